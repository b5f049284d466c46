//! The mean point spread function of many frames.

use crate::pupil::Pupil;
use rayon::prelude::*;
use splash_fft::{Complex, Planned, Transform};

/// The pupil's share of the transformed field, at most a quarter: the point spread function is
/// then sampled twice as finely as its own band limit asks for.
const PADDING: usize = 4;
/// Columns transformed at a time.
const STRIP: usize = 8;

/// Accumulates |FT of the pupil's field|^2, normalised such that the peak of the
/// diffraction-limited image is one. It need not be fed every frame.
pub struct LongExposure {
    pupil: Pupil,
    /// Pixels on the side of the image.
    side: usize,
    fft: Transform<f32>,
    /// Field, then its transform along x, for the rows that cross the pupil: `[row][kx]`.
    rows: Vec<Complex<f32>>,
    /// Sum over frames, `[kx][ky]`.
    sum: Vec<f64>,
    frames: u64,
}

impl LongExposure {
    /// An empty exposure through `pupil`.
    pub fn new(pupil: &Pupil) -> Self {
        let side = (PADDING * pupil.side()).next_power_of_two();
        Self {
            pupil: pupil.clone(),
            side,
            fft: f32::forward(side),
            rows: vec![Complex::default(); pupil.side() * side],
            sum: vec![0.0; side * side],
            frames: 0,
        }
    }

    /// Adds a frame of residual `phase`, rad at the science wavelength, `[row][col]` (S x S).
    ///
    /// # Panics
    /// If `phase` is not S x S.
    pub fn add(&mut self, phase: &[f32]) {
        let (pupil, side, fft) = (&self.pupil, self.side, self.fft.as_ref());
        let width = pupil.side();
        assert_eq!(phase.len(), width * width, "phase array");
        let scratch = || vec![Complex::default(); fft.get_inplace_scratch_len()];
        self.rows.par_chunks_exact_mut(side).enumerate().for_each_init(
            scratch,
            |scratch, (y, row)| {
                row.fill(Complex::default());
                for (x, value) in row[..width].iter_mut().enumerate() {
                    let amplitude = pupil.amplitude(y, x);
                    if amplitude > 0.0 {
                        *value = Complex::cis(phase[y * width + x]) * amplitude;
                    }
                }
                fft.process_with_scratch(row, scratch);
            },
        );
        let norm = 1.0 / pupil.open_samples().powi(2);
        let rows = &self.rows;
        self.sum.par_chunks_exact_mut(STRIP * side).enumerate().for_each_init(
            || (vec![Complex::default(); STRIP * side], scratch()),
            |(strip, scratch), (index, sum)| {
                strip.fill(Complex::default());
                for (y, row) in rows.chunks_exact(side).enumerate() {
                    for (x, value) in row[index * STRIP..][..STRIP].iter().enumerate() {
                        strip[x * side + y] = *value;
                    }
                }
                fft.process_with_scratch(strip, scratch);
                for (sum, value) in sum.iter_mut().zip(strip) {
                    *sum += norm * f64::from(value.norm_sqr());
                }
            },
        );
        self.frames += 1;
    }

    /// Number of frames added.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Pixels on the side of the image.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Side of a pixel in units of lambda/D, D = N d.
    pub fn pixel_in_lambda_over_diameter(&self) -> f64 {
        self.pupil.side() as f64 / self.side as f64
    }

    /// On-axis intensity of the mean image relative to the diffraction limit; zero before the
    /// first frame.
    pub fn strehl(&self) -> f64 {
        self.sum[0] / self.frames.max(1) as f64
    }

    /// The mean image, `[row][column]`, the axis at pixel (side/2, side/2).
    pub fn image(&self) -> Vec<f32> {
        let (side, half) = (self.side, self.side / 2);
        let at = |k: usize| {
            // The transform's exponent is negative: a positive gradient is a positive frequency.
            let (row, col) = ((k / side + half) % side, (k % side + half) % side);
            (self.sum[col * side + row] / self.frames.max(1) as f64) as f32
        };
        (0..side * side).map(at).collect()
    }
}
