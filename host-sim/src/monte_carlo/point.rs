//! One size of pupil: what all its screens have in common, and the run of one screen.

use super::budget::{Case, Step};
use super::converged::Converged;
use super::gradient_loop::GradientLoop;
use crate::atmosphere::{Atmosphere, Turbulence};
use crate::board::in_process;
use crate::calibration::calibrated;
use crate::closed_loop::{ClosedLoop, Run, Sensing};
use crate::error::{Error, refuse};
use crate::instrument::{Instrument, PupilName, PupilShape};
use crate::lighting::Lighting;
use crate::optics::geometric::{Effects, Sensor};
use crate::optics::science::{Observation, Science};
use crate::optics::segment_fit::SegmentFit;
use crate::pupil::{MAX_ACROSS, Mirror, Pupil};
use crate::reconstructor::Reconstructor;
use sha2::{Digest, Sha256};
use splash_firmware::geometry::{MAX_ACROSS as FIRMWARE_ACROSS, MIN_ACROSS};
use std::ops::Range;
use std::sync::Arc;

/// What all screens of a run have in common, beside the instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// Images through detector and firmware, or exact gradients in double precision.
    pub sensing: Sensing,
    /// Detector without noise.
    pub noise_free: bool,
    /// Frames that each loop gets to close; cycles, if SPLASH's spots are lit in turn.
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
    /// Frames in which SPLASH's spots are all lit once.
    cycle: u32,
}

impl Point {
    /// `n` subapertures of the description's size across the pupil: 4 to 40 with images, which the firmware
    /// takes, 4 to 128 with gradients.
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
        let cycle = Lighting::on(&instrument, &pupil)?.count();
        Ok(Self { instrument, pupil, conditions, cycle })
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

    /// Frames that each loop gets to close: so many cycles, if spots are lit in turn.
    pub fn settle(&self) -> u32 {
        self.conditions.settle * self.cycle
    }

    /// Frames in which SPLASH's spots are all lit once.
    pub fn cycle(&self) -> u32 {
        self.cycle
    }

    /// Frames in all.
    pub fn frames(&self) -> u32 {
        self.settle() + self.conditions.frames
    }

    /// The frames that are averaged; under a sky that stands still and has been corrected, one is like any other.
    pub fn averaged(&self) -> Range<u32> {
        let settle = self.settle();
        settle..if self.still() { settle + 1 } else { self.frames() }
    }

    /// Whether no layer moves.
    pub fn still(&self) -> bool {
        self.instrument.atmosphere.layers.iter().all(|layer| layer.wind_speed_m_per_s == 0.0)
    }

    /// How long the turbulence blows, s.
    pub fn duration_s(&self) -> f64 {
        f64::from(self.frames()) * self.instrument.frame_s()
    }

    /// What the outcome of a screen depends on, as hexadecimal digits: not the number of screens, nor which
    /// cases are run.
    ///
    /// # Errors
    /// [`Error::Run`] if the description cannot be written, which no instrument's is.
    pub fn digest(&self) -> Result<String, Error> {
        let conditions = format!("{} {:?}\n", env!("CARGO_PKG_VERSION"), self.conditions);
        let text = conditions + &self.instrument.to_toml()?;
        Ok(Sha256::digest(text)[..8].iter().map(|byte| format!("{byte:02x}")).collect())
    }

