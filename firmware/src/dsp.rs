//! Packed kernels behind safe functions: the one module of the library with `unsafe` in it.
//!
//! A kernel here computes the integers of its portable twin in `pixels`, `centroid`, `control` and `sor`, bit for
//! bit, and is tested against it. A target without one uses the twin.
//!
//! | module | where | pixels at a time |
//! |---|---|---|
//! | `sse2` | x86-64 | 8 |
//! | `armv7em` | Cortex-M7 and its like, instructions on pairs of 16 bits | 2 |
//! | `rv32` | RISC-V of 32 bits, ordinary instructions, 12 bits | 2 |
//! | `rv32_wide` | the same, up to 16 bits | 1 |
//!
//! For RISC-V and the Cortex-M7 there is what is done to all nodes: `law`, the integrator, `edges`, the right-hand
//! side, `relax`, a relaxation step of the pistons, `totals`, and `reach`, what segments of a level mirror show. For
//! RISC-V alone there are `squares`, whole windows of 8 x 8 pixels, `spots`, what becomes of windows from
//! their moments to their slopes, `quads`, relaxation of the pupils that it is fastest for, and `codes`. The suite,
//! whose digests are the same on host and boards, is the test of these.

#[cfg(any(target_arch = "riscv32", armv7em, test))]
use crate::centroid::{RowSums, WholeWindows};
#[cfg(any(target_arch = "riscv32", armv7em, test))]
use crate::pixels::{Cut, Seen, WATCHED};

#[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
pub(crate) mod sse2;

#[cfg(any(target_arch = "riscv32", test))]
pub(crate) mod rv32;

#[cfg(any(target_arch = "riscv32", test))]
pub(crate) mod rv32_wide;

#[cfg(target_arch = "riscv32")]
pub(crate) mod codes;

#[cfg(any(target_arch = "riscv32", armv7em))]
pub(crate) mod edges;

#[cfg(any(target_arch = "riscv32", armv7em))]
pub(crate) mod law;

#[cfg(target_arch = "riscv32")]
pub(crate) mod quads;

#[cfg(any(target_arch = "riscv32", armv7em))]
pub(crate) mod reach;

#[cfg(any(target_arch = "riscv32", armv7em, test))]
pub(crate) mod relax;

#[cfg(target_arch = "riscv32")]
pub(crate) mod spots;

#[cfg(target_arch = "riscv32")]
pub(crate) mod squares;

#[cfg(any(target_arch = "riscv32", armv7em))]
pub(crate) mod totals;

#[cfg(any(target_arch = "riscv32", armv7em))]
mod walk;

#[cfg(any(armv7em, test))]
pub(crate) mod armv7em;

/// `x`, of which the compiler is to know no more than that: what it cannot see through it makes no branch
/// of. No instruction.
#[inline(always)]
pub(crate) fn opaque(x: i32) -> i32 {
    #[cfg(target_arch = "riscv32")]
    {
        let mut x = x;
        // SAFETY: there is nothing in it.
        #[allow(unsafe_code)]
        unsafe {
            core::arch::asm!("/* {x} */", x = inout(reg) x, options(pure, nomem, nostack, preserves_flags));
        }
        x
    }
    #[cfg(not(target_arch = "riscv32"))]
    x
}

/// max(x, 0): on RISC-V a multiplication by a comparison has an instruction less than masks.
#[inline(always)]
pub(crate) fn positive(x: i32) -> i32 {
    #[cfg(target_arch = "riscv32")]
    {
        let mut x = x;
        // SAFETY: it writes two registers that are given here.
        #[allow(unsafe_code)]
        unsafe {
            core::arch::asm!("sgtz {y}, {x}", "mul {x}, {x}, {y}", x = inout(reg) x, y = out(reg) _,
                options(pure, nomem, nostack, preserves_flags));
        }
        x
    }
    #[cfg(not(target_arch = "riscv32"))]
    {
        x & !(x >> 31)
    }
}

