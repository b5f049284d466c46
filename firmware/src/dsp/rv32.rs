//! Two pixels of up to 12 bits at a time with ordinary 32-bit instructions, for machines without
//! others.
//!
//! A lane is 16 bits. With its top bit set before a subtraction, that bit says afterwards whether
//! the difference is negative, and no borrow leaves the lane:
//!
//! ```text
//! d = (raw + 0x8000 - excess) - floor        0x8000 - 2 x 4095 <= d < 2^16
//! s = d where its top bit is set, less that bit, else 0
//! ```
//!
//! A peak so far, of 4095 at most, may come off d as well.
//!
//! Whole windows have kernels of their own, which take rows together: work on a single row is work that is not
//! pixels. That of 16 x 16 is here, that of 8 x 8 in `squares`.

use super::{Kernel, Rows, Watched, seen};
use crate::centroid::RowSums;
use crate::pixels::{Cut, Seen};

/// Highest raw value.
const TOP: u16 = (1 << 12) - 1;

/// The top bits of both lanes.
pub(super) const SIGNS: u32 = 0x8000_8000;
/// One in both lanes.
pub(super) const ONES: u32 = 0x0001_0001;

/// `x` in both lanes.
#[inline(always)]
fn both(x: u16) -> u32 {
    u32::from(x).wrapping_mul(ONES)
}

/// Words of the largest row.
const WORDS: usize = 8;

/// Sums of up to 16 rows. Of each of a row's words they are packed at first: 16 x 4095 < 2^16.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Sums {
    /// Of all pixels.
    sum: u32,
    /// Of all pixels times their word's place in its row.
    words: u32,
    /// Of the second pixels of all words.
    second: u32,
    /// Of the sums up to each row.
    running: u32,
}

/// What a kernel takes off pixels and looks for in them.
#[derive(Clone, Copy)]
pub(super) struct Levels {
    /// Takes a pixel to its lane's top bit: `SIGNS` less the excess.
    pub(super) open: u32,
    /// Takes a saturated pixel to its lane's top bit.
    pub(super) white: u32,
}

/// What is done to rows.
#[cfg(target_arch = "riscv32")]
mod row {
    use super::{Levels, ONES, Rows, SIGNS, Sums, WORDS, Watched};
    use core::arch::asm;

    /// Instructions on each row, which has `bytes`. The loop is entered at its end, so that its time
    /// is proportional to the rows, if there are any or not, and starts at a word's address: a jump
    /// into the middle of one takes a cycle more.
    macro_rules! for_each_row {
        ($bytes:literal, $($code:expr),*) => {
            concat!(
                "j 3f\n .p2align 2\n 2:\n", $($code, "\n",)*
                "add {raw}, {raw}, {stride}\n addi {floor}, {floor}, ", $bytes, "\n",
                "3: bne {floor}, {end}, 2b\n",
            )
        };
    }

    /// Two words become their signals, less their floors `c` and `d`.
    macro_rules! cut {
        ($a:literal $b:literal) => {
            concat!(
                "add ",
                $a,
                ", ",
                $a,
                ", {open}\n add ",
                $b,
                ", ",
                $b,
                ", {open}\n",
                "sub ",
                $a,
                ", ",
                $a,
                ", {c}\n sub ",
                $b,
                ", ",
                $b,
                ", {d}\n",
                "and {c}, ",
                $a,
                ", {signs}\n and {d}, ",
                $b,
                ", {signs}\n",
                "srli {e}, {c}, 15\n sub {c}, {c}, {e}\n and ",
                $a,
                ", ",
                $a,
                ", {c}\n",
                "srli {e}, {d}, 15\n sub {d}, {d}, {e}\n and ",
                $b,
                ", ",
                $b,
                ", {d}\n",
            )
        };
    }

    /// The signals of two words, from where they and their floors are. Loads stand apart from what needs
    /// them.
    macro_rules! signals {
        ($a:literal $b:literal: $first:expr, $first_floor:expr, $second:expr, $second_floor:expr) => {
            concat!(
                "lw ", $a, ", ", $first, "\n lw {c}, ", $first_floor, "\n",
                "lw ", $b, ", ", $second, "\n lw {d}, ", $second_floor, "\n", cut!($a $b),
            )
        };
    }

