//! What an estimator makes of the spots' images, against the exact gradient.
//!
//! A spot is seen through the whole turbulence above the telescope: unless that is corrected on the way back, its
//! image is a speckle pattern as wide as the seeing disk, another one for each spot. Its centre of gravity over
//! all of the plane is the gradient all the same (OTF = OTF_up conj(OTF_down), see
//! [`crate::optics::splash_image`]); a window cuts the wings, and a threshold leaves the brightest speckles, whose
//! centre is another one. That is SPLASH's centroid anisoplanatism. The mirror can be in either way or in a
//! part of it:
//!
//! | state | mirror on the way up | on the way back |
//! |---|---|---|
//! | open | none | none |
//! | half | half of the correction | the same half |
//! | launch | all | none |
//! | launch-half | all | half |
//! | corrected | all | all |
//!
//! The correction is what a loop of exact gradients converges to under the same frozen sky
//! ([`crate::monte_carlo::converged`]), so that the exact gradient is zero wherever all of it is on the way up:
//! its mean tilt is zero, and the way back sees no more of a mirror than that. Errors are those of slopes with
//! the mean over the pupil taken off, as the control law does:
//!
//! ```text
//! error   = rms(m - t)              m measured (less that of a flat wavefront), t exact; px
//! gain    = sum(m t) / sum(t t)     where t is not zero
//! fitted  = rms(m / gain - t)       what no calibration takes away
//! ```
//!
//! over both axes, all valid subapertures and all screens; standard errors are those of a jackknife over
//! screens. A pixel is lambda / (p d), or 2 pi / p rad of phase from edge to edge of a subaperture.
//!
//! Measured by `host-sim centroids` with the default instrument (d = r0, 40 % of the turbulence at a quarter of the
//! beacon's height, no noise, 12 screens), px of lambda / 2d; a pixel is pi rad from edge to edge:
//!
//! | estimator | state | D/r0 = 4 | 8 | 16 | 32 | fitted at 32 |
//! |---|---|---|---|---|---|---|
//! | plain | open | 0.055(6) | 0.060(1) | 0.061(2) | 0.064(1) | 0.042 |
//! | | launch | 0.035(1) | 0.038(1) | 0.040 | 0.040 | |
//! | | corrected | 0.035(1) | 0.038(1) | 0.040 | 0.040 | |
//! | thresholded at 0.02 | open | 0.048(2) | 0.054(1) | 0.056(1) | 0.056 | 0.053 |
//! | | launch | 0.047(1) | 0.053(1) | 0.055(1) | 0.055 | |
//! | | corrected | 0.049(2) | 0.055(1) | 0.057(1) | 0.057 | |
//! | thresholded at 0.1 | open | 0.093(3) | 0.099(2) | 0.103(1) | 0.103(1) | 0.097 |
//! | | launch | 0.091(3) | 0.096(2) | 0.100(1) | 0.100(1) | |
//! | | corrected | 0.098(4) | 0.107(2) | 0.110(1) | 0.112(1) | |
//! | thresholded at 0.3 | open | 0.108(3) | 0.118(2) | 0.120(1) | 0.121(1) | 0.114 |
//! | | launch | 0.118(4) | 0.130(3) | 0.135(2) | 0.136(2) | |
//! | | corrected | 0.102(4) | 0.104(2) | 0.109(2) | 0.117(1) | |
//! | weighted | open | 0.087(3) | 0.093(2) | 0.095(1) | 0.096(1) | 0.091 |
//! | | corrected | 0.089(3) | 0.097(2) | 0.099(1) | 0.100(1) | |
//! | brightest 16 | open | 0.104(3) | 0.111(2) | 0.113(1) | 0.114(1) | 0.107 |
//! | | corrected | 0.103(4) | 0.111(2) | 0.114(1) | 0.116(1) | |
//!
//! Errors of less than a thousandth have no digit in brackets. The error hardly grows with the telescope, nor
//! with what is left on the way back: it is the asymmetry of each spot on its way up, of which a threshold takes
//! more the higher it is. Only at 0.3 of the peak the speckle of an uncorrected way back adds to it, by a sixth to a quarter.

use crate::atmosphere::{Atmosphere, Turbulence};
use crate::board::{Frame, in_process};
use crate::error::Error;
use crate::imager::{Imager, Noise};
use crate::instrument::{EstimatorName, Instrument};
use crate::monte_carlo::converged::Converged;
use crate::monte_carlo::point::screen_seed;
use crate::optics::geometric::{Effects, GeometricSensor, Sensor};
use crate::pupil::{Mirror, Pupil};
use crate::reconstructor::Reconstructor;
use splash_firmware::fixed::CENTROID_BITS;

