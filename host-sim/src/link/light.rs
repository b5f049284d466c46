//! What the detector of a board sees whose frames come from here.

use crate::atmosphere::Atmosphere;
use crate::error::Error;
use crate::imager::{Imager, Noise};
use crate::mirror::SegmentedMirror;
use crate::optics::geometric::Sensor;
use crate::pupil::{Mirror, Pupil};
use crate::reconstructor::Reconstructor;
use std::fmt;

/// Frames of turbulence that are drawn; then the same sky comes again.
const SKY_FRAMES: u32 = 1000;

/// What falls on the detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Light {
    /// Nothing.
    Dark,
    /// The same on every pixel, half of its range.
    Even,
    /// The spots through still air: a bench.
    Bench,
    /// The spots through turbulence.
    Sky,
}

impl fmt::Display for Light {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Dark => "no light on the detector",
            Self::Even => "even light on the detector, half of its range",
            Self::Bench => "the spots on the detector, without turbulence",
            Self::Sky => "the spots on the detector",
        })
    }
}

/// What a detector sees, frame after frame.
pub trait Scene {
    /// From the next frame on, this light.
    ///
    /// # Errors
    /// [`Error`] if there is no such light.
    fn set_light(&mut self, light: Light) -> Result<(), Error>;

    /// The next frame, ADU, row-major, with these codes on the mirror; none for a mirror that nothing
    /// has driven yet.
    ///
    /// # Errors
    /// [`Error`].
    fn expose(&mut self, codes: &[[u16; 3]]) -> Result<&[u16], Error>;
}

/// An instrument in simulation, with all its noise.
pub struct Simulated {
    reconstructor: Reconstructor,
    pupil: Pupil,
    device: SegmentedMirror,
    shape: Mirror,
    light: Light,
    bench: (Atmosphere, Imager),
    /// Drawn when it is first asked for.
    sky: Option<(Atmosphere, Imager)>,
    seed: u64,
    frame: u32,
    pixels: Vec<u16>,
}

impl Simulated {
    /// The reconstructor's, on the bench, with its gates; `seed` is that of noise and turbulence.
    ///
    /// # Errors
    /// [`Error::Config`] for what the optics refuse.
    pub fn new(reconstructor: Reconstructor, seed: u64) -> Result<Self, Error> {
        let instrument = reconstructor.instrument();
        let pupil = instrument.pupil()?;
        let still = Atmosphere::from_screens(Vec::new(), pupil.diameter_m(), 0.0)?;
        let imager = Imager::new(&reconstructor, Sensor::Splash, &pupil, &still)?;
        let detector = reconstructor.detector().spec();
        let pixels = detector.width * detector.height;
        Ok(Self {
            device: SegmentedMirror::new(instrument),
            shape: Mirror::flat(pupil.subapertures().len()),
            reconstructor,
            pupil,
            light: Light::Bench,
            bench: (still, imager),
            sky: None,
            seed,
            frame: 0,
            pixels: vec![0; pixels],
        })
    }

    fn draw_sky(&self) -> Result<(Atmosphere, Imager), Error> {
        let Self { reconstructor, pupil, .. } = self;
        let instrument = reconstructor.instrument();
        let duration_s = f64::from(SKY_FRAMES) * instrument.frame_s();
        let turbulence = instrument.turbulence(pupil, duration_s)?;
        let sky = turbulence.realise(self.seed, &mut |_| ());
        let imager = Imager::new(reconstructor, Sensor::Splash, pupil, &sky)?;
        Ok((sky, imager))
    }

    /// Half of the range of a pixel, electrons.
    fn half_range_e(&self) -> f32 {
        let detector = &self.reconstructor.instrument().detector;
        let codes = f64::from((1u32 << detector.bits) - 1) - detector.bias_adu;
        (codes * detector.gain_e_per_adu).min(detector.full_well_e) as f32 / 2.0
    }
}

impl Scene for Simulated {
    fn set_light(&mut self, light: Light) -> Result<(), Error> {
        if light == Light::Sky && self.sky.is_none() {
            self.sky = Some(self.draw_sky()?);
        }
        self.light = light;
        Ok(())
    }

    fn expose(&mut self, codes: &[[u16; 3]]) -> Result<&[u16], Error> {
        self.device.apply(codes, &mut self.shape);
        let frame = self.frame;
        self.frame = frame.wrapping_add(1);
        let level_e = match self.light {
            Light::Dark => 0.0,
            Light::Even => self.half_range_e(),
            Light::Bench | Light::Sky => {
                let time_s =
                    f64::from(frame % SKY_FRAMES) * self.reconstructor.instrument().frame_s();
                let noise = Some(Noise { seed: self.seed, frame: frame.into() });
                let scene = match &mut self.sky {
                    Some(sky) if self.light == Light::Sky => sky,
                    _ => &mut self.bench,
                };
                let (air, imager) = scene;
                imager.light(frame);
                return imager.expose(air, time_s, &self.shape, noise);
            }
        };
        let level = vec![level_e; self.pixels.len()];
        let detector = self.reconstructor.detector();
        detector.read(&level, frame.into(), self.seed, &mut self.pixels)?;
        Ok(&self.pixels)
    }
}
