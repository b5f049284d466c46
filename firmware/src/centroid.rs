//! Centroid: first moments of a window's signal, divided by its sum.
//!
//! Coordinates are measured from the window's centre in half pixels, 2x - (W - 1) and
//! 2y - (W - 1), integers for odd and even windows alike:
//!
//! ```text
//! I  = sum s                < 2^26 (1024 pixels of 16 bits); weighted, < 2^42
//! Mx = sum s (2x - (W-1))   <= 2^30 (65535 x 32 x 512); weighted, < 2^46
//! cx = Mx 2^15 / I          i32, Q16 pixels, rounded down and within 2^-20 of itself
//! ```
//!
//! The sums stream: a window's row is added as it arrives and nothing is kept of it, except for
//! brightest-n, which buffers its window. Sums are exact: 32 bits, 64 where they are weighted.
//! A weighted sum is shifted down to 26 bits together with its moments before it is divided by: the
//! weights are two products of 8 bits, and rounding each would cost what faint spots are made of.
//! The quotient is a product with the reciprocal of I from a table ([`crate::inverse`]); that of a window
//! without signal is zero, and its flux marks it as invalid.
//!
//! | estimator | threshold | passes |
//! |---|---|---|
//! | thresholded centre of gravity (CoG) | max(k sigma, fraction of the last peak) | 1 |
//! | plain CoG | the pixels' own (k sigma, or none) | 1 |
//! | weighted CoG | as above, times a Gaussian centred on the last centroid | 1 |
//! | brightest-n | the (n+1)-th brightest pixel of the window | one a signal bit |

#[cfg(armv7em)]
use crate::dsp::armv7em::Pairs;
#[cfg(any(target_arch = "riscv32", armv7em))]
use crate::dsp::{Kernel, Rows, Watched};
#[cfg(target_arch = "riscv32")]
use crate::dsp::{rv32::Narrow, rv32_wide::Wide};
use crate::fixed::{self, CENTROID_BITS};
use crate::inverse::Inverse;
use crate::pixels::{self, BankRow, Cut, Seen, WATCHED};
use serde::{Deserialize, Serialize};

/// Largest window, pixels on a side.
pub const MAX_WINDOW: usize = 32;
/// Smallest window, pixels on a side.
pub const MIN_WINDOW: usize = 4;

/// Largest centroid, Q16: twice the largest window bounds any that means something.
pub const CENTROID_LIMIT: i32 = (2 * MAX_WINDOW as i32) << CENTROID_BITS;

/// How a window becomes a centroid, in fixed point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum EstimatorConfig {
    /// Centre of gravity above the larger of the pixels' threshold and `peak_fraction` (Q16) of
    /// the subaperture's previous peak; plain CoG has fraction 0.
    CentreOfGravity {
        /// Q16.
        peak_fraction: u16,
    },
    /// Centre of gravity weighted with the template; `gain` is Q12.
    Weighted {
        /// Q16.
        peak_fraction: u16,
        /// Displacement per measured displacement from the weight's centre, Q12, 1 to 7 x 4096.
        gain: i32,
    },
    /// Centre of gravity above the (n+1)-th brightest pixel; `bits` bounds the signal.
    Brightest {
        /// 1 to W^2 - 1.
        n: u32,
        /// Of the signal, 1 to 16.
        bits: u32,
    },
}

impl EstimatorConfig {
    /// Of the last peak, Q16.
    #[inline(always)]
    pub(crate) const fn peak_fraction(&self) -> u16 {
        match *self {
            Self::CentreOfGravity { peak_fraction } | Self::Weighted { peak_fraction, .. } => {
                peak_fraction
            }
            Self::Brightest { .. } => 0,
        }
    }
}

/// One subaperture's measurement in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Measurement {
    /// Centroid x, y from the window's centre, pixels in Q16, within +-64 pixels.
    pub centroid_q16: [i32; 2],
    /// Sum of the thresholded signal, calibrated units; with the weighted estimator, of the
    /// weighted signal.
    pub flux: u32,
    /// Brightest of the watched pixels that passed its threshold, before the moving one is taken
    /// off; 0 if none passed.
    pub peak: u16,
    /// Watched pixels that have a signal and are at or above the saturation level.
    pub saturated: u16,
}

/// Running sums of one window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Moments {
    /// I.
    pub(crate) sum: u32,
    /// Mx, half pixels.
    pub(crate) x: i32,
    /// My, half pixels.
    pub(crate) y: i32,
}

