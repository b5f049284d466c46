//! The response of each pixel to light.

use super::DetectorSpec;
use super::stream::mix;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;

/// 1 plus a Gaussian of the specification's rms, never negative.
pub(super) fn response_map(spec: &DetectorSpec) -> Vec<f32> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(mix(spec.response_seed));
    (0..spec.width * spec.height)
        .map(|_| {
            let normal: f64 = random.sample(StandardNormal);
            (1.0 + spec.response_rms * normal).max(0.0) as f32
        })
        .collect()
}