    /// Two words of a row, added to their columns' sums.
    macro_rules! columns {
        ($first:literal $left:literal $second:literal $right:literal) => {
            concat!(
                signals!("{a}" "{b}": concat!($first, "({raw})"),
                    concat!($first, "({floor})"),
                    concat!($second, "({raw})"),
                    concat!($second, "({floor})")
                ),
                "add {",
                $left,
                "}, {",
                $left,
                "}, {a}\n",
                "add {",
                $right,
                "}, {",
                $right,
                "}, {b}\n",
            )
        };
    }

    /// `row`, the packed sum of a row, to the sums, or the first to them. Each of its lanes is at most
    /// 8 x 4095 < 2^15: the upper half of the product has the sum of both.
    macro_rules! fold {
        (first) => {
            "mul {row}, {row}, {ones}\n srli {sum}, {row}, 16\n mv {running}, {sum}"
        };
        (later) => {
            concat!(
                "mul {row}, {row}, {ones}\n srli {row}, {row}, 16\n",
                "add {sum}, {sum}, {row}\n add {running}, {running}, {sum}",
            )
        };
    }

    /// The last of a row's columns, packed, into sums from here on: `a` and `b` of second pixels, `c` and
    /// `d` of packed ones; `a` and `c` of the columns so far, `b` and `d` of what they were after each
    /// column, which adds up to the sum of place times column.
    macro_rules! last {
        ($column:literal) => {
            concat!(
                "srli {a}, {",
                $column,
                "}, 16\n mv {b}, {a}\n",
                "mv {c}, {",
                $column,
                "}\n mv {d}, {c}\n",
            )
        };
    }

    /// The columns before it, from right to left.
    macro_rules! before {
        ($($column:literal)*) => {
            concat!($(
                "srli {e}, {", $column, "}, 16\n add {a}, {a}, {e}\n add {b}, {b}, {a}\n",
                "add {c}, {c}, {", $column, "}\n add {d}, {d}, {c}\n",
            )*)
        };
    }

    /// The first column counts among the second pixels only. `d` has lost what is above 32 bits of the
    /// upper halves, `b`: without them it is the sum over lower halves, below 28 x 2^16.
    macro_rules! first {
        ($column:literal) => {
            concat!(
                "srli {e}, {",
                $column,
                "}, 16\n add {a}, {a}, {e}\n",
                "slli {e}, {b}, 16\n sub {d}, {d}, {e}\n add {d}, {d}, {b}\n",
            )
        };
    }

    /// Gives `run` what rows of 4 or 8 words take: bytes of a row, instructions on it, what is then done
    /// to columns, and the columns' names.
    macro_rules! for_width {
        ($run:ident) => {
            if N == WORDS {
                $run!("32", concat!(
                    columns!("0" "k0" "4" "k1"), "add {row}, {a}, {b}\n",
                    columns!("8" "k2" "12" "k3"), "add {a}, {a}, {b}\n add {row}, {row}, {a}\n",
                    columns!("16" "k4" "20" "k5"), "add {a}, {a}, {b}\n add {row}, {row}, {a}\n",
                    columns!("24" "k6" "28" "k7"), "add {a}, {a}, {b}\n add {row}, {row}, {a}\n"),
                    concat!(last!("k7"), before!("k6" "k5" "k4" "k3" "k2" "k1"), first!("k0"));
                    k0, k1, k2, k3, k4, k5, k6, k7);
            } else {
                $run!("16", concat!(
                    columns!("0" "k0" "4" "k1"), "add {row}, {a}, {b}\n",
                    columns!("8" "k2" "12" "k3"), "add {a}, {a}, {b}\n add {row}, {row}, {a}\n"),
                    concat!(last!("k3"), before!("k2" "k1"), first!("k0")); k0, k1, k2, k3);
            }
        };
    }