/// Running weighted sums of one window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct WeightedMoments {
    pub(crate) sum: u64,
    pub(crate) x: i64,
    pub(crate) y: i64,
}

/// Bits of the divisor of a centroid: those of the largest plain sum.
const SUM_BITS: u32 = 26;

impl Moments {
    /// No signal yet.
    pub(crate) const ZERO: Self = Self { sum: 0, x: 0, y: 0 };

    /// Adds window row `y` with sum `sum` (below 2^21) and x moment `x` (within 2^25).
    #[inline(always)]
    pub(crate) fn add_row(&mut self, window: usize, y: usize, (sum, x): (u32, i32)) {
        self.sum = self.sum.wrapping_add(sum);
        self.x = self.x.wrapping_add(x);
        self.y = self.y.wrapping_add((sum as i32).wrapping_mul(half_pixels(window, y)));
    }

    /// Adds `count` rows from window row `y` on.
    #[inline(always)]
    pub(crate) fn add_rows(&mut self, window: usize, y: usize, count: usize, rows: RowSums) {
        self.sum = self.sum.wrapping_add(rows.sum);
        self.x = self.x.wrapping_add(rows.x);
        // Row i counts n - i times in what is taken off: 2 (y + n) - (W - 1) - 2 (n - i) is its place.
        let last = (rows.sum as i32).wrapping_mul(half_pixels(window, y.wrapping_add(count)));
        let y = last.wrapping_sub((rows.running as i32).wrapping_mul(2));
        self.y = self.y.wrapping_add(y);
    }

    /// The centroid of what has been added, Q16 pixels from the window's centre: a moment is in half pixels.
    #[inline(always)]
    pub(crate) fn centroid_q16(&self) -> [i32; 2] {
        let inverse = Inverse::new(self.sum);
        [self.x, self.y].map(|moment| inverse.quotient_q15(moment))
    }
}

impl WeightedMoments {
    /// No signal yet.
    pub(crate) const ZERO: Self = Self { sum: 0, x: 0, y: 0 };

    /// Adds window row `y` with sum `sum` (below 2^37) and x moment `x` (within 2^41).
    #[inline(always)]
    pub(crate) fn add_row(&mut self, window: usize, y: usize, (sum, x): (u64, i64)) {
        self.sum = self.sum.wrapping_add(sum);
        self.x = self.x.wrapping_add(x);
        let weighted = (sum as i64).wrapping_mul(i64::from(half_pixels(window, y)));
        self.y = self.y.wrapping_add(weighted);
    }

    /// The sums shifted down to what plain ones have at most: the bits lost are below 2^-25 of them.
    #[inline]
    pub(crate) fn narrow(&self) -> Moments {
        let excess = (u64::BITS - SUM_BITS).saturating_sub(self.sum.leading_zeros());
        // |Mx| <= 31 (I + 1) < 2^31, with what the shift takes off I.
        let [x, y] = [self.x, self.y].map(|m| (m >> excess) as i32);
        Moments { sum: (self.sum >> excess) as u32, x, y }
    }

    /// The weighted signal in units of signal.
    #[inline]
    pub(crate) fn flux(&self) -> u32 {
        (self.sum.wrapping_add(1 << (WEIGHT_BITS - 1)) >> WEIGHT_BITS) as u32
    }
}

/// Position of pixel `i` from the centre of a window, half pixels.
#[inline(always)]
fn half_pixels(window: usize, i: usize) -> i32 {
    2 * i as i32 - (window as i32 - 1)
}

/// Sum and x moment of one window row of signal: below 2^21, and within 2^25.
///
/// The moment from running sums, without a multiplication a pixel: they add up to the sum of
/// (W - x) s.
#[inline(always)]
pub(crate) fn row_moments(signal: impl ExactSizeIterator<Item = u32>) -> (u32, i32) {
    let window = signal.len() as i32;
    let (sum, running) = signal.fold((0u32, 0u32), |(sum, running), s| {
        let sum = sum.wrapping_add(s);
        (sum, running.wrapping_add(sum))
    });
    let x = (sum as i32).wrapping_mul(window + 1).wrapping_sub((running as i32).wrapping_mul(2));
    (sum, x)
}

