//! Kolmogorov turbulence as a sum of waves.
//!
//! A layer's phase has the power spectrum W(k) = A/(4 pi^2) k^(-11/3), so that two linear functionals of it, a and b,
//! have the covariance
//!
//! cov(a, b) = int W(k) Re[a(k) b(k)*] d^2k = sum over waves of w Re[a(k) b(k)*],
//!
//! where a(k) is what the functional makes of exp(i k.x). Every way to look at a layer is a product of few such
//! factors, however many squares it goes through, and a matrix that is summed up in this way is a covariance: no
//! eigenvalue of it is negative.
//!
//! Functionals without piston and tilt grow as k^2, and W(k) a b* k dk as k^(4/3) dk. With k = u^3 / (u^2 + c^2) that
//! is smooth in u, and equal steps in u and in angle converge faster than any power of them, once they resolve
//! exp(i k.r) for the longest r there is. What remains is what lies beyond the finest wave. At N = 4, of the largest
//! covariance: 7e-3 with two waves on a subaperture, 1e-3 with four, 3e-5 with sixteen; of low-order modes it falls
//! with N as well.
//!
//! Lengths are in units of half the grid's side, everything is for D / r0 = 1.

use crate::theory::kolmogorov::spectrum;
use std::f64::consts::{PI, TAU};

/// A wave of the turbulence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// k.
    pub vector: [f64; 2],
    /// w, of the wave and of its opposite together, rad^2.
    pub weight: f64,
}

/// How much finer steps are than the longest separation needs.
const MARGIN: f64 = 1.3;
/// c, steps: with less, the bend of k(u) is too sharp for the steps, by 5e-3 with 2.
const KNEE: f64 = 4.0;

/// The waves for a grid of `across` subapertures, up to `per_subaperture` of them on one, between points that are up
/// to `longest` apart.
pub fn waves(across: usize, per_subaperture: f64, longest: f64) -> Vec<Wave> {
    let farthest = per_subaperture * PI * across as f64;
    let step = TAU / (MARGIN * longest);
    // c: below, k has the power of u that makes the spectrum smooth; above, it grows as u.
    let knee = KNEE * step;
    let at = |u: f64| u.powi(3) / (u * u + knee * knee);
    let growth = |u: f64| {
        let (u2, c2) = (u * u, knee * knee);
        u2 * (u2 + 3.0 * c2) / (u2 + c2).powi(2)
    };
    let mut waves = Vec::new();
    let mut u = 0.5 * step;
    while at(u) < farthest {
        let k = at(u);
        let reach = k * longest;
        let angles = (0.5 * (reach + 6.0 * reach.cbrt() + 8.0)).ceil();
        let spectrum = spectrum() / (4.0 * PI) * k.powf(-11.0 / 3.0);
        let weight = spectrum * k * growth(u) * step * TAU / angles;
        for angle in 0..angles as usize {
            let (sin, cos) = (PI * (angle as f64 + 0.5) / angles).sin_cos();
            waves.push(Wave { vector: [k * cos, k * sin], weight });
        }
        u += step;
    }
    waves
}
