//! One gate, two gates and guide stars under the same screens, with exact gradients in double precision.
//!
//! Every contender closes a loop of its own. A geometric sensor takes the mirror's tips and tilts off what it sees with
//! a flat mirror, so each gate and each guide star is looked through once a frame, whoever follows it; and once for
//! all under a sky that stands still. Slopes may have noise: a normal deviate for each slope, gate and frame, the
//! same for all contenders that look through the gate; guide stars have as much as the gate at H.
//!
//! Residual variance, rad^2, in the paper's setting (d = r0, 40 % of the turbulence at a quarter of the beacon's height,
//! frozen screens, seed 1, 60 screens, 30 for N = 32), the second gate at half the beacon's height:
//!
//! | N = D/r0 | noise, rad | one gate, f = 1 | best f | 12 modes | 25 modes | LGS | NGS | fit |
//! |---|---|---|---|---|---|---|---|---|
//! | 8 | 0 | 0.588(26) | 0.477(15) | 0.3455(67) | 0.3373(62) | 0.808(23) | 0.3175(54) | 0.1729(17) |
//! | 16 | 0 | 0.974(46) | 0.768(35) | 0.3992(61) | 0.3415(28) | 2.128(70) | 0.3106(25) | 0.1709(9) |
//! | 32 | 0 | 2.28(21) | 1.95(19) | 0.642(21) | 0.4363(58) | 6.91(37) | 0.3079(15) | 0.1703(6) |
//! | 8 | 0.1 | 0.590(27) | 0.479(15) | 0.3505(68) | 0.3435(63) | 0.809(23) | 0.3189(54) | 0.1729(17) |
//! | 16 | 0.1 | 0.977(46) | 0.771(35) | 0.4035(62) | 0.3472(29) | 2.130(70) | 0.3123(25) | 0.1709(9) |
//! | 32 | 0.1 | 2.28(21) | 1.95(18) | 0.647(21) | 0.4428(63) | 6.91(37) | 0.3100(16) | 0.1703(6) |
//!
//! Of the variance of one gate with f = 1, 12 modes leave 0.410(20) at N = 16 and 25 modes 0.191(18) at N = 32; with the
//! fit's taken off both, 0.284(17) and 0.126(13). A combination for that profile, at N = 16 with noise of 0.1 rad under
//! others, 24 screens:
//!
//! | layer above | one gate, f = 1 | f = 1.13 | 12 modes | 25 modes |
//! |---|---|---|---|---|
//! | 40 % at H/3 | 1.363(83) | 1.093(77) | 0.577(31) | 0.508(21) |
//! | 40 % at H/6 | 0.604(32) | 0.499(21) | 0.3375(52) | 0.3480(69) |
//! | 50 % at H/4 | 1.088(70) | 0.809(52) | 0.440(14) | 0.3577(49) |
//! | 30 % at H/4 | 0.778(44) | 0.657(39) | 0.3866(85) | 0.3324(41) |
//!
//! and at N = 32:
//!
//! | layer above | one gate, f = 1 | best f for the profile expected | 12 modes | 25 modes |
//! |---|---|---|---|---|
//! | 40 % at H/3 | 3.67(41) | 3.24(36) | 1.319(93) | 0.939(72) |
//! | 40 % at H/6 | 1.145(98) | 1.016(86) | 0.444(9) | 0.480(18) |
//! | 50 % at H/4 | 2.68(28) | 2.12(22) | 0.699(24) | 0.467(9) |
//! | 30 % at H/4 | 1.73(17) | 1.64(16) | 0.570(17) | 0.416(6) |

use super::point::{Outcome, Point, Sum, screen_seed};
use super::slope_control::{SlopeControl, Tilts, remove_mean};
use crate::atmosphere::{Atmosphere, Turbulence};
use crate::error::Error;
use crate::instrument::Instrument;
use crate::optics::geometric::{GeometricSensor, Sensor};
use crate::optics::science::Science;
use crate::optics::segment_fit::SegmentFit;
use crate::pupil::Mirror;
use crate::range_diversity::law::Law;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

/// What a contender looks through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// SPLASH's spots, imaged once or twice.
    Splash,
    /// A conventional laser guide star.
    Lgs,
    /// A natural guide star.
    Ngs,
    /// Nothing: piston, tip and tilt of each segment are fitted to the star's phase.
    Fit,
}

/// A loop.
#[derive(Clone, Debug)]
pub struct Contender {
    /// In tables and files.
    pub name: String,
    /// What it sees.
    pub view: View,
    /// What it makes of it.
    pub law: Law,
}

/// A point with its contenders, ready to run screens, any number at a time.
pub struct Contest<'a> {
    point: &'a Point,
    contenders: &'a [Contender],
    gate_height_m: f64,
    /// Rms noise of a slope of the gate at H and of the second one, rad from one edge of a subaperture to the other.
    noise_rad: [f64; 2],
    turbulence: Turbulence,
}

/// Slopes of all sensors with a flat mirror, rad from centre to edge, less their means.
struct Slopes {
    sensors: [GeometricSensor; 4],
    flat: Mirror,
    rad_per_px: f64,
    /// Gate at H, second gate, laser and natural guide star.
    slopes: [Tilts; 4],
}

impl<'a> Contest<'a> {
    /// A contest with the second gate at `gate_height_m`, above 0 and up to the beacon's height.
    ///
    /// # Errors
    /// [`Error::Config`] for what the optics refuse.
    pub fn new(
        point: &'a Point,
        contenders: &'a [Contender],
        gate_height_m: f64,
        noise_rad: [f64; 2],
    ) -> Result<Self, Error> {
        let (instrument, pupil) = (point.instrument(), point.pupil());
        let turbulence = instrument.turbulence(pupil, point.duration_s())?;
        Ok(Self { point, contenders, gate_height_m, noise_rad, turbulence })
    }

