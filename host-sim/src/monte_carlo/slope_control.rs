//! The firmware's control law in double precision: slopes to tips and tilts to pistons.
//!
//! c' = (1 - g) c + g L(s + c_applied), where c_applied is what was on the mirror while the slopes s were exposed, L is
//! the law of [`crate::range_diversity`], f times its argument for one gate, and the means are removed from slopes and
//! commands: with one gain for all the firmware's commands never get one. With a mirror that the sensor sees as it is,
//! s + c_applied is the sky's: the pole is 1 - g, whatever L. Tips, tilts and slopes are phases from centre to edge.

use super::pistons::Pistons;
use crate::pupil::{Mirror, Pupil};
use crate::range_diversity::law::Law;
use std::collections::VecDeque;

/// Tips and tilts of the segments, rad from centre to edge.
pub type Tilts = Vec<[f64; 2]>;

/// A controller and its state.
#[derive(Clone, Debug)]
pub struct SlopeControl {
    law: Law,
    gain: f64,
    pistons: Pistons,
    commands: Tilts,
    applied: Tilts,
    /// Commands on their way to the mirror, oldest first: as many as the delay has frames.
    pending: VecDeque<Tilts>,
    wanted: Tilts,
    mirror: Mirror,
    /// s + c_applied of each subaperture as it was last lit, with a schedule.
    open_loop: Vec<Option<[f64; 2]>>,
}

impl SlopeControl {
    /// A flat mirror, the integrator's `gain`, and a delay beyond the one frame of any loop.
    pub fn new(pupil: &Pupil, law: Law, gain: f64, delay_frames: u8) -> Self {
        let flat = vec![[0.0; 2]; pupil.subapertures().len()];
        Self {
            law,
            gain,
            pistons: Pistons::new(pupil),
            mirror: Mirror::flat(flat.len()),
            pending: vec![flat.clone(); usize::from(delay_frames)].into(),
            commands: flat.clone(),
            applied: flat.clone(),
            open_loop: vec![None; flat.len()],
            wanted: flat,
        }
    }

    /// The mirror.
    pub fn mirror(&self) -> &Mirror {
        &self.mirror
    }

    /// Tips and tilts of the mirror.
    pub fn applied(&self) -> &[[f64; 2]] {
        &self.applied
    }

    /// Moves the mirror after the slopes of the gates less their means, which are left as open-loop slopes; the second
    /// is empty where there is none.
    ///
    /// # Panics
    /// If there is not one slope for each segment.
    pub fn step(&mut self, first: &mut [[f64; 2]], second: &mut [[f64; 2]]) {
        for slopes in [&mut *first, &mut *second] {
            for (slope, applied) in slopes.iter_mut().zip(&self.applied) {
                for axis in 0..2 {
                    slope[axis] += applied[axis];
                }
            }
        }
        self.law.commands(first, second, &mut self.wanted);
        for (command, wanted) in self.commands.iter_mut().zip(&self.wanted) {
            for axis in 0..2 {
                command[axis] += self.gain * (wanted[axis] - command[axis]);
            }
        }
        remove_mean(&mut self.commands);
        self.show();
    }

    /// Moves the segments that a sub-cycle has lit, after their slopes; the mean of s + c_applied is that of everyone's
    /// latest, as in the firmware.
    ///
    /// # Panics
    /// If there is not one slope for each segment.
    pub fn step_part(&mut self, slopes: &[[f64; 2]], lit: impl Fn(usize) -> bool) {
        for (i, ([x, y], [tip, tilt])) in slopes.iter().zip(&self.applied).enumerate() {
            if lit(i) {
                self.open_loop[i] = Some([x + tip, y + tilt]);
            }
        }
        let known: Tilts = self.open_loop.iter().flatten().copied().collect();
        let mean = |axis: usize| known.iter().map(|x| x[axis]).sum::<f64>() / known.len() as f64;
        let mean = [mean(0), mean(1)];
        let less = |x: &Option<[f64; 2]>| x.map_or([0.0; 2], |[x, y]| [x - mean[0], y - mean[1]]);
        let open_loop: Tilts = self.open_loop.iter().map(less).collect();
        self.law.commands(&open_loop, &[], &mut self.wanted);
        for (i, (command, wanted)) in self.commands.iter_mut().zip(&self.wanted).enumerate() {
            if lit(i) {
                for axis in 0..2 {
                    command[axis] += self.gain * (wanted[axis] - command[axis]);
                }
            }
        }
        self.show();
    }

    /// Gives the mirror the command whose time has come.
    fn show(&mut self) {
        self.pending.push_back(self.commands.clone());
        if let Some(next) = self.pending.pop_front() {
            self.applied = next;
        }
        let pistons = self.pistons.solve(&self.applied);
        let shape = pistons.iter().zip(&self.applied);
        self.mirror.segments = shape.map(|(&piston, &[tip, tilt])| [piston, tip, tilt]).collect();
    }
}

/// Global tip and tilt are not the sensor's to correct.
pub(super) fn remove_mean(tilts: &mut [[f64; 2]]) {
    for axis in 0..2 {
        let mean = tilts.iter().map(|tilt| tilt[axis]).sum::<f64>() / tilts.len() as f64;
        tilts.iter_mut().for_each(|tilt| tilt[axis] -= mean);
    }
}