/// Sum and x moment of one raw window row.
#[inline(always)]
pub(crate) fn calibrated_row_moments(raw: &[u16], row: BankRow<'_>, cut: Cut) -> (u32, i32) {
    #[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
    if raw.len().is_multiple_of(crate::dsp::sse2::LANES) {
        return crate::dsp::sse2::row_moments(raw, row, cut);
    }
    let mut buffer = [0u16; MAX_WINDOW];
    let signal = buffer.get_mut(..raw.len()).unwrap_or_default();
    pixels::signal(raw, row, cut, signal);
    row_moments(signal.iter().map(|&s| u32::from(s)))
}

/// Sums of consecutive rows of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct RowSums {
    /// Sum, below 2^26.
    pub(crate) sum: u32,
    /// x moment, half pixels, within 2^30.
    pub(crate) x: i32,
    /// Sum of the sums up to each row: of n rows, row i counts n - i times. Below 2^31.
    pub(crate) running: u32,
}

impl RowSums {
    /// Adds the next row.
    #[inline(always)]
    fn add(&mut self, (sum, x): (u32, i32)) {
        self.sum = self.sum.wrapping_add(sum);
        self.x = self.x.wrapping_add(x);
        self.running = self.running.wrapping_add(self.sum);
    }
}

/// Rows of a detector with a bank that has only floors, of which whole windows of W = 2 N pixels on a side
/// are taken.
pub(crate) trait WholeWindows<const W: usize, const N: usize> {
    /// Of one window.
    type Floors: ?Sized + 'static;

    /// The floors of one window after the other; none where they do not lie as they have to.
    fn floors<'f>(&self, floors: &'f [u16]) -> impl Iterator<Item = &'f Self::Floors>;

    /// Sums of the window that starts with pixel `start`, and what its pixels from column and row `watched` on
    /// show besides. `None` where its rows are not there, or not as they have to lie.
    fn window(
        &self,
        start: usize,
        floors: &Self::Floors,
        excess: u16,
        watched: [usize; 2],
    ) -> Option<(RowSums, Seen)>;
}

/// Those that need not lie in any way.
#[cfg(not(any(target_arch = "riscv32", armv7em)))]
pub(crate) struct Anyhow<'a> {
    pub(crate) raw: &'a [u16],
    pub(crate) width: usize,
    pub(crate) cut: Cut,
}

#[cfg(not(any(target_arch = "riscv32", armv7em)))]
impl<const W: usize, const N: usize> WholeWindows<W, N> for Anyhow<'_> {
    type Floors = [u16];

    #[inline(always)]
    fn floors<'f>(&self, floors: &'f [u16]) -> impl Iterator<Item = &'f [u16]> {
        floors.chunks_exact(W * W)
    }

    #[inline(always)]
    fn window(
        &self,
        start: usize,
        floor: &[u16],
        excess: u16,
        [x, y]: [usize; 2],
    ) -> Option<(RowSums, Seen)> {
        let (size, width) = (W, self.width);
        let span = (size - 1).wrapping_mul(width).wrapping_add(size);
        let raw = self.raw.get(start..start.wrapping_add(span))?;
        let cut = Cut { excess, ..self.cut };
        let sums = floored_moments::<N>(raw, width, floor, size, cut);
        let seen = watch_floored::<N>(
            raw.get(y.wrapping_mul(width).wrapping_add(x)..)?,
            floor.get(y * size + x..)?,
            cut,
        )?;
        Some((sums, seen))
    }
}

/// Sums of some rows of a window of a bank that has only floors. `raw` starts with the first of their
/// pixels and has the next row `stride` pixels further on; `floor` has `size` pixels a row and tells
/// how many rows there are. `N` is half of `size`, or 0 for any.
#[inline(always)]
pub(crate) fn floored_moments<const N: usize>(
    raw: &[u16],
    stride: usize,
    floor: &[u16],
    size: usize,
    cut: Cut,
) -> RowSums {
    #[cfg(target_arch = "riscv32")]
    if let Some(rows) = Rows::<N>::new(raw, stride, floor)
        && rows.count() <= 2 * N
    {
        if Narrow::takes::<N>(&cut) {
            return Narrow.sums(rows, cut);
        }
        if Wide::takes::<N>() {
            return Wide.sums(rows, cut);
        }
    }
    #[cfg(armv7em)]
    if let Some(rows) = Rows::<N>::new(raw, stride, floor) {
        return Pairs.sums(rows, cut);
    }
    sum_rows(raw, stride, floor, size, |raw, floor| floored_row_moments(raw, floor, cut))
}

