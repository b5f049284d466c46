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

/// Sum of the lanes.
#[inline(always)]
fn lanes(x: u32) -> u32 {
    (x & 0xffff).wrapping_add(x >> 16)
}

/// Packed sums of up to [`GROUP`] rows, each of the words of a row whose number k has something in
/// common.
#[derive(Clone, Copy, Default)]
struct Packed {
    /// k odd.
    ones: u32,
    /// k / 2 odd; for 8 words only.
    twos: u32,
    /// Lower half.
    lower: u32,
    /// Upper half.
    upper: u32,
}

/// Rows of which the packed sums of four words each fit their lanes: 4 x 4 x 4095 < 2^16.
const GROUP: usize = 4;
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

#[cfg(target_arch = "riscv32")]
mod row {
    use super::{ONES, Packed, SIGNS, Watch};
    use core::arch::asm;

    /// Two words: `a` and `b` become their signals. Loads stand apart from what needs them.
    macro_rules! signals {
        ($first:literal, $second:literal) => {
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
            )
        };
    }

    /// Runs instructions on a row.
    macro_rules! add {
        ($packed:ident, $row:ident, $floor:ident, $open:ident; $($code:expr),*) => {{
            let Packed { mut ones, mut twos, mut lower, mut upper } = *$packed;
            let (low, high): (u32, u32);
            // SAFETY: the instructions write registers that are given here and no memory, and read
            // as many words from two arrays as these have.
            #[allow(unsafe_code)]
            unsafe {
                asm!($($code),*,
                    raw = in(reg) $row.as_ptr(), floor = in(reg) $floor.as_ptr(),
                    open = in(reg) $open, signs = in(reg) SIGNS,
                    ones = inout(reg) ones, twos = inout(reg) twos,
                    lower = inout(reg) lower, upper = inout(reg) upper,
                    low = out(reg) low, high = out(reg) high,
                    a = out(reg) _, b = out(reg) _, c = out(reg) _, d = out(reg) _, e = out(reg) _,
                    options(pure, readonly, nostack));
            }
            *$packed = Packed { ones, twos, lower, upper };
            low.wrapping_add(high)
        }};
    }

    /// Adds a row of 8 words, and returns the packed sum of its words.
    #[inline(always)]
    pub(super) fn add_8(packed: &mut Packed, row: &[u32; 8], floor: &[u32; 8], open: u32) -> u32 {
        add!(packed, row, floor, open;
            signals!("0", "4"), "add {low}, {a}, {b}", "add {ones}, {ones}, {b}",
            signals!("8", "12"), "add {ones}, {ones}, {b}", "add {a}, {a}, {b}",
            "add {twos}, {twos}, {a}", "add {low}, {low}, {a}",
            signals!("16", "20"), "add {high}, {a}, {b}", "add {ones}, {ones}, {b}",
            signals!("24", "28"), "add {ones}, {ones}, {b}", "add {a}, {a}, {b}",
            "add {twos}, {twos}, {a}", "add {high}, {high}, {a}",
            "add {lower}, {lower}, {low}", "add {upper}, {upper}, {high}")
    }

    /// Adds a row of 4 words, and returns the packed sum of its words.
    #[inline(always)]
    pub(super) fn add_4(packed: &mut Packed, row: &[u32; 4], floor: &[u32; 4], open: u32) -> u32 {
        add!(packed, row, floor, open;
            signals!("0", "4"), "add {low}, {a}, {b}", "add {ones}, {ones}, {b}",
            signals!("8", "12"), "add {high}, {a}, {b}", "add {ones}, {ones}, {b}",
            "add {lower}, {lower}, {low}", "add {upper}, {upper}, {high}", "// {twos}")
    }

    /// Looks at a word.
    #[inline(always)]
    pub(super) fn note(watch: &mut Watch, raw: u32, floor: u32) {
        let (mut room, mut saturated) = (watch.room, watch.saturated);
        // SAFETY: the instructions write registers that are given here and touch no memory.
        #[allow(unsafe_code)]
        unsafe {
            asm!(
                "add {a}, {raw}, {raise}", "add {raw}, {raw}, {white}", "sub {a}, {a}, {floor}",
                "add {b}, {a}, {room}", "add {a}, {a}, {lit}", "and {c}, {b}, {signs}",
                "and {a}, {a}, {raw}", "srli {floor}, {c}, 15", "srli {a}, {a}, 15",
                "sub {c}, {c}, {floor}", "and {a}, {a}, {ones}", "and {b}, {b}, {c}",
                "add {saturated}, {saturated}, {a}", "sub {room}, {room}, {b}",
                raw = inout(reg) raw => _, floor = inout(reg) floor => _,
                raise = in(reg) watch.raise, white = in(reg) watch.white, lit = in(reg) watch.lit,
                signs = in(reg) SIGNS, ones = in(reg) ONES,
                room = inout(reg) room, saturated = inout(reg) saturated,
                a = out(reg) _, b = out(reg) _, c = out(reg) _,
                options(pure, nomem, nostack));
        }
        (watch.room, watch.saturated) = (room, saturated);
    }
}

