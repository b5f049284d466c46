//! f and B with the least mean square error, and the error that is expected.
//!
//! With slopes s1, s2 and the tips and tilts t that take the star's gradients out, all less their mean, let m be the
//! modal parts [q^T s1; q^T s2]. The modes of the command are a linear estimate of those of t from m,
//!
//! G = <q^T t m^T> (<m m^T> + noise)^-1,  B = G - f [1 0],
//!
//! whatever f is. Beyond the modes only the gate at H counts. Let e be what the best fit of the segments to the star's
//! phase has beyond the mirror of q G m, and u the mirror of that part of s1 that is orthogonal to q. Then
//! f = <e, u> / (<u, u> + noise), products being those of the phase ([`super::phase_metric`]), and <e, e> - <e, u> f is
//! left beside the fitting error. Without modes, that f is the best number for a single gate.
//!
//! **Noise.** The law's low pass, c' = (1 - g) c + g (..), leaves g / (2 - g) of the variance of white noise in its
//! commands; it is that which is weighed against the turbulence.

use super::modes::Modes;
use super::phase_metric::{PhaseMetric, Shapes};
use super::response::{Arms, Response, Responses, remove_mean};
use super::waves::{Wave, waves};
use crate::error::{Error, refuse};
use crate::instrument::Instrument;
use crate::pupil::Pupil;
use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Waves on a subaperture up to which the turbulence is summed, at least, and waves on the pupil: what a small pupil
/// takes for a mode is finer.
const PER_SUBAPERTURE: f64 = 2.0;
const PER_PUPIL: f64 = 32.0;
/// Waves that are dealt with at once.
const CHUNK: usize = 64;
/// Least noise of a slope, rad across a subaperture: what two gates tell apart by less is nothing to rely on, and the
/// firmware's gains have twelve bits.
const LEAST_NOISE_RAD: f64 = 1e-3;

/// What a design is for.
#[derive(Clone, Debug, PartialEq)]
pub struct Purpose {
    /// H, m.
    pub beacon_height_m: f64,
    /// z, m; 0 for no second gate.
    pub gate_height_m: f64,
    /// Weight and height, m, of each layer.
    pub layers: Vec<[f64; 2]>,
    /// Fried parameter at the laser's wavelength, m.
    pub r0_m: f64,
    /// Rms noise of a slope of the gate at H and of the second one, rad of phase at the laser's wavelength from one edge of a subaperture to the
    /// other.
    pub noise_rad: [f64; 2],
    /// g, the integrator's gain.
    pub gain: f64,
}

impl Purpose {
    /// That of an instrument whose second gate is at `gate_height_m` and whose slopes have `noise_rad`.
    pub fn of(instrument: &Instrument, gate_height_m: f64, noise_rad: [f64; 2]) -> Self {
        let Instrument { atmosphere, laser, second_gate, control, .. } = instrument;
        let own = atmosphere.layers.iter().map(|layer| [layer.weight, layer.height_m]);
        let expected = second_gate.layers.iter().map(|layer| [layer.weight, layer.height_m]);
        Self {
            beacon_height_m: laser.beacon_height_m,
            gate_height_m,
            layers: if second_gate.layers.is_empty() { own.collect() } else { expected.collect() },
            r0_m: instrument.r0_m(),
            noise_rad,
            gain: control.gain,
        }
    }
}

/// f and B.
#[derive(Clone, Debug)]
pub struct Design {
    /// f.
    pub lever_arm: f64,
    /// q.
    pub modes: Modes,
    /// B, M x 2M.
    pub coupling: DMatrix<f64>,
    /// Variance of the star's phase that is expected beyond the fitting error, rad^2 at the laser's wavelength, piston,
    /// tip and tilt removed.
    pub residual_rad2: f64,
    /// The same for f = 1 and no B.
    pub null_seeking_rad2: f64,
}

