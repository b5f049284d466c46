//! Windows of 8 x 8 pixels that are whole in a block of rows, in RISC-V's own instructions: one after the other, with
//! nothing but the arithmetic in between.
//!
//! Pixels of up to 12 bits are taken two at a time, in the lanes of [`super::rv32`], others one at a time as in
//! [`super::rv32_wide`]. The sum of place times row comes from the bits of places: odd rows, odd pairs of them and the
//! lower half, 16 pixels of 12 bits in a lane each, with no work on single rows.

use super::rv32::{Levels, Narrow, ONES, SIGNS};
use super::{Block, words};
use crate::pixels::{Cut, Seen};
use crate::readout::{Tracking, Window};
use core::arch::asm;
use core::mem::offset_of;

/// What there is of each window.
pub(crate) struct Squares<'a> {
    /// Bytes in a frame before its first pixel.
    pub(crate) starts: &'a [usize],
    pub(crate) tracking: &'a [Tracking],
    /// 64 a window, of all windows; none where they do not start at a word's address.
    pub(crate) floors: &'a [u16],
    pub(crate) windows: &'a mut [Window],
}

/// Pixels on a side, and words of them.
const SIDE: usize = 8;
const WORDS: usize = SIDE / 2;

// Both lanes are stored as a word.
const _: () = assert!(
    (offset_of!(Window, seen) + offset_of!(Seen, peak)).is_multiple_of(4)
        && (offset_of!(Window, seen) + offset_of!(Seen, saturated)).is_multiple_of(4)
        && align_of::<Window>() == 4
        && size_of::<Seen>() == 8
);

/// Takes windows from the first on, of a block that starts with row `row`, and tells how many: less than all only
/// where one is not in it. All start at a word's address.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn take(block: Block<'_>, row: u16, cut: Cut, squares: Squares<'_>) -> usize {
    let Squares { starts, tracking, floors, windows } = squares;
    let (floors, _) = words(floors).unwrap_or_default().as_chunks::<{ SIDE * WORDS }>();
    let lengths = [starts.len(), tracking.len(), floors.len()];
    let count = lengths.into_iter().fold(windows.len(), usize::min);
    let Block { raw, stride } = block;
    // Words from a window's first to its last, of which the block may have as many once.
    let span = stride.checked_mul(SIDE - 1).and_then(|rows| rows.checked_add(WORDS));
    let Some(room) = span.and_then(|span| raw.len().checked_sub(span)) else { return 0 };
    if count == 0 {
        return 0;
    }
    let (first, stride) = (windows.as_mut_ptr(), stride.wrapping_mul(4) as u32);
    let odd = count % 2;
    let narrow = Narrow::takes::<WORDS>(&cut);
    let white = match narrow {
        true => Levels::new(cut).white,
        // The highest level that is not: what is above takes one comparison.
        false => cut.saturation.wrapping_sub(1).into(),
    };
    let shared = [
        stride.wrapping_mul(row.into()).wrapping_neg(),
        (room * 4) as u32,
        raw.as_ptr().expose_provenance() as u32,
        white,
        ONES,
        first.wrapping_add(count).addr() as u32,
    ];
    let left: *mut Window;
    macro_rules! run {
        ($code:literal, $($registers:tt)*) => {
            // SAFETY: the instructions go through `count` of each slice, which are as long at least, two a turn, of
            // which an odd first one is the second. Of `raw` they read what starts `room` words from its start at
            // most, in bytes, and has `span`; of floors those of a window. Its watched pixels are two words of its
            // rows whatever `near` is: a row is three bits of it, and the first word the sum of two comparisons. They
            // write the windows, and registers that are given here.
            unsafe {
                asm!(include_str!("square_begin_rv32.s"), include_str!($code),
                    include_str!("square_turns_rv32.s"),
                    excess = const offset_of!(Tracking, excess), near = const offset_of!(Tracking, near),
                    trackings = const size_of::<Tracking>(), windows = const size_of::<Window>(),
                    sum = const offset_of!(Window, moments.sum), mx = const offset_of!(Window, moments.x),
                    my = const offset_of!(Window, moments.y),
                    seen_peak = const offset_of!(Window, seen) + offset_of!(Seen, peak),
                    seen_saturated = const offset_of!(Window, seen) + offset_of!(Seen, saturated),
                    start = inout(reg) starts.as_ptr().wrapping_sub(odd) => _,
                    tracking = inout(reg) tracking.as_ptr().wrapping_sub(odd) => _,
                    floor = inout(reg) floors.as_ptr().wrapping_sub(odd) => _,
                    window = inout(reg) first.wrapping_sub(odd) => left,
                    shared = in(reg) shared.as_ptr(), stride = in(reg) stride, open = out(reg) _,
                    raw = out(reg) _, raw1 = out(reg) _, raw2 = out(reg) _, raw3 = out(reg) _,
                    odd = out(reg) _, pair = out(reg) _, half = out(reg) _,
                    a = inout(reg) odd => _, b = out(reg) _, c = out(reg) _, d = out(reg) _,
                    e = out(reg) _, f = out(reg) _, k0 = out(reg) _, k1 = out(reg) _, $($registers)*
                    options(nostack));
            }
        };
    }
    match narrow {
        true => run!("squares_rv32.s", k2 = out(reg) _, k3 = out(reg) _, signs = in(reg) SIGNS,
            lower = in(reg) 1 - (1 << 16),),
        false => run!("wide_squares_rv32.s",),
    }
    left.addr().wrapping_sub(first.addr()) / size_of::<Window>()
}
