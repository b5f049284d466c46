//! Random numbers of the detector: the streams and the response map.

use pulp::{Arch, Simd, WithSimd};
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::DetectorSpec;
use crate::optics::sincos::sin_cos;

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

/// Pairs drawn together.
const LANES: usize = 16;

/// Fills `normals` with deviates of mean 0 and variance 1, two for each 64 bits (Box & Muller 1958):
/// sqrt(-2 ln u) times cosine and sine of 2 pi v, u and v of 24 bits. None is beyond 5.9.
pub(super) fn fill_normal(random: &mut impl Rng, normals: &mut [f32]) {
    let arch = Arch::new();
    for normals in normals.chunks_mut(2 * LANES) {
        // 2 to the power -25 in the middle of the first of 2^24 steps.
        let uniform = |bits: u32| (bits >> 8) as f32 * 2f32.powi(-24) + 2f32.powi(-25);
        let mut pairs = Pairs { u: [0.0; LANES], v: [0.0; LANES] };
        for (u, v) in pairs.u.iter_mut().zip(&mut pairs.v) {
            let bits = random.next_u64();
            (*u, *v) = (uniform((bits >> 32) as u32), uniform(bits as u32));
        }
        let drawn = arch.dispatch(pairs);
        normals.copy_from_slice(&drawn.as_flattened()[..normals.len()]);
    }
}

/// Uniform deviates, which become normal ones.
struct Pairs {
    u: [f32; LANES],
    v: [f32; LANES],
}

impl WithSimd for Pairs {
    type Output = [[f32; LANES]; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        // Between -pi and pi, where the phase needs no reduction.
        let angle = self.v.map(|v| std::f32::consts::TAU * (v - 0.5));
        let radius = self.u.map(|u| (-2.0 * ln(u)).max(0.0).sqrt());
        let mut out = [[0.0; LANES]; 2];
        let [sin, cos] = &mut out;
        let vectors = S::as_mut_simd_f32s(sin).0.iter_mut().zip(S::as_mut_simd_f32s(cos).0);
        for ((sin, cos), &angle) in vectors.zip(S::as_simd_f32s(&angle).0) {
            (*sin, *cos) = sin_cos(simd, angle);
        }
        out.map(|part| std::array::from_fn(|k| part[k] * radius[k]))
    }
}

/// ln x of a normal number x, to 2e-7 of the greater of itself and 1, without a branch:
/// x = 2^k m, sqrt(1/2) <= m < sqrt(2), ln m = 2 artanh s, s = (m - 1)/(m + 1).
#[inline(always)]
fn ln(x: f32) -> f32 {
    const SQRT_HALF: u32 = std::f32::consts::FRAC_1_SQRT_2.to_bits();
    const MANTISSA: u32 = (1 << 23) - 1;
    let above = x.to_bits().wrapping_sub(SQRT_HALF);
    let k = (above as i32 >> 23) as f32;
    let m = f32::from_bits((above & MANTISSA) + SQRT_HALF);
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let series = 1.0 / 3.0 + s2 * (1.0 / 5.0 + s2 * (1.0 / 7.0 + s2 * (1.0 / 9.0)));
    k * std::f32::consts::LN_2 + 2.0 * (s + s * s2 * series)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithm() {
        for k in 1..1 << 20 {
            let x = k as f32 * 2f32.powi(-20);
            let expected = f64::from(x).ln();
            let error = (f64::from(ln(x)) - expected).abs();
            assert!(error < 2e-7 * expected.abs().max(1.0), "ln {x}: {error:e}");
        }
    }

    /// Moments of a million deviates, and how many lie beyond 1 to 4, against the normal distribution:
    /// within five standard errors.
    #[test]
    fn deviates_are_normal() {
        const COUNT: usize = 1 << 20;
        let mut normals = vec![0.0; COUNT];
        fill_normal(&mut row_stream(1, 2, 3), &mut normals);
        let mean_of = |power: i32| {
            normals.iter().map(|&z| f64::from(z).powi(power)).sum::<f64>() / COUNT as f64
        };
        // Mean of z^p, and variance: that of z^2p less the square of the mean.
        for (power, expected, variance) in
            [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0), (6, 15.0, 10170.0)]
        {
            let five = 5.0 * f64::sqrt(variance / COUNT as f64);
            let found = mean_of(power);
            assert!((found - expected).abs() < five, "mean of z^{power}: {found}, not {expected}");
        }
        for (limit, expected) in
            [(1.0, 0.317_310_5), (2.0, 0.045_500_26), (3.0, 2.699_796e-3), (4.0, 6.334_25e-5)]
        {
            let beyond = normals.iter().filter(|z| z.abs() > limit).count() as f64 / COUNT as f64;
            let five = 5.0 * f64::sqrt(expected / COUNT as f64);
            assert!((beyond - expected).abs() < five, "beyond {limit}: {beyond}, not {expected}");
        }
        // Neighbours, and the two of a pair, have nothing to do with one another.
        for apart in [1, LANES] {
            let product = |k: usize| f64::from(normals[k]) * f64::from(normals[k + apart]);
            let mean = (0..COUNT - apart).map(product).sum::<f64>() / COUNT as f64;
            assert!(mean.abs() < 5.0 / (COUNT as f64).sqrt(), "{apart} apart: {mean}");
        }
    }
}