impl Design {
    /// The best law with `modes` (none: a single gate's best number) on `pupil`; `progress` is told the fraction done.
    ///
    /// # Errors
    /// [`Error::Config`] for layers that are not below the beacon, a gate that is not, or modes that the subapertures do
    /// not tell apart.
    pub fn new(
        pupil: &Pupil,
        purpose: &Purpose,
        modes: usize,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Self, Error> {
        let modes = Modes::new(pupil, modes)?;
        let sky = Sky::new(pupil, purpose)?;
        // Half of the noise from edge to edge is from centre to edge.
        let filtered = purpose.gain / (2.0 - purpose.gain);
        let noise =
            purpose.noise_rad.map(|rad| filtered * (0.5 * rad.max(LEAST_NOISE_RAD)).powi(2));
        let estimate = estimate(&modes, noise, &sky, &|done| progress(0.5 * done));
        let metric = PhaseMetric::new(pupil);
        let shapes = metric.mirror(modes.matrix().clone());
        let products = sky.sum(&|done| progress(0.5 + 0.5 * done), &|responses| {
            products(&metric, &modes, &shapes, &estimate, responses)
        });
        let [ee, eu, uu, null] = [0, 1, 2, 3].map(|k| products[k]);
        let of_noise = of_noise(&metric, &modes, &estimate, noise);
        let lever_arm = eu / (uu + of_noise[0]);
        let mut coupling = estimate;
        for mode in 0..modes.count() {
            coupling[(mode, mode)] -= lever_arm;
        }
        Ok(Self {
            lever_arm,
            modes,
            coupling,
            residual_rad2: ee + of_noise[1] - eu * lever_arm,
            null_seeking_rad2: null + of_noise[2],
        })
    }
}

/// The turbulence over a pupil.
struct Sky {
    response: Response,
    layers: Vec<Arms>,
    waves: Vec<Wave>,
    /// (D / r0)^(5/3).
    strength: f64,
}

impl Sky {
    fn new(pupil: &Pupil, purpose: &Purpose) -> Result<Self, Error> {
        let response = Response::new(pupil);
        let across = pupil.across();
        let finest = PER_SUBAPERTURE.max(PER_PUPIL / across as f64);
        Ok(Self {
            layers: arms(purpose)?,
            waves: waves(across, finest, response.longest()),
            response,
            strength: (pupil.diameter_m() / purpose.r0_m).powf(5.0 / 3.0),
        })
    }

    /// The sum of `each` over all waves and layers; `progress` is told the fraction done.
    fn sum(
        &self,
        progress: &(dyn Fn(f64) + Sync),
        each: &(dyn Fn(Responses) -> DMatrix<f64> + Sync),
    ) -> DMatrix<f64> {
        let of_layer = |&layer| self.waves.chunks(CHUNK).map(move |waves| (waves, layer));
        let chunks: Vec<(&[Wave], Arms)> = self.layers.iter().flat_map(of_layer).collect();
        let (done, all) = (AtomicUsize::new(0), chunks.len() as f64);
        let part = |(waves, layer)| {
            let part = each(self.response.to(waves, layer));
            progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / all);
            part
        };
        let parts: Vec<DMatrix<f64>> = chunks.into_par_iter().map(part).collect();
        // In the order of the chunks, whichever thread had them.
        parts.into_iter().reduce(|sum, part| sum + part).unwrap_or_default() * self.strength
    }
}

