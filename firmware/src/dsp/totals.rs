//! The sums of [`crate::sor`] over all nodes in the machine's own instructions.

use super::walk::{self, Start, Walk};
use crate::geometry::Grid;
use crate::redblack::{Offsets, RedBlack};
use crate::sor::{Coupling, Totals, Unknown};
use core::arch::asm;

/// Places a turn.
const TURN: usize = if cfg!(target_arch = "riscv32") { 8 } else { walk::TURN };

/// The sums over one colour: [`Coupling::total`] of all.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn totals<const M: usize>(
    unknowns: &RedBlack<Unknown, M>,
    couplings: &RedBlack<Coupling, M>,
    (grid, colour): (&Grid, usize),
) -> Option<Totals> {
    let at = Offsets::new(grid, colour);
    let walk = Walk::new(unknowns, colour, &at)?;
    let Start { own, east, north, south, end, back } = walk.start_of(TURN);
    let each = couplings.half(colour).as_ptr().wrapping_add(at.own).wrapping_sub(back);
    let west = walk.west().doubled;
    let (mut squares_low, mut squares_high) = (0u32, 0u32);
    let (low, high): (i32, i32);
    #[cfg(target_arch = "riscv32")]
    // SAFETY: the instructions read what `Walk::new` found within the halves and as much of `each`, and write
    // registers that are given here.
    unsafe {
        asm!(concat!(include_str!("total_rv32.s"), include_str!("totals_rv32.s"), include_str!("around_rv32.s"),
                include_str!("long_turns_rv32.s")),
            ".purgem total", ".purgem around",
            own = inout(reg) own => _, east = inout(reg) east => _,
            north = inout(reg) north => _, south = inout(reg) south => _,
            each = inout(reg) each => _, end = in(reg) end,
            a = inout(reg) west => _, b = inout(reg) west => _,
            squares_low = inout(reg) squares_low, squares_high = inout(reg) squares_high,
            low = inout(reg) 0 => low, high = inout(reg) 0 => high,
            k = out(reg) _, x = inout(reg) back => _, y = out(reg) _, p = out(reg) _,
            rhs = out(reg) _, options(readonly, nostack));
    }
    #[cfg(armv7em)]
    // SAFETY: as above, but for two registers that they save on the stack beside the end.
    unsafe {
        asm!(concat!(include_str!("totals_armv7em.s"), include_str!("turns_armv7em.s")),
            "add sp, #8", "pop {{r6, r7}}",
            inout("r8") own => _, inout("r9") east => _, inout("r10") north => _,
            inout("r11") south => _, inout("lr") each => _,
            inout("r0") west => _, inout("r1") west => _,
            inout("r2") squares_low, inout("r3") squares_high,
            inout("r5") end => low, inout("r12") 0 => high, inout("r4") back => _);
    }
    Some(together([squares_low, squares_high], [low, high]))
}

/// What the instructions have summed up: squares in two words, and pistons (see [`walk::sum`]).
#[inline(always)]
pub(super) fn together([squares_low, squares_high]: [u32; 2], [low, high]: [i32; 2]) -> Totals {
    Totals {
        residual_squared: u64::from(squares_high) << 32 | u64::from(squares_low),
        doubled: walk::sum(low, high),
    }
}
