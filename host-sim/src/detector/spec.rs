//! What a detector is, in numbers, and their limits.

use serde::{Deserialize, Serialize};

/// Largest side of a frame, pixels: larger than any wavefront-sensor detector, small enough that
/// a slip of the pen does not ask for all the memory.
const MAX_SIDE: usize = 8192;

/// Largest rms of the pixel response: beyond it a Gaussian response is negative too often.
const MAX_RESPONSE_RMS: f64 = 0.25;

/// A detector's description. Every field has a default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectorSpec {
    /// Columns, 1 to 8192 pixels. Default 128.
    pub width: usize,
    /// Rows, 1 to 8192 pixels. Default 128.
    pub height: usize,
    /// Bits of a code, 8 to 16. Default 12.
    pub bits: u32,
    /// Photo-electrons per code step, e-/ADU, above 0. Default 4.
    pub gain_e_per_adu: f64,
    /// Read noise, e- rms, 0 or more. Default 3.
    pub read_noise_e: f64,
    /// Mean dark charge and stray light per pixel and frame, e-, 0 or more. Default 0.
    pub dark_e_per_frame: f64,
    /// Code of an empty pixel, ADU, from 0 to the largest code. Default 64: with the default read
    /// noise the code's noise never reaches zero, where clipping would bias a mean.
    pub bias_adu: f64,
    /// Charge at which a pixel saturates, e-, above 0. Default 20000.
    pub full_well_e: f64,
    /// Pixels that do not work. Default none.
    pub bad_pixels: Vec<BadPixel>,
    /// Pixel-to-pixel rms of the response to light, as a fraction, 0 to 0.25. Default 0.
    pub response_rms: f64,
    /// Seed of the response map: another seed, another device. Default 0.
    pub response_seed: u64,
}

impl Default for DetectorSpec {
    fn default() -> Self {
        Self {
            width: 128,
            height: 128,
            bits: 12,
            gain_e_per_adu: 4.0,
            read_noise_e: 3.0,
            dark_e_per_frame: 0.0,
            bias_adu: 64.0,
            full_well_e: 20_000.0,
            bad_pixels: Vec::new(),
            response_rms: 0.0,
            response_seed: 0,
        }
    }
}

/// A pixel that does not work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BadPixel {
    /// Column, pixels from the left.
    pub x: usize,
    /// Row, pixels from the first.
    pub y: usize,
    /// What is wrong with it.
    pub kind: PixelFault,
}

/// What is wrong with a bad pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PixelFault {
    /// Its dark current fills the well in every frame.
    Hot,
    /// It collects nothing: bias and read noise only.
    Dead,
}

/// Why a detector, or a frame for it, was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DetectorError {
    /// A number of the specification is out of its limits.
    #[error("detector: {field} = {value}, must be {limit}")]
    Field {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        limit: String,
    },
    /// A bad pixel is not on the detector.
    #[error("detector: bad pixel ({x}, {y}) is outside the {width} x {height} frame")]
    BadPixel {
        /// Column of the pixel.
        x: usize,
        /// Row of the pixel.
        y: usize,
        /// Columns of the frame.
        width: usize,
        /// Rows of the frame.
        height: usize,
    },
    /// A slice does not have the right number of elements.
    #[error("detector: {what} has {found} elements, expected {expected}")]
    Size {
        /// Which slice.
        what: &'static str,
        /// Elements it must have.
        expected: usize,
        /// Elements it has.
        found: usize,
    },
    /// A spot's window leaves the detector.
    #[error(
        "detector: window of spot {spot}, {window} x {window} pixels at ({x}, {y}), leaves the \
         {width} x {height} frame"
    )]
    Window {
        /// Index of the spot.
        spot: usize,
        /// First column of the window.
        x: usize,
        /// First row of the window.
        y: usize,
        /// Side of the window, pixels.
        window: usize,
        /// Columns of the frame.
        width: usize,
        /// Rows of the frame.
        height: usize,
    },
}

impl DetectorSpec {
    /// The largest code, 2^bits - 1.
    pub fn max_code(&self) -> u16 {
        ((1_u32 << self.bits.min(16)) - 1) as u16
    }

    /// Checks every field against its limits.
    ///
    /// # Errors
    /// Names the first field that is out of its limits.
    pub fn check(&self) -> Result<(), DetectorError> {
        let sides = 1.0..=MAX_SIDE as f64;
        within("width", self.width as f64, sides.clone())?;
        within("height", self.height as f64, sides)?;
        within("bits", f64::from(self.bits), 8.0..=16.0)?;
        above_zero("gain_e_per_adu", self.gain_e_per_adu)?;
        within("read_noise_e", self.read_noise_e, 0.0..=f64::MAX)?;
        within("dark_e_per_frame", self.dark_e_per_frame, 0.0..=f64::MAX)?;
        within("bias_adu", self.bias_adu, 0.0..=f64::from(self.max_code()))?;
        above_zero("full_well_e", self.full_well_e)?;
        within("response_rms", self.response_rms, 0.0..=MAX_RESPONSE_RMS)?;
        let outside = |pixel: &&BadPixel| pixel.x >= self.width || pixel.y >= self.height;
        match self.bad_pixels.iter().find(outside) {
            None => Ok(()),
            Some(&BadPixel { x, y, .. }) => {
                Err(DetectorError::BadPixel { x, y, width: self.width, height: self.height })
            }
        }
    }
}

/// NaN fails the range test as well.
fn within(
    field: &'static str,
    value: f64,
    range: std::ops::RangeInclusive<f64>,
) -> Result<(), DetectorError> {
    if range.contains(&value) {
        return Ok(());
    }
    let limit = if *range.end() == f64::MAX {
        format!("finite and at least {}", range.start())
    } else {
        format!("from {} to {}", range.start(), range.end())
    };
    Err(DetectorError::Field { field, value, limit })
}

fn above_zero(field: &'static str, value: f64) -> Result<(), DetectorError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(DetectorError::Field { field, value, limit: "finite and above 0".into() })
    }
}
