//! Two pixels of up to 12 bits at a time with ordinary 32-bit instructions, for machines without
//! others.
//!
//! A lane is 16 bits. With its top bit set before a subtraction, that bit says afterwards whether
//! the difference is negative, and no borrow leaves the lane:
//!
//! ```text
//! d = (raw + 0x8000 - excess) - floor        0x8000 - 2 x 4095 <= d < 2^16
//! s = d where its top bit is set, less that bit, else 0
//! ```
//!
//! The moment comes from running sums, as in [`crate::centroid::row_moments`], but packed: those of
//! four pairs of words, but for the last, add up to at most 6 x 2 x 4095 < 2^16 in a lane.

use super::{put_word, word, words};
use crate::pixels::{Cut, Seen};

/// Highest raw value.
const TOP: u16 = (1 << 12) - 1;
/// Most words of a row.
const WORDS: usize = 8;

/// The top bits of both lanes.
const SIGNS: u32 = 0x8000_8000;
/// One in both lanes.
const ONES: u32 = 0x0001_0001;

/// A row and its floors in words; `None` where they are not of this module's kind.
#[inline(always)]
pub(crate) fn packed<'a, const N: usize>(
    raw: &'a [u16],
    floor: &'a [u16],
    cut: Cut,
) -> Option<(&'a [u32; N], &'a [u32; N])> {
    if N == 0 || !N.is_multiple_of(4) || N > WORDS || cut.top > TOP {
        return None;
    }
    Some((words(raw)?, words(floor)?))
}

/// `x` in both lanes.
#[inline(always)]
fn both(x: u16) -> u32 {
    u32::from(x).wrapping_mul(ONES)
}

/// The lanes whose top bit is set, without it; zero for the others.
#[inline(always)]
fn positive(d: u32) -> u32 {
    let signs = d & SIGNS;
    d & signs.wrapping_sub(signs >> 15)
}

/// Sum of the lanes.
#[inline(always)]
fn lanes(x: u32) -> u32 {
    (x & 0xffff).wrapping_add(x >> 16)
}

/// The signals of a row, in words.
#[inline(always)]
fn signals<const N: usize>(raw: &[u32; N], floor: &[u32; N], cut: Cut) -> [u32; N] {
    let open = SIGNS.wrapping_sub(both(cut.excess));
    let mut signals = [0; N];
    for (signal, (raw, floor)) in signals.iter_mut().zip(raw.iter().zip(floor)) {
        *signal = positive(raw.wrapping_add(open).wrapping_sub(*floor));
    }
    signals
}

/// See [`crate::centroid::floored_row_moments`].
#[inline(always)]
pub(crate) fn row_moments<const N: usize>(
    raw: &[u32; N],
    floor: &[u32; N],
    cut: Cut,
) -> (u32, i32) {
    let signals = signals(raw, floor, cut);
    let (pairs, _) = signals.as_chunks::<2>();
    // Packed: all signals, those of the pairs' second words, and all running sums but the last.
    let (mut total, mut second, mut running) = (0u32, 0u32, 0u32);
    for &[first, next] in pairs {
        running = running.wrapping_add(total);
        second = second.wrapping_add(next);
        total = total.wrapping_add(first).wrapping_add(next);
    }
    let sum = lanes(total);
    // Half pixels: 8 pair + 4 word + 2 lane - (W - 1), W = 2 N. Of N / 2 pairs the running sums
    // count pair i (N / 2 - 1 - i) times.
    let whole = (8 * (N as u32 / 2 - 1)).wrapping_sub(2 * N as u32 - 1);
    let x = sum
        .wrapping_mul(whole)
        .wrapping_sub(lanes(running).wrapping_mul(8))
        .wrapping_add(lanes(second).wrapping_mul(4))
        .wrapping_add((total >> 16).wrapping_mul(2));
    (sum, x as i32)
}

/// See [`crate::pixels::Seen::note`].
#[inline(always)]
pub(crate) fn note<const N: usize>(raw: &[u32; N], floor: &[u32; N], cut: Cut, seen: &mut Seen) {
    // 2^15 less the largest signal of each lane.
    let mut room = SIGNS.wrapping_sub(word(&seen.peak));
    let mut saturated = word(&seen.saturated);
    // What takes a saturated pixel's lane to its top bit.
    let white = SIGNS.wrapping_sub(both(cut.saturation));
    for (signal, raw) in signals(raw, floor, cut).into_iter().zip(raw) {
        room = room.wrapping_sub(positive(signal.wrapping_add(room)));
        let counts = raw.wrapping_add(white) & signal.wrapping_add(SIGNS - ONES);
        saturated = saturated.wrapping_add((counts >> 15) & ONES);
    }
    put_word(&mut seen.peak, SIGNS.wrapping_sub(room));
    put_word(&mut seen.saturated, saturated);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::tests::{compare, rows};

    fn agree<const N: usize>() {
        rows(2 * N, TOP, |raw, floor, cut| {
            let (words, floors) = packed::<N>(raw, floor, cut).expect("aligned");
            let moments = || row_moments(words, floors, cut);
            compare(raw, floor, cut, moments, |seen| note(words, floors, cut, seen));
        });
    }

    #[test]
    fn packed_and_portable_agree_to_the_bit() {
        agree::<4>();
        agree::<8>();
    }

    #[test]
    fn other_rows_are_left_to_the_portable_kernel() {
        rows(8, u16::MAX, |raw, floor, cut| {
            assert!(packed::<4>(raw, floor, cut).is_none(), "16 bits");
            let narrow = Cut { top: TOP, ..cut };
            assert!(packed::<4>(&raw[1..], &floor[1..], narrow).is_none(), "not aligned");
            assert!(packed::<4>(&raw[2..], &floor[2..], narrow).is_none(), "too short");
            assert!(packed::<2>(&raw[..4], &floor[..4], narrow).is_none(), "too few words");
        });
    }
}
