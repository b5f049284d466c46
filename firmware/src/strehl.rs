//! What slopes say of the wavefront: an estimate, for a person who looks at it.
//!
//! In floating point: not for the frame path, which leaves [`tilt_squared`] to be judged later.

use crate::slopes::Slope;
use micromath::F32Ext;

/// Sum of tip^2 + tilt^2 over valid slopes, ulp^2: below 2^57 for 1600 subapertures.
#[must_use]
pub fn tilt_squared(slopes: &[Slope]) -> u64 {
    slopes.iter().fold(0, |sum, slope| {
        let squares = slope.tilt_ulp.map(|tilt| u64::from(tilt.unsigned_abs()).pow(2));
        // |tilt| <= 2^23; a mask keeps the time the same.
        let [tip, tilt] = squares.map(|square| square & u64::from(slope.valid).wrapping_neg());
        sum.wrapping_add(tip).wrapping_add(tilt)
    })
}

/// Rms over the valid subapertures of the path difference that their measured tips and tilts leave, nm.
///
/// `squared_ulp2` is the sum of tip^2 + tilt^2 in ulp of `ulp_m`; a tip t from centre to edge has a
/// variance of t^2 / 3 over its square. Noise and fitting: what the sensor sees counts, noise included;
/// what is finer than a subaperture, and pistons, do not. Zero without valid subapertures.
#[must_use]
pub fn tilt_rms_nm(squared_ulp2: u64, valid: u16, ulp_m: f64) -> f32 {
    if valid == 0 {
        return 0.0;
    }
    let mean = squared_ulp2 as f32 / (3.0 * f32::from(valid));
    // ulp are fractions of a nanometre: scaled before f32 could lose them.
    F32Ext::sqrt(mean) * (ulp_m * 1e9) as f32
}

/// Strehl ratio by Marechal's approximation, exp(-sigma^2), of a path difference of `rms_nm` alone.
#[must_use]
pub fn strehl(rms_nm: f32, wavelength_nm: f32) -> f32 {
    let sigma = 2.0 * core::f32::consts::PI * rms_nm / wavelength_nm;
    F32Ext::exp(-(sigma * sigma))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_slopes_do_not_count() {
        let slope = |tilt_ulp, valid| Slope { tilt_ulp, valid };
        let slopes = [slope([3, -4], true), slope([100, 100], false), slope([1 << 23, 0], true)];
        assert_eq!(tilt_squared(&slopes), 25 + (1 << 46));
    }

    /// 52 subapertures, each tipped by 30 nm and tilted by 40 nm from centre to edge.
    #[test]
    fn known_tilts_have_their_rms() {
        let ulp_m = 0.3e-9;
        let squared = 52 * (100u64.pow(2) + 133u64.pow(2));
        let expected = f64::sqrt((30.0f64.powi(2) + 39.9f64.powi(2)) / 3.0);
        let found = f64::from(tilt_rms_nm(squared, 52, ulp_m));
        // The square root of micromath is one step of Newton's away from exact.
        assert!((found / expected - 1.0).abs() < 0.05, "{found}, {expected}");
        assert_eq!(tilt_rms_nm(0, 0, ulp_m), 0.0);
    }

    #[test]
    fn strehl_is_marechals_within_what_a_log_shows() {
        for rms in [0.0, 10.0, 30.0, 60.0, 100.0, 200.0] {
            let sigma = core::f64::consts::TAU * rms / 532.0;
            let expected = f64::exp(-sigma * sigma);
            let found = f64::from(strehl(rms as f32, 532.0));
            assert!((found - expected).abs() < 0.01, "{rms}: {found}, {expected}");
        }
    }

    #[test]
    fn the_largest_sums_do_no_harm() {
        assert!(tilt_rms_nm(u64::MAX, 1, 1e-9).is_finite());
        assert!((0.0..=1.0).contains(&strehl(tilt_rms_nm(u64::MAX, 1, 1e-9), 532.0)));
    }
}
