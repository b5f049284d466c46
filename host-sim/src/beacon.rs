//! What scatters the laser's light, how much of it comes back, and from how deep.
//!
//! The lidar equation, integrated over the gate: of E/(h nu) photons launched in a frame along the zenith angle
//! zeta, there are detected
//!
//! N = E/(h nu) t_launch T^(2 / cos zeta) cos zeta \[int s(z) / z^2 dz\] A t_receive q,
//!
//! z the height above the telescope, A its collecting area, T the atmosphere's transmission one way at the zenith,
//! t the throughput of the optics, q the detector's quantum efficiency, and s(z) the light sent back, per metre
//! and steradian:
//! - **Rayleigh**: n(z) 5.45e-32 m^2/sr (550 nm / lambda)^4, n from the U.S. Standard Atmosphere 1976 (Collis &
//!   Russell 1976; Measures 1984, Laser Remote Sensing, p. 42; molecules of dry air below 100 km). No aerosol.
//! - **Sodium**: C sigma / (4 pi) times a Gaussian profile; C atoms per m^2 in the column, sigma an effective cross
//!   section that stands for line width, polarisation, pumping and the Earth's field, and is the laser's own.
//!   The default, 5.5e-16 m^2, is s_ce = sigma/(4 pi h nu) = 130 photons s^-1 W^-1 per atom m^-2, the low end of what
//!   Holzloehner et al. 2010 (A&A 510, A20) compute for continuous lasers; not saturated.
//!
//! All heights are above the telescope, but for the standard atmosphere's and the sodium layer's, which are above
//! sea level.

use crate::standard_atmosphere::molecules_per_m3;
use crate::theory::legendre::GaussLegendre;
use splash_firmware::gate::SPEED_OF_LIGHT_M_PER_S;
use std::f64::consts::{LN_2, PI};

/// Planck's constant, J s.
const PLANCK_J_S: f64 = 6.626_070_15e-34;
/// Backscatter cross section of a molecule of air, m^2/sr, at this wavelength, m.
const BACKSCATTER_M2_PER_SR: f64 = 5.45e-32;
const BACKSCATTER_WAVELENGTH_M: f64 = 550e-9;
/// Points over the gate: to 1e-6 for a gate through two widths of the sodium layer.
const POINTS: usize = 24;

/// What scatters, above a telescope at some altitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatterer {
    /// Of the telescope above sea level, m.
    pub site_altitude_m: f64,
    /// What.
    pub kind: Kind,
}

/// The two kinds of beacons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Molecules of the air.
    Rayleigh,
    /// Sodium atoms.
    Sodium {
        /// Middle of the layer above sea level, m.
        altitude_m: f64,
        /// Full width at half maximum, m.
        fwhm_m: f64,
        /// Atoms in the column, per m^2.
        atoms_per_m2: f64,
        /// Effective cross section, m^2.
        cross_section_m2: f64,
    },
}

impl Scatterer {
    /// Light sent back from `height_m` above the telescope, per m and sr.
    pub fn backscatter_per_m_sr(&self, height_m: f64, wavelength_m: f64) -> f64 {
        let altitude_m = self.site_altitude_m + height_m;
        match self.kind {
            Kind::Rayleigh => {
                let colour = (BACKSCATTER_WAVELENGTH_M / wavelength_m).powi(4);
                molecules_per_m3(altitude_m) * BACKSCATTER_M2_PER_SR * colour
            }
            Kind::Sodium { altitude_m: middle_m, fwhm_m, atoms_per_m2, cross_section_m2 } => {
                let sigma_m = fwhm_m / (8.0 * LN_2).sqrt();
                let away = (altitude_m - middle_m) / sigma_m;
                let per_m = (-away * away / 2.0).exp() / (sigma_m * (2.0 * PI).sqrt());
                atoms_per_m2 * per_m * cross_section_m2 / (4.0 * PI)
            }
        }
    }
}

/// A laser, its gate and what receives its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// What scatters.
    pub scatterer: Scatterer,
    /// Wavelength, m.
    pub wavelength_m: f64,
    /// Energy launched in a frame, as it leaves the laser, J.
    pub energy_j: f64,
    /// Middle of the gate above the telescope, m.
    pub height_m: f64,
    /// Depth of the gate, m of height.
    pub depth_m: f64,
    /// Zenith angle, rad.
    pub zenith_angle_rad: f64,
    /// From the laser to the sky, 0 to 1.
    pub launch_throughput: f64,
    /// Of the atmosphere between telescope and beacon, one way, at the zenith, 0 to 1.
    pub transmission: f64,
    /// Collecting area, m^2.
    pub area_m2: f64,
    /// From the sky to the detector, 0 to 1.
    pub receive_throughput: f64,
    /// Photo-electrons per photon.
    pub quantum_efficiency: f64,
}

impl Link {
    /// Photons that reach the telescope's area in a frame, above its optics.
    pub fn photons(&self) -> f64 {
        let photon_j = PLANCK_J_S * SPEED_OF_LIGHT_M_PER_S / self.wavelength_m;
        let cosine = self.zenith_angle_rad.cos();
        let rule = GaussLegendre::new(POINTS);
        let sent = |&(place, weight): &(f64, f64)| {
            let height_m = self.height_m + self.depth_m * (place - 0.5);
            let sent = self.scatterer.backscatter_per_m_sr(height_m, self.wavelength_m);
            weight * sent / (height_m * height_m)
        };
        let back_per_m2 = cosine * self.depth_m * rule.nodes().iter().map(sent).sum::<f64>();
        let launched = self.energy_j / photon_j * self.launch_throughput;
        launched * self.transmission.powf(2.0 / cosine) * back_per_m2 * self.area_m2
    }

    /// Photo-electrons in a frame.
    pub fn electrons(&self) -> f64 {
        self.photons() * self.receive_throughput * self.quantum_efficiency
    }
}