/// Frames of a sky, cycles with a schedule, after which an estimator is asked: moving thresholds and weights
/// follow the frame before.
const FRAMES: u32 = 3;

/// How much of the correction is where: the module's table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// In files and on the screen.
    pub name: &'static str,
    /// Part of the mirror's correction that is on the way up.
    pub up: f64,
    /// Part of that which is on the way back as well.
    pub back: f32,
}

/// All states.
pub const STATES: [State; 5] = [
    State { name: "open", up: 0.0, back: 1.0 },
    State { name: "half", up: 0.5, back: 1.0 },
    State { name: "launch", up: 1.0, back: 0.0 },
    State { name: "launch-half", up: 1.0, back: 0.5 },
    State { name: "corrected", up: 1.0, back: 1.0 },
];

/// An estimator and its threshold.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// In files and on the screen.
    pub name: String,
    /// The estimator.
    pub estimator: EstimatorName,
    /// Least threshold, part of the last peak.
    pub peak_fraction: f64,
}

impl Estimate {
    /// That of the description.
    pub fn described(description: &Instrument) -> Self {
        let centroids = &description.centroids;
        let (estimator, peak_fraction) = (centroids.estimator, centroids.peak_fraction);
        Self { name: "described".to_string(), estimator, peak_fraction }
    }

    /// Plain, thresholded at these fractions of the peak, weighted and brightest, as the description has
    /// them.
    pub fn all(description: &Instrument, fractions: &[f64]) -> Vec<Self> {
        let named = |estimator, name: &str, peak_fraction| Self {
            name: name.to_string(),
            estimator,
            peak_fraction,
        };
        let thresholded = |&fraction: &f64| {
            named(EstimatorName::Thresholded, &format!("thresholded-{fraction}"), fraction)
        };
        let least = description.centroids.peak_fraction;
        let mut all = vec![named(EstimatorName::Plain, "plain", 0.0)];
        all.extend(fractions.iter().map(thresholded));
        all.push(named(EstimatorName::Weighted, "weighted", least));
        all.push(named(EstimatorName::Brightest, "brightest", 0.0));
        all
    }
}

/// Sums over slopes, px^2.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Of (m - t)^2, m t, t^2 and m^2.
    error: f64,
    product: f64,
    exact: f64,
    measured: f64,
    /// Valid slopes, two a subaperture.
    count: f64,
    /// Subapertures without a valid flux.
    pub invalid: f64,
}

impl Sums {
    /// Both together.
    #[must_use]
    pub fn plus(self, other: &Self) -> Self {
        Self {
            error: self.error + other.error,
            product: self.product + other.product,
            exact: self.exact + other.exact,
            measured: self.measured + other.measured,
            count: self.count + other.count,
            invalid: self.invalid + other.invalid,
        }
    }

    /// Rms of m - t, px.
    pub fn error_px(&self) -> f64 {
        (self.error / self.count).sqrt()
    }

    /// Rms of t, px.
    pub fn exact_px(&self) -> f64 {
        (self.exact / self.count).sqrt()
    }

    /// Least-squares slope of m over t; NaN where t is zero.
    pub fn gain(&self) -> f64 {
        // A thousandth of a pixel is what centroids of 16 bits leave.
        if self.exact_px() > 1e-3 { self.product / self.exact } else { f64::NAN }
    }

    /// Rms of m / gain - t, px.
    pub fn fitted_px(&self) -> f64 {
        let rest = self.measured - self.product.powi(2) / self.exact;
        (rest.max(0.0) / self.count).sqrt() / self.gain().abs()
    }
}

/// A size of pupil.
pub struct CentroidStudy {
    pupil: Pupil,
    turbulence: Turbulence,
    instrument: Instrument,
    reconstructors: Vec<Reconstructor>,
    /// Of a flat wavefront without noise, as [`Self::centroids`].
    references: Vec<Vec<Option<[f64; 2]>>>,
    noise: bool,
}