    /// Plans the screens and calibrates the sensors of `cases`; `progress` is told the fraction done.
    ///
    /// # Errors
    /// [`Error::Config`] for what optics or firmware refuse.
    pub fn prepare(
        &self,
        cases: &[Case],
        progress: &mut dyn FnMut(f64),
    ) -> Result<Prepared<'_>, Error> {
        let turbulence = self.instrument.turbulence(&self.pupil, self.duration_s())?;
        let mut eyes: Vec<Eye> = cases.iter().filter_map(|&case| self.eye(case)).collect();
        eyes.sort_unstable();
        eyes.dedup();
        let mut sensors: Vec<Sensor> =
            cases.iter().filter_map(|case| case.comparator.sensor()).collect();
        sensors.sort_unstable();
        sensors.dedup();
        // As each sensor has it, with its control law.
        let own = |sensor: Sensor| {
            Ok((sensor, self.instrument.clone().seen_by(sensor).with_lever_arm_of(sensor)?))
        };
        let instruments: Vec<_> = sensors.into_iter().map(own).collect::<Result<_, Error>>()?;
        let mut reconstructors = Vec::new();
        for (index, &eye) in eyes.iter().enumerate() {
            let (Eye::Images { sensor, .. } | Eye::Gradients { sensor }) = eye;
            let (_, instrument) =
                instruments.iter().find(|(of, _)| *of == sensor).expect("of every case's sensor");
            let mut instrument = instrument.clone();
            if matches!(eye, Eye::Images { noise_free: true, .. }) {
                instrument = instrument.noise_free();
            }
            let mut reconstructor = Reconstructor::new(&instrument)?;
            if matches!(eye, Eye::Images { .. }) {
                reconstructor = reconstructor.with_second_gate(&|_| ())?;
                reconstructor = calibrated(sensor, reconstructor, &mut |done| {
                    progress((index as f64 + done) / eyes.len() as f64);
                })?;
            }
            reconstructors.push((eye, instrument, reconstructor));
        }
        Ok(Prepared { point: self, turbulence, instruments, reconstructors })
    }

    /// What the firmware is given in a case; `None` in cases without firmware.
    fn eye(&self, Case { comparator, until }: Case) -> Option<Eye> {
        let Conditions { sensing, noise_free, .. } = self.conditions;
        let sensor = comparator.sensor()?;
        match until {
            None if sensing == Sensing::Images => Some(Eye::Images { sensor, noise_free }),
            Some(Step::Images) => Some(Eye::Images { sensor, noise_free: true }),
            Some(Step::Quantisation) => Some(Eye::Gradients { sensor }),
            _ => None,
        }
    }
}

/// What the firmware is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Eye {
    /// Exact gradients: the ideal calibration is every sensor's, the control law its own.
    Gradients {
        sensor: Sensor,
    },
    Images {
        sensor: Sensor,
        noise_free: bool,
    },
}

/// The pupil; beyond what the firmware takes, only circles and squares.
fn pupil(instrument: &Instrument) -> Result<Pupil, Error> {
    let telescope = &instrument.telescope;
    let (across, samples, pitch_m) = (telescope.subapertures, telescope.samples, telescope.pitch_m);
    if across <= FIRMWARE_ACROSS {
        return instrument.pupil();
    }
    let pupil = match &telescope.pupil {
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
    };
    instrument.obstructed(pupil)
}

/// A point that is ready to run screens, any number at a time.
pub struct Prepared<'a> {
    point: &'a Point,
    turbulence: Turbulence,
    /// Of each sensor, with its own control law.
    instruments: Vec<(Sensor, Instrument)>,
    /// With the instrument that each is for.
    reconstructors: Vec<(Eye, Instrument, Reconstructor)>,
}