/// [`floored_moments`] without vector instructions.
#[cfg(test)]
pub(crate) fn portable_floored_moments(
    raw: &[u16],
    stride: usize,
    floor: &[u16],
    size: usize,
    cut: Cut,
) -> RowSums {
    sum_rows(raw, stride, floor, size, |raw, floor| portable_floored_row_moments(raw, floor, cut))
}

#[inline(always)]
fn sum_rows(
    raw: &[u16],
    stride: usize,
    floor: &[u16],
    size: usize,
    moments: impl Fn(&[u16], &[u16]) -> (u32, i32),
) -> RowSums {
    let mut sums = RowSums::default();
    for (raw, floor) in raw.chunks(stride.max(1)).zip(floor.chunks_exact(size.max(1))) {
        if let Some(raw) = raw.get(..size) {
            sums.add(moments(raw, floor));
        }
    }
    sums
}

/// Sum and x moment of one raw window row of a bank that has only floors.
#[inline(always)]
fn floored_row_moments(raw: &[u16], floor: &[u16], cut: Cut) -> (u32, i32) {
    #[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
    if raw.len().is_multiple_of(crate::dsp::sse2::LANES) {
        return crate::dsp::sse2::floored_row_moments(raw, floor, cut);
    }
    portable_floored_row_moments(raw, floor, cut)
}

/// [`floored_row_moments`] without vector instructions.
#[inline(always)]
pub(crate) fn portable_floored_row_moments(raw: &[u16], floor: &[u16], cut: Cut) -> (u32, i32) {
    row_moments(signals(raw, floor, cut))
}

/// The signals of a row of a bank that has only floors.
#[inline(always)]
pub(crate) fn signals(raw: &[u16], floor: &[u16], cut: Cut) -> impl ExactSizeIterator<Item = u32> {
    let excess = i32::from(cut.excess);
    raw.iter().zip(floor).map(move |(&raw, &floor)| {
        fixed::positive(i32::from(raw) - i32::from(floor) - excess) as u32
    })
}

/// Looks at the watched pixels of a bank that has only floors, with which `raw` and `floor` start; `N` as in
/// [`floored_moments`].
#[inline(always)]
pub(crate) fn watch_floored<const N: usize>(raw: &[u16], floor: &[u16], cut: Cut) -> Option<Seen> {
    #[cfg(target_arch = "riscv32")]
    if let Some(watched) = Watched::new(raw, floor)
        && Wide::takes::<N>()
    {
        return Some(match Narrow::takes::<N>(&cut) {
            true => Kernel::<N>::watch(Narrow, watched, cut),
            false => Kernel::<N>::watch(Wide, watched, cut),
        });
    }
    #[cfg(armv7em)]
    if let Some(watched) = Watched::new(raw, floor)
        && N != 0
    {
        return Some(Kernel::<N>::watch(Pairs, watched, cut));
    }
    let (raw, floor) = (raw.first_chunk::<WATCHED>()?, floor.first_chunk::<WATCHED>()?);
    Some(Seen::of(signals(raw, floor, cut), raw, cut))
}

/// Fraction bits of the two weights of a pixel, its column's and its row's.
pub(crate) const WEIGHT_BITS: u32 = 16;

/// Sum and x moment of one window row, each pixel times the weight of its column (Q8) and all
/// times that of the row (Q8): exact, below 2^37 and within 2^41.
#[inline(always)]
pub(crate) fn weighted_row_moments(signal: &[u16], weights: &[u8], row: u8) -> (u64, i64) {
    let window = signal.len();
    let pixels = signal.iter().zip(weights).enumerate();
    let (sum, x) = pixels.fold((0u32, 0i64), |(sum, x), (i, (&s, &w))| {
        // 65535 x 255 x 31 < 2^29.
        let product = u32::from(s).wrapping_mul(u32::from(w));
        let moment = (product as i32).wrapping_mul(half_pixels(window, i));
        (sum.wrapping_add(product), x.wrapping_add(i64::from(moment)))
    });
    (u64::from(sum) * u64::from(row), x.wrapping_mul(i64::from(row)))
}

/// Steps of a pixel by which the template can be placed.
pub const PHASES: usize = 8;
/// Template samples per phase: the window, half a window of motion either way, and its ends.
pub const TEMPLATE: usize = 2 * MAX_WINDOW + 2;

/// A Gaussian weight sampled at eight positions a pixel, Q8 (255 at its centre), so that a row of
/// weights for any centre is one slice.
#[derive(Debug)]
pub(crate) struct Template {
    pub(crate) samples: [[u8; TEMPLATE]; PHASES],
}

