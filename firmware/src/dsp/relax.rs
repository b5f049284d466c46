//! The relaxation of [`crate::sor`] in the machine's own instructions.
//!
//! Some places a turn: a node, its neighbours to the east, north and south, and its coupling have a
//! pointer each that moves once a turn; the west is the east of the place before, which two registers hold
//! in turn. Where there is no node only the east is read. So the mask decides about time, and never what a
//! piston is.

#[cfg(any(target_arch = "riscv32", armv7em))]
use super::walk::first_turn;
use crate::redblack::Offsets;
use crate::sor::{Coupling, Unknown};
use core::marker::PhantomData;

/// Places a turn.
#[cfg(any(target_arch = "riscv32", armv7em))]
const TURN: usize = 8;

/// The places of one colour.
#[derive(Clone, Copy, Debug)]
struct Line {
    own: *mut Unknown,
    west: *const Unknown,
    east: *const Unknown,
    north: *const Unknown,
    south: *const Unknown,
    couplings: *const Coupling,
    /// As many of each but the west, which the first place alone has.
    places: usize,
}

/// Both colours of a grid.
#[derive(Debug)]
pub(crate) struct Lines<'a> {
    lines: [Line; 2],
    halves: PhantomData<(&'a mut [Unknown], &'a [Coupling])>,
}

impl Line {
    /// `None` unless all places are within the halves.
    #[inline(always)]
    fn new<const M: usize>(
        own: *mut Unknown,
        other: *const Unknown,
        couplings: &[Coupling; M],
        at: &Offsets,
    ) -> Option<Self> {
        let last = M.checked_sub(at.places)?;
        let starts = [at.own, at.west, at.east, at.north, at.south];
        (starts.into_iter().all(|start| start <= last) && at.west < M).then_some(Self {
            own: own.wrapping_add(at.own),
            west: other.wrapping_add(at.west),
            east: other.wrapping_add(at.east),
            north: other.wrapping_add(at.north),
            south: other.wrapping_add(at.south),
            couplings: couplings.as_ptr().wrapping_add(at.own),
            places: at.places,
        })
    }
}

impl<'a> Lines<'a> {
    /// The nodes of both colours and their couplings; `None` unless they are within their halves.
    #[inline(always)]
    pub(crate) fn new<const M: usize>(
        nodes: &'a mut [[Unknown; M]; 2],
        couplings: &'a [[Coupling; M]; 2],
        at: &[Offsets; 2],
    ) -> Option<Self> {
        let ([red, black], [red_couplings, black_couplings]) = (nodes, couplings);
        let (red, black) = (red.as_mut_ptr(), black.as_mut_ptr());
        let [red_at, black_at] = at;
        Some(Self {
            lines: [
                Line::new(red, black, red_couplings, red_at)?,
                Line::new(black, red, black_couplings, black_at)?,
            ],
            halves: PhantomData,
        })
    }

    /// Relaxes the nodes of one colour after the other, `sweeps` times, with omega - 1 in Q32 and steps that are
    /// `short_by` bits short of 32 fraction bits.
    pub(crate) fn relax(self, overshoot_q32: u32, short_by: u32, sweeps: u16) {
        let [red, black] = &self.lines;
        for _ in 0..sweeps {
            // SAFETY: `Line::new` found each pointer to be followed by as many places within its half,
            // which the lifetime lends for this value alone. A line writes its own half and reads the other.
            #[allow(unsafe_code)]
            unsafe {
                red.relax::<true>(overshoot_q32, short_by);
                black.relax::<false>(overshoot_q32, short_by);
            }
        }
    }
}

