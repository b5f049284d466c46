//! The integrator of [`crate::control`] in the machine's own instructions: products' upper halves.

#[cfg(armv7em)]
use super::walk::{Start, Walk};
use crate::control::{Changes, INVERSES};
use crate::fixed::TILT_LIMIT;
use crate::geometry::Grid;
#[cfg(armv7em)]
use crate::redblack::COLOURS;
use crate::redblack::{Offsets, RedBlack};
use core::arch::asm;

/// [`INVERSES`] doubled, of which a product's upper half is the mean.
#[cfg(target_arch = "riscv32")]
static DOUBLED: [u32; INVERSES.len()] = {
    let mut doubled = [0; INVERSES.len()];
    let mut i = 0;
    while i < doubled.len() {
        doubled[i] = 2 * INVERSES[i] as u32;
        i += 1;
    }
    doubled
};

// Commands are limited to 24 bits, and gains and indices have theirs.
const _: () = assert!(TILT_LIMIT == 1 << 23 && Changes::HOLD == 1 << 13 && INVERSES.len() == 16);

/// Pairs of a red and a black place a turn.
#[cfg(target_arch = "riscv32")]
const TURN: usize = 6;
/// Largest `M` of which both halves are within what an instruction adds to a pointer to their middle.
#[cfg(target_arch = "riscv32")]
const REACHED: usize = 480;

/// The new commands, of 16 x less `mean`: [`Changes::update`] of all. `None` if it is for others to do.
///
/// Place by place in the order of the grid, red and black in turn: what is read as the east of one is the next one's
/// own, and the west of the one after it.
#[cfg(target_arch = "riscv32")]
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn update<const M: usize>(
    open_loop: &RedBlack<[i32; 2], M>,
    command: &mut RedBlack<[i32; 2], M>,
    changes: &RedBlack<Changes, M>,
    grid: &Grid,
    [mean_x, mean_y]: [i32; 2],
) -> Option<()> {
    let (row, places) = (grid.stride / 2, Offsets::new(grid, 0).places);
    // A black place before all red ones, and a red one behind all black ones: there is a black one more at the end.
    let (first, pairs) = (row, places + 1);
    // The south of the last place.
    if M > REACHED || grid.stride.is_multiple_of(2) || first + places + row + 1 >= M {
        return None;
    }
    let [red, black] = open_loop.halves();
    let (west, own) = (*red.get(first)?, *black.get(first)?);
    // The first turn is entered behind so many pairs and the red place of the next.
    let back = (TURN - pairs % TURN) % TURN;
    // West, own and east are in three pairs of registers in turn.
    let ([ax, ay], [bx, by], [cx, cy]) = match back % 3 {
        0 => (own, west, own),
        1 => (west, own, own),
        _ => (own, own, west),
    };
    let at = open_loop.halves().as_flattened().as_ptr().wrapping_add(first).wrapping_sub(back);
    let own = at.wrapping_byte_add(4 * M);
    let to = command.halves_mut().as_flattened_mut().as_mut_ptr();
    let each = changes.halves().as_flattened().as_ptr();
    // SAFETY: from `first` on there are `pairs` places in each half of `open_loop` with one to the east, and half a
    // row and one more to the north and to the south, as was compared with M, but for the first red place's, which is
    // a west only and never taken: the instructions read these, as much of `each`, write as much of `to`, and
    // registers that are given here.
    unsafe {
        asm!(include_str!("law_rv32.s"),
            half = const if M > REACHED { 0 } else { 4 * M },
            turn = const TURN,
            own = inout(reg) own => _,
            north = inout(reg) own.wrapping_sub(row + 1) => _,
            south = inout(reg) own.wrapping_add(row) => _,
            to = inout(reg) to.wrapping_add(first).wrapping_sub(back).wrapping_byte_add(4 * M) => _,
            each = inout(reg) each.wrapping_add(first).wrapping_sub(back).wrapping_byte_add(2 * M) => _,
            end = in(reg) own.wrapping_add(back + pairs),
            inverses = in(reg) DOUBLED.as_ptr(), hold = in(reg) Changes::HOLD,
            upper = in(reg) 0xffff_8000u32, mean_x = in(reg) mean_x, mean_y = in(reg) mean_y,
            limit = in(reg) TILT_LIMIT, room = in(reg) 2 * TILT_LIMIT - 1,
            highest = in(reg) TILT_LIMIT - 1,
            ax = inout(reg) ax => _, ay = inout(reg) ay => _, bx = inout(reg) bx => _,
            by = inout(reg) by => _, cx = inout(reg) cx => _, cy = inout(reg) cy => _,
            p = inout(reg) back => _, known = out(reg) _, gains = out(reg) _,
            c = out(reg) _, d = out(reg) _,
            options(nostack));
    }
    Some(())
}

/// The new commands, of 16 x less `mean`: [`Changes::update`] of all. `None` if it is for others to do.
#[cfg(armv7em)]
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn update<const M: usize>(
    open_loop: &RedBlack<[i32; 2], M>,
    command: &mut RedBlack<[i32; 2], M>,
    changes: &RedBlack<Changes, M>,
    grid: &Grid,
    [mean_x, mean_y]: [i32; 2],
) -> Option<()> {
    let offsets = COLOURS.map(|colour| Offsets::new(grid, colour));
    let [red, black] = &offsets;
    let walks = [Walk::new(open_loop, 0, red)?, Walk::new(open_loop, 1, black)?];
    for ((walk, at), colour) in walks.iter().zip(&offsets).zip(COLOURS) {
        let Start { own, east, north, south, end, back } = walk.start();
        let to = command.half_mut(colour).as_mut_ptr().wrapping_add(at.own).wrapping_sub(back);
        let each = changes.half(colour).as_ptr().wrapping_add(at.own).wrapping_sub(back);
        // SAFETY: the instructions read what `Walk::new` found within the halves and as much of `each`, write as
        // much of `to`, and registers that are given here, but for two that they save on the stack beside what
        // they keep there.
        unsafe {
            asm!(concat!(include_str!("law_armv7em.s"), include_str!("turns_armv7em.s")),
                "add sp, #16", "pop {{r6, r7}}",
                hold = const Changes::HOLD,
                inout("r8") own => _, inout("r9") east => _, inout("r10") north => _,
                inout("r11") south => _, inout("r12") to => _, inout("lr") each => _,
                inout("r0") mean_x => _, inout("r1") mean_y => _,
                inout("r2") INVERSES.as_ptr() => _, inout("r3") end => _,
                inout("r4") back => _, out("r5") _);
        }
    }
    Some(())
}
