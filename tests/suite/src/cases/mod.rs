//! What there is: the stages one by one, then whole frames.

mod frames;
mod law;
mod mirror;
mod pixels;
#[cfg(test)]
mod tests;

use crate::instrument::Instrument;
use crate::play::Case;

/// An instrument and what is done with it.
#[derive(Debug)]
pub(crate) struct Subject {
    pub(crate) instrument: Instrument,
    /// Cases of its solver alone, with limits of the tips and tilts that it gets, ulp.
    pub(crate) tilts: &'static [(&'static str, i32)],
    pub(crate) cases: &'static [Case],
}

/// All of them, in the order of a frame.
pub(crate) const SUBJECTS: [&[Subject]; 4] =
    [pixels::SUBJECTS, law::SUBJECTS, mirror::SUBJECTS, frames::SUBJECTS];
