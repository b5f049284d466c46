//! The modal reconstructor: gradients to Zernike coefficients by least squares,
//!
//! b = D^-1 g,  D_ij = mean over square i of the gradient of Z_j,
//!
//! in rad per pupil radius. Z_2 and Z_3 are fitted with the rest. `nominal` takes the mean over the
//! subapertures (D); `matched` takes it over the smaller squares that SPLASH's beams cover at a layer
//! (D'), so that it knows which part of the wavefront was measured. With several layers of weights
//! w_k, the gradients to expect from given coefficients are sum_k w_k D'_k a, and that is inverted.
//! The lever arm is in neither of them.

use super::legendre::GaussLegendre;
use super::mean_gradient::mean_gradients;
use super::squares::Squares;
use super::zernike::Zernikes;
use nalgebra::DMatrix;

/// A mode must stand out of those before it by more than this part of its length, or it counts as
/// unseen: least squares multiplies errors by up to the inverse. Subapertures in a circle show all
/// modes through order N, up to N = 29, and not all of order N + 1, some of which leave 1e-15.
pub const INDEPENDENT: f64 = 1e-3;

/// A pupil does not show all modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("radial orders up to {highest} can be told apart")]
pub struct Degenerate {
    /// The highest radial order of which all modes can be told apart.
    pub highest: usize,
}

/// Mean gradients of the modes through `max_order` over weighted sets of squares; the weights' sum
/// is 1.
pub fn gradients(footprints: &[(f64, Squares)], max_order: usize) -> DMatrix<f64> {
    let zernikes = Zernikes::new(max_order);
    // Exact up to degree 2 points - 1.
    let rule = GaussLegendre::new(max_order / 2 + 1);
    let one = |(weight, squares): &(f64, Squares)| {
        let count = zernikes.modes().len();
        *weight * mean_gradients(squares, count, &rule, |point, out| zernikes.values(point, out))
    };
    let first = one(&footprints[0]);
    footprints[1..].iter().fold(first, |sum, footprint| sum + one(footprint))
}

/// The least-squares inverse of `gradients`, modes by gradients.
///
/// # Errors
/// [`Degenerate`] if modes cannot be told apart, or are more than the gradients.
pub fn invert(gradients: &DMatrix<f64>, max_order: usize) -> Result<DMatrix<f64>, Degenerate> {
    let (rows, columns) = gradients.shape();
    let seen = columns.min(rows);
    let qr = gradients.columns(0, seen).into_owned().qr();
    let r = qr.r();
    let hidden = (0..seen).find(|&j| r[(j, j)].abs() <= INDEPENDENT * gradients.column(j).norm());
    match hidden.or((seen < columns).then_some(seen)) {
        None => {
            Ok(r.solve_upper_triangular(&qr.q().transpose()).expect("the diagonal has no zeros"))
        }
        Some(mode) => {
            // Mode 0 is j = 2: orders up to n have n (n + 3) / 2 modes.
            let complete = |order: &usize| order * (order + 3) / 2 <= mode;
            let highest = (1..=max_order).take_while(complete).last().unwrap_or(0);
            Err(Degenerate { highest })
        }
    }
}
