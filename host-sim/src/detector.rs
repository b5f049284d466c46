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
//! Each row of each frame draws from its own random stream ([`noise::row_stream`]), so a frame is
//! a function of (specification, expectation, seed, frame number) alone, whatever the number of
//! threads and whichever frames were read before.

pub mod noise;
pub mod poisson;
mod spec;
mod windows;

use rayon::prelude::*;

use poisson::PoissonSampler;
pub use spec::{BadPixel, DetectorError, DetectorSpec, PixelFault};
pub use windows::place;

/// Rows that one task reads at least: handing a row to another thread costs as much as reading it.
const ROWS_PER_TASK: usize = 16;

/// A detector with its maps worked out; made from a [`DetectorSpec`].
#[derive(Debug, Clone)]
pub struct Detector {
    spec: DetectorSpec,
    /// Reciprocal of the gain: a division per pixel would show.
    adu_per_e: f64,
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
        let mut response = noise::response_map(&spec);
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
        Ok(Self { adu_per_e: 1.0 / spec.gain_e_per_adu, spec, response, dark_e })
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
        let poisson = PoissonSampler::get();
        out.par_chunks_mut(width)
            .zip(expected_e.par_chunks(width))
            .enumerate()
            .with_min_len(ROWS_PER_TASK)
            .for_each_init(
                || (vec![0.0; width], vec![0.0; width]),
                |(charges, normals), (y, (codes, expected))| {
                    let mut random = noise::row_stream(seed, frame, y as u64);
                    for (x, (charge, &expected)) in charges.iter_mut().zip(expected).enumerate() {
                        *charge = poisson.draw(&mut random, self.mean_e(y * width + x, expected));
                    }
                    noise::fill_normal(&mut random, normals);
                    for ((code, &charge), &normal) in codes.iter_mut().zip(&*charges).zip(&*normals)
                    {
                        *code = self.digitise(charge, self.spec.read_noise_e * f64::from(normal));
                    }
                },
            );
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
            *code = self.digitise(self.mean_e(index, expected), 0.0);
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

    fn mean_e(&self, index: usize, expected_e: f32) -> f64 {
        // `max` also turns NaN into 0.
        f64::from(expected_e.max(0.0) * self.response[index]) + f64::from(self.dark_e[index])
    }

    fn digitise(&self, charge_e: f64, noise_e: f64) -> u16 {
        let charge = charge_e.min(self.spec.full_well_e) + noise_e;
        let code = charge * self.adu_per_e + self.spec.bias_adu + 0.5;
        // The conversion truncates, which is the floor of what the clamp leaves.
        code.clamp(0.0, f64::from(self.spec.max_code())) as u16
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
