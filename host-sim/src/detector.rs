//! The detector: expected photo-electrons in, digital frames out.
//!
//! Pixels are row-major, column x fastest, row 0 first: pixel (x, y) is `[y * width + x]`.
//!
//! Per pixel and frame, with `mean` the expected photo-electrons,
//! ```text
//! charge = min(Poisson(mean * response + dark), full well)        [e-]
//! code   = floor((charge + read noise * Normal) / gain + bias + 1/2), clipped to 0 ..= 2^bits - 1
//! ```
//! The well limits the charge, before the amplifier adds its noise, as in a real device.
//!
//! Each row of each frame draws from its own random stream (`stream::RowStream`), so a frame is
//! a function of (specification, expectation, seed, frame number) alone, whatever the number of
//! threads and whichever frames were read before.

mod alias;
mod floor;
mod normal;
mod poisson;
mod ptrs;
mod response;
mod spec;
mod stream;
mod windows;

use floor::floor;
use poisson::{BLOCK, PoissonSampler};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
pub use spec::{BadPixel, DetectorError, DetectorSpec, PixelFault};
use stream::RowStream;
pub use windows::place;

/// Rows that one task reads at least: handing a row to another thread costs as much as reading it.
const ROWS_PER_TASK: usize = 16;

/// A detector with its maps worked out; made from a [`DetectorSpec`].
#[derive(Debug, Clone)]
pub struct Detector {
    spec: DetectorSpec,
    full_well_e: f32,
    /// Reciprocal of the gain: a division per pixel would show.
    adu_per_e: f32,
    /// Bias, and the half that rounds.
    offset_adu: f32,
    max_code: f32,
    read_noise_e: f32,
    /// Photo-electrons collected per expected photo-electron, per pixel.
    response: Vec<f32>,
    /// Mean dark charge per pixel and frame, e-.
    dark_e: Vec<f32>,
}

/// What the calibration of the real instrument would measure; every map is row-major,
/// height x width.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Mean code without light, bias included, ADU.
    pub dark_adu: Vec<f32>,
    /// Response to light relative to the nominal pixel, 1 on average; 0 where the pixel is blind.
    pub flat: Vec<f32>,
    /// Standard deviation of the code without light, quantisation included, ADU.
    pub sigma_adu: Vec<f32>,
    /// Pixels that carry no information, `[x, y]`.
    pub bad_pixels: Vec<[usize; 2]>,
}

impl Detector {
    /// Checks the specification and works out the maps.
    ///
    /// # Errors
    /// Names the first field that is out of its limits.
    pub fn new(spec: DetectorSpec) -> Result<Self, DetectorError> {
        spec.check()?;
        let mut response = response::response_map(&spec);
        let mut dark_e = vec![spec.dark_e_per_frame as f32; spec.width * spec.height];
        for pixel in &spec.bad_pixels {
            let index = pixel.y * spec.width + pixel.x;
            response[index] = 0.0;
            dark_e[index] = match pixel.kind {
                // Twice the well: Poisson noise never brings it below the brim.
                PixelFault::Hot => 2.0 * spec.full_well_e as f32,
                PixelFault::Dead => 0.0,
            };
        }
        Ok(Self {
            full_well_e: spec.full_well_e as f32,
            adu_per_e: (1.0 / spec.gain_e_per_adu) as f32,
            offset_adu: (spec.bias_adu + 0.5) as f32,
            max_code: f32::from(spec.max_code()),
            read_noise_e: spec.read_noise_e as f32,
            spec,
            response,
            dark_e,
        })
    }

    /// The specification this detector was made from.
    pub fn spec(&self) -> &DetectorSpec {
        &self.spec
    }

    /// Reads one frame with photon and read noise.
    ///
    /// `expected_e` (photo-electrons) and `out` (ADU) are height x width. An expectation that is
    /// negative or NaN counts as no light.
    ///
    /// # Errors
    /// If a slice does not have height x width elements.
    pub fn read(
        &self,
        expected_e: &[f32],
        frame: u64,
        seed: u64,
        out: &mut [u16],
    ) -> Result<(), DetectorError> {
        self.check_sizes(expected_e, out)?;
        let width = self.spec.width;
        let arch = Arch::new();
        out.par_chunks_mut(width)
            .zip(expected_e.par_chunks(width))
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each(|(y, (codes, expected_e))| {
                arch.dispatch(Row { detector: self, expected_e, frame, seed, y, codes });
            });
        Ok(())
    }

