//! The closed loop: light through turbulence and mirror, frames through the firmware library, its
//! codes back to the mirror.
//!
//! Frame k is exposed and the star observed at time k times the frame's length, with the shape
//! that the mirror was given by the codes of frame k - 1 - L (L the configured delay). With a schedule it
//! shows the spots of its colour ([`crate::lighting`]), and is a sub-cycle to the firmware.

use crate::atmosphere::Atmosphere;
use crate::board::{Board, Frame, Standing, operate};
use crate::error::{Error, refuse};
use crate::imager::{Imager, Noise};
use crate::instrument::Instrument;
use crate::lighting::Lighting;
use crate::mirror::SegmentedMirror;
use crate::optics::geometric::{GeometricSensor, Sensor};
use crate::optics::science::{Observation, Science};
use crate::pupil::{Mirror, Pupil};
use crate::reconstructor::Reconstructor;
use splash_firmware::centroid::Measurement;
use splash_firmware::fixed::CENTROID_BITS;
use splash_firmware::pipeline::Report;
use std::collections::VecDeque;
use std::sync::Arc;

/// How the sensor is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Sensing {
    /// Images through the optics and the detector, centroids by the firmware.
    Images,
    /// Exact phase gradients in place of images and centroids, of both gates if there are two.
    Geometric,
}

impl Sensing {
    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Images => "images",
            Self::Geometric => "geometric",
        }
    }

    /// The one of that name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Images, Self::Geometric].into_iter().find(|sensing| sensing.name() == name)
    }
}

/// What to run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run {
    /// The sensor.
    pub sensor: Sensor,
    /// How it is simulated.
    pub sensing: Sensing,
    /// Frames.
    pub frames: u32,
    /// Seed of turbulence and noise.
    pub seed: u64,
    /// Detector without noise.
    pub noise_free: bool,
}

/// One frame of a loop, as it was left by the firmware.
pub struct Step<'a> {
    /// Its number.
    pub frame: u32,
    /// Its time, s.
    pub time_s: f64,
    /// What the star saw while it was exposed.
    pub observation: Observation,
    /// The detector, ADU, row-major; empty without images.
    pub pixels: &'a [u16],
    /// What the firmware made of it.
    pub report: Report,
}

/// A loop that is set up and can be stepped.
pub struct ClosedLoop<'a> {
    board: &'a mut dyn Board,
    run: Run,
    frame_s: f64,
    pupil: Pupil,
    atmosphere: Arc<Atmosphere>,
    eye: Eye,
    science: Science,
    device: SegmentedMirror,
    mirror: Mirror,
    /// Codes on their way to the mirror, oldest first: L of them.
    pending: VecDeque<Vec<[u16; 3]>>,
    /// Frames in which every spot is lit once.
    cycle: u32,
    frame: u32,
}

/// The sensor.
enum Eye {
    Images(Box<Imager>),
    Gradients {
        sensor: TruthSensor,
        lighting: Lighting,
        /// What the measurement of each lit spot claims, one gate after the other.
        fluxes: Vec<u32>,
    },
}

