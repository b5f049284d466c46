//! Slopes: centroids to tip and tilt, with reference slopes, a 2 x 2 gain and a validity rule.
//!
//! ```text
//! s = G (c - reference)
//! ```
//!
//! `c` in Q16 pixels; `s` is the tip (x) and tilt (y) of the segment as its centre-to-edge optical
//! path difference in ulp, so that the path difference across the edge between neighbours i and j
//! is exactly s_i + s_j. The 2 x 2 matrix carries pixel scale, rotation, flips and centroid gain:
//! 16-bit mantissas under one exponent e for all. |c - reference| < 2^23 (64 px and 32 px), so that it has room for
//! seven bits more, and a mantissa for up to seven of its exponent beside those that make a whole ulp of the upper half
//! of a product. Both products are rounded down, and their sum, below 2^30, is saturated to +-2^23 ulp. Up to e = 7
//! (2^22 ulp a pixel, 32 pixels a stroke) that is the exact product or less by less than 2 ulp, which is 2^-8 of a DAC's
//! last place; beyond, by less than 2^(e-6).

use crate::centroid::Measurement;
use crate::fixed::{self, CENTROID_BITS, TILT_LIMIT};
use serde::{Deserialize, Serialize};

/// What is done with the mean slope over the valid subapertures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum MeanSlope {
    /// Removed: SPLASH cannot see a global tilt.
    #[default]
    Remove,
    /// Kept: a natural guide star shows the global tilt.
    Keep,
}

/// The slope calibration of one subaperture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlopeCalibration {
    /// Reference slope, Q16 pixels.
    pub reference_q16: [i32; 2],
    /// Rows tip and tilt, columns x and y: ulp per pixel = mantissa 2^exponent.
    pub gain: [[i16; 2]; 2],
    /// Least flux of a valid measurement, calibrated units; at least 1.
    pub flux_min: u32,
    /// Greatest flux of a valid measurement, calibrated units.
    pub flux_max: u32,
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

/// Exponent of the gains' mantissas as shifts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct SlopeScale {
    /// Of a mantissa.
    pub(crate) up: u32,
    /// Of the sum of products, and the limit before it.
    pub(crate) left: u32,
    pub(crate) limit: i32,
}

/// Bits that a centroid's difference has free above it.
pub(crate) const HEADROOM: u32 = 7;
/// Bits by which a mantissa is shifted up, so that the upper half of its product is in ulp.
const WHOLE: u32 = 32 - CENTROID_BITS - HEADROOM;

impl SlopeScale {
    /// For gains of mantissa times 2^exponent ulp a pixel, 0 to 15.
    pub(crate) const fn new(exponent: u32) -> Self {
        // A mantissa has 16 bits.
        let left = exponent.saturating_sub(16 - WHOLE);
        Self { up: WHOLE + exponent - left, left, limit: TILT_LIMIT >> left }
    }

    /// A mantissa as a factor of a product.
    #[inline(always)]
    pub(crate) const fn factor(self, mantissa: i16) -> i32 {
        (mantissa as i32) << self.up
    }
}

impl SlopeCalibration {
    /// Whether no centroid of signals, within (W - 1) / 2 pixels and two ulp of the centre of a window of this size,
    /// makes a slope that has to be limited.
    pub(crate) fn is_free(&self, scale: SlopeScale, window: usize) -> bool {
        let inside = (window as i64 - 1) << (CENTROID_BITS - 1);
        let reach = self.reference_q16.map(|r| i64::from(r.unsigned_abs()) + inside + 2);
        self.gain.iter().all(|row| {
            let products =
                row.iter().zip(reach).map(|(&g, x)| i64::from(scale.factor(g)).abs() * x);
            // Both are rounded down.
            (products.sum::<i64>() >> (32 - HEADROOM)) + 2 <= i64::from(scale.limit)
        })
    }
}

