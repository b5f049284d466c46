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

use super::{Rows, put_word, word};
use crate::centroid::RowSums;
use crate::pixels::{Cut, Seen};

/// Highest raw value.
const TOP: u16 = (1 << 12) - 1;

/// The top bits of both lanes.
const SIGNS: u32 = 0x8000_8000;
/// One in both lanes.
const ONES: u32 = 0x0001_0001;

/// `x` in both lanes.
#[inline(always)]
fn both(x: u16) -> u32 {
    u32::from(x).wrapping_mul(ONES)
}

/// Words of the largest row.
const WORDS: usize = 8;

/// Sums of up to 16 rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Sums {
    /// Of each of a row's words, packed: 16 x 4095 < 2^16.
    columns: [u32; WORDS],
    /// Of all pixels.
    sum: u32,
    /// Of the sums up to each row.
    running: u32,
}

/// What a pixel less its floor and an excess is raised by to be no less than 0: with 12 bits each it
/// stays below 2^14.
const RAISE: u16 = 2 * TOP;

/// What is looked for in the watched rows, and what was found in each lane so far.
#[derive(Clone, Copy)]
struct Watch {
    /// Raises a pixel: `RAISE` less the excess.
    raise: u32,
    /// Takes a saturated pixel to its lane's top bit.
    white: u32,
    /// Takes a raised signal to its lane's top bit.
    lit: u32,
    /// 2^15 less the largest raised pixel.
    room: u32,
    /// Saturated pixels.
    saturated: u32,
}

/// What is done to rows.
#[cfg(target_arch = "riscv32")]
mod row {
    use super::{ONES, Rows, SIGNS, Sums, WORDS, Watch};
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

