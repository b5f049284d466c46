//! Noll's (1976) covariances of Zernike coefficients in Kolmogorov turbulence, with W = 1 / pi on the
//! unit disk:
//!
//! <a_j a_k> = (2 A / pi) (-1)^((n + n' - 2 m) / 2) sqrt((n + 1) (n' + 1))
//!             int_0^inf t^(-14/3) J_(n+1)(t) J_(n'+1)(t) dt
//!
//! for equal m and equal angular parts, 0 otherwise; the integral (Weber, Schafheitlin) is
//!
//! 2^(-14/3) Gamma(14/3) Gamma((n + n' - 5/3) / 2)
//!   / [Gamma((n - n' + 17/3) / 2) Gamma((n' - n + 17/3) / 2) Gamma((n + n' + 23/3) / 2)].
//!
//! Good to 1e-13 for n + n' <= 300. The constant that Noll prints as 0.023 is exact here: his
//! residuals come out 0.2 to 0.6 % larger.

use super::kolmogorov::spectrum;
use libm::tgamma;

/// <a_j a_k> of two polynomials with radial orders `n` and `n_other`, the same azimuthal order
/// `azimuthal` and the same angular part, rad^2 for D / r0 = 1. At most one may be piston, whose own
/// variance is infinite.
pub fn covariance(n: usize, n_other: usize, azimuthal: usize) -> f64 {
    let sign = if ((n + n_other) / 2 - azimuthal).is_multiple_of(2) { 1.0 } else { -1.0 };
    let (n, n_other) = (n as f64, n_other as f64);
    let (sum, difference) = (n + n_other, n - n_other);
    let gamma = |x: f64| tgamma(0.5 * x);
    let integral = 2f64.powf(-14.0 / 3.0) * tgamma(14.0 / 3.0) * gamma(sum - 5.0 / 3.0)
        / (gamma(17.0 / 3.0 + difference) * gamma(17.0 / 3.0 - difference))
        / gamma(sum + 23.0 / 3.0);
    2.0 * spectrum() * sign * ((n + 1.0) * (n_other + 1.0)).sqrt() * integral
}
