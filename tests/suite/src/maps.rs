//! Lists that a specification borrows: places of windows, and calibrations from the generator.
//!
//! Every value is an integer times a power of two, or such a value times a length: what a target
//! makes of it depends on nothing but IEEE 754.

use splash_firmware::segments::ACTUATORS;
use splash_firmware::spec::{Map, Spec, triangle};

use crate::MODES;
use crate::generator::Generator;

/// Detector pixels that can have a calibration of their own.
pub(crate) const PIXELS: usize = 512;
/// Subapertures that can have a calibration of their own.
pub(crate) const SUBAPERTURES: usize = 16;
/// Windows that can be placed.
pub(crate) const PLACES: usize = 2 * 208;

/// The calibration of one subaperture; lengths in m.
#[derive(Debug)]
struct Subapertures {
    reference_px: [[f64; 2]; SUBAPERTURES],
    gain_m_per_px: [[[f64; 2]; 2]; SUBAPERTURES],
    flux_min_adu: [f64; SUBAPERTURES],
    control_gain: [f64; SUBAPERTURES],
    matrix: [[[f64; 3]; ACTUATORS]; SUBAPERTURES],
    flat_m: [[f64; ACTUATORS]; SUBAPERTURES],
    limits_m: [[[f64; 2]; ACTUATORS]; SUBAPERTURES],
    response_m: [[[f64; 2]; ACTUATORS]; SUBAPERTURES],
}

/// The lists of one instrument.
#[derive(Debug)]
pub(crate) struct Maps {
    /// Those of the first gate, then those of the second.
    origins: [[u16; 2]; PLACES],
    count: usize,
    /// Of those, of the second.
    second: usize,
    modes: [[f64; 2]; MODES * PLACES / 2],
    coupling: [f64; 2 * MODES * MODES],
    dark_adu: [f64; PIXELS],
    gain: [f64; PIXELS],
    noise_adu: [f64; PIXELS],
    subapertures: Subapertures,
}

/// Bad pixels of a calibrated detector.
const BAD: &[[u16; 2]] = &[[2, 0], [7, 3], [4, 4]];

impl Maps {
    pub(crate) const fn new() -> Self {
        Self {
            origins: [[0; 2]; PLACES],
            count: 0,
            second: 0,
            modes: [[0.0; 2]; MODES * PLACES / 2],
            coupling: [0.0; 2 * MODES * MODES],
            dark_adu: [0.0; PIXELS],
            gain: [0.0; PIXELS],
            noise_adu: [0.0; PIXELS],
            subapertures: Subapertures {
                reference_px: [[0.0; 2]; SUBAPERTURES],
                gain_m_per_px: [[[0.0; 2]; 2]; SUBAPERTURES],
                flux_min_adu: [0.0; SUBAPERTURES],
                control_gain: [0.0; SUBAPERTURES],
                matrix: [[[0.0; 3]; ACTUATORS]; SUBAPERTURES],
                flat_m: [[0.0; ACTUATORS]; SUBAPERTURES],
                limits_m: [[[0.0; 2]; ACTUATORS]; SUBAPERTURES],
                response_m: [[[0.0; 2]; ACTUATORS]; SUBAPERTURES],
            },
        }
    }

    /// Sets where the windows are: those of the first gate, then as many of the second or none.
    pub(crate) fn place(
        &mut self,
        first: impl Iterator<Item = [u16; 2]>,
        second: impl Iterator<Item = [u16; 2]>,
    ) {
        (self.count, self.second) = (0, 0);
        let places = &mut self.origins.iter_mut();
        for (origin, place) in first.zip(&mut *places) {
            *place = origin;
            self.count += 1;
        }
        for (origin, place) in second.zip(places) {
            *place = origin;
            self.second += 1;
        }
    }

    /// Column and row of the first pixel of each window: of the first gate in mask order, then of the
    /// second.
    pub(crate) fn origins(&self) -> &[[u16; 2]] {
        self.origins.get(..self.count + self.second).unwrap_or_default()
    }

    /// Those of the first gate, and those of the second.
    pub(crate) fn gates(&self) -> [&[[u16; 2]]; 2] {
        self.origins().split_at_checked(self.count).unwrap_or_default().into()
    }

