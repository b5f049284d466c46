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
//! The moment comes from running sums, as in [`crate::centroid::row_moments`], but packed: over a
//! group of four words a lane's running sums add up to at most 10 x 4095 < 2^16.

use super::{put_word, word, words};
use crate::pixels::{Cut, Seen};

/// Words of a group.
const GROUP: usize = 4;
/// Highest raw value.
const TOP: u16 = (1 << 12) - 1;

/// The top bits of both lanes.
const SIGNS: u32 = 0x8000_8000;
/// One in both lanes.
const ONES: u32 = 0x0001_0001;

type Group = [u32; GROUP];

/// A row and its floors in groups; `None` where they are not of this module's kind.
#[inline(always)]
pub(crate) fn packed<'a>(
    raw: &'a [u16],
    floor: &'a [u16],
    cut: Cut,
) -> Option<(&'a [Group], &'a [Group])> {
    if cut.top > TOP {
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

/// What is gathered over a watched row.
struct Watch {
    /// 2^15 less the largest signal of each lane.
    room: u32,
    /// Saturated pixels of each lane.
    saturated: u32,
    /// What takes a saturated pixel's lane to its top bit.
    white: u32,
}

impl Watch {
    #[inline(always)]
    fn new(seen: &Seen, cut: Cut) -> Self {
        Self {
            room: SIGNS.wrapping_sub(word(&seen.peak)),
            saturated: word(&seen.saturated),
            white: SIGNS.wrapping_sub(both(cut.saturation)),
        }
    }

    #[inline(always)]
    fn note(&mut self, signal: u32, raw: u32) {
        self.room = self.room.wrapping_sub(positive(signal.wrapping_add(self.room)));
        let white = raw.wrapping_add(self.white) & signal.wrapping_add(SIGNS - ONES);
        self.saturated = self.saturated.wrapping_add((white >> 15) & ONES);
    }

    #[inline(always)]
    fn put(self, seen: &mut Seen) {
        put_word(&mut seen.peak, SIGNS.wrapping_sub(self.room));
        put_word(&mut seen.saturated, self.saturated);
    }
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
        Some(seen) => watched_moments(raw, floor, cut, seen),
    }
}

/// Not inlined: it needs all registers.
#[inline(never)]
fn watched_moments(raw: &[Group], floor: &[Group], cut: Cut, seen: &mut Seen) -> (u32, i32) {
    let mut watch = Watch::new(seen, cut);
    let sums = moments(raw, floor, cut, |signal, raw| watch.note(signal, raw));
    watch.put(seen);
    sums
}

#[inline(always)]
fn moments(raw: &[Group], floor: &[Group], cut: Cut, mut note: impl FnMut(u32, u32)) -> (u32, i32) {
    let open = SIGNS.wrapping_sub(both(cut.excess));
    // Sums over the row: of signals, of signals of the upper lanes, and of the pixels' pair
    // numbers times signals.
    let (mut sum, mut upper, mut pairs) = (0u32, 0u32, 0u32);
    for (g, (raw, floor)) in raw.iter().zip(floor).enumerate() {
        let (mut total, mut running) = (0u32, 0u32);
        for (&raw, &floor) in raw.iter().zip(floor) {
            let signal = positive(raw.wrapping_add(open).wrapping_sub(floor));
            note(signal, raw);
            total = total.wrapping_add(signal);
            running = running.wrapping_add(total);
        }
        let group = lanes(total);
        sum = sum.wrapping_add(group);
        upper = upper.wrapping_add(total >> 16);
        // The running sums count word k of a group 4 - k times.
        let after = (GROUP * (g + 1)) as u32;
        pairs = pairs.wrapping_add(group.wrapping_mul(after)).wrapping_sub(lanes(running));
    }
    // Half pixels: 2 (2 j + lane) - (W - 1), with 2 GROUP pixels a group.
    let last = (2 * GROUP * raw.len()) as u32 - 1;
    let x = pairs.wrapping_mul(4).wrapping_add(upper.wrapping_mul(2));
    (sum, x.wrapping_sub(sum.wrapping_mul(last)) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::tests::{compare, rows};

    #[test]
    fn packed_and_portable_agree_to_the_bit() {
        rows(8, TOP, |raw, floor, cut| {
            let (words, floors) = packed(raw, floor, cut).expect("aligned");
            compare(raw, floor, cut, |seen| row_moments(words, floors, cut, seen));
        });
    }

    #[test]
    fn other_rows_are_left_to_the_portable_kernel() {
        rows(8, u16::MAX, |raw, floor, cut| {
            assert!(packed(raw, floor, cut).is_none());
            let narrow = Cut { top: TOP, ..cut };
            assert!(packed(&raw[1..], &floor[1..], narrow).is_none(), "not aligned");
            assert!(packed(&raw[2..], &floor[2..], narrow).is_none(), "no whole groups");
        });
    }
}
