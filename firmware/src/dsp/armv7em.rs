//! Two pixels at a time with the Armv7E-M instructions on pairs of 16 bits.
//!
//! | instruction | here |
//! |---|---|
//! | UQSUB16 | saturating difference: pixel less floor less excess |
//! | SMLAD, SMLADX | sum of a pair times a pair of weights, added up |
//! | USUB16, SEL | the larger of two, the saturated ones |
//!
//! SMLAD is signed. Up to 15 bits a signal is what it is; of 16 bits its top bit is flipped, which
//! makes it less by 2^15: weights 2x - (W - 1) add up to zero over a row, so that this cancels in the
//! moment, and of the sum it is taken back.

use super::{Rows, put_word, word};
use crate::centroid::RowSums;
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
        /// `sum` plus both products of each lane with the other one, signed.
        smladx(x, y, sum) = "smladx {out}, {x}, {y}, {sum}" => lateout;
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

    pub(super) fn smladx(x: u32, y: u32, sum: u32) -> u32 {
        smlad(x, y.rotate_left(16), sum)
    }

    pub(super) fn larger(x: u32, y: u32) -> u32 {
        lanes(x, y, u16::max)
    }

    pub(super) fn reached(x: u32, y: u32, one: u32, zero: u32) -> u32 {
        let reached = lanes(x, y, |x, y| if x >= y { u16::MAX } else { 0 });
        (one & reached) | (zero & !reached)
    }
}

use instructions::{larger, reached, smlad, smladx, uqsub16};

/// `x` in both lanes.
#[inline(always)]
fn both(x: u16) -> u32 {
    u32::from(x).wrapping_mul(ONES)
}

/// See [`crate::centroid::floored_moments`].
#[inline(always)]
pub(crate) fn sums<const N: usize>(rows: Rows<'_, N>, cut: Cut) -> RowSums {
    if cut.top <= SIGNED_TOP {
        signed_sums(rows, cut, 0)
    } else {
        let RowSums { sum, x, running } = signed_sums(rows, cut, both(1 << 15));
        // What the flipped bits took from each row, and from each row's running sum.
        let (row, count) = ((2 * N as u32) << 15, rows.count() as u32);
        let running = running.wrapping_add((row >> 1).wrapping_mul(count.wrapping_mul(count + 1)));
        RowSums { sum: sum.wrapping_add(row.wrapping_mul(count)), x, running }
    }
}

/// Running sums of rows. Weights are 2x - (W - 1); those of a word and of its mirror image are each
/// other's negatives with the lanes exchanged, so that one serves both and the moment is
/// `left - right`.
#[derive(Clone, Copy, Default)]
struct Sums {
    sum: u32,
    left: u32,
    right: u32,
}

/// Sums of the signals with the bits of `flip` inverted, as signed numbers.
#[inline(always)]
fn signed_sums<const N: usize>(rows: Rows<'_, N>, cut: Cut, flip: u32) -> RowSums {
    let excess = both(cut.excess);
    let last = 2 * N as i16 - 1;
    let outermost = word(&[-last as u16, (2 - last) as u16]);
    let (mut sums, mut running) = (Sums::default(), 0u32);
    rows.each(|raw, floor| {
        row::add(&mut sums, raw, floor, [excess, flip, outermost]);
        running = running.wrapping_add(sums.sum);
    });
    RowSums { sum: sums.sum, x: sums.left.wrapping_sub(sums.right) as i32, running }
}

/// Half pixels from one word to the next, in both lanes.
const WORD: u32 = 4 * ONES;

/// One word after the other.
#[inline(always)]
fn add_words<const N: usize>(
    sums: &mut Sums,
    raw: &[u32; N],
    floor: &[u32; N],
    [excess, flip, outermost]: [u32; 3],
) {
    let signal = |raw: u32, floor: u32| uqsub16(uqsub16(raw, floor), excess) ^ flip;
    let (first, last) = raw.split_at(N / 2);
    let (first_floor, last_floor) = floor.split_at(N / 2);
    let mut weight = outermost;
    for (&raw, &floor) in first.iter().zip(first_floor) {
        let signal = signal(raw, floor);
        sums.sum = smlad(signal, ONES, sums.sum);
        sums.left = smlad(signal, weight, sums.left);
        weight = weight.wrapping_add(WORD);
    }
    for (&raw, &floor) in last.iter().zip(last_floor) {
        weight = weight.wrapping_sub(WORD);
        let signal = signal(raw, floor);
        sums.sum = smlad(signal, ONES, sums.sum);
        sums.right = smladx(signal, weight, sums.right);
    }
}

#[cfg(not(armv7em))]
mod row {
    pub(super) use super::add_words as add;
}

/// The rows of the common windows in instructions of their own: words are loaded by two, and twelve
/// registers are all that there are.
#[cfg(armv7em)]
mod row {
    use super::{ONES, Sums, add_words};
    use core::arch::asm;

