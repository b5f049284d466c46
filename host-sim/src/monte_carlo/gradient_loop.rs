//! A loop of exact gradients in double precision: no images, no detector, no rounding, no limits.
//!
//! It has the firmware's law ([`super::slope_control`]), its sub-cycles too, and reaches pupils that the firmware does
//! not. Tips and tilts are phases from centre to edge: a centroid of one pixel of lambda/(p d) is pi/p of it.

use super::slope_control::{SlopeControl, Tilts, remove_mean};
use crate::atmosphere::Atmosphere;
use crate::error::Error;
use crate::instrument::Instrument;
use crate::lighting::Lighting;
use crate::optics::geometric::{GeometricSensor, Sensor};
use crate::optics::science::{Observation, Science};
use crate::pupil::Pupil;
use crate::range_diversity::law::Law;

/// A loop and its state.
pub struct GradientLoop {
    sensor: GeometricSensor,
    science: Science,
    control: SlopeControl,
    rad_per_px: f64,
    slopes: Tilts,
    lighting: Lighting,
    frame: u32,
}

impl GradientLoop {
    /// A loop with a flat mirror, for atmospheres like `atmosphere`.
    ///
    /// # Errors
    /// [`Error::Config`] for what the optics refuse.
    pub fn new(
        instrument: &Instrument,
        pupil: &Pupil,
        atmosphere: &Atmosphere,
        sensor: Sensor,
    ) -> Result<Self, Error> {
        let Instrument { laser, science, control, windows, .. } = instrument;
        let scale = windows.pixels_per_lambda_d;
        let height_m = laser.beacon_height_m;
        let law = Law::scalar(instrument.lever_arm(sensor)?);
        Ok(Self {
            sensor: GeometricSensor::new(sensor, pupil, atmosphere, height_m, scale)?
                .with_launch(instrument.launch()),
            science: Science::new(pupil, atmosphere, laser.wavelength_m, science.wavelength_m)?,
            control: SlopeControl::new(pupil, law, control.gain, control.delay_frames),
            rad_per_px: std::f64::consts::PI / scale,
            slopes: vec![[0.0; 2]; pupil.subapertures().len()],
            lighting: Lighting::on(&instrument.clone().seen_by(sensor), pupil)?,
            frame: 0,
        })
    }

    /// Observes the star if `observe` is on, measures, and moves the mirror.
    ///
    /// # Panics
    /// If the atmosphere is not like the one given to [`Self::new`], or `time_s` is outside its duration.
    pub fn step(
        &mut self,
        atmosphere: &Atmosphere,
        time_s: f64,
        observe: bool,
    ) -> Option<Observation> {
        let mirror = self.control.mirror();
        let observation = observe.then(|| self.science.observe(atmosphere, time_s, mirror));
        self.sensor.centroids(atmosphere, time_s, mirror, &mut self.slopes);
        self.slopes.as_flattened_mut().iter_mut().for_each(|slope| *slope *= self.rad_per_px);
        if self.lighting.count() == 1 {
            remove_mean(&mut self.slopes);
            self.control.step(&mut self.slopes, &mut []);
        } else {
            let lit = |i| self.lighting.lights(self.frame, i);
            self.control.step_part(&self.slopes, lit);
        }
        self.frame = self.frame.wrapping_add(1);
        observation
    }
}
