//! Readout: detector rows to one measurement a subaperture, as the rows arrive.
//!
//! Windows are kept in readout order, so that those which a row meets are one contiguous range
//! with two ends that only move forward. Nothing of a row is kept but its windows' sums (and, for
//! brightest-n, their pixels). A window is finished with its last row; after the last row of the
//! frame nothing is left to do here.

use crate::centroid::{
    self, CENTROID_LIMIT, EstimatorConfig, MAX_WINDOW, Measurement, Moments, Template,
    WeightedMoments, WholeWindows,
};
use crate::config::{Config, Slot};
#[cfg(armv7em)]
use crate::dsp::armv7em::Pairs;
#[cfg(any(target_arch = "riscv32", armv7em))]
use crate::dsp::{Block, Whole};
#[cfg(target_arch = "riscv32")]
use crate::dsp::{
    rv32::Narrow,
    rv32_wide::Wide,
    spots::{self, Spots, Subapertures},
    squares::{self, Squares},
};
use crate::pixels::{self, BankRow, Convention, Cut, Noted, Seen};

/// What takes measurements when their windows have ended.
pub(crate) trait Sink<const M: usize> {
    /// Takes those of windows `first` to `next`, up to [`BATCH`], which are among `measurements` by
    /// subaperture.
    fn take(&mut self, windows: [usize; 2], measurements: &[Measurement]);

    /// What there is of the subapertures of as many windows in their order, of a frame that is as every other;
    /// `None` where they are to be taken as any.
    #[cfg(target_arch = "riscv32")]
    fn subapertures(&mut self, windows: [usize; 2]) -> Option<Subapertures<'_, M>>;
}

/// Measurements of which a [`Sink`] may keep sums in one word.
pub(crate) const BATCH: usize = 64;

/// What is kept of a window between its rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    pub(crate) moments: Moments,
    pub(crate) seen: Seen,
}

/// What a frame leaves of a window for the next one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tracking {
    /// Moving threshold beyond the fixed one, signal units.
    pub(crate) excess: u16,
    /// The pixel nearest the centroid, its column and row as of [`centroid::nearest`]: the peak is looked for there.
    /// That at the middle of a window without flux.
    pub(crate) near: [i8; 2],
}

impl Window {
    const NEW: Self = Self { moments: Moments::ZERO, seen: Seen::NOTHING };

    /// Looks at its watched pixels if row `y`, of which these are the pixels and their calibration, has them.
    #[inline(always)]
    fn watch(
        &mut self,
        tracking: &Tracking,
        (size, y): (usize, usize),
        raw: &[u16],
        row: BankRow<'_>,
        cut: Cut,
    ) {
        let [first, watched] = centroid::watched(size, tracking.near);
        if y == watched {
            self.seen = pixels::watch(raw, row, first, cut).unwrap_or(Seen::NOTHING);
        }
    }

    /// The measurement, and what the next frame does with the window, of which `base` is the fixed
    /// threshold.
    #[inline(always)]
    fn measured(&self, tracking: &Tracking, base: u16, shared: &Shared) -> (Measurement, Tracking) {
        let measurement = self.measurement(&self.moments, self.moments.sum, tracking, shared);
        (measurement, Tracking::next::<true>(&measurement, base, shared))
    }

    /// Both of a weighted window, the `k`-th, with a gain that undoes the weight.
    #[inline(always)]
    fn weighted<const M: usize>(
        &self,
        (moments, centres, gain): (&[WeightedMoments; M], &[[i16; 2]; M], i32),
        k: usize,
        tracking: &Tracking,
        base: u16,
        shared: &Shared,
    ) -> (Measurement, Tracking) {
        let moments = moments.get(k).copied().unwrap_or(WeightedMoments::ZERO);
        let mut measurement = self.measurement(&moments.narrow(), moments.flux(), tracking, shared);
        let centre = centres.get(k).copied().unwrap_or_default();
        measurement.centroid_q16.iter_mut().zip(centre).for_each(|(c, centre)| {
            *c = centroid::unweighted(centre.into(), *c, gain);
        });
        (measurement, Tracking::next::<false>(&measurement, base, shared))
    }

