//! How much a beacon's gradients have to be raised: the factor f of c' = (1 - g) c + g f (s + c).
//!
//! A gradient at a layer appears times b = 1 - h/H in the pupil, so gradients of a profile of shares w_k are too
//! small. For the lever arm alone, the least mean square of g - f s with s = sum_k b_k g_k, layers independent,
//! is at
//!
//! f = sum_k w_k b_k / sum_k w_k b_k^2.                                                    (`alone`)
//!
//! What else a beacon does to them changes the best f: on its way up, a beam covers a square of side b d; on the
//! way back, seen from spot i, the mean over the pupil's shadow (1 - b) x_i + b x_k is taken off. What counts is
//! the wavefront that the mirror makes of gradients: with R for tips and tilts, least-squares pistons and the
//! plane taken off, g the star's gradients and < > over the pupil as well,
//!
//! f = <(R g) (R s)> / <(R s)^2>                                                           (`least_variance`)
//!
//! leaves least of R g: exact covariances of Kolmogorov turbulence, those of [`super::covariance`]. With u for the
//! way up and r for the way back, s_k = b_k (u_k - r_k),
//!
//! ```text
//! <s s> = sum_k w_k b_k^2 (<u u> - <u r> - <r u> + <r r>),  <g s> = sum_k w_k b_k (<g u> - <g r>)
//! ```
//!
//! Turbulence has no scale: f depends on the number of subapertures only through how finely they sample it, and an
//! array of 8 across stands for all. R g is smaller than the wavefront itself, whatever the sensor: in the paper's
//! setting f is 1.101, and 200 screens have the least residual at 1.17 for N = 8 and 1.13 for N = 16, between which
//! and 1.101 there are 3 % and 1 % of the variance. For SPLASH on one pupil, [`crate::range_diversity::design`] without
//! modes finds the f that leaves least of the phase: the best f of `host-sim gates`.

use super::covariance::{SquarePair, matrix};
use super::residuals::Layer;
use super::squares::Squares;
use crate::pupil::Pupil;
use crate::range_diversity::phase_metric::PhaseMetric;
use nalgebra::DMatrix;
use rayon::prelude::*;
use splash_firmware::geometry::Mask;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Subapertures across the array that stands for all.
const ACROSS: usize = 8;
/// Whose gradients they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beacon {
    /// Spots launched through the pupil, seen through all of it.
    Splash,
    /// One laser beacon above the telescope.
    Lgs,
}

/// f for the lever arm alone. Weights need not be normalised, but their sum is above 0, as is some beta.
pub fn alone(layers: &[Layer]) -> f64 {
    let sum = |power: i32| -> f64 { layers.iter().map(|l| l.weight * l.beta.powi(power)).sum() };
    sum(1) / sum(2)
}

/// f that leaves least of the wavefront's variance, betas in [`super::BETAS`].
pub fn least_variance(layers: &[Layer], beacon: Beacon) -> f64 {
    let mut sums = [0.0; 2];
    for &Layer { weight, beta } in layers.iter().filter(|layer| layer.weight > 0.0) {
        let [cross, own] = variances(beacon, beta);
        sums[0] += weight * beta * cross;
        sums[1] += weight * beta * beta * own;
    }
    sums[0] / sums[1]
}

/// <(R g) (R s)> and <(R s)^2> of a layer, without the lever arm: 0.7 s of one core for SPLASH, and remembered,
/// for every sensor, law and size of a run asks for the same.
fn variances(beacon: Beacon, beta: f64) -> [f64; 2] {
    static KNOWN: Mutex<BTreeMap<(bool, u64), [f64; 2]>> = Mutex::new(BTreeMap::new());
    let key = (beacon == Beacon::Splash, beta.to_bits());
    // Whoever panicked while it was locked left it whole.
    if let Some(&known) = KNOWN.lock().unwrap_or_else(PoisonError::into_inner).get(&key) {
        return known;
    }
    let mask = Mask::circle(ACROSS).expect("a size that the firmware takes");
    let subapertures = Squares::subapertures(&mask);
    let weights = variance(&subapertures);
    let covariances = match beacon {
        Beacon::Lgs => one_way(&subapertures, &subapertures.lgs(beta)),
        Beacon::Splash => both_ways(&subapertures, beta),
    };
    let found = covariances.map(|covariances| weights.dot(&covariances));
    KNOWN.lock().unwrap_or_else(PoisonError::into_inner).insert(key, found);
    found
}

/// R^T R in the mean over the pupil: its sum with the covariances of gradients is the variance that the mirror gives
/// the wavefront.
fn variance(subapertures: &Squares) -> DMatrix<f64> {
    let pupil = Pupil::circular(ACROSS, 2, subapertures.pitch()).expect("a size that optics take");
    let metric = PhaseMetric::new(&pupil);
    // A gradient of one is half a pitch from centre to edge.
    let (slopes, edge) = (2 * subapertures.count(), 0.5 * subapertures.pitch());
    metric.gram(&metric.mirror(DMatrix::from_diagonal_element(slopes, slopes, edge)))
}

/// <g s> and <s s> of gradients over `squares`, without the lever arm.
fn one_way(subapertures: &Squares, squares: &Squares) -> [DMatrix<f64>; 2] {
    [matrix(subapertures, squares), matrix(squares, squares)]
}