impl Prepared<'_> {
    /// Runs `cases` under screen number `screen`: a function of that number, the point and nothing else.
    ///
    /// # Errors
    /// [`Error::Config`] for what optics or firmware refuse, [`Error::Run`] if a loop fails.
    ///
    /// # Panics
    /// If the point was not prepared for these cases.
    pub fn run(&self, screen: u32, cases: &[Case]) -> Result<Vec<(Case, Outcome)>, Error> {
        let seed = screen_seed(self.point.conditions.seed, self.point.n(), screen);
        let atmosphere = Arc::new(self.turbulence.realise(seed, &mut |_| ()));
        let run = |&case: &Case| Ok((case, self.case(case, seed, &atmosphere)?));
        cases.iter().map(run).collect()
    }

    fn case(&self, case: Case, seed: u64, atmosphere: &Arc<Atmosphere>) -> Result<Outcome, Error> {
        let Some(sensor) = case.comparator.sensor() else { return self.fit(atmosphere) };
        if let Some(eye) = self.point.eye(case) {
            return self.firmware(eye, sensor, seed, atmosphere);
        }
        let found = self.instruments.iter().find(|(of, _)| *of == sensor);
        let (_, instrument) = found.expect("prepared for this case");
        let lever_arm = instrument.lever_arm(sensor)?;
        let cone = Effects { lever_arm: false, return_path: false };
        match case.until {
            Some(Step::Fitting) => self.fit(atmosphere),
            Some(Step::Aliasing) => self.converged(Sensor::Ngs, Effects::ALL, 1.0, atmosphere),
            Some(Step::Cone) => self.converged(sensor, cone, 1.0, atmosphere),
            Some(Step::LeverArm) => {
                let arm = Effects { lever_arm: true, ..cone };
                self.converged(sensor, arm, lever_arm, atmosphere)
            }
            Some(Step::ReturnPath) => self.converged(sensor, Effects::ALL, lever_arm, atmosphere),
            // What is left has exact gradients in a loop.
            _ => self.gradients(instrument, sensor, atmosphere),
        }
    }

    /// Through the firmware; with images, through optics and detector before it.
    fn firmware(
        &self,
        eye: Eye,
        sensor: Sensor,
        seed: u64,
        atmosphere: &Arc<Atmosphere>,
    ) -> Result<Outcome, Error> {
        let ready = self.reconstructors.iter().find(|(ready, ..)| *ready == eye);
        let (_, instrument, reconstructor) = ready.expect("prepared for this case");
        let mut board = in_process(&reconstructor.spec())?;
        let frames = self.point.frames();
        let (sensing, noise_free) = match eye {
            Eye::Gradients { .. } => (Sensing::Geometric, true),
            Eye::Images { noise_free, .. } => (Sensing::Images, noise_free),
        };
        let run = Run { sensor, sensing, frames, seed, noise_free };
        let sky = Arc::clone(atmosphere);
        let mut closed = ClosedLoop::under(instrument, reconstructor, board.as_mut(), run, sky)?;
        let mut sum = Sum::default();
        for frame in 0..frames {
            let observation = closed.step()?.observation;
            if frame >= self.point.settle() {
                sum.add(&observation);
            }
        }
        Ok(sum.mean())
    }

    /// With exact gradients and as if each of the frames had all the time to converge.
    fn converged(
        &self,
        sensor: Sensor,
        effects: Effects,
        lever_arm: f64,
        atmosphere: &Atmosphere,
    ) -> Result<Outcome, Error> {
        let Point { instrument, pupil, .. } = self.point;
        let mut closed = Converged::new(instrument, pupil, atmosphere, sensor, effects, lever_arm)?;
        let mut sum = Sum::default();
        for frame in self.point.averaged() {
            sum.add(&closed.observe(atmosphere, f64::from(frame) * instrument.frame_s()));
        }
        Ok(sum.mean())
    }

    /// With exact gradients in double precision.
    fn gradients(
        &self,
        instrument: &Instrument,
        sensor: Sensor,
        atmosphere: &Atmosphere,
    ) -> Result<Outcome, Error> {
        let Point { pupil, .. } = self.point;
        let mut closed = GradientLoop::new(instrument, pupil, atmosphere, sensor)?;
        let mut sum = Sum::default();
        for frame in 0..self.point.frames() {
            let time_s = f64::from(frame) * instrument.frame_s();
            let observation = closed.step(atmosphere, time_s, frame >= self.point.settle());
            observation.iter().for_each(|observation| sum.add(observation));
        }
        Ok(sum.mean())
    }

    /// The best that the mirror can do, in the frames that are averaged.
    fn fit(&self, atmosphere: &Atmosphere) -> Result<Outcome, Error> {
        let Point { instrument, pupil, .. } = self.point;
        let (sensing_m, science_m) =
            (instrument.laser.wavelength_m, instrument.science.wavelength_m);
        let mut science = Science::new(pupil, atmosphere, sensing_m, science_m)?;
        let mut fit = SegmentFit::default();
        let mut mirror = Mirror::flat(pupil.subapertures().len());
        let mut sum = Sum::default();
        for frame in self.point.averaged() {
            let time_s = f64::from(frame) * instrument.frame_s();
            fit.fit(pupil, atmosphere, time_s, &mut mirror);
            sum.add(&science.observe(atmosphere, time_s, &mirror));
        }
        Ok(sum.mean())
    }
}

/// A mean in the making.
#[derive(Clone, Default)]
pub(super) struct Sum {
    strehl: f64,
    variance_rad2: f64,
    frames: u32,
}

impl Sum {
    pub(super) fn add(&mut self, observation: &Observation) {
        self.strehl += observation.strehl;
        self.variance_rad2 += observation.variance_rad2;
        self.frames += 1;
    }

    pub(super) fn mean(&self) -> Outcome {
        let frames = f64::from(self.frames);
        Outcome { strehl: self.strehl / frames, variance_rad2: self.variance_rad2 / frames }
    }
}

/// The seed of a screen: screens of other numbers, pupils and runs have nothing in common.
pub(crate) fn screen_seed(seed: u64, n: usize, screen: u32) -> u64 {
    let mut hash = Sha256::new();
    hash.update(seed.to_le_bytes());
    hash.update((n as u64).to_le_bytes());
    hash.update(screen.to_le_bytes());
    let digest: [u8; 32] = hash.finalize().into();
    u64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|k| digest[k]))
}
