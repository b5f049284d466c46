//! Fixed-point primitives of the frame path: rounding, saturation and ratios.
//!
//! Every function here is branch-free in its data and exact or bounded as its documentation
//! says, so that a PC, a Cortex-M7 and a RISC-V soft core give the same bits, by one sequence of
//! instructions whatever the data. Rounding is to nearest, ties towards plus infinity, but for products' upper halves,
//! which are rounded down.

/// Fraction bits of a centroid in pixels (Q16).
pub const CENTROID_BITS: u32 = 16;

/// Fraction bits of a length: 1 ulp = 2^-9 height LSB, 1 LSB = stroke / 65536.
///
/// Nine guard bits keep the rounding of the relaxation, limit cycles included, within 0.06 LSB at 40 x 40
/// subapertures.
pub const LENGTH_BITS: u32 = 9;

/// Largest magnitude of a tip or tilt, ulp: 2^14 LSB centre to edge, half the stroke over a segment.
pub const TILT_LIMIT: i32 = 1 << 23;

/// Largest magnitude of a piston, ulp: 49152 LSB, half as much again as a stroke shows either side of its
/// middle.
///
/// With this bound and [`TILT_LIMIT`] no sum of the solver leaves 32 bits (see `sor`).
pub const PISTON_LIMIT: i32 = 3 << 23;

/// `x / 2^n`, rounded; `1 <= n <= 62`. The caller keeps `|x| < 2^62`.
#[inline(always)]
pub const fn round_shift(x: i64, n: u32) -> i64 {
    x.wrapping_add(1 << (n - 1)) >> n
}

/// Saturates a 64-bit intermediate to `-limit ..= limit`, for a limit that is not negative.
///
/// `clamp` would panic on crossed limits, and carry its message into the frame path wherever the
/// limits are not constants.
#[inline(always)]
pub fn saturate(x: i64, limit: i32) -> i32 {
    x.max(-i64::from(limit)).min(i64::from(limit)) as i32
}

/// max(x, 0).
///
/// This and what is made of it are written with signs and masks: a comparison would become a branch
/// on a machine without conditional moves, and its time depend on the data.
#[inline(always)]
pub fn positive(x: i32) -> i32 {
    crate::dsp::positive(x)
}

/// min(x, 0): an instruction less than [`positive`] where there is no "and not".
///
/// The mask is opaque: compilers know this for a comparison, and what is subtracted from it for another.
#[inline(always)]
pub fn negative(x: i32) -> i32 {
    x & crate::dsp::opaque(x >> 31)
}

/// The larger of two numbers less than 2^31 apart.
#[inline(always)]
pub fn larger(a: i32, b: i32) -> i32 {
    a.wrapping_sub(negative(a.wrapping_sub(b)))
}

/// The smaller of two numbers less than 2^31 apart.
#[inline(always)]
pub fn smaller(a: i32, b: i32) -> i32 {
    b.wrapping_add(negative(a.wrapping_sub(b)))
}

/// `x` within `-limit ..= limit`, for `|x| + limit < 2^31`.
#[inline(always)]
pub fn clamp(x: i32, limit: i32) -> i32 {
    clamp_raised(x.wrapping_add(limit), limit)
}

/// [`clamp`] of what has been raised by `limit` already, with something else that was added to it.
#[inline(always)]
pub fn clamp_raised(raised: i32, limit: i32) -> i32 {
    negative(positive(raised).wrapping_sub(2 * limit)).wrapping_add(limit)
}

/// Saturates to `-2^30 ..= 2^30 - 1` without a branch.
#[inline(always)]
pub fn narrow(x: i64) -> i32 {
    let sign = (x >> 63) as i32;
    let beyond = (x >> 30) ^ (x >> 63);
    let beyond = ((beyond >> 32) | beyond) as i32;
    // All ones where it is; opaque, or the compiler makes a branch of it.
    let beyond = core::hint::black_box((beyond | beyond.wrapping_neg()) >> 31);
    (x as i32 & !beyond) | ((sign ^ ((1 << 30) - 1)) & beyond)
}

/// The upper half of `a * b`: SMMUL on a Cortex-M7, MULH on RISC-V.
#[inline(always)]
pub const fn mul_high(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
}

/// `a * b / 2^16`, rounded down: SMULW on a Cortex-M7, MULH on RISC-V.
#[inline(always)]
pub const fn mul_short(a: i16, b: i32) -> i32 {
    if cfg!(target_arch = "riscv32") {
        mul_high((a as i32) << 16, b)
    } else {
        ((a as i64 * b as i64) >> 16) as i32
    }
}

/// The upper half of `a * b`, which may be any: MULHSU on RISC-V.
#[inline(always)]
pub const fn mul_high_unsigned(a: i32, b: u32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
}

/// `min(floor(2^16 num / den), 2^16)` for `den <= 2^22`; a zero denominator gives one.
///
/// A numerator below the denominator is below 2^22, so that ten bits more still fit 32.
#[inline]
pub fn ratio_q16(num: u32, den: u32) -> u32 {
    let whole = u32::from(num >= den);
    let d = den.max(1);
    // A numerator at or above the denominator is answered by `whole`; zero keeps the rest bounded.
    let n = num.wrapping_mul(1 - whole);
    let high = (n << 10) / d;
    let rest = (n << 10).wrapping_sub(high.wrapping_mul(d));
    let low = (rest << 6) / d;
    (whole << 16) + (high << 6) + low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn narrow_is_the_nearest_in_range() {
        let (low, high) = (-(1i64 << 30), (1 << 30) - 1);
        let near = [0, low, high, 1 << 31, 1 << 32, 1 << 33, 1 << 62, i64::MAX, i64::MIN];
        for x in near.into_iter().flat_map(|x| [x.saturating_sub(1), x, x.saturating_add(1)]) {
            for x in [x, x.saturating_neg()] {
                assert_eq!(i64::from(narrow(x)), x.clamp(low, high), "{x}");
            }
        }
    }

    #[test]
    fn ratio_is_the_floor() {
        let mut x = 1u32;
        for _ in 0..200_000 {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let (num, den) = (x >> 10, x.rotate_left(13) >> 10);
            let exact = ((u64::from(num) << 16) / u64::from(den.max(1))).min(65536);
            let expected = if num >= den { 65536 } else { exact };
            assert_eq!(u64::from(ratio_q16(num, den)), expected, "{num} / {den}");
        }
    }

    #[test]
    fn an_unsigned_factor_may_have_its_top_bit() {
        let mut x = 1u32;
        for _ in 0..100_000 {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let (a, b) = (x.rotate_left(9) as i32, x);
            let exact = (i128::from(a) * i128::from(b)).div_euclid(1 << 32);
            assert_eq!(i128::from(mul_high_unsigned(a, b)), exact);
        }
        assert_eq!(mul_high_unsigned(-1, 1), -1, "rounded down");
        assert_eq!(mul_high_unsigned(i32::MIN, u32::MAX), i32::MIN, "the largest");
    }
}
