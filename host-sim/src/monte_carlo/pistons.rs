//! Pistons from tips and tilts by exact least squares.
//!
//! Where two segments meet, their edges should: p_j - p_i = t_i + t_j across each of their common edges,
//! with t the phase from centre to edge along the line between them (Southwell's geometry). The normal
//! equations are those of the grid's Laplacian, L p = b; conjugate gradients solve them, from the last
//! solution on, until the residual is 1e-9 of b. It is what the firmware's relaxation converges to. Parts of a
//! pupil that no edge connects keep a mean of zero each.

use crate::pupil::Pupil;

/// |r| / |b| at which the solution is taken.
const TOLERANCE: f64 = 1e-9;

/// The edges of a pupil, and the last solution.
#[derive(Clone, Debug)]
pub struct Pistons {
    /// First segment, second segment, axis from the first to the second.
    edges: Vec<(usize, usize, usize)>,
    pistons: Vec<f64>,
}

impl Pistons {
    /// All zero, for the segments of `pupil`.
    pub fn new(pupil: &Pupil) -> Self {
        let subapertures = pupil.subapertures();
        let find = |cell: [usize; 2]| subapertures.iter().position(|&other| other == cell);
        let mut edges = Vec::new();
        for (i, &[ix, iy]) in subapertures.iter().enumerate() {
            for (axis, neighbour) in [[ix + 1, iy], [ix, iy + 1]].into_iter().enumerate() {
                if pupil.contains(neighbour[0], neighbour[1]) {
                    edges.extend(find(neighbour).map(|j| (i, j, axis)));
                }
            }
        }
        Self { edges, pistons: vec![0.0; subapertures.len()] }
    }

    /// The pistons that fit these centre-to-edge tips and tilts best, in their unit.
    ///
    /// # Panics
    /// If there is not one tip and tilt per segment.
    pub fn solve(&mut self, tilts: &[[f64; 2]]) -> &[f64] {
        assert_eq!(tilts.len(), self.pistons.len(), "tips and tilts");
        let mut residual = vec![0.0; tilts.len()];
        for &(i, j, axis) in &self.edges {
            let step = tilts[i][axis] + tilts[j][axis];
            residual[i] -= step;
            residual[j] += step;
        }
        let enough = TOLERANCE * TOLERANCE * dot(&residual, &residual);
        for (residual, applied) in residual.iter_mut().zip(self.laplacian(&self.pistons)) {
            *residual -= applied;
        }
        let mut direction = residual.clone();
        let mut square = dot(&residual, &residual);
        // In exact arithmetic there are never more steps than segments.
        for _ in 0..2 * tilts.len() {
            if square <= enough {
                break;
            }
            let applied = self.laplacian(&direction);
            let step = square / dot(&direction, &applied);
            for (k, applied) in applied.iter().enumerate() {
                self.pistons[k] += step * direction[k];
                residual[k] -= step * applied;
            }
            let next = dot(&residual, &residual);
            for (direction, residual) in direction.iter_mut().zip(&residual) {
                *direction = residual + next / square * *direction;
            }
            square = next;
        }
        &self.pistons
    }

    /// L p: over each segment's edges, the sum of how much higher it is than its neighbour.
    fn laplacian(&self, pistons: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; pistons.len()];
        for &(i, j, _) in &self.edges {
            let step = pistons[j] - pistons[i];
            out[i] -= step;
            out[j] += step;
        }
        out
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
