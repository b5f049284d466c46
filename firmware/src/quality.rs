//! The frame-quality gate: which frames may be reconstructed.
//!
//! A complete frame is refused, and the ladder told, by the first of these that holds:
//!
//! ```text
//! number       not one that follows the last frame's (see [`crate::frame_counter`])
//! valid        subapertures with a valid flux      below `valid_min`
//! flux         sum over all windows                outside `flux_min ..= flux_max`
//! saturation   saturated watched pixels            above `saturated_pixels_max`
//! ```
//!
//! Fluxes are u32 in calibrated units; their sum over at most 1600 windows is below 2^43. A
//! [second gate](crate::modal) does not count: without it there still is a frame to follow.

use crate::centroid::Measurement;
use crate::fault::Fault;
use crate::report::Report;
use serde::{Deserialize, Serialize};

/// What a frame must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct QualityLimits {
    /// Subapertures that must have a valid flux.
    pub valid_min: u16,
    /// Least flux of all windows together, flux units.
    pub flux_min: u64,
    /// Greatest flux of all windows together, flux units.
    pub flux_max: u64,
    /// Watched pixels that may be saturated.
    pub saturated_pixels_max: u32,
}

impl QualityLimits {
    /// Every frame passes.
    pub const NONE: Self =
        Self { valid_min: 0, flux_min: 0, flux_max: u64::MAX, saturated_pixels_max: u32::MAX };

    /// Refuses what must not be reconstructed. `lit` of all subapertures were lit, and as many
    /// valid ones are asked for, rounded up; the frame had `seen` of `asked` pulses, and the flux that is
    /// asked of it is in their proportion, rounded down. A window that was not lit counts with the flux that
    /// it last had.
    ///
    /// # Errors
    /// The fault.
    pub fn check(
        &self,
        report: &Report,
        measurements: &[Measurement],
        lit: usize,
        [seen, asked]: [u32; 2],
    ) -> Result<(), Fault> {
        let Self { valid_min, flux_min, flux_max, saturated_pixels_max } = *self;
        let all = measurements.len().max(1);
        // Both below 2^11.
        let least = (usize::from(valid_min) * lit).div_ceil(all) as u16;
        if report.valid < least {
            return Err(Fault::TooFewValid { valid: report.valid, least });
        }
        let add = |sum: u64, m: &Measurement| sum.wrapping_add(m.flux.into());
        let flux = measurements.iter().fold(0, add);
        let [low, high] = [flux_min, flux_max].map(|limit| in_proportion(limit, seen, asked));
        for (broken, limit) in [(flux < low, low), (flux > high, high)] {
            if broken {
                return Err(Fault::TotalFlux { flux, limit });
            }
        }
        let pixels = report.saturated_pixels;
        if pixels > saturated_pixels_max {
            return Err(Fault::SaturatedPixels { pixels, most: saturated_pixels_max });
        }
        Ok(())
    }
}

/// limit seen / asked, rounded down; the limit itself unless pulses are missing.
fn in_proportion(limit: u64, seen: u32, asked: u32) -> u64 {
    if seen >= asked {
        return limit;
    }
    // Below the limit, since seen < asked.
    (u128::from(limit) * u128::from(seen) / u128::from(asked.max(1))) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::Outcome;

    const LIMITS: QualityLimits =
        QualityLimits { valid_min: 40, flux_min: 1000, flux_max: 5000, saturated_pixels_max: 3 };
    const WHOLE: [u32; 2] = [10, 10];

    fn report(valid: u16, saturated_pixels: u32) -> Report {
        Report {
            frame: 0,
            outcome: Outcome::Updated,
            valid,
            saturated_pixels,
            residual_squared: 0,
            saturated_actuators: 0,
            slewed_actuators: 0,
            extra_rows: 0,
            restarted: false,
            global_tilt_age: None,
            global_tilt_stale: false,
        }
    }

    fn fluxes(total: u32) -> [Measurement; 52] {
        let mut all = [Measurement::default(); 52];
        (all[0].flux, all[51].flux) = (total / 2, total - total / 2);
        all
    }

    #[test]
    fn a_frame_passes_up_to_each_limit_and_fails_beyond() {
        let check =
            |valid, pixels, flux| LIMITS.check(&report(valid, pixels), &fluxes(flux), 52, WHOLE);
        for (valid, pixels, flux) in [(40, 3, 1000), (52, 0, 5000), (40, 0, 3000)] {
            assert_eq!(check(valid, pixels, flux), Ok(()));
        }
        assert_eq!(check(39, 0, 3000), Err(Fault::TooFewValid { valid: 39, least: 40 }));
        assert_eq!(check(52, 0, 999), Err(Fault::TotalFlux { flux: 999, limit: 1000 }));
        assert_eq!(check(52, 0, 5001), Err(Fault::TotalFlux { flux: 5001, limit: 5000 }));
        assert_eq!(check(52, 4, 3000), Err(Fault::SaturatedPixels { pixels: 4, most: 3 }));
    }

    #[test]
    fn missing_pulses_ask_for_less_light() {
        let check = |flux, seen| LIMITS.check(&report(52, 0), &fluxes(flux), 52, [seen, 10]);
        assert_eq!(check(700, 7), Ok(()));
        assert_eq!(check(699, 7), Err(Fault::TotalFlux { flux: 699, limit: 700 }));
        assert_eq!(check(3501, 7), Err(Fault::TotalFlux { flux: 3501, limit: 3500 }));
        assert_eq!(check(5000, 12), Ok(()), "more than asked changes nothing");
    }

    /// 40 of 52, and of 13 that are lit 10.
    #[test]
    fn a_sub_cycle_is_asked_for_its_share() {
        let check = |valid| LIMITS.check(&report(valid, 0), &fluxes(3000), 13, WHOLE);
        assert_eq!(check(10), Ok(()));
        assert_eq!(check(9), Err(Fault::TooFewValid { valid: 9, least: 10 }));
    }

    #[test]
    fn without_limits_everything_passes() {
        let bright = [Measurement { flux: u32::MAX, ..Default::default() }; 1600];
        assert_eq!(QualityLimits::NONE.check(&report(0, u32::MAX), &bright, 1600, WHOLE), Ok(()));
        assert_eq!(QualityLimits::NONE.check(&report(0, 0), &[], 0, WHOLE), Ok(()));
    }
}
