//! Random numbers of the detector: the streams and the response map.

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::DetectorSpec;

/// The random stream of one row of one frame.
///
/// The stream's 64-bit key is `m(m(m(seed) ^ frame) ^ row)`, where `m` is SplitMix64's output
/// function. `m` is a bijection, so the rows of a frame never share a key, nor do the frames'
/// own keys of a run.
pub fn row_stream(seed: u64, frame: u64, row: u64) -> Xoshiro256PlusPlus {
    Xoshiro256PlusPlus::seed_from_u64(mix(mix(mix(seed) ^ frame) ^ row))
}

/// Output function of SplitMix64 (Steele, Lea & Flood 2014).
fn mix(value: u64) -> u64 {
    let z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Response of each pixel: 1 plus a Gaussian of the specification's rms, never negative.
pub(super) fn response_map(spec: &DetectorSpec) -> Vec<f32> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(mix(spec.response_seed));
    (0..spec.width * spec.height)
        .map(|_| {
            let normal: f64 = random.sample(StandardNormal);
            (1.0 + spec.response_rms * normal).max(0.0) as f32
        })
        .collect()
}
