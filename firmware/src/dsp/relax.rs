//! The relaxation of [`crate::sor`] in the machine's own instructions.
//!
//! Four places a turn: a node, its neighbours to the east, north and south, and its coupling have a
//! pointer each that moves once a turn; the west is the east of the place before, which two registers hold
//! in turn. Where there is no node only the east is read. So the mask decides about time, and never what a
//! piston is.

use crate::redblack::Offsets;
use crate::sor::{Coupling, ROOM, Unknown};
use core::marker::PhantomData;

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
            #[allow(unsafe_code)]
            // SAFETY: `Line::new` found each pointer to be followed by as many places within its half, which
            // the lifetime lends for this value alone. A line writes its own half and reads the other.
            self.lines.iter().for_each(|line| unsafe { line.relax() });
        }
    }
}

/// A place, by its bytes from where the pointers of nodes are, those of its right-hand side and those
/// from its coupling's. `west` becomes the place's own; `east` is the next one's west.
///
/// 2 r << 2 by the coupling, its upper half added; then the piston's upper limit, its lower one, and the
/// last bit.
#[cfg(target_arch = "riscv32")]
macro_rules! place {
    ($node:literal $rhs:literal $coupling:literal $west:literal $east:literal) => {
        // Loads stand apart from what needs them.
        concat!(
            "lw {k}, ",
            $coupling,
            "({couplings})\n lw ",
            $east,
            ", ",
            $node,
            "({east})\n",
            "beqz {k}, 9f\n",
            "lw {x}, ",
            $node,
            "({north})\n lw {y}, ",
            $node,
            "({south})\n",
            "lw {p}, ",
            $node,
            "({own})\n lw {b}, ",
            $rhs,
            "({own})\n",
            "add ",
            $west,
            ", ",
            $west,
            ", ",
            $east,
            "\n add {x}, {x}, {y}\n",
            "andi {y}, {k}, 7\n mul {y}, {y}, {p}\n",
            "add ",
            $west,
            ", ",
            $west,
            ", {x}\n add ",
            $west,
            ", ",
            $west,
            ", {b}\n",
            "sub ",
            $west,
            ", ",
            $west,
            ", {y}\n slli ",
            $west,
            ", ",
            $west,
            ", 2\n",
            "mulh ",
            $west,
            ", ",
            $west,
            ", {k}\n add {p}, {p}, ",
            $west,
            "\n",
            "srai {x}, {p}, 31\n and {p}, {p}, {x}\n",
            "add {x}, {p}, {room}\n srai {y}, {x}, 31\n and {x}, {x}, {y}\n sub {p}, {p}, {x}\n",
            "ori {p}, {p}, 1\n sw {p}, ",
            $node,
            "({own})\n",
            "9:\n",
        )
    };
}

/// The same; the limit is one that an instruction can hold.
#[cfg(armv7em)]
macro_rules! place {
    ($node:literal $rhs:literal $coupling:literal $west:literal $east:literal) => {
        concat!(
            "ldr r0, [{couplings}, #",
            $coupling,
            "]\n ldr ",
            $east,
            ", [{east}, #",
            $node,
            "]\n",
            "cbz r0, 9f\n",
            "ldr {x}, [{north}, #",
            $node,
            "]\n ldr {y}, [{south}, #",
            $node,
            "]\n",
            "add ",
            $west,
            ", ",
            $east,
            "\n add {x}, {y}\n add ",
            $west,
            ", {x}\n",
            "ldrd {p}, {y}, [{own}, #",
            $node,
            "]\n add ",
            $west,
            ", {y}\n",
            "and {y}, r0, #7\n mls ",
            $west,
            ", {p}, {y}, ",
            $west,
            "\n",
            "lsl ",
            $west,
            ", ",
            $west,
            ", #2\n smmul ",
            $west,
            ", ",
            $west,
            ", r0\n",
            "add {p}, ",
            $west,
            "\n and {p}, {p}, {p}, asr #31\n",
            "add {x}, {p}, #{room}\n and {x}, {x}, {x}, asr #31\n sub {p}, {x}\n",
            "orr {p}, {p}, #1\n str {p}, [{own}, #",
            $node,
            "]\n",
            "9:\n",
        )
    };
}

impl Line {
    /// Relaxes each node once.
    ///
    /// # Safety
    /// The pointers are valid for as many places as there are, `own` for writes, and `west` for one.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn relax(&self) {
        let Self { own, west, east, north, south, couplings, places } = *self;
        // Places by which the first turn's pointers are before the first place: it is entered behind them.
        let back = 4 - places % 4;
        let end = own.wrapping_add(places).wrapping_sub(4);
        // SAFETY: `west` is valid.
        let west = unsafe { (*west).doubled };
        macro_rules! run {
            ($enter:literal, $turn:literal, $again:literal, $($end:tt)*) => {
                // SAFETY: the instructions write registers that are given here and the nodes of `own`, and
                // read `places` places by the other pointers.
                unsafe {
                    core::arch::asm!($enter, $turn,
                        place!("0" "4" "0" "{w0}" "{w1}"),
                        "3:", place!("8" "12" "4" "{w1}" "{w0}"),
                        "4:", place!("16" "20" "8" "{w0}" "{w1}"),
                        "5:", place!("24" "28" "12" "{w1}" "{w0}"),
                        $again,
                        own = inout(reg) own.wrapping_sub(back) => _,
                        east = inout(reg) east.wrapping_sub(back) => _,
                        north = inout(reg) north.wrapping_sub(back) => _,
                        south = inout(reg) south.wrapping_sub(back) => _,
                        couplings = inout(reg) couplings.wrapping_sub(back) => _,
                        end = in(reg) end, w0 = inout(reg) west => _, w1 = inout(reg) west => _,
                        x = inout(reg) back => _, y = out(reg) _, p = out(reg) _,
                        $($end)* options(nostack))
                }
            };
        }
        #[cfg(target_arch = "riscv32")]
        run!(".option push\n .option norvc\n .p2align 2\n addi {x}, {x}, -2\n bltz {x}, 3f\n beqz {x}, 4f\n addi {x}, {x}, -1\n beqz {x}, 5f\n j 6f",
            "2: addi {couplings}, {couplings}, 16\n addi {own}, {own}, 32\n addi {east}, {east}, 32\n addi {north}, {north}, 32\n addi {south}, {south}, 32",
            "6: bne {own}, {end}, 2b\n .option pop",
            room = in(reg) ROOM, k = out(reg) _, b = out(reg) _,);
        #[cfg(armv7em)]
        run!("cmp {x}, #2\n blt 3f\n beq 4f\n cmp {x}, #3\n beq 5f\n b 6f",
            "2: add {couplings}, #16\n add {own}, #32\n add {east}, #32\n add {north}, #32\n add {south}, #32",
            "6: cmp {own}, {end}\n bne 2b",
            room = const ROOM, out("r0") _,);
    }
}
