//! Pistons by exact least squares, and the numbers of the graph that they live on.

use std::collections::HashMap;

use splash_firmware::geometry::Mask;

/// The subapertures of a mask and the edges between neighbours.
#[derive(Clone, Debug)]
pub struct Pupil {
    /// First, second subaperture, and the axis from the first to the second (0 is x, 1 is y).
    edges: Vec<(usize, usize, usize)>,
    neighbours: Vec<Vec<usize>>,
    /// Connected component of each subaperture.
    component: Vec<usize>,
    /// Size of each component.
    sizes: Vec<usize>,
}

impl Pupil {
    /// Those of `mask`, in row-major order.
    pub fn new(mask: &Mask) -> Self {
        let cells: Vec<_> = mask.cells().collect();
        let index: HashMap<_, _> = cells.iter().enumerate().map(|(i, &cell)| (cell, i)).collect();
        let mut edges = Vec::new();
        let mut neighbours = vec![Vec::new(); cells.len()];
        for (i, &(x, y)) in cells.iter().enumerate() {
            for (axis, beside) in [(x + 1, y), (x, y + 1)].into_iter().enumerate() {
                if let Some(&j) = index.get(&beside) {
                    edges.push((i, j, axis));
                    neighbours[i].push(j);
                    neighbours[j].push(i);
                }
            }
        }
        let mut component = vec![usize::MAX; cells.len()];
        let mut sizes = Vec::new();
        for first in 0..cells.len() {
            if component[first] != usize::MAX {
                continue;
            }
            let mut open = vec![first];
            let mut size = 0;
            component[first] = sizes.len();
            while let Some(i) = open.pop() {
                size += 1;
                for &j in &neighbours[i] {
                    if component[j] == usize::MAX {
                        component[j] = sizes.len();
                        open.push(j);
                    }
                }
            }
            sizes.push(size);
        }
        Self { edges, neighbours, component, sizes }
    }

    /// The number of subapertures.
    pub fn count(&self) -> usize {
        self.component.len()
    }

    /// The number of connected components.
    pub fn components(&self) -> usize {
        self.sizes.len()
    }

    /// The subapertures beside `i`.
    pub fn neighbours(&self, i: usize) -> &[usize] {
        &self.neighbours[i]
    }

    /// The normal equations' right-hand side for tilts given from centre to edge: the path
    /// difference between neighbours i and j is that of the two halves, t_i + t_j.
    pub fn divergence(&self, tilts: &[[f64; 2]]) -> Vec<f64> {
        let mut rhs = vec![0.0; self.count()];
        for &(i, j, axis) in &self.edges {
            let rise = tilts[i][axis] + tilts[j][axis];
            rhs[j] += rise;
            rhs[i] -= rise;
        }
        rhs
    }

    /// The graph Laplacian: sum over the neighbours of p_i - p_j.
    pub fn laplacian(&self, pistons: &[f64]) -> Vec<f64> {
        let at = |(p, beside): (&f64, &Vec<usize>)| beside.iter().map(|&j| p - pistons[j]).sum();
        pistons.iter().zip(&self.neighbours).map(at).collect()
    }

    /// Takes the mean off each component.
    pub fn remove_means(&self, values: &mut [f64]) {
        let mut means = vec![0.0; self.components()];
        for (value, &c) in values.iter().zip(&self.component) {
            means[c] += value / self.sizes[c] as f64;
        }
        for (value, &c) in values.iter_mut().zip(&self.component) {
            *value -= means[c];
        }
    }

    /// The solution of L p = rhs with zero mean on each component, by conjugate gradients to a
    /// residual of 1e-13 of the right-hand side.
    ///
    /// # Panics
    /// If it does not converge.
    pub fn solve(&self, rhs: &[f64]) -> Vec<f64> {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut r = rhs.to_vec();
        self.remove_means(&mut r);
        let mut solution = vec![0.0; r.len()];
        let goal = 1e-26 * dot(&r, &r);
        let mut direction = r.clone();
        let mut size = dot(&r, &r);
        for _ in 0..20 * (self.count() + 10) {
            if size <= goal {
                self.remove_means(&mut solution);
                return solution;
            }
            let image = self.laplacian(&direction);
            let step = size / dot(&direction, &image);
            solution.iter_mut().zip(&direction).for_each(|(s, d)| *s += step * d);
            r.iter_mut().zip(&image).for_each(|(r, i)| *r -= step * i);
            let next = dot(&r, &r);
            direction.iter_mut().zip(&r).for_each(|(d, r)| *d = r + next / size * *d);
            size = next;
        }
        panic!("conjugate gradients left {size:e} of {goal:e}");
    }