/// Pixels as words of two, the first in the lower half, without an odd last one; `None` unless they
/// start at a word's address.
#[cfg(any(target_arch = "riscv32", armv7em, test))]
#[inline(always)]
fn words(pixels: &[u16]) -> Option<&[u32]> {
    let aligned = pixels.as_ptr().addr().is_multiple_of(align_of::<u32>());
    if !aligned || cfg!(target_endian = "big") {
        return None;
    }
    // SAFETY: the pointer is aligned for u32, the words cover none but the slice's memory, any bits
    // are a u32, and the shared borrow is passed on.
    #[allow(unsafe_code)]
    Some(unsafe { core::slice::from_raw_parts(pixels.as_ptr().cast(), pixels.len() / 2) })
}

/// The pixels of words, as they lie in memory: the inverse of [`words`].
#[cfg(any(target_arch = "riscv32", test))]
#[inline(always)]
fn halves(words: &[u32]) -> &[u16] {
    // SAFETY: a u32 is two u16 in memory, aligned for them, and the shared borrow is passed on.
    #[allow(unsafe_code)]
    unsafe {
        core::slice::from_raw_parts(words.as_ptr().cast(), 2 * words.len())
    }
}

/// Rows of the detector in words, two pixels each.
#[cfg(any(target_arch = "riscv32", armv7em, test))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block<'a> {
    raw: &'a [u32],
    /// Words from one row to the next.
    stride: usize,
}

#[cfg(any(target_arch = "riscv32", armv7em, test))]
impl<'a> Block<'a> {
    /// The rows of `raw`, `stride` pixels each. `None` where one does not start at a word's address.
    #[inline(always)]
    pub(crate) fn new(raw: &'a [u16], stride: usize) -> Option<Self> {
        if !stride.is_multiple_of(2) {
            return None;
        }
        Some(Self { raw: words(raw)?, stride: stride / 2 })
    }

    /// The rows of `floor`, the first from pixel `start` on. `None` where one does not start at a word's
    /// address, or is missing.
    #[inline(always)]
    fn rows<const N: usize>(self, start: usize, floor: &'a [[u32; N]]) -> Option<Rows<'a, N>> {
        if self.stride < N || !start.is_multiple_of(2) {
            return None;
        }
        let last = floor.len().saturating_sub(1).checked_mul(self.stride)?;
        let (first, span) = (start / 2, last.checked_add(N)?);
        // One comparison a window with what is the same for all.
        if first > self.raw.len().checked_sub(span)? {
            return None;
        }
        // SAFETY: `first + span` is at most the length.
        #[allow(unsafe_code)]
        let raw = unsafe { self.raw.get_unchecked(first..first + span) };
        Some(Rows { raw, stride: self.stride, floor })
    }
}

/// Consecutive rows of a window in words, and their floors.
#[cfg(any(target_arch = "riscv32", armv7em, test))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows<'a, const N: usize> {
    /// From the first word of the first row to the last of the last one.
    raw: &'a [u32],
    /// Words from one row to the next.
    stride: usize,
    floor: &'a [[u32; N]],
}

#[cfg(any(target_arch = "riscv32", armv7em, test))]
impl<'a, const N: usize> Rows<'a, N> {
    /// The rows of `floor`; those of `raw` are `stride` pixels apart. `None` where a row does not start
    /// at a word's address, or is missing.
    #[inline(always)]
    pub(crate) fn new(raw: &'a [u16], stride: usize, floor: &'a [u16]) -> Option<Self> {
        if N == 0 {
            return None;
        }
        let (floor, _) = words(floor)?.as_chunks();
        Block::new(raw, stride)?.rows(0, floor)
    }

    /// The watched pixels, from column `x`, which is even, and row `y` on.
    #[inline(always)]
    fn watched(self, [x, y]: [usize; 2]) -> Option<Watched<'a>> {
        let floor = self.floor.get(y)?.get(x / 2..)?.first_chunk()?;
        // SAFETY: `Block::rows` took as many words for `raw` as rows have that are `stride` words apart,
        // one for each in `floor`: row y has all of its N, of which its floors have these.
        #[allow(unsafe_code)]
        let raw = unsafe { &*self.raw.as_ptr().add(y * self.stride + x / 2).cast() };
        Some(Watched { raw, floor })
    }

    /// How many they are.
    #[inline(always)]
    pub(crate) const fn count(&self) -> usize {
        self.floor.len()
    }

    /// Hands over one row after the other, with its floors.
    #[cfg(any(armv7em, test))]
    #[inline(always)]
    pub(crate) fn each(self, mut each: impl FnMut(&[u32; N], &[u32; N])) {
        for (raw, floor) in self.raw.chunks(self.stride.max(1)).zip(self.floor) {
            if let Some(raw) = raw.first_chunk() {
                each(raw, floor);
            }
        }
    }
}

