//! The beacon of an instrument: its beams, its slab, its light.

use super::{Instrument, Laser, LaunchName, PhotonNumberName, ScattererName};
use crate::atmosphere::Turbulence;
use crate::beacon::{Kind, Link, Scatterer};
use crate::error::Error;
use crate::optics::OpticsError;
use crate::optics::launch::Launch;
use crate::optics::slab::Slab;
use crate::pupil::Pupil;

impl Instrument {
    /// The beams launched through the subapertures.
    pub fn launch(&self) -> Launch {
        match self.laser.launch {
            LaunchName::Uniform => Launch::Uniform,
            LaunchName::Gaussian => {
                Launch::Gaussian { waist_pitches: self.laser.launch_waist_pitches }
            }
        }
    }

    /// What scatters the laser's light.
    pub fn scatterer(&self) -> Scatterer {
        let photons = &self.photons;
        let kind = match self.laser.scatterer {
            ScattererName::Rayleigh => Kind::Rayleigh,
            ScattererName::Sodium => Kind::Sodium {
                altitude_m: photons.sodium_altitude_m,
                fwhm_m: photons.sodium_fwhm_m,
                atoms_per_m2: photons.sodium_atoms_per_m2,
                cross_section_m2: photons.sodium_cross_section_m2,
            },
        };
        Scatterer { site_altitude_m: photons.site_altitude_m, kind }
    }

    /// From where the light comes.
    ///
    /// # Errors
    /// [`Error::Config`] for a slab that cannot be.
    pub fn slab(&self) -> Result<Slab, Error> {
        let Laser { beacon_height_m, gate_depth_m, slices, .. } = self.laser;
        let slices = match slices {
            0 => self.slices_needed(beacon_height_m, gate_depth_m),
            given => given,
        };
        self.slab_about(beacon_height_m, gate_depth_m, slices, self.scatterer())
    }

    /// Slices that follow the blur of a gate whose camera is focused at its middle.
    pub(super) fn slices_needed(&self, focus_m: f64, depth_m: f64) -> usize {
        let (pitch_m, wavelength_m) = (self.telescope.pitch_m, self.laser.wavelength_m);
        let diameter_m = self.telescope.subapertures as f64 * pitch_m;
        Slab::slices_needed(focus_m, depth_m, wavelength_m, pitch_m, diameter_m)
    }

    /// From where the light of such a gate comes; a sheet for one slice.
    pub(super) fn slab_about(
        &self,
        focus_m: f64,
        depth_m: f64,
        slices: usize,
        scatterer: Scatterer,
    ) -> Result<Slab, Error> {
        if slices == 1 {
            return Ok(Slab::sheet(focus_m));
        }
        let wavelength_m = self.laser.wavelength_m;
        let density = |height_m| scatterer.backscatter_per_m_sr(height_m, wavelength_m);
        Ok(Slab::gated(focus_m, depth_m, wavelength_m, slices, density)?)
    }

    /// Photo-electrons per spot and frame, of a subaperture that is lit all over.
    ///
    /// # Errors
    /// [`Error::Config`] if the pupil cannot be.
    pub fn electrons_per_spot(&self) -> Result<f64, Error> {
        Ok(self.electrons_per_spot_on(&self.pupil()?))
    }

    /// The same on a pupil, which may be larger than any that the firmware takes.
    pub fn electrons_per_spot_on(&self, pupil: &Pupil) -> f64 {
        match self.photons.number {
            PhotonNumberName::Given => self.laser.electrons_per_spot,
            PhotonNumberName::Lidar => self.lidar(pupil).electrons(),
        }
    }

    /// The lidar equation of one spot.
    pub fn lidar(&self, pupil: &Pupil) -> Link {
        let Self { laser, photons, .. } = self;
        let spots = pupil.subapertures().len() as f64;
        Link {
            scatterer: self.scatterer(),
            wavelength_m: laser.wavelength_m,
            energy_j: photons.laser_power_w * self.frame_s() / spots,
            height_m: laser.beacon_height_m,
            depth_m: laser.gate_depth_m,
            zenith_angle_rad: laser.zenith_angle_deg.to_radians(),
            launch_throughput: photons.launch_throughput * self.launch().transmitted(),
            transmission: photons.transmission,
            area_m2: pupil.open_samples() * pupil.sample_pitch_m().powi(2),
            receive_throughput: photons.receive_throughput,
            quantum_efficiency: photons.quantum_efficiency,
        }
    }

    /// The same instrument under layers that stand still.
    #[must_use]
    pub fn frozen(mut self) -> Self {
        self.atmosphere.layers.iter_mut().for_each(|layer| layer.wind_speed_m_per_s = 0.0);
        self
    }

    /// The turbulence over a pupil for `duration_s`.
    ///
    /// # Errors
    /// [`OpticsError`] as [`Turbulence::new`].
    pub fn turbulence(&self, pupil: &Pupil, duration_s: f64) -> Result<Turbulence, OpticsError> {
        let (diameter_m, pitch_m) = (pupil.diameter_m(), pupil.pitch_m());
        Turbulence::new(self.r0_m(), &self.layers(), diameter_m, pitch_m, duration_s)
    }

    /// Fried parameter at the laser's wavelength, m.
    pub fn r0_m(&self) -> f64 {
        let (at_m, laser_m) = (self.atmosphere.r0_wavelength_m, self.laser.wavelength_m);
        if at_m == 0.0 || at_m == laser_m {
            return self.atmosphere.r0_m;
        }
        self.atmosphere.r0_m * (laser_m / at_m).powf(6.0 / 5.0)
    }
}