    /// The sums of rows; `N` is 4 or 8.
    #[inline(always)]
    pub(super) fn sums<const N: usize>(rows: Rows<'_, N>, Levels { open, .. }: Levels) -> Sums {
        let Rows { raw, stride, floor } = rows;
        let floor = floor.as_flattened().as_ptr_range();
        let (sum, running, second, words): (u32, u32, u32, u32);
        macro_rules! run {
            ($bytes:literal, $row:expr, $columns:expr; $($column:ident),*) => {
                // SAFETY: the instructions write registers that are given here and no memory, and
                // read the rows only, which `Block::rows` found in their slices.
                #[allow(unsafe_code)]
                unsafe {
                    asm!($(concat!("li {", stringify!($column), "}, 0"),)*
                        "li {sum}, 0", "li {running}, 0",
                        for_each_row!($bytes, $row, fold!(later)), $columns,
                        raw = inout(reg) raw.as_ptr() => _, floor = inout(reg) floor.start => _,
                        end = in(reg) floor.end, stride = in(reg) stride.wrapping_mul(4),
                        open = in(reg) open, signs = in(reg) SIGNS, ones = in(reg) ONES,
                        $($column = out(reg) _,)*
                        sum = out(reg) sum, running = out(reg) running,
                        a = out(reg) second, b = out(reg) _, c = out(reg) _, d = out(reg) words,
                        e = out(reg) _, row = out(reg) _,
                        options(pure, readonly, nostack));
                }
            };
        }
        for_width!(run);
        Sums { sum, words, second, running }
    }

    /// Peaks and saturated pixels in their lanes. With its lane's top bit set, a signal less the first one keeps it
    /// where it is no less, and less one where it is not zero.
    #[inline(always)]
    pub(super) fn watch(
        Watched { raw: [first, second], floor: [first_floor, second_floor] }: Watched<'_>,
        Levels { open, white }: Levels,
    ) -> [u32; 2] {
        let (peak, saturated): (u32, u32);
        // SAFETY: the instructions write registers that are given here and no memory.
        #[allow(unsafe_code)]
        unsafe {
            asm!("add {peak}, {a}, {open}", "add {a}, {a}, {white}",
                "sub {peak}, {peak}, {c}", "sub {c}, {peak}, {ones}",
                "and {a}, {a}, {c}", "and {c}, {peak}, {signs}",
                "and {a}, {a}, {signs}", "srli {saturated}, {a}, 15",
                "srli {a}, {c}, 15", "sub {c}, {c}, {a}", "and {peak}, {peak}, {c}",
                "add {a}, {b}, {open}", "add {b}, {b}, {white}",
                "sub {a}, {a}, {d}", "sub {d}, {a}, {peak}",
                "sub {a}, {a}, {ones}", "and {b}, {b}, {a}",
                "and {a}, {d}, {signs}", "and {b}, {b}, {signs}",
                "srli {b}, {b}, 15", "add {saturated}, {saturated}, {b}",
                "srli {b}, {a}, 15", "sub {a}, {a}, {b}",
                "and {d}, {d}, {a}", "add {peak}, {peak}, {d}",
                a = inout(reg) *first => _, b = inout(reg) *second => _,
                c = inout(reg) *first_floor => _, d = inout(reg) *second_floor => _,
                open = in(reg) open, white = in(reg) white, signs = in(reg) SIGNS, ones = in(reg) ONES,
                peak = out(reg) peak, saturated = out(reg) saturated,
                options(pure, nomem, nostack));
        }
        [peak, saturated]
    }

    /// Two words, added to their column's sum, or its first ones.
    macro_rules! pair {
        (first $column:literal $a:literal $b:literal) => {
            concat!("add {", $column, "}, ", $a, ", ", $b, "\n")
        };
        (later $column:literal $a:literal $b:literal) => {
            concat!("add {a}, ", $a, ", ", $b, "\n add {", $column, "}, {", $column, "}, {a}\n",)
        };
    }

