//! Turbulence profiles by name, from tables, and fewer layers in their place.
//!
//! Heights are above the telescope, vertical, as is the beacon's: what a layer does follows from the ratio of the
//! two, and a zenith angle lengthens both alike. Weights are shares: r0 is the description's, along the line of
//! sight (at zenith angle z that of the zenith times cos^(3/5) z).
//!
//! | name | layers | source |
//! |---|---|---|
//! | `paper` | 2 | Butterley et al. 2006: 60 % at the ground, 40 % at a quarter of the beacon's height |
//! | `hufnagel-valley-57` | 10 | the Hufnagel-Valley model of r0 = 5 cm and an isoplanatic angle of 7 urad at 500 nm, with Bufton's wind: Andrews & Phillips 2005, Laser Beam Propagation through Random Media, ch. 12 |
//! | `eso-median-35` | 35 | ESO's reference profile for the ELT, median: Sarazin et al. 2013, Defining reference turbulence profiles for E-ELT AO performance simulations, AO4ELT3; as in MAOS, `config/maos/atm/atm_elt50p.conf` |
//! | `mauna-kea-7` | 7 | the TMT site testing's median for Mauna Kea 13N; as in MAOS, `config/maos/atm/atm_mk13n50p.conf` |
//!
//! Models and tables give wind speeds and no directions: all blow along +x.

mod reduce;
mod tables;

pub use reduce::reduced;
pub use tables::{Profile, bufton_wind_m_per_s, hufnagel_valley_57, read};