/// The same for SPLASH, the way back taken off.
fn both_ways(subapertures: &Squares, beta: f64) -> [DMatrix<f64>; 2] {
    let up = subapertures.splash(beta);
    let back = subapertures.lgs(beta);
    let [mut with_true, mut own] = one_way(subapertures, &up);
    let moved = |i: usize| subapertures.centre(i).map(|x| (1.0 - beta) * x);
    let shadows = |squares: &Squares| -> Vec<Vec<[f64; 3]>> {
        let count = squares.count();
        let pair = SquarePair::new(squares.side(), back.side());
        let of = |i: usize, l: usize| {
            let [from, shift] = [squares.centre(i), moved(l)];
            let sum = (0..count).fold([0.0; 3], |sum, k| {
                let to = back.centre(k);
                let separation = [0, 1].map(|axis| from[axis] - to[axis] - shift[axis]);
                add(sum, covariance(&pair, separation))
            });
            sum.map(|c| c / count as f64)
        };
        (0..count).into_par_iter().map(|i| (0..count).map(|l| of(i, l)).collect()).collect()
    };
    let (seen, crossed) = (shadows(subapertures), shadows(&up));
    let returns = returns(subapertures, &back, beta);
    for i in 0..up.count() {
        for l in 0..up.count() {
            let both = returns[&apart(subapertures, i, l)];
            let all = [0, 1, 2].map(|k| both[k] - crossed[i][l][k] - crossed[l][i][k]);
            for (row, column, k) in [(0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)] {
                with_true[(2 * i + row, 2 * l + column)] -= seen[i][l][k];
                own[(2 * i + row, 2 * l + column)] += all[k];
            }
        }
    }
    [with_true, own]
}

/// <r r> of two spots, by how many pitches they are apart.
fn returns(subapertures: &Squares, back: &Squares, beta: f64) -> BTreeMap<[i32; 2], [f64; 3]> {
    let count = subapertures.count();
    let mut pairs: BTreeMap<[i32; 2], f64> = BTreeMap::new();
    for i in 0..count {
        for l in 0..count {
            *pairs.entry(apart(subapertures, i, l)).or_default() += 1.0 / (count * count) as f64;
        }
    }
    let pair = SquarePair::new(back.side(), back.side());
    let place = |pitches: [i32; 2], scale: f64| {
        pitches.map(|p| scale * f64::from(p) * subapertures.pitch())
    };
    let of = |&spots: &[i32; 2]| {
        let from = place(spots, 1.0 - beta);
        let sum = pairs.iter().fold([0.0; 3], |sum, (&squares, share)| {
            let to = place(squares, beta);
            let separation = [0, 1].map(|axis| from[axis] + to[axis]);
            add(sum, covariance(&pair, separation).map(|c| share * c))
        });
        (spots, sum)
    };
    pairs.par_iter().map(|(spots, _)| of(spots)).collect()
}

fn covariance(pair: &SquarePair, separation: [f64; 2]) -> [f64; 3] {
    let c = pair.covariance(separation);
    [c.xx, c.xy, c.yy]
}

/// From one subaperture to another, pitches.
fn apart(subapertures: &Squares, i: usize, l: usize) -> [i32; 2] {
    let [a, b] = [i, l].map(|k| subapertures.cells()[k]);
    [0, 1].map(|axis| (a[axis] - b[axis]) / 2)
}

fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[k] + b[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two(weight: f64, beta: f64) -> [Layer; 2] {
        [Layer { weight: 1.0 - weight, beta: 1.0 }, Layer { weight, beta }]
    }

    /// 0.6 + 0.4 x 0.75 = 0.9, 0.6 + 0.4 x 0.5625 = 0.825.
    #[test]
    fn of_the_lever_arm_alone() {
        assert!((alone(&two(0.4, 0.75)) - 0.9 / 0.825).abs() < 1e-15);
        assert_eq!(alone(&two(0.0, 0.75)), 1.0);
    }

    /// At the ground gradients are the star's, whatever the beacon.
    #[test]
    fn at_the_ground_nothing_is_raised() {
        for beacon in [Beacon::Splash, Beacon::Lgs] {
            let found = least_variance(&two(0.0, 0.75), beacon);
            assert!((found - 1.0).abs() < 1e-9, "{beacon:?}: {found}");
        }
    }

    /// An LGS sees phi(b x), of a quadratic phase b^2 of it, which asks for f = 1 / b^2, and of finer ones something
    /// else than is there, which asks for less. SPLASH sees things where they are, less the way back, which takes
    /// from what the lever arm leaves: its f is larger, and above that of the lever arm alone.
    #[test]
    fn the_way_back_asks_for_more() {
        for (weight, beta) in [(0.4, 0.75), (1.0, 0.75), (0.5, 0.9)] {
            let layers = two(weight, beta);
            let [splash, lgs] =
                [Beacon::Splash, Beacon::Lgs].map(|beacon| least_variance(&layers, beacon));
            assert!(splash > alone(&layers) && splash > lgs, "{splash} {lgs}");
            assert!(lgs > 1.0 && lgs < 1.0 / beta / beta, "{lgs}");
        }
    }
}
