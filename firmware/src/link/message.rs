//! What is said on the link.

use crate::adjust::{AdjustError, Adjustment, Parameter};
use crate::banks::{BankError, DraftState};
use crate::calibration::{Calibration, Uncalibrated};
use crate::centroid::Measurement;
use crate::controller::Command;
use crate::error::{ConfigError, Field, Limit};
use crate::fault::{KINDS, Moment, Record as FaultRecord};
use crate::gate::GateStamp;
use crate::image::ImageError;
use crate::interlock::Outputs;
use crate::mirror::Serials;
use crate::mode::{Mode, Refusal, Transition};
use crate::pipeline::{GlobalTilt, Report, RowError, Totals};
use crate::segments::{ACTUATORS, Position};
use crate::slopes::Slope;
use crate::store::{StoreError, Stored};
use crate::telemetry::{Decimation, Dropped, Record};
use core::fmt;
use serde::{Deserialize, Serialize};

/// Entries in a piece of a list.
pub const LIST: usize = 16;

/// Bytes in a piece of an image.
pub const PIECE: usize = 256;

/// Entries in a piece of a history.
pub const HISTORY: usize = 8;

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
        /// Window of the first.
        first: u16,
        /// In mask order, a second gate's behind the others.
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
    /// Answered by [`Response::Status`].
    Status,
    /// An image of so many bytes comes into the other bank, as [`Request::Chunk`]s. Answered, like
    /// all that is done to the other bank, by [`Response::Draft`] or [`Response::Refused`].
    Upload {
        /// Length of the image.
        bytes: u32,
    },
    /// The next bytes of the image.
    Chunk {
        /// Where they belong.
        offset: u32,
        /// The bytes.
        bytes: heapless::Vec<u8, PIECE>,
    },
    /// Makes the other bank a copy of the one that runs.
    Copy,
    /// Changes the other bank.
    Adjust(Adjustment),
    /// Checks the other bank as a whole.
    Check,
    /// Has the other bank run from the next frame on.
    Switch,
    /// Gives up what is in the other bank.
    Discard,
    /// A parameter of what runs. Answered by [`Response::Value`].
    Get(Parameter),
    /// The image of what runs. Answered by [`Response::Image`]s, and [`Response::Ready`] behind them.
    ReadBack {
        /// First byte.
        offset: u32,
        /// How many; those behind the image's end do not come.
        bytes: u32,
    },
    /// Stores what runs in flash, in safe and standby modes. Answered by [`Response::Stored`].
    Store,
    /// What is stored. Answered by [`Response::Stored`].
    Stored,
    /// Loads what is stored into the other bank.
    Restore,
    /// The calibration of what runs. Answered by [`Response::Calibration`], or refused with what is
    /// missing.
    Calibration,
    /// Asks for telemetry; `None`: as much as suits the link. Answered by [`Response::Streams`].
    Subscribe(Option<Decimation>),
    /// What telemetry comes. Answered by [`Response::Streams`].
    Streams,
    /// Answered by [`Response::Counters`].
    Counters,
    /// The last faults. Answered by [`Response::Faults`], and [`Response::Ready`] behind them.
    Faults,
    /// The last transitions between modes. Answered by [`Response::Transitions`], and
    /// [`Response::Ready`] behind them.
    Transitions,
    /// What an operator asks of the controller. Answered by [`Response::Ready`].
    Command(Command),
    /// Raw pixels of a row of the next frame: as many as fit into a piece. Answered, behind that frame,
    /// by [`Response::Pixels`].
    Pixels {
        /// The row.
        row: u16,
        /// Column of the first.
        first: u16,
    },
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
    /// Measurements of the last complete frame, of all windows.
    Measurements {
        /// Window of the first.
        first: u16,
        /// In mask order, a second gate's behind the others.
        items: List<Measurement>,
    },
    /// Slopes of the last complete frame, of all windows.
    Slopes {
        /// Window of the first.
        first: u16,
        /// In the same order.
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
    /// How it is.
    Status(Status),
    /// What is in the other bank.
    Draft(DraftState),
    /// The present value of a parameter.
    Value(Adjustment),
    /// Bytes of the image of what runs.
    Image {
        /// Where they belong.
        offset: u32,
        /// The bytes.
        bytes: heapless::Vec<u8, PIECE>,
    },
    /// What is stored in flash; `None` if nothing whole is.
    Stored(Option<Stored>),
    /// The calibration of what runs, which fits it.
    Calibration(Calibration),
    /// What telemetry comes.
    Streams {
        /// Every how many frames.
        decimation: Decimation,
        /// What was dropped since the subscription: frames, slopes, commands, codes, fluxes.
        dropped: Dropped,
    },
    /// Telemetry, unasked for: its sequence number is 0.
    Telemetry(Record),
    /// What was counted.
    Counters(Counters),
    /// The last faults, oldest first.
    Faults {
        /// Place of the first.
        first: u16,
        /// With when they were.
        items: heapless::Vec<FaultRecord, HISTORY>,
    },
    /// The last transitions between modes, oldest first.
    Transitions {
        /// Place of the first.
        first: u16,
        /// With why and when they were.
        items: heapless::Vec<Transition, HISTORY>,
    },
    /// Raw pixels of a row.
    Pixels {
        /// The frame they are of.
        frame: u32,
        /// ADU, u16 little-endian.
        bytes: heapless::Vec<u8, PIECE>,
    },
}

