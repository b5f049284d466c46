//! The camera of any sensor.

use super::OpticsError;
use super::gate_image::GateCamera;
use super::geometric::Sensor;
use super::launch::Launch;
use super::slab::Slab;
use super::splash_image::SplashCamera;
use super::subaperture_image::SubapertureCamera;
use crate::atmosphere::Atmosphere;
use crate::pupil::{Mirror, Pupil};

/// What makes the images of a sensor.
pub enum Camera {
    /// Spots through the subaperture and back through the whole telescope.
    Splash(Box<SplashCamera>),
    /// The same spots on their way.
    SecondGate(Box<GateCamera>),
    /// A guide star through each subaperture.
    Subapertures(Box<SubapertureCamera>),
}

impl Camera {
    /// The camera of `sensor`, whose beacon (if it has one) is at `beacon_height_m`; see
    /// [`SplashCamera::new`] and [`SubapertureCamera::new`].
    ///
    /// # Errors
    /// [`OpticsError`] with the value and its limit.
    pub fn new(
        sensor: Sensor,
        pupil: &Pupil,
        atmosphere: &Atmosphere,
        beacon_height_m: f64,
        pixels_per_lambda_d: f64,
        window: usize,
    ) -> Result<Self, OpticsError> {
        let of_guide_star = |height_m| {
            SubapertureCamera::new(pupil, atmosphere, height_m, pixels_per_lambda_d, window)
        };
        Ok(match sensor {
            Sensor::Splash => {
                let height_m = beacon_height_m;
                let camera =
                    SplashCamera::new(pupil, atmosphere, height_m, pixels_per_lambda_d, window)?;
                Self::Splash(camera.into())
            }
            Sensor::Lgs => Self::Subapertures(of_guide_star(Some(beacon_height_m))?.into()),
            Sensor::Ngs => Self::Subapertures(of_guide_star(None)?.into()),
        })
    }

    /// The same camera with beams of this shape; guide stars have none of them.
    #[must_use]
    pub fn with_launch(self, launch: Launch) -> Self {
        match self {
            Self::Splash(camera) => Self::Splash(Box::new(camera.with_launch(launch))),
            Self::SecondGate(camera) => Self::SecondGate(Box::new(camera.with_launch(launch))),
            Self::Subapertures(_) => self,
        }
    }

    /// The same camera with its beacon's light from this slab; a natural star has none, and a second gate has its
    /// own.
    ///
    /// # Errors
    /// As [`SplashCamera::with_slab`].
    pub fn with_slab(self, slab: Slab, atmosphere: &Atmosphere) -> Result<Self, OpticsError> {
        Ok(match self {
            Self::Splash(camera) => Self::Splash(camera.with_slab(slab, atmosphere)?.into()),
            Self::SecondGate(_) => self,
            Self::Subapertures(camera) => {
                Self::Subapertures(camera.with_slab(slab, atmosphere)?.into())
            }
        })
    }

    /// W, pixels on the side of a window.
    pub fn window(&self) -> usize {
        match self {
            Self::Splash(camera) => camera.window(),
            Self::SecondGate(camera) => camera.window(),
            Self::Subapertures(camera) => camera.window(),
        }
    }

    /// Number of images, one per subaperture in use.
    pub fn spots(&self) -> usize {
        match self {
            Self::Splash(camera) => camera.spots(),
            Self::SecondGate(camera) => camera.spots(),
            Self::Subapertures(camera) => camera.spots(),
        }
    }

    /// Whose images to make, one a spot; the others are left as they are. All, until told otherwise; those of
    /// a guide star, and of a second gate, are made at once.
    pub fn light(&mut self, lit: &[bool]) {
        match self {
            Self::Splash(camera) => camera.light(lit),
            Self::SecondGate(_) | Self::Subapertures(_) => {}
        }
    }

    /// See [`SplashCamera::return_through`]; light of guide stars comes in by one way only, and a second gate is
    /// always seen through all of the mirror.
    pub fn return_through(&mut self, part: f32) {
        match self {
            Self::Splash(camera) => camera.return_through(part),
            Self::SecondGate(_) | Self::Subapertures(_) => {}
        }
    }

    /// The images, `[subaperture][row][column]`, as fractions of each subaperture's light.
    ///
    /// # Panics
    /// As [`SplashCamera::expose`], [`GateCamera::expose`] and [`SubapertureCamera::expose`].
    pub fn expose(
        &mut self,
        atmosphere: &Atmosphere,
        time_s: f64,
        mirror: &Mirror,
        images: &mut [f32],
    ) {
        match self {
            Self::Splash(camera) => camera.expose(atmosphere, time_s, mirror, images),
            Self::SecondGate(camera) => camera.expose(atmosphere, time_s, mirror, images),
            Self::Subapertures(camera) => camera.expose(atmosphere, time_s, mirror, images),
        }
    }
}
