//! The pixel kernels in the vector unit that every x86-64 has: eight pixels at a time.
//!
//! The same integers as [`crate::pixels`] and [`crate::centroid`], bit for bit; only the order of
//! additions differs, which wrapping sums do not see. Pixels enter and leave registers as arrays,
//! so that all that is `unsafe` is the claim that the target has SSE2, which `cfg` proves, and the
//! loads and stores of whole arrays.
//!
//! Sums of unsigned pixels come from the signed multiply-add of pairs: a pixel with its top bit
//! flipped is the pixel less 2^15. Weights 2x - (W - 1) add up to zero over a row, so that the
//! 2^15 cancels in the moment; of the sum it is taken back.

use core::arch::x86_64::{self as x86, __m128i};

use crate::pixels::{BankRow, Convention, Cut};

/// Pixels in a register.
pub(crate) const LANES: usize = 8;

/// Instructions as safe functions.
macro_rules! instructions {
    ($($name:ident($($x:ident: $type:ty),*) -> $out:ty = $instruction:expr;)*) => {$(
        #[inline(always)]
        fn $name($($x: $type),*) -> $out {
            // SAFETY: this module is compiled only where SSE2 is part of the target, and none of
            // its instructions touches memory but for load and store, of whole arrays.
            #[allow(unsafe_code)]
            unsafe { $instruction($($x),*) }
        }
    )*};
}

type V = __m128i;
type Eight = [i16; LANES];
instructions! {
    zero() -> V = x86::_mm_setzero_si128;
    lanes(x: i16) -> V = x86::_mm_set1_epi16;
    word(high: i64, low: i64) -> V = x86::_mm_set_epi64x;
    eight(x: Eight) -> V = |[a, b, c, d, e, f, g, h]: Eight| x86::_mm_set_epi16(h, g, f, e, d, c, b, a);
    load(x: &[u16; LANES]) -> V = |x: &[u16; LANES]| x86::_mm_loadu_si128(x.as_ptr().cast());
    store(x: V) -> [u16; LANES] = |x| {
        let mut out = [0; LANES];
        x86::_mm_storeu_si128(out.as_mut_ptr().cast(), x);
        out
    };
    low_word(x: V) -> i64 = x86::_mm_cvtsi128_si64;
    swap_halves(x: V) -> V = x86::_mm_shuffle_epi32::<0b0100_1110>;
    interleave_low(x: V, y: V) -> V = x86::_mm_unpacklo_epi32;
    interleave_high(x: V, y: V) -> V = x86::_mm_unpackhi_epi32;
    bytes_interleaved(x: V, y: V) -> V = x86::_mm_unpacklo_epi8;
    and_not(x: V, y: V) -> V = x86::_mm_andnot_si128;
    xor(x: V, y: V) -> V = x86::_mm_xor_si128;
    equal_16(x: V, y: V) -> V = x86::_mm_cmpeq_epi16;
    sub_16(x: V, y: V) -> V = x86::_mm_sub_epi16;
    add_32(x: V, y: V) -> V = x86::_mm_add_epi32;
    saturating_sub_u16(x: V, y: V) -> V = x86::_mm_subs_epu16;
    saturating_add_u16(x: V, y: V) -> V = x86::_mm_adds_epu16;
    product_high_u16(x: V, y: V) -> V = x86::_mm_mulhi_epu16;
    product_low_16(x: V, y: V) -> V = x86::_mm_mullo_epi16;
    top_bit_16(x: V) -> V = x86::_mm_srli_epi16::<15>;
    shift_left_16(x: V, n: V) -> V = x86::_mm_sll_epi16;
    sum_of_products(x: V, y: V) -> V = x86::_mm_madd_epi16;
}

#[inline(always)]
fn splat(x: u16) -> __m128i {
    lanes(x as i16)
}

/// A block of pixels with its calibration.
#[derive(Clone, Copy)]
struct Block<'a> {
    raw: &'a [u16; LANES],
    floor: &'a [u16; LANES],
    loss: &'a [u16; LANES],
    threshold: &'a [u8; LANES],
}

/// See [`crate::pixels::calibrate`] and [`crate::pixels::calibrate_zero_below`].
#[inline(always)]
fn calibrated(block: Block<'_>, cut: Cut) -> V {
    let Block { raw, floor, loss, threshold } = block;
    let (raw, floor, loss) = (load(raw), load(floor), load(loss));
    let a = saturating_sub_u16(raw, floor);
    let high = product_high_u16(a, loss);
    let low = top_bit_16(product_low_16(a, loss));
    let flat = sub_16(sub_16(a, high), low);
    match cut.convention {
        Convention::Subtract => saturating_sub_u16(flat, splat(cut.excess)),
        Convention::ZeroBelow => {
            let bytes = word(0, i64::from_le_bytes(*threshold));
            let shift = word(0, i64::from(cut.shift));
            let limit = shift_left_16(bytes_interleaved(bytes, zero()), shift);
            let limit = saturating_add_u16(limit, splat(cut.excess));
            let below = equal_16(saturating_sub_u16(flat, limit), zero());
            and_not(below, flat)
        }
    }
}

/// Weights 2x - (W - 1) of the block of pixels from `first`.
#[inline(always)]
fn weights(window: usize, first: usize) -> __m128i {
    eight([0, 1, 2, 3, 4, 5, 6, 7].map(|i| 2 * (first as i16 + i) - (window as i16 - 1)))
}

