//! The integrator of [`crate::control`] in the machine's own instructions.
//!
//! The Cortex-M7 takes the products of 16 and 24 bits times 2^19, which leaves what they come to in the upper half
//! of 64 bits, rounded by what the lower one starts with; on RISC-V 32 bits do.

use super::walk::{Start, Walk};
use crate::control::{Changes, INVERSES};
use crate::fixed::TILT_LIMIT;
use crate::geometry::Grid;
use crate::redblack::{Offsets, RedBlack};
use core::arch::asm;

/// The new commands of one colour with their mean still in them, of x less `mean`, and the sums of those that
/// were measured: [`Changes::update`] of all.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn update<const M: usize>(
    open_loop: &RedBlack<[i32; 2], M>,
    command: &mut RedBlack<[i32; 2], M>,
    changes: &RedBlack<Changes, M>,
    (grid, colour): (&Grid, usize),
    [mean_x, mean_y]: [i32; 2],
) -> Option<[i64; 2]> {
    let at = Offsets::new(grid, colour);
    let walk = Walk::new(open_loop, colour, &at)?;
    let Start { own, east, north, south, end, back } = walk.start();
    let to = command.half_mut(colour).as_mut_ptr().wrapping_add(at.own).wrapping_sub(back);
    let each = changes.half(colour).as_ptr().wrapping_add(at.own).wrapping_sub(back);
    #[cfg(target_arch = "riscv32")]
    {
        let [west_x, west_y] = walk.west();
        let (mut low_c, mut high_c, mut low_d, mut high_d) = (0, 0, 0, 0);
        // SAFETY: the instructions read what `Walk::new` found within the halves and as much of `each`, write as
        // much of `to`, and registers that are given here.
        unsafe {
            asm!(concat!(include_str!("law_rv32.s"), include_str!("turns_rv32.s")),
                ".purgem change",
                own = inout(reg) own => _, east = inout(reg) east => _,
                north = inout(reg) north => _, south = inout(reg) south => _,
                to = inout(reg) to => _, each = inout(reg) each => _, end = in(reg) end,
                inverses = in(reg) INVERSES.as_ptr(), half = in(reg) Changes::HALF,
                mean_x = in(reg) mean_x, mean_y = in(reg) mean_y,
                ax = inout(reg) west_x => _, ay = inout(reg) west_y => _,
                bx = inout(reg) west_x => _, by = inout(reg) west_y => _,
                low_c = inout(reg) low_c, high_c = inout(reg) high_c,
                low_d = inout(reg) low_d, high_d = inout(reg) high_d,
                x = inout(reg) back => _, y = out(reg) _, p = out(reg) _, q = out(reg) _,
                take = out(reg) _, valid = out(reg) _, c = out(reg) _, d = out(reg) _,
                options(nostack));
        }
        Some([super::walk::sum(low_c, high_c), super::walk::sum(low_d, high_d)])
    }
    #[cfg(armv7em)]
    {
        let (low_c, high_c, low_d, high_d): (u32, i32, u32, i32);
        // SAFETY: the instructions read what `Walk::new` found within the halves and as much of `each`, write as
        // much of `to`, and registers that are given here, but for two that they save on the stack beside what
        // they keep there.
        unsafe {
            asm!(concat!(include_str!("law_armv7em.s"), include_str!("turns_armv7em.s")),
                "add sp, #16", "ldrd r0, r1, [sp], #8", "ldrd r2, r3, [sp], #8", "pop {{r6, r7}}",
                inout("r8") own => _, inout("r9") east => _, inout("r10") north => _,
                inout("r11") south => _, inout("r12") to => _, inout("lr") each => _,
                // |mean| is below 2^25, as x is.
                inout("r0") mean_x << 3 => low_c, inout("r1") mean_y << 3 => high_c,
                inout("r2") INVERSES.as_ptr() => low_d, inout("r3") end => high_d,
                inout("r4") back => _, out("r5") _);
        }
        Some(
            [(low_c, high_c), (low_d, high_d)]
                .map(|(low, high)| i64::from(high) << 32 | i64::from(low)),
        )
    }
}

/// Takes the mean off the commands of one colour, of which it is less by [`TILT_LIMIT`], and limits them to that.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn settle<const M: usize>(
    command: &mut RedBlack<[i32; 2], M>,
    changes: &RedBlack<Changes, M>,
    (grid, colour): (&Grid, usize),
    [least_c, least_d]: [i32; 2],
) -> Option<()> {
    let at = Offsets::new(grid, colour);
    let Start { own, end, back, .. } = Walk::new(command, colour, &at)?.start();
    let own = command.half_mut(colour).as_mut_ptr().with_addr(own.addr());
    let each = changes.half(colour).as_ptr().wrapping_add(at.own).wrapping_sub(back);
    // SAFETY: the instructions read and write what `Walk::new` found within the half, read as much of `each`, and
    // write registers that are given here.
    #[cfg(target_arch = "riscv32")]
    unsafe {
        asm!(concat!(include_str!("settle_rv32.s"), include_str!("turns_rv32.s")),
            own = inout(reg) own => _, each = inout(reg) each => _, end = in(reg) end,
            least_c = in(reg) least_c, least_d = in(reg) least_d,
            room = in(reg) 2 * TILT_LIMIT, limit = in(reg) TILT_LIMIT,
            x = inout(reg) back => _, y = out(reg) _, c = out(reg) _, d = out(reg) _,
            options(nostack));
    }
    // SAFETY: the same.
    #[cfg(armv7em)]
    unsafe {
        asm!(concat!(include_str!("settle_armv7em.s"), include_str!("turns_armv7em.s")),
            inout("r8") own => _, inout("lr") each => _, in("r2") end,
            in("r0") least_c, in("r1") least_d,
            room = const 2 * TILT_LIMIT, limit = const TILT_LIMIT,
            inout("r4") back => _, out("r5") _,
            options(nostack));
    }
    Some(())
}