/// The layers' arms, weights normalised.
fn arms(purpose: &Purpose) -> Result<Vec<Arms>, Error> {
    let Purpose { beacon_height_m, gate_height_m, layers, .. } = purpose;
    if !(0.0..=*beacon_height_m).contains(gate_height_m) {
        let limit = format!("from 0 to laser.beacon_height_m = {beacon_height_m}");
        return Err(refuse("second_gate.height_m", gate_height_m, &limit));
    }
    let sum: f64 = layers.iter().map(|[weight, _]| weight).sum();
    if sum <= 0.0 {
        return Err(refuse("layers: sum of weights", sum, "above 0"));
    }
    let arm = |&[weight, height_m]: &[f64; 2]| match height_m < *beacon_height_m {
        true => Ok(Arms {
            weight: weight / sum,
            focus: 1.0 - height_m / beacon_height_m,
            gate: if height_m < *gate_height_m { 1.0 - height_m / gate_height_m } else { 0.0 },
        }),
        false => {
            let limit = format!("below laser.beacon_height_m = {beacon_height_m}");
            Err(refuse("height_m of a layer", height_m, &limit))
        }
    };
    layers.iter().filter(|[weight, _]| *weight > 0.0).map(arm).collect()
}

/// G.
fn estimate(
    modes: &Modes,
    noise: [f64; 2],
    sky: &Sky,
    progress: &(dyn Fn(f64) + Sync),
) -> DMatrix<f64> {
    let (q, count) = (modes.matrix(), modes.count());
    if count == 0 {
        return DMatrix::zeros(0, 0);
    }
    let covariances = sky.sum(progress, &|Responses { star, first, second, .. }| {
        let mut parts = DMatrix::zeros(3 * count, star.ncols());
        for (index, slopes) in [star, first, second].iter().enumerate() {
            parts.rows_mut(index * count, count).copy_from(&q.tr_mul(slopes));
        }
        &parts * parts.transpose()
    });
    let mut own = covariances.view((count, count), (2 * count, 2 * count)).into_owned();
    for (mode, noise) in (0..2 * count).map(|k| (k, noise[k / count])) {
        own[(mode, mode)] += noise;
    }
    let with_star = covariances.view((count, 0), (2 * count, count)).into_owned();
    // A covariance and a positive diagonal: the decomposition exists.
    Cholesky::new(own).expect("positive definite").solve(&with_star).transpose()
}

/// <e, e>, <e, u>, <u, u>, and <e, e> for f = 1 and no B.
fn products(
    metric: &PhaseMetric,
    modes: &Modes,
    shapes: &Shapes,
    estimate: &DMatrix<f64>,
    Responses { fit, pistons, first, second, .. }: Responses,
) -> DMatrix<f64> {
    let (q, count) = (modes.matrix(), modes.count());
    let mut seen = DMatrix::zeros(2 * count, first.ncols());
    seen.rows_mut(0, count).copy_from(&q.tr_mul(&first));
    seen.rows_mut(count, count).copy_from(&q.tr_mul(&second));
    let truth = metric.shapes(fit, pistons);
    let mirror = metric.mirror(first);
    let null = truth.clone().less(&mirror);
    let e = truth.less(&shapes.combined(&(estimate * &seen)));
    let u = mirror.less(&shapes.combined(&seen.rows(0, count).into_owned()));
    let inner = |a: &Shapes, b: &Shapes| metric.inner(a, b);
    DMatrix::from_row_slice(
        1,
        4,
        &[inner(&e, &e), inner(&e, &u), inner(&u, &u), inner(&null, &null)],
    )
}

/// What noise adds to <u, u>, to <e, e>, and to a command that is s1.
fn of_noise(
    metric: &PhaseMetric,
    modes: &Modes,
    estimate: &DMatrix<f64>,
    noise: [f64; 2],
) -> [f64; 3] {
    let (q, count) = (modes.matrix(), modes.count());
    let square = |tilts| {
        let shapes = metric.mirror(tilts);
        metric.inner(&shapes, &shapes)
    };
    let mut white = DMatrix::identity(q.nrows(), q.nrows());
    remove_mean(&mut white);
    let whole = noise[0] * square(white.clone());
    let beyond = noise[0] * square(white - q * q.transpose());
    let modal = [0, 1].map(|gate| noise[gate] * square(q * estimate.columns(gate * count, count)));
    [beyond, modal[0] + modal[1], whole]
}