/// The slope that a measurement stands for.
#[inline]
pub(crate) fn slope(
    calibration: &SlopeCalibration,
    scale: SlopeScale,
    measurement: &Measurement,
) -> Slope {
    let [cx, cy] = measurement.centroid_q16;
    let [rx, ry] = calibration.reference_q16;
    let (x, y) = (cx.wrapping_sub(rx) << HEADROOM, cy.wrapping_sub(ry) << HEADROOM);
    let tilt_ulp = calibration.gain.map(|[gx, gy]| {
        let product = |gain: i16, c: i32| fixed::mul_high(scale.factor(gain), c);
        let sum = product(gx, x).wrapping_add(product(gy, y));
        fixed::clamp(sum, scale.limit) << scale.left
    });
    let flux = measurement.flux;
    let valid = (flux >= calibration.flux_min) & (flux <= calibration.flux_max);
    Slope { tilt_ulp, valid }
}

/// Whether a flux is within the limits of a frame that had `pulses`, Q16, of what was asked, up to
/// 2^16: limits in proportion, rounded down, the lower one at least 1.
pub(crate) fn valid_in_proportion(
    calibration: &SlopeCalibration,
    flux: u32,
    pulses_q16: u32,
) -> bool {
    let scaled = |limit: u32| ((u64::from(limit) * u64::from(pulses_q16)) >> 16) as u32;
    flux >= scaled(calibration.flux_min).max(1) && flux <= scaled(calibration.flux_max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slopes of the furthest centroids, with and without limits, of gains and references of all sizes.
    #[test]
    fn free_slopes_need_no_limits() {
        let mut free = 0;
        for (exponent, gain) in
            (0..10).flat_map(|e| (6..16).map(move |b| (e, i16::MAX >> (15 - b))))
        {
            let scale = SlopeScale::new(exponent);
            for (window, reference) in [(8, 0), (8, 1 << 19), (16, -70_000), (32, 1 << 21)] {
                let calibration = SlopeCalibration {
                    reference_q16: [reference, -reference],
                    gain: [[gain, -gain / 3], [gain / 5, -gain]],
                    flux_min: 1,
                    flux_max: 1,
                };
                if !calibration.is_free(scale, window) {
                    continue;
                }
                free += 1;
                let edge = ((window as i32 - 1) << (CENTROID_BITS - 1)) + 2;
                for centroid_q16 in [[edge, edge], [edge, -edge], [-edge, edge], [-edge, -edge]] {
                    let measurement = Measurement { centroid_q16, ..Measurement::default() };
                    let limited = slope(&calibration, scale, &measurement).tilt_ulp;
                    let [x, y] = [0, 1].map(|axis| {
                        f64::from(centroid_q16[axis] - calibration.reference_q16[axis]) / 65_536.0
                    });
                    for (tilt, [gx, gy]) in limited.into_iter().zip(calibration.gain) {
                        let exact =
                            f64::exp2(exponent.into()) * (f64::from(gx) * x + f64::from(gy) * y);
                        let step = f64::exp2(scale.left.into());
                        let below = (exact - f64::from(tilt)) / step;
                        assert!((0.0..2.0).contains(&below), "{tilt} for {exact}");
                        assert!(tilt.abs() < TILT_LIMIT);
                    }
                }
            }
        }
        assert!(free > 100, "{free}");
    }

    #[test]
    fn limits_shrink_with_the_pulses() {
        let calibration = SlopeCalibration {
            reference_q16: [0; 2],
            gain: [[1, 0], [0, 1]],
            flux_min: 1000,
            flux_max: 60_000,
        };
        let valid = |flux, pulses_q16| valid_in_proportion(&calibration, flux, pulses_q16);
        for (pulses, low, high) in [(1 << 16, 1000, 60_000), (1 << 15, 500, 30_000)] {
            assert!(!valid(low - 1, pulses) && valid(low, pulses));
            assert!(valid(high, pulses) && !valid(high + 1, pulses));
        }
        assert!(!valid(0, 0), "no pulse, no light");
    }
}
