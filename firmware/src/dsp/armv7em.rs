//! Two pixels at a time with the Armv7E-M instructions on pairs of 16 bits.
//!
//! | instruction | here |
//! |---|---|
//! | UQSUB16 | saturating difference: pixel less floor less excess |
//! | SMLAD | sum of a pair times a pair of weights, added up |
//! | USUB16, SEL | the larger of two, the saturated ones |
//!
//! SMLAD is signed. Up to 15 bits a signal is what it is; of 16 bits its top bit is flipped, which
//! makes it less by 2^15: weights 2x - (W - 1) add up to zero over a row, so that this cancels in the
//! moment, and of the sum it is taken back.

use super::{put_word, word};
use crate::pixels::{Cut, Seen};

/// Highest raw value of which no bit needs flipping.
const SIGNED_TOP: u16 = i16::MAX as u16;
/// One in both lanes.
const ONES: u32 = 0x0001_0001;

#[cfg(armv7em)]
mod instructions {
    use core::arch::asm;

    /// Instructions as safe functions. The first of two must not overwrite what the second reads:
    /// its output is `out`, not `lateout`.
    macro_rules! instructions {
        ($($(#[$doc:meta])* $name:ident($($x:ident),*) = $($code:literal),* => $out:ident;)*) => {$(
            $(#[$doc])*
            #[inline(always)]
            pub(super) fn $name($($x: u32),*) -> u32 {
                let out: u32;
                // SAFETY: the instructions read registers and write `out` and the status flags,
                // which count as changed; they touch no memory. This module is compiled only where
                // they are part of the target.
                #[allow(unsafe_code)]
                unsafe {
                    asm!($($code),*, $($x = in(reg) $x,)* out = $out(reg) out,
                        options(pure, nomem, nostack));
                }
                out
            }
        )*};
    }

    instructions! {
        /// max(x - y, 0) in each lane, unsigned.
        uqsub16(x, y) = "uqsub16 {out}, {x}, {y}" => lateout;
        /// `sum` plus both products of the lanes, signed.
        smlad(x, y, sum) = "smlad {out}, {x}, {y}, {sum}" => lateout;
        /// The larger of each lane, unsigned.
        larger(x, y) = "usub16 {out}, {x}, {y}", "sel {out}, {x}, {y}" => out;
        /// One in each lane where x >= y, unsigned.
        reached(x, y, one, zero) = "usub16 {out}, {x}, {y}", "sel {out}, {one}, {zero}" => out;
    }
}

/// The same instructions in portable arithmetic, so that the kernel can be tested on a PC.
#[cfg(not(armv7em))]
mod instructions {
    fn split(x: u32) -> [u16; 2] {
        [x as u16, (x >> 16) as u16]
    }

    fn lanes(x: u32, y: u32, rule: impl Fn(u16, u16) -> u16) -> u32 {
        let ([a, b], [c, d]) = (split(x), split(y));
        u32::from(rule(a, c)) | u32::from(rule(b, d)) << 16
    }

    pub(super) fn uqsub16(x: u32, y: u32) -> u32 {
        lanes(x, y, u16::saturating_sub)
    }

    pub(super) fn smlad(x: u32, y: u32, sum: u32) -> u32 {
        let signed = |x: u32| split(x).map(|lane| i32::from(lane as i16));
        let ([a, b], [c, d]) = (signed(x), signed(y));
        (sum as i32).wrapping_add(a * c).wrapping_add(b * d) as u32
    }

    pub(super) fn larger(x: u32, y: u32) -> u32 {
        lanes(x, y, u16::max)
    }

    pub(super) fn reached(x: u32, y: u32, one: u32, zero: u32) -> u32 {
        let reached = lanes(x, y, |x, y| if x >= y { u16::MAX } else { 0 });
        (one & reached) | (zero & !reached)
    }
}

use instructions::{larger, reached, smlad, uqsub16};

/// `x` in both lanes.
#[inline(always)]
fn both(x: u16) -> u32 {
    u32::from(x).wrapping_mul(ONES)
}

/// See [`crate::centroid::floored_row_moments`].
#[inline(always)]
pub(crate) fn row_moments<const N: usize>(
    raw: &[u32; N],
    floor: &[u32; N],
    cut: Cut,
) -> (u32, i32) {
    if cut.top <= SIGNED_TOP {
        signed_moments(raw, floor, cut, 0)
    } else {
        let (sum, x) = signed_moments(raw, floor, cut, both(1 << 15));
        (sum.wrapping_add((2 * N as u32) << 15), x)
    }
}

/// Sum and moment of the signals with the bits of `flip` inverted, as signed numbers.
#[inline(always)]
fn signed_moments<const N: usize>(
    raw: &[u32; N],
    floor: &[u32; N],
    cut: Cut,
    flip: u32,
) -> (u32, i32) {
    let excess = both(cut.excess);
    let last = 2 * N as i16 - 1;
    let (mut sum, mut x) = (0, 0);
    for (k, (&raw, &floor)) in raw.iter().zip(floor).enumerate() {
        let signal = uqsub16(uqsub16(raw, floor), excess) ^ flip;
        let first = 4 * k as i16 - last;
        sum = smlad(signal, ONES, sum);
        x = smlad(signal, word(&[first as u16, (first + 2) as u16]), x);
    }
    (sum, x as i32)
}

/// See [`crate::pixels::Seen::note`].
#[inline(always)]
pub(crate) fn note<const N: usize>(raw: &[u32; N], floor: &[u32; N], cut: Cut, seen: &mut Seen) {
    let (excess, white) = (both(cut.excess), both(cut.saturation));
    let (mut peak, mut saturated) = (word(&seen.peak), word(&seen.saturated));
    for (&raw, &floor) in raw.iter().zip(floor) {
        let signal = uqsub16(uqsub16(raw, floor), excess);
        peak = larger(signal, peak);
        let lit = reached(signal, ONES, ONES, 0);
        saturated = saturated.wrapping_add(reached(raw, white, lit, 0));
    }
    put_word(&mut seen.peak, peak);
    put_word(&mut seen.saturated, saturated);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::packed;
    use crate::dsp::tests::{compare, rows};

    fn agree<const N: usize>(top: u16) {
        rows(2 * N, top, |raw, floor, cut| {
            let (words, floors) = packed::<N>(raw, floor).expect("aligned");
            let moments = || row_moments(words, floors, cut);
            compare(raw, floor, cut, moments, |seen| note(words, floors, cut, seen));
        });
    }

    #[test]
    fn packed_and_portable_agree_to_the_bit() {
        for bits in [12, 15, 16] {
            let top = ((1u32 << bits) - 1) as u16;
            agree::<4>(top);
            agree::<8>(top);
            agree::<16>(top);
        }
    }
}
