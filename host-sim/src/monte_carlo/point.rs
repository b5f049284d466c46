//! One size of pupil: what all its screens have in common, and the run of one screen.

use super::comparator::Comparator;
use super::gradient_loop::GradientLoop;
use crate::atmosphere::{Atmosphere, Turbulence};
use crate::board::in_process;
use crate::calibration::SlopeCalibration;
use crate::closed_loop::{ClosedLoop, Run, Sensing};
use crate::error::{Error, refuse};
use crate::instrument::{Instrument, PupilName, PupilShape};
use crate::optics::geometric::Sensor;
use crate::optics::science::{Observation, Science};
use crate::optics::segment_fit::SegmentFit;
use crate::pupil::{MAX_ACROSS, Mirror, Pupil};
use crate::reconstructor::Reconstructor;
use sha2::{Digest, Sha256};
use splash_firmware::geometry::{MAX_ACROSS as FIRMWARE_ACROSS, MIN_ACROSS};
use std::sync::Arc;

/// What all screens of a run have in common, beside the instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// Images through detector and firmware, or exact gradients in double precision.
    pub sensing: Sensing,
    /// Detector without noise.
    pub noise_free: bool,
    /// Frames that each loop gets to close.
    pub settle: u32,
    /// Frames after these, which are averaged.
    pub frames: u32,
    /// Seed of all turbulence and noise.
    pub seed: u64,
}

/// What a screen comes to: means over the frames averaged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// |<exp(i phi)>|^2 over the pupil, piston, tip and tilt removed.
    pub strehl: f64,
    /// Mean square of that phase, rad^2.
    pub variance_rad2: f64,
}

/// A size of pupil.
#[derive(Clone, Debug)]
pub struct Point {
    instrument: Instrument,
    pupil: Pupil,
    conditions: Conditions,
}

impl Point {
    /// `n` subapertures of the description's size across the pupil: 4 to 40 with images, which the firmware
    /// takes, 4 to 120 with gradients.
    ///
    /// # Errors
    /// [`Error::Config`] with field, value and limit.
    pub fn new(description: &Instrument, n: usize, conditions: Conditions) -> Result<Self, Error> {
        let most = match conditions.sensing {
            Sensing::Images => FIRMWARE_ACROSS,
            Sensing::Geometric => MAX_ACROSS,
        };
        if !(MIN_ACROSS..=most).contains(&n) {
            let limit = format!(
                "from {MIN_ACROSS} to {FIRMWARE_ACROSS}, or to {MAX_ACROSS} with --sensing geometric"
            );
            return Err(refuse("--n", n, &limit));
        }
        let mut instrument = description.clone();
        // What the firmware takes checks everything else as well.
        instrument.telescope.subapertures = n.min(FIRMWARE_ACROSS);
        instrument.check()?;
        instrument.telescope.subapertures = n;
        if conditions.noise_free {
            instrument = instrument.noise_free();
        }
        let pupil = pupil(&instrument)?;
        Ok(Self { instrument, pupil, conditions })
    }

    /// Subapertures across the pupil.
    pub fn n(&self) -> usize {
        self.pupil.across()
    }

    /// The pupil.
    pub fn pupil(&self) -> &Pupil {
        &self.pupil
    }

    /// The instrument.
    pub fn instrument(&self) -> &Instrument {
        &self.instrument
    }

    /// The conditions.
    pub fn conditions(&self) -> Conditions {
        self.conditions
    }

    /// Frames in all.
    pub fn frames(&self) -> u32 {
        self.conditions.settle + self.conditions.frames
    }

    /// How long the turbulence blows, s.
    pub fn duration_s(&self) -> f64 {
        f64::from(self.frames()) * self.instrument.frame_s()
    }

    /// What the outcome of a screen depends on, as hexadecimal digits: not the number of screens, nor which
    /// comparators are run.
    ///
    /// # Errors
    /// [`Error::Run`] if the description cannot be written, which no instrument's is.
    pub fn digest(&self) -> Result<String, Error> {
        let conditions = format!("{} {:?}\n", env!("CARGO_PKG_VERSION"), self.conditions);
        let text = conditions + &self.instrument.to_toml()?;
        Ok(Sha256::digest(text)[..8].iter().map(|byte| format!("{byte:02x}")).collect())
    }

    /// Plans the screens and calibrates the sensors of `comparators`; `progress` is told the fraction done.
    ///
    /// # Errors
    /// [`Error::Config`] for what optics or firmware refuse.
    pub fn prepare(
        &self,
        comparators: &[Comparator],
        progress: &mut dyn FnMut(f64),
    ) -> Result<Prepared<'_>, Error> {
        let turbulence = Turbulence::new(
            self.instrument.atmosphere.r0_m,
            &self.instrument.layers(),
            self.pupil.diameter_m(),
            self.pupil.pitch_m(),
            self.duration_s(),
        )?;
        let mut reconstructors = Vec::new();
        if self.conditions.sensing == Sensing::Images {
            for (index, &comparator) in comparators.iter().enumerate() {
                let Some(sensor) = comparator.sensor() else { continue };
                let slopes = SlopeCalibration::of(sensor, &self.instrument, &mut |done| {
                    progress((index as f64 + done) / comparators.len() as f64);
                })?;
                let reconstructor = Reconstructor::new(&self.instrument)?.with_slopes(slopes);
                reconstructors.push((sensor, reconstructor));
            }
        }
        Ok(Prepared { point: self, turbulence, reconstructors })
    }
}