    /// Makes `modes` modes and what they take of each other.
    ///
    /// Mode k is a cosine of k half waves over the subapertures in their order, 3/5 of it along x and 4/5
    /// along y: orthonormal, without a mean.
    pub(crate) fn draw_modes(&mut self, modes: usize) {
        let count = self.count.max(1) as f64;
        let norm = libm::sqrt(2.0 / count);
        for (k, mode) in (1..=modes).zip(self.modes.chunks_exact_mut(self.count.max(1))) {
            let angle = core::f64::consts::PI * k as f64 / count;
            // cos(a + b) = 2 cos(b) cos(a) - cos(a - b).
            let step = 2.0 * libm::cos(angle);
            let mut last = libm::cos(angle / 2.0);
            let mut value = last;
            for q in mode {
                *q = [0.6 * norm * value, 0.8 * norm * value];
                (last, value) = (value, step * value - last);
            }
        }
        let numbers = &mut Generator::new(0xb1a5);
        for entry in self.coupling.iter_mut().take(2 * modes * modes) {
            *entry = f64::from(numbers.between(-1024, 1024)) / 4096.0;
        }
    }

    /// The modes that were made, mode by mode, and what they take of each other.
    pub(crate) fn modes(&self, modes: usize) -> (&[[f64; 2]], &[f64]) {
        let gradients = self.modes.get(..modes * self.count).unwrap_or_default();
        (gradients, self.coupling.get(..2 * modes * modes).unwrap_or_default())
    }

    /// Makes a calibration for each pixel, around `dark_adu`, and for each subaperture, around the
    /// slope gain `gain_m` and for actuators of `stroke_m`.
    pub(crate) fn draw(&mut self, dark_adu: f64, gain_m: f64, stroke_m: f64) {
        let numbers = &mut Generator::new(0xca1);
        let mut number = |low, high, scale: f64| f64::from(numbers.between(low, high)) * scale;
        for dark in &mut self.dark_adu {
            *dark = dark_adu * number(56, 72, 1.0 / 64.0);
        }
        for gain in &mut self.gain {
            *gain = number(200, 300, 1.0 / 256.0);
        }
        for noise in &mut self.noise_adu {
            *noise = number(16, 48, 1.0 / 32.0);
        }
        let each = &mut self.subapertures;
        for reference in each.reference_px.as_flattened_mut() {
            *reference = number(-128, 128, 1.0 / 256.0);
        }
        for [[xx, xy], [yx, yy]] in &mut each.gain_m_per_px {
            [*xx, *yy] = [(); 2].map(|()| gain_m * number(48, 80, 1.0 / 64.0));
            [*xy, *yx] = [(); 2].map(|()| gain_m * number(-16, 16, 1.0 / 64.0));
        }
        for least in &mut each.flux_min_adu {
            *least = number(100, 400, 1.0);
        }
        for gain in &mut each.control_gain {
            *gain = number(16, 96, 1.0 / 64.0);
        }
        for (influence, of_flat) in each
            .matrix
            .as_flattened_mut()
            .iter_mut()
            .zip([triangle(0.6); SUBAPERTURES].as_flattened())
        {
            *influence = of_flat.map(|value| value + number(-8, 8, 1.0 / 64.0));
        }
        for flat in each.flat_m.as_flattened_mut() {
            *flat = stroke_m * number(24, 40, 1.0 / 64.0);
        }
        for limits in each.limits_m.as_flattened_mut() {
            *limits = [(0, 8), (52, 64)].map(|(a, b)| stroke_m * number(a, b, 1.0 / 64.0));
        }
        for (i, response) in each.response_m.as_flattened_mut().iter_mut().enumerate() {
            *response = [(-8, 0), (64, 80)].map(|(a, b)| stroke_m * number(a, b, 1.0 / 64.0));
            // Some actuators go down where the others go up.
            if i % 4 == 0 {
                response.reverse();
            }
        }
    }

    /// `spec` with the calibrations drawn, for the pixels of its detector and its subapertures.
    pub(crate) fn calibrate<'a>(&'a self, mut spec: Spec<'a>) -> Spec<'a> {
        let pixels = usize::from(spec.detector.width) * usize::from(spec.detector.height);
        let count = self.count;
        spec.pixels.dark_adu = first(&self.dark_adu, pixels);
        spec.pixels.gain = first(&self.gain, pixels);
        spec.pixels.noise_adu = first(&self.noise_adu, pixels);
        spec.pixels.bad = BAD;
        let each = &self.subapertures;
        spec.slopes.reference_px = first(&each.reference_px, count);
        spec.slopes.gain_m_per_px = first(&each.gain_m_per_px, count);
        spec.slopes.flux_min_adu = first(&each.flux_min_adu, count);
        spec.control.gain = first(&each.control_gain, count);
        spec.segments.matrix = first(&each.matrix, count);
        spec.segments.flat_m = first(&each.flat_m, count);
        spec.segments.limits_m = first(&each.limits_m, count);
        spec.actuators.response_m = first(&each.response_m, count);
        spec
    }
}

/// One entry each for `count`. Beyond the list's end there are none, and a build refuses it.
fn first<T>(list: &[T], count: usize) -> Map<'_, T> {
    Map::Each(list.get(..count).unwrap_or_default())
}
