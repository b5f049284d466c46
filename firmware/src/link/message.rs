//! What is said on the link.

use crate::centroid::Measurement;
use crate::error::{ConfigError, Field, Limit};
use crate::image::ImageError;
use crate::pipeline::{GlobalTilt, Report, RowError, Totals};
use crate::segments::{ACTUATORS, Position};
use crate::slopes::Slope;
use core::fmt;
use serde::{Deserialize, Serialize};

/// Entries in a piece of a list.
pub const LIST: usize = 16;

/// Bytes in a piece of an image.
pub const PIECE: usize = 256;

/// A piece of a list.
pub type List<T> = heapless::Vec<T, LIST>;

/// What a PC asks of a board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "without allocation nothing can be put elsewhere")]
pub enum Request {
    /// Answered by [`Response::Identity`].
    Identify,
    /// A configuration image of so many bytes follows as [`Request::Piece`]s. Answered, after the
    /// last of them, by [`Response::Ready`] or [`Response::Refused`].
    Load {
        /// Length of the image.
        bytes: u32,
    },
    /// A piece of the image. Not answered.
    Piece {
        /// Where it belongs.
        offset: u32,
        /// The bytes.
        bytes: heapless::Vec<u8, PIECE>,
    },
    /// Opens the loop. Answered by the flat mirror's codes, totals and [`Response::Ready`].
    Reset,
    /// A frame of so many pixels comes on the detector port, row after row. Answered by what the
    /// frame left, [`Response::Report`] last, or by [`Response::Refused`].
    Frame {
        /// Its number.
        number: u32,
        /// Its pixels.
        pixels: u32,
    },
    /// Measurements for [`Request::MeasuredFrame`]; `first` = 0 begins anew. Not answered.
    Measurements {
        /// Subaperture of the first.
        first: u16,
        /// In mask order.
        items: List<Measurement>,
    },
    /// A frame without pixels, of the measurements that came before. Answered as
    /// [`Request::Frame`] is.
    MeasuredFrame {
        /// Its number.
        number: u32,
        /// How many measurements it has.
        count: u32,
    },
    /// A global tilt. Answered by [`Response::Ready`].
    GlobalTilt(GlobalTilt),
    /// Answered by [`Response::Stack`].
    Stack,
}

/// What a board answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Response {
    /// What it is.
    Identity(Identity),
    /// Done.
    Ready,
    /// Not done.
    Refused(Reason),
    /// DAC codes of the segments from `first` on.
    Codes {
        /// Subaperture of the first.
        first: u16,
        /// In mask order.
        items: List<[u16; ACTUATORS]>,
    },
    /// Measurements of the last complete frame.
    Measurements {
        /// Subaperture of the first.
        first: u16,
        /// In mask order.
        items: List<Measurement>,
    },
    /// Slopes of the last complete frame.
    Slopes {
        /// Subaperture of the first.
        first: u16,
        /// In mask order.
        items: List<Slope>,
    },
    /// Positions of the segments.
    Positions {
        /// Subaperture of the first.
        first: u16,
        /// In mask order.
        items: List<Position>,
    },
    /// Totals since the last reset.
    Totals(Totals),
    /// What became of a frame: the last of its answers.
    Report(Report),
    /// The stack since the start.
    Stack(Stack),
}

/// How deep a board's stack went.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stack {
    /// The most that was in use at once, bytes.
    pub used: u32,
    /// What the board keeps for it, bytes.
    pub reserved: u32,
}

/// What a board is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Its name.
    pub board: heapless::String<16>,
    /// Version of the firmware library in it.
    pub version: heapless::String<16>,
    /// Cells of the subaperture grid that it has room for.
    pub cells: u32,
    /// Window pixels that it has room for.
    pub pixels: u32,
    /// Pixels that brightest-n can buffer.
    pub buffered: u32,
}

/// Why a board did not do what it was asked.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Reason {
    /// The image ended early, or a piece of it was lost.
    ImageCut,
    /// The bytes are not an image of the version that the board reads.
    ImageUnknown,
    /// The image is damaged.
    ImageDamaged,
    /// A value is out of its limits, or does not fit the board.
    Value {
        /// The field.
        field: Field,
        /// Which entry of a field that has many.
        index: Option<u32>,
        /// The value it had.
        value: f64,
        /// Lowest and highest value; `None` for a rule that a range does not say.
        limits: Option<[f64; 2]>,
    },
    /// A row of pixels, or the list of measurements.
    Row(RowError),
}

impl From<ImageError> for Reason {
    fn from(error: ImageError) -> Self {
        match error {
            ImageError::Cut => Self::ImageCut,
            ImageError::NotAnImage | ImageError::Version { .. } => Self::ImageUnknown,
            ImageError::Malformed | ImageError::Checksum => Self::ImageDamaged,
            ImageError::Refused(ConfigError { field, index, value, limit }) => {
                let limits = match limit {
                    Limit::Within(low, high) | Limit::Between(low, high) => Some([low, high]),
                    Limit::Elevation { most, .. } => Some([0.0, most]),
                    Limit::Rule(_) => None,
                };
                Self::Value { field, index, value, limits }
            }
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ImageCut => ImageError::Cut.fmt(f),
            Self::ImageUnknown => f.write_str("not a configuration image that this board reads"),
            Self::ImageDamaged => f.write_str("configuration image is damaged"),
            Self::Value { field, index, value, limits } => {
                let limit = match *limits {
                    Some([low, high]) => Limit::Within(low, high),
                    None => Limit::Rule("breaks a rule of the board"),
                };
                ConfigError { field: *field, index: *index, value: *value, limit }.fmt(f)
            }
            Self::Row(error) => error.fmt(f),
        }
    }
}
