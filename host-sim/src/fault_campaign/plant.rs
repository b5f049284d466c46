//! What the controller controls: sky, spots and mirror, and what of them is broken.

use crate::error::Error;
use crate::instrument::Instrument;
use crate::mirror::SegmentedMirror;
use crate::pupil::Mirror;
use crate::quick::spots::Spots;
use crate::quick::waves::Waves;
use crate::reconstructor::Reconstructor;

/// Light that is left in a dropout.
const DROPOUT: f64 = 0.02;

/// The plant.
pub(super) struct Plant {
    waves: Waves,
    spots: Spots,
    device: SegmentedMirror,
    mirror: Mirror,
    centroids: Vec<[f64; 2]>,
    fluxes_e: Vec<f64>,
    nominal_e: f64,
    /// What the actuators show.
    shown: Vec<[u16; 3]>,
    /// What is broken, and until which frame.
    pub(super) dead: Vec<u64>,
    pub(super) stuck: Vec<[u64; 3]>,
    pub(super) dropout: u64,
}

impl Plant {
    /// One in which nothing is broken.
    pub(super) fn new(
        instrument: &Instrument,
        reconstructor: &Reconstructor,
        seed: u64,
    ) -> Result<Self, Error> {
        let pupil = instrument.pupil()?;
        let count = pupil.subapertures().len();
        Ok(Self {
            waves: Waves::new(instrument, &pupil, seed),
            spots: Spots::new(instrument, reconstructor, seed),
            device: SegmentedMirror::new(instrument),
            mirror: Mirror::flat(count),
            centroids: vec![[0.0; 2]; count],
            fluxes_e: vec![0.0; count],
            nominal_e: instrument.electrons_per_spot()?,
            shown: vec![[0; 3]; count],
            dead: vec![0; count],
            stuck: vec![[0; 3]; count],
            dropout: 0,
        })
    }

    /// The actuators go to their codes, but for those that are stuck at `frame`.
    pub(super) fn move_to(&mut self, codes: &[[u16; 3]], frame: u64) {
        let shown = self.shown.as_flattened_mut().iter_mut();
        for ((shown, code), until) in shown.zip(codes.as_flattened()).zip(self.stuck.as_flattened())
        {
            if *until <= frame {
                *shown = *code;
            }
        }
        self.device.apply(&self.shown, &mut self.mirror);
    }

    /// Exposes frame `frame` with so much of the laser's light, 0 to 1: pixels, ADU, row-major.
    pub(super) fn expose(&mut self, frame: u64, light: f64) -> &mut [u16] {
        self.waves.centroids(&self.mirror, &mut self.centroids);
        let light = light * if frame < self.dropout { DROPOUT } else { 1.0 };
        for (flux, until) in self.fluxes_e.iter_mut().zip(&self.dead) {
            *flux = if frame < *until { 0.0 } else { light * self.nominal_e };
        }
        self.spots.expose(&self.centroids, &self.fluxes_e)
    }

    /// Distance of the last frame's spots from their reference, rms, px.
    pub(super) fn offset_px(&self) -> f64 {
        let squares: f64 = self.centroids.as_flattened().iter().map(|c| c * c).sum();
        (squares / self.centroids.len() as f64).sqrt()
    }

    /// Whether light is missing at `frame`.
    pub(super) fn is_dim(&self, frame: u64) -> bool {
        self.dead.iter().chain([&self.dropout]).any(|until| frame < *until)
    }

    /// Whether anything is broken at `frame`.
    pub(super) fn is_broken(&self, frame: u64) -> bool {
        self.is_dim(frame) || self.stuck.as_flattened().iter().any(|until| frame < *until)
    }
}
