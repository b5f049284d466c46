//! What segments of a level mirror show, in the machine's own instructions: [`Segment::go`] of all.
//!
//! Compiled, the loop keeps a third of what it needs on the Cortex-M7's stack. Here that is what has the least to
//! do: five addresses, and what is the same for all.
//!
//! A level mirror has piston 0 for each tip and tilt. So a piston above it can be beyond upper limits only, one below
//! it beyond lower ones, and it gives way no further than to 0.

use crate::fixed::PISTON_LIMIT;
use crate::redblack::RedBlack;
#[cfg(target_arch = "riscv32")]
use crate::segments::Lever;
use crate::segments::{ACTUATORS, Position, Segment, tilt_shift};
use crate::sor::{Node, ROOM, Unknown};
use core::arch::asm;
use core::mem::offset_of;

/// What there is of each subaperture.
pub(crate) struct Subapertures<'a> {
    pub(crate) nodes: &'a [Node],
    pub(crate) segments: &'a [Segment],
    #[cfg(target_arch = "riscv32")]
    pub(crate) levers: &'a [Lever],
    pub(crate) applied: &'a mut [[i32; 2]],
    pub(crate) positions: &'a mut [Position],
    pub(crate) heights_ulp: &'a mut [[i32; ACTUATORS]],
}

// The registers of a load are those of the fields.
const _: () = assert!(
    offset_of!(Node, place) == 0
        && size_of::<Node>() == 6
        && offset_of!(Segment, ratios) == 0
        && offset_of!(Segment, highest) == offset_of!(Segment, lowest) + 12
        && offset_of!(Unknown, doubled) == 0
        && size_of::<Unknown>() == 8
        && offset_of!(Position, piston_ulp) == 0
        && offset_of!(Position, tilt_ulp) == 4
        && size_of::<Position>() == 12
);

/// Takes `mean` off the pistons, and tells how many actuators would have gone beyond their limits.
#[allow(unsafe_code)]
#[inline(never)]
pub(crate) fn reach<const M: usize>(
    all: Subapertures<'_>,
    unknowns: &mut RedBlack<Unknown, M>,
    commands: &RedBlack<[i32; 2], M>,
    mean: i32,
    ratio_bits: u32,
) -> u32 {
    let Subapertures { nodes, segments, applied, positions, heights_ulp, .. } = all;
    let lengths = [nodes.len(), segments.len(), applied.len(), positions.len(), heights_ulp.len()];
    let count = lengths.into_iter().fold(usize::MAX, usize::min);
    #[cfg(target_arch = "riscv32")]
    let count = count.min(all.levers.len());
    if count == 0 {
        return 0;
    }
    let shift = tilt_shift(ratio_bits);
    let places = 2 * M as u32;
    let raise = ROOM.wrapping_sub(mean << 1);
    let unknowns = unknowns.halves_mut().as_flattened_mut().as_mut_ptr();
    let commands = commands.halves().as_flattened().as_ptr();
    let end = segments.as_ptr().wrapping_add(count);
    let mut saturated = 0;
    #[cfg(target_arch = "riscv32")]
    {
        // The first turn is entered behind one to eight segments.
        let back = 8 - count % 8;
        // SAFETY: the instructions go through `count` of each slice, which are as long at least, and read and write
        // fields at places that they compare with how many there are; they write registers that are given here.
        unsafe {
            asm!(include_str!("segment_turns_rv32.s"), include_str!("reach_rv32.s"),
                node = const size_of::<Node>(),
                lowest = const offset_of!(Segment, lowest), highest = const offset_of!(Segment, highest),
                segment = const size_of::<Segment>(), lever = const size_of::<Lever>(),
                nodes = inout(reg) nodes.as_ptr().wrapping_sub(back) => _,
                segments = inout(reg) segments.as_ptr().wrapping_sub(back) => _,
                levers = inout(reg) all.levers.as_ptr().wrapping_sub(back) => _,
                applied = inout(reg) applied.as_mut_ptr().wrapping_sub(back) => _,
                positions = inout(reg) positions.as_mut_ptr().wrapping_sub(back) => _,
                heights = inout(reg) heights_ulp.as_mut_ptr().wrapping_sub(back) => _,
                end = in(reg) end.wrapping_sub(8),
                unknowns = in(reg) unknowns, commands = in(reg) commands, places = in(reg) places,
                blacks = in(reg) unknowns.wrapping_add(M), raise = in(reg) raise, room = in(reg) ROOM,
                limit = in(reg) PISTON_LIMIT, shift = in(reg) shift, saturated = inout(reg) saturated,
                a = out(reg) _, b = out(reg) _, c = out(reg) _, p = out(reg) _, s = out(reg) _,
                t = out(reg) _, u = out(reg) _, v = out(reg) _, x = inout(reg) count % 8 => _,
                y = out(reg) _, options(nostack));
        }
    }
    #[cfg(armv7em)]
    {
        let shared = [
            nodes.as_ptr().expose_provenance() as u32,
            unknowns.expose_provenance() as u32,
            commands.expose_provenance() as u32,
            applied.as_mut_ptr().expose_provenance() as u32,
            raise.wrapping_neg() as u32,
            places,
            shift,
            end.addr() as u32,
        ];
        // SAFETY: as above, but for two registers that they save on the stack with a copy of `shared`.
        unsafe {
            asm!(include_str!("reach_armv7em.s"),
                blacks = const M, room = const ROOM, limit = const PISTON_LIMIT,
                lowest = const offset_of!(Segment, lowest), highest = const offset_of!(Segment, highest),
                segment = const size_of::<Segment>(),
                inout("r0") shared.as_ptr() => _, out("r1") _, out("r2") _, out("r3") _, out("r4") _,
                out("r5") _, out("r8") _, out("r9") _, inout("r10") segments.as_ptr() => _,
                inout("r11") positions.as_mut_ptr() => _, inout("r12") heights_ulp.as_mut_ptr() => _,
                inout("lr") saturated);
        }
    }
    saturated
}
