//! Normal deviates of mean 0 and variance 1.

use super::stream::{LANES, RowStream};
use crate::optics::sincos::sin_cos;
use pulp::Simd;

/// Deviates drawn together.
pub(super) const BLOCK: usize = 2 * LANES;

/// The transform of Box & Muller (1958): sqrt(-2 ln u) times cosine and sine of 2 pi v, u and v of 24
/// bits. None is beyond 5.9.
#[inline(always)]
pub(super) fn draw<S: Simd>(simd: S, random: &mut RowStream) -> [f32; BLOCK] {
    let [first, second] = random.draw(simd);
    // 2 to the power -25 in the middle of the first of 2^24 steps.
    let uniform = |bits: u32| (bits >> 8) as i32 as f32 * 2f32.powi(-24) + 2f32.powi(-25);
    let (mut radius, mut angle) = ([0.0; LANES], [0.0; LANES]);
    for k in 0..LANES {
        radius[k] = (-2.0 * ln(uniform(first[k]))).max(0.0).sqrt();
        // Between -pi and pi, where the phase needs no reduction.
        angle[k] = std::f32::consts::TAU * (uniform(second[k]) - 0.5);
    }
    let (mut sin, mut cos) = ([0.0; LANES], [0.0; LANES]);
    let vectors = S::as_mut_simd_f32s(&mut sin).0.iter_mut().zip(S::as_mut_simd_f32s(&mut cos).0);
    for ((sin, cos), &angle) in vectors.zip(S::as_simd_f32s(&angle).0) {
        (*sin, *cos) = sin_cos(simd, angle);
    }
    let mut normals = [0.0; BLOCK];
    let (first, second) = normals.split_at_mut(LANES);
    for k in 0..LANES {
        first[k] = radius[k] * cos[k];
        second[k] = radius[k] * sin[k];
    }
    normals
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

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Arch, WithSimd};

    struct Blocks(usize);

    impl WithSimd for Blocks {
        type Output = Vec<f32>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
            let mut random = RowStream::new(1, 2, 3);
            (0..self.0).flat_map(|_| draw(simd, &mut random)).collect()
        }
    }

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
        let normals = Arch::new().dispatch(Blocks(COUNT / BLOCK));
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
