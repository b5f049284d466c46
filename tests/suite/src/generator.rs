//! The numbers that everything here is made of: 32-bit integers, equal on every machine.

use rand_xoshiro::Xoroshiro64StarStar;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

/// xoroshiro64** (Blackman & Vigna 2018): two words of state, no 64-bit operation a number.
#[derive(Debug)]
pub(crate) struct Generator(Xoroshiro64StarStar);

impl Generator {
    /// A sequence of its own for each seed.
    pub(crate) fn new(seed: u32) -> Self {
        Self(Xoroshiro64StarStar::seed_from_u64(seed.into()))
    }

    /// 32 uniform bits.
    #[inline]
    pub(crate) fn bits(&mut self) -> u32 {
        self.0.next_u32()
    }

    /// Uniform in `0 .. n`, to within 2^-32.
    #[inline]
    pub(crate) fn below(&mut self, n: u32) -> u32 {
        ((u64::from(self.bits()) * u64::from(n)) >> 32) as u32
    }

    /// Uniform in `low ..= high`, less than 2^32 apart.
    #[inline]
    pub(crate) fn between(&mut self, low: i32, high: i32) -> i32 {
        low.wrapping_add(self.below(high.wrapping_sub(low) as u32 + 1) as i32)
    }

    /// One of `edges` or 32 uniform bits, with equal chances.
    pub(crate) fn edge(&mut self, edges: &[u32]) -> u32 {
        let random = self.bits();
        let chosen = edges.get(self.below(2 * edges.len() as u32) as usize);
        chosen.copied().unwrap_or(random)
    }
}
