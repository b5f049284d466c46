//! What the loop of gradients converges to under a sky that stands still, without running it.
//!
//! The law c' = (1 - g) c + g f (s + c) has the fixed point c = f (s + c). A geometric sensor takes the
//! mirror off what it sees, so s + c is what it sees with a flat mirror, less its mean: the gain does not
//! matter, and one frame is enough.

use super::pistons::Pistons;
use super::slope_control::{Tilts, remove_mean};
use crate::atmosphere::Atmosphere;
use crate::error::Error;
use crate::instrument::Instrument;
use crate::optics::geometric::{Effects, GeometricSensor, Sensor};
use crate::optics::science::{Observation, Science};
use crate::pupil::{Mirror, Pupil};

/// A loop that has converged.
pub struct Converged {
    sensor: GeometricSensor,
    science: Science,
    pistons: Pistons,
    /// f, and rad from centre to edge per pixel of centroid.
    rad_per_px: f64,
    flat: Mirror,
    mirror: Mirror,
    tilts: Tilts,
}

impl Converged {
    /// That of `sensor` with `effects`, under atmospheres like `atmosphere`; `lever_arm` is f.
    ///
    /// # Errors
    /// [`Error::Config`] for what the optics refuse.
    pub fn new(
        instrument: &Instrument,
        pupil: &Pupil,
        atmosphere: &Atmosphere,
        sensor: Sensor,
        effects: Effects,
        lever_arm: f64,
    ) -> Result<Self, Error> {
        let Instrument { laser, science, windows, .. } = instrument;
        let scale = windows.pixels_per_lambda_d;
        let sensor = GeometricSensor::new(sensor, pupil, atmosphere, laser.beacon_height_m, scale)?;
        let flat = Mirror::flat(pupil.subapertures().len());
        Ok(Self {
            sensor: sensor.with_effects(effects).with_launch(instrument.launch()),
            science: Science::new(pupil, atmosphere, laser.wavelength_m, science.wavelength_m)?,
            pistons: Pistons::new(pupil),
            rad_per_px: lever_arm * std::f64::consts::PI / scale,
            mirror: flat.clone(),
            tilts: vec![[0.0; 2]; flat.segments.len()],
            flat,
        })
    }

    /// The mirror of the last [`Converged::observe`].
    pub fn mirror(&self) -> &Mirror {
        &self.mirror
    }

    /// The star behind the mirror that the sky of `time_s` asks for.
    ///
    /// # Panics
    /// If the atmosphere is not like the one given to [`Self::new`], or `time_s` is outside its duration.
    pub fn observe(&mut self, atmosphere: &Atmosphere, time_s: f64) -> Observation {
        self.sensor.centroids(atmosphere, time_s, &self.flat, &mut self.tilts);
        remove_mean(&mut self.tilts);
        self.tilts.as_flattened_mut().iter_mut().for_each(|tilt| *tilt *= self.rad_per_px);
        let pistons = self.pistons.solve(&self.tilts);
        let shape = pistons.iter().zip(&self.tilts);
        self.mirror.segments = shape.map(|(&piston, &[tip, tilt])| [piston, tip, tilt]).collect();
        self.science.observe(atmosphere, time_s, &self.mirror)
    }
}
