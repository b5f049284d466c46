//! The imaging sensor: its optics and its detector, from turbulence to a frame in ADU.

use crate::atmosphere::Atmosphere;
use crate::detector::{Detector, place};
use crate::error::Error;
use crate::instrument::Instrument;
use crate::optics::camera::Camera;
use crate::optics::geometric::Sensor;
use crate::pupil::{Mirror, Pupil};
use crate::reconstructor::Reconstructor;

/// What the random numbers of a frame depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noise {
    /// The run's seed.
    pub seed: u64,
    /// The frame's number.
    pub frame: u64,
}

/// Spots through optics onto the detector.
pub struct Imager {
    camera: Camera,
    detector: Detector,
    /// First column and row of each window.
    origins: Vec<[usize; 2]>,
    /// Photo-electrons per spot and frame.
    flux_e: f32,
    images: Vec<f32>,
    expected_e: Vec<f32>,
    pixels: Vec<u16>,
}

impl Imager {
    /// That of `sensor` in an instrument, for atmospheres like `atmosphere`.
    ///
    /// # Errors
    /// [`Error::Config`] for what the optics refuse.
    pub fn new(
        instrument: &Instrument,
        reconstructor: &Reconstructor,
        sensor: Sensor,
        pupil: &Pupil,
        atmosphere: &Atmosphere,
    ) -> Result<Self, Error> {
        let (scale, window) = (instrument.windows.pixels_per_lambda_d, instrument.windows.size);
        let height_m = instrument.laser.beacon_height_m;
        let camera = Camera::new(sensor, pupil, atmosphere, height_m, scale, window)?
            .with_launch(instrument.launch())
            .with_slab(instrument.slab()?, atmosphere)?;
        let detector = reconstructor.detector().clone();
        let pixels = detector.spec().width * detector.spec().height;
        Ok(Self {
            images: vec![0.0; camera.spots() * window * window],
            camera,
            detector,
            origins: reconstructor.origins().iter().map(|o| o.map(usize::from)).collect(),
            flux_e: instrument.electrons_per_spot()? as f32,
            expected_e: vec![0.0; pixels],
            pixels: vec![0; pixels],
        })
    }

    /// Exposes and reads a frame, ADU, row-major; without `noise`, its expectation.
    ///
    /// # Errors
    /// [`Error::Config`] if a window leaves the detector.
    pub fn expose(
        &mut self,
        atmosphere: &Atmosphere,
        time_s: f64,
        mirror: &Mirror,
        noise: Option<Noise>,
    ) -> Result<&[u16], Error> {
        let Self { camera, detector, origins, flux_e, images, expected_e, pixels } = self;
        camera.expose(atmosphere, time_s, mirror, images);
        expected_e.fill(0.0);
        place(images, *flux_e, origins, camera.window(), detector.spec().width, expected_e)?;
        match noise {
            Some(Noise { seed, frame }) => detector.read(expected_e, frame, seed, pixels)?,
            None => detector.read_noise_free(expected_e, pixels)?,
        }
        Ok(pixels)
    }

    /// The last frame, ADU, row-major.
    pub fn pixels(&self) -> &[u16] {
        &self.pixels
    }
}
