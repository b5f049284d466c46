//! A sky and a detector that cost next to nothing, for runs of a million frames: [`waves`] in place
//! of phase screens, Gaussian [`spots`] in place of diffraction.
//!
//! The firmware cannot tell: its frames have the instrument's windows, bits, bias and noise, and a
//! spot goes where the wavefront's tilt less the mirror's puts it. What is lost is speckle, and the
//! return path; no Strehl ratio is to be had from here.

pub mod spots;
pub mod waves;