    /// The words of two rows at one place of theirs, added to the rows' sums and the column's.
    macro_rules! two {
        ($which:ident $column:literal: $x:literal $f0:literal $f1:literal) => {
            concat!(
                signals!("{a}" "{b}": concat!($x, "({raw})"), concat!($f0, "({floor})"),
                    concat!($x, "({raw1})"), concat!($f1, "({floor})")),
                "add {row}, {row}, {a}\n add {odd}, {odd}, {b}\n",
                pair!($which $column "{a}" "{b}"),
            )
        };
    }

    /// Two rows of 8 words, the `first` ones or `later` ones, whose floors are from `y` bytes on. Packed sums
    /// are below 2^15, as of one row.
    macro_rules! two_rows {
        ($which:ident) => {
            concat!(
                "add {raw1}, {raw}, {stride}\n",
                signals!("{row}" "{odd}": "0({raw})", "\\y({floor})",
                    "0({raw1})", "\\y + 32({floor})"),
                pair!($which "k0" "{row}" "{odd}"),
                two!($which "k1": "4" "\\y + 4" "\\y + 36"),
                two!($which "k2": "8" "\\y + 8" "\\y + 40"),
                two!($which "k3": "12" "\\y + 12" "\\y + 44"),
                two!($which "k4": "16" "\\y + 16" "\\y + 48"),
                two!($which "k5": "20" "\\y + 20" "\\y + 52"),
                two!($which "k6": "24" "\\y + 24" "\\y + 56"),
                two!($which "k7": "28" "\\y + 28" "\\y + 60"),
                "add {raw}, {raw1}, {stride}\n", fold!($which), "\n",
                "mul {odd}, {odd}, {ones}\n srli {odd}, {odd}, 16\n",
                "add {sum}, {sum}, {odd}\n add {running}, {running}, {sum}\n",
            )
        };
    }

    /// The sums of 16 x 16 pixels: two rows at a time add to a column once.
    #[inline(always)]
    fn large_square(raw: &[u32], stride: usize, floor: &[[u32; 8]; 16], open: u32) -> Sums {
        let (sum, running, second, words): (u32, u32, u32, u32);
        // SAFETY: as of `sums`; of `raw` it reads 8 words in each of 16 rows, those that have these floors.
        #[allow(unsafe_code)]
        unsafe {
            asm!(".irp y, 0", two_rows!(first), ".endr",
                ".irp y, 64, 128, 192, 256, 320, 384, 448", two_rows!(later), ".endr",
                last!("k7"), before!("k6" "k5" "k4" "k3" "k2" "k1"), first!("k0"),
                raw = inout(reg) raw.as_ptr() => _, stride = in(reg) stride.wrapping_mul(4),
                floor = in(reg) floor.as_ptr(),
                open = in(reg) open, signs = in(reg) SIGNS, ones = in(reg) ONES,
                raw1 = out(reg) _, row = out(reg) _, odd = out(reg) _,
                k0 = out(reg) _, k1 = out(reg) _, k2 = out(reg) _, k3 = out(reg) _,
                k4 = out(reg) _, k5 = out(reg) _, k6 = out(reg) _, k7 = out(reg) _,
                sum = out(reg) sum, running = out(reg) running,
                a = out(reg) second, b = out(reg) _, c = out(reg) _, d = out(reg) words,
                e = out(reg) _,
                options(pure, readonly, nostack));
        }
        Sums { sum, words, second, running }
    }

    /// The sums of a square window.
    #[inline(always)]
    pub(super) fn square_sums<const N: usize>(rows: Rows<'_, N>, levels: Levels) -> Sums {
        let Rows { raw, stride, floor } = rows;
        let floors = floor.as_flattened();
        if N == 8
            && let ([floor], []) = floors.as_chunks().0.as_chunks()
        {
            return large_square(raw, stride, floor, levels.open);
        }
        sums(rows, levels)
    }
}

/// The same in portable arithmetic, so that the kernel can be tested on a PC.
#[cfg(not(target_arch = "riscv32"))]
mod row {
    use super::{Levels, ONES, Rows, SIGNS, Sums, WORDS, Watched};

