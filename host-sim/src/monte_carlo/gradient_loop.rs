//! A loop of exact gradients in double precision: no images, no detector, no rounding, no limits.
//!
//! It has the firmware's law, c' = (1 - g) c + g f (s + c_applied), with means removed from slopes and
//! commands, and reaches pupils that the firmware does not. Tips and tilts are phases from centre to edge:
//! a centroid of one pixel of lambda/(p d) is pi/p of it.

use super::pistons::Pistons;
use crate::atmosphere::Atmosphere;
use crate::error::Error;
use crate::instrument::Instrument;
use crate::optics::geometric::{GeometricSensor, Sensor};
use crate::optics::science::{Observation, Science};
use crate::pupil::{Mirror, Pupil};
use std::collections::VecDeque;

/// Tips and tilts of the segments, rad from centre to edge.
pub(super) type Tilts = Vec<[f64; 2]>;

/// A loop and its state.
pub struct GradientLoop {
    sensor: GeometricSensor,
    science: Science,
    pistons: Pistons,
    gain: f64,
    lever_arm: f64,
    rad_per_px: f64,
    commands: Tilts,
    applied: Tilts,
    /// Commands on their way to the mirror, oldest first: as many as the delay has frames.
    pending: VecDeque<Tilts>,
    mirror: Mirror,
    centroids: Tilts,
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
        let flat = vec![[0.0; 2]; pupil.subapertures().len()];
        Ok(Self {
            sensor: GeometricSensor::new(sensor, pupil, atmosphere, height_m, scale)?,
            science: Science::new(pupil, atmosphere, laser.wavelength_m, science.wavelength_m)?,
            pistons: Pistons::new(pupil),
            gain: control.gain,
            lever_arm: instrument.lever_arm(sensor)?,
            rad_per_px: std::f64::consts::PI / scale,
            mirror: Mirror::flat(flat.len()),
            pending: vec![flat.clone(); usize::from(control.delay_frames)].into(),
            commands: flat.clone(),
            applied: flat.clone(),
            centroids: flat,
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
        let observation = observe.then(|| self.science.observe(atmosphere, time_s, &self.mirror));
        self.sensor.centroids(atmosphere, time_s, &self.mirror, &mut self.centroids);
        remove_mean(&mut self.centroids);
        let measured = self.centroids.iter().zip(&self.applied);
        for (command, (centroid, applied)) in self.commands.iter_mut().zip(measured) {
            for axis in 0..2 {
                let open = self.rad_per_px * centroid[axis] + applied[axis];
                command[axis] += self.gain * (self.lever_arm * open - command[axis]);
            }
        }
        remove_mean(&mut self.commands);
        self.pending.push_back(self.commands.clone());
        if let Some(next) = self.pending.pop_front() {
            self.applied = next;
        }
        let pistons = self.pistons.solve(&self.applied);
        let shape = pistons.iter().zip(&self.applied);
        self.mirror.segments = shape.map(|(&piston, &[tip, tilt])| [piston, tip, tilt]).collect();
        observation
    }
}

/// Global tip and tilt are not the sensor's to correct.
pub(super) fn remove_mean(tilts: &mut [[f64; 2]]) {
    for axis in 0..2 {
        let mean = tilts.iter().map(|tilt| tilt[axis]).sum::<f64>() / tilts.len() as f64;
        tilts.iter_mut().for_each(|tilt| tilt[axis] -= mean);
    }
}