    /// Reads one frame without any noise: the mean charge, digitised.
    ///
    /// # Errors
    /// As [`Detector::read`].
    pub fn read_noise_free(
        &self,
        expected_e: &[f32],
        out: &mut [u16],
    ) -> Result<(), DetectorError> {
        self.check_sizes(expected_e, out)?;
        for (index, (code, &expected)) in out.iter_mut().zip(expected_e).enumerate() {
            let mean = mean_e(expected, self.response[index], self.dark_e[index]);
            *code = self.digitise(mean, 0.0);
        }
        Ok(())
    }

    /// The maps that calibrate this detector, from its specification rather than from frames.
    pub fn calibration(&self) -> Calibration {
        let spec = &self.spec;
        let well = spec.full_well_e as f32;
        let code = |dark: f32| f64::from(dark.min(well)) / spec.gain_e_per_adu + spec.bias_adu;
        // A brimming well has no shot noise.
        let shot = |dark: f32| if dark < well { f64::from(dark) } else { 0.0 };
        let sigma = |dark: f32| {
            let charge_variance = shot(dark) + spec.read_noise_e.powi(2);
            (charge_variance / spec.gain_e_per_adu.powi(2) + 1.0 / 12.0).sqrt()
        };
        Calibration {
            dark_adu: self
                .dark_e
                .iter()
                .map(|&dark| code(dark).min(f64::from(spec.max_code())) as f32)
                .collect(),
            flat: self.response.clone(),
            sigma_adu: self.dark_e.iter().map(|&dark| sigma(dark) as f32).collect(),
            bad_pixels: spec.bad_pixels.iter().map(|pixel| [pixel.x, pixel.y]).collect(),
        }
    }

    #[inline(always)]
    fn digitise(&self, charge_e: f32, noise_e: f32) -> u16 {
        let charge = charge_e.min(self.full_well_e) + noise_e;
        let code = charge * self.adu_per_e + self.offset_adu;
        // `clamp` would look at its limits each time.
        let not_above = code.min(self.max_code);
        floor(not_above.max(0.0)) as u16
    }

    fn check_sizes(&self, expected_e: &[f32], out: &[u16]) -> Result<(), DetectorError> {
        let pixels = self.spec.width * self.spec.height;
        let check = |what, found| {
            if found == pixels {
                Ok(())
            } else {
                Err(DetectorError::Size { what, expected: pixels, found })
            }
        };
        check("expected photo-electrons", expected_e.len())?;
        check("output frame", out.len())
    }
}

/// Mean charge of a pixel, e-; light that is negative or NaN counts as none.
#[inline(always)]
fn mean_e(expected_e: f32, response: f32, dark_e: f32) -> f32 {
    // `max` also turns NaN into 0.
    let light_e = expected_e.max(0.0);
    // Infinite light on a blind pixel would not be a number.
    light_e.min(f32::MAX) * response + dark_e
}

/// One row of one frame.
struct Row<'a> {
    detector: &'a Detector,
    expected_e: &'a [f32],
    frame: u64,
    seed: u64,
    y: usize,
    codes: &'a mut [u16],
}

impl WithSimd for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { detector, expected_e, frame, seed, y, codes } = self;
        let poisson = PoissonSampler::get();
        let mut random = RowStream::new(seed, frame, y as u64);
        let here = y * codes.len()..(y + 1) * codes.len();
        let response = detector.response[here.clone()].chunks(BLOCK);
        let maps = response.zip(detector.dark_e[here].chunks(BLOCK));
        let blocks = codes.chunks_mut(BLOCK).zip(expected_e.chunks(BLOCK));
        for ((codes, expected), (response, dark)) in blocks.zip(maps) {
            let mut means = [0.0; BLOCK];
            for (((mean, &expected), &response), &dark) in
                means.iter_mut().zip(expected).zip(response).zip(dark)
            {
                *mean = mean_e(expected, response, dark);
            }
            let charges = poisson.draw(simd, &mut random, means);
            let normals = normal::draw(simd, &mut random);
            for ((code, &charge), &normal) in codes.iter_mut().zip(&charges).zip(&normals) {
                *code = detector.digitise(charge, detector.read_noise_e * normal);
            }
        }
    }
}
