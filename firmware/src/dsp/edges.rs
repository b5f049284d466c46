//! The right-hand side of [`crate::sor`] in the machine's own instructions.

use super::walk::{self, Start, Walk};
use crate::geometry::Grid;
use crate::redblack::{Offsets, RedBlack};
use crate::sor::{Coupling, Unknown, offset};
use core::arch::asm;

/// Places a turn.
const TURN: usize = if cfg!(target_arch = "riscv32") { 8 } else { walk::TURN };

/// The right-hand sides of one colour: [`Coupling::edges`] of all.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn load<const M: usize>(
    tilts: &RedBlack<[i32; 2], M>,
    unknowns: &mut RedBlack<Unknown, M>,
    couplings: &RedBlack<Coupling, M>,
    (grid, colour): (&Grid, usize),
) -> Option<()> {
    let at = Offsets::new(grid, colour);
    let walk = Walk::new(tilts, colour, &at)?;
    let Start { own, east, north, south, end, back } = walk.start_of(TURN);
    let to = unknowns.half_mut(colour).as_mut_ptr().wrapping_add(at.own).wrapping_sub(back);
    let each = couplings.half(colour).as_ptr().wrapping_add(at.own).wrapping_sub(back);
    let [west, _] = walk.west();
    // SAFETY: the instructions read what `Walk::new` found within the halves and as much of `each`, write as much
    // of `to`, and registers that are given here.
    #[cfg(target_arch = "riscv32")]
    unsafe {
        asm!(concat!(include_str!("edges_rv32.s"), include_str!("long_turns_rv32.s")),
            own = inout(reg) own => _, east = inout(reg) east => _,
            north = inout(reg) north => _, south = inout(reg) south => _,
            to = inout(reg) to => _, each = inout(reg) each => _, end = in(reg) end,
            a = inout(reg) west => _, b = inout(reg) west => _, offset = in(reg) offset(colour),
            x = inout(reg) back => _, y = out(reg) _, k = out(reg) _, n = out(reg) _,
            s = out(reg) _, t = out(reg) _, options(nostack));
    }
    // SAFETY: the same, but for two registers that they save on the stack.
    #[cfg(armv7em)]
    unsafe {
        asm!(concat!(include_str!("edges_armv7em.s"), include_str!("turns_armv7em.s")),
            "pop {{r6, r7}}",
            inout("r8") own => _, inout("r9") east => _, inout("r10") north => _,
            inout("r11") south => _, inout("r12") to => _, inout("lr") each => _,
            inout("r0") west => _, inout("r1") west => _, in("r2") end,
            inout("r3") offset(colour) => _, inout("r4") back => _, out("r5") _);
    }
    Some(())
}