impl<'a> ClosedLoop<'a> {
    /// Draws the turbulence and flattens the mirror; `progress` is told the fraction done.
    ///
    /// # Errors
    /// [`Error::Config`] for what the optics refuse.
    pub fn new(
        instrument: &Instrument,
        reconstructor: &Reconstructor,
        board: &'a mut dyn Board,
        run: Run,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Self, Error> {
        if run.frames == 0 {
            return Err(refuse("--frames", 0, "at least 1"));
        }
        let pupil = instrument.pupil()?;
        let electrons = instrument.electrons_per_spot_on(&pupil);
        if !(electrons > 0.0 && electrons <= 1e9) {
            return Err(refuse("laser.electrons_per_spot", electrons, "above 0 and at most 1e9"));
        }
        let duration_s = f64::from(run.frames) * instrument.frame_s();
        let turbulence = instrument.turbulence(&pupil, duration_s)?;
        let atmosphere = turbulence.realise(run.seed, progress).into();
        Self::under(instrument, reconstructor, board, run, atmosphere)
    }

    /// Flattens the mirror under a sky that is given, and lasts for as long as the loop is stepped.
    ///
    /// # Errors
    /// [`Error::Config`] for what the optics refuse.
    pub fn under(
        instrument: &Instrument,
        reconstructor: &Reconstructor,
        board: &'a mut dyn Board,
        run: Run,
        atmosphere: Arc<Atmosphere>,
    ) -> Result<Self, Error> {
        let pupil = instrument.pupil()?;
        let frame_s = instrument.frame_s();
        let spots = pupil.subapertures().len();
        let two_gates = reconstructor.law().is_some();
        if two_gates && run.sensor != Sensor::Splash {
            let limit = "0 with a guide star, whose light comes from one height";
            return Err(refuse("second_gate.height_m", instrument.second_gate.height_m, limit));
        }
        let eye = match run.sensing {
            Sensing::Images => {
                Eye::Images(Imager::new(reconstructor, run.sensor, &pupil, &atmosphere)?.into())
            }
            Sensing::Geometric => Eye::Gradients {
                sensor: TruthSensor::new(
                    instrument,
                    reconstructor,
                    run.sensor,
                    &pupil,
                    &atmosphere,
                )?,
                lighting: reconstructor.lighting().clone(),
                fluxes: reconstructor.nominal_fluxes(),
            },
        };
        let (sensing_m, science_m) =
            (instrument.laser.wavelength_m, instrument.science.wavelength_m);
        let science = Science::new(&pupil, &atmosphere, sensing_m, science_m)?;
        let flat = vec![board.codes().to_vec(); usize::from(instrument.control.delay_frames)];
        let device = SegmentedMirror::new(instrument);
        let mut mirror = Mirror::flat(spots);
        device.apply(board.codes(), &mut mirror);
        Ok(Self {
            board,
            run,
            frame_s,
            atmosphere,
            eye,
            science,
            device,
            mirror,
            pending: flat.into(),
            cycle: reconstructor.lighting().count(),
            pupil,
            frame: 0,
        })
    }

    /// Exposes one frame, lets the firmware answer and moves the mirror.
    ///
    /// # Errors
    /// [`Error::Run`] if the board or the detector refuses the frame.
    pub fn step(&mut self) -> Result<Step<'_>, Error> {
        let (frame, time_s) = (self.frame, f64::from(self.frame) * self.frame_s);
        let Self { science, eye, atmosphere, mirror, run, board, .. } = self;
        let mut star = || science.observe(atmosphere, time_s, mirror);
        let (observation, report) = match eye {
            Eye::Images(imager) => {
                imager.light(frame);
                let noise =
                    (!run.noise_free).then_some(Noise { seed: run.seed, frame: u64::from(frame) });
                // The star and the sensor look at the same time: one enters the pool of threads, and both
                // take from it what they can.
                let (observation, pixels) =
                    rayon::join(star, || imager.expose(atmosphere, time_s, mirror, noise));
                (observation, board.frame(frame, Frame::Pixels(pixels?))?)
            }
            Eye::Gradients { sensor, lighting, fluxes } => {
                let observation = star();
                let spots = mirror.segments.len();
                let seen = sensor.look(atmosphere, time_s, mirror).iter().zip(fluxes).enumerate();
                let measured = seen.map(|(window, (centroid, flux))| {
                    let lit = lighting.lights(frame, window % spots);
                    measurement(*centroid, if lit { *flux } else { 0 })
                });
                let measurements: Vec<Measurement> = measured.collect();
                (observation, board.frame(frame, Frame::Measurements(&measurements))?)
            }
        };
        self.pending.push_back(self.board.codes().to_vec());
        if let Some(codes) = self.pending.pop_front() {
            self.device.apply(&codes, &mut self.mirror);
        }
        self.frame += 1;
        Ok(Step { frame, time_s, observation, pixels: self.pixels(), report })
    }

    /// Has the board's controller decide which frames are followed: to be called before each step
    /// ([`operate`]); without, every complete frame is.
    ///
    /// # Errors
    /// As there.
    pub fn operate(&mut self) -> Result<(), Error> {
        Ok(operate(self.board, self.frame, self.cycle)?)
    }

