//! Slopes: centroids to tip and tilt, with reference slopes, a 2 x 2 gain and a validity rule.
//!
//! ```text
//! s = G (c - reference)
//! ```
//!
//! `c` in Q16 pixels; `s` is the tip (x) and tilt (y) of the segment as its centre-to-edge optical
//! path difference in ulp, so that the path difference across the edge between neighbours i and j
//! is exactly s_i + s_j. The 2 x 2 matrix carries pixel scale, rotation, flips and centroid gain:
//! 16-bit mantissas under one exponent for all, products in i64 (2^15 x 2^33 x 2 = 2^49), rounded
//! once, saturated to +-2^23 ulp.

use crate::centroid::Measurement;
use crate::fixed::{self, CENTROID_BITS, TILT_LIMIT};
use serde::{Deserialize, Serialize};

/// What is done with the mean slope over the valid subapertures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum MeanSlope {
    /// Removed, of slopes and of commands: SPLASH cannot see a global tilt.
    #[default]
    Remove,
    /// Kept: a natural guide star shows the global tilt.
    Keep,
}

/// The slope calibration of one subaperture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct SlopeCalibration {
    /// Reference slope, Q16 pixels.
    pub(crate) reference_q16: [i32; 2],
    /// Rows tip and tilt, columns x and y: ulp per pixel = mantissa 2^exponent.
    pub(crate) gain: [[i16; 2]; 2],
    /// Least flux of a valid measurement, calibrated units; at least 1.
    pub(crate) flux_min: u32,
    /// Greatest flux of a valid measurement, calibrated units.
    pub(crate) flux_max: u32,
}

/// The slope of one subaperture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Slope {
    /// Tip and tilt, centre-to-edge path difference, ulp.
    pub tilt_ulp: [i32; 2],
    /// Whether the flux is within its limits.
    pub valid: bool,
}

/// The slope that a measurement stands for; `exponent` is that of the gain's mantissas, 0 to 15.
#[inline]
pub(crate) fn slope(
    calibration: &SlopeCalibration,
    exponent: u32,
    measurement: &Measurement,
) -> Slope {
    let [cx, cy] = measurement.centroid_q16;
    let [rx, ry] = calibration.reference_q16;
    // 64 bits: a centroid from elsewhere may be any i32. The products stay below 2^49.
    let (x, y) = (i64::from(cx) - i64::from(rx), i64::from(cy) - i64::from(ry));
    let shift = CENTROID_BITS - exponent;
    let tilt_ulp = calibration.gain.map(|[gx, gy]| {
        let product = i64::from(gx) * x + i64::from(gy) * y;
        fixed::saturate(fixed::round_shift(product, shift), TILT_LIMIT)
    });
    let flux = measurement.flux;
    let valid = flux >= calibration.flux_min && flux <= calibration.flux_max;
    Slope { tilt_ulp, valid }
}