impl Template {
    /// No weight anywhere.
    pub(crate) const EMPTY: Self = Self { samples: [[0; TEMPLATE]; PHASES] };

    /// A Gaussian of `fwhm_px` pixels' full width at half maximum.
    pub(crate) fn fill(&mut self, fwhm_px: f64) {
        // exp(-4 ln 2 (r / fwhm)^2): one half at r = fwhm / 2.
        let scale = -4.0 * core::f64::consts::LN_2 / (fwhm_px * fwhm_px);
        for (phase, samples) in self.samples.iter_mut().enumerate() {
            for (j, sample) in samples.iter_mut().enumerate() {
                let r = j as f64 - MAX_WINDOW as f64 - phase as f64 / PHASES as f64;
                *sample = libm::round(255.0 * libm::exp(scale * r * r)) as u8;
            }
        }
    }

    /// The centre the template takes for a centroid: rounded to an eighth of a pixel and kept
    /// within half a window. Eighths of a pixel from the window's centre.
    #[inline(always)]
    pub(crate) fn centre(window: usize, centroid_q16: i32) -> i32 {
        let eighths = fixed::round_shift(i64::from(centroid_q16), CENTROID_BITS - 3);
        fixed::saturate(eighths, 4 * window as i32)
    }

    /// The weights of pixels `0 .. window` for a template centred on `centre` eighths.
    #[inline(always)]
    pub(crate) fn row(&self, window: usize, centre: i32) -> &[u8] {
        // Pixel x lies 8x - 4(W-1) - centre eighths from the template's centre: sample
        // x + MAX_WINDOW - (whole pixels of what is subtracted). One pixel more on both sides
        // keeps that difference positive for a centre of -4 W.
        let offset = (4 * (window as i32 - 1) + centre + PHASES as i32).max(0) as usize;
        let (whole, phase) = (offset / PHASES, offset % PHASES);
        let start = (MAX_WINDOW + 1).saturating_sub(whole);
        self.samples
            .get(phase)
            .and_then(|samples| samples.get(start..start + window))
            .unwrap_or_default()
    }

    /// The weight of window row `y`.
    #[inline(always)]
    pub(crate) fn weight(&self, window: usize, centre: i32, y: usize) -> u8 {
        self.row(window, centre).get(y).copied().unwrap_or(0)
    }
}

/// The centroid that a weighted measurement stands for: c + gain (m - c), where `c` is the
/// template's centre (eighths) and `m` the weighted centroid; gain in Q12.
///
/// A Gaussian template of variance v on a spot of variance u shows v / (u + v) of a displacement;
/// `gain` is the inverse of that.
#[inline]
pub(crate) fn unweighted(centre: i32, measured_q16: i32, gain_q12: i32) -> i32 {
    let c = centre.wrapping_shl(CENTROID_BITS - 3);
    let step = i64::from(measured_q16.wrapping_sub(c)) * i64::from(gain_q12);
    fixed::saturate(i64::from(c) + fixed::round_shift(step, 12), CENTROID_LIMIT)
}

/// The (n+1)-th largest of `signal`, each below 2^bits: the largest t that at least n + 1 pixels
/// reach. One counting pass a bit: linear in the pixels, and its time does not depend on them.
#[inline(always)]
pub(crate) fn nth_brightest(signal: &[u16], n: u32, bits: u32) -> u16 {
    let mut threshold = 0u16;
    for bit in (0..bits.min(16)).rev() {
        let trial = threshold | (1 << bit);
        // At most 1024 pixels: a u16 counts them.
        let count: u16 = signal.iter().fold(0, |c, &s| c.wrapping_add(u16::from(s >= trial)));
        threshold = if u32::from(count) > n { trial } else { threshold };
    }
    threshold
}

/// Moments of a buffered window above the (n+1)-th brightest pixel. Pixels equal to that one
/// contribute nothing, so ties need no order and at most n pixels count.
#[inline(always)]
pub(crate) fn brightest_moments(signal: &[u16], window: usize, n: u32, bits: u32) -> Moments {
    let threshold = nth_brightest(signal, n, bits);
    let mut moments = Moments::ZERO;
    for (y, pixels) in signal.chunks_exact(window.max(1)).enumerate() {
        let above = pixels.iter().map(|&s| u32::from(pixels::less(s, threshold)));
        moments.add_row(window, y, row_moments(above));
    }
    moments
}

