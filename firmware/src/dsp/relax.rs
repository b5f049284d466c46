//! The relaxation of [`crate::sor`] in the machine's own instructions.
//!
//! Some places a turn: a node, its neighbours to the east, north and south, and its coupling have a
//! pointer each that moves once a turn; the west is the east of the place before, which two registers hold
//! in turn. Where there is no node only the east is read. So the mask decides about time, and never what a
//! piston is.

#[cfg(any(target_arch = "riscv32", armv7em))]
use super::walk::first_turn;
use crate::redblack::Offsets;
#[cfg(any(target_arch = "riscv32", armv7em))]
use crate::sor::ROOM;
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

    /// Relaxes the nodes of one colour after the other, `sweeps` times.
    pub(crate) fn relax(self, sweeps: u16) {
        for _ in 0..sweeps {
            for line in &self.lines {
                // SAFETY: `Line::new` found each pointer to be followed by as many places within its half,
                // which the lifetime lends for this value alone. A line writes its own half and reads the other.
                #[allow(unsafe_code)]
                unsafe {
                    line.relax();
                }
            }
        }
    }
}

impl Line {
    /// Relaxes each node once.
    ///
    /// # Safety
    /// The pointers are valid for as many places as there are, `own` for writes, and `west` for one.
    #[cfg(any(target_arch = "riscv32", armv7em))]
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn relax(&self) {
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
                        own = inout(reg) own.wrapping_sub(back) => _,
                        east = inout(reg) east.wrapping_sub(back) => _,
                        north = inout(reg) north.wrapping_sub(back) => _,
                        south = inout(reg) south.wrapping_sub(back) => _,
                        each = inout(reg) couplings.wrapping_sub(back) => _,
                        end = in(reg) end, a = inout(reg) west => _, b = inout(reg) west => _,
                        x = inout(reg) back => _, y = out(reg) _, p = out(reg) _,
                        $($registers)*
                        options(nostack))
                }
            };
        }
        #[cfg(target_arch = "riscv32")]
        run!(concat!(include_str!("residual_rv32.s"), include_str!("limit_rv32.s"), include_str!("relax_rv32.s"),
                include_str!("sides_rv32.s"), include_str!("long_turns_rv32.s"),
                ".purgem residual\n.purgem limit"), room = in(reg) ROOM, k = out(reg) _, rhs = out(reg) _,);
        #[cfg(armv7em)]
        run!(include_str!("relax_armv7em.s"), room = const ROOM, out("r0") _,);
    }
    /// The same in portable arithmetic, so that it can be tested on a PC.
    ///
    /// # Safety
    /// As above.
    #[cfg(not(any(target_arch = "riscv32", armv7em)))]
    #[allow(unsafe_code)]
    unsafe fn relax(&self) {
        // SAFETY: one place after the other of each, and the first one's west.
        unsafe {
            let mut west = *self.west;
            for i in 0..self.places {
                let (coupling, east) = (*self.couplings.add(i), *self.east.add(i));
                if coupling.present() {
                    let sides = [west, east, *self.north.add(i), *self.south.add(i)];
                    coupling.relax(&mut *self.own.add(i), sides);
                }
                west = east;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixed::PISTON_LIMIT;
    use crate::geometry::{Grid, MIN_ACROSS, Mask};
    use crate::redblack::{COLOURS, Place, RedBlack};

    const M: usize = 200;

    /// Pistons and right-hand sides over the formats' ranges, against 64-bit arithmetic on the mask.
    #[test]
    fn steps_are_rounded_once_and_limited() {
        let mut x = 1u32;
        let mut between = |low: i64, high: i64| {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + ((u64::from(x >> 2) * (high - low + 1) as u64) >> 30) as i64
        };
        let limit = i64::from(PISTON_LIMIT);
        for across in MIN_ACROSS..=18 {
            let mask = Mask::from_fn(across, |_, _| between(0, 5) > 0).expect("in range");
            let grid = Grid::new(across);
            let mut couplings = RedBlack::<Coupling, M>::new(Coupling::NONE);
            let mut nodes = RedBlack::<Unknown, M>::new(Unknown::default());
            let (mut pistons, mut cells) = (vec![0i64; grid.nodes], Vec::new());
            for (x, y) in mask.cells() {
                let f = grid.node(x, y);
                let beside =
                    [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
                let links = beside.map(|(x, y)| mask.contains(x, y));
                let degree = links.into_iter().filter(|&there| there).count() as i64;
                let step = (between(1 << 30, (1 << 31) - 1) / degree.max(1)) as i32;
                let coupling = Coupling::new(links).with_step(step);
                let wide = between(0, 1) * limit;
                let piston = between(-limit, limit).clamp(wide - limit, limit);
                let rhs = between(-(1 << 25), 1 << 25);
                *couplings.get_mut(Place::new::<M>(f)).expect("on the grid") = coupling;
                *nodes.get_mut(Place::new::<M>(f)).expect("on the grid") =
                    Unknown { doubled: (2 * (piston - limit) + 1) as i32, rhs: (8 * rhs) as i32 };
                pistons[f] = piston;
                cells.push((f, degree, rhs, i64::from(coupling.multiplier())));
            }
            let at = COLOURS.map(|colour| Offsets::new(&grid, colour));
            let lines = Lines::new(nodes.halves_mut(), couplings.halves(), &at).expect("room");
            lines.relax(3);
            for colour in [0, 1, 0, 1, 0, 1] {
                for &(f, degree, rhs, step) in cells.iter().filter(|(f, ..)| f % 2 == colour) {
                    let sides = [f - 1, f + 1, f - grid.stride, f + grid.stride];
                    let around: i64 = sides.into_iter().map(|f| pistons[f]).sum();
                    let r = rhs + around - degree * pistons[f];
                    pistons[f] = (pistons[f] + ((step * r + (1 << 29)) >> 30)).clamp(-limit, limit);
                }
            }
            for (f, ..) in cells {
                let node = nodes.get(Place::new::<M>(f)).expect("on the grid");
                assert_eq!(i64::from(node.piston()), pistons[f], "N = {across}, node {f}");
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
