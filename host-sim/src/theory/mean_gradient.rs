//! Gradients averaged over squares, from values on their edges:
//!
//! (1 / A) int int df/dx dx dy = [mean of f over the right edge - mean over the left] / side.
//!
//! Gauss-Legendre quadrature along the edges is exact for polynomials. Covariances with Zernike
//! coefficients are analytic on both sides of the unit circle and lose some derivative there, so
//! an edge that crosses it is integrated in parts: 12 points on each part leave less than 1e-9 of the
//! coefficient's variance.

use super::legendre::GaussLegendre;
use super::squares::Squares;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// The mean gradients of `functions` functions over all squares. `values` gives all functions at a
/// point. A column is a function; rows are the x and y gradient over the first square, over the
/// second, and so on.
pub fn mean_gradients(
    squares: &Squares,
    functions: usize,
    rule: &GaussLegendre,
    values: impl Fn([f64; 2], &mut [f64]) + Sync,
) -> DMatrix<f64> {
    let half = 0.5 * squares.side();
    let of_square = |index: usize| {
        let [x, y] = squares.centre(index);
        let mut at_point = vec![0.0; functions];
        // The mean over the edge from one corner to another is added `factor` times.
        let mut add = |from: [f64; 2], to: [f64; 2], factor: f64, sum: &mut [f64]| {
            let along = |t: f64| [0, 1].map(|axis| from[axis] + t * (to[axis] - from[axis]));
            let parts = parts(from, to);
            for part in parts.windows(2) {
                let length = part[1] - part[0];
                for &(t, weight) in rule.nodes() {
                    values(along(part[0] + t * length), &mut at_point);
                    for (sum, value) in sum.iter_mut().zip(&at_point) {
                        *sum += factor * length * weight * value;
                    }
                }
            }
        };
        let (mut along_x, mut along_y) = (vec![0.0; functions], vec![0.0; functions]);
        for sign in [-1.0, 1.0] {
            let factor = sign / squares.side();
            let (x_edge, y_edge) = (x + sign * half, y + sign * half);
            add([x_edge, y - half], [x_edge, y + half], factor, &mut along_x);
            add([x - half, y_edge], [x + half, y_edge], factor, &mut along_y);
        }
        [along_x, along_y]
    };
    let rows: Vec<_> = (0..squares.count()).into_par_iter().map(of_square).collect();
    DMatrix::from_fn(2 * squares.count(), functions, |row, j| rows[row / 2][row % 2][j])
}

/// Where a segment has to be cut at the unit circle: fractions of its length, from 0 to 1.
fn parts(from: [f64; 2], to: [f64; 2]) -> Vec<f64> {
    let step = [to[0] - from[0], to[1] - from[1]];
    // |from + t step|^2 = 1.
    let a = step[0] * step[0] + step[1] * step[1];
    let b = from[0] * step[0] + from[1] * step[1];
    let c = from[0] * from[0] + from[1] * from[1] - 1.0;
    let root = (b * b - a * c).max(0.0).sqrt();
    let crossings = [(-b - root) / a, (-b + root) / a];
    let within = crossings.into_iter().filter(|&t| 0.0 < t && t < 1.0);
    std::iter::once(0.0).chain(within).chain([1.0]).collect()
}
