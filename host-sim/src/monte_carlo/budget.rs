//! The error budget of a closed loop: each effect switched on in turn, under the same screens.
//!
//! A chain of runs leads from the best that the mirror can do to the run itself. With V_k the variance of the
//! star's residual phase in the k-th of them, term k is V_k - V_(k-1); the terms add up to the variance of
//! the run by construction. A term depends on those before it, and can be negative: an effect that undoes
//! part of another. Its error is that of the differences, screen by screen.
//!
//! Phases are those of layers at heights h with b = 1 - h/H, f is the control law's `lever_arm`, < > the mean
//! over a subaperture i centred on x_i:
//!
//! | step | what is corrected | what it adds |
//! |---|---|---|
//! | fitting | piston, tip and tilt of each segment fitted to phi(x) | what segments cannot follow |
//! | aliasing | <grad phi(x)>, pistons by least squares | gradients of the star alone, with what they alias |
//! | cone | <grad phi(b x + (1-b) x_i)>, a square of side b d around x_i; a laser guide star <grad phi(b x)> | each beam covers part of its subaperture; the guide star's cone is the whole pupil's |
//! | lever arm | f b times these | a gradient at the layer appears times b |
//! | return path | less the mean over the pupil of f b grad phi(b x + (1-b) x_i) | the tilt on the way back, which differs from spot to spot |
//! | temporal | the same in a loop: gain, delay, wind | what moves before it is corrected; nothing under a sky that stands still |
//! | quantisation | the same through the firmware | integers, sweeps that end, DAC steps, limits of the actuators |
//! | images | images of the spots in place of exact gradients | diffraction, windows, threshold, a detector without noise |
//! | noise | the same with the description's detector | photon, dark and read noise, and its bits |
//!
//! A laser guide star's cone and lever arm are best read together. It sees the layer magnified, as phi(b x), whose
//! gradient is b times that at the layer: taken whole, as in the step of the cone, gradients are too steep, and
//! the lever arm's term is negative for large telescopes.
//!
//! In the paper's setting (frozen screens, d = r0, 400 screens of seed 11, exact gradients), rad^2:
//!
//! | N = D/r0 | | fitting | aliasing | cone | lever arm | return path | run |
//! |---|---|---|---|---|---|---|---|
//! | 4 | SPLASH | 0.1706(12) | 0.1226(26) | 0.0104(12) | 0.0263(19) | 0.0370(19) | 0.3668(54) |
//! | 8 | SPLASH | 0.1694(6) | 0.1360(12) | 0.0164(8) | 0.1082(32) | 0.1029(42) | 0.5329(74) |
//! | 16 | SPLASH | 0.1703(3) | 0.1396(6) | 0.0253(6) | 0.3676(94) | 0.356(15) | 1.059(24) |
//! | 4 | LGS | the same | the same | 0.0476(27) | 0.0231(18) | | 0.3639(42) |
//! | 8 | LGS | | | 0.4741(72) | -0.0193(51) | | 0.7602(78) |
//! | 16 | LGS | | | 2.087(27) | -0.227(19) | | 2.170(26) |
//!
//! Theory has 0.00335 (D/r0)^(5/3) for the lever arm, which is 0.0338, 0.1072 and 0.3403 ([`lever_arm_rad2`]), and
//! 0.0202 (D/r0)^(5/3) for an LGS's cone with its lever arm, 0.204, 0.646 and 2.052, of which segments do not
//! follow what is finer than they are.
//!
//! Up to the return path the loop need not be run: c' = (1 - g) c + g f (s + c) converges to
//! c = f (s + c), and s + c is what the sensor sees with a flat mirror ([`super::converged`]).

use super::comparator::Comparator;
use super::point::Point;
use super::statistics::Mean;
use crate::closed_loop::Sensing;
use crate::instrument::{Instrument, LeverArm};
use crate::optics::geometric::Sensor;

/// An effect that is switched on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs, reason = "the module's table says what they are")]
pub enum Step {
    Fitting,
    Aliasing,
    Cone,
    LeverArm,
    ReturnPath,
    Temporal,
    Quantisation,
    Images,
    Noise,
}

impl Step {
    /// All of them, in the order in which they are switched on.
    pub const ALL: [Self; 9] = [
        Self::Fitting,
        Self::Aliasing,
        Self::Cone,
        Self::LeverArm,
        Self::ReturnPath,
        Self::Temporal,
        Self::Quantisation,
        Self::Images,
        Self::Noise,
    ];

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fitting => "fitting",
            Self::Aliasing => "aliasing",
            Self::Cone => "cone",
            Self::LeverArm => "lever_arm",
            Self::ReturnPath => "return_path",
            Self::Temporal => "temporal",
            Self::Quantisation => "quantisation",
            Self::Images => "images",
            Self::Noise => "noise",
        }
    }

    fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|step| step.name() == name)
    }
}

/// What is run under a screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Case {
    /// Whose loop it is.
    pub comparator: Comparator,
    /// The last effect that is switched on; `None` for the run itself.
    pub until: Option<Step>,
}