/// What is done to rows in words. The results are those of the portable twins, to the bit.
#[cfg(any(target_arch = "riscv32", armv7em, test))]
pub(crate) trait Kernel<const N: usize>: Copy {
    /// Sums of rows, no more than a square window has: see [`crate::centroid::floored_moments`].
    fn sums(self, rows: Rows<'_, N>, cut: Cut) -> RowSums;

    /// Looks at watched pixels: see [`Seen::of`].
    fn watch(self, watched: Watched<'_>, cut: Cut) -> Seen;

    /// Both, of the rows of a square window and of pixels of one of them.
    #[inline(always)]
    fn window(self, rows: Rows<'_, N>, watched: Watched<'_>, cut: Cut) -> (RowSums, Seen) {
        let seen = self.watch(watched, cut);
        (self.sums(rows, cut), seen)
    }
}

/// The watched pixels of a window in words, and their floors.
#[cfg(any(target_arch = "riscv32", armv7em, test))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Watched<'a> {
    raw: &'a [u32; WATCHED / 2],
    floor: &'a [u32; WATCHED / 2],
}

#[cfg(any(target_arch = "riscv32", armv7em, test))]
impl<'a> Watched<'a> {
    /// Those with which `raw` and `floor` start; `None` where they do not start at a word's address, or are missing.
    #[inline(always)]
    pub(crate) fn new(raw: &'a [u16], floor: &'a [u16]) -> Option<Self> {
        Some(Self { raw: words(raw)?.first_chunk()?, floor: words(floor)?.first_chunk()? })
    }
}

/// A detector's rows, of which whole windows are taken by a kernel.
#[cfg(any(target_arch = "riscv32", armv7em, test))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Whole<'a, K> {
    pub(crate) block: Block<'a>,
    pub(crate) cut: Cut,
    pub(crate) kernel: K,
}

#[cfg(any(target_arch = "riscv32", armv7em, test))]
impl<const W: usize, const N: usize, K: Kernel<N>> WholeWindows<W, N> for Whole<'_, K> {
    type Floors = [[u32; N]; W];

    #[inline(always)]
    fn floors<'f>(&self, floors: &'f [u16]) -> impl Iterator<Item = &'f Self::Floors> {
        let (rows, _) = words(floors).unwrap_or_default().as_chunks();
        rows.as_chunks().0.iter()
    }

    #[inline(always)]
    fn window(
        &self,
        start: usize,
        floors: &Self::Floors,
        excess: u16,
        watched: [usize; 2],
    ) -> Option<(RowSums, Seen)> {
        let cut = Cut { excess, ..self.cut };
        let rows = self.block.rows(start, floors)?;
        Some(self.kernel.window(rows, rows.watched(watched)?, cut))
    }
}

/// What was seen in lanes of words, the first in the lower half.
#[cfg(any(target_arch = "riscv32", armv7em, test))]
#[inline(always)]
fn seen(peak: u32, saturated: u32) -> Seen {
    let halves = |word: u32| [word as u16, (word >> 16) as u16];
    Seen { peak: halves(peak), saturated: halves(saturated) }
}

#[cfg(test)]
mod tests {
    use super::{Block, Kernel, Rows, Watched, Whole, halves};
    use crate::centroid::{WholeWindows, portable_floored_moments, signals};
    use crate::pixels::{Convention, Cut, Seen, WATCHED};

    /// Room between one row of a block and the next, pixels.
    const GAP: usize = 6;