    /// The measurement, of `moments` or its own.
    #[inline(always)]
    fn measurement(
        &self,
        moments: &Moments,
        flux: u32,
        tracking: &Tracking,
        shared: &Shared,
    ) -> Measurement {
        let Noted { peak, saturated } = self.seen.all();
        // What was taken off the peak; nothing off none. Their sum is a raw value less its floor.
        let taken = i32::from(tracking.excess & shared.subtracted) & mask(peak as u32);
        Measurement {
            centroid_q16: moments.centroid_q16(),
            flux,
            peak: peak.wrapping_add(taken) as u16,
            saturated,
        }
    }
}

impl Tracking {
    const NEW: Self = Self { excess: 0, near: [0; 2] };

    /// What the next frame does with a window that was measured so; `base` is its fixed threshold.
    ///
    /// `INSIDE`: its centroid is one of signals, and inside the window, in the middle of one without flux.
    #[inline(always)]
    fn next<const INSIDE: bool>(measurement: &Measurement, base: u16, shared: &Shared) -> Self {
        let (peak, covered) = (measurement.peak, base & shared.subtracted);
        let seen = if INSIDE { -1 } else { mask(measurement.flux) as i8 };
        Self {
            excess: centroid::excess(peak, shared.peak_fraction, base, covered),
            near: measurement
                .centroid_q16
                .map(|c| centroid::nearest::<INSIDE>(shared.window, c) & seen),
        }
    }
}

/// All ones unless `x`, below 2^31, is zero. Without a comparison, which would become a branch: the time
/// must not tell what is lit.
#[inline(always)]
const fn mask(x: u32) -> i32 {
    x.wrapping_neg() as i32 >> 31
}

/// What all windows share.
#[derive(Clone, Copy)]
struct Shared {
    /// Pixels on a side.
    window: usize,
    /// All ones where thresholds are subtracted.
    subtracted: u16,
    /// Of the last peak, Q16.
    peak_fraction: u16,
}

impl Shared {
    #[inline(always)]
    fn new<const M: usize, const P: usize, const B: usize, const K: usize>(
        config: &Config<M, P, B, K>,
    ) -> Self {
        Self {
            window: config.window,
            subtracted: u16::from(config.bank.convention == Convention::Subtract).wrapping_neg(),
            peak_fraction: config.estimator.peak_fraction(),
        }
    }
}

/// The state of the readout. `M` and `B` as in [`Config`].
#[derive(Debug)]
pub(crate) struct Readout<const M: usize, const B: usize> {
    /// The next row.
    row: u16,
    /// First window that the next row can meet, and first that no row has met.
    active: [usize; 2],
    /// In readout order.
    windows: [Window; M],
    /// In readout order: what the last complete frame left, and what this one will.
    tracking: [[Tracking; M]; 2],
    /// In readout order, of the weighted estimator: moments, and centres of the weights in eighths of a
    /// pixel, within +-128.
    weighted: [WeightedMoments; M],
    centres: [[i16; 2]; M],
    /// In subaperture order: those of the last complete frame and those being measured.
    measurements: [[Measurement; M]; 2],
    /// Which of `measurements` and `tracking` is complete.
    complete: usize,
    /// Pixels of the windows being read; window k uses place k modulo the windows at once.
    buffer: [u16; B],
}

impl<const M: usize, const B: usize> Readout<M, B> {
    pub(crate) const fn new() -> Self {
        const BLANK: Measurement =
            Measurement { centroid_q16: [0; 2], flux: 0, peak: 0, saturated: 0 };
        Self {
            row: 0,
            active: [0; 2],
            windows: [Window::NEW; M],
            tracking: [[Tracking::NEW; M]; 2],
            weighted: [WeightedMoments::ZERO; M],
            centres: [[0; 2]; M],
            measurements: [[BLANK; M]; 2],
            complete: 0,
            buffer: [0; B],
        }
    }

    /// Starts a frame; what was measured of an unfinished one is dropped.
    pub(crate) fn begin(&mut self) {
        self.row = 0;
        self.active = [0; 2];
    }