/// Sum and x moment, with their bias.
#[derive(Clone, Copy)]
struct Sums {
    sum: __m128i,
    x: __m128i,
}

impl Sums {
    #[inline(always)]
    fn new() -> Self {
        Self { sum: zero(), x: zero() }
    }

    #[inline(always)]
    fn add(&mut self, signal: __m128i, weights: __m128i) {
        let biased = xor(signal, splat(1 << 15));
        self.sum = add_32(self.sum, sum_of_products(biased, splat(1)));
        self.x = add_32(self.x, sum_of_products(biased, weights));
    }

    #[inline(always)]
    fn row(self, window: usize) -> (u32, i32) {
        let pairs = add_32(interleave_low(self.sum, self.x), interleave_high(self.sum, self.x));
        let both = low_word(add_32(pairs, swap_halves(pairs)));
        ((both as u32).wrapping_add((window as u32) << 15), (both >> 32) as i32)
    }
}

/// A row and its calibration in blocks.
#[inline(always)]
fn blocks<'a>(raw: &'a [u16], row: BankRow<'a>) -> impl Iterator<Item = Block<'a>> {
    let (raw, _) = raw.as_chunks();
    let (floor, _) = row.floor.as_chunks();
    let (loss, _) = row.loss.as_chunks();
    let (threshold, _) = row.threshold.as_chunks();
    let calibration = floor.iter().zip(loss).zip(threshold);
    let blocks = raw.iter().zip(calibration);
    blocks.map(|(raw, ((floor, loss), threshold))| Block { raw, floor, loss, threshold })
}

/// See [`crate::centroid::calibrated_row_moments`]; the width is a multiple of [`LANES`].
#[inline(always)]
pub(crate) fn row_moments(raw: &[u16], row: BankRow<'_>, cut: Cut) -> (u32, i32) {
    let mut sums = Sums::new();
    for (k, block) in blocks(raw, row).enumerate() {
        sums.add(calibrated(block, cut), weights(raw.len(), LANES * k));
    }
    sums.row(raw.len())
}

/// The signals of a row with only floors, in blocks.
#[inline(always)]
fn floored<'a>(raw: &'a [u16], floor: &'a [u16], cut: Cut) -> impl Iterator<Item = V> + use<'a> {
    let blocks = raw.as_chunks().0.iter().zip(floor.as_chunks().0);
    blocks.map(move |(raw, floor)| {
        saturating_sub_u16(saturating_sub_u16(load(raw), load(floor)), splat(cut.excess))
    })
}

/// See [`crate::centroid::floored_row_moments`]; the width is a multiple of [`LANES`].
#[inline(always)]
pub(crate) fn floored_row_moments(raw: &[u16], floor: &[u16], cut: Cut) -> (u32, i32) {
    let mut sums = Sums::new();
    for (k, signal) in floored(raw, floor, cut).enumerate() {
        sums.add(signal, weights(raw.len(), LANES * k));
    }
    sums.row(raw.len())
}

/// See [`crate::pixels::signal`]; the width is a multiple of [`LANES`].
#[inline(always)]
pub(crate) fn signal(raw: &[u16], row: BankRow<'_>, cut: Cut, signal: &mut [u16]) {
    let (places, _) = signal.as_chunks_mut::<LANES>();
    for (block, place) in blocks(raw, row).zip(places) {
        *place = store(calibrated(block, cut));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{centroid, pixels};

    /// The portable stages on the same row, and every result compared.
    fn compare(raw: &[u16], row: BankRow<'_>, cut: Cut) {
        let context = format!("{raw:?} {row:?} {cut:?}");
        let mut expected = vec![0; raw.len()];
        pixels::portable_signal(raw, row, cut, &mut expected);
        let moments = centroid::row_moments(expected.iter().map(|&s| u32::from(s)));
        assert_eq!(row_moments(raw, row, cut), moments, "{context}");
        let mut found = vec![1; raw.len()];
        signal(raw, row, cut, &mut found);
        assert_eq!(found, expected, "{context}");
        if cut.convention == Convention::Subtract {
            let expected = centroid::portable_floored_row_moments(raw, row.floor, cut);
            assert_eq!(floored_row_moments(raw, row.floor, cut), expected, "{context}");
        }
    }

    #[test]
    fn packed_and_portable_agree_to_the_bit() {
        let mut x = 1u32;
        let mut next = || {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            x >> 8
        };
        for _ in 0..100_000 {
            let window = 8 * (1 + next() as usize % 4);
            // Anything, and the ends of the range and their neighbours more often.
            let edges = [0, 1, 0x7fff, 0x8000, 0xfffe, 0xffff];
            let mut any = || match next() {
                k if k % 4 == 0 => edges[next() as usize % edges.len()],
                _ => next() as u16,
            };
            let mut map = || -> Vec<u16> { (0..window).map(|_| any()).collect() };
            let (raw, floor, loss) = (map(), map(), map());
            let (excess, saturation, top) = (map()[0], map()[0].max(1), map()[0]);
            let threshold: Vec<u8> = (0..window).map(|_| next() as u8).collect();
            let shift = next() % 9;
            let row = BankRow { floor: &floor, loss: &loss, threshold: &threshold };
            for convention in [Convention::Subtract, Convention::ZeroBelow] {
                compare(&raw, row, Cut { convention, shift, excess, saturation, top });
            }
        }
    }
}
