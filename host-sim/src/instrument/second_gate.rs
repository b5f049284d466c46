//! The second gate of an instrument: its slab, its light, its pixels.

use super::Instrument;
use crate::beacon::Link;
use crate::error::Error;
use crate::optics::gate_image::Gate;
use crate::optics::slab::Slab;
use crate::pupil::Pupil;

impl Instrument {
    /// Whether spots are imaged at a second height, and something is made of it.
    pub fn has_second_gate(&self) -> bool {
        self.second_gate.height_m > 0.0 && self.second_gate.modes > 0
    }

    /// The second gate of the description, if it has one.
    ///
    /// # Errors
    /// [`Error::Config`] for a slab that cannot be.
    pub fn gate(&self) -> Result<Option<Gate>, Error> {
        if !self.has_second_gate() {
            return Ok(None);
        }
        let height_m = self.second_gate.height_m;
        Ok(Some(Gate {
            focus_m: self.laser.beacon_height_m,
            height_m,
            slab: self.slab_about(height_m, self.second_gate.depth_m)?,
            wavelength_m: self.laser.wavelength_m,
        }))
    }

    /// Pixels in lambda/d behind the second gate: the description's, or so many that a window reaches from the middle
    /// between two spots, d / z apart on the sky, to the next.
    pub fn gate_pixels_per_lambda_d(&self) -> f64 {
        let gate = &self.second_gate;
        if gate.pixels_per_lambda_d > 0.0 {
            return gate.pixels_per_lambda_d;
        }
        let pitch_m = self.telescope.pitch_m;
        let lambda_d = pitch_m * pitch_m / (self.laser.wavelength_m * gate.height_m);
        self.windows.size as f64 / lambda_d
    }

    /// Light of a spot at the second gate over its light at the first.
    ///
    /// # Errors
    /// [`Error::Config`] if the pupil cannot be.
    pub fn gate_light(&self) -> Result<f64, Error> {
        let pupil = self.pupil()?;
        if self.second_gate.electrons_per_spot > 0.0 {
            return Ok(self.second_gate.electrons_per_spot / self.electrons_per_spot_on(&pupil));
        }
        Ok(self.gate_lidar(&pupil).electrons() / self.lidar(&pupil).electrons())
    }

    /// The lidar equation of a spot at the second gate.
    fn gate_lidar(&self, pupil: &Pupil) -> Link {
        let gate = &self.second_gate;
        Link { height_m: gate.height_m, depth_m: gate.depth_m, ..self.lidar(pupil) }
    }

    /// From where the light of a gate comes whose camera is focused at its middle.
    pub(super) fn slab_about(&self, focus_m: f64, depth_m: f64) -> Result<Slab, Error> {
        let laser = &self.laser;
        if laser.slices == 1 {
            return Ok(Slab::sheet(focus_m));
        }
        let (pitch_m, wavelength_m) = (self.telescope.pitch_m, laser.wavelength_m);
        let diameter_m = self.telescope.subapertures as f64 * pitch_m;
        let count = match laser.slices {
            0 => Slab::slices_needed(focus_m, depth_m, wavelength_m, pitch_m, diameter_m),
            count => count,
        };
        let scatterer = self.scatterer();
        let density = |height_m| scatterer.backscatter_per_m_sr(height_m, wavelength_m);
        Ok(Slab::gated(focus_m, depth_m, wavelength_m, count, density)?)
    }
}
