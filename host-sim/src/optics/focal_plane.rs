//! From the transfer function's lags to the detector's pixels.

use super::OpticsError;
use super::lane_fft::LANES;
use super::otf::Lags;
use super::sinc::sinc;
use pulp::{Simd, WithSimd};

/// Intensity I(theta) = sum over lags l of OTF(l) exp(-2 pi i l u), u = theta d/(n lambda),
/// integrated over the pixels of a square window.
///
/// The image of a sampled pupil repeats itself with a period of 1 in u, n lambda/d: the wings
/// beyond are folded into it. A window of one period therefore holds all the light, OTF(0), and
/// its centre of gravity follows a tilt with gain one; a larger window would show the spot twice
/// and is refused by the camera. A positive gradient moves the spot to +x, +y. Pixel centres are
/// at k - (W-1)/2.
pub(crate) struct FocalPlane {
    samples: usize,
    window: usize,
    /// Window width in whole groups of lanes.
    padded: usize,
    /// Integral of the kernel over the pixel, `[lx + n - 1][column]`.
    x_re: Vec<f32>,
    x_im: Vec<f32>,
    /// The same along y with the lags ly < 0 folded in, `[row][ly]`.
    y_re: Vec<f32>,
    y_im: Vec<f32>,
}

/// Buffers of [`FocalPlane::image`].
pub(crate) struct FocalPlaneScratch {
    /// Transformed along x, `[ly][column]`.
    rows: [Vec<f32>; 2],
    line: Vec<f32>,
}

/// Refuses windows that the firmware does not take.
pub(crate) fn check_window(window: usize) -> Result<(), OpticsError> {
    match (4..=32).contains(&window) {
        true => Ok(()),
        false => Err(OpticsError::range("window", window as f64, "4 to 32 pixels")),
    }
}

impl FocalPlane {
    /// A window of `window` x `window` pixels (4 to 32), `pixels_per_lambda_d` of them in lambda/d (1
    /// to 8), no wider than the image's period.
    pub(crate) fn checked(
        samples: usize,
        window: usize,
        pixels_per_lambda_d: f64,
    ) -> Result<Self, OpticsError> {
        check_window(window)?;
        if !(1.0..=8.0).contains(&pixels_per_lambda_d) {
            return Err(OpticsError::range("pixels_per_lambda_d", pixels_per_lambda_d, "1 to 8"));
        }
        // The image of a pupil with n samples per subaperture repeats itself every n lambda/d.
        let period = samples as f64 * pixels_per_lambda_d;
        if window as f64 > period {
            let limit = format!("<= {period} pixels (samples times pixels_per_lambda_d)");
            return Err(OpticsError::range("window", window as f64, limit));
        }
        Ok(Self::new(samples, window, pixels_per_lambda_d))
    }

    /// The same for any window and pixels; beyond the image's period it repeats itself.
    pub(crate) fn new(samples: usize, window: usize, pixels_per_lambda_d: f64) -> Self {
        let padded = window.next_multiple_of(LANES);
        let pixel = 1.0 / (samples as f64 * pixels_per_lambda_d);
        let kernel = |lag: i64, k: usize| -> [f64; 2] {
            let centre = (k as f64 - (window as f64 - 1.0) / 2.0) * pixel;
            let integral = pixel * sinc(std::f64::consts::PI * lag as f64 * pixel);
            let (sin, cos) = (-std::f64::consts::TAU * lag as f64 * centre).sin_cos();
            [integral * cos, integral * sin]
        };
        let (mut x_re, mut x_im) = (vec![], vec![]);
        for lag in 1 - samples as i64..samples as i64 {
            for k in 0..padded {
                let [re, im] = if k < window { kernel(lag, k) } else { [0.0; 2] };
                x_re.push(re as f32);
                x_im.push(im as f32);
            }
        }
        let (mut y_re, mut y_im) = (vec![], vec![]);
        for k in 0..window {
            for lag in 0..samples as i64 {
                let both = if lag == 0 { 1.0 } else { 2.0 };
                let [re, im] = kernel(lag, k);
                y_re.push((both * re) as f32);
                y_im.push((both * im) as f32);
            }
        }
        Self { samples, window, padded, x_re, x_im, y_re, y_im }
    }