    /// Two words: `a` and `b` become their signals.
    macro_rules! signals {
        ($offset:literal, $flip:literal) => {
            concat!(
                "ldrd {a}, {b}, [{raw}, #",
                $offset,
                "]\n",
                "ldrd {c}, {d}, [{floor}, #",
                $offset,
                "]\n",
                "uqsub16 {a}, {a}, {c}\n uqsub16 {b}, {b}, {d}\n",
                "uqsub16 {a}, {a}, {excess}\n uqsub16 {b}, {b}, {excess}\n",
                $flip,
            )
        };
    }

    /// Two words of the left half and their mirror images, between which the weight goes inwards and
    /// back again.
    macro_rules! ends {
        ($left:literal, $right:literal, $flip:literal) => {
            concat!(
                signals!($left, $flip),
                "smlad {sum}, {a}, {ones}, {sum}\n smlad {left}, {a}, {weight}, {left}\n",
                "add {weight}, {weight}, #0x00040004\n",
                "smlad {sum}, {b}, {ones}, {sum}\n smlad {left}, {b}, {weight}, {left}\n",
                signals!($right, $flip),
                "smlad {sum}, {a}, {ones}, {sum}\n smladx {right}, {a}, {weight}, {right}\n",
                "sub {weight}, {weight}, #0x00040004\n",
                "smlad {sum}, {b}, {ones}, {sum}\n smladx {right}, {b}, {weight}, {right}\n",
            )
        };
    }

    macro_rules! run {
        ($sums:ident, $raw:ident, $floor:ident, $excess:ident, $outermost:ident, $($code:expr),*) => {{
            // SAFETY: the instructions read as many words from two arrays as these have, at their
            // alignment, write registers that are given here and the status flags, which count as
            // changed, and no memory.
            #[allow(unsafe_code)]
            unsafe {
                asm!($($code),*,
                    raw = in(reg) $raw.as_ptr(), floor = in(reg) $floor.as_ptr(),
                    excess = in(reg) $excess, ones = in(reg) ONES,
                    weight = inout(reg) $outermost => _,
                    sum = inout(reg) $sums.sum, left = inout(reg) $sums.left,
                    right = inout(reg) $sums.right,
                    a = out(reg) _, b = out(reg) _, c = out(reg) _, d = out(reg) _,
                    options(pure, readonly, nostack));
            };
        }};
    }

    /// Adds a row.
    #[inline(always)]
    pub(super) fn add<const N: usize>(
        sums: &mut Sums,
        raw: &[u32; N],
        floor: &[u32; N],
        given: [u32; 3],
    ) {
        let [excess, flip, outermost] = given;
        match (N, flip) {
            (4, 0) => run!(sums, raw, floor, excess, outermost, ends!("0", "8", "")),
            (8, 0) => run!(
                sums,
                raw,
                floor,
                excess,
                outermost,
                ends!("0", "24", ""),
                "add {weight}, {weight}, #0x00080008",
                ends!("8", "16", "")
            ),
            (4, _) => run!(
                sums,
                raw,
                floor,
                excess,
                outermost,
                ends!("0", "8", "eor {a}, {a}, #0x80008000\n eor {b}, {b}, #0x80008000\n")
            ),
            (8, _) => run!(
                sums,
                raw,
                floor,
                excess,
                outermost,
                ends!("0", "24", "eor {a}, {a}, #0x80008000\n eor {b}, {b}, #0x80008000\n"),
                "add {weight}, {weight}, #0x00080008",
                ends!("8", "16", "eor {a}, {a}, #0x80008000\n eor {b}, {b}, #0x80008000\n")
            ),
            _ => add_words(sums, raw, floor, given),
        }
    }
}

/// See [`crate::pixels::Seen::note`].
#[inline(always)]
pub(crate) fn note<const N: usize>(rows: Rows<'_, N>, cut: Cut, seen: &mut Seen) {
    let (excess, white) = (both(cut.excess), both(cut.saturation));
    let (mut peak, mut saturated) = (word(&seen.peak), word(&seen.saturated));
    rows.each(|raw, floor| {
        for (&raw, &floor) in raw.iter().zip(floor) {
            let signal = uqsub16(uqsub16(raw, floor), excess);
            peak = larger(signal, peak);
            let lit = reached(signal, ONES, ONES, 0);
            saturated = saturated.wrapping_add(reached(raw, white, lit, 0));
        }
    });
    put_word(&mut seen.peak, peak);
    put_word(&mut seen.saturated, saturated);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::tests::agree;

    #[test]
    fn packed_and_portable_agree_to_the_bit() {
        for bits in [12, 15, 16] {
            let top = ((1u32 << bits) - 1) as u16;
            agree::<4>(top, sums, note);
            agree::<8>(top, sums, note);
            agree::<16>(top, sums, note);
        }
    }
}