    /// Forgets thresholds and centres as well.
    pub(crate) fn reset(&mut self) {
        self.begin();
        self.windows.fill(Window::NEW);
        self.tracking.as_flattened_mut().fill(Tracking::NEW);
        self.centres.fill([0; 2]);
        self.measurements.as_flattened_mut().fill(Measurement::default());
    }

    /// Rows taken since [`Readout::begin`].
    pub(crate) const fn rows(&self) -> u16 {
        self.row
    }

    /// Takes the next `rows` rows, which have the detector's width; `sink` is given each
    /// measurement when its window has ended.
    #[inline]
    pub(crate) fn push<const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        pixels: &[u16],
        rows: u16,
        sink: &mut impl Sink<M>,
    ) {
        // The common sizes get loops of known length; the results are the same.
        let only_floors = config.bank.only_floors()
            && matches!(config.estimator, EstimatorConfig::CentreOfGravity { .. });
        if only_floors {
            let met = self.meet(config, rows);
            let whole = self.are_whole(config, met, rows);
            match (config.window, whole) {
                (8, true) => self.whole_windows::<8, 4, P, K>(config, met, pixels, rows),
                (16, true) => self.whole_windows::<16, 8, P, K>(config, met, pixels, rows),
                (8, false) => self.floored_rows::<8, 4, P, K>(config, met, pixels, rows),
                (16, false) => self.floored_rows::<16, 8, P, K>(config, met, pixels, rows),
                _ => self.floored_rows::<0, 0, P, K>(config, met, pixels, rows),
            }
            self.end(config, rows, whole, sink);
            return;
        }
        for pixels in pixels.chunks_exact(usize::from(config.width).max(1)) {
            let met = self.meet(config, 1);
            match config.window {
                8 => self.rows_of::<8, P, K>(config, met, pixels),
                16 => self.rows_of::<16, P, K>(config, met, pixels),
                _ => self.rows_of::<0, P, K>(config, met, pixels),
            }
            self.end(config, 1, false, sink);
        }
    }

    /// First window that the next `rows` rows meet, and first that they do not meet any more.
    #[inline(always)]
    fn meet<const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        rows: u16,
    ) -> [usize; 2] {
        /// Windows looked past at once: in readout order all have started where the last of them has.
        const SOME: usize = 8;
        let end = self.row.wrapping_add(rows);
        let [first, mut next] = self.active;
        let starts = |k: usize| config.slots.get(k).is_some_and(|slot| slot.y0 < end);
        while starts(next + (SOME - 1)) {
            next += SOME;
        }
        while starts(next) {
            next += 1;
        }
        self.active = [first, next];
        self.active
    }

    /// Whether the next `rows` rows have all of every window they meet: in readout order the first one
    /// met starts first and the last ends last.
    fn are_whole<const P: usize, const K: usize>(
        &self,
        config: &Config<M, P, B, K>,
        [first, next]: [usize; 2],
        rows: u16,
    ) -> bool {
        let met = config.slots.get(first..next).unwrap_or_default();
        let starts = met.first().is_none_or(|slot| slot.y0 >= self.row);
        let end = usize::from(self.row).wrapping_add(usize::from(rows));
        starts && met.last().is_none_or(|slot| usize::from(slot.y0) + config.window <= end)
    }

    /// [`Readout::floored_rows`] where no window goes beyond the rows.
    #[inline(always)]
    fn whole_windows<const W: usize, const N: usize, const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        [mut first, next]: [usize; 2],
        pixels: &[u16],
        rows: u16,
    ) {
        let (width, cut) = (usize::from(config.width), config.bank.cut(0));
        while first < next {
            let met = [first, next];
            #[cfg(target_arch = "riscv32")]
            let left = match Block::new(pixels, width) {
                None => first,
                Some(block) if W == 8 && config.in_words => {
                    self.take_squares(config, met, block, cut)
                }
                Some(block) if Narrow::takes::<N>(&cut) => {
                    self.take::<W, N, P, K>(config, met, &Whole { block, cut, kernel: Narrow })
                }
                Some(block) => {
                    self.take::<W, N, P, K>(config, met, &Whole { block, cut, kernel: Wide })
                }
            };
            #[cfg(armv7em)]
            let left = Block::new(pixels, width).map_or(first, |block| {
                self.take::<W, N, P, K>(config, met, &Whole { block, cut, kernel: Pairs })
            });
            #[cfg(not(any(target_arch = "riscv32", armv7em)))]
            let left =
                self.take::<W, N, P, K>(config, met, &centroid::Anyhow { raw: pixels, width, cut });
            // What a kernel does not take goes the way of any window.
            if left < next {
                self.floored_rows::<W, N, P, K>(config, [left, left + 1], pixels, rows);
            }
            first = left + 1;
        }
    }

    /// [`Readout::take`] of windows of 8 x 8 pixels.
    ///
    /// Not inlined: it needs all registers.
    #[cfg(target_arch = "riscv32")]
    #[inline(never)]
    fn take_squares<const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        [first, next]: [usize; 2],
        block: Block<'_>,
        cut: Cut,
    ) -> usize {
        let (Some(starts), Some(tracking), Some(windows)) = (
            config.starts.get(first..next),
            self.tracking.get(self.complete).and_then(|done| done.get(first..next)),
            self.windows.get_mut(first..next),
        ) else {
            return first;
        };
        let floors = config.bank.floors_of(first, next, 8 * 8);
        let taken =
            squares::take(block, self.row, cut, Squares { starts, tracking, floors, windows });
        first.wrapping_add(taken)
    }

    /// Takes windows from the first on, and returns the first that could not be taken.
    ///
    /// Not inlined: it needs all registers.
    #[inline(never)]
    fn take<const W: usize, const N: usize, const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        [first, next]: [usize; 2],
        rows: &impl WholeWindows<W, N>,
    ) -> usize {
        let (width, row) = (usize::from(config.width), usize::from(self.row));
        let (Some(slots), Some(tracking), Some(windows)) = (
            config.slots.get(first..next),
            self.tracking.get(self.complete).and_then(|done| done.get(first..next)),
            self.windows.get_mut(first..next),
        ) else {
            return first;
        };
        let windows = slots.iter().zip(tracking).zip(windows);
        let floors = rows.floors(config.bank.floors_of(first, next, W * W));
        let mut left = first;
        for (((slot, tracking), window), floors) in windows.zip(floors) {
            let y = usize::from(slot.y0).wrapping_sub(row);
            let start = y.wrapping_mul(width).wrapping_add(usize::from(slot.x0));
            // Below W, a power of two, already.
            let [x, y] = centroid::watched(W, tracking.near);
            let watched = [x, y % W];
            let Some((sums, seen)) = rows.window(start, floors, tracking.excess, watched) else {
                break;
            };
            let mut moments = Moments::ZERO;
            moments.add_rows(W, 0, W, sums);
            *window = Window { moments, seen };
            left = left.wrapping_add(1);
        }
        left
    }

    /// Adds the rows to every window they meet, for centre of gravity above floors. `W` is the
    /// window's size and `N` half of it, or both 0 for any.
    ///
    /// Not inlined: it needs all registers.
    #[inline(never)]
    fn floored_rows<const W: usize, const N: usize, const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        [first, next]: [usize; 2],
        pixels: &[u16],
        rows: u16,
    ) {
        let size = if W == 0 { config.window } else { W };
        let (width, row) = (usize::from(config.width), self.row);
        let slots = config.slots.get(first..next).unwrap_or_default();
        let tracking = self.tracking.get(self.complete).and_then(|done| done.get(first..next));
        let windows = self.windows.get_mut(first..next).unwrap_or_default();
        let windows = slots.iter().zip(tracking.unwrap_or_default()).zip(windows);
        let base = config.bank.cut(0);
        let area = (size * size).max(1);
        let floors = config.bank.floors_of(first, next, area).chunks_exact(area);
        for (((slot, tracking), window), floors) in windows.zip(floors) {
            // Of the rows, those before the window's first; of the window, those before them.
            let before = usize::from(slot.y0.saturating_sub(row));
            let y = usize::from(row.saturating_sub(slot.y0));
            let count = usize::from(rows).wrapping_sub(before).min(size.wrapping_sub(y));
            let x0 = usize::from(slot.x0);
            // Both are there in a validated configuration and rows of the right length.
            let (Some(raw), Some(floor)) = (
                pixels.get(before.wrapping_mul(width).wrapping_add(x0)..),
                floors.get(y * size..y.wrapping_add(count).wrapping_mul(size)),
            ) else {
                continue;
            };
            if y == 0 {
                *window = Window::NEW;
            }
            let cut = Cut { excess: tracking.excess, ..base };
            let sums = centroid::floored_moments::<N>(raw, width, floor, size, cut);
            window.moments.add_rows(size, y, count, sums);
            let [x, watched] = centroid::watched(size, tracking.near);
            let watched = watched.wrapping_sub(y);
            if watched < count {
                // All there, as above.
                let seen = raw
                    .get(watched.wrapping_mul(width).wrapping_add(x)..)
                    .zip(floor.get(watched * size + x..))
                    .and_then(|(raw, floor)| centroid::watch_floored::<N>(raw, floor, cut));
                window.seen = seen.unwrap_or(Seen::NOTHING);
            }
        }
    }

    /// Adds the row to every window it meets. `W` is the window's size, or 0 for any.
    #[inline(never)]
    fn rows_of<const W: usize, const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        [first, next]: [usize; 2],
        pixels: &[u16],
    ) {
        let size = if W == 0 { config.window } else { W };
        let area = size * size;
        let row = self.row;
        let slots = config.slots.get(first..next).unwrap_or_default();
        let tracking = self.tracking.get(self.complete).and_then(|done| done.get(first..next));
        let windows = self.windows.get_mut(first..next).unwrap_or_default();
        let windows = slots.iter().zip(tracking.unwrap_or_default()).zip(windows);
        let bank = &config.bank;
        // Window, its row, that row's calibration and its pixels. What is not there in a validated
        // configuration and a row of the right length is skipped.
        let lines = windows.enumerate().filter_map(|(k, ((slot, tracking), window))| {
            let y = usize::from(row.wrapping_sub(slot.y0));
            let x0 = usize::from(slot.x0);
            if y == 0 {
                *window = Window::NEW;
            }
            let calibration = bank.row((first + k) * area + y * size, size)?;
            Some((window, *tracking, y, calibration, pixels.get(x0..x0 + size)?))
        });
        match config.estimator {
            EstimatorConfig::CentreOfGravity { .. } => {
                for (window, tracking, y, row, raw) in lines {
                    let cut = bank.cut(tracking.excess);
                    window.watch(&tracking, (size, y), raw, row, cut);
                    let sums = centroid::calibrated_row_moments(raw, row, cut);
                    window.moments.add_row(size, y, sums);
                }
            }
            EstimatorConfig::Weighted { .. } => {
                let weighted = self.weighted.get_mut(first..next).unwrap_or_default().iter_mut();
                let weighted = weighted.zip(self.centres.get(first..next).unwrap_or_default());
                for ((window, tracking, y, row, raw), (moments, centre)) in lines.zip(weighted) {
                    let mut buffer = [0u16; MAX_WINDOW];
                    let Some(signal) = buffer.get_mut(..size) else { continue };
                    let cut = bank.cut(tracking.excess);
                    window.watch(&tracking, (size, y), raw, row, cut);
                    pixels::signal(raw, row, cut, signal);
                    let [cx, cy] = centre.map(i32::from);
                    let weights = config.template.row(size, cx);
                    let weight = config.template.weight(size, cy, y);
                    if y == 0 {
                        *moments = WeightedMoments::ZERO;
                    }
                    let sums = centroid::weighted_row_moments(signal, weights, weight);
                    moments.add_row(size, y, sums);
                }
            }
            EstimatorConfig::Brightest { n, bits } => {
                for (k, (window, tracking, y, row, raw)) in (first..).zip(lines) {
                    let start = (k % config.concurrent.max(1)) * area;
                    let Some(stored) = self.buffer.get_mut(start..start + area) else { continue };
                    let Some(signal) = stored.get_mut(y * size..(y + 1) * size) else {
                        continue;
                    };
                    window.watch(&tracking, (size, y), raw, row, bank.cut(0));
                    pixels::signal(raw, row, bank.cut(0), signal);
                    if y + 1 == size {
                        window.moments = centroid::brightest_moments(stored, size, n, bits);
                    }
                }
            }
        }
    }

    /// Counts `rows` rows as taken and measures every window that has ended with them: all that they met
    /// if those are `whole`.
    #[inline(always)]
    fn end<const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        rows: u16,
        whole: bool,
        sink: &mut impl Sink<M>,
    ) {
        self.row = self.row.wrapping_add(rows);
        let [start, next] = self.active;
        let met = config.slots.get(start..next).unwrap_or_default().iter();
        let has_ended =
            |slot: &&Slot| usize::from(slot.y0) + config.window <= usize::from(self.row);
        let end = match whole {
            true => next,
            false => start.wrapping_add(met.take_while(has_ended).count()),
        };
        self.active = [end, next];
        let mut start = start;
        while start < end {
            let some = [start, end.min(start.wrapping_add(BATCH))];
            #[cfg(target_arch = "riscv32")]
            {
                let taken = match (config.low_thresholds, config.small_fluxes) {
                    (true, true) => self.take_spots::<true, true, P, K>(config, some, sink),
                    (true, false) => self.take_spots::<true, false, P, K>(config, some, sink),
                    (false, _) => self.take_spots::<false, false, P, K>(config, some, sink),
                };
                if taken {
                    [_, start] = some;
                    continue;
                }
            }
            match config.estimator {
                EstimatorConfig::Weighted { gain, .. } => {
                    self.measure::<true, P, K>(config, some, gain);
                }
                _ => self.measure::<false, P, K>(config, some, 0),
            }
            [_, start] = some;
            if let Some(new) = self.measurements.get(1 - self.complete) {
                sink.take(some, new);
            }
        }
    }

    /// Measures windows and hands them over at once, if they are such as the kernel takes; `LOW` if
    /// thresholds are, `SMALL` if fluxes are.
    ///
    /// Not inlined: it needs all registers.
    #[cfg(target_arch = "riscv32")]
    #[inline(never)]
    fn take_spots<const LOW: bool, const SMALL: bool, const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        [first, next]: [usize; 2],
        sink: &mut impl Sink<M>,
    ) -> bool {
        let EstimatorConfig::CentreOfGravity { peak_fraction } = config.estimator else {
            return false;
        };
        let convention = config.bank.convention;
        if !config.in_order
            || !config.window.is_multiple_of(2)
            || convention != Convention::Subtract
        {
            return false;
        }
        let pair = [self.complete, 1 - self.complete];
        let (Ok([done, new]), Some(measurements), Some(subapertures)) = (
            self.tracking.get_disjoint_mut(pair),
            self.measurements.get_mut(1 - self.complete),
            sink.subapertures([first, next]),
        ) else {
            return false;
        };
        let (Some(windows), Some(tracking), Some(new), Some(limits), Some(measurements)) = (
            self.windows.get(first..next),
            done.get(first..next),
            new.get_mut(first..next),
            config.limits.get(first..next),
            measurements.get_mut(first..next),
        ) else {
            return false;
        };
        let spots = Spots { windows, tracking, next: new, limits, measurements, peak_fraction };
        spots::take::<M, LOW, SMALL>(spots, subapertures);
        true
    }

    /// Measures windows from their moments, or from their weighted ones, of which `gain` undoes the weight.
    ///
    /// Not inlined: it needs all registers.
    #[inline(never)]
    fn measure<const WEIGHTED: bool, const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        [start, end]: [usize; 2],
        gain: i32,
    ) {
        let (Some(measurements), Ok([done, new])) = (
            self.measurements.get_mut(1 - self.complete),
            self.tracking.get_disjoint_mut([self.complete, 1 - self.complete]),
        ) else {
            return;
        };
        let bases = config.base_thresholds.as_slice();
        // Always there. (Where the compiler knows that, it adds up addresses at every use.)
        let tracking = done.get(start..end).unwrap_or_default().iter();
        let tracking = tracking.zip(new.get_mut(start..end).unwrap_or_default());
        let windows = self.windows.get(start..end).unwrap_or_default().iter().zip(tracking);
        let weighted = (&self.weighted, &self.centres, gain);
        let shared = Shared::new(config);
        let measure =
            |k, (window, (tracking, next)): (&Window, (&Tracking, &mut Tracking)), base| {
                let measurement;
                (measurement, *next) = match WEIGHTED {
                    true => window.weighted(weighted, k, tracking, base, &shared),
                    false => window.measured(tracking, base, &shared),
                };
                measurement
            };
        // As many of both, so that one comparison finds a subaperture in them.
        let Some(measurements) = measurements.get_mut(..bases.len()) else { return };
        let slots = config.slots.get(start..end).unwrap_or_default();
        for (k, (window, slot)) in (start..).zip(windows.zip(slots)) {
            let subaperture = usize::from(slot.subaperture);
            if let (Some(place), Some(&base)) =
                (measurements.get_mut(subaperture), bases.get(subaperture))
            {
                *place = measure(k, window, base);
            }
        }
    }

    /// Takes measurements made elsewhere in place of a frame's rows; centroids and peaks saturate.
    pub(crate) fn supply<const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        measurements: &[Measurement],
        sink: &mut impl Sink<M>,
    ) {
        let (Some(new), Some(tracking)) = (
            self.measurements.get_mut(1 - self.complete),
            self.tracking.get_mut(1 - self.complete),
        ) else {
            return;
        };
        for (place, &new) in new.iter_mut().zip(measurements) {
            let bound = |c: i32| c.clamp(-CENTROID_LIMIT, CENTROID_LIMIT);
            *place = Measurement {
                centroid_q16: new.centroid_q16.map(bound),
                // The next frame's thresholds come from it, and pixels have no more.
                peak: new.peak.min(config.bank.top),
                ..new
            };
        }
        let count = config.slots.len();
        for first in (0..count).step_by(BATCH) {
            sink.take([first, count.min(first + BATCH)], new);
        }
        let shared = Shared::new(config);
        for (slot, next) in config.slots.iter().zip(tracking) {
            let subaperture = usize::from(slot.subaperture);
            let places = (new.get(subaperture), config.base_thresholds.get(subaperture));
            if let (Some(measurement), Some(&base)) = places {
                *next = Tracking::next::<false>(measurement, base, &shared);
            }
        }
        self.row = config.height;
    }

    /// Windows that the frame just read did not light keep what the last complete one left of them.
    pub(crate) fn retain<const P: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        lit: impl Fn(usize) -> bool,
    ) {
        let pair = [self.complete, 1 - self.complete];
        let (Ok([done, new]), Ok([tracked, next])) =
            (self.measurements.get_disjoint_mut(pair), self.tracking.get_disjoint_mut(pair))
        else {
            return;
        };
        for (slot, (next, tracked)) in config.slots.iter().zip(next.iter_mut().zip(tracked)) {
            let subaperture = usize::from(slot.subaperture);
            if lit(subaperture) {
                continue;
            }
            *next = *tracked;
            if let (Some(new), Some(done)) = (new.get_mut(subaperture), done.get(subaperture)) {
                *new = *done;
            }
        }
    }

    /// Makes the frame just read the last complete one: its measurements become readable, its
    /// peaks and centroids set the next frame's thresholds, watched pixels and weights.
    ///
    /// A window without flux keeps its weight where it was.
    pub(crate) fn commit<const P: usize, const K: usize>(&mut self, config: &Config<M, P, B, K>) {
        self.complete = 1 - self.complete;
        if !matches!(config.estimator, EstimatorConfig::Weighted { .. }) {
            return;
        }
        let measured = self.measurements.get(self.complete).map_or(&[][..], |frame| frame);
        for (slot, centre) in config.slots.iter().zip(&mut self.centres) {
            let Some(measurement) = measured.get(usize::from(slot.subaperture)) else {
                continue;
            };
            if measurement.flux > 0 {
                *centre = measurement
                    .centroid_q16
                    .map(|centroid| Template::centre(config.window, centroid) as i16);
            }
        }
    }

    /// Which of two places is that of the last complete frame: 0 or 1.
    pub(crate) const fn complete(&self) -> usize {
        self.complete
    }

    /// The measurements of the last complete frame, in subaperture order.
    pub(crate) fn measurements(&self) -> &[Measurement] {
        self.measurements.get(self.complete).map_or(&[], |frame| frame)
    }
}