impl From<Comparator> for Case {
    fn from(comparator: Comparator) -> Self {
        Self { comparator, until: None }
    }
}

impl Case {
    /// The name in files.
    pub fn name(self) -> String {
        let sensor = self.comparator.name();
        self.until.map_or(sensor.into(), |step| format!("{sensor}/{}", step.name()))
    }

    /// The one of that name.
    pub fn named(name: &str) -> Option<Self> {
        match name.split_once('/') {
            None => Comparator::named(name).map(Self::from),
            Some((sensor, step)) => Some(Self {
                comparator: Comparator::named(sensor)?,
                until: Some(Step::named(step)?),
            }),
        }
    }
}

/// The chain of `comparator` at `point`: the effects that its run has, each with the run in which it is the last
/// one switched on. Empty for a fit, which is not a run.
pub fn chain(point: &Point, comparator: Comparator) -> Vec<(Step, Case)> {
    let Some(sensor) = comparator.sensor() else { return Vec::new() };
    let instrument = point.instrument();
    let conditions = point.conditions();
    let high = instrument.atmosphere.layers.iter().any(|l| l.weight > 0.0 && l.height_m > 0.0);
    let beacon = high && sensor != Sensor::Ngs;
    let images = conditions.sensing == Sensing::Images;
    let has = |step: &Step| match step {
        Step::Fitting | Step::Aliasing | Step::Temporal => true,
        Step::Cone => beacon,
        // One by name is 1 where there is no beacon.
        Step::LeverArm => {
            let factor = matches!(instrument.control.lever_arm, LeverArm::Factor(f) if f != 1.0);
            beacon || factor
        }
        Step::ReturnPath => high && sensor == Sensor::Splash,
        Step::Quantisation | Step::Images => images,
        Step::Noise => images && !conditions.noise_free,
    };
    let steps: Vec<Step> = Step::ALL.into_iter().filter(has).collect();
    let last = steps.len() - 1;
    let case = |(index, step): (usize, Step)| {
        let case = match step {
            _ if index == last => comparator.into(),
            Step::Fitting => Comparator::Fit.into(),
            // The star's gradients, whatever the sensor.
            Step::Aliasing => Case { comparator: Comparator::Ngs, until: Some(step) },
            _ => Case { comparator, until: Some(step) },
        };
        (step, case)
    };
    steps.into_iter().enumerate().map(case).collect()
}

/// Noll's residual of Kolmogorov turbulence over a circle without piston, tip and tilt, rad^2 for D = r0.
const BEYOND_TILT: f64 = 0.134;

/// The lever arm's term by theory, rad^2 at the science wavelength, for a control law that knows nothing of it
/// (f = 1): 1 - b of a layer's phase beyond tip and tilt stays, so with shares w_k of the turbulence
/// 0.134 (D/r0)^(5/3) sum_k w_k (1 - b_k)^2. Over a circle, and as if segments followed all of it.
pub fn lever_arm_rad2(instrument: &Instrument, diameter_in_r0: f64) -> f64 {
    let layers = &instrument.atmosphere.layers;
    let beacon_m = instrument.laser.beacon_height_m;
    let sums = layers.iter().fold([0.0, 0.0], |[missed, all], layer| {
        let away = layer.height_m / beacon_m;
        [missed + layer.weight * away * away, all + layer.weight]
    });
    let ratio = instrument.laser.wavelength_m / instrument.science.wavelength_m;
    BEYOND_TILT * diameter_in_r0.powf(5.0 / 3.0) * sums[0] / sums[1] * ratio * ratio
}

/// The terms of a chain of variances, `[step][screen]`.
///
/// # Panics
/// If the steps do not have the same number of screens.
pub fn terms(variances: &[Vec<f64>]) -> Vec<Mean> {
    let first = variances.first().map(|first| Mean::of(first));
    let rest = variances.windows(2).map(|pair| Mean::of_differences(&pair[1], &pair[0]));
    first.into_iter().chain(rest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back() {
        for comparator in Comparator::ALL {
            for until in [None].into_iter().chain(Step::ALL.map(Some)) {
                let case = Case { comparator, until };
                assert_eq!(Case::named(&case.name()), Some(case));
            }
        }
        assert_eq!(Case::named("splash/cone/"), None);
        assert_eq!(Case::named("lidar"), None);
    }

    #[test]
    fn terms_add_up_and_have_the_errors_of_differences() {
        let terms = terms(&[vec![1.0, 3.0], vec![2.0, 4.0], vec![1.0, 6.0]]);
        let means: Vec<f64> = terms.iter().map(|term| term.mean).collect();
        assert_eq!(means, [2.0, 1.0, 0.5]);
        assert_eq!(means.iter().sum::<f64>(), Mean::of(&[1.0, 6.0]).mean);
        // -1 and 2: s^2 = 4.5, of two values.
        let errors: Vec<f64> = terms.iter().map(|term| term.standard_error).collect();
        assert_eq!(errors, [1.0, 0.0, 1.5]);
    }
}
