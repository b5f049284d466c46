//! Kolmogorov turbulence with an infinite outer scale, in units of the pupil's radius:
//!
//! D(r) = C r^(5/3),  C = 2 [24/5 Gamma(6/5)]^(5/6) (R / r0)^(5/3).
//!
//! The constant is the exact one, 6.88388; the paper prints 6.88. Everything is for D / r0 = 1, that
//! is R / r0 = 1/2: variances are in rad^2 (D / r0)^(5/3), and fractions of them do not depend on r0.
//!
//! Its one integral that is not elementary,
//!
//! K(x, y) = int_0^y (x^2 + t^2)^(5/6) dt,
//!
//! is y times the hypergeometric function 2F1(-5/6, 1/2; 3/2; -y^2 / x^2) |x|^(5/3). Pfaff's
//! transformation, after the connection formula where |y| > |x|, leaves series in an argument of
//! at most 1/2, so that 56 terms give 15 digits everywhere:
//!
//! |y| <= |x|:  K = y r^(5/3) 2F1(-5/6, 1; 3/2; y^2 / r^2),  r^2 = x^2 + y^2
//! |y| > |x|:   K = sign(y) kappa |x|^(8/3) + (3/8) y r^(5/3) 2F1(-5/6, 1; -1/3; x^2 / r^2),
//!              kappa = Gamma(3/2) Gamma(-4/3) / Gamma(-5/6)

use crate::screen::STRUCTURE_CONSTANT;
use libm::tgamma;

/// Terms of the series: the last is below 2^-56.
const TERMS: usize = 56;

/// C, the structure function at one pupil radius for D / r0 = 1, rad^2.
pub fn structure() -> f64 {
    STRUCTURE_CONSTANT * 0.5f64.powf(5.0 / 3.0)
}

/// A / pi, where A k^(-11/3) is the power spectrum over angular wavenumbers that belongs to D:
/// from D(r) = (A / pi) int_0^inf k^(-8/3) (1 - J_0(k r)) dk.
pub fn spectrum() -> f64 {
    let integral = -2f64.powf(-8.0 / 3.0) * tgamma(-5.0 / 6.0) / tgamma(11.0 / 6.0);
    structure() / integral
}

/// The integral K(x, y), within 2e-15 of its value.
#[derive(Clone, Debug)]
pub struct LineIntegral {
    near: [f64; TERMS],
    far: [f64; TERMS],
    kappa: f64,
}

impl LineIntegral {
    /// Computes the series' coefficients.
    pub fn new() -> Self {
        let kappa = tgamma(1.5) * tgamma(-4.0 / 3.0) / tgamma(-5.0 / 6.0);
        Self { near: coefficients(1.5), far: coefficients(-1.0 / 3.0), kappa }
    }

    /// K(x, y), and r^(5/3), which it takes anyway.
    pub fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let (x2, y2) = (x * x, y * y);
        let r2 = x2 + y2;
        if r2 == 0.0 {
            return (0.0, 0.0);
        }
        let r53 = r2.powf(5.0 / 6.0);
        let integral = if y2 <= x2 {
            y * r53 * series(&self.near, y2 / r2)
        } else {
            let constant = y.signum() * self.kappa * x2.powf(4.0 / 3.0);
            constant + 0.375 * y * r53 * series(&self.far, x2 / r2)
        };
        (integral, r53)
    }
}

impl Default for LineIntegral {
    fn default() -> Self {
        Self::new()
    }
}

/// Those of 2F1(-5/6, 1; c; w).
fn coefficients(c: f64) -> [f64; TERMS] {
    let mut term = 1.0;
    std::array::from_fn(|k| {
        let this = term;
        term *= (k as f64 - 5.0 / 6.0) / (k as f64 + c);
        this
    })
}

fn series(coefficients: &[f64; TERMS], w: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * w + coefficient)
}
