//! Poisson deviates whose mean is another one at every call.
//!
//! A sum of Poisson deviates is a Poisson deviate of the summed means. So a mean below 128 is split
//! into a multiple of 4, a multiple of 1/16 below 4, and a rest below 1/16: the first two are drawn
//! from tables made once (Walker's alias method: one look-up, no search), the rest is zero 97 times
//! in a hundred. Larger means are drawn by transformed rejection (Hoermann 1993, algorithm PTRS): a
//! square root and a division work out its constants, and nine draws in ten end without a logarithm.
//!
//! The tables resolve probabilities to 2^-24 and end where less than 1e-17 is left: the mean is
//! right to 1e-5 e-, far below what any number of frames could show.

use std::sync::LazyLock;

use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

const COARSE_STEP: f64 = 4.0;
const COARSE_MEANS: usize = 32;
const COARSE_COUNTS: usize = 256;
const FINE_STEP: f64 = 1.0 / 16.0;
const FINE_MEANS: usize = 64;
const FINE_COUNTS: usize = 32;

/// Means above this fill any well; there, a double still holds every count.
const MAX_MEAN: f64 = 1e12;

/// Draws Poisson deviates; get it once by [`PoissonSampler::get`], outside the loop.
#[derive(Debug)]
pub struct PoissonSampler {
    coarse: Vec<Alias<COARSE_COUNTS>>,
    fine: Vec<Alias<FINE_COUNTS>>,
}

impl PoissonSampler {
    /// The one set of tables of the process, made at the first call.
    pub fn get() -> &'static Self {
        static SAMPLER: LazyLock<PoissonSampler> = LazyLock::new(|| PoissonSampler {
            coarse: (0..COARSE_MEANS).map(|i| Alias::new(i as f64 * COARSE_STEP)).collect(),
            fine: (0..FINE_MEANS).map(|i| Alias::new(i as f64 * FINE_STEP)).collect(),
        });
        &SAMPLER
    }

    /// A Poisson deviate of the given mean; 0 for a mean that is not above 0 (NaN included).
    #[inline]
    pub fn draw(&self, random: &mut impl Rng, mean: f64) -> f64 {
        if mean >= COARSE_STEP * COARSE_MEANS as f64 {
            return draw_large(random.next_u64(), mean.min(MAX_MEAN));
        }
        if mean.is_nan() || mean <= 0.0 {
            return 0.0;
        }
        let steps = (mean / FINE_STEP) as usize;
        let rest = mean - steps as f64 * FINE_STEP;
        let bits = random.next_u64();
        let coarse = self.coarse[steps / FINE_MEANS].draw((bits >> 32) as u32);
        let fine = self.fine[steps % FINE_MEANS].draw(bits as u32);
        f64::from(coarse + fine + draw_small(random, rest))
    }
}

/// A Poisson deviate of a mean below 1/16, by sequential search.
fn draw_small(random: &mut impl Rng, mean: f64) -> u32 {
    let mut remainder: f64 = random.random();
    // exp(-mean) is larger: most calls end here, without an exponential.
    if remainder < 1.0 - mean {
        return 0;
    }
    let mut probability = (-mean).exp();
    let mut count = 0;
    while remainder >= probability && probability > f64::MIN_POSITIVE {
        remainder -= probability;
        count += 1;
        probability *= mean / f64::from(count);
    }
    count
}

