//! Lists that a specification borrows: places of windows, and calibrations from the generator.
//!
//! Every value is an integer times a power of two, or such a value times a length: what a target
//! makes of it depends on nothing but IEEE 754.

use splash_firmware::segments::ACTUATORS;
use splash_firmware::spec::{Map, Spec, triangle};

use crate::generator::Generator;

/// Detector pixels that can have a calibration of their own.
pub(crate) const PIXELS: usize = 512;
/// Subapertures that can have a calibration of their own.
pub(crate) const SUBAPERTURES: usize = 16;
/// Subapertures that can be placed.
pub(crate) const PLACES: usize = 256;

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
    origins: [[u16; 2]; PLACES],
    count: usize,
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

    /// Sets where the windows are.
    pub(crate) fn place(&mut self, origins: impl Iterator<Item = [u16; 2]>) {
        self.count = 0;
        for (place, origin) in self.origins.iter_mut().zip(origins) {
            *place = origin;
            self.count += 1;
        }
    }

    /// Column and row of the first pixel of each window, in mask order.
    pub(crate) fn origins(&self) -> &[[u16; 2]] {
        self.origins.get(..self.count).unwrap_or_default()
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
