//! The integrator of [`crate::control`] in the machine's own instructions: products' upper halves.

use super::walk::{Start, Walk};
use crate::control::{Changes, INVERSES};
use crate::fixed::TILT_LIMIT;
use crate::geometry::Grid;
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

/// The new commands of one colour, of 16 x less `mean`: [`Changes::update`] of all.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn update<const M: usize>(
    open_loop: &RedBlack<[i32; 2], M>,
    command: &mut RedBlack<[i32; 2], M>,
    changes: &RedBlack<Changes, M>,
    (grid, colour): (&Grid, usize),
    [mean_x, mean_y]: [i32; 2],
) -> Option<()> {
    let at = Offsets::new(grid, colour);
    let walk = Walk::new(open_loop, colour, &at)?;
    let Start { own, east, north, south, end, back } = walk.start();
    let to = command.half_mut(colour).as_mut_ptr().wrapping_add(at.own).wrapping_sub(back);
    let each = changes.half(colour).as_ptr().wrapping_add(at.own).wrapping_sub(back);
    #[cfg(target_arch = "riscv32")]
    {
        let [west_x, west_y] = walk.west();
        // SAFETY: the instructions read what `Walk::new` found within the halves and as much of `each`, write as
        // much of `to`, and registers that are given here.
        unsafe {
            asm!(concat!(include_str!("law_rv32.s"), include_str!("long_turns_rv32.s")),
                own = inout(reg) own => _, east = inout(reg) east => _,
                north = inout(reg) north => _, south = inout(reg) south => _,
                to = inout(reg) to => _, each = inout(reg) each => _, end = in(reg) end,
                inverses = in(reg) DOUBLED.as_ptr(), hold = in(reg) Changes::HOLD,
                upper = in(reg) 0xffff_8000u32, mean_x = in(reg) mean_x, mean_y = in(reg) mean_y,
                limit = in(reg) TILT_LIMIT, room = in(reg) 2 * TILT_LIMIT - 1,
                highest = in(reg) TILT_LIMIT - 1,
                ax = inout(reg) west_x => _, ay = inout(reg) west_y => _,
                bx = inout(reg) west_x => _, by = inout(reg) west_y => _,
                x = inout(reg) back => _, y = out(reg) _, p = out(reg) _, known = out(reg) _,
                gains = out(reg) _, c = out(reg) _, d = out(reg) _,
                options(nostack));
        }
    }
    #[cfg(armv7em)]
    {
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
