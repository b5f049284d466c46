//! The modes: gradients of x^a y^b, 2 <= a + b <= 4 (12 of them) or <= 6 (25), averaged over each subaperture,
//!
//! <d/dx x^a y^b> = [(x + d/2)^a - (x - d/2)^a] / d . [(y + d/2)^(b+1) - (y - d/2)^(b+1)] / (d (b + 1)),
//!
//! made orthonormal over the 2n slopes of a pupil, and orthogonal to uniform tip and tilt, by Gram and Schmidt's
//! procedure, every step done twice: inner products are within 1e-14 of 0 and 1.

use crate::error::{Error, refuse};
use crate::pupil::Pupil;
use nalgebra::{DMatrix, DVector};

/// What is left of a mode's norm once all before it are taken off, at which it is none of its own.
const DEPENDENT: f64 = 1e-6;

/// Orthonormal modes of slopes.
#[derive(Clone, Debug)]
pub struct Modes {
    /// A column is a mode; rows are x and y slope of the first subaperture, of the second, and so on.
    matrix: DMatrix<f64>,
}

impl Modes {
    /// Numbers of modes on offer.
    pub const COUNTS: [usize; 3] = [0, 12, 25];

    /// The `count` modes of lowest degree on `pupil`.
    ///
    /// # Errors
    /// [`Error::Config`] for a number that is not on offer, or more than the subapertures tell apart.
    pub fn new(pupil: &Pupil, count: usize) -> Result<Self, Error> {
        let degree = match count {
            0 => 0,
            12 => 4,
            25 => 6,
            _ => return Err(refuse("second_gate.modes", count, "0, 12 or 25")),
        };
        let slopes = 2 * pupil.subapertures().len();
        let uniform = [0, 1]
            .map(|axis| DVector::from_fn(slopes, |row, _| if row % 2 == axis { 1.0 } else { 0.0 }));
        let mut basis: Vec<DVector<f64>> = uniform.map(|tilt| tilt.normalize()).into();
        for total in 2..=degree {
            for b in 0..=total {
                let gradient = gradient(pupil, total - b, b);
                let mut mode = gradient.normalize();
                for _ in 0..2 {
                    for known in &basis {
                        let along = known.dot(&mode);
                        mode.axpy(-along, known, 1.0);
                    }
                }
                if mode.norm() < DEPENDENT {
                    let limit = format!("fewer: {} slopes do not tell them apart", slopes);
                    return Err(refuse("second_gate.modes", count, &limit));
                }
                basis.push(mode.normalize());
            }
        }
        let matrix = match &basis[2..] {
            [] => DMatrix::zeros(slopes, 0),
            modes => DMatrix::from_columns(modes),
        };
        Ok(Self { matrix })
    }

    /// M, how many there are.
    pub fn count(&self) -> usize {
        self.matrix.ncols()
    }

    /// q, 2n x M: a column is a mode; rows are x and y slope of the first subaperture, of the second, and so on.
    pub fn matrix(&self) -> &DMatrix<f64> {
        &self.matrix
    }

    /// Mode after mode, x and y slope of each subaperture in the order of [`Pupil::subapertures`].
    pub fn mode_major(&self) -> Vec<[f64; 2]> {
        self.matrix.as_slice().as_chunks().0.to_vec()
    }
}

/// The gradient of x^a y^b, x and y in units of half the grid's side.
fn gradient(pupil: &Pupil, a: i32, b: i32) -> DVector<f64> {
    let half = 1.0 / pupil.across() as f64;
    let centre = |index: usize| 2.0 * half * (index as f64 + 0.5) - 1.0;
    let rise =
        |x: f64, power: i32| ((x + half).powi(power) - (x - half).powi(power)) / (2.0 * half);
    let mean = |x: f64, power: i32| rise(x, power + 1) / f64::from(power + 1);
    let slopes = pupil.subapertures().iter().flat_map(|cell| {
        let [x, y] = cell.map(centre);
        [rise(x, a) * mean(y, b), mean(x, a) * rise(y, b)]
    });
    DVector::from_iterator(2 * pupil.subapertures().len(), slopes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orthonormal_and_without_tilt() {
        for (across, count) in [(8, 12), (8, 25), (16, 25), (5, 12)] {
            let pupil = Pupil::circular(across, 2, 0.5).unwrap();
            let modes = Modes::new(&pupil, count).unwrap();
            assert_eq!(modes.count(), count);
            let error = modes.matrix().tr_mul(modes.matrix()) - DMatrix::identity(count, count);
            assert!(error.amax() < 1e-14, "{across}, {count}: {}", error.amax());
            for (mode, slopes) in modes.matrix().column_iter().enumerate() {
                for axis in 0..2 {
                    let sum: f64 = slopes.iter().skip(axis).step_by(2).sum();
                    assert!(sum.abs() < 1e-13, "{across}, mode {mode}: {sum}");
                }
            }
        }
    }

    /// x^2 has the gradient (2x, 0), x y (y, x): on a square pupil they are orthogonal as they are.
    #[test]
    fn the_first_are_focus_and_astigmatism() {
        let pupil = Pupil::square(4, 2, 1.0).unwrap();
        let modes = Modes::new(&pupil, 12).unwrap().mode_major();
        // Sum of x^2 over the 16 centres +-1/2, +-3/2: 16 x 1.25 = 20.
        for (subaperture, cell) in pupil.subapertures().iter().enumerate() {
            let [x, y] = cell.map(|index| pupil.centre_m(index));
            let (along_x, across) = (modes[subaperture], modes[16 + subaperture]);
            assert!((along_x[0] - x / 20f64.sqrt()).abs() < 1e-14 && along_x[1].abs() < 1e-14);
            for (found, expected) in across.iter().zip([y, x]) {
                assert!((found - expected / 40f64.sqrt()).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn more_than_slopes_tell_apart_is_refused() {
        let pupil = Pupil::circular(4, 2, 0.5).unwrap();
        let error = Modes::new(&pupil, 25).unwrap_err().to_string();
        assert_eq!(
            error,
            "second_gate.modes = 25: must be fewer: 24 slopes do not tell them apart"
        );
        let error = Modes::new(&pupil, 7).unwrap_err().to_string();
        assert_eq!(error, "second_gate.modes = 7: must be 0, 12 or 25");
    }
}
