//! The second gate of an instrument: its slab, its light, its pixels.

use super::limits::{MAX_DETECTOR_SIDE, within};
use super::{Instrument, LayoutName, SecondGate};
use crate::beacon::{Kind, Link, Scatterer};
use crate::error::{Error, refuse};
use crate::optics::gate_image::Gate;
use crate::pupil::Pupil;
use crate::range_diversity::modes::Modes;

/// From spot to spot: as many samples are taken across a subaperture, whose transforms take their time.
const MOST_LAMBDA_D: f64 = 480.0;
/// Blur of a slab that no more slices follow than there may be.
const MOST_BLUR_LAMBDA_D: f64 = 78.0;

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
        let SecondGate { height_m, depth_m, .. } = self.second_gate;
        let slices = match self.laser.slices {
            1 => 1,
            // The whole telescope's depth of focus is less here than at the beacon.
            count => count.max(self.slices_needed(height_m, depth_m)),
        };
        Ok(Some(Gate {
            focus_m: self.laser.beacon_height_m,
            height_m,
            slab: self.slab_about(height_m, depth_m, slices, self.air())?,
            wavelength_m: self.laser.wavelength_m,
        }))
    }

    /// Pixels in lambda/d behind the second gate: the description's, or as few as there may be.
    pub fn gate_pixels_per_lambda_d(&self) -> f64 {
        match self.second_gate.pixels_per_lambda_d {
            0.0 => self.least_gate_pixels_per_lambda_d(),
            given => given,
        }
    }

    /// So many that a window reaches from the middle between two spots, d / z apart on the sky, to the next.
    fn least_gate_pixels_per_lambda_d(&self) -> f64 {
        self.windows.size as f64 / self.gate_spacing_lambda_d()
    }

    /// From spot to spot at the second gate, lambda/d.
    fn gate_spacing_lambda_d(&self) -> f64 {
        let pitch_m = self.telescope.pitch_m;
        pitch_m * pitch_m / (self.laser.wavelength_m * self.second_gate.height_m)
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
        let SecondGate { height_m, depth_m, .. } = self.second_gate;
        Link { height_m, depth_m, scatterer: self.air(), ..self.lidar(pupil) }
    }

    /// Below a beacon of sodium there is air.
    fn air(&self) -> Scatterer {
        Scatterer { kind: Kind::Rayleigh, ..self.scatterer() }
    }

    /// What the second gate cannot be with, and where it cannot be.
    pub(super) fn check_second_gate(&self) -> Result<(), Error> {
        let Self { laser, second_gate: gate, .. } = self;
        let highest_m = laser.beacon_height_m - (laser.gate_depth_m + gate.depth_m) / 2.0;
        within("second_gate.height_m", gate.height_m, 0.0, highest_m.max(0.0))?;
        within("second_gate.depth_m", gate.depth_m, 1e-3, 1e6)?;
        within("second_gate.electrons_per_spot", gate.electrons_per_spot, 0.0, 1e9)?;
        within("second_gate.pixels_per_lambda_d", gate.pixels_per_lambda_d, 0.0, 8.0)?;
        if !Modes::COUNTS.contains(&gate.modes) {
            return Err(refuse("second_gate.modes", gate.modes, "0, 12 or 25"));
        }
        for (index, noise_rad) in gate.slope_noise_rad.into_iter().enumerate() {
            within(&format!("second_gate.slope_noise_rad[{index}]"), noise_rad, 0.0, 100.0)?;
        }
        for (index, layer) in gate.layers.iter().enumerate() {
            let check = |field: &str, value, from, to| {
                within(&format!("second_gate.layers[{index}].{field}"), value, from, to)
            };
            check("weight", layer.weight, 1e-6, 1e9)?;
            check("height_m", layer.height_m, 0.0, 0.999 * laser.beacon_height_m)?;
        }
        if self.has_second_gate() { self.check_gate_images() } else { Ok(()) }
    }

    /// Spots side by side, as wide as they are, each in a window of its own.
    fn check_gate_images(&self) -> Result<(), Error> {
        let Self { telescope, laser, second_gate: gate, .. } = self;
        if !self.schedule.lights_all() {
            let limit = "0 with [schedule]: a second gate needs all spots lit together";
            return Err(refuse("second_gate.height_m", gate.height_m, limit));
        }
        if self.windows.layout == LayoutName::Sky {
            let limit = "\"relayed\" with a second gate, whose spots have other distances";
            return Err(refuse("windows.layout", "\"sky\"", limit));
        }
        let (rows, most) = (2 * self.detector_side(), MAX_DETECTOR_SIDE);
        within("second_gate: rows of the detector", rows as f64, 1.0, most as f64)?;
        let spacing = self.gate_spacing_lambda_d();
        if spacing > MOST_LAMBDA_D {
            let limit = format!(
                "higher: spots are {spacing:.0} lambda/d apart there, at most {MOST_LAMBDA_D}"
            );
            return Err(refuse("second_gate.height_m", gate.height_m, &limit));
        }
        if gate.pixels_per_lambda_d > 0.0 {
            let least = self.least_gate_pixels_per_lambda_d();
            within("second_gate.pixels_per_lambda_d", gate.pixels_per_lambda_d, least, 8.0)?;
        }
        if laser.slices != 1 {
            // Of a spot, d (1/z - 1/H) wide, d/H are left to its neighbour's.
            let pitch_m = telescope.pitch_m;
            let room_rad = (pitch_m / laser.beacon_height_m)
                .min(MOST_BLUR_LAMBDA_D * laser.wavelength_m / pitch_m);
            let diameter_m = telescope.subapertures as f64 * pitch_m;
            let deepest_m = room_rad * gate.height_m.powi(2) / diameter_m;
            if gate.depth_m > deepest_m {
                let limit = format!(
                    "at most {deepest_m:.1} with laser.slices = {}: beyond, out of the whole telescope's \
                     focus, spots reach into one another",
                    laser.slices
                );
                return Err(refuse("second_gate.depth_m", gate.depth_m, &limit));
            }
        }
        let electrons = self.electrons_per_spot()? * self.gate_light()?;
        let name = "second_gate.electrons_per_spot: photo-electrons per spot and frame";
        within(name, electrons, 1e-3, 1e9)
    }
}
