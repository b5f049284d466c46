//! The random numbers of one row of one frame, as wide as the processor's vectors.

use pulp::Simd;

/// Words drawn together.
pub(super) const LANES: usize = 16;

/// Sixteen generators xoshiro128++ (Blackman & Vigna 2021) side by side.
///
/// The row's 64-bit key is `m(m(m(seed) ^ frame) ^ row)`, where `m` is SplitMix64's output
/// function. `m` is a bijection, so the rows of a frame never share a key, nor do the frames'
/// own keys of a run. Generator `l` starts from SplitMix64's outputs `2 l` and `2 l + 1` after the key.
#[derive(Debug, Clone)]
pub(super) struct RowStream {
    state: [[u32; LANES]; 4],
}

impl RowStream {
    /// The stream of a row.
    #[inline(always)]
    pub(super) fn new(seed: u64, frame: u64, row: u64) -> Self {
        let mut state = [[0; LANES]; 4];
        let key = mix(mix(mix(seed) ^ frame) ^ row);
        for (half, words) in state.as_chunks_mut::<2>().0.iter_mut().enumerate() {
            let [low, high] = words;
            for (lane, (low, high)) in low.iter_mut().zip(high).enumerate() {
                let bits = mix(key.wrapping_add(STEP.wrapping_mul((2 * lane + half) as u64)));
                (*low, *high) = (bits as u32, (bits >> 32) as u32);
            }
        }
        Self { state }
    }

    /// The next words of each generator, `N` times those of all.
    #[inline(always)]
    pub(super) fn draw<S: Simd, const N: usize>(&mut self, simd: S) -> [[u32; LANES]; N] {
        let add = |x, y| simd.add_u32s(x, y);
        let xor = |x, y| simd.xor_u32s(x, y);
        let left = |x, by| simd.wrapping_dyn_shl_u32s(x, simd.splat_u32s(by));
        let right = |x, by| simd.wrapping_dyn_shr_u32s(x, simd.splat_u32s(by));
        let rotate = |x, by| simd.or_u32s(left(x, by), right(x, 32 - by));
        let [a, b, c, d] = self.state.each_mut().map(|words| S::as_mut_simd_u32s(words).0);
        let mut words = [[0; LANES]; N];
        for words in &mut words {
            for (v, word) in S::as_mut_simd_u32s(words).0.iter_mut().enumerate() {
                *word = add(rotate(add(a[v], d[v]), 7), a[v]);
                let shifted = left(b[v], 9);
                c[v] = xor(c[v], a[v]);
                d[v] = xor(d[v], b[v]);
                b[v] = xor(b[v], c[v]);
                a[v] = xor(a[v], d[v]);
                c[v] = xor(c[v], shifted);
                d[v] = rotate(d[v], 11);
            }
        }
        words
    }
}

/// What SplitMix64 adds to its state at each output.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// Output function of SplitMix64 (Steele, Lea & Flood 2014).
#[inline(always)]
pub(super) fn mix(value: u64) -> u64 {
    let z = value.wrapping_add(STEP);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Arch, WithSimd};
    use rand::{Rng, SeedableRng};
    use rand_xoshiro::Xoshiro128PlusPlus;

    const DRAWS: usize = 100;

    struct Draw(RowStream);

    impl WithSimd for Draw {
        type Output = [[u32; LANES]; DRAWS];

        #[inline(always)]
        fn with_simd<S: Simd>(mut self, simd: S) -> Self::Output {
            self.0.draw(simd)
        }
    }

    /// That crate spreads seeds by SplitMix64, too.
    #[test]
    fn each_lane_is_a_generator_of_rand_xoshiro() {
        let key = mix(mix(mix(7) ^ 8) ^ 9);
        let mut lanes: [Xoshiro128PlusPlus; LANES] = std::array::from_fn(|lane| {
            let seed = key.wrapping_add(STEP.wrapping_mul(2 * lane as u64));
            Xoshiro128PlusPlus::seed_from_u64(seed)
        });
        for words in Arch::new().dispatch(Draw(RowStream::new(7, 8, 9))) {
            assert_eq!(words, lanes.each_mut().map(Rng::next_u32));
        }
    }
}
