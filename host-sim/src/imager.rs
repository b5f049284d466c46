//! The imaging sensor: its optics and its detector, from turbulence to a frame in ADU.

use crate::atmosphere::Atmosphere;
use crate::detector::{Detector, place};
use crate::error::Error;
use crate::lighting::Lighting;
use crate::optics::camera::Camera;
use crate::optics::gate_image::GateCamera;
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
    /// One a gate.
    views: Vec<View>,
    detector: Detector,
    lighting: Lighting,
    /// Photo-electrons of each spot that is lit, at the first gate.
    flux_e: f32,
    /// Which spots are lit.
    lit: Vec<bool>,
    expected_e: Vec<f32>,
    pixels: Vec<u16>,
}

/// What is seen through one gate.
struct View {
    camera: Camera,
    /// First column and row of the image of each spot.
    origins: Vec<[usize; 2]>,
    /// A spot's light over its light at the first gate.
    light: f32,
    images: Vec<f32>,
}

impl View {
    fn new(camera: Camera, origins: impl Iterator<Item = [usize; 2]>, light: f64) -> Self {
        let images = vec![0.0; camera.spots() * camera.window().pow(2)];
        Self { camera, origins: origins.collect(), light: light as f32, images }
    }
}

impl Imager {
    /// That of `sensor` in the reconstructor's instrument, with its gates, for atmospheres like `atmosphere`.
    ///
    /// # Errors
    /// [`Error::Config`] for what the optics refuse.
    pub fn new(
        reconstructor: &Reconstructor,
        sensor: Sensor,
        pupil: &Pupil,
        atmosphere: &Atmosphere,
    ) -> Result<Self, Error> {
        let instrument = reconstructor.instrument();
        let (scale, field) = (instrument.windows.pixels_per_lambda_d, instrument.field_px());
        // A window is in the middle of what is seen of its spot.
        let margin = (field - instrument.windows.size) / 2;
        let origin =
            |window: &[u16; 2]| window.map(|first| usize::from(first).saturating_sub(margin));
        let height_m = instrument.laser.beacon_height_m;
        let camera = Camera::new(sensor, pupil, atmosphere, height_m, scale, field)?
            .with_launch(instrument.launch())
            .with_slab(instrument.slab()?, atmosphere)?;
        let mut views = vec![View::new(camera, reconstructor.origins().iter().map(origin), 1.0)];
        if let (Some(origins), Some(light), Some(gate)) =
            (reconstructor.second_origins(), reconstructor.second_light(), instrument.gate()?)
        {
            let (scale, size) = (instrument.gate_pixels_per_lambda_d(), instrument.windows.size);
            let camera = GateCamera::new(pupil, atmosphere, &gate, scale, size)?
                .with_launch(instrument.launch());
            let origins = origins.iter().map(|window| window.map(usize::from));
            views.push(View::new(Camera::SecondGate(camera.into()), origins, light));
        }
        let detector = reconstructor.detector().clone();
        let pixels = detector.spec().width * detector.spec().height;
        let mut imager = Self {
            views,
            detector,
            flux_e: reconstructor.lighting().electrons(0) as f32,
            lit: vec![true; reconstructor.lighting().colours().len()],
            lighting: reconstructor.lighting().clone(),
            expected_e: vec![0.0; pixels],
            pixels: vec![0; pixels],
        };
        imager.light(0);
        Ok(imager)
    }

    /// Lights the spots that a schedule lights in frame `frame`, until told otherwise; those of the first
    /// frame before the first call.
    pub fn light(&mut self, frame: u32) {
        let Self { lighting, lit, flux_e, views, .. } = self;
        if lighting.count() > 1 {
            lit.iter_mut().enumerate().for_each(|(i, lit)| *lit = lighting.lights(frame, i));
            views.iter_mut().for_each(|view| view.camera.light(lit));
            *flux_e = lighting.electrons(frame) as f32;
        }
    }

    /// Leaves only this part of the mirror in the return path of SPLASH's spots.
    pub fn return_through(&mut self, part: f32) {
        self.views.iter_mut().for_each(|view| view.camera.return_through(part));
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
        let Self { views, detector, flux_e, lit, expected_e, pixels, .. } = self;
        expected_e.fill(0.0);
        for View { camera, origins, light, images } in views {
            camera.expose(atmosphere, time_s, mirror, images);
            let area = camera.window().pow(2);
            for (image, _) in images.chunks_exact_mut(area).zip(&*lit).filter(|(_, lit)| !**lit) {
                image.fill(0.0);
            }
            let width = detector.spec().width;
            place(images, *flux_e * *light, origins, camera.window(), width, expected_e)?;
        }
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
