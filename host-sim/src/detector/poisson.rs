//! Poisson deviates, each of a mean of its own.
//!
//! A sum of Poisson deviates is a Poisson deviate of the summed means. So a mean below 4096 is split
//! into a multiple of 128, one of 4 below 128, one of 1/16 below 4 and a rest below 1/16. The multiples are
//! drawn from tables made once, the first of them only where it is not zero; the rest, by inversion without a
//! branch. Larger means are drawn by transformed rejection.
//!
//! Tables resolve probabilities to 2^-32; what is left out or rounded of the rest is below 1e-8: far below what
//! any number of frames could show.

use super::alias::Alias;
use super::floor::floor;
use super::ptrs;
use super::stream::{LANES, RowStream};
use pulp::Simd;
use std::sync::LazyLock;

/// Deviates drawn together.
pub(super) const BLOCK: usize = 2 * LANES;

const BRIGHT_STEP: f32 = 128.0;
const BRIGHT_MEANS: usize = 32;
const BRIGHT_COUNTS: usize = 1024;
const COARSE_STEP: f32 = 4.0;
const COARSE_MEANS: usize = 32;
const COARSE_COUNTS: usize = 256;
const FINE_STEP: f32 = 1.0 / 16.0;
const FINE_MEANS: usize = 64;
const FINE_COUNTS: usize = 32;

/// Means above this fill any well.
const MAX_MEAN: f32 = 1e12;

/// Draws Poisson deviates; get it once by [`PoissonSampler::get`], outside the loop.
#[derive(Debug)]
pub(super) struct PoissonSampler {
    bright: Box<[Alias<BRIGHT_COUNTS>; BRIGHT_MEANS]>,
    coarse: Box<[Alias<COARSE_COUNTS>; COARSE_MEANS]>,
    fine: Box<[Alias<FINE_COUNTS>; FINE_MEANS]>,
}

impl PoissonSampler {
    /// The one set of tables of the process, made at the first call.
    pub(super) fn get() -> &'static Self {
        fn tables<const N: usize, const M: usize>(step: f32) -> Box<[Alias<N>; M]> {
            let table = |i| Alias::new(i as f64 * f64::from(step));
            let tables: Vec<_> = (0..M).map(table).collect();
            tables.try_into().expect("M of them")
        }
        static SAMPLER: LazyLock<PoissonSampler> = LazyLock::new(|| PoissonSampler {
            bright: tables(BRIGHT_STEP),
            coarse: tables(COARSE_STEP),
            fine: tables(FINE_STEP),
        });
        &SAMPLER
    }

    /// Poisson deviates of the given means; 0 for a mean that is not above 0 (NaN included). Counts beyond
    /// 2^24 are those of a float.
    #[inline(always)]
    pub(super) fn draw<S: Simd>(
        &self,
        simd: S,
        random: &mut RowStream,
        mut means: [f32; BLOCK],
    ) -> [f32; BLOCK] {
        let mut counts = [0.0; BLOCK];
        let mut bright = 0;
        for mean in &mut means {
            // NaN also becomes 0.
            *mean = mean.max(0.0);
            bright |= u32::from(*mean >= BRIGHT_STEP);
        }
        if bright != 0 {
            self.take_bright(&random.draw(simd), &mut means, &mut counts);
        }
        let (mut steps, mut rest) = ([0; BLOCK], [0.0; BLOCK]);
        for ((steps, rest), &mean) in steps.iter_mut().zip(&mut rest).zip(&means) {
            *steps = floor(mean * (1.0 / FINE_STEP));
            *rest = mean - *steps as i32 as f32 * FINE_STEP;
        }
        // Most pixels of a window are in the dark. `FINE_MEANS` is a power of two.
        let lit = steps.iter().fold(0, |all, steps| all | steps) >= FINE_MEANS as u32;
        if lit {
            let bits = random.draw::<_, 2>(simd);
            for ((count, &steps), &bits) in counts.iter_mut().zip(&steps).zip(bits.as_flattened()) {
                let table = &self.coarse[steps as usize / FINE_MEANS % COARSE_MEANS];
                *count += table.draw(bits) as i32 as f32;
            }
        }
        let bits: [_; 4] = random.draw(simd);
        let [for_fine, for_rest] = [0, 2].map(|k| bits[k..k + 2].as_flattened());
        for (k, count) in counts.iter_mut().enumerate() {
            let fine = self.fine[steps[k] as usize % FINE_MEANS].draw(for_fine[k]);
            *count += fine as i32 as f32 + small(for_rest[k], rest[k]);
        }
        counts
    }

    /// Draws the multiples of [`BRIGHT_STEP`] and leaves the rest of each mean.
    fn take_bright(
        &self,
        bits: &[[u32; LANES]; 4],
        means: &mut [f32; BLOCK],
        counts: &mut [f32; BLOCK],
    ) {
        let (first, second) = bits.as_flattened().split_at(BLOCK);
        for (((mean, count), &first), &second) in
            means.iter_mut().zip(counts).zip(first).zip(second)
        {
            let steps = (*mean / BRIGHT_STEP) as usize;
            if steps >= BRIGHT_MEANS {
                let seed = u64::from(first) << 32 | u64::from(second);
                *count = ptrs::draw(seed, f64::from(mean.min(MAX_MEAN))) as f32;
                *mean = 0.0;
            } else if steps > 0 {
                let table = &self.bright[steps];
                *count = (table.first() + table.draw(first)) as f32;
                *mean -= steps as f32 * BRIGHT_STEP;
            }
        }
    }
}

/// A Poisson deviate of a mean m below 1/16: how many of P(at least 1), P(at least 2) ... exceed a uniform
/// number. P(at least k) = m^k/k! (1 - k m/(k + 1) + k m^2/(2 (k + 2)) - ...); P(at least 5) is below 8e-9 and
/// left out.
#[inline(always)]
fn small(bits: u32, mean: f32) -> f32 {
    // The conversion rounds: small numbers, on which the larger counts depend, are right to 2^-33.
    let uniform = ((bits >> 1) as i32 as f32 + 0.5) * 2f32.powi(-31);
    let m = mean;
    let at_least = [
        m * (1.0 - m * (1.0 / 2.0 - m * (1.0 / 6.0 - m * (1.0 / 24.0)))),
        m * m * (1.0 / 2.0 - m * (1.0 / 3.0 - m * (1.0 / 8.0))),
        m * m * m * (1.0 / 6.0 - m * (1.0 / 8.0 - m * (1.0 / 20.0))),
        m * m * m * m * (1.0 / 24.0 - m * (1.0 / 30.0)),
    ];
    let [one, two, three, four] = at_least.map(|at_least| i32::from(uniform < at_least));
    ((one + two) + (three + four)) as f32
}