    /// Means over the frames averaged under screen number `screen`, of each contender: a function of that number, the
    /// contest and nothing else.
    ///
    /// # Errors
    /// [`Error::Config`] for what the optics refuse.
    pub fn run(&self, screen: u32) -> Result<Vec<Outcome>, Error> {
        let (point, pupil) = (self.point, self.point.pupil());
        let Instrument { laser, science, control, .. } = point.instrument();
        let seed = screen_seed(point.conditions().seed, point.n(), screen);
        let atmosphere = self.turbulence.realise(seed, &mut |_| ());
        let mut noise = Noise::new(seed, self.noise_rad);
        let mut slopes = Slopes::new(point, &atmosphere, self.gate_height_m)?;
        let mut star = Science::new(pupil, &atmosphere, laser.wavelength_m, science.wavelength_m)?;
        let controller = |contender: &Contender| {
            SlopeControl::new(pupil, contender.law.clone(), control.gain, control.delay_frames)
        };
        let mut loops: Vec<SlopeControl> = self.contenders.iter().map(controller).collect();
        let mut sums = vec![Sum::default(); loops.len()];
        let averaged = match self.noise_rad != [0.0; 2] {
            true => point.conditions().settle..point.frames(),
            false => point.averaged(),
        };
        let mut fit = SegmentFit::default();
        let mut fitted = Mirror::flat(pupil.subapertures().len());
        for frame in 0..averaged.end {
            let time_s = f64::from(frame) * point.instrument().frame_s();
            if frame == 0 || !point.still() {
                slopes.look(&atmosphere, time_s);
            }
            let noises = [0, 1, 0, 0].map(|gate| noise.draw(gate, fitted.segments.len()));
            let observed = averaged.contains(&frame);
            for ((contender, control), sum) in self.contenders.iter().zip(&mut loops).zip(&mut sums)
            {
                let see = |sensor: usize| slopes.through(sensor, control.applied(), &noises);
                let [mut first, mut second] = match contender.view {
                    View::Splash if contender.law.modes.is_empty() => [see(0), Tilts::new()],
                    View::Splash => [see(0), see(1)],
                    View::Lgs => [see(2), Tilts::new()],
                    View::Ngs => [see(3), Tilts::new()],
                    View::Fit => {
                        if observed {
                            fit.fit(pupil, &atmosphere, time_s, &mut fitted);
                            sum.add(&star.observe(&atmosphere, time_s, &fitted));
                        }
                        continue;
                    }
                };
                if observed {
                    sum.add(&star.observe(&atmosphere, time_s, control.mirror()));
                }
                control.step(&mut first, &mut second);
            }
        }
        Ok(sums.iter().map(Sum::mean).collect())
    }
}

impl Slopes {
    fn new(point: &Point, atmosphere: &Atmosphere, gate_height_m: f64) -> Result<Self, Error> {
        let (instrument, pupil) = (point.instrument(), point.pupil());
        let (height_m, scale) =
            (instrument.laser.beacon_height_m, instrument.windows.pixels_per_lambda_d);
        let sensor = |kind| {
            let sensor = GeometricSensor::new(kind, pupil, atmosphere, height_m, scale)?;
            Ok::<_, Error>(sensor.with_launch(instrument.launch()))
        };
        let flat = Mirror::flat(pupil.subapertures().len());
        let empty = || vec![[0.0; 2]; flat.segments.len()];
        Ok(Self {
            sensors: [
                sensor(Sensor::Splash)?,
                sensor(Sensor::Splash)?.with_gate(gate_height_m)?,
                sensor(Sensor::Lgs)?,
                sensor(Sensor::Ngs)?,
            ],
            rad_per_px: std::f64::consts::PI / scale,
            slopes: [empty(), empty(), empty(), empty()],
            flat,
        })
    }

    fn look(&mut self, atmosphere: &Atmosphere, time_s: f64) {
        for (sensor, slopes) in self.sensors.iter_mut().zip(&mut self.slopes) {
            sensor.centroids(atmosphere, time_s, &self.flat, slopes);
            slopes.as_flattened_mut().iter_mut().for_each(|slope| *slope *= self.rad_per_px);
            remove_mean(slopes);
        }
    }

    /// What a sensor sees behind the mirror.
    fn through(&self, sensor: usize, mirror: &[[f64; 2]], noise: &[Tilts; 4]) -> Tilts {
        let slopes = self.slopes[sensor].iter().zip(mirror).zip(&noise[sensor]);
        let mut seen: Tilts = slopes
            .map(|((slope, mirror), noise)| [0, 1].map(|k| slope[k] - mirror[k] + noise[k]))
            .collect();
        remove_mean(&mut seen);
        seen
    }
}

/// Normal deviates.
struct Noise {
    random: Xoshiro256PlusPlus,
    /// Rms of each gate from centre to edge, rad.
    rms: [f64; 2],
}

impl Noise {
    fn new(seed: u64, noise_rad: [f64; 2]) -> Self {
        // Another stream than that of the screens.
        let random = Xoshiro256PlusPlus::seed_from_u64(seed ^ 0x6e6f_6973_6520_6f66);
        Self { random, rms: noise_rad.map(|rms| 0.5 * rms) }
    }

    fn draw(&mut self, gate: usize, count: usize) -> Tilts {
        if self.rms == [0.0; 2] {
            return vec![[0.0; 2]; count];
        }
        let rms = self.rms[gate];
        let mut one = || -> f64 { StandardNormal.sample(&mut self.random) };
        (0..count).map(|_| [0; 2].map(|_| rms * one())).collect()
    }
}
