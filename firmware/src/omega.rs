//! The relaxation factor from the real mask, computed when the configuration is built.
//!
//! ```text
//! omega = 2 / (1 + sqrt(1 - mu^2))
//! ```
//!
//! mu is the largest, over the connected components, of the second singular value of the
//! red-black block of D^-1/2 A D^-1/2 (A the adjacency, D the degrees). The first is 1 in every
//! component: its vector sqrt(degree) is the mean piston, which is removed anyway. Southwell's
//! 2/(1 + sin(pi/(N + 1))) belongs to fixed edges, not to the free ones of a pupil, and costs up to
//! 1.7 times the sweeps on an annulus. Young (1954) for the two-colour theory.

use crate::redblack::RedBlack;
use crate::sor::{Node, SorConfig};

/// Power iterations at most; a 40 x 40 square needs about 2000 for [`TOLERANCE`].
const MAX_ITERATIONS: usize = 20_000;
/// Relative change of mu^2 in one iteration at which it has converged. The Rayleigh quotient's
/// error is then below 1e-7 at N = 40, which moves omega by less than 1e-5.
const TOLERANCE: f64 = 1e-10;

/// The optimal relaxation factor for the mask that `config.couplings` describe; in [1, 2).
///
/// Only +, -, x, / and libm's square root are used, in one order: every machine gets the same
/// bits.
pub(crate) fn optimal<const M: usize>(config: &SorConfig<M>, nodes: &[Node]) -> f64 {
    2.0 / (1.0 + libm::sqrt(1.0 - second_singular_squared(config, nodes)))
}

/// Errors of the pistons shrink by omega - 1 a sweep; this is ln of how far a frame's sweeps must
/// take them. On circles it comes to ceil(N/2) sweeps, which leave 4 to 6 % rms of the residual
/// wavefront error when turbulence moves by an eighth of a subaperture a frame.
const SHRINKAGE: f64 = 2.6;

/// Sweeps that a warm frame needs with the optimal relaxation factor: at least ceil(N/2), more where
/// the mask relaxes more slowly than a circle (a fifth more with an obstruction of 0.3).
pub(crate) fn sweeps(omega: f64, across: usize) -> u16 {
    // omega = 1 converges at once: ln 0 asks for no sweep.
    let needed = libm::ceil(SHRINKAGE / -libm::log(omega - 1.0));
    (needed as u16).max(across.div_ceil(2) as u16)
}

/// mu^2 by power iteration with each component's first vector deflated.
fn second_singular_squared<const M: usize>(config: &SorConfig<M>, nodes: &[Node]) -> f64 {
    let mut weight = RedBlack::<f64, M>::new(0.0);
    let mut vector = RedBlack::<f64, M>::new(0.0);
    let mut degrees = [0.0; M];
    let is_black = |node: &&Node| node.place.padded::<M>() % 2 == 1;
    let mut seed = 1u32;
    for node in nodes {
        let degree = config.couplings.get(node.place).map_or(0, |c| c.degree());
        if degree == 0 {
            continue;
        }
        put(&mut weight, *node, 1.0 / libm::sqrt(f64::from(degree)));
        // A fixed pseudo-random start has a part along every vector.
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        if is_black(&node) {
            put(&mut vector, *node, f64::from(seed >> 8) / f64::from(1 << 24) - 0.5);
            if let Some(sum) = degrees.get_mut(usize::from(node.component)) {
                *sum += f64::from(degree);
            }
        }
    }

    let mut mu_squared = 0.0;
    for _ in 0..MAX_ITERATIONS {
        deflate(&mut vector, &weight, &degrees, nodes);
        let size = norm_squared(&vector, config, 1);
        // Nothing but rounding is left of a vector of unit norm: no component has a second
        // singular value, or none above 1e-5, which asks for omega = 1 as well.
        if size < 1e-20 && mu_squared < 1e-10 {
            return 0.0;
        }
        let scale = 1.0 / libm::sqrt(size);
        vector.nodes_mut(&config.grid, 1).iter_mut().for_each(|v| *v *= scale);
        apply(&mut vector, &weight, config, 0);
        let next = norm_squared(&vector, config, 0);
        apply(&mut vector, &weight, config, 1);
        let converged = (next - mu_squared).abs() <= TOLERANCE * next;
        mu_squared = next;
        if converged {
            break;
        }
    }
    mu_squared.min(1.0)
}

fn put<const M: usize>(field: &mut RedBlack<f64, M>, node: Node, value: f64) {
    if let Some(place) = field.get_mut(node.place) {
        *place = value;
    }
}

/// Replaces the values of one colour by D^-1/2 A D^-1/2 times those of the other.
fn apply<const M: usize>(
    vector: &mut RedBlack<f64, M>,
    weight: &RedBlack<f64, M>,
    config: &SorConfig<M>,
    colour: usize,
) {
    let own_weight = weight.nodes(&config.grid, colour);
    let side_weights = weight.sides(&config.grid, colour);
    let (own, sides) = vector.nodes_and_sides(&config.grid, colour);
    let values = own.iter_mut().zip(own_weight).zip(sides.iter().zip(side_weights.iter()));
    for ((v, &w), ([a, b, c, d], [wa, wb, wc, wd])) in values {
        *v = w * (a * wa + b * wb + c * wc + d * wd);
    }
}

/// Removes each component's part along sqrt(degree) from the black values.
fn deflate<const M: usize>(
    vector: &mut RedBlack<f64, M>,
    weight: &RedBlack<f64, M>,
    degrees: &[f64; M],
    nodes: &[Node],
) {
    let mut parts = [0.0; M];
    let black = || nodes.iter().filter(|node| node.place.padded::<M>() % 2 == 1);
    for node in black() {
        let (v, w) = (vector.get(node.place), weight.get(node.place));
        let part = parts.get_mut(usize::from(node.component));
        if let (Some(&v), Some(&w), Some(part)) = (v, w, part)
            && w > 0.0
        {
            *part += v / w;
        }
    }
    for (part, &degree) in parts.iter_mut().zip(degrees) {
        *part = if degree > 0.0 { *part / degree } else { 0.0 };
    }
    for node in black() {
        let part = parts.get(usize::from(node.component)).copied().unwrap_or(0.0);
        if let (Some(v), Some(&w)) = (vector.get_mut(node.place), weight.get(node.place))
            && w > 0.0
        {
            *v -= part / w;
        }
    }
}

fn norm_squared<const M: usize>(
    vector: &RedBlack<f64, M>,
    config: &SorConfig<M>,
    colour: usize,
) -> f64 {
    vector.nodes(&config.grid, colour).iter().map(|v| v * v).sum()
}