/// The pupil; beyond what the firmware takes, only circles and squares.
fn pupil(instrument: &Instrument) -> Result<Pupil, Error> {
    let telescope = &instrument.telescope;
    let (across, samples, pitch_m) = (telescope.subapertures, telescope.samples, telescope.pitch_m);
    if across <= FIRMWARE_ACROSS {
        return instrument.pupil();
    }
    Ok(match &telescope.pupil {
        PupilShape::Named(PupilName::Circle) if !telescope.spider => {
            Pupil::circular(across, samples, pitch_m)?
        }
        PupilShape::Named(PupilName::Square) if !telescope.spider => {
            Pupil::square(across, samples, pitch_m)?
        }
        _ => {
            let limit = format!("a circle or square without spider beyond {FIRMWARE_ACROSS}");
            return Err(refuse("telescope.pupil with --n", across, &limit));
        }
    })
}

/// A point that is ready to run screens, any number at a time.
pub struct Prepared<'a> {
    point: &'a Point,
    turbulence: Turbulence,
    /// One for each sensor, with images.
    reconstructors: Vec<(Sensor, Reconstructor)>,
}

impl Prepared<'_> {
    /// Runs `comparators` under screen number `screen`: a function of that number, the point and nothing
    /// else.
    ///
    /// # Errors
    /// [`Error::Config`] for what optics or firmware refuse, [`Error::Run`] if a loop fails.
    pub fn run(
        &self,
        screen: u32,
        comparators: &[Comparator],
    ) -> Result<Vec<(Comparator, Outcome)>, Error> {
        let seed = screen_seed(self.point.conditions.seed, self.point.n(), screen);
        let atmosphere = Arc::new(self.turbulence.realise(seed, &mut |_| ()));
        let run = |&comparator: &Comparator| {
            let outcome = match comparator.sensor() {
                None => self.fit(&atmosphere)?,
                Some(sensor) => match self.point.conditions.sensing {
                    Sensing::Images => self.images(sensor, seed, &atmosphere)?,
                    Sensing::Geometric => self.gradients(sensor, &atmosphere)?,
                },
            };
            Ok((comparator, outcome))
        };
        comparators.iter().map(run).collect()
    }

    /// Through optics, detector and firmware.
    fn images(
        &self,
        sensor: Sensor,
        seed: u64,
        atmosphere: &Arc<Atmosphere>,
    ) -> Result<Outcome, Error> {
        let Conditions { noise_free, settle, .. } = self.point.conditions;
        let ready = self.reconstructors.iter().find(|(ready, _)| *ready == sensor);
        let (_, reconstructor) = ready.expect("prepared for this sensor");
        let mut board = in_process(&reconstructor.spec())?;
        let frames = self.point.frames();
        let run = Run { sensor, sensing: Sensing::Images, frames, seed, noise_free };
        let instrument = &self.point.instrument;
        let sky = Arc::clone(atmosphere);
        let mut closed = ClosedLoop::under(instrument, reconstructor, board.as_mut(), run, sky)?;
        let mut sum = Sum::default();
        for frame in 0..frames {
            let observation = closed.step()?.observation;
            if frame >= settle {
                sum.add(&observation);
            }
        }
        Ok(sum.mean())
    }

    /// With exact gradients in double precision.
    fn gradients(&self, sensor: Sensor, atmosphere: &Atmosphere) -> Result<Outcome, Error> {
        let Point { instrument, pupil, conditions } = self.point;
        let mut closed = GradientLoop::new(instrument, pupil, atmosphere, sensor)?;
        let mut sum = Sum::default();
        for frame in 0..self.point.frames() {
            let time_s = f64::from(frame) * instrument.frame_s();
            let observation = closed.step(atmosphere, time_s, frame >= conditions.settle);
            observation.iter().for_each(|observation| sum.add(observation));
        }
        Ok(sum.mean())
    }

    /// The best that the mirror can do, in the frames that are averaged.
    fn fit(&self, atmosphere: &Atmosphere) -> Result<Outcome, Error> {
        let Point { instrument, pupil, conditions } = self.point;
        let (sensing_m, science_m) =
            (instrument.laser.wavelength_m, instrument.science.wavelength_m);
        let mut science = Science::new(pupil, atmosphere, sensing_m, science_m)?;
        let mut fit = SegmentFit::default();
        let mut mirror = Mirror::flat(pupil.subapertures().len());
        let mut sum = Sum::default();
        let still = instrument.atmosphere.layers.iter().all(|l| l.wind_speed_m_per_s == 0.0);
        // Under a sky that stands still one frame is like any other.
        let last = if still { conditions.settle + 1 } else { self.point.frames() };
        for frame in conditions.settle..last {
            let time_s = f64::from(frame) * instrument.frame_s();
            fit.fit(pupil, atmosphere, time_s, &mut mirror);
            sum.add(&science.observe(atmosphere, time_s, &mirror));
        }
        Ok(sum.mean())
    }
}

/// A mean in the making.
#[derive(Default)]
struct Sum {
    strehl: f64,
    variance_rad2: f64,
    frames: u32,
}

impl Sum {
    fn add(&mut self, observation: &Observation) {
        self.strehl += observation.strehl;
        self.variance_rad2 += observation.variance_rad2;
        self.frames += 1;
    }

    fn mean(&self) -> Outcome {
        let frames = f64::from(self.frames);
        Outcome { strehl: self.strehl / frames, variance_rad2: self.variance_rad2 / frames }
    }
}

/// The seed of a screen: screens of other numbers, pupils and runs have nothing in common.
fn screen_seed(seed: u64, n: usize, screen: u32) -> u64 {
    let mut hash = Sha256::new();
    hash.update(seed.to_le_bytes());
    hash.update((n as u64).to_le_bytes());
    hash.update(screen.to_le_bytes());
    let digest: [u8; 32] = hash.finalize().into();
    u64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|k| digest[k]))
}