/// How a board is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Hash of the firmware library's source.
    pub build: u32,
    /// Hash of the configuration that runs; 0 without one.
    pub configuration: u32,
    /// Serial numbers of the hardware; 0 is not stated.
    pub serials: Serials,
    /// What is in the other bank.
    pub draft: DraftState,
    /// Why it does not run although it was to.
    pub draft_refused: Option<Refusal>,
    /// The mode.
    pub mode: Mode,
    /// What the interlock lets on.
    pub outputs: Outputs,
    /// The last frame, and the time now.
    pub at: Moment,
    /// Ticks of the board's clock in a second; 0 without a clock.
    pub ticks_per_second: u32,
    /// The gate of the last frame.
    pub gate: GateStamp,
    /// Rms over the valid subapertures of the path difference that the last frame's tips and tilts
    /// leave, nm.
    pub tilt_rms_nm: f32,
}

/// What a board has counted since its start; all saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Frames, since the last reset.
    pub totals: Totals,
    /// Faults, by kind: see [`crate::fault::NAMES`].
    pub faults: [u32; KINDS],
    /// Transitions between modes that were refused.
    pub refused_transitions: u32,
    /// Frames on the link that were no message.
    pub unreadable_messages: u32,
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
    /// The other bank is empty.
    Empty,
    /// An image is still coming into the other bank.
    Receiving {
        /// Where its next bytes belong.
        due: u32,
        /// Its length.
        length: u32,
    },
    /// No image is coming.
    NotReceiving,
    /// A chunk belongs elsewhere; the one that is due can still come.
    Offset {
        /// Where it belongs.
        found: u32,
        /// Where the next bytes belong.
        due: u32,
    },
    /// The image is longer than was said.
    Length {
        /// Its end.
        found: u32,
        /// What was said.
        length: u32,
    },
    /// The other bank has changed since it was checked.
    NotChecked,
    /// The other bank is about to run.
    Ordered,
    /// There is no configuration.
    NotConfigured,
    /// Mask, windows and detector change by whole images only.
    Geometry,
    /// There are fewer entries than that.
    Place {
        /// First entry that there is not.
        found: u32,
        /// How many there are.
        entries: u32,
    },
    /// The image is longer than a slot of the flash.
    Slot {
        /// With its header, bytes.
        found: u32,
        /// Bytes of a slot.
        slot: u32,
    },
    /// The flash refuses, or does not keep what is written to it.
    Flash,
    /// Nothing whole is stored.
    NothingStored,
    /// There is no calibration that fits.
    Uncalibrated(Uncalibrated),
    /// The mode, or what it asks for, does not allow it.
    Mode(Refusal),
    /// This board has none of that.
    Unsupported,
}

impl From<BankError> for Reason {
    fn from(error: BankError) -> Self {
        match error {
            BankError::Empty => Self::Empty,
            BankError::Receiving { due, length } => Self::Receiving { due, length },
            BankError::NotReceiving => Self::NotReceiving,
            BankError::Offset { found, due } => Self::Offset { found, due },
            BankError::Length { found, length } => Self::Length { found, length },
            BankError::Image(error) => error.into(),
            BankError::Adjust(error) => error.into(),
            BankError::NotChecked => Self::NotChecked,
            BankError::Ordered => Self::Ordered,
        }
    }
}

impl From<AdjustError> for Reason {
    fn from(error: AdjustError) -> Self {
        match error {
            AdjustError::NotConfigured => Self::NotConfigured,
            AdjustError::Geometry => Self::Geometry,
            AdjustError::Place { found, entries } => Self::Place { found, entries },
            AdjustError::Value(error) => ImageError::Refused(error).into(),
        }
    }
}

impl<E> From<StoreError<E>> for Reason {
    fn from(error: StoreError<E>) -> Self {
        match error {
            StoreError::Flash(_) | StoreError::Unreliable => Self::Flash,
            StoreError::NotConfigured => Self::NotConfigured,
            StoreError::Long { found, slot } => Self::Slot { found, slot },
            StoreError::Nothing => Self::NothingStored,
            StoreError::Image(error) => error.into(),
        }
    }
}

impl From<Uncalibrated> for Reason {
    fn from(error: Uncalibrated) -> Self {
        Self::Uncalibrated(error)
    }
}

impl From<Refusal> for Reason {
    fn from(refusal: Refusal) -> Self {
        Self::Mode(refusal)
    }
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
            Self::Empty => BankError::Empty.fmt(f),
            Self::Receiving { due, length } => {
                BankError::Receiving { due: *due, length: *length }.fmt(f)
            }
            Self::NotReceiving => BankError::NotReceiving.fmt(f),
            Self::Offset { found, due } => BankError::Offset { found: *found, due: *due }.fmt(f),
            Self::Length { found, length } => {
                BankError::Length { found: *found, length: *length }.fmt(f)
            }
            Self::NotChecked => BankError::NotChecked.fmt(f),
            Self::Ordered => BankError::Ordered.fmt(f),
            Self::NotConfigured => f.write_str("the board has no configuration"),
            Self::Geometry => AdjustError::Geometry.fmt(f),
            Self::Place { found, entries } => {
                AdjustError::Place { found: *found, entries: *entries }.fmt(f)
            }
            Self::Slot { found, slot } => {
                StoreError::<()>::Long { found: *found, slot: *slot }.fmt(f)
            }
            Self::Flash => f.write_str("the flash refuses, or does not keep what is written to it"),
            Self::NothingStored => StoreError::<()>::Nothing.fmt(f),
            Self::Uncalibrated(error) => error.fmt(f),
            Self::Mode(refusal) => refusal.fmt(f),
            Self::Unsupported => f.write_str("the board has none of that"),
        }
    }
}