    pub(crate) fn scratch(&self) -> FocalPlaneScratch {
        FocalPlaneScratch {
            rows: [0; 2].map(|_| vec![0.0; self.samples * self.padded]),
            line: vec![0.0; self.padded],
        }
    }

    /// The image `[row][column]` of the transfer function `otf`.
    #[inline(always)]
    pub(crate) fn image<S: Simd>(
        &self,
        simd: S,
        otf: &Lags,
        scratch: &mut FocalPlaneScratch,
        image: &mut [f32],
    ) {
        let FocalPlaneScratch { rows: [rows_re, rows_im], line } = scratch;
        let lags = 2 * self.samples - 1;
        for v in (0..self.padded).step_by(S::F32_LANES) {
            let here = v..v + S::F32_LANES;
            for ly in 0..self.samples {
                // Four sums, so that none waits for another.
                let [mut rr, mut ii, mut ri, mut ir] = [simd.splat_f32s(0.0); 4];
                let here_otf = ly * lags..(ly + 1) * lags;
                let values = otf.re[here_otf.clone()].iter().zip(&otf.im[here_otf]);
                let kernel_re = self.x_re.chunks_exact(self.padded);
                let kernels = kernel_re.zip(self.x_im.chunks_exact(self.padded));
                for ((&a_re, &a_im), (k_re, k_im)) in values.zip(kernels) {
                    let (a_re, a_im) = (simd.splat_f32s(a_re), simd.splat_f32s(a_im));
                    let k_re = S::as_simd_f32s(&k_re[here.clone()]).0[0];
                    let k_im = S::as_simd_f32s(&k_im[here.clone()]).0[0];
                    rr = simd.mul_add_e_f32s(a_re, k_re, rr);
                    ii = simd.mul_add_e_f32s(a_im, k_im, ii);
                    ri = simd.mul_add_e_f32s(a_re, k_im, ri);
                    ir = simd.mul_add_e_f32s(a_im, k_re, ir);
                }
                let (re, im) = (simd.sub_f32s(rr, ii), simd.add_f32s(ri, ir));
                let at = ly * self.padded;
                S::as_mut_simd_f32s(&mut rows_re[at..][here.clone()]).0[0] = re;
                S::as_mut_simd_f32s(&mut rows_im[at..][here.clone()]).0[0] = im;
            }
        }
        for (row, image) in image.chunks_exact_mut(self.window).enumerate() {
            let y_re = &self.y_re[row * self.samples..][..self.samples];
            let y_im = &self.y_im[row * self.samples..][..self.samples];
            for v in (0..self.padded).step_by(S::F32_LANES) {
                let here = v..v + S::F32_LANES;
                let [mut of_re, mut of_im] = [simd.splat_f32s(0.0); 2];
                let kernel = y_re.iter().zip(y_im);
                let rows_re = rows_re.chunks_exact(self.padded);
                let rows = rows_re.zip(rows_im.chunks_exact(self.padded));
                for ((&k_re, &k_im), (row_re, row_im)) in kernel.zip(rows) {
                    let row_re = S::as_simd_f32s(&row_re[here.clone()]).0[0];
                    let row_im = S::as_simd_f32s(&row_im[here.clone()]).0[0];
                    of_re = simd.mul_add_e_f32s(row_re, simd.splat_f32s(k_re), of_re);
                    of_im = simd.mul_add_e_f32s(row_im, simd.splat_f32s(k_im), of_im);
                }
                S::as_mut_simd_f32s(&mut line[here]).0[0] = simd.sub_f32s(of_re, of_im);
            }
            image.copy_from_slice(&line[..self.window]);
        }
    }
}

/// The image of a transfer function: [`FocalPlane::image`], to be dispatched.
pub(crate) struct Image<'a> {
    pub(crate) plane: &'a FocalPlane,
    pub(crate) otf: &'a Lags,
    pub(crate) scratch: &'a mut FocalPlaneScratch,
    pub(crate) image: &'a mut [f32],
}

impl WithSimd for Image<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.plane.image(simd, self.otf, self.scratch, self.image);
    }
}
