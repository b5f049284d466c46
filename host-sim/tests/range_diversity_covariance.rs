//! What both gates see, as a sum over waves, against the exact covariances of gradients averaged over squares: every
//! square of the way back at its place in the layer.
//!
//! s1_i = b [G(x_i; b d) - mean_j G(b x_j + (1-b) x_i; b d)],
//! s2_i = b_z [G(x_i; b d) - mean_j G(b_z x_j + (1-b_z) x_i; b_z d)], t_i = G(x_i; d),
//! with G(y; a) the mean gradient over the square of side a around y, and the mean over i taken off.

use host_sim::pupil::Pupil;
use host_sim::range_diversity::modes::Modes;
use host_sim::range_diversity::response::{Arms, Response, Responses};
use host_sim::range_diversity::waves::waves;
use host_sim::theory::covariance::SquarePair;
use nalgebra::DMatrix;

/// A mean over squares of one side, of weight and centre.
type Term = (f64, f64, Vec<[f64; 2]>);

/// The squares of a slope: weight, side, centres. Lengths are in units of half the grid's side.
fn slope(centres: &[[f64; 2]], i: usize, pitch: f64, up: f64, back: Option<f64>) -> Vec<Term> {
    let mut terms = vec![(back.unwrap_or(1.0), up * pitch, vec![centres[i]])];
    if let Some(b) = back {
        let place = |x: &[f64; 2]| [0, 1].map(|axis| b * x[axis] + (1.0 - b) * centres[i][axis]);
        terms.push((-b, b * pitch, centres.iter().map(place).collect()));
    }
    terms
}

/// <a b> of two slopes, each less its mean over the subapertures.
fn exact(a: &[Vec<Term>], b: &[Vec<Term>]) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(2 * a.len(), 2 * b.len());
    for (i, a) in a.iter().enumerate() {
        for (l, b) in b.iter().enumerate() {
            for (wa, side_a, from) in a {
                for (wb, side_b, to) in b {
                    let pair = SquarePair::new(*side_a, *side_b);
                    let weight = wa * wb / (from.len() * to.len()) as f64;
                    for p in from {
                        for q in to {
                            let c = pair.covariance([p[0] - q[0], p[1] - q[1]]);
                            for (axes, value) in
                                [([0, 0], c.xx), ([0, 1], c.xy), ([1, 0], c.xy), ([1, 1], c.yy)]
                            {
                                matrix[(2 * i + axes[0], 2 * l + axes[1])] += weight * value;
                            }
                        }
                    }
                }
            }
        }
    }
    let count = a.len() as f64;
    let centring = DMatrix::from_fn(2 * a.len(), 2 * a.len(), |r, c| {
        f64::from(u8::from(r == c)) - f64::from(u8::from(r % 2 == c % 2)) / count
    });
    &centring * matrix * centring
}

#[test]
fn sums_over_waves_are_the_exact_covariances() {
    let pupil = Pupil::circular(4, 2, 0.5).unwrap();
    let centre = |index: usize| (2.0 * index as f64 + 1.0) / 4.0 - 1.0;
    let centres: Vec<[f64; 2]> = pupil.subapertures().iter().map(|c| c.map(centre)).collect();
    let (pitch, count) = (0.5, centres.len());
    let (b, b_z) = (0.75, 0.5);
    let all = |up: f64, back: Option<f64>| -> Vec<Vec<Term>> {
        (0..count).map(|i| slope(&centres, i, pitch, up, back)).collect()
    };
    let slopes = [all(1.0, None), all(b, Some(b)), all(b, Some(b_z))];

    let response = Response::new(&pupil);
    let waves = waves(4, 8.0, response.longest());
    let seen = response.to(&waves, Arms { weight: 1.0, focus: b, gate: b_z });
    let Responses { star, first, second, .. } = seen;
    let seen = [star, first, second];
    let modes = Modes::new(&pupil, 12).unwrap();
    let q = modes.matrix();
    for (a, b) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)] {
        // Tips are half a pitch of the gradient.
        let exact = exact(&slopes[a], &slopes[b]) * (0.5 * pitch) * (0.5 * pitch);
        let summed = &seen[a] * seen[b].transpose();
        let relative = |summed: DMatrix<f64>, exact: DMatrix<f64>| {
            let scale = exact.amax();
            (summed - exact).amax() / scale
        };
        let modal = relative(q.tr_mul(&summed) * q, q.tr_mul(&exact) * q);
        let each = relative(summed, exact);
        println!("{a}{b}: modes {modal:.2e}, slopes {each:.2e}");
        assert!(modal < 5e-4 && each < 5e-4, "{a}{b}: modes {modal}, slopes {each}");
    }
}