impl CentroidStudy {
    /// `n` subapertures across under frozen turbulence, the description's noise or none.
    ///
    /// # Errors
    /// [`Error::Config`] for what optics or firmware refuse.
    pub fn new(
        description: &Instrument,
        n: usize,
        noise: bool,
        estimates: &[Estimate],
    ) -> Result<Self, Error> {
        let mut instrument = description.clone().frozen();
        instrument.telescope.subapertures = n;
        // Each gate's spots are centroids of their own.
        instrument.second_gate.height_m = 0.0;
        if !noise {
            instrument = instrument.noise_free();
        }
        let reconstructor = |estimate: &Estimate| {
            let mut instrument = instrument.clone();
            instrument.centroids.estimator = estimate.estimator;
            instrument.centroids.peak_fraction = estimate.peak_fraction;
            // A high threshold leaves little of a speckled spot: it counts like any other.
            (instrument.centroids.flux_min, instrument.centroids.flux_max) = (0.0, 1e3);
            instrument.check()?;
            Reconstructor::new(&instrument)
        };
        let reconstructors = estimates.iter().map(reconstructor).collect::<Result<_, _>>()?;
        let pupil = instrument.pupil()?;
        let turbulence = instrument.turbulence(&pupil, 1.0)?;
        let references = Vec::new();
        let mut study = Self { pupil, turbulence, instrument, reconstructors, references, noise };
        let still = Atmosphere::from_screens(Vec::new(), study.pupil.diameter_m(), 0.0)?;
        let flat = Mirror::flat(study.pupil.subapertures().len());
        let seen = study.frames(&mut study.imager(&still)?, &still, &flat, None)?;
        study.references = study.centroids(&seen)?;
        Ok(study)
    }

    /// Texels of the screens.
    ///
    /// # Errors
    /// [`Error::Config`] for a screen that is too large for any memory.
    pub fn texels(&self) -> Result<u64, Error> {
        let layers = self.instrument.layers();
        let (diameter_m, pitch_m) = (self.pupil.diameter_m(), self.pupil.pitch_m());
        let [_, all] = Turbulence::texels(&layers, diameter_m, pitch_m, 1.0)?;
        Ok(all)
    }

    /// The sums of every state and estimator under a screen, estimators within states: a function of the
    /// screen's number and the seed alone.
    ///
    /// # Errors
    /// [`Error::Config`] for what optics or firmware refuse.
    pub fn screen(&self, seed: u64, screen: u32) -> Result<Vec<Sums>, Error> {
        let seed = screen_seed(seed, self.pupil.across(), screen);
        let sky = self.turbulence.realise(seed, &mut |_| ());
        let (sensor, all) = (Sensor::Splash, Effects::ALL);
        let mut converged = Converged::new(&self.instrument, &self.pupil, &sky, sensor, all, 1.0)?;
        converged.observe(&sky, 0.0);
        let (mut imager, mut sensor) = (self.imager(&sky)?, self.sensor(&sky)?);
        let mut exact = vec![[0.0; 2]; self.pupil.subapertures().len()];
        let noise = self.noise.then_some(seed);
        let mut sums = Vec::new();
        for state in STATES {
            let mut mirror = converged.mirror().clone();
            mirror.segments.iter_mut().flatten().for_each(|phase| *phase *= state.up);
            sensor.centroids(&sky, 0.0, &mirror, &mut exact);
            imager.return_through(state.back);
            let seen = self.frames(&mut imager, &sky, &mirror, noise)?;
            for (measured, reference) in self.centroids(&seen)?.iter().zip(&self.references) {
                sums.push(compare(measured, reference, &exact));
            }
        }
        Ok(sums)
    }

    /// SPLASH's images of skies like this.
    fn imager(&self, sky: &Atmosphere) -> Result<Imager, Error> {
        let Self { pupil, reconstructors, .. } = self;
        Imager::new(&reconstructors[0], Sensor::Splash, pupil, sky)
    }

    /// Its exact gradients, px.
    fn sensor(&self, sky: &Atmosphere) -> Result<GeometricSensor, Error> {
        let Instrument { laser, windows, .. } = &self.instrument;
        let (height_m, scale) = (laser.beacon_height_m, windows.pixels_per_lambda_d);
        let sensor = GeometricSensor::new(Sensor::Splash, &self.pupil, sky, height_m, scale)?;
        Ok(sensor.with_launch(self.instrument.launch()))
    }

    /// What the detector shows of a sky, with noise of this seed or none.
    fn frames(
        &self,
        imager: &mut Imager,
        sky: &Atmosphere,
        mirror: &Mirror,
        noise: Option<u64>,
    ) -> Result<Vec<Vec<u16>>, Error> {
        let expose = |frame: u32| {
            imager.light(frame);
            let noise = noise.map(|seed| Noise { seed, frame: frame.into() });
            Ok(imager.expose(sky, 0.0, mirror, noise)?.to_vec())
        };
        let cycle = self.reconstructors[0].lighting().count();
        // Without noise one cycle is like the next.
        let frames = if noise.is_some() { FRAMES * cycle } else { cycle };
        (0..frames).map(expose).collect()
    }