    /// Where the board's controller is.
    ///
    /// # Errors
    /// As [`Board::standing`].
    pub fn standing(&mut self) -> Result<Standing, Error> {
        Ok(self.board.standing()?)
    }

    /// The board.
    pub fn board(&self) -> &dyn Board {
        self.board
    }

    /// The turbulence.
    pub fn atmosphere(&self) -> &Atmosphere {
        &self.atmosphere
    }

    /// The pupil.
    pub fn pupil(&self) -> &Pupil {
        &self.pupil
    }

    /// The last detector frame, ADU, row-major; empty without images.
    pub fn pixels(&self) -> &[u16] {
        match &self.eye {
            Eye::Images(imager) => imager.pixels(),
            Eye::Gradients { .. } => &[],
        }
    }

    /// The star's residual phase of the last step, rad at the science wavelength.
    pub fn residual(&self) -> &[f32] {
        self.science.residual()
    }

    /// The mirror's shape after the last step, rad at the sensing wavelength.
    pub fn mirror(&self) -> &Mirror {
        &self.mirror
    }

    /// Exact centroids at the time of the next step with the mirror as it is, pixels: of each window, the second
    /// gate's behind the others.
    ///
    /// # Errors
    /// As [`ClosedLoop::new`].
    pub fn truth(
        &self,
        instrument: &Instrument,
        reconstructor: &Reconstructor,
    ) -> Result<TruthSensor, Error> {
        let (pupil, atmosphere) = (&self.pupil, &self.atmosphere);
        TruthSensor::new(instrument, reconstructor, self.run.sensor, pupil, atmosphere)
    }

    /// Measures with `sensor` what the next step's frame will show.
    pub fn look<'s>(&self, sensor: &'s mut TruthSensor) -> &'s [[f64; 2]] {
        let time_s = f64::from(self.frame) * self.frame_s;
        sensor.look(&self.atmosphere, time_s, &self.mirror)
    }
}

/// Exact centroids of all windows: a geometric sensor a gate.
pub struct TruthSensor {
    gates: Vec<GeometricSensor>,
    centroids: Vec<[f64; 2]>,
}

impl TruthSensor {
    fn new(
        instrument: &Instrument,
        reconstructor: &Reconstructor,
        sensor: Sensor,
        pupil: &Pupil,
        atmosphere: &Atmosphere,
    ) -> Result<Self, Error> {
        let gradients = |pixels_per_lambda_d| {
            let height_m = instrument.laser.beacon_height_m;
            let sensor =
                GeometricSensor::new(sensor, pupil, atmosphere, height_m, pixels_per_lambda_d)?;
            Ok::<_, Error>(sensor.with_launch(instrument.launch()))
        };
        let mut gates = vec![gradients(instrument.windows.pixels_per_lambda_d)?];
        if reconstructor.law().is_some() {
            let second = gradients(instrument.gate_pixels_per_lambda_d())?;
            gates.push(second.with_gate(instrument.second_gate.height_m)?);
        }
        let windows = gates.len() * pupil.subapertures().len();
        Ok(Self { gates, centroids: vec![[0.0; 2]; windows] })
    }

    /// What there is to see at `time_s` with `mirror`.
    fn look(&mut self, atmosphere: &Atmosphere, time_s: f64, mirror: &Mirror) -> &[[f64; 2]] {
        let each = self.centroids.chunks_exact_mut(mirror.segments.len());
        for (gate, centroids) in self.gates.iter_mut().zip(each) {
            gate.centroids(atmosphere, time_s, mirror, centroids);
        }
        &self.centroids
    }
}

/// A noiseless measurement of a centroid, pixels, with the flux of a spot.
fn measurement(centroid_px: [f64; 2], flux: u32) -> Measurement {
    let scale = f64::from(1u32 << CENTROID_BITS);
    // A centroid beyond any window is one at its edge; the cast saturates.
    let centroid_q16 = centroid_px.map(|c| (c.clamp(-32.0, 32.0) * scale).round() as i32);
    Measurement { centroid_q16, flux, peak: 0, saturated: 0 }
}
