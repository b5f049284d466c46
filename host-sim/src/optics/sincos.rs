//! Sine and cosine of a vector of phases.

use pulp::Simd;

/// 1.5 * 2^23: adding it rounds to an integer, whose parity is then the lowest bit.
const ROUND: f32 = 12_582_912.0;
/// pi in three parts; the first two have few bits, so that their multiples are exact.
const PI: [f32; 3] = [3.140_625, 9.670_257_6e-4, 6.277_114e-7];
/// (sin r - r) / r^3 on |r| <= pi/2, minimax in sin r: 5e-9.
const SIN: [f32; 4] = [-0.166_666_57, 8.333_017e-3, -1.980_660_1e-4, 2.600_024_2e-6];
/// (cos r - 1) / r^2 on |r| <= pi/2, minimax in cos r: 5.3e-8.
const COS: [f32; 4] = [-0.499_999_3, 4.166_399e-2, -1.385_591_4e-3, 2.319_407e-5];

/// (sin x, cos x) for |x| <= 1000 rad, error below 3e-7.
///
/// x = k pi + r, |r| <= pi/2: two polynomials in r^2, and the sign of both is that of (-1)^k.
#[inline(always)]
pub(crate) fn sin_cos<S: Simd>(simd: S, x: S::f32s) -> (S::f32s, S::f32s) {
    let splat = |value: f32| simd.splat_f32s(value);
    let rounded = simd.mul_add_e_f32s(x, splat(std::f32::consts::FRAC_1_PI), splat(ROUND));
    let k = simd.sub_f32s(rounded, splat(ROUND));
    let bits = simd.transmute_u32s_f32s(rounded);
    let sign = simd.transmute_f32s_u32s(simd.wrapping_dyn_shl_u32s(bits, simd.splat_u32s(31)));
    let r = PI.iter().fold(x, |r, &part| simd.negate_mul_add_e_f32s(k, splat(part), r));
    let r2 = simd.mul_f32s(r, r);
    let polynomial = |coefficients: [f32; 4]| {
        let [c0, c1, c2, c3] = coefficients.map(splat);
        let high = simd.mul_add_e_f32s(c3, r2, c2);
        simd.mul_add_e_f32s(simd.mul_add_e_f32s(high, r2, c1), r2, c0)
    };
    let sin = simd.mul_add_e_f32s(simd.mul_f32s(r, r2), polynomial(SIN), r);
    let cos = simd.mul_add_e_f32s(r2, polynomial(COS), splat(1.0));
    (simd.xor_f32s(sin, sign), simd.xor_f32s(cos, sign))
}

#[cfg(test)]
mod tests {
    use pulp::{Arch, Simd, WithSimd};

    struct All<'a>(&'a [f32], &'a mut [f32], &'a mut [f32]);

    impl WithSimd for All<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let x = S::as_simd_f32s(self.0).0;
            let sin = S::as_mut_simd_f32s(self.1).0;
            let cos = S::as_mut_simd_f32s(self.2).0;
            for ((x, sin), cos) in x.iter().zip(sin).zip(cos) {
                (*sin, *cos) = super::sin_cos(simd, *x);
            }
        }
    }

    #[test]
    fn error_below_3e_7() {
        let x: Vec<f32> = (-500_000..500_000i32).map(|k| k as f32 * 0.002).collect();
        let (mut sin, mut cos) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        Arch::new().dispatch(All(&x, &mut sin, &mut cos));
        let mut worst = 0.0_f64;
        for (k, &x) in x.iter().enumerate() {
            let (expected_sin, expected_cos) = f64::from(x).sin_cos();
            worst = worst.max((f64::from(sin[k]) - expected_sin).abs());
            worst = worst.max((f64::from(cos[k]) - expected_cos).abs());
        }
        println!("{worst:e}");
        assert!(worst < 3e-7, "{worst:e}");
    }
}
