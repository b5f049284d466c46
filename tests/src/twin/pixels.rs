//! Raw windows to centroids.
//!
//! Signals are in the firmware's unit: calibrated ADU divided by the largest pixel gain.

use splash_firmware::pixels::Convention;
use splash_firmware::spec::Estimator;

use super::{round, stored};
use crate::instrument::Instrument;

/// Which numbers a model calibrates with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Numbers {
    /// The physical ones.
    Physical,
    /// Those of the documented formats: whole ADU, 16-bit gains, 8-bit thresholds and weights.
    Stored,
}

/// What a subaperture remembers of the frame before.
#[derive(Clone, Copy, Debug, Default)]
pub struct History {
    /// Its peak, before the moving threshold.
    pub peak: f64,
    /// Its centroid, pixels from the window's centre: the last one with flux.
    pub centroid: [f64; 2],
    /// The same, or the centre without flux.
    pub near: [f64; 2],
}

/// What one window shows.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    /// Pixels from the window's centre; zero without flux.
    pub centroid: [f64; 2],
    /// Sum of what the centroid is made of.
    pub flux: f64,
    /// Brightest of the watched pixels that passes, before the moving threshold; with stored
    /// numbers after the fixed one, if that is subtracted.
    pub peak: f64,
    /// Watched pixels that have a signal and are at or above the saturation level.
    pub saturated: u16,
}

/// One good pixel's calibration, in units of signal but for the dark level.
#[derive(Clone, Copy, Debug)]
struct Pixel {
    raw: f64,
    dark_adu: f64,
    threshold_adu: f64,
    /// Gain over the largest gain.
    gain: f64,
}

/// The pixels of a window in which peak and saturation are looked for, first columns and then rows: four of the row
/// nearest the last centroid, which was at `centroid_px` from the centre, from an even column on, so that the pixel
/// nearest that is the second or third of them, or as far as the window goes.
pub fn watched(size: usize, centroid_px: [f64; 2]) -> [std::ops::Range<usize>; 2] {
    let last = size as f64 - 1.0;
    let [x, y] = centroid_px.map(|c| (c + last / 2.0 + 0.5).floor().clamp(0.0, last));
    let first = (2.0 * ((x - 1.0) / 2.0).floor()).clamp(0.0, size as f64 - 4.0) as usize;
    let row = y as usize;
    [first..first + 4, row..row + 1]
}

/// The model of everything from raw pixels to centroids.
#[derive(Clone, Debug)]
pub struct Detector<'a> {
    instrument: &'a Instrument,
    numbers: Numbers,
    largest_gain: f64,
    /// Unit of the stored thresholds.
    threshold_step: f64,
}

impl<'a> Detector<'a> {
    /// The model of `instrument`.
    pub fn new(instrument: &'a Instrument, numbers: Numbers) -> Self {
        let mut model = Self { instrument, numbers, largest_gain: 1.0, threshold_step: 1.0 };
        let pixels = |model: &Self| {
            let frame = vec![0; model.area()];
            let window = |i| model.window(i, &frame);
            (0..instrument.count()).flat_map(window).flatten().collect::<Vec<_>>()
        };
        let most = |values: Vec<f64>| values.into_iter().fold(0.0, f64::max);
        model.largest_gain = most(pixels(&model).iter().map(|p| p.gain).collect());
        let highest = most(pixels(&model).iter().map(|p| p.threshold_adu * p.gain).collect());
        while highest / model.threshold_step > 255.0 {
            model.threshold_step *= 2.0;
        }
        model
    }

    fn area(&self) -> usize {
        let detector = &self.instrument.detector;
        usize::from(detector.width) * usize::from(detector.height)
    }

    /// Calibrated ADU per unit of signal.
    pub fn largest_gain(&self) -> f64 {
        self.largest_gain
    }

    /// The pixels of window `i`, row-major; `None` for a bad one.
    fn window(&self, i: usize, frame: &[u16]) -> Vec<Option<Pixel>> {
        let instrument = self.instrument;
        let [x0, y0] = instrument.origins[i];
        let size = u16::from(instrument.window);
        let places = (0..size).flat_map(|y| (0..size).map(move |x| [x0 + x, y0 + y]));
        let pixel = |[x, y]: [u16; 2]| {
            let at = usize::from(y) * usize::from(instrument.detector.width) + usize::from(x);
            (!instrument.bad.contains(&[x, y])).then(|| Pixel {
                raw: f64::from(frame[at]),
                dark_adu: instrument.dark_adu.at(at),
                threshold_adu: instrument.threshold_sigma * instrument.noise_adu.at(at),
                gain: instrument.pixel_gain.at(at) / self.largest_gain,
            })
        };
        places.map(pixel).collect()
    }

    fn peak_fraction(&self) -> f64 {
        match self.instrument.estimator {
            Estimator::ThresholdedCentreOfGravity { peak_fraction }
            | Estimator::WeightedCentreOfGravity { peak_fraction, .. } => peak_fraction,
            _ => 0.0,
        }
    }

    /// Values of the window's pixels, and their signals after max(k sigma, fraction of the previous
    /// peak).
    fn signals(&self, pixels: &[Option<Pixel>], last_peak: f64) -> Vec<[f64; 2]> {
        match self.numbers {
            Numbers::Physical => self.physical(pixels, last_peak),
            Numbers::Stored => self.stored(pixels, last_peak),
        }
    }