/// The column or row nearest a centroid at `c_q16` from the window's centre, from that behind the window's middle
/// on: -(W / 2) ..= (W - 1) / 2.
///
/// `INSIDE`: the centroid is one of signals, within (W - 1) / 2 pixels and two ulp, as is what is nearest it.
#[inline(always)]
pub(crate) fn nearest<const INSIDE: bool>(window: usize, c_q16: i32) -> i8 {
    // Of an even window the centre is between pixels.
    let half = (window as i32 & 1) << (CENTROID_BITS - 1);
    let near = c_q16.wrapping_add(half) >> CENTROID_BITS;
    if INSIDE {
        return near as i8;
    }
    let (middle, last) = (window as i32 / 2, window as i32 - 1);
    let place = fixed::positive(near.wrapping_add(middle));
    place.wrapping_sub(fixed::positive(place.wrapping_sub(last))).wrapping_sub(middle) as i8
}

/// Column of the first and row of the [`WATCHED`] pixels for a centroid next to which is pixel `near`, as of
/// [`nearest`].
#[inline(always)]
pub(crate) fn watched(window: usize, near: [i8; 2]) -> [usize; 2] {
    let [x, y] = near.map(|near| (window as i32 / 2).wrapping_add(near.into()));
    // The second or third of them is that pixel.
    let even = fixed::positive(x.wrapping_sub(1) >> 1 << 1);
    let last = (window as i32).wrapping_sub(WATCHED as i32);
    [even.wrapping_sub(fixed::positive(even.wrapping_sub(last))) as usize, y as usize]
}

/// The part of a moving threshold that a pixel's own threshold does not already cover:
/// max(fraction x peak above dark - base, 0).
///
/// `base` is the subaperture's mean fixed threshold; `covered` is what of it the peak had lost
/// when it was measured (all of it with the subtracting convention, nothing otherwise).
#[inline]
pub(crate) fn excess(peak: u16, fraction_q16: u16, base: u16, covered: u16) -> u16 {
    let above_dark = u32::from(peak) + u32::from(covered);
    // All ones where it does not fit.
    let above_dark = (above_dark | (above_dark >> 16).wrapping_neg()) & u32::from(u16::MAX);
    let moving = ((above_dark * u32::from(fraction_q16) + (1 << 15)) >> 16) as u16;
    pixels::less(moving, base)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Positions of a window's pixels from its centre.
    fn positions(window: usize) -> impl Iterator<Item = (usize, f64)> {
        (0..window).map(move |i| (i, i as f64 - (window as f64 - 1.0) / 2.0))
    }

    /// A Gaussian spot's light on a pixel at distance `r` of it along an axis, two pixels wide at half maximum.
    fn spot(r: f64) -> f64 {
        f64::exp(-core::f64::consts::LN_2 * r * r)
    }

    /// Centroids all over windows of every size: what is watched is in the window, has every pixel of its row that is
    /// nearer than a pixel and a half, and of a spot that has not moved 84 % of the brightest pixel, sampled there.
    #[test]
    fn watched_pixels_hold_the_peak() {
        for window in MIN_WINDOW..=MAX_WINDOW {
            let steps = (window as i32 - 1) * 16;
            for step in -steps..=steps {
                let c_q16 = step << (CENTROID_BITS - 5);
                let c = f64::from(step) / 32.0;
                let near = nearest::<true>(window, c_q16);
                assert_eq!(near, nearest::<false>(window, c_q16));
                let [x, y] = watched(window, [near; 2]);
                let last = window - WATCHED;
                assert!(x <= last && (x % 2 == 0 || x == last), "{window}: {c}");
                let highest = positions(window).map(|(_, at)| spot(at - c)).fold(0.0, f64::max);
                for (i, at) in positions(window) {
                    assert!(
                        (at - c).abs() >= 1.5 || (x..x + WATCHED).contains(&i),
                        "{window}: {c}"
                    );
                    assert!(i != y || spot(at - c) >= 0.84, "{window}: {c}");
                    assert!(i != y || spot(at - c) >= highest - 1e-12, "{window}: {c}");
                }
            }
        }
    }

    #[test]
    fn a_centroid_beyond_the_window_is_nearest_its_edge() {
        for window in MIN_WINDOW..=MAX_WINDOW {
            let half = window as i32 / 2;
            let found = [-CENTROID_LIMIT, CENTROID_LIMIT].map(|c| nearest::<false>(window, c));
            assert_eq!(found.map(i32::from), [-half, window as i32 - 1 - half]);
        }
    }
}
