//! Pixels of more than 12 bits with ordinary 32-bit instructions, one at a time: eight instructions
//! each, in loops of a row. Windows of 8 x 8 pixels have a kernel of their own, in `squares`.
//!
//! ```text
//! d = raw - floor - excess        s = d [d > 0]: a multiplication takes a cycle, and a mask two
//! sum += s                        before += sum
//! ```
//!
//! `before` adds up to the sum over pixels x of (W - x) s, which gives the moment without a
//! multiplication a pixel, as in [`crate::centroid::row_moments`]: below 16 x 136 x 65535 < 2^28.

use super::{Kernel, Rows, Watched, halves};
use crate::centroid::{RowSums, signals};
use crate::pixels::{Cut, Seen};

/// Sums of rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Sums {
    /// Of all pixels.
    sum: u32,
    /// Of the sums up to each pixel of its row.
    before: u32,
    /// Of the sums up to each row.
    running: u32,
}

#[cfg(target_arch = "riscv32")]
mod row {
    use super::{Rows, Sums};
    use core::arch::asm;

    /// Two pixels of a row. Loads stand apart from what needs them.
    macro_rules! pixels {
        ($($first:literal $second:literal)*) => {
            concat!($(
                "lhu {a}, ", $first, "({raw})\n lhu {c}, ", $first, "({floor})\n",
                "lhu {b}, ", $second, "({raw})\n lhu {d}, ", $second, "({floor})\n",
                "sub {a}, {a}, {c}\n sub {b}, {b}, {d}\n",
                "sub {a}, {a}, {excess}\n sub {b}, {b}, {excess}\n",
                "sgtz {c}, {a}\n sgtz {d}, {b}\n mul {a}, {a}, {c}\n mul {b}, {b}, {d}\n",
                "add {row}, {row}, {a}\n add {before}, {before}, {row}\n",
                "add {row}, {row}, {b}\n add {before}, {before}, {row}\n",
            )*)
        };
    }

    /// See [`super::sums`]; `N` is 4 or 8.
    #[inline(always)]
    pub(super) fn sums<const N: usize>(rows: Rows<'_, N>, excess: u32) -> Sums {
        let Rows { raw, stride, floor } = rows;
        let floor = floor.as_flattened().as_ptr_range();
        let (sum, before, running): (u32, u32, u32);
        macro_rules! run {
            ($bytes:literal, $pixels:expr) => {{
                // SAFETY: the instructions write registers that are given here and no memory, and
                // read the rows only, which `Rows::new` found in their slices.
                #[allow(unsafe_code)]
                unsafe {
                    // Entered at its end, at a word's address: its time is proportional to the rows.
                    asm!("li {sum}, 0", "li {before}, 0", "li {running}, 0",
                        "j 3f\n .p2align 2\n 2: li {row}, 0",
                        $pixels,
                        "add {sum}, {sum}, {row}", "add {running}, {running}, {sum}",
                        "add {raw}, {raw}, {stride}",
                        concat!("addi {floor}, {floor}, ", $bytes),
                        "3: bne {floor}, {end}, 2b",
                        raw = inout(reg) raw.as_ptr() => _, floor = inout(reg) floor.start => _,
                        end = in(reg) floor.end, stride = in(reg) stride.wrapping_mul(4),
                        excess = in(reg) excess,
                        sum = out(reg) sum, before = out(reg) before, running = out(reg) running,
                        a = out(reg) _, b = out(reg) _, c = out(reg) _, d = out(reg) _,
                        row = out(reg) _,
                        options(pure, readonly, nostack));
                };
            }};
        }
        if N == 8 {
            run!(
                "32",
                pixels!("0" "2" "4" "6" "8" "10" "12" "14"
                "16" "18" "20" "22" "24" "26" "28" "30")
            );
        } else {
            run!("16", pixels!("0" "2" "4" "6" "8" "10" "12" "14"));
        }
        Sums { sum, before, running }
    }
}

/// The same in portable arithmetic, so that the kernel can be tested on a PC.
#[cfg(not(target_arch = "riscv32"))]
mod row {
    use super::{Rows, Sums};

    pub(super) fn sums<const N: usize>(rows: Rows<'_, N>, excess: u32) -> Sums {
        let mut sums = Sums::default();
        rows.each(|raw, floor| {
            let mut row = 0;
            for (raw, floor) in raw.iter().zip(floor) {
                for shift in [0, 16] {
                    let pixel = |word: u32| (word >> shift & 0xffff) as i32;
                    row += (pixel(*raw) - pixel(*floor) - excess as i32).max(0) as u32;
                    sums.before += row;
                }
            }
            sums.sum += row;
            sums.running += sums.sum;
        });
        sums
    }
}

/// The kernel of up to 16 bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wide;

impl Wide {
    /// Whether pixels are of its kind: in rows of 4 or 8 words.
    #[inline(always)]
    pub(crate) const fn takes<const N: usize>() -> bool {
        N == 4 || N == 8
    }
}

impl Sums {
    /// Of rows of `N` words.
    #[inline(always)]
    fn finish<const N: usize>(self) -> RowSums {
        let Self { sum, before, running } = self;
        let x = sum.wrapping_mul(2 * N as u32 + 1).wrapping_sub(before.wrapping_mul(2)) as i32;
        RowSums { sum, x, running }
    }
}

impl<const N: usize> Kernel<N> for Wide {
    #[inline(always)]
    fn sums(self, rows: Rows<'_, N>, cut: Cut) -> RowSums {
        row::sums(rows, cut.excess.into()).finish::<N>()
    }

    #[inline(always)]
    fn watch(self, watched: Watched<'_>, cut: Cut) -> Seen {
        let (raw, floor) = (halves(watched.raw), halves(watched.floor));
        Seen::of(signals(raw, floor, cut), raw, cut)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::tests::agree;

    #[test]
    fn other_rows_are_not_taken() {
        assert!(Wide::takes::<4>());
        assert!(!Wide::takes::<2>(), "too few words");
    }

    #[test]
    fn agrees_with_the_portable_kernel() {
        for bits in [8, 13, 16] {
            let top = ((1u32 << bits) - 1) as u16;
            agree::<8, 4>(top, Wide);
            agree::<16, 8>(top, Wide);
        }
    }
}