/// A Poisson deviate of a mean of at least 10: k = floor((2 a / s + b) u + mean + 0.43), u uniform in
/// -1/2 .. 1/2 and s = 1/2 - |u|, is accepted by its density's ratio to the distribution.
///
/// It has a stream of its own, from `seed`: nothing then keeps that of the caller out of the registers.
fn draw_large(seed: u64, mean: f64) -> f64 {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let b = 0.931 + 2.53 * mean.sqrt();
    let a = 0.024_83 * b - 0.059;
    let accepted_at_once = 0.9277 - 3.6224 / (b - 2.0);
    loop {
        let u = random.random::<f64>() - 0.5;
        let v: f64 = random.random();
        let s = 0.5 - u.abs();
        let count = ((2.0 * a / s + b) * u + mean + 0.43).floor();
        if s >= 0.07 && v <= accepted_at_once {
            return count;
        }
        if count < 0.0 || (s < 0.013 && v > s) {
            continue;
        }
        let inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
        let density = (v * inverse_alpha / (a / (s * s) + b)).ln();
        if density <= count * mean.ln() - mean - libm::lgamma(count + 1.0) {
            return count;
        }
    }
}

/// A table of `N` columns (a power of two, at most 256) of equal probability, each shared by two
/// counts: its own up to `share`, `other` above.
#[derive(Debug)]
struct Alias<const N: usize> {
    columns: [Column; N],
}

/// Other count in the lowest eight bits, above them the own share of the column in units of 2^-24: four
/// bytes, so that all tables stay in the nearest cache.
#[derive(Debug, Clone, Copy)]
struct Column(u32);

impl Column {
    fn new(share: u32, other: usize) -> Self {
        Self(share << 8 | other as u32)
    }

    fn share(self) -> u32 {
        self.0 >> 8
    }

    fn other(self) -> u32 {
        self.0 & 0xff
    }
}

impl<const N: usize> Alias<N> {
    /// Vose's construction for the Poisson distribution of `mean`, cut at `N` counts.
    fn new(mean: f64) -> Self {
        const UNIT: f64 = (1_u32 << 24) as f64;
        let mut heights = [0.0; N];
        let mut probability = (-mean).exp();
        for (count, height) in heights.iter_mut().enumerate() {
            *height = probability * N as f64;
            probability *= mean / (count + 1) as f64;
        }
        // What no other column tops up keeps its own count.
        let mut columns = std::array::from_fn(|own| Column::new(0, own));
        let (mut low, mut high): (Vec<_>, Vec<_>) = (0..N).partition(|&i| heights[i] < 1.0);
        while let (Some(from), Some(&to)) = (high.last().copied(), low.last()) {
            low.pop();
            let share = (heights[to] * UNIT).round().min(UNIT - 1.0);
            columns[to] = Column::new(share as u32, from);
            heights[from] -= 1.0 - heights[to];
            if heights[from] < 1.0 {
                high.pop();
                low.push(from);
            }
        }
        Self { columns }
    }

    /// The count for 32 random bits: the top ones choose the column, the 24 lowest the side.
    #[inline]
    fn draw(&self, bits: u32) -> u32 {
        let index = (bits >> 24) as usize % N;
        let column = self.columns[index];
        // A branch here would go either way at random.
        let own = bits & 0x00ff_ffff < column.share();
        std::hint::select_unpredictable(own, index as u32, column.other())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_hold_the_distribution() {
        for table_mean in [0.0, FINE_STEP, 3.9375] {
            probabilities_match(&Alias::<FINE_COUNTS>::new(table_mean), table_mean);
        }
        for table_mean in [0.0, 4.0, 124.0] {
            probabilities_match(&Alias::<COARSE_COUNTS>::new(table_mean), table_mean);
        }
    }

    /// Adds up the columns' shares and compares them with exp(-m) m^k / k!.
    fn probabilities_match<const N: usize>(table: &Alias<N>, mean: f64) {
        let mut found = [0.0; N];
        for (count, column) in table.columns.iter().enumerate() {
            let share = f64::from(column.share()) / f64::from(1 << 24);
            found[count] += share / N as f64;
            found[column.other() as usize] += (1.0 - share) / N as f64;
        }
        let mut expected = (-mean).exp();
        for (count, found) in found.iter().enumerate() {
            assert!((found - expected).abs() < 1e-7, "mean {mean}: P({count}) {found} {expected}");
            expected *= mean / (count + 1) as f64;
        }
    }
}
