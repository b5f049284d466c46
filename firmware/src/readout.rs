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
use crate::pixels::{self, BankRow, Convention, RowPixels};

/// What a subaperture's next frame needs of its last complete one.
#[derive(Clone, Copy, Debug, Default)]
struct History {
    /// Moving threshold beyond the fixed one, signal units.
    excess: u16,
    /// Centre of the weight, eighths of a pixel, within +-128.
    centre: [i16; 2],
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
        for (k, (slot, moments)) in slots.iter().zip(moments).enumerate() {
            let (x0, y) = (usize::from(slot.x0), usize::from(self.row - slot.y0));
            let place = (first + k) * window * window + y * window;
            let subaperture = usize::from(slot.subaperture);
            // All three exist in a validated configuration and a row of the right length.
            let (Some(raw), Some(bank), Some(history)) = (
                pixels.get(x0..x0 + window),
                config.bank.row(place, window),
                self.history.get(subaperture),
            ) else {
                continue;
            };
            if y == 0 {
                *moments = Moments::ZERO;
            }
            let last = y + 1 == window;
            let mut row = [0u16; MAX_WINDOW];
            let Some(signal) = row.get_mut(..window) else { continue };
            let measurement = match config.estimator {
                EstimatorConfig::CentreOfGravity { .. } => {
                    let seen = calibrate(config, raw, bank, history.excess, signal);
                    let (sum, x) = centroid::row_moments(signal);
                    moments.add_row(window, y, sum, x);
                    note(moments, seen);
                    last.then(|| moments.measurement(0))
                }
                EstimatorConfig::Weighted { gain, .. } => {
                    let seen = calibrate(config, raw, bank, history.excess, signal);
                    let [cx, cy] = history.centre.map(i32::from);
                    let weights = config.template.row(window, cx);
                    let weight = config.template.weight(window, cy, y);
                    let (sum, x) = centroid::weighted_row_moments(signal, weights, weight);
                    moments.add_row(window, y, sum, x);
                    note(moments, seen);
                    last.then(|| {
                        let mut measurement = moments.measurement(WEIGHT_BITS);
                        let axes = measurement.centroid_q16.iter_mut().zip([cx, cy]);
                        axes.for_each(|(c, centre)| *c = centroid::unweighted(centre, *c, gain));
                        measurement
                    })
                }
                EstimatorConfig::Brightest { n, bits } => {
                    let area = window * window;
                    let start = ((first + k) % config.concurrent.max(1)) * area;
                    let Some(stored) = self.buffer.get_mut(start..start + area) else { continue };
                    let Some(signal) = stored.get_mut(y * window..(y + 1) * window) else {
                        continue;
                    };
                    let seen = calibrate(config, raw, bank, 0, signal);
                    note(moments, seen);
                    last.then(|| {
                        let sums = centroid::brightest_moments(stored, window, n, bits);
                        let Moments { peak, saturated, .. } = *moments;
                        Moments { peak, saturated, ..sums }.measurement(0)
                    })
                }
            };
            if let (Some(measurement), Some(place)) =
                (measurement, measurements.get_mut(subaperture))
            {
                *place = measurement;
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
    /// A window without flux keeps its weight where it was and falls back to the fixed threshold.
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

#[inline(always)]
fn calibrate<const M: usize, const P: usize, const B: usize>(
    config: &Config<M, P, B>,
    raw: &[u16],
    row: BankRow<'_>,
    excess: u16,
    signal: &mut [u16],
) -> RowPixels {
    let bank = &config.bank;
    match bank.convention {
        Convention::Subtract => pixels::calibrate(raw, row, excess, bank.saturation, signal),
        Convention::ZeroBelow => {
            let shift = bank.threshold_shift;
            pixels::calibrate_zero_below(raw, row, shift, excess, bank.saturation, signal)
        }
    }
}

#[inline(always)]
fn note(moments: &mut Moments, seen: RowPixels) {
    moments.peak = moments.peak.max(seen.peak);
    moments.saturated = moments.saturated.wrapping_add(seen.saturated);
}