    /// Blocks of rows, 1 to as many as a square window has: their words, stride, pixels and floors.
    fn blocks<const N: usize>(
        top: u16,
        mut check: impl FnMut(Rows<'_, N>, usize, &[u16], &[u16], Cut),
    ) {
        let (size, stride) = (2 * N, 2 * N + GAP);
        // Words, so that they start at a word's address.
        let (mut raw, mut floor) = (Vec::new(), Vec::new());
        let mut longest = 1;
        rows(size, top, |row, floors, cut| {
            let pairs = |pixels: &[u16]| -> Vec<u32> {
                let (pairs, _) = pixels.as_chunks::<2>();
                pairs.iter().map(|&[a, b]| u32::from(a) | u32::from(b) << 16).collect()
            };
            raw.extend(pairs(row));
            floor.extend(pairs(floors));
            if floor.len() == longest * N {
                let (raw_halves, floor_halves) = (halves(&raw), halves(&floor));
                let rows = Rows::<N>::new(raw_halves, stride, floor_halves).expect("words");
                check(rows, stride, raw_halves, floor_halves, cut);
                raw.clear();
                floor.clear();
                longest = longest % size + 1;
            } else {
                // White, so that whatever looks between the rows is seen to.
                raw.extend([u32::MAX; GAP / 2]);
            }
        });
    }

    /// A kernel against its portable twins: of rows, and of square windows of `W` = 2 `N` pixels on a side.
    pub(super) fn agree<const W: usize, const N: usize>(top: u16, kernel: impl Kernel<N>) {
        blocks::<N>(top, |rows, stride, raw, floor, cut| {
            let expected = portable_floored_moments(raw, stride, floor, 2 * N, cut);
            assert_eq!(kernel.sums(rows, cut), expected, "{raw:?} {floor:?} {cut:?}");
            let seen = |x: usize, y: usize| {
                let places = [y * stride + x, y * 2 * N + x];
                let [raw, floor] = [&raw[places[0]..][..WATCHED], &floor[places[1]..][..WATCHED]];
                let found = kernel.watch(Watched::new(raw, floor).expect("words"), cut);
                let expected = Seen::of(signals(raw, floor, cut), raw, cut);
                assert_eq!(found.all(), expected.all(), "{raw:?} {floor:?} {cut:?}");
                found
            };
            for x in (0..=W - WATCHED).step_by(2) {
                seen(x, rows.count() - 1);
            }
            let whole = Whole { block: Block::new(raw, stride).expect("words"), cut, kernel };
            for floors in WholeWindows::<W, N>::floors(&whole, floor) {
                let watched = [W - WATCHED, W - 1];
                let (sums, seen_there) =
                    WholeWindows::<W, N>::window(&whole, 0, floors, cut.excess, watched)
                        .expect("rows");
                let [x, y] = watched;
                assert_eq!((sums, seen_there), (kernel.sums(rows, cut), seen(x, y)));
            }
        });
    }

    #[test]
    fn rows_are_words() {
        let (raw, floor) = ([0u32; 32], [0u32; 32]);
        let (raw, floor) = (halves(&raw), halves(&floor));
        let is_there = |raw, stride, floor| Rows::<4>::new(raw, stride, floor).is_some();
        assert!(is_there(raw, 8, floor));
        assert!(!is_there(&raw[1..], 8, floor), "not aligned");
        assert!(!is_there(raw, 8, &floor[1..]), "floors not aligned");
        assert!(!is_there(&raw[2..], 8, floor), "too short");
        assert!(!is_there(raw, 9, floor), "later rows would not be aligned");
        assert!(!is_there(raw, 6, floor), "rows over each other");
    }

    /// Rows of raw values up to `top`, word aligned, and their floors: anything, and the ends of the
    /// range and their neighbours more often.
    pub(super) fn rows(pixels: usize, top: u16, mut check: impl FnMut(&[u16], &[u16], Cut)) {
        let mut x = 1u32;
        let mut next = || {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            x >> 8
        };
        for _ in 0..30_000 {
            let edges = [0, 1, top / 2, top / 2 + 1, top - 1, top];
            let mut any = || match next() {
                k if k % 4 == 0 => edges[next() as usize % edges.len()],
                _ => (next() % (u32::from(top) + 1)) as u16,
            };
            let mut row = || -> Vec<u32> {
                (0..pixels / 2).map(|_| u32::from(any()) | u32::from(any()) << 16).collect()
            };
            let (raw, floor) = (row(), row());
            let (excess, saturation) = (any(), any().max(1));
            let cut = Cut { convention: Convention::Subtract, shift: 0, top, saturation, excess };
            check(halves(&raw), halves(&floor), cut);
        }
    }
}