    /// What each estimator makes of the last of `frames`, px; `None` where the flux is not valid.
    fn centroids(&self, frames: &[Vec<u16>]) -> Result<Vec<Vec<Option<[f64; 2]>>>, Error> {
        let px = 1.0 / f64::from(1u32 << CENTROID_BITS);
        let one = |reconstructor: &Reconstructor| {
            let mut board = in_process(&reconstructor.spec())?;
            let numbers = 0..FRAMES * reconstructor.lighting().count();
            for (number, pixels) in numbers.zip(frames.iter().cycle()) {
                board.frame(number, Frame::Pixels(pixels))?;
            }
            let seen = board.measurements().iter().zip(board.slopes());
            let centroid = |q16: [i32; 2]| q16.map(|c| f64::from(c) * px);
            Ok(seen.map(|(m, slope)| slope.valid.then(|| centroid(m.centroid_q16))).collect())
        };
        self.reconstructors.iter().map(one).collect()
    }
}

/// The sums of one estimator under one sky.
fn compare(
    measured: &[Option<[f64; 2]>],
    reference: &[Option<[f64; 2]>],
    exact: &[[f64; 2]],
) -> Sums {
    let slopes: Vec<[[f64; 2]; 2]> = measured
        .iter()
        .zip(reference)
        .zip(exact)
        .filter_map(|((&measured, &reference), &[tx, ty])| {
            let ([x, y], [x0, y0]) = (measured?, reference?);
            Some([[x - x0, y - y0], [tx, ty]])
        })
        .collect();
    let count = slopes.len() as f64;
    let mean = |which: usize, axis: usize| {
        slopes.iter().map(|pair| pair[which][axis]).sum::<f64>() / count
    };
    let mut sums = Sums { invalid: (measured.len() - slopes.len()) as f64, ..Sums::default() };
    for axis in 0..2 {
        let (mean_m, mean_t) = (mean(0, axis), mean(1, axis));
        for [measured, exact] in &slopes {
            let (m, t) = (measured[axis] - mean_m, exact[axis] - mean_t);
            sums.error += (m - t).powi(2);
            sums.product += m * t;
            sums.exact += t * t;
            sums.measured += m * m;
            sums.count += 1.0;
        }
    }
    sums
}

/// A number of all screens' sums and its standard error, by leaving out one screen after the other; NaN for a
/// single screen.
pub fn jackknife(screens: &[Sums], of: fn(&Sums) -> f64) -> (f64, f64) {
    let total = |left_out: Option<usize>| {
        let kept = screens.iter().enumerate().filter(|(k, _)| Some(*k) != left_out);
        of(&kept.fold(Sums::default(), |sum, (_, screen)| sum.plus(screen)))
    };
    let count = screens.len() as f64;
    if screens.len() < 2 {
        return (total(None), f64::NAN);
    }
    let without: Vec<f64> = (0..screens.len()).map(|k| total(Some(k))).collect();
    let mean = without.iter().sum::<f64>() / count;
    let square = without.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    (total(None), ((count - 1.0) / count * square).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Measured 0.8 t and +-0.1 px apart from it: gain 0.8, and 0.125 px of what was measured in units of t.
    #[test]
    fn gain_and_error_are_those_of_the_line() {
        let exact = [[1.0, -2.0], [-1.0, 2.0], [2.0, 1.0], [-2.0, -1.0]];
        // Orthogonal to t and to the mean in both axes.
        let off = [[0.1, 0.1], [0.1, 0.1], [-0.1, -0.1], [-0.1, -0.1]];
        let measured: Vec<_> = exact
            .iter()
            .zip(&off)
            .map(|(t, e)| Some([0.8 * t[0] + e[0] + 7.0, 0.8 * t[1] + e[1]]))
            .collect();
        let reference = vec![Some([0.0; 2]); 4];
        let sums = compare(&measured, &reference, &exact);
        assert!((sums.gain() - 0.8).abs() < 1e-12);
        assert!((sums.fitted_px() - 0.125).abs() < 1e-12);
        // t^2 is 2.5 on average, (0.2 t)^2 a twenty-fifth of it.
        assert!((sums.error_px() - (0.1f64 + 0.01).sqrt()).abs() < 1e-12);
        assert!((sums.exact_px() - 2.5f64.sqrt()).abs() < 1e-12);
        let dark = vec![None; 4];
        assert_eq!(compare(&dark, &reference, &exact).invalid, 4.0);
    }

    /// Of a mean, the jackknife's error is s / sqrt(M): of 2, 4 and 9 sqrt(13 / 3).
    #[test]
    fn jackknife_of_a_mean_is_its_standard_error() {
        let screens = [2.0, 4.0, 9.0].map(|error| Sums { error, count: 1.0, ..Sums::default() });
        let (mean, se) = jackknife(&screens, |sums| sums.error / sums.count);
        assert!((mean - 5.0).abs() < 1e-12 && (se - (13f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!(jackknife(&screens[..1], |sums| sums.error).1.is_nan());
    }
}
