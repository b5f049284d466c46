//! The covariance of a Zernike coefficient with the phase at a point,
//!
//! c_j(x) = <a_j phi(x)> = Theta_j(theta) f_nm(r),  Theta = {1, sqrt(2) cos(m theta), sqrt(2) sin(m theta)}
//! f_nm(r) = (A / pi) sqrt(n + 1) (-1)^((n - m) / 2) int_0^inf k^(-11/3) J_(n+1)(k) J_m(k r) dk.
//!
//! Inside the disk it is a sum over Zernike polynomials of the same m and part,
//!
//! c_j(x) = sum_k <a_j a_k> Z_k(x),
//!
//! whose terms fall with the -8.3th power of the order: what is beyond 60 more orders than the highest
//! is below 1e-9 of the coefficient's variance.
//! Outside, where corners of subapertures lie, the integral (Weber, Schafheitlin) is
//!
//! Gamma(a) / [2^(11/3) (n + 1)! Gamma((m - n + 11/3) / 2)] r^(5/3 - n) 2F1(a, b; n + 2; 1 / r^2),
//! a = (n + m - 5/3) / 2,  b = (n - m - 5/3) / 2.
//!
//! Both are right up to a constant that no gradient sees: the sums leave nothing out, piston
//! included, whose covariance with the others is finite.

use super::kolmogorov::spectrum;
use super::noll;
use super::zernike::{Mode, angular, modes, powers, radial};
use libm::tgamma;
use nalgebra::DMatrix;

/// Radial orders in the sums inside the disk beyond the highest coefficient's.
const BEYOND: usize = 60;
/// The series outside ends where a term is this small a part of the sum: falling as k^(-14/3) at
/// r = 1 and faster beyond, all that follow are 2e-11 of it.
const NEGLIGIBLE: f64 = 1e-13;

/// c_j(x) for all coefficients from j = 2 through some radial order.
#[derive(Clone, Debug)]
pub struct PhaseCovariance {
    max_order: usize,
    modes: Vec<Mode>,
    /// For each m: <a_n a_n'>, n along the rows and n' along the columns, both from m in steps of 2.
    spectra: Vec<DMatrix<f64>>,
    spectrum: f64,
}

impl PhaseCovariance {
    /// Those of the coefficients of [`modes`] through `max_order`, at most 100.
    pub fn new(max_order: usize) -> Self {
        Self::with_terms(max_order, BEYOND)
    }

    /// With another number of orders in the sums: how their error is measured.
    pub fn with_terms(max_order: usize, beyond: usize) -> Self {
        let spectra = (0..=max_order).map(|m| {
            // Piston's variance does not exist; its row, that of a_1, is never read.
            let first = usize::from(m == 0);
            let rows = (max_order - m) / 2 + 1;
            let columns = (max_order + beyond - m) / 2 + 1;
            DMatrix::from_fn(rows, columns, |row, column| {
                if row < first { 0.0 } else { noll::covariance(m + 2 * row, m + 2 * column, m) }
            })
        });
        let spectra = spectra.collect();
        Self { max_order, modes: modes(max_order), spectra, spectrum: spectrum() }
    }

    /// What the coefficients belong to, in Noll's order from j = 2.
    pub fn modes(&self) -> &[Mode] {
        &self.modes
    }

    /// c_j at `point` (in units of the pupil's radius), rad^2 for D / r0 = 1.
    pub fn values(&self, point: [f64; 2], out: &mut [f64]) {
        let r2 = point[0] * point[0] + point[1] * point[1];
        if r2 <= 1.0 { self.inside(point, r2, out) } else { self.outside(point, r2, out) }
    }

    fn inside(&self, point: [f64; 2], r2: f64, out: &mut [f64]) {
        let powers = powers(point, self.max_order + 1);
        let sums: Vec<_> = self
            .spectra
            .iter()
            .enumerate()
            .map(|(m, spectrum)| {
                let mut polynomials = nalgebra::DVector::zeros(spectrum.ncols());
                radial(m, r2, polynomials.as_mut_slice());
                spectrum * polynomials
            })
            .collect();
        for (mode, out) in self.modes.iter().zip(out) {
            let Mode { radial, azimuthal: m, part } = *mode;
            *out = sums[m][(radial - m) / 2] * angular(part, powers[m]);
        }
    }

    fn outside(&self, point: [f64; 2], r2: f64, out: &mut [f64]) {
        let r = r2.sqrt();
        let powers = powers(point.map(|coordinate| coordinate / r), self.max_order + 1);
        // A mode and its partner of the other part differ in the angle only.
        let mut last = (0, 0, 0.0);
        for (mode, out) in self.modes.iter().zip(out) {
            let Mode { radial, azimuthal: m, part } = *mode;
            if (radial, m) != (last.0, last.1) {
                last = (radial, m, self.spectrum * tail(radial, m, r));
            }
            *out = last.2 * angular(part, powers[m]);
        }
    }
}

/// sqrt(n + 1) (-1)^((n - m) / 2) times the integral, for r > 1.
fn tail(n: usize, m: usize, r: f64) -> f64 {
    let sign = if ((n - m) / 2).is_multiple_of(2) { 1.0 } else { -1.0 };
    let (n, m) = (n as f64, m as f64);
    let (a, b, c) = (0.5 * (n + m - 5.0 / 3.0), 0.5 * (n - m - 5.0 / 3.0), n + 2.0);
    let z = 1.0 / (r * r);
    let (mut sum, mut term, mut k) = (1.0, 1.0, 0.0);
    while f64::abs(term) > NEGLIGIBLE * f64::abs(sum) {
        term *= (a + k) * (b + k) / ((c + k) * (k + 1.0)) * z;
        sum += term;
        k += 1.0;
    }
    let gammas = tgamma(a) / (tgamma(n + 2.0) * tgamma(0.5 * (m - n + 11.0 / 3.0)));
    sign * (n + 1.0).sqrt() * 2f64.powf(-11.0 / 3.0) * gammas * r.powf(5.0 / 3.0 - n) * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The two forms are of one function: it and its gradient pass through the edge of the disk.
    #[test]
    fn inside_and_outside_meet() {
        for order in [4, 13, 31] {
            let covariance = PhaseCovariance::new(order);
            let count = covariance.modes().len();
            let (cos, sin) = (0.8, 0.6);
            let at = |r: f64, inside: bool| {
                let mut values = vec![0.0; count];
                let point = [r * cos, r * sin];
                let of = if inside { PhaseCovariance::inside } else { PhaseCovariance::outside };
                of(&covariance, point, r * r, &mut values);
                values
            };
            let largest = at(1.0, true).into_iter().map(f64::abs).fold(0.0, f64::max);
            let (inner, outer) = (at(1.0, true), at(1.0 + 1e-9, false));
            for (j, (inner, outer)) in inner.iter().zip(&outer).enumerate() {
                assert!((inner - outer).abs() < 5e-9 * largest, "j = {}: {inner} {outer}", j + 2);
            }
        }
    }
}
