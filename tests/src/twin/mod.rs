//! The stages in f64, written from their equations.
//!
//! Where a stage says how it stores a value (a threshold as a whole ADU, a gain as a 13-bit
//! fraction), its model can take the stored value as well as the physical one: the first shows
//! the error of the arithmetic, the second that of the format.

pub mod control;
pub mod mirror;
pub mod modal;
pub mod pistons;
pub mod pixels;

/// Nearest integer, ties up.
pub fn round(x: f64) -> f64 {
    (x + 0.5).floor()
}

/// The nearest multiple of 2^-`bits`, ties up.
pub fn stored(x: f64, bits: i32) -> f64 {
    let scale = f64::powi(2.0, bits);
    round(x * scale) / scale
}
