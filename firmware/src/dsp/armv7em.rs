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

use super::{put_word, word, words};
use crate::pixels::{Cut, Seen};

/// Words of a group: what is read and added up without a loop.
const GROUP: usize = 2;
/// Highest raw value of which no bit needs flipping.
const SIGNED_TOP: u16 = i16::MAX as u16;
/// One in both lanes.
const ONES: u32 = 0x0001_0001;

type Group = [u32; GROUP];

#[cfg(all(target_arch = "arm", target_feature = "dsp"))]
mod instructions {
    use core::arch::asm;

    /// Instructions as safe functions.
    macro_rules! instructions {
        ($($(#[$doc:meta])* $name:ident($($x:ident),*) = $($code:literal),*;)*) => {$(
            $(#[$doc])*
            #[inline(always)]
            pub(super) fn $name($($x: u32),*) -> u32 {
                let out: u32;
                // SAFETY: the instructions read registers and write `out` and the status flags,
                // which count as changed; they touch no memory. This module is compiled only where
                // they are part of the target.
                #[allow(unsafe_code)]
                unsafe {
                    asm!($($code),*, $($x = in(reg) $x,)* out = lateout(reg) out,
                        options(pure, nomem, nostack));
                }
                out
            }
        )*};
    }

    instructions! {
        /// max(x - y, 0) in each lane, unsigned.
        uqsub16(x, y) = "uqsub16 {out}, {x}, {y}";
        /// `sum` plus both products of the lanes, signed.
        smlad(x, y, sum) = "smlad {out}, {x}, {y}, {sum}";
        /// The larger of each lane, unsigned.
        larger(x, y) = "usub16 {out}, {x}, {y}", "sel {out}, {x}, {y}";
        /// One in each lane where x >= y, unsigned.
        reached(x, y, one, zero) = "usub16 {out}, {x}, {y}", "sel {out}, {one}, {zero}";
    }
}

/// The same instructions in portable arithmetic, so that the kernel can be tested on a PC.
#[cfg(not(all(target_arch = "arm", target_feature = "dsp")))]
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

/// A row and its floors in groups; `None` where they are not words.
#[inline(always)]
pub(crate) fn packed<'a>(raw: &'a [u16], floor: &'a [u16]) -> Option<(&'a [Group], &'a [Group])> {
    Some((words(raw)?, words(floor)?))
}

/// `x` in both lanes.
#[inline(always)]
fn both(x: u16) -> u32 {
    u32::from(x).wrapping_mul(ONES)
}

/// See [`crate::centroid::floored_row_moments`].
#[inline(always)]
pub(crate) fn row_moments(
    raw: &[Group],
    floor: &[Group],
    cut: Cut,
    seen: Option<&mut Seen>,
) -> (u32, i32) {
    match seen {
        None => moments(raw, floor, cut, |_, _| {}),
        Some(seen) => {
            let (mut peak, mut count) = (word(&seen.peak), word(&seen.saturated));
            let white = both(cut.saturation);
            let sums = moments(raw, floor, cut, |signal, raw| {
                peak = larger(signal, peak);
                let lit = reached(signal, ONES, ONES, 0);
                count = count.wrapping_add(reached(raw, white, lit, 0));
            });
            put_word(&mut seen.peak, peak);
            put_word(&mut seen.saturated, count);
            sums
        }
    }
}

#[inline(always)]
fn moments(raw: &[Group], floor: &[Group], cut: Cut, note: impl FnMut(u32, u32)) -> (u32, i32) {
    let pixels = 2 * GROUP * raw.len();
    if cut.top <= SIGNED_TOP {
        signed_moments(raw, floor, cut, note, 0)
    } else {
        let (sum, x) = signed_moments(raw, floor, cut, note, both(1 << 15));
        (sum.wrapping_add((pixels as u32) << 15), x)
    }
}

/// Sum and moment of the signals with the bits of `flip` inverted, as signed numbers.
#[inline(always)]
fn signed_moments(
    raw: &[Group],
    floor: &[Group],
    cut: Cut,
    mut note: impl FnMut(u32, u32),
    flip: u32,
) -> (u32, i32) {
    let excess = both(cut.excess);
    let last = (2 * GROUP * raw.len()) as i16 - 1;
    let (mut sum, mut x) = (0, 0);
    for (g, (raw, floor)) in raw.iter().zip(floor).enumerate() {
        for (k, (&raw, &floor)) in raw.iter().zip(floor).enumerate() {
            let signal = uqsub16(uqsub16(raw, floor), excess);
            note(signal, raw);
            let signal = signal ^ flip;
            let first = 4 * (GROUP * g + k) as i16 - last;
            sum = smlad(signal, ONES, sum);
            x = smlad(signal, word(&[first as u16, (first + 2) as u16]), x);
        }
    }
    (sum, x as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::tests::{compare, rows};

    #[test]
    fn packed_and_portable_agree_to_the_bit() {
        for top in [TOP_12, SIGNED_TOP, u16::MAX] {
            rows(4, top, |raw, floor, cut| {
                let (words, floors) = packed(raw, floor).expect("aligned");
                compare(raw, floor, cut, |seen| row_moments(words, floors, cut, seen));
            });
        }
    }

    const TOP_12: u16 = (1 << 12) - 1;
}
