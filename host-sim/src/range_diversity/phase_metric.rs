//! The mean square over the pupil of a phase that is a plane on each segment.
//!
//! With pistons p and tips and tilts e, rad from centre to edge, less the least-squares plane over the pupil, it is
//!
//! (1/n) sum_i (p_i^2 + |e_i|^2 / 3) - v^T V^-1 v,
//!
//! where v are the means of the phase times 1, x and y and V those of their products. It is a quadratic form: a product
//! of two phases goes with it. The mirror's pistons follow from its tips and tilts by least squares, p = R e; those of
//! the best fit to the star's phase are its own.

use crate::monte_carlo::pistons::Pistons;
use crate::pupil::Pupil;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// The quadratic form of a pupil.
#[derive(Clone, Debug)]
pub struct PhaseMetric {
    /// R, n x 2n.
    pistons: DMatrix<f64>,
    /// 1, x and y at the segments' centres, n x 3, in units of half the grid's side.
    plane: DMatrix<f64>,
    /// V^-1.
    inverse: Matrix3<f64>,
    across: f64,
}

/// Tips and tilts, pistons and the means with 1, x and y, one phase in each column.
#[derive(Clone, Debug)]
pub struct Shapes {
    tilts: DMatrix<f64>,
    pistons: DMatrix<f64>,
    moments: DMatrix<f64>,
}

impl Shapes {
    /// Sums of the columns with `factors`, one sum a column of those.
    ///
    /// # Panics
    /// If there is not one row of factors for each column.
    #[must_use]
    pub fn combined(&self, factors: &DMatrix<f64>) -> Self {
        Self {
            tilts: &self.tilts * factors,
            pistons: &self.pistons * factors,
            moments: &self.moments * factors,
        }
    }

    /// These less others, column by column.
    ///
    /// # Panics
    /// If there are not as many.
    #[must_use]
    pub fn less(mut self, other: &Self) -> Self {
        self.tilts -= &other.tilts;
        self.pistons -= &other.pistons;
        self.moments -= &other.moments;
        self
    }
}

impl PhaseMetric {
    /// That of `pupil`.
    pub fn new(pupil: &Pupil) -> Self {
        let cells = pupil.subapertures();
        let (count, across) = (cells.len(), pupil.across() as f64);
        let mut solver = Pistons::new(pupil);
        let mut pistons = DMatrix::zeros(count, 2 * count);
        let mut unit = vec![[0.0; 2]; count];
        for (slope, mut column) in pistons.column_iter_mut().enumerate() {
            unit[slope / 2][slope % 2] = 1.0;
            column.copy_from_slice(solver.solve(&unit));
            unit[slope / 2][slope % 2] = 0.0;
        }
        let centre = |index: usize| (2.0 * index as f64 + 1.0) / across - 1.0;
        let plane = DMatrix::from_fn(count, 3, |segment, term| match term {
            0 => 1.0,
            axis => centre(cells[segment][axis - 1]),
        });
        // Within a segment, whose half is 1/N: <x^2> = x_i^2 + 1 / (3 N^2).
        let mut normal = plane.tr_mul(&plane).fixed_view::<3, 3>(0, 0) / count as f64;
        for axis in 1..3 {
            normal[(axis, axis)] += 1.0 / (3.0 * across * across);
        }
        let inverse = normal.pseudo_inverse(1e-12).unwrap_or_else(|_| Matrix3::zeros());
        Self { pistons, plane, inverse, across }
    }

    /// The mirror with these tips and tilts, one set in each column, tip and tilt of the first segment, of the second,
    /// and so on.
    ///
    /// # Panics
    /// If there are not two for each segment.
    pub fn mirror(&self, tilts: DMatrix<f64>) -> Shapes {
        let pistons = &self.pistons * &tilts;
        self.shapes(tilts, pistons)
    }

    /// Tips and tilts with pistons that are given.
    ///
    /// # Panics
    /// If there are not two and one for each segment.
    pub fn shapes(&self, tilts: DMatrix<f64>, pistons: DMatrix<f64>) -> Shapes {
        let count = self.plane.nrows() as f64;
        let mut moments = self.plane.tr_mul(&pistons) / count;
        // <(x - x_i)^2> = 1 / (3 N^2), and a tip of e rises by e from there to 1/N.
        for (column, tilts) in tilts.column_iter().enumerate() {
            for axis in 0..2 {
                let sum: f64 = tilts.iter().skip(axis).step_by(2).sum();
                moments[(1 + axis, column)] += sum / count / (3.0 * self.across);
            }
        }
        Shapes { tilts, pistons, moments }
    }

    /// The means over the pupil of the products of phases, each with each.
    pub fn gram(&self, phases: &Shapes) -> DMatrix<f64> {
        let Shapes { tilts, pistons, moments } = phases;
        let whole = pistons.tr_mul(pistons) + tilts.tr_mul(tilts) / 3.0;
        whole / self.plane.nrows() as f64 - moments.tr_mul(&(self.inverse * moments))
    }

    /// The mean over the pupil of the products of two sets of phases, rad^2, summed over the columns.
    pub fn inner(&self, a: &Shapes, b: &Shapes) -> f64 {
        let count = self.plane.nrows() as f64;
        let planes = a.moments.column_iter().zip(b.moments.column_iter()).map(|(a, b)| {
            let [a, b] = [a, b].map(|v| Vector3::new(v[0], v[1], v[2]));
            a.dot(&(self.inverse * b))
        });
        let whole = a.pistons.dot(&b.pistons) + a.tilts.dot(&b.tilts) / 3.0;
        whole / count - planes.sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane leaves nothing; a parabola of segments, p = x^2 and e = 2 x d/2, leaves what is computed sample by
    /// sample.
    #[test]
    fn planes_are_nothing_and_parabolas_are_what_they_are() {
        let pupil = Pupil::square(6, 2, 1.0).unwrap();
        let metric = PhaseMetric::new(&pupil);
        let half = 1.0 / 6.0;
        let centre = |index: usize| (2.0 * index as f64 + 1.0) / 6.0 - 1.0;
        let tilts = |tip: &dyn Fn(f64) -> f64| {
            DMatrix::from_fn(72, 1, |row, _| match row % 2 {
                0 => tip(centre(pupil.subapertures()[row / 2][0])),
                _ => 0.0,
            })
        };
        let flat = metric.mirror(tilts(&|_| 0.3));
        assert!(metric.inner(&flat, &flat).abs() < 1e-12);
        let bowl = metric.mirror(tilts(&|x| 2.0 * x * half));
        // Pistons x_i^2 fit their edges exactly. Along x, with fine steps: variance of x_i^2 + 2 x_i (x - x_i).
        let phase = |x: f64| {
            let nearest = centre((((x + 1.0) * 3.0) as usize).min(5));
            nearest * nearest + 2.0 * nearest * (x - nearest)
        };
        let points = 60_000;
        let at = |k: i32| phase(2.0 * (f64::from(k) + 0.5) / f64::from(points) - 1.0);
        let mean = (0..points).map(at).sum::<f64>() / f64::from(points);
        let square = (0..points).map(|k| (at(k) - mean).powi(2)).sum::<f64>() / f64::from(points);
        let found = metric.inner(&bowl, &bowl);
        assert!((found / square - 1.0).abs() < 1e-6, "{found}, not {square}");
    }
}
