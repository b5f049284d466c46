//! Poisson deviates of large means by transformed rejection (Hoermann 1993, algorithm PTRS).

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// A Poisson deviate of a mean of at least 10, from a stream that starts at `seed`:
/// k = floor((2 a / s + b) u + mean + 0.43), u uniform in -1/2 .. 1/2 and s = 1/2 - |u|, is accepted by its
/// density's ratio to the distribution; nine draws in ten are without a logarithm.
pub(super) fn draw(seed: u64, mean: f64) -> f64 {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let b = 0.931 + 2.53 * mean.sqrt();
    let a = 0.024_83 * b - 0.059;
    let accepted_at_once = 0.9277 - 3.6224 / (b - 2.0);
    loop {
        let u = random.random::<f64>() - 0.5;
        let v: f64 = random.random();
        let s = 0.5 - u.abs();
        let count = ((2.0 * a / s + b) * u + mean + 0.43).floor();
        if s >= 0.07 && v <= accepted_at_once {
            return count;
        }
        if count < 0.0 || (s < 0.013 && v > s) {
            continue;
        }
        let inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
        let density = (v * inverse_alpha / (a / (s * s) + b)).ln();
        if density <= count * mean.ln() - mean - libm::lgamma(count + 1.0) {
            return count;
        }
    }
}