    /// Two words of a row: `a` and `b` become their signals, which their columns' sums get. Loads
    /// stand apart from what needs them.
    macro_rules! signals {
        ($first:literal $left:literal $second:literal $right:literal) => {
            concat!(
                "lw {a}, ",
                $first,
                "({raw})\n lw {c}, ",
                $first,
                "({floor})\n",
                "lw {b}, ",
                $second,
                "({raw})\n lw {d}, ",
                $second,
                "({floor})\n",
                "add {a}, {a}, {open}\n add {b}, {b}, {open}\n",
                "sub {a}, {a}, {c}\n sub {b}, {b}, {d}\n",
                "and {c}, {a}, {signs}\n and {d}, {b}, {signs}\n",
                "srli {e}, {c}, 15\n sub {c}, {c}, {e}\n and {a}, {a}, {c}\n",
                "srli {e}, {d}, 15\n sub {d}, {d}, {e}\n and {b}, {b}, {d}\n",
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

    /// `row`, the packed sum of a row, to the sums. Each of its lanes is at most 8 x 4095 < 2^15: the
    /// upper half of the product has the sum of both.
    macro_rules! fold {
        () => {
            concat!(
                "mul {row}, {row}, {ones}\n srli {row}, {row}, 16\n",
                "add {sum}, {sum}, {row}\n add {running}, {running}, {sum}",
            )
        };
    }

    /// The sums of rows; `N` is 4 or 8.
    #[inline(always)]
    pub(super) fn sums<const N: usize>(rows: Rows<'_, N>, open: u32) -> Sums {
        let Rows { raw, stride, floor } = rows;
        let floor = floor.as_flattened().as_ptr_range();
        let (k0, k1, k2, k3, sum, running): (u32, u32, u32, u32, u32, u32);
        let [mut k4, mut k5, mut k6, mut k7] = [0u32; WORDS / 2];
        macro_rules! run {
            ($code:expr; $($column:ident),*) => {
                // SAFETY: the instructions write registers that are given here and no memory, and
                // read the rows only, which `Rows::new` found in their slices.
                #[allow(unsafe_code)]
                unsafe {
                    asm!($(concat!("li {", stringify!($column), "}, 0"),)*
                        "li {sum}, 0", "li {running}, 0", $code,
                        raw = inout(reg) raw.as_ptr() => _, floor = inout(reg) floor.start => _,
                        end = in(reg) floor.end, stride = in(reg) stride.wrapping_mul(4),
                        open = in(reg) open, signs = in(reg) SIGNS, ones = in(reg) ONES,
                        $($column = out(reg) $column,)*
                        sum = out(reg) sum, running = out(reg) running,
                        a = out(reg) _, b = out(reg) _, c = out(reg) _, d = out(reg) _,
                        e = out(reg) _, row = out(reg) _,
                        options(pure, readonly, nostack));
                }
            };
        }
        if N == WORDS {
            run!(for_each_row!("32",
                signals!("0" "k0" "4" "k1"), "add {row}, {a}, {b}",
                signals!("8" "k2" "12" "k3"), "add {a}, {a}, {b}\n add {row}, {row}, {a}",
                signals!("16" "k4" "20" "k5"), "add {a}, {a}, {b}\n add {row}, {row}, {a}",
                signals!("24" "k6" "28" "k7"), "add {a}, {a}, {b}\n add {row}, {row}, {a}",
                fold!()); k0, k1, k2, k3, k4, k5, k6, k7);
        } else {
            run!(for_each_row!("16",
                signals!("0" "k0" "4" "k1"), "add {row}, {a}, {b}",
                signals!("8" "k2" "12" "k3"), "add {a}, {a}, {b}\n add {row}, {row}, {a}",
                fold!()); k0, k1, k2, k3);
        }
        Sums { columns: [k0, k1, k2, k3, k4, k5, k6, k7], sum, running }
    }

    /// Looks at two words.
    macro_rules! note {
        ($first:literal $second:literal) => {
            concat!(
                "lw {a}, ",
                $first,
                "({raw})\n lw {c}, ",
                $first,
                "({floor})\n",
                "lw {b}, ",
                $second,
                "({raw})\n lw {d}, ",
                $second,
                "({floor})\n",
                note!("{a}", "{c}"),
                note!("{b}", "{d}"),
            )
        };
        ($word:literal, $floor:literal) => {
            concat!(
                "add {e}, ",
                $word,
                ", {raise}\n add ",
                $word,
                ", ",
                $word,
                ", {white}\n",
                "sub {e}, {e}, ",
                $floor,
                "\n add ",
                $floor,
                ", {e}, {room}\n",
                "add {e}, {e}, {lit}\n and {f}, ",
                $floor,
                ", {signs}\n",
                "and ",
                $word,
                ", ",
                $word,
                ", {e}\n srli {e}, {f}, 15\n",
                "srli ",
                $word,
                ", ",
                $word,
                ", 15\n sub {f}, {f}, {e}\n",
                "and ",
                $word,
                ", ",
                $word,
                ", {ones}\n and ",
                $floor,
                ", ",
                $floor,
                ", {f}\n",
                "add {saturated}, {saturated}, ",
                $word,
                "\n sub {room}, {room}, ",
                $floor,
                "\n",
            )
        };
    }

    /// Looks at rows; `N` is 4 or 8.
    #[inline(always)]
    pub(super) fn note<const N: usize>(watch: &mut Watch, rows: Rows<'_, N>) {
        let Rows { raw, stride, floor } = rows;
        let floor = floor.as_flattened().as_ptr_range();
        macro_rules! run {
            ($code:expr) => {
                // SAFETY: as above.
                #[allow(unsafe_code)]
                unsafe {
                    asm!($code,
                        raw = inout(reg) raw.as_ptr() => _, floor = inout(reg) floor.start => _,
                        end = in(reg) floor.end, stride = in(reg) stride.wrapping_mul(4),
                        raise = in(reg) watch.raise, white = in(reg) watch.white,
                        lit = in(reg) watch.lit, signs = in(reg) SIGNS, ones = in(reg) ONES,
                        room = inout(reg) watch.room, saturated = inout(reg) watch.saturated,
                        a = out(reg) _, b = out(reg) _, c = out(reg) _, d = out(reg) _,
                        e = out(reg) _, f = out(reg) _,
                        options(pure, readonly, nostack));
                }
            };
        }
        if N == WORDS {
            run!(for_each_row!(
                "32",
                note!("0" "4"),
                note!("8" "12"),
                note!("16" "20"),
                note!("24" "28")
            ));
        } else {
            run!(for_each_row!("16", note!("0" "4"), note!("8" "12")));
        }
    }
}

/// The same in portable arithmetic, so that the kernel can be tested on a PC.
#[cfg(not(target_arch = "riscv32"))]
mod row {
    use super::{ONES, Rows, SIGNS, Sums, Watch};

    /// The lanes whose top bit is set, without it; zero for the others.
    fn positive(d: u32) -> u32 {
        let signs = d & SIGNS;
        d & signs.wrapping_sub(signs >> 15)
    }

    pub(super) fn sums<const N: usize>(rows: Rows<'_, N>, open: u32) -> Sums {
        let mut sums = Sums::default();
        rows.each(|raw, floor| {
            for ((raw, floor), column) in raw.iter().zip(floor).zip(&mut sums.columns) {
                let signal = positive(raw.wrapping_add(open).wrapping_sub(*floor));
                *column += signal;
                sums.sum += (signal & 0xffff) + (signal >> 16);
            }
            sums.running += sums.sum;
        });
        sums
    }

    pub(super) fn note<const N: usize>(watch: &mut Watch, rows: Rows<'_, N>) {
        rows.each(|raw, floor| {
            for (raw, floor) in raw.iter().zip(floor) {
                let raised = raw.wrapping_add(watch.raise).wrapping_sub(*floor);
                watch.room -= positive(raised.wrapping_add(watch.room));
                let counts = raw.wrapping_add(watch.white) & raised.wrapping_add(watch.lit);
                watch.saturated += (counts >> 15) & ONES;
            }
        });
    }
}

/// Whether rows are of this module's kind: of 4 or 8 words of 12 bits, and no more of them than a square
/// window has.
#[inline(always)]
pub(crate) const fn takes<const N: usize>(rows: &Rows<'_, N>, cut: Cut) -> bool {
    (N == 4 || N == 8) && cut.top <= TOP && rows.count() <= 2 * N
}

/// See [`crate::centroid::floored_moments`].
#[inline(always)]
pub(crate) fn sums<const N: usize>(rows: Rows<'_, N>, cut: Cut) -> RowSums {
    let open = SIGNS.wrapping_sub(both(cut.excess));
    let Sums { columns, sum, running } = row::sums(rows, open);
    // From the last word to the second, the sums of those met add up to k times word k.
    let (mut met, mut words, mut second) = (0u32, 0u32, 0u32);
    for column in columns.into_iter().take(N).skip(1).rev() {
        let high = column >> 16;
        met = met.wrapping_add(column & 0xffff).wrapping_add(high);
        words = words.wrapping_add(met);
        second = second.wrapping_add(high);
    }
    let second = columns.first().map_or(0, |first| second.wrapping_add(first >> 16));
    // Half pixels: 4 word + 2 lane - (W - 1), W = 2 N.
    let x = words.wrapping_mul(4).wrapping_add(second.wrapping_mul(2));
    let x = x.wrapping_sub(sum.wrapping_mul(2 * N as u32 - 1)) as i32;
    RowSums { sum, x, running }
}

/// See [`crate::pixels::Seen::note`].
#[inline(always)]
pub(crate) fn note<const N: usize>(rows: Rows<'_, N>, cut: Cut, seen: &mut Seen) {
    let mut watch = Watch {
        raise: both(RAISE.wrapping_sub(cut.excess)),
        white: SIGNS.wrapping_sub(both(cut.saturation)),
        lit: SIGNS.wrapping_sub(both(RAISE + 1)),
        room: SIGNS.wrapping_sub(word(&seen.peak).wrapping_add(both(RAISE))),
        saturated: word(&seen.saturated),
    };
    row::note(&mut watch, rows);
    put_word(&mut seen.peak, SIGNS.wrapping_sub(watch.room).wrapping_sub(both(RAISE)));
    put_word(&mut seen.saturated, watch.saturated);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::tests::agree;

    #[test]
    fn packed_and_portable_agree_to_the_bit() {
        agree::<4>(TOP, sums, note);
        agree::<8>(TOP, sums, note);
    }

    #[test]
    fn other_rows_are_not_taken() {
        let (raw, floor) = ([0; 64], [0; 64]);
        let cut = Cut {
            convention: crate::pixels::Convention::Subtract,
            shift: 0,
            top: TOP,
            saturation: 1,
            excess: 0,
        };
        let rows = Rows::<4>::new(&raw, 8, &floor).expect("words");
        assert!(takes(&rows, cut));
        assert!(!takes(&rows, Cut { top: TOP + 1, ..cut }), "13 bits");
        let narrow = Rows::<2>::new(&raw, 4, &floor).expect("words");
        assert!(!takes(&narrow, cut), "too few words, and too many rows");
    }
}
