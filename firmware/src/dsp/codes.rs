//! Codes of 16 bits for actuators with a quadratic response, in RISC-V's own instructions:
//! [`crate::actuators::code`] of all.
//!
//! The base instruction set has no count of zeros: a comparison and a table of the highest byte take a third less
//! than comparisons alone. v has 31 bits and its double is what the root is of:
//!
//! ```text
//! x = v 2^12 where v < 2^19, else v       below 2^31
//! m = x 2^1, 2^5 or 2^9                   from 2^28 on, but where v < 2^7; there a cell has four v
//! ```

use crate::actuators::Response;
#[cfg(target_arch = "riscv32")]
use crate::fixed::{RISE_BITS, ROOTS};
#[cfg(target_arch = "riscv32")]
use crate::segments::ACTUATORS;

/// Below which v is shifted by 12 bits first.
const SMALL: u32 = 1 << 19;

/// By how much x is shifted, by its nine highest bits, of which the first is never set; and 32, so that half of all
/// shifts is what the root is too large by in 16 bits of fraction. (A shift has five bits.)
static SHIFTS: [u8; 512] = {
    let mut shifts = [32 + 1; 512];
    let mut byte = 1;
    while byte < 16 {
        shifts[byte] = 32 + 5;
        byte += 1;
    }
    shifts[0] = 32 + 9;
    shifts
};

/// Makes the codes of all segments that there is one of each for, whose responses and heights are
/// [short](Response::is_short) or not.
#[cfg(target_arch = "riscv32")]
#[inline(never)]
pub(crate) fn codes(
    responses: &[[Response; ACTUATORS]],
    heights_ulp: &[[i32; ACTUATORS]],
    codes: &mut [[u16; ACTUATORS]],
    is_short: bool,
) {
    if is_short {
        make::<true>(responses, heights_ulp, codes);
    } else {
        make::<false>(responses, heights_ulp, codes);
    }
}

#[cfg(target_arch = "riscv32")]
#[allow(unsafe_code)]
#[inline(always)]
fn make<const IS_SHORT: bool>(
    responses: &[[Response; ACTUATORS]],
    heights_ulp: &[[i32; ACTUATORS]],
    codes: &mut [[u16; ACTUATORS]],
) {
    use core::mem::offset_of;
    const {
        assert!(offset_of!(Response, offset) == 0);
        assert!(offset_of!(Response, slope) == 4);
    }
    let count = responses.len().min(heights_ulp.len()).min(codes.len());
    // The first turn is entered behind one segment, or two.
    let back = 2 - count % 2;
    let to = codes.as_mut_ptr();
    // SAFETY: the instructions read `count` of `responses` and `heights_ulp` and write as many of `codes`, which are
    // as long at least; they read `SHIFTS` and `ROOTS` at nine bits, and write registers that are given here.
    unsafe {
        core::arch::asm!(include_str!("codes_rv32.s"),
            is_short = const IS_SHORT as u32,
            each = inout(reg) responses.as_ptr().wrapping_sub(back) => _,
            heights = inout(reg) heights_ulp.as_ptr().wrapping_sub(back) => _,
            to = inout(reg) to.wrapping_sub(back) => _,
            end = in(reg) to.wrapping_add(count).wrapping_sub(2),
            small = in(reg) SMALL, twelve = in(reg) 12,
            shifts = in(reg) SHIFTS.as_ptr(), roots = in(reg) ROOTS.as_ptr(),
            rise = in(reg) (1 << RISE_BITS) - 1,
            h = inout(reg) count % 2 => _, v = out(reg) _, w = out(reg) _, x = out(reg) _,
            y = out(reg) _, options(nostack));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixed::{FIRST_CELL, RISE_BITS, ROOT_CELLS, ROOT_FRACTION, roots, square_root};

    /// The instructions' root of 2 v.
    fn root(roots: &[u32; ROOT_CELLS], v: u32) -> u32 {
        let first = u32::from(v < SMALL) * 12;
        let x = v << first;
        let second = u32::from(SHIFTS[(x >> 23) as usize]);
        let m = x.wrapping_shl(second);
        let cell = roots[(m >> ROOT_FRACTION) as usize];
        let rise = cell & ((1 << RISE_BITS) - 1);
        let root_q16 = cell.wrapping_add(rise.wrapping_mul(m >> (ROOT_FRACTION - RISE_BITS)));
        let r = root_q16.wrapping_shr((first + second) / 2);
        r + u32::from(r * (r + 1) < 2 * v)
    }

    #[test]
    fn a_root_is_the_nearest() {
        let roots = roots(FIRST_CELL);
        let check = |v: u32| assert_eq!(root(&roots, v), square_root(2 * v), "v = {v}");
        (0..1 << 20).for_each(check);
        // Where a root is rounded up, and one before.
        for r in 0..1 << 16 {
            let v = r * (r + 1) / 2;
            check(v);
            check(v + 1);
        }
        (0..1 << 20).map(|i: u32| i.wrapping_mul(2_654_435_761) >> 1).for_each(check);
        for cell in 0..512 {
            for shift in (1..32).step_by(2) {
                check((cell << 23) >> shift);
                check(((cell << 23) | 0x7f_ffff) >> shift);
            }
        }
    }

    #[test]
    fn a_short_product_is_the_upper_half_of_one() {
        let mut x = 1u32;
        let mut next = || {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            x
        };
        let ends = (-(1 << 25), (1 << 25) - 1);
        for _ in 0..100_000 {
            let slope = (next() >> 5) as i32;
            let response = Response { offset: i32::MAX, slope };
            assert!(response.is_short(ends) && !Response { offset: -1, slope }.is_short(ends));
            let height = next() as i32 >> 6;
            let product = i64::from(height << 6) * i64::from((slope as u32) << 5);
            let rise = response.value(height) - i64::from(response.offset);
            assert_eq!(product >> 32, rise, "{slope} {height}");
        }
        assert!(!Response { offset: i32::MAX, slope: 1 << 27 }.is_short(ends));
        assert!(!Response { offset: i32::MAX, slope: -1 }.is_short(ends));
        assert!(!Response { offset: i32::MAX, slope: 1 }.is_short((ends.0, 1 << 25)));
    }
}
