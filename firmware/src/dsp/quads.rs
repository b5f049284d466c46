//! The relaxation of [`crate::sor`] in RISC-V's own instructions for pupils of 7, 8, 15 and 16 subapertures across
//! whose nodes all have two neighbours at least, and steps of 32 fraction bits: four rows at a time. An odd number
//! has a row of padding more.
//!
//! Of one colour a row's nodes and the next one's stand in a zigzag, whose sides they share:
//!
//! ```text
//!  n          west of row    0  a   b  c  d
//! 0 e         its east          e   f  g  h
//!  1 f
//! 2 g         around 0: a + n + (e + b)      1: (e + b) + f + g
//!  3 h               2: b + c + (g + d)      3: (g + d) + h + s
//!    s
//! ```
//!
//! A node's east is the next one's west. So four nodes take six reads of neighbours in place of twelve, and ten
//! additions. Black rows go down like that, and red ones up. With the stride known all of a place is at a constant
//! from three pointers. The mask decides about time, and never what a piston is.

use super::{opaque, totals};
use crate::geometry::Grid;
use crate::sor::{Coupling, Totals, Unknown};
use core::arch::asm;

/// Relaxes the nodes of one colour after the other, `sweeps` times with omega - 1 in Q32, and tells the sums over the
/// black ones, which are final with the last step; `None`, with nothing done, where pupil or halves have another size
/// or there are no sweeps.
///
/// Not inlined: it is large.
#[inline(never)]
pub(crate) fn relax<const M: usize>(
    nodes: &mut [[Unknown; M]; 2],
    couplings: &[[Coupling; M]; 2],
    grid: &Grid,
    overshoot_q32: u32,
    sweeps: u16,
) -> Option<Totals> {
    match grid.stride {
        9 => relax_all::<9, M>(nodes, couplings, overshoot_q32, sweeps),
        17 => relax_all::<17, M>(nodes, couplings, overshoot_q32, sweeps),
        _ => None,
    }
}

#[inline(always)]
fn relax_all<const STRIDE: usize, const M: usize>(
    [red, black]: &mut [[Unknown; M]; 2],
    [red_couplings, black_couplings]: &[[Coupling; M]; 2],
    overshoot_q32: u32,
    sweeps: u16,
) -> Option<Totals> {
    // A row above and one below.
    if M < STRIDE * (STRIDE + 1) / 2 {
        return None;
    }
    let mut sums = None;
    let (red, black) = (red.as_mut_ptr(), black.as_mut_ptr());
    let (red_couplings, black_couplings) = (red_couplings.as_ptr(), black_couplings.as_ptr());
    // SAFETY: the halves have all places of the padded grid, and the colours are those of the halves.
    #[allow(unsafe_code)]
    unsafe {
        let reds = Rows::new::<STRIDE, true>(red, black, red_couplings);
        let blacks = Rows::new::<STRIDE, false>(black, red, black_couplings);
        for later in (0..sweeps).rev() {
            reds.relax::<STRIDE, true>(overshoot_q32);
            // Opaque, or the compiler makes two copies of all that.
            if opaque(later.into()) > 0 {
                blacks.relax::<STRIDE, false>(overshoot_q32);
            } else {
                sums = Some(blacks.relax_last::<STRIDE>(overshoot_q32));
            }
        }
    }
    sums
}

/// Where the nodes of one colour are, in a grid of `STRIDE` - 1 subapertures across, a multiple of four.
#[derive(Clone, Copy)]
struct Rows {
    /// The first of row 0 of the first four rows: the lowest of the red ones, the highest of the black ones.
    own: *mut Unknown,
    /// Its east.
    other: *const Unknown,
    each: *const Coupling,
    /// Behind the last four rows.
    end: *mut Unknown,
}

/// Places from row 0 to 1, and from 2 to 3.
const fn out(stride: usize, red: bool) -> isize {
    let half = stride as isize / 2;
    if red { -half } else { half + 1 }
}

/// Places from row 1 to 2.
const fn back(stride: usize, red: bool) -> isize {
    let half = stride as isize / 2;
    if red { -half - 1 } else { half }
}

/// All rows, by a step with registers of its own, and what is to be undone of its macros.
///
/// Safe where the pointers of `$rows` are those of halves with all places of the padded grid, `own` for writes: each of
/// four rows is one of the grid's, as many as it has, and their sides are in rows of the padded grid. The instructions
/// write `own` and registers that are given here.
macro_rules! run {
    ($rows:expr, $stride:expr, $red:expr, $overshoot:expr, $step:expr, $behind:expr, $($registers:tt)*) => {
        asm!(concat!(include_str!("limit_rv32.s"), include_str!("step_rv32.s"), $step,
                include_str!("quads_rv32.s"), $behind),
            stride = const $stride, out = const out($stride, $red), back = const back($stride, $red),
            red = const $red as u32, overshoot = in(reg) $overshoot,
            own = inout(reg) $rows.own => _, other = inout(reg) $rows.other => _,
            each = inout(reg) $rows.each => _, end = in(reg) $rows.end,
            a0 = out(reg) _, a1 = out(reg) _, a2 = out(reg) _, a3 = out(reg) _,
            b0 = out(reg) _, b1 = out(reg) _, b2 = out(reg) _, b3 = out(reg) _,
            k = out(reg) _, l = out(reg) _, p = out(reg) _, rhs = out(reg) _,
            shared = out(reg) _, x = out(reg) _, $($registers)* options(nostack))
    };
}

impl Rows {
    #[inline(always)]
    const fn new<const STRIDE: usize, const RED: bool>(
        own: *mut Unknown,
        other: *const Unknown,
        couplings: *const Coupling,
    ) -> Self {
        // Nodes (0, 3) and (0, 0).
        let first = if RED { 2 * STRIDE } else { STRIDE / 2 };
        Self {
            own: own.wrapping_add(first),
            // That of a red node has its own index.
            other: other.wrapping_add(if RED { first } else { first + 1 }),
            each: couplings.wrapping_add(first),
            end: own.wrapping_add(first + STRIDE * (STRIDE - 1) / 2),
        }
    }

    /// Relaxes each node once.
    ///
    /// # Safety
    /// The pointers are those of halves with all places of the padded grid, `own` for writes.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn relax<const STRIDE: usize, const RED: bool>(self, overshoot_q32: u32) {
        // SAFETY: what the caller has to see to is what `run` asks for.
        unsafe { run!(self, STRIDE, RED, overshoot_q32, include_str!("quads_step_rv32.s"), "",) }
    }

    /// The same of black nodes, for the last time, and their sums.
    ///
    /// # Safety
    /// As above.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn relax_last<const STRIDE: usize>(self, overshoot_q32: u32) -> Totals {
        let (mut squares_low, mut squares_high, mut low, mut high) = (0, 0, 0, 0);
        // SAFETY: what the caller has to see to is what `run` asks for.
        unsafe {
            run!(self, STRIDE, false, overshoot_q32,
                concat!(include_str!("total_rv32.s"), include_str!("quads_last_step_rv32.s")), ".purgem total",
                q = out(reg) _, y = out(reg) _, squares_low = inout(reg) squares_low,
                squares_high = inout(reg) squares_high, low = inout(reg) low, high = inout(reg) high,);
        }
        totals::together([squares_low, squares_high], [low, high])
    }
}
