//! What focal anisoplanatism leaves of the wavefront, radial order by radial order (Butterley et
//! al. 2006, section 3).
//!
//! True gradients g give b = D^-1 g, those of the sensor g' give b' = B g' with the reconstructor B.
//! Layers are independent: with weights w_k, covariances with g' are sum_k w_k of those with
//! g'_k, and <g' g'> likewise. For each radial order, sums over its modes j of
//!
//! sensed = <(b - b')^2> / <b^2>,  <b^2> = D^-1 G (D^-1)^T
//!                                 <b b'> = D^-1 G' B^T,  G' = <g g'>
//!                                 <b'^2> = B G'' B^T,  G'' = <g' g'>
//! total = <(a - b')^2> / <a^2>,   <a b'> = <a g'> B^T, <a^2> from Noll
//!
//! `sensed` is the paper's a = b, applied to every term; `total` has aliasing and fitting too. With
//! the lever arm, g'_k is beta_k times the gradient at the layer. The floor is `total` of a natural
//! guide star, b' = b.

use super::covariance::matrix;
use super::legendre::GaussLegendre;
use super::mean_gradient::mean_gradients;
use super::noll;
use super::phase_covariance::PhaseCovariance;
use super::reconstructor::{Degenerate, gradients, invert};
use super::squares::Squares;
use super::zernike::{Mode, modes};
use clap::ValueEnum;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use splash_firmware::geometry::Mask;
use std::ops::RangeInclusive;

/// Points along an edge when covariances of phase are averaged over it: see
/// [`super::mean_gradient`].
pub const EDGE_POINTS: usize = 12;

/// The betas for which results are exact to 1e-5: below, a layer is close to its beacon, and
/// covariances lose too many digits.
pub const BETAS: RangeInclusive<f64> = 0.1..=1.0;

/// A turbulent layer, by what matters here.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Layer {
    /// Share of the turbulence; shares are normalised.
    pub weight: f64,
    /// 1 - height / beacon height, one of [`BETAS`].
    pub beta: f64,
}

/// Which reconstructor turns SPLASH's gradients into coefficients; laser and natural guide stars
/// have the nominal one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Reconstruction {
    /// Matched without the lever arm, nominal with it
    Mixed,
    /// D'^-1: gradients averaged over the beams' squares at the layers
    Matched,
    /// D^-1: gradients averaged over the subapertures
    Nominal,
}

/// A pupil, its sensors and its turbulence.
#[derive(Clone, Debug)]
pub struct Theory {
    max_order: usize,
    /// Weights normalised.
    layers: Vec<Layer>,
    subapertures: Squares,
    nominal: DMatrix<f64>,
    /// SPLASH's, without and with the lever arm.
    splash: [DMatrix<f64>; 2],
}

/// Residual variance as a fraction of the uncorrected variance, one number a radial order.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Fractions {
    /// Of what the sensor would have measured without focal anisoplanatism.
    pub sensed: Vec<f64>,
    /// Of the wavefront, aliasing and fitting included.
    pub total: Vec<f64>,
}

/// The same for a natural guide star, which senses all that it can.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Floor {
    /// Of the wavefront.
    pub total: Vec<f64>,
}

/// The result, radial order by radial order. Tip and tilt, order 1, are fitted and not reported.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Residuals {
    /// The radial orders, from 2.
    pub orders: Vec<usize>,
    /// SPLASH without the lever arm.
    pub splash: Fractions,
    /// SPLASH with the lever arm.
    pub splash_lever: Fractions,
    /// Laser guide star without the lever arm.
    pub lgs: Fractions,
    /// Laser guide star with the lever arm.
    pub lgs_lever: Fractions,
    /// Natural guide star.
    pub ngs: Floor,
}

/// The highest radial order fitted unless told otherwise: the smaller of 3 N / 4 + 1 and N / 2 + 5,
/// rounded down, which is 7, 10 and 13 for N = 8, 12 and 16.
///
/// On a circle it leaves less than 3/4 of the variance of any order to a natural guide star. A fit of
/// more orders multiplies what is aliased: two more leave more than all of one, or cannot be told
/// apart. The slower growth above N = 16 is that of polynomials fitted to points on a grid, well
/// conditioned up to a degree that grows as the square root of N.
pub fn default_order(across: usize) -> usize {
    (3 * across / 4 + 1).min(across / 2 + 5)
}

/// Moments of a sensor's coefficients b', mode by mode, summed over layers.
struct Moments<'a> {
    reconstructor: &'a DMatrix<f64>,
    lever_arm: bool,
    with_true: DVector<f64>,
    with_sensed: DVector<f64>,
    own: DVector<f64>,
}

impl<'a> Moments<'a> {
    fn new(reconstructor: &'a DMatrix<f64>, lever_arm: bool) -> Self {
        let zeros = DVector::zeros(reconstructor.nrows());
        let [with_true, with_sensed, own] = [zeros.clone(), zeros.clone(), zeros];
        Self { reconstructor, lever_arm, with_true, with_sensed, own }
    }
}