    fn physical(&self, pixels: &[Option<Pixel>], last_peak: f64) -> Vec<[f64; 2]> {
        let moving = self.peak_fraction() * last_peak;
        let signal = |pixel: &Option<Pixel>| {
            let Some(p) = pixel else { return [0.0; 2] };
            let value = p.gain * f64::max(p.raw - p.dark_adu, 0.0);
            let threshold = f64::max(p.gain * p.threshold_adu, moving);
            let signal = match self.instrument.convention {
                Convention::Subtract => f64::max(value - threshold, 0.0),
                Convention::ZeroBelow => value * f64::from(value > threshold),
            };
            [value, signal]
        };
        pixels.iter().map(signal).collect()
    }

    fn stored(&self, pixels: &[Option<Pixel>], last_peak: f64) -> Vec<[f64; 2]> {
        let subtract = self.instrument.convention == Convention::Subtract;
        let good = || pixels.iter().flatten();
        let count = good().count().max(1) as f64;
        let base = round(good().map(|p| p.threshold_adu * p.gain).sum::<f64>() / count);
        let fraction = stored(self.peak_fraction(), 16);
        // The peak has already lost the threshold where that is subtracted.
        let above_dark = last_peak + if subtract { base } else { 0.0 };
        let excess = f64::max(round(fraction * above_dark) - base, 0.0);
        let signal = |pixel: &Option<Pixel>| {
            let Some(p) = pixel else { return [0.0; 2] };
            let folded = if subtract { p.threshold_adu } else { 0.0 };
            let above = f64::max(p.raw - round(p.dark_adu + folded), 0.0);
            let loss = round(65536.0 * (1.0 - p.gain));
            let value = above - round(above * loss / 65536.0);
            let step = self.threshold_step;
            let threshold = step * round(p.threshold_adu * p.gain / step);
            let signal = if subtract {
                f64::max(value - excess, 0.0)
            } else {
                value * f64::from(value > threshold + excess)
            };
            [value, signal]
        };
        pixels.iter().map(signal).collect()
    }

    /// What window `i` of `frame` shows.
    pub fn measure(&self, i: usize, frame: &[u16], history: &History) -> Seen {
        let pixels = self.window(i, frame);
        let signals = self.signals(&pixels, history.peak);
        let size = usize::from(self.instrument.window);
        let [columns, rows] = watched(size, history.near);
        let watched = rows.start * size + columns.start..rows.start * size + columns.end;
        let passed = signals[watched.clone()].iter().filter(|[_, signal]| *signal > 0.0);
        let peak = passed.map(|[value, _]| *value).fold(0.0, f64::max);
        let top = ((1u32 << self.instrument.detector.bits) - 1) as u16;
        let level = f64::from(self.instrument.saturation_adu.unwrap_or(top));
        let white = pixels[watched.clone()]
            .iter()
            .zip(&signals[watched])
            .filter(|(pixel, signal)| pixel.is_some_and(|p| p.raw >= level) && signal[1] > 0.0);
        let saturated = white.count() as u16;
        let mut signal: Vec<f64> = signals.into_iter().map(|[_, signal]| signal).collect();
        let (centroid, flux) = match self.instrument.estimator {
            Estimator::WeightedCentreOfGravity { fwhm_px, gain, .. } => {
                self.weighted(&signal, size, (fwhm_px, gain), history.centroid)
            }
            Estimator::Brightest { count } => {
                let mut sorted = signal.clone();
                sorted.sort_by(|a, b| b.total_cmp(a));
                let next = sorted[usize::from(count)];
                signal.iter_mut().for_each(|s| *s = f64::max(*s - next, 0.0));
                centre_of_gravity(&signal, size)
            }
            _ => centre_of_gravity(&signal, size),
        };
        Seen { centroid, flux, peak, saturated }
    }

    fn weighted(
        &self,
        signal: &[f64],
        size: usize,
        (fwhm_px, gain): (f64, f64),
        last: [f64; 2],
    ) -> ([f64; 2], f64) {
        let half = size as f64 / 2.0;
        let is_stored = self.numbers == Numbers::Stored;
        let centre = last.map(|c| if is_stored { stored(c, 3).clamp(-half, half) } else { c });
        let weight = |i: usize, c: f64| {
            let r = position(i, size) - c;
            let exact = f64::exp(-4.0 * std::f64::consts::LN_2 * (r / fwhm_px).powi(2));
            // Q8, 255 in the middle.
            if is_stored { round(255.0 * exact) / 256.0 } else { exact }
        };
        let weigh = |(at, s): (usize, &f64)| {
            s * weight(at % size, centre[0]) * weight(at / size, centre[1])
        };
        let products: Vec<f64> = signal.iter().enumerate().map(weigh).collect();
        let (seen, flux) = centre_of_gravity(&products, size);
        let gain = if is_stored { stored(gain, 12) } else { gain };
        let axis = |axis: usize| centre[axis] + gain * (seen[axis] - centre[axis]);
        ([axis(0), axis(1)], flux)
    }
}

/// The position of pixel `i` from the centre of its window.
fn position(i: usize, size: usize) -> f64 {
    i as f64 - (size as f64 - 1.0) / 2.0
}

/// Centre of gravity and sum; the window's centre if there is nothing.
fn centre_of_gravity(signal: &[f64], size: usize) -> ([f64; 2], f64) {
    let sum = |weight: &dyn Fn(usize) -> f64| -> f64 {
        signal.iter().enumerate().map(|(at, s)| s * weight(at)).sum()
    };
    let flux = sum(&|_| 1.0);
    if flux <= 0.0 {
        return ([0.0; 2], 0.0);
    }
    let x = sum(&|at| position(at % size, size)) / flux;
    let y = sum(&|at| position(at / size, size)) / flux;
    ([x, y], flux)
}
