//! No turbulence.

use host_sim::atmosphere::Atmosphere;
use host_sim::pupil::Pupil;

/// Above a pupil, at time 0.
pub(crate) fn still_air(pupil: &Pupil) -> Atmosphere {
    Atmosphere::from_screens(vec![], pupil.diameter_m(), 0.0).unwrap()
}
