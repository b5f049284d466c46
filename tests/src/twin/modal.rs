//! Two gates: what their difference adds to the pseudo-open-loop slopes.

use splash_firmware::geometry::Mask;

/// Largest a, b, mode of the correction and correction: 2^30 ulp.
const MODAL_LIMIT: f64 = (1u64 << 30) as f64;
/// Largest pseudo-open-loop slope, ulp.
const OPEN_LOOP_LIMIT: f64 = (3u64 << 23) as f64;

/// Slopes of one gate; `None` where invalid.
pub type Slopes = [Option<[f64; 2]>];

/// The modes and their coupling.
#[derive(Clone, Debug)]
pub struct Modes {
    /// Mode by mode, the gradients at each subaperture.
    pub gradients: Vec<Vec<[f64; 2]>>,
    /// B, row by row.
    pub coupling: Vec<Vec<f64>>,
}

impl Modes {
    /// Those of a specification over `count` subapertures.
    pub fn new(modes: &[[f64; 2]], coupling: &[f64], count: usize) -> Self {
        let gradients: Vec<_> = modes.chunks_exact(count).map(<[_]>::to_vec).collect();
        let coupling = coupling.chunks_exact(2 * gradients.len()).map(<[_]>::to_vec).collect();
        Self { gradients, coupling }
    }

    /// q B [q^T x1; q^T x2] at each subaperture, over f; means over the valid are off. Where
    /// the second gate is invalid its difference from the first counts as the mean difference, where the first
    /// is both count as their mean.
    pub fn correction(
        &self,
        [first, second]: [&Slopes; 2],
        applied: &[[f64; 2]],
        f: f64,
    ) -> Vec<[f64; 2]> {
        let seen = first.iter().zip(applied);
        let x1 = without_mean(seen.map(|(s, applied)| (*s).map(|s| add(s, *applied))));
        let both = first.iter().zip(second);
        let d = without_mean(both.map(|(s1, s2)| Some(add((*s2)?, (*s1)?.map(|s| -s)))));
        let a: Vec<f64> = self.gradients.iter().map(|q| project(q, &x1)).collect();
        let b: Vec<f64> = self.gradients.iter().map(|q| project(q, &d)).collect();
        let modes = self.gradients.len();
        let mut correction = vec![[0.0; 2]; applied.len()];
        for (q, row) in self.gradients.iter().zip(&self.coupling) {
            // B1 q^T x1 + B2 q^T x2, with x2 = x1 + d.
            let of = |j: usize| row[j] * a[j] + row[modes + j] * (a[j] + b[j]);
            let weight = ((0..modes).map(of).sum::<f64>() / f).clamp(-MODAL_LIMIT, MODAL_LIMIT);
            for (u, q) in correction.iter_mut().zip(q) {
                *u = add(*u, q.map(|q| q * weight));
            }
        }
        let limited = |u: [f64; 2]| u.map(|u| u.clamp(-MODAL_LIMIT, MODAL_LIMIT));
        correction.into_iter().map(limited).collect()
    }

    /// The first gate's slopes with the correction, for the law of one gate with that f.
    pub fn corrected(
        &self,
        slopes: [&Slopes; 2],
        applied: &[[f64; 2]],
        f: f64,
    ) -> Vec<Option<[f64; 2]>> {
        let correction = self.correction(slopes, applied, f);
        let all = slopes[0].iter().zip(applied).zip(correction);
        all.map(|((s, applied), u)| {
            let x = add(add((*s)?, *applied), u);
            let x = x.map(|x| x.clamp(-OPEN_LOOP_LIMIT, OPEN_LOOP_LIMIT));
            Some(add(x, applied.map(|c| -c)))
        })
        .collect()
    }
}

/// q^T x over both axes.
fn project(q: &[[f64; 2]], x: &[[f64; 2]]) -> f64 {
    let sum = q.iter().zip(x).map(|(q, x)| q[0] * x[0] + q[1] * x[1]).sum::<f64>();
    sum.clamp(-MODAL_LIMIT, MODAL_LIMIT)
}

/// What is valid less its mean, and zero where it is not.
fn without_mean(values: impl Iterator<Item = Option<[f64; 2]>>) -> Vec<[f64; 2]> {
    let values: Vec<_> = values.collect();
    let count = values.iter().flatten().count().max(1) as f64;
    let sum = values.iter().flatten().fold([0.0; 2], |sum, v| add(sum, *v));
    let mean = sum.map(|sum| -sum / count);
    values.into_iter().map(|v| v.map_or([0.0; 2], |v| add(v, mean))).collect()
}

fn add(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

/// Gradients of x^a y^b, 2 <= a + b, the first `modes` of them by order, orthonormal over both axes and
/// without uniform tilt: modified Gram-Schmidt, twice.
pub fn polynomials(mask: &Mask, modes: usize) -> Vec<[f64; 2]> {
    let half = mask.across() as f64 / 2.0;
    let centre = |i: usize| (i as f64 + 0.5) / half - 1.0;
    let cells: Vec<_> = mask.cells().map(|(x, y)| [centre(x), centre(y)]).collect();
    let orders = (2..).flat_map(|order| (0..=order).map(move |b| [order - b, b]));
    let power = |x: f64, n: i32| if n < 0 { 0.0 } else { x.powi(n) };
    let mut basis: Vec<Vec<[f64; 2]>> = Vec::new();
    for [a, b] in orders.take(modes) {
        let gradient = |&[x, y]: &[f64; 2]| {
            let along_x = f64::from(a) * power(x, a - 1) * power(y, b);
            [along_x, f64::from(b) * power(x, a) * power(y, b - 1)]
        };
        let mut mode: Vec<[f64; 2]> = cells.iter().map(gradient).collect();
        for _ in 0..2 {
            for axis in 0..2 {
                let mean = mode.iter().map(|q| q[axis]).sum::<f64>() / cells.len() as f64;
                mode.iter_mut().for_each(|q| q[axis] -= mean);
            }
            for other in &basis {
                let along: f64 =
                    mode.iter().zip(other).map(|(q, o)| q[0] * o[0] + q[1] * o[1]).sum();
                let pairs = mode.as_flattened_mut().iter_mut().zip(other.as_flattened());
                pairs.for_each(|(q, o)| *q -= along * o);
            }
            let norm = mode.as_flattened().iter().map(|q| q * q).sum::<f64>().sqrt();
            mode.as_flattened_mut().iter_mut().for_each(|q| *q /= norm);
        }
        basis.push(mode);
    }
    basis.concat()
}
