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

use super::{put_word, word, words};
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

/// What is done to rows of `N` words. The floors of all of them follow each other; their pixels start
/// at `raw`, each row `stride` words after the last.
#[cfg(target_arch = "riscv32")]
mod row {
    use super::{ONES, SIGNS, Sums, WORDS, Watch};
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

    /// The sums of the rows of `floor`, of which the last is in `raw`; `N` is 4 or 8.
    #[inline(always)]
    pub(super) fn sums<const N: usize>(
        raw: &[u32],
        stride: usize,
        floor: &[[u32; N]],
        open: u32,
    ) -> Sums {
        let floor = floor.as_flattened().as_ptr_range();
        let [mut k0, mut k1, mut k2, mut k3, mut k4, mut k5, mut k6, mut k7] = [0u32; WORDS];
        let (mut sum, mut running) = (0u32, 0u32);
        macro_rules! run {
            ($code:expr; $($column:ident),*) => {
                // SAFETY: the instructions write registers that are given here and no memory, and
                // read the rows only, which the caller says are in their slices.
                #[allow(unsafe_code)]
                unsafe {
                    asm!($code,
                        raw = inout(reg) raw.as_ptr() => _, floor = inout(reg) floor.start => _,
                        end = in(reg) floor.end, stride = in(reg) stride.wrapping_mul(4),
                        open = in(reg) open, signs = in(reg) SIGNS, ones = in(reg) ONES,
                        $($column = inout(reg) $column,)*
                        sum = inout(reg) sum, running = inout(reg) running,
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

    /// Looks at the rows of `floor`, of which the last is in `raw`; `N` is 4 or 8.
    #[inline(always)]
    pub(super) fn note<const N: usize>(
        watch: &mut Watch,
        raw: &[u32],
        stride: usize,
        floor: &[[u32; N]],
    ) {
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
    use super::{ONES, SIGNS, Sums, Watch};

    /// The lanes whose top bit is set, without it; zero for the others.
    fn positive(d: u32) -> u32 {
        let signs = d & SIGNS;
        d & signs.wrapping_sub(signs >> 15)
    }

    fn each<'a, const N: usize>(
        raw: &'a [u32],
        stride: usize,
        floor: &'a [[u32; N]],
    ) -> impl Iterator<Item = impl Iterator<Item = (u32, u32)>> {
        let rows = floor.iter().enumerate();
        rows.map(move |(k, floor)| {
            raw[k * stride..][..N].iter().zip(floor).map(|(&raw, &floor)| (raw, floor))
        })
    }

    pub(super) fn sums<const N: usize>(
        raw: &[u32],
        stride: usize,
        floor: &[[u32; N]],
        open: u32,
    ) -> Sums {
        let mut sums = Sums::default();
        for row in each(raw, stride, floor) {
            for ((raw, floor), column) in row.zip(&mut sums.columns) {
                let signal = positive(raw.wrapping_add(open).wrapping_sub(floor));
                *column += signal;
                sums.sum += (signal & 0xffff) + (signal >> 16);
            }
            sums.running += sums.sum;
        }
        sums
    }

    pub(super) fn note<const N: usize>(
        watch: &mut Watch,
        raw: &[u32],
        stride: usize,
        floor: &[[u32; N]],
    ) {
        for (raw, floor) in each(raw, stride, floor).flatten() {
            let raised = raw.wrapping_add(watch.raise).wrapping_sub(floor);
            watch.room -= positive(raised.wrapping_add(watch.room));
            let counts = raw.wrapping_add(watch.white) & raised.wrapping_add(watch.lit);
            watch.saturated += (counts >> 15) & ONES;
        }
    }
}

/// Consecutive rows of a window in words, two pixels each.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a, const N: usize> {
    /// From the first word of the first row to the last of the last one at least.
    raw: &'a [u32],
    /// Words from one row to the next.
    stride: usize,
    floor: &'a [[u32; N]],
}

impl<'a, const N: usize> Rows<'a, N> {
    /// The rows of `floor`; those of `raw` are `stride` pixels apart. `None` where they are not of
    /// this module's kind: 4 or 8 words of 12 bits a row, each row at a word's address, and no more
    /// of them than a square window has.
    #[inline(always)]
    pub(crate) fn new(raw: &'a [u16], stride: usize, floor: &'a [u16], cut: Cut) -> Option<Self> {
        if !(N == 4 || N == 8) || cut.top > TOP || !stride.is_multiple_of(2) {
            return None;
        }
        let (raw, stride) = (words(raw)?, stride / 2);
        let (floor, _) = words(floor)?.as_chunks();
        let last = floor.len().saturating_sub(1).checked_mul(stride)?;
        let fits = floor.len() <= 2 * N && raw.len() >= last.checked_add(N)?;
        fits.then_some(Self { raw, stride, floor })
    }

    /// See [`crate::centroid::floored_moments`].
    #[inline(always)]
    pub(crate) fn sums(self, cut: Cut) -> RowSums {
        let open = SIGNS.wrapping_sub(both(cut.excess));
        let Sums { columns, sum, running } = row::sums(self.raw, self.stride, self.floor, open);
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
    pub(crate) fn note(self, cut: Cut, seen: &mut Seen) {
        let mut watch = Watch {
            raise: both(RAISE.wrapping_sub(cut.excess)),
            white: SIGNS.wrapping_sub(both(cut.saturation)),
            lit: SIGNS.wrapping_sub(both(RAISE + 1)),
            room: SIGNS.wrapping_sub(word(&seen.peak).wrapping_add(both(RAISE))),
            saturated: word(&seen.saturated),
        };
        row::note(&mut watch, self.raw, self.stride, self.floor);
        put_word(&mut seen.peak, SIGNS.wrapping_sub(watch.room).wrapping_sub(both(RAISE)));
        put_word(&mut seen.saturated, watch.saturated);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::centroid::{portable_floored_moments, signals};
    use crate::dsp::tests::{halves, rows};

    /// Room between one row of a block and the next, pixels.
    const GAP: usize = 6;

    fn agree<const N: usize>() {
        let (size, stride) = (2 * N, 2 * N + GAP);
        // Words, so that they start at a word's address.
        let (mut raw, mut floor) = (Vec::new(), Vec::new());
        let mut longest = 1;
        rows(size, TOP, |row, floors, cut| {
            let pairs = |pixels: &[u16]| -> Vec<u32> {
                let (pairs, _) = pixels.as_chunks::<2>();
                pairs.iter().map(|&[a, b]| u32::from(a) | u32::from(b) << 16).collect()
            };
            raw.extend(pairs(row));
            floor.extend(pairs(floors));
            if floor.len() == longest * N {
                let (raw_halves, floor_halves) = (halves(&raw), halves(&floor));
                let kernel = Rows::<N>::new(raw_halves, stride, floor_halves, cut).expect("words");
                let expected =
                    portable_floored_moments(raw_halves, stride, floor_halves, size, cut);
                assert_eq!(kernel.sums(cut), expected, "{raw_halves:?} {floor_halves:?} {cut:?}");
                let (mut noted, mut expected) = (Seen::NOTHING, Seen::NOTHING);
                // Twice: rows add to what was seen before.
                for _ in 0..2 {
                    kernel.note(cut, &mut noted);
                    for (raw, floor) in raw_halves.chunks(stride).zip(floor_halves.chunks(size)) {
                        expected.note(signals(&raw[..size], floor, cut), &raw[..size], cut);
                    }
                    assert_eq!(
                        noted.all(),
                        expected.all(),
                        "{raw_halves:?} {floor_halves:?} {cut:?}"
                    );
                }
                raw.clear();
                floor.clear();
                longest = longest % size + 1;
            } else {
                // White, so that whatever looks between the rows is seen to.
                raw.extend([u32::MAX; GAP / 2]);
            }
        });
    }

    #[test]
    fn packed_and_portable_agree_to_the_bit() {
        agree::<4>();
        agree::<8>();
    }

    #[test]
    fn other_rows_are_left_to_the_portable_kernel() {
        rows(8, u16::MAX, |raw, floor, cut| {
            let rows = |raw, stride, cut| Rows::<4>::new(raw, stride, floor, cut).is_some();
            assert!(!rows(raw, 8, cut), "16 bits");
            let narrow = Cut { top: TOP, ..cut };
            assert!(rows(raw, 8, narrow));
            assert!(!rows(&raw[1..], 8, narrow), "not aligned");
            assert!(!rows(&raw[2..], 8, narrow), "too short");
            assert!(!rows(raw, 9, narrow), "later rows would not be aligned");
            assert!(Rows::<2>::new(raw, 8, floor, narrow).is_none(), "too few words");
        });
    }
}
