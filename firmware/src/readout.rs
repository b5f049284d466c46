//! Readout: detector rows to one measurement a subaperture, as the rows arrive.
//!
//! Windows are kept in readout order, so that those which a row meets are one contiguous range
//! with two ends that only move forward. Nothing of a row is kept but its windows' sums (and, for
//! brightest-n, their pixels). A window is finished with its last row; after the last row of the
//! frame nothing is left to do here.

use crate::centroid::{
    self, CENTROID_LIMIT, EstimatorConfig, MAX_WINDOW, Measurement, Moments, Template,
    WeightedMoments,
};
use crate::config::{Config, Slot};
use crate::pixels::{self, Convention, Cut, Noted, Seen, WATCHED};

/// What is kept of a window between its rows, and from frame to frame.
#[derive(Clone, Copy, Debug)]
struct Window {
    moments: Moments,
    seen: Seen,
    /// Moving threshold beyond the fixed one, signal units.
    excess: u16,
    /// First of the rows in which the peak is looked for.
    watched: u8,
}

/// What the weighted estimator keeps of a window.
#[derive(Clone, Copy, Debug)]
struct Weighted {
    moments: WeightedMoments,
    /// Centre of the weight, eighths of a pixel, within +-128.
    centre: [i16; 2],
}

impl Window {
    const NEW: Self = Self { moments: Moments::ZERO, seen: Seen::NOTHING, excess: 0, watched: 0 };

    /// Forgets the rows of the last frame.
    #[inline(always)]
    fn start(&mut self) {
        self.moments = Moments::ZERO;
        self.seen = Seen::NOTHING;
    }

    #[inline(always)]
    fn watches(&self, y: usize) -> bool {
        y.wrapping_sub(usize::from(self.watched)) < WATCHED
    }

    /// What a watched row adds to.
    #[inline(always)]
    fn watch(&mut self, y: usize) -> Option<&mut Seen> {
        self.watches(y).then_some(&mut self.seen)
    }

    /// The measurement, of `moments` or its own.
    #[inline]
    fn measurement(&self, moments: &Moments, flux: u32, config: &Shared) -> Measurement {
        let Noted { peak, saturated } = self.seen.all();
        // What was taken off the peak; nothing off none.
        let taken = self.excess * u16::from(config.subtracts) * u16::from(peak != 0);
        Measurement {
            centroid_q16: moments.centroid_q16(config.short_sums),
            flux,
            peak: peak.wrapping_add(taken),
            saturated,
        }
    }
}

impl Weighted {
    const NEW: Self = Self { moments: WeightedMoments::ZERO, centre: [0; 2] };
}

/// The smaller of two, without a branch.
#[inline(always)]
fn least(a: usize, b: usize) -> usize {
    a.wrapping_sub(a.saturating_sub(b))
}