    /// The pistons that fit the tilts' path differences best, of zero mean on each component.
    pub fn least_squares(&self, tilts: &[[f64; 2]]) -> Vec<f64> {
        self.solve(&self.divergence(tilts))
    }

    /// Piston variance per slope variance for white slope noise at unit pitch.
    ///
    /// A slope of one is one unit of path over a pitch: half of it from centre to edge.
    pub fn noise_gain(&self) -> f64 {
        let mut tilts = vec![[0.0; 2]; self.count()];
        let mut trace = 0.0;
        for i in 0..self.count() {
            for axis in 0..2 {
                tilts[i][axis] = 0.5;
                trace += self.least_squares(&tilts).iter().map(|p| p * p).sum::<f64>();
                tilts[i][axis] = 0.0;
            }
        }
        trace / self.count() as f64
    }

    /// mu: the largest second singular value, over the components, of the red-black block of
    /// D^-1/2 A D^-1/2.
    ///
    /// That matrix has the block's singular values with both signs as its eigenvalues, and the
    /// component's first is 1.
    pub fn second_singular_value(&self) -> f64 {
        let second = |c: usize| {
            let members: Vec<usize> =
                (0..self.count()).filter(|&i| self.component[i] == c).collect();
            let root = |i: usize| f64::sqrt(self.neighbours[i].len() as f64);
            let entry = |i: usize, j: usize| match self.neighbours[i].contains(&j) {
                true => 1.0 / (root(i) * root(j)),
                false => 0.0,
            };
            let row = |&i: &usize| members.iter().map(|&j| entry(i, j)).collect();
            let mut values = symmetric_eigenvalues(members.iter().map(row).collect());
            values.sort_by(|a, b| b.total_cmp(a));
            values.get(1).map_or(0.0, |&v| f64::max(v, 0.0))
        };
        (0..self.components()).map(second).fold(0.0, f64::max)
    }

    /// The relaxation factor that is best for this pupil: 2 / (1 + sqrt(1 - mu^2)).
    pub fn relaxation_factor(&self) -> f64 {
        let mu = self.second_singular_value();
        2.0 / (1.0 + f64::sqrt(1.0 - mu * mu))
    }
}

/// Eigenvalues of a symmetric matrix by Jacobi's rotations, to 1e-14 of its norm.
///
/// # Panics
/// If 60 sweeps do not suffice.
pub fn symmetric_eigenvalues(mut a: Vec<Vec<f64>>) -> Vec<f64> {
    let n = a.len();
    let norm: f64 = a.iter().flatten().map(|v| v * v).sum();
    for _ in 0..60 {
        let off: f64 = (0..n)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| a[i][j])
            .fold(0.0, |s, v| s + v * v);
        if off <= 1e-28 * norm {
            return (0..n).map(|i| a[i][i]).collect();
        }
        for p in 0..n {
            for q in p + 1..n {
                if a[p][q].abs() < 1e-300 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = f64::copysign(1.0, theta) / (theta.abs() + f64::hypot(theta, 1.0));
                let c = 1.0 / f64::hypot(t, 1.0);
                let s = t * c;
                let (head, tail) = a.split_at_mut(q);
                for (x, y) in head[p].iter_mut().zip(&mut tail[0]) {
                    (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
                }
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
            }
        }
    }
    panic!("Jacobi's rotations do not converge");
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The path graph of n nodes has the walk eigenvalues cos(pi k / (n - 1)), k = 0 .. n - 1.
    #[test]
    fn eigenvalues_of_a_row_are_cosines() {
        let row = Mask::square(9).expect("a mask").without(|_, y| y != 4);
        let mu = Pupil::new(&row).second_singular_value();
        assert!((mu - f64::cos(std::f64::consts::PI / 8.0)).abs() < 1e-12, "{mu}");
    }

    #[test]
    fn least_squares_returns_the_plane_of_its_tilts() {
        let mask = Mask::annulus(10, 0.3).expect("a mask");
        let pupil = Pupil::new(&mask);
        let pistons = pupil.least_squares(&vec![[1.5, -0.5]; mask.count()]);
        let mut plane: Vec<f64> = mask.cells().map(|(x, y)| 3.0 * x as f64 - y as f64).collect();
        pupil.remove_means(&mut plane);
        for (p, plane) in pistons.iter().zip(&plane) {
            assert!((p - plane).abs() < 1e-10);
        }
    }
}