impl Line {
    /// Relaxes each node once, of red ones if `RED`.
    ///
    /// # Safety
    /// The pointers are valid for as many places as there are, `own` for writes, and `west` for one.
    #[cfg(any(target_arch = "riscv32", armv7em))]
    #[cfg_attr(armv7em, allow(unused_variables, reason = "its right-hand sides are shifted"))]
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn relax<const RED: bool>(&self, overshoot_q32: u32, short_by: u32) {
        let Self { own, west, east, north, south, couplings, places } = *self;
        let back = first_turn(places, TURN);
        let end = own.wrapping_add(places).wrapping_sub(TURN);
        // SAFETY: `west` is valid.
        let west = unsafe { (*west).doubled };
        macro_rules! run {
            ($code:expr, $($registers:tt)*) => {
                // SAFETY: the instructions write registers that are given here and the nodes of `own`, and
                // read `places` places by the other pointers.
                unsafe {
                    core::arch::asm!($code,
                        red = const RED as u32, overshoot = in(reg) overshoot_q32,
                        own = inout(reg) own.wrapping_sub(back) => _,
                        east = inout(reg) east.wrapping_sub(back) => _,
                        north = inout(reg) north.wrapping_sub(back) => _,
                        south = inout(reg) south.wrapping_sub(back) => _,
                        each = inout(reg) couplings.wrapping_sub(back) => _,
                        end = in(reg) end, a = inout(reg) west => _, b = inout(reg) west => _,
                        x = inout(reg) back => _, y = out(reg) _, p = out(reg) _,
                        $($registers)* options(nostack))
                }
            };
        }
        #[cfg(target_arch = "riscv32")]
        run!(concat!(include_str!("limit_rv32.s"), include_str!("step_rv32.s"), include_str!("relax_rv32.s"),
                include_str!("around_rv32.s"), include_str!("long_turns_rv32.s"),
                ".purgem take_step\n.purgem widen\n.purgem limit\n.purgem around"),
            k = out(reg) _, rhs = out(reg) _, short_by = in(reg) short_by,);
        #[cfg(armv7em)]
        run!(include_str!("relax_armv7em.s"), out("r0") _,);
    }
    /// The same in portable arithmetic, so that it can be tested on a PC.
    ///
    /// # Safety
    /// As above.
    #[cfg(not(any(target_arch = "riscv32", armv7em)))]
    #[allow(unsafe_code)]
    unsafe fn relax<const RED: bool>(&self, overshoot_q32: u32, _: u32) {
        // SAFETY: one place after the other of each, and the first one's west.
        unsafe {
            let mut west = *self.west;
            for i in 0..self.places {
                let (coupling, east) = (*self.couplings.add(i), *self.east.add(i));
                if coupling.step > 0 {
                    let sides = [west, east, *self.north.add(i), *self.south.add(i)];
                    let colour = if RED { 0 } else { 1 };
                    coupling.relax(&mut *self.own.add(i), sides, colour, overshoot_q32);
                }
                west = east;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Grid, MIN_ACROSS, Mask};
    use crate::redblack::{COLOURS, Place, RedBlack};
    use crate::sor::ROOM;

    const M: usize = 200;

    /// Unknowns and right-hand sides over their ranges, against the equation of [`crate::sor`] over present
    /// neighbours only, in 128 bits.
    #[test]
    fn steps_are_rounded_down_and_limited() {
        let mut x = 1u32;
        let mut between = |low: i64, high: i64| {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + ((u64::from(x >> 2) * (high - low + 1) as u64) >> 30) as i64
        };
        // Half of it: where pistons of 0 are.
        let middle = i64::from(ROOM) / 2;
        for across in MIN_ACROSS..=18 {
            let mask = Mask::from_fn(across, |_, _| between(0, 5) > 0).expect("in range");
            let grid = Grid::new(across);
            let mut couplings = RedBlack::<Coupling, M>::new(Coupling::NONE);
            let mut nodes = RedBlack::<Unknown, M>::new(Unknown::default());
            for colour in COLOURS {
                nodes.half_mut(colour).fill(Unknown::absent(colour));
            }
            // 1 to 1.99.
            let overshoot = between(0, (0.99 * f64::from(1u32 << 31)) as i64) as u32 * 2;
            let (mut doubled, mut cells) = (vec![0i64; grid.nodes], Vec::new());
            for (x, y) in mask.cells() {
                let f = grid.node(x, y);
                let beside =
                    [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
                let links = beside.map(|(x, y)| mask.contains(x, y));
                let sides = [f - 1, f + 1, f - grid.stride, f + grid.stride];
                let sides: Vec<_> = sides
                    .into_iter()
                    .zip(links)
                    .filter_map(|(f, there)| there.then_some(f))
                    .collect();
                let coupling = Coupling::new(links).with_overshoot(overshoot, 1);
                let (place, red) = (Place::new::<M>(f), f.is_multiple_of(2));
                // Anywhere, or where every second node is at its end.
                let far = ((i128::from(overshoot) + (1 << 32)) << 27 >> 32) as i64;
                let u = if between(0, 1) == 0 { far } else { between(0, far) };
                let u = if red { u } else { -u };
                let degree = sides.len() as i64;
                let rhs = between(-(degree << 24), degree << 24);
                let offset = if red { 16 * middle } else { -16 * middle };
                *couplings.get_mut(place).expect("on the grid") = coupling;
                *nodes.get_mut(place).expect("on the grid") =
                    Unknown { doubled: u as i32, rhs: (4 * rhs + offset) as i32 };
                doubled[f] = if red { u - middle } else { u + middle };
                cells.push((f, sides, rhs));
            }
            let at = COLOURS.map(|colour| Offsets::new(&grid, colour));
            let lines = Lines::new(nodes.halves_mut(), couplings.halves(), &at).expect("room");
            lines.relax(overshoot, 1, 3);
            let product = |a: i64, b: i128, bits: u32| ((i128::from(a) * b) >> bits) as i64;
            for colour in [0, 1, 0, 1, 0, 1] {
                for (f, sides, rhs) in cells.iter().filter(|(f, ..)| f % 2 == colour) {
                    let degree = sides.len() as i128;
                    if degree == 0 {
                        continue;
                    }
                    // From the limit that is 0.
                    let limit = if colour == 0 { -middle } else { middle };
                    let bracket: i64 =
                        sides.iter().map(|&f| doubled[f] - limit).sum::<i64>() + 2 * rhs;
                    let step = ((1 << 32) + i128::from(overshoot) + degree) / (2 * degree);
                    let u = product(bracket, step, 31)
                        - product(doubled[*f] - limit, overshoot.into(), 32);
                    doubled[*f] = limit + if colour == 0 { u.max(0) } else { u.min(0) };
                }
            }
            for (f, ..) in cells {
                let place = Place::new::<M>(f);
                let node = nodes.get(place).expect("on the grid");
                let found = i64::from(node.doubled_piston(place.is_black::<M>()));
                assert_eq!(found, doubled[f], "N = {across}, node {f}");
            }
        }
    }

    #[test]
    fn places_beyond_a_half_are_refused() {
        let grid = Grid::new(8);
        let at = COLOURS.map(|colour| Offsets::new(&grid, colour));
        fn fits<const M: usize>(at: &[Offsets; 2]) -> bool {
            let mut nodes = RedBlack::<Unknown, M>::new(Unknown::default());
            let couplings = RedBlack::<Coupling, M>::new(Coupling::NONE);
            Lines::new(nodes.halves_mut(), couplings.halves(), at).is_some()
        }
        assert!(fits::<45>(&at));
        assert!(!fits::<44>(&at));
    }
}
