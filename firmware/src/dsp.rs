//! Packed kernels behind safe functions: the one module of the library with `unsafe` in it.
//!
//! A kernel here computes the integers of its portable twin in `pixels` and `centroid`, bit for
//! bit, and is tested against it. A target without one uses the twin.
//!
//! | module | where | pixels at a time |
//! |---|---|---|
//! | `sse2` | x86-64 | 8 |
//! | `armv7em` | Cortex-M7 and its like, instructions on pairs of 16 bits | 2 |
//! | `rv32` | RISC-V of 32 bits, ordinary instructions, 12 bits | 2 |

#[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
pub(crate) mod sse2;

#[cfg(any(target_arch = "riscv32", test))]
pub(crate) mod rv32;

#[cfg(any(armv7em, test))]
pub(crate) mod armv7em;

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

/// A row and its floors as `N` words each; `None` unless they are.
#[cfg(any(armv7em, test))]
#[inline(always)]
pub(crate) fn packed<'a, const N: usize>(
    raw: &'a [u16],
    floor: &'a [u16],
) -> Option<(&'a [u32; N], &'a [u32; N])> {
    if N == 0 || raw.len() != 2 * N || floor.len() != 2 * N {
        return None;
    }
    Some((words(raw)?.first_chunk()?, words(floor)?.first_chunk()?))
}

/// The first two lanes in a word, the first in the lower half.
#[cfg(any(target_arch = "riscv32", armv7em, test))]
#[inline(always)]
fn word<const N: usize>(lanes: &[u16; N]) -> u32 {
    let low = lanes.first().map_or(0, |&x| u32::from(x));
    let high = lanes.get(1).map_or(0, |&x| u32::from(x));
    low | high << 16
}

/// A word into the first two lanes.
#[cfg(any(target_arch = "riscv32", armv7em, test))]
#[inline(always)]
fn put_word<const N: usize>(lanes: &mut [u16; N], word: u32) {
    let halves = [word as u16, (word >> 16) as u16];
    lanes.iter_mut().zip(halves).for_each(|(lane, half)| *lane = half);
}

#[cfg(test)]
mod tests {
    use crate::centroid::{portable_floored_row_moments, signals};
    use crate::pixels::{Convention, Cut, Seen};

    /// Kernels against their portable twins.
    pub(super) fn compare(
        raw: &[u16],
        floor: &[u16],
        cut: Cut,
        moments: impl Fn() -> (u32, i32),
        note: impl Fn(&mut Seen),
    ) {
        let context = || format!("{raw:?} {floor:?} {cut:?}");
        let expected = portable_floored_row_moments(raw, floor, cut);
        assert_eq!(moments(), expected, "{}", context());
        let (mut expected, mut found) = (Seen::NOTHING, Seen::NOTHING);
        // Twice: a row adds to what was seen before.
        for _ in 0..2 {
            expected.note(signals(raw, floor, cut), raw, cut);
            note(&mut found);
            assert_eq!(found.all(), expected.all(), "{}", context());
        }
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

    pub(super) fn halves(words: &[u32]) -> &[u16] {
        // SAFETY: a u32 is two u16 in memory, aligned for them.
        #[allow(unsafe_code)]
        unsafe {
            core::slice::from_raw_parts(words.as_ptr().cast(), 2 * words.len())
        }
    }
}