/// The same in portable arithmetic, so that the kernel can be tested on a PC.
#[cfg(not(target_arch = "riscv32"))]
mod row {
    use super::{ONES, Packed, SIGNS, Watch};

    /// The lanes whose top bit is set, without it; zero for the others.
    fn positive(d: u32) -> u32 {
        let signs = d & SIGNS;
        d & signs.wrapping_sub(signs >> 15)
    }

    fn add(packed: &mut Packed, row: &[u32], floor: &[u32], open: u32) -> u32 {
        let mut total = 0u32;
        for (k, (raw, floor)) in row.iter().zip(floor).enumerate() {
            let signal = positive(raw.wrapping_add(open).wrapping_sub(*floor));
            let half = if k < row.len() / 2 { &mut packed.lower } else { &mut packed.upper };
            *half += signal;
            packed.ones += signal * (k as u32 & 1);
            packed.twos += signal * (k as u32 >> 1 & 1) * u32::from(row.len() == 8);
            total += signal;
        }
        total
    }

    pub(super) fn add_8(packed: &mut Packed, row: &[u32; 8], floor: &[u32; 8], open: u32) -> u32 {
        add(packed, row, floor, open)
    }

    pub(super) fn add_4(packed: &mut Packed, row: &[u32; 4], floor: &[u32; 4], open: u32) -> u32 {
        add(packed, row, floor, open)
    }

    pub(super) fn note(watch: &mut Watch, raw: u32, floor: u32) {
        let raised = raw.wrapping_add(watch.raise).wrapping_sub(floor);
        watch.room -= positive(raised.wrapping_add(watch.room));
        let counts = raw.wrapping_add(watch.white) & raised.wrapping_add(watch.lit);
        watch.saturated += (counts >> 15) & ONES;
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
    /// this module's kind: 4 or 8 words of 12 bits a row, each row at a word's address.
    #[inline(always)]
    pub(crate) fn new(raw: &'a [u16], stride: usize, floor: &'a [u16], cut: Cut) -> Option<Self> {
        if !(N == 4 || N == 8) || cut.top > TOP || !stride.is_multiple_of(2) {
            return None;
        }
        let (raw, stride) = (words(raw)?, stride / 2);
        let (floor, _) = words(floor)?.as_chunks();
        let last = floor.len().saturating_sub(1).checked_mul(stride)?;
        (raw.len() >= last.checked_add(N)?).then_some(Self { raw, stride, floor })
    }

    /// One row after the other, with its floors.
    #[inline(always)]
    fn iter(self) -> impl Iterator<Item = (&'a [u32; N], &'a [u32; N])> {
        let first = self.raw.as_ptr();
        self.floor.iter().enumerate().map(move |(k, floor)| {
            // SAFETY: `new` has seen to it that the last of these rows ends inside `raw`, which is
            // borrowed for 'a, and k is at most that of the last.
            #[allow(unsafe_code)]
            let row = unsafe { &*first.add(k.wrapping_mul(self.stride)).cast() };
            (row, floor)
        })
    }

    /// See [`crate::centroid::floored_moments`].
    ///
    /// The number of a row's word k is, in binary, k0 + 2 k1 + 4 k2, and so is its part in the moment:
    /// the sum of the words with odd k, twice that of those with odd k / 2, four times that of the
    /// upper half.
    #[inline(always)]
    pub(crate) fn sums(self, cut: Cut) -> RowSums {
        let open = SIGNS.wrapping_sub(both(cut.excess));
        let (mut sum, mut running) = (0u32, 0u32);
        // Over all rows: the sum of the second lanes, and of k times word k.
        let (mut second, mut words) = (0u32, 0u32);
        let mut rows = self.iter();
        for group in self.floor.chunks(GROUP) {
            let mut packed = Packed::default();
            for (row, floor) in rows.by_ref().take(group.len()) {
                let row = match (row.as_slice().try_into(), floor.as_slice().try_into()) {
                    (Ok(row), Ok(floor)) => row::add_8(&mut packed, row, floor, open),
                    _ => match (row.as_slice().try_into(), floor.as_slice().try_into()) {
                        (Ok(row), Ok(floor)) => row::add_4(&mut packed, row, floor, open),
                        _ => 0,
                    },
                };
                // Both lanes of a row: at most 16 x 4095 < 2^16.
                sum = sum.wrapping_add(row.wrapping_mul(ONES) >> 16);
                running = running.wrapping_add(sum);
            }
            let Packed { ones, twos, lower, upper } = packed;
            second = second.wrapping_add(lower >> 16).wrapping_add(upper >> 16);
            words = words
                .wrapping_add(lanes(ones))
                .wrapping_add(lanes(twos).wrapping_mul(2))
                .wrapping_add(lanes(upper).wrapping_mul(N as u32 / 2));
        }
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
        for (row, floor) in self.iter() {
            row.iter().zip(floor).for_each(|(&raw, &floor)| row::note(&mut watch, raw, floor));
        }
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
                longest = longest % 17 + 1;
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
