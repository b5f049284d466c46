//! Fixed-point primitives of the frame path: rounding, saturation, ratios and roots.
//!
//! Every function here is branch-free in its data and exact or bounded as its documentation
//! says, so that a PC, a Cortex-M7 and a RISC-V soft core give the same bits, by one sequence of
//! instructions whatever the data. Rounding is to nearest, ties towards plus infinity, everywhere.

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

/// The upper half of `a * b`, which may be any: MULHSU on RISC-V.
#[inline(always)]
pub const fn mul_high_unsigned(a: i32, b: u32) -> i32 {
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

/// Cells of the square-root table over 2^32.
pub(crate) const ROOT_CELLS: usize = 512;
/// Bits of an argument below its cell.
pub(crate) const ROOT_FRACTION: u32 = 23;
/// Bits of an entry that hold the root's rise over its cell.
pub(crate) const RISE_BITS: u32 = 12;

/// Lines through the roots of the cells' ends in Q16, modulo 2^32, of an argument in 2^11: what they have at 0,
/// with their rises over a cell, Q4, in place of the lowest bits. For arguments from 2^28 on.
///
/// A root is stored 7/32 high: what follows from it is low by up to 1/2 for the chord and 1/16 for the argument's
/// lowest bits, high by up to 1/16 for the rise in it, and off by less than 1/8 for the rounding of both. The last
/// cell's rise is short, so that no result is 65536.
pub(crate) static ROOTS: [u32; ROOT_CELLS] =
    roots(if cfg!(target_arch = "riscv32") { FIRST_CELL } else { 0 });

/// The first cell for [`crate::dsp::codes`], which finds v of 0 to 3 in it, a quarter each: a line that is 1 or less
/// below the roots of 0, 2, 4 and 6. [`square_root`] has only 0 in it.
pub(crate) const FIRST_CELL: u32 = (1 << 26) - (1 << 22) - 1;

pub(crate) const fn roots(first: u32) -> [u32; ROOT_CELLS] {
    // 16 sqrt(2^23 cell) + 7/2, rounded.
    const fn root(cell: u64) -> u64 {
        ((cell << (ROOT_FRACTION + 12)).isqrt() + 7 * 2 + 2) >> 2
    }
    let mut table = [0; ROOT_CELLS];
    table[0] = first;
    let mut cell = 1;
    while cell < ROOT_CELLS as u32 {
        table[cell as usize] = if cell < 32 {
            // The same: the root of 8 cell, to nearest, is that of the next three even numbers or one less.
            (32 * cell).isqrt().div_ceil(2) << 26
        } else {
            let low = root(cell as u64);
            let next = root(cell as u64 + 1);
            let high = if next > (1 << 20) - 2 { (1 << 20) - 2 } else { next };
            let rise = (high - low) as u32;
            (low as u32).wrapping_sub(rise * cell) << RISE_BITS | rise
        };
        cell += 1;
    }
    table
}

/// Leading zeros rounded down to a multiple of four, 28 at most; of 0 any of these.
#[inline(always)]
fn leading_nibbles(x: u32) -> u32 {
    if cfg!(target_arch = "riscv32") {
        // The base instruction set has no count of zeros, and the library's takes twice as long. A limit
        // that the compiler does not know stays in a register: it would compare a shifted number with 0.
        let mut x = x;
        let mut shift = 0;
        let mut step = 16u32;
        while step >= 4 {
            let limit = crate::dsp::opaque(1 << (32 - step)) as u32;
            let zeros = borrow(x, limit) << step.trailing_zeros();
            x <<= zeros;
            shift += zeros;
            step /= 2;
        }
        shift
    } else {
        x.leading_zeros() & 28
    }
}

/// The integer nearest to the square root of `v`: 0 to 65536.
///
/// A table of roots, interpolated linearly on the argument shifted to its top nibble, is off by less
/// than 1/2: rounded down it is the answer n or one less. As n^2 - n < v <= n^2 + n, there is no tie.
#[inline(always)]
pub fn square_root(v: u32) -> u32 {
    let shift = leading_nibbles(v);
    let m = v.wrapping_shl(shift);
    let cell = ROOTS.get((m >> ROOT_FRACTION) as usize % ROOT_CELLS).copied().unwrap_or(0);
    let rise = cell & ((1 << RISE_BITS) - 1);
    let root_q16 = cell.wrapping_add(rise.wrapping_mul(m >> (ROOT_FRACTION - RISE_BITS)));
    // 0 to 65535: r^2 + r fits.
    let r = root_q16 >> (16 + shift / 2);
    // A borrow in place of a comparison, which could become a branch.
    r + borrow(r * r + r, v)
}

/// 1 where `a < b`, else 0.
#[inline(always)]
const fn borrow(a: u32, b: u32) -> u32 {
    a.overflowing_sub(b).1 as u32
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
    fn square_root_is_the_nearest() {
        let check = |v: u32| {
            let root = f64::from(v).sqrt();
            assert_eq!(f64::from(square_root(v)), (root + 0.5).floor(), "sqrt {v}");
        };
        // Every neighbourhood of a perfect square and of a rounding boundary, and a spread.
        for r in 0..65536u32 {
            for delta in [-1i64, 0, 1, i64::from(r), i64::from(r) + 1] {
                let v = i64::from(r) * i64::from(r) + delta;
                check(v.clamp(0, i64::from(u32::MAX)) as u32);
            }
        }
        (0..1_000_000u32).for_each(|i| check(i.wrapping_mul(2_654_435_761)));
        // Every cell's ends.
        for cell in 0..512u32 {
            for shift in (0..29).step_by(4) {
                check((cell << 23) >> shift);
                check(((cell << 23) | 0x7f_ffff) >> shift);
            }
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
