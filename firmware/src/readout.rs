//! Readout: detector rows to one measurement a subaperture, as the rows arrive.
//!
//! Windows are kept in readout order, so that those which a row meets are one contiguous range
//! with two ends that only move forward. Nothing of a row is kept but its windows' sums (and, for
//! brightest-n, their pixels). A window is finished with its last row; after the last row of the
//! frame nothing is left to do here.

use crate::centroid::{
    self, EstimatorConfig, MAX_WINDOW, Measurement, Moments, Template, WEIGHT_BITS,
};
use crate::config::{Config, Slot};
use crate::pixels::{self, BankRow, Convention, Cut};

/// What a subaperture's next frame needs of its last complete one.
#[derive(Clone, Copy, Debug, Default)]
struct History {
    /// Moving threshold beyond the fixed one, signal units.
    excess: u16,
    /// Centre of the weight, eighths of a pixel, within +-128.
    centre: [i16; 2],
}

/// A row of one window, and what it adds to.
struct Line<'a> {
    /// Number of the window in readout order.
    window: usize,
    /// Row of the window.
    y: usize,
    subaperture: usize,
    raw: &'a [u16],
    bank: BankRow<'a>,
    history: &'a History,
    moments: &'a mut Moments,
}

/// The state of the readout. `M` and `B` as in [`Config`].
#[derive(Debug)]
pub(crate) struct Readout<const M: usize, const B: usize> {
    /// The next row.
    row: u16,
    /// First window that the next row can meet, and first that no row has met.
    active: [usize; 2],
    /// In readout order.
    moments: [Moments; M],
    /// In subaperture order.
    history: [History; M],
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
            moments: [Moments::ZERO; M],
            history: [History { excess: 0, centre: [0; 2] }; M],
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
        self.history.fill(History::default());
        self.measurements.as_flattened_mut().fill(Measurement::default());
    }

    /// Rows taken since [`Readout::begin`].
    pub(crate) const fn rows(&self) -> u16 {
        self.row
    }

    /// Takes the next row, which has the detector's width.
    #[inline]
    pub(crate) fn push<const P: usize>(&mut self, config: &Config<M, P, B>, pixels: &[u16]) {
        // The common sizes get loops of known length; the results are the same.
        match config.window {
            8 => self.windows::<8, P>(config, pixels),
            16 => self.windows::<16, P>(config, pixels),
            _ => self.windows::<0, P>(config, pixels),
        }
        self.row = self.row.wrapping_add(1);
    }

    /// Adds the row to every window it meets. `W` is the window's size, or 0 for any.
    #[inline(always)]
    fn windows<const W: usize, const P: usize>(
        &mut self,
        config: &Config<M, P, B>,
        pixels: &[u16],
    ) {
        let window = if W == 0 { config.window } else { W };
        let [first, next] = &mut self.active;
        let starts = |slot: &Slot| slot.y0 <= self.row;
        while config.slots.get(*next).is_some_and(starts) {
            *next += 1;
        }
        let ended = |slot: &Slot| usize::from(slot.y0) + window <= usize::from(self.row);
        while config.slots.get(*first).is_some_and(ended) {
            *first += 1;
        }
        let (first, next) = (*first, *next);
        let slots = config.slots.get(first..next).unwrap_or_default();
        let moments = self.moments.get_mut(first..next).unwrap_or_default();
        let [done, new] = &mut self.measurements;
        let measurements = if self.complete == 0 { new } else { done };
        let bank = &config.bank;
        let (row, history) = (self.row, &self.history);
        let whole = slots.iter().zip(moments).zip(bank.windows(first, next, window * window));
        // What is not there in a validated configuration and a row of the right length is skipped.
        let lines = whole.enumerate().filter_map(|(k, ((slot, moments), pixel))| {
            let y = usize::from(row.wrapping_sub(slot.y0));
            let x0 = usize::from(slot.x0);
            let subaperture = usize::from(slot.subaperture);
            if y == 0 {
                *moments = Moments::ZERO;
            }
            Some(Line {
                window: first + k,
                y,
                subaperture,
                raw: pixels.get(x0..x0 + window)?,
                bank: pixel.part(y * window, window)?,
                history: history.get(subaperture)?,
                moments,
            })
        });
        let cut = |excess| Cut {
            convention: bank.convention,
            shift: bank.threshold_shift,
            excess,
            saturation: bank.saturation,
        };
        let mut finish = |subaperture, measurement| {
            if let Some(place) = measurements.get_mut::<usize>(subaperture) {
                *place = measurement;
            }
        };
        match config.estimator {
            EstimatorConfig::CentreOfGravity { .. } => {
                for Line { y, subaperture, raw, bank, history, moments, .. } in lines {
                    let cut = cut(history.excess);
                    let (sum, x) =
                        centroid::calibrated_row_moments(raw, bank, cut, &mut moments.seen);
                    moments.add_row(window, y, sum, x);
                    if y + 1 == window {
                        finish(subaperture, moments.measurement(0));
                    }
                }
            }
            EstimatorConfig::Weighted { gain, .. } => {
                for Line { y, subaperture, raw, bank, history, moments, .. } in lines {
                    let mut buffer = [0u16; MAX_WINDOW];
                    let Some(signal) = buffer.get_mut(..window) else { continue };
                    pixels::signal(raw, bank, cut(history.excess), &mut moments.seen, signal);
                    let [cx, cy] = history.centre.map(i32::from);
                    let weights = config.template.row(window, cx);
                    let weight = config.template.weight(window, cy, y);
                    let (sum, x) = centroid::weighted_row_moments(signal, weights, weight);
                    moments.add_row(window, y, sum, x);
                    if y + 1 == window {
                        let mut measurement = moments.measurement(WEIGHT_BITS);
                        let axes = measurement.centroid_q16.iter_mut().zip([cx, cy]);
                        axes.for_each(|(c, centre)| *c = centroid::unweighted(centre, *c, gain));
                        finish(subaperture, measurement);
                    }
                }
            }
            EstimatorConfig::Brightest { n, bits } => {
                let area = window * window;
                for Line { window: k, y, subaperture, raw, bank, moments, .. } in lines {
                    let start = (k % config.concurrent.max(1)) * area;
                    let Some(stored) = self.buffer.get_mut(start..start + area) else { continue };
                    let Some(signal) = stored.get_mut(y * window..(y + 1) * window) else {
                        continue;
                    };
                    pixels::signal(raw, bank, cut(0), &mut moments.seen, signal);
                    if y + 1 == window {
                        let sums = centroid::brightest_moments(stored, window, n, bits);
                        let sums = Moments { seen: moments.seen, ..sums };
                        finish(subaperture, sums.measurement(0));
                    }
                }
            }
        }
    }

    /// Takes measurements made elsewhere in place of a frame's rows.
    pub(crate) fn supply<const P: usize>(
        &mut self,
        config: &Config<M, P, B>,
        measurements: &[Measurement],
    ) {
        if let Some(new) = self.measurements.get_mut(1 - self.complete) {
            new.iter_mut().zip(measurements).for_each(|(place, &new)| *place = new);
        }
        self.row = config.height;
    }

    /// Makes the frame just read the last complete one: its measurements become readable, its
    /// peaks and centroids set the next frame's thresholds and weights.
    ///
    /// A window without flux keeps its weight where it was; its threshold follows its peak.
    pub(crate) fn commit<const P: usize>(&mut self, config: &Config<M, P, B>) {
        self.complete = 1 - self.complete;
        let fraction = match config.estimator {
            EstimatorConfig::CentreOfGravity { peak_fraction }
            | EstimatorConfig::Weighted { peak_fraction, .. } => peak_fraction,
            EstimatorConfig::Brightest { .. } => 0,
        };
        let subtracts = u16::from(config.bank.convention == Convention::Subtract);
        let measured = self.measurements.get(self.complete).map_or(&[][..], |frame| frame);
        let subapertures = self.history.iter_mut().zip(measured);
        for ((history, measurement), &base) in subapertures.zip(&config.base_thresholds) {
            let covered = base * subtracts;
            history.excess = centroid::excess(measurement.peak, fraction, base, covered);
            let axes = history.centre.iter_mut().zip(measurement.centroid_q16);
            for (centre, centroid) in axes {
                let seen = Template::centre(config.window, centroid) as i16;
                *centre = if measurement.flux > 0 { seen } else { *centre };
            }
        }
    }

    /// The measurements of the last complete frame, in subaperture order.
    pub(crate) fn measurements(&self) -> &[Measurement] {
        self.measurements.get(self.complete).map_or(&[], |frame| frame)
    }
}
