//! Zernike polynomials in the order and normalisation of Noll (1976):
//!
//! Z_j(r, theta) = sqrt(n + 1) R_n^m(r) {1, sqrt(2) cos(m theta), sqrt(2) sin(m theta)},
//!
//! even j with the cosine and odd j with the sine, so that the mean of Z_j Z_k over the unit disk
//! is 1 for j = k and 0 otherwise. They are polynomials in x and y, defined outside the disk too,
//! where the corners of subapertures lie.
//!
//! R_n^m(r) = r^m P_k^(0,m)(2 r^2 - 1) with k = (n - m) / 2, and the Jacobi polynomials P come from
//! their recurrence: values on the disk are within 1e-12 up to order 40, where sums of factorials
//! would have lost everything.

/// Which part of exp(i m theta) a polynomial carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// m = 0: none.
    Round,
    /// cos(m theta).
    Cosine,
    /// sin(m theta).
    Sine,
}

/// A Zernike polynomial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mode {
    /// n, the radial order.
    pub radial: usize,
    /// m, the azimuthal order, 0 to n, of the parity of n.
    pub azimuthal: usize,
    /// The angular factor.
    pub part: Part,
}

/// The polynomials from j = 2 (piston left out) through radial order `max_order`, in Noll's order:
/// element i is j = i + 2.
pub fn modes(max_order: usize) -> Vec<Mode> {
    let mut modes = Vec::with_capacity((max_order + 1) * (max_order + 2) / 2);
    for radial in 1..=max_order {
        for azimuthal in (radial % 2..=radial).step_by(2) {
            let pair = match (azimuthal, modes.len() % 2) {
                (0, _) => &[Part::Round][..],
                (_, 0) => &[Part::Cosine, Part::Sine],
                _ => &[Part::Sine, Part::Cosine],
            };
            modes.extend(pair.iter().map(|&part| Mode { radial, azimuthal, part }));
        }
    }
    modes
}

/// sqrt(n + 1) R_n^m(r) / r^m at `r2` = r^2, for n = m, m + 2, m + 4 ...: `out.len()` of them.
pub fn radial(azimuthal: usize, r2: f64, out: &mut [f64]) {
    let m = azimuthal as f64;
    let t = 2.0 * r2 - 1.0;
    let (mut value, mut before) = (1.0, 0.0);
    for (index, out) in out.iter_mut().enumerate() {
        let k = index as f64;
        if index == 1 {
            (value, before) = (1.0 + 0.5 * (m + 2.0) * (t - 1.0), value);
        } else if index > 1 {
            let s = 2.0 * k + m;
            let next = (s - 1.0) * (s * (s - 2.0) * t - m * m) * value
                - 2.0 * (k - 1.0) * (k + m - 1.0) * s * before;
            (value, before) = (next / (2.0 * k * (k + m) * (s - 2.0)), value);
        }
        *out = (m + 2.0 * k + 1.0).sqrt() * value;
    }
}

/// The angular factors for one azimuthal order at (x + i y)^m = `power`, in the order of [`Part`].
pub(super) fn angular(part: Part, power: [f64; 2]) -> f64 {
    match part {
        Part::Round => 1.0,
        Part::Cosine => std::f64::consts::SQRT_2 * power[0],
        Part::Sine => std::f64::consts::SQRT_2 * power[1],
    }
}

/// (x + i y)^m for m = 0, 1 ... : `count` of them.
pub(super) fn powers([x, y]: [f64; 2], count: usize) -> Vec<[f64; 2]> {
    let next = |[re, im]: &[f64; 2]| Some([re * x - im * y, re * y + im * x]);
    std::iter::successors(Some([1.0, 0.0]), next).take(count).collect()
}

/// The polynomials of [`modes`] at any point of the plane.
#[derive(Clone, Debug)]
pub struct Zernikes {
    max_order: usize,
    modes: Vec<Mode>,
}

impl Zernikes {
    /// Those through radial order `max_order`.
    pub fn new(max_order: usize) -> Self {
        Self { max_order, modes: modes(max_order) }
    }

    /// What they are, in Noll's order from j = 2.
    pub fn modes(&self) -> &[Mode] {
        &self.modes
    }

    /// Their values at `point`, in units of the pupil's radius.
    pub fn values(&self, point: [f64; 2], out: &mut [f64]) {
        let [x, y] = point;
        let powers = powers(point, self.max_order + 1);
        let mut row = vec![0.0; self.max_order / 2 + 1];
        let rows: Vec<Vec<f64>> = (0..=self.max_order)
            .map(|m| {
                let row = &mut row[..(self.max_order - m) / 2 + 1];
                radial(m, x * x + y * y, row);
                row.to_vec()
            })
            .collect();
        for (mode, out) in self.modes.iter().zip(out) {
            let Mode { radial, azimuthal: m, part } = *mode;
            *out = rows[m][(radial - m) / 2] * angular(part, powers[m]);
        }
    }
}