/// The diagonal of a b^T.
fn diagonal(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DVector<f64> {
    a.component_mul(b).column_sum()
}

impl Theory {
    /// Sets up the reconstructors for the subapertures in `mask` and radial orders through
    /// `max_order`, 2 to 100. Weights need not be normalised, but their sum is above 0.
    ///
    /// # Errors
    /// [`Degenerate`] if the pupil does not show all modes.
    pub fn new(
        mask: &Mask,
        max_order: usize,
        layers: &[Layer],
        reconstruction: Reconstruction,
    ) -> Result<Self, Degenerate> {
        let sum: f64 = layers.iter().map(|layer| layer.weight).sum();
        let share = |layer: &Layer| Layer { weight: layer.weight / sum, ..*layer };
        let kept = layers.iter().filter(|layer| layer.weight > 0.0);
        let layers: Vec<Layer> = kept.map(share).collect();
        let subapertures = Squares::subapertures(mask);
        let inverse =
            |footprints: &[(f64, Squares)]| invert(&gradients(footprints, max_order), max_order);
        let nominal = inverse(&[(1.0, subapertures.clone())])?;
        let matched = || {
            let footprint = |layer: &Layer| (layer.weight, subapertures.splash(layer.beta));
            inverse(&layers.iter().map(footprint).collect::<Vec<_>>())
        };
        let splash = match reconstruction {
            Reconstruction::Mixed => [matched()?, nominal.clone()],
            Reconstruction::Matched => {
                let matched = matched()?;
                [matched.clone(), matched]
            }
            Reconstruction::Nominal => [nominal.clone(), nominal.clone()],
        };
        Ok(Self { max_order, layers, subapertures, nominal, splash })
    }

    /// How many matrices of covariances [`Theory::residuals`] computes, where its time goes.
    pub fn steps(&self) -> usize {
        1 + 4 * self.layers.len()
    }

    /// The residuals; `progress` is called after each of the steps.
    pub fn residuals(&self, progress: &mut dyn FnMut()) -> Residuals {
        let mut gradients = |rows: &Squares, columns: &Squares| {
            let matrix = matrix(rows, columns);
            progress();
            matrix
        };
        let phase = PhaseCovariance::new(self.max_order);
        let rule = GaussLegendre::new(EDGE_POINTS);
        let count = phase.modes().len();
        let with_coefficients = |squares: &Squares| {
            mean_gradients(squares, count, &rule, |point, out| phase.values(point, out)).transpose()
        };
        let (nominal, subapertures) = (&self.nominal, &self.subapertures);
        let true_own = phase
            .modes()
            .iter()
            .map(|&Mode { radial, azimuthal, .. }| noll::covariance(radial, radial, azimuthal));
        let true_own = DVector::from_iterator(count, true_own);
        let sensed_own = diagonal(&(nominal * gradients(subapertures, subapertures)), nominal);
        let true_with_sensed = diagonal(&with_coefficients(subapertures), nominal);

        let [plain, with_lever] = &self.splash;
        let mut splash = [Moments::new(plain, false), Moments::new(with_lever, true)];
        let mut lgs = [Moments::new(nominal, false), Moments::new(nominal, true)];
        for &Layer { weight, beta } in &self.layers {
            let sensors =
                [(&mut splash, subapertures.splash(beta)), (&mut lgs, subapertures.lgs(beta))];
            for (estimates, squares) in sensors {
                let with_true = with_coefficients(&squares);
                let with_sensed = nominal * gradients(subapertures, &squares);
                let own = gradients(&squares, &squares);
                for moments in estimates {
                    let by = moments.reconstructor;
                    let arm = if moments.lever_arm { beta } else { 1.0 };
                    moments.with_true += weight * arm * diagonal(&with_true, by);
                    moments.with_sensed += weight * arm * diagonal(&with_sensed, by);
                    moments.own += weight * arm * arm * diagonal(&(by * &own), by);
                }
            }
        }

        let fractions = |moments: &Moments<'_>| Fractions {
            sensed: self.by_order(&sensed_own, &moments.with_sensed, &moments.own),
            total: self.by_order(&true_own, &moments.with_true, &moments.own),
        };
        Residuals {
            orders: (2..=self.max_order).collect(),
            splash: fractions(&splash[0]),
            splash_lever: fractions(&splash[1]),
            lgs: fractions(&lgs[0]),
            lgs_lever: fractions(&lgs[1]),
            ngs: Floor { total: self.by_order(&true_own, &true_with_sensed, &sensed_own) },
        }
    }

    /// <(p - q)^2> / <p^2> of each radial order from 2, from <p^2>, <p q> and <q^2> of each mode.
    fn by_order(&self, p: &DVector<f64>, cross: &DVector<f64>, q: &DVector<f64>) -> Vec<f64> {
        let mut sums = vec![[0.0, 0.0]; self.max_order + 1];
        for (j, mode) in modes(self.max_order).iter().enumerate() {
            sums[mode.radial][0] += p[j] - 2.0 * cross[j] + q[j];
            sums[mode.radial][1] += p[j];
        }
        sums[2..].iter().map(|[residual, variance]| residual / variance).collect()
    }
}