/// What all windows share.
#[derive(Clone, Copy)]
struct Shared {
    /// Whether thresholds are subtracted.
    subtracts: bool,
    short_sums: bool,
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
    /// In readout order.
    weighted: [Weighted; M],
    /// In subaperture order: those of the last complete frame and those being measured.
    measurements: [[Measurement; M]; 2],
    /// Which of `measurements` is complete.
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
            weighted: [Weighted::NEW; M],
            measurements: [[BLANK; M]; 2],
            complete: 0,
            buffer: [0; B],
        }
    }

    /// Starts a frame; what was measured of an unfinished one is dropped.
    pub(crate) fn begin(&mut self, windows: usize) {
        self.row = 0;
        self.active = [0; 2];
        self.windows.iter_mut().take(windows).for_each(Window::start);
    }

    /// Forgets thresholds and centres as well.
    pub(crate) fn reset(&mut self, window: usize) {
        self.begin(0);
        let watched = centroid::first_watched(window, 0);
        self.windows.fill(Window { watched, ..Window::NEW });
        self.weighted.fill(Weighted::NEW);
        self.measurements.as_flattened_mut().fill(Measurement::default());
    }

    /// Rows taken since [`Readout::begin`].
    pub(crate) const fn rows(&self) -> u16 {
        self.row
    }

    /// Takes the next `rows` rows, which have the detector's width.
    #[inline]
    pub(crate) fn push<const P: usize>(
        &mut self,
        config: &Config<M, P, B>,
        pixels: &[u16],
        rows: u16,
    ) {
        // The common sizes get loops of known length; the results are the same.
        let only_floors = config.bank.only_floors()
            && matches!(config.estimator, EstimatorConfig::CentreOfGravity { .. });
        if only_floors {
            let met = self.meet(config, rows);
            match config.window {
                8 => self.floored_rows::<8, 4, P>(config, met, pixels, rows),
                16 => self.floored_rows::<16, 8, P>(config, met, pixels, rows),
                _ => self.floored_rows::<0, 0, P>(config, met, pixels, rows),
            }
            self.row = self.row.wrapping_add(rows);
            return;
        }
        for pixels in pixels.chunks_exact(usize::from(config.width).max(1)) {
            let met = self.meet(config, 1);
            match config.window {
                8 => self.rows_of::<8, P>(config, met, pixels),
                16 => self.rows_of::<16, P>(config, met, pixels),
                _ => self.rows_of::<0, P>(config, met, pixels),
            }
            self.row = self.row.wrapping_add(1);
        }
    }

    /// First window that the next `rows` rows meet, and first that they do not meet any more.
    #[inline(always)]
    fn meet<const P: usize>(&mut self, config: &Config<M, P, B>, rows: u16) -> [usize; 2] {
        let [first, next] = &mut self.active;
        let end = self.row.wrapping_add(rows);
        let starts = |slot: &Slot| slot.y0 < end;
        while config.slots.get(*next).is_some_and(starts) {
            *next += 1;
        }
        let ended = |slot: &Slot| usize::from(slot.y0) + config.window <= usize::from(self.row);
        while config.slots.get(*first).is_some_and(ended) {
            *first += 1;
        }
        self.active
    }

    /// Adds the rows to every window they meet, for centre of gravity above floors. `W` is the
    /// window's size and `N` half of it, or both 0 for any.
    ///
    /// Not inlined: it needs all registers.
    #[inline(never)]
    fn floored_rows<const W: usize, const N: usize, const P: usize>(
        &mut self,
        config: &Config<M, P, B>,
        [first, next]: [usize; 2],
        pixels: &[u16],
        rows: u16,
    ) {
        let size = if W == 0 { config.window } else { W };
        let (width, row) = (usize::from(config.width), self.row);
        let slots = config.slots.get(first..next).unwrap_or_default();
        let windows = self.windows.get_mut(first..next).unwrap_or_default();
        let Some(measurements) = self.measurements.get_mut(1 - self.complete) else { return };
        let shared = Shared { subtracts: true, short_sums: config.short_sums };
        let base = config.bank.cut(0);
        for ((slot, window), floors) in
            slots.iter().zip(windows).zip(config.bank.floors_of(first, next, size * size))
        {
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
            let cut = Cut { excess: window.excess, ..base };
            let sums = centroid::floored_moments::<N>(raw, width, floor, size, cut);
            window.moments.add_rows(size, y, count, sums);
            // Those of the watched rows that are among these; none is a case like the others, whose
            // time does not show.
            let watched = usize::from(window.watched);
            let [from, to] = [watched, watched.wrapping_add(WATCHED)]
                .map(|row| least(row.saturating_sub(y), count));
            let first = least(from, count.wrapping_sub(1));
            let (Some(raw), Some(floor)) = (
                raw.get(first.wrapping_mul(width)..),
                floor.get(
                    first * size..first.wrapping_add(to.wrapping_sub(from)).wrapping_mul(size),
                ),
            ) else {
                continue;
            };
            centroid::note_floored::<N>(raw, width, floor, size, cut, &mut window.seen);
            if y.wrapping_add(count) == size {
                let measurement = window.measurement(&window.moments, window.moments.sum, &shared);
                if let Some(place) = measurements.get_mut(usize::from(slot.subaperture)) {
                    *place = measurement;
                }
            }
        }
    }

    /// Adds the row to every window it meets. `W` is the window's size, or 0 for any.
    #[inline(never)]
    fn rows_of<const W: usize, const P: usize>(
        &mut self,
        config: &Config<M, P, B>,
        [first, next]: [usize; 2],
        pixels: &[u16],
    ) {
        let size = if W == 0 { config.window } else { W };
        let area = size * size;
        let row = self.row;
        let slots = config.slots.get(first..next).unwrap_or_default();
        let windows = self.windows.get_mut(first..next).unwrap_or_default();
        let Some(measurements) = self.measurements.get_mut(1 - self.complete) else { return };
        let bank = &config.bank;
        let shared = Shared {
            subtracts: bank.convention == Convention::Subtract,
            short_sums: config.short_sums,
        };
        // Window, its row, its place in the bank and its pixels. What is not there in a validated
        // configuration and a row of the right length is skipped.
        let lines = slots.iter().zip(windows).enumerate().filter_map(|(k, (slot, window))| {
            let y = usize::from(row.wrapping_sub(slot.y0));
            let x0 = usize::from(slot.x0);
            Some((slot, window, y, (first + k) * area + y * size, pixels.get(x0..x0 + size)?))
        });
        let mut finish = |slot: &Slot, measurement| {
            if let Some(place) = measurements.get_mut(usize::from(slot.subaperture)) {
                *place = measurement;
            }
        };
        match config.estimator {
            EstimatorConfig::CentreOfGravity { .. } => {
                for (slot, window, y, place, raw) in lines {
                    let Some(row) = bank.row(place, size) else { continue };
                    let cut = bank.cut(window.excess);
                    let sums = centroid::calibrated_row_moments(raw, row, cut, window.watch(y));
                    window.moments.add_row(size, y, sums);
                    if y + 1 == size {
                        let moments = window.moments;
                        finish(slot, window.measurement(&moments, moments.sum, &shared));
                    }
                }
            }
            EstimatorConfig::Weighted { gain, .. } => {
                let weighted = self.weighted.get_mut(first..next).unwrap_or_default();
                let shared = Shared { short_sums: false, ..shared };
                for ((slot, window, y, place, raw), weighted) in lines.zip(weighted) {
                    let Some(row) = bank.row(place, size) else { continue };
                    let mut buffer = [0u16; MAX_WINDOW];
                    let Some(signal) = buffer.get_mut(..size) else { continue };
                    let cut = bank.cut(window.excess);
                    pixels::signal(raw, row, cut, window.watch(y), signal);
                    let [cx, cy] = weighted.centre.map(i32::from);
                    let weights = config.template.row(size, cx);
                    let weight = config.template.weight(size, cy, y);
                    if y == 0 {
                        weighted.moments = WeightedMoments::ZERO;
                    }
                    let sums = centroid::weighted_row_moments(signal, weights, weight);
                    weighted.moments.add_row(size, y, sums);
                    if y + 1 == size {
                        let (moments, flux) = (weighted.moments.narrow(), weighted.moments.flux());
                        let mut measurement = window.measurement(&moments, flux, &shared);
                        let axes = measurement.centroid_q16.iter_mut().zip([cx, cy]);
                        axes.for_each(|(c, centre)| *c = centroid::unweighted(centre, *c, gain));
                        finish(slot, measurement);
                    }
                }
            }
            EstimatorConfig::Brightest { n, bits } => {
                for (k, (slot, window, y, place, raw)) in (first..).zip(lines) {
                    let start = (k % config.concurrent.max(1)) * area;
                    let Some(row) = bank.row(place, size) else { continue };
                    let Some(stored) = self.buffer.get_mut(start..start + area) else { continue };
                    let Some(signal) = stored.get_mut(y * size..(y + 1) * size) else {
                        continue;
                    };
                    pixels::signal(raw, row, bank.cut(0), window.watch(y), signal);
                    if y + 1 == size {
                        let moments = centroid::brightest_moments(stored, size, n, bits);
                        finish(slot, window.measurement(&moments, moments.sum, &shared));
                    }
                }
            }
        }
    }

    /// Takes measurements made elsewhere in place of a frame's rows; centroids saturate.
    pub(crate) fn supply<const P: usize>(
        &mut self,
        config: &Config<M, P, B>,
        measurements: &[Measurement],
    ) {
        if let Some(new) = self.measurements.get_mut(1 - self.complete) {
            for (place, &new) in new.iter_mut().zip(measurements) {
                let bound = |c: i32| c.clamp(-CENTROID_LIMIT, CENTROID_LIMIT);
                *place = Measurement { centroid_q16: new.centroid_q16.map(bound), ..new };
            }
        }
        self.row = config.height;
    }

    /// Makes the frame just read the last complete one: its measurements become readable, its
    /// peaks and centroids set the next frame's thresholds, watched rows and weights.
    ///
    /// A window without flux keeps its rows and its weight where they were; its threshold follows
    /// its peak.
    pub(crate) fn commit<const P: usize>(&mut self, config: &Config<M, P, B>) {
        self.complete = 1 - self.complete;
        let fraction = match config.estimator {
            EstimatorConfig::CentreOfGravity { peak_fraction }
            | EstimatorConfig::Weighted { peak_fraction, .. } => peak_fraction,
            EstimatorConfig::Brightest { .. } => 0,
        };
        let weighted = matches!(config.estimator, EstimatorConfig::Weighted { .. });
        let subtracts = u16::from(config.bank.convention == Convention::Subtract);
        let measured = self.measurements.get(self.complete).map_or(&[][..], |frame| frame);
        for (slot, window) in config.slots.iter().zip(&mut self.windows) {
            let subaperture = usize::from(slot.subaperture);
            let places = (measured.get(subaperture), config.base_thresholds.get(subaperture));
            let (Some(measurement), Some(&base)) = places else { continue };
            let covered = base * subtracts;
            window.excess = centroid::excess(measurement.peak, fraction, base, covered);
            let [_, y_q16] = measurement.centroid_q16;
            let seen = centroid::first_watched(config.window, y_q16);
            // Opaque, or the compiler makes a branch of it: the time must not tell what is lit.
            let lit = core::hint::black_box(u8::from(measurement.flux != 0));
            window.watched = seen * lit + window.watched * (1 - lit);
        }
        if weighted {
            for (slot, weighted) in config.slots.iter().zip(&mut self.weighted) {
                let Some(measurement) = measured.get(usize::from(slot.subaperture)) else {
                    continue;
                };
                if measurement.flux > 0 {
                    weighted.centre = measurement
                        .centroid_q16
                        .map(|centroid| Template::centre(config.window, centroid) as i16);
                }
            }
        }
    }

    /// The measurements of the last complete frame, in subaperture order.
    pub(crate) fn measurements(&self) -> &[Measurement] {
        self.measurements.get(self.complete).map_or(&[], |frame| frame)
    }
}