    /// The lanes whose top bit is set, without it; zero for the others.
    fn positive(d: u32) -> u32 {
        let signs = d & SIGNS;
        d & signs.wrapping_sub(signs >> 15)
    }

    pub(super) fn sums<const N: usize>(rows: Rows<'_, N>, levels: Levels) -> Sums {
        let mut sums = Sums::default();
        let mut columns = [0u32; WORDS];
        rows.each(|raw, floor| {
            for ((raw, floor), column) in raw.iter().zip(floor).zip(&mut columns) {
                let signal = positive(raw.wrapping_add(levels.open).wrapping_sub(*floor));
                *column += signal;
                sums.sum += (signal & 0xffff) + (signal >> 16);
            }
            sums.running += sums.sum;
        });
        for (place, column) in (0..).zip(columns) {
            let (first, second) = (column & 0xffff, column >> 16);
            sums.words += place * (first + second);
            sums.second += second;
        }
        sums
    }

    pub(super) fn watch(watched: Watched<'_>, levels: Levels) -> [u32; 2] {
        let (mut peak, mut saturated) = (0, 0);
        for (raw, floor) in watched.raw.iter().zip(watched.floor) {
            let signal = raw.wrapping_add(levels.open).wrapping_sub(*floor);
            let counts = raw.wrapping_add(levels.white) & signal.wrapping_sub(ONES) & SIGNS;
            saturated += counts >> 15;
            peak += positive(signal.wrapping_sub(peak));
        }
        [peak, saturated]
    }

    pub(super) use self::sums as square_sums;
}

/// The kernel of 12 bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Narrow;

impl Narrow {
    /// Whether pixels are of its kind: in rows of 4 or 8 words, of 12 bits.
    #[inline(always)]
    pub(crate) const fn takes<const N: usize>(cut: &Cut) -> bool {
        (N == 4 || N == 8) && cut.top <= TOP
    }
}

impl Levels {
    #[inline(always)]
    pub(super) fn new(cut: Cut) -> Self {
        let below = |level: u16| SIGNS.wrapping_sub(both(level));
        Self { open: below(cut.excess), white: below(cut.saturation) }
    }
}

impl Sums {
    /// Of rows of `N` words.
    #[inline(always)]
    fn finish<const N: usize>(self) -> RowSums {
        let Self { sum, words, second, running } = self;
        // Half pixels: 4 word + 2 lane - (W - 1), W = 2 N.
        let x = words.wrapping_mul(4).wrapping_add(second.wrapping_mul(2));
        let x = x.wrapping_sub(sum.wrapping_mul(2 * N as u32 - 1)) as i32;
        RowSums { sum, x, running }
    }
}

impl<const N: usize> Kernel<N> for Narrow {
    #[inline(always)]
    fn sums(self, rows: Rows<'_, N>, cut: Cut) -> RowSums {
        row::sums(rows, Levels::new(cut)).finish::<N>()
    }

    #[inline(always)]
    fn watch(self, watched: Watched<'_>, cut: Cut) -> Seen {
        let [peak, saturated] = row::watch(watched, Levels::new(cut));
        seen(peak, saturated)
    }

    #[inline(always)]
    fn window(self, rows: Rows<'_, N>, watched: Watched<'_>, cut: Cut) -> (RowSums, Seen) {
        let seen = Kernel::<N>::watch(self, watched, cut);
        (row::square_sums(rows, Levels::new(cut)).finish::<N>(), seen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::tests::agree;

    #[test]
    fn packed_and_portable_agree_to_the_bit() {
        agree::<8, 4>(TOP, Narrow);
        agree::<16, 8>(TOP, Narrow);
    }

    #[test]
    fn other_rows_are_not_taken() {
        let cut = Cut {
            convention: crate::pixels::Convention::Subtract,
            shift: 0,
            top: TOP,
            saturation: 1,
            excess: 0,
        };
        assert!(Narrow::takes::<4>(&cut));
        assert!(!Narrow::takes::<4>(&Cut { top: TOP + 1, ..cut }), "13 bits");
        assert!(!Narrow::takes::<2>(&cut), "too few words");
    }
}
