//! The upward transfer function: that of one subaperture.

use super::lane_fft::LANES;
use super::launch::Launch;
use super::otf::{Lags, PathPhase};
use super::sincos::sin_cos;
use pulp::Simd;

/// Autocorrelation over one subaperture, summed directly.
pub(crate) struct BlockOtf {
    samples: usize,
    /// Lags in x, in whole vectors.
    width: usize,
    /// Floats per row of the padded amplitude.
    stride: usize,
    /// Amplitude of the light at each sample, `[row][col]`, mean square one.
    beam: Vec<f32>,
}

/// Buffers of [`BlockOtf::lags`].
pub(crate) struct BlockOtfScratch {
    phase: Vec<f32>,
    /// Amplitude `[row][n - 1 zeros, n samples, zeros]`.
    amplitude: [Vec<f32>; 2],
    sums: [Vec<f32>; 2],
}

impl BlockOtf {
    /// That of the light of `launch`, over `samples` x `samples` of them.
    pub(crate) fn new(samples: usize, launch: Launch) -> Self {
        let width = (2 * samples - 1).next_multiple_of(LANES);
        let line = launch.amplitudes(samples);
        let beam = line.iter().flat_map(|y| line.iter().map(move |x| (x * y) as f32)).collect();
        Self { samples, width, stride: samples + width, beam }
    }

    pub(crate) fn scratch(&self) -> BlockOtfScratch {
        BlockOtfScratch {
            phase: vec![0.0; (self.samples * self.samples).next_multiple_of(LANES)],
            amplitude: [0; 2].map(|_| vec![0.0; self.samples * self.stride]),
            sums: [0; 2].map(|_| vec![0.0; self.width]),
        }
    }

    /// The autocorrelation of `path`'s amplitude over subaperture (`ix`, `iy`), not normalised.
    #[inline(always)]
    pub(crate) fn lags<S: Simd>(
        &self,
        simd: S,
        path: &PathPhase,
        [ix, iy]: [usize; 2],
        scratch: &mut BlockOtfScratch,
        lags: &mut Lags,
    ) {
        let n = self.samples;
        let BlockOtfScratch { phase, amplitude: [re, im], sums: [sum_re, sum_im] } = scratch;
        for (k, phase) in phase[..n * n].iter_mut().enumerate() {
            *phase = path.at(iy * n + k / n, ix * n + k % n);
        }
        let mut cos = [0.0; LANES];
        for (chunk, phase) in phase.chunks_exact_mut(LANES).enumerate() {
            let cosines = S::as_mut_simd_f32s(&mut cos).0;
            for (phase, cos) in S::as_mut_simd_f32s(phase).0.iter_mut().zip(cosines) {
                (*phase, *cos) = sin_cos(simd, *phase);
            }
            for lane in 0..LANES.min(n * n - chunk * LANES) {
                let k = chunk * LANES + lane;
                let at = k / n * self.stride + n - 1 + k % n;
                let beam = self.beam[k] * path.amplitude_at(iy * n + k / n, ix * n + k % n);
                (re[at], im[at]) = (beam * cos[lane], beam * phase[lane]);
            }
        }
        for ly in 0..n {
            for v in (0..self.width).step_by(S::F32_LANES) {
                // Four sums, so that none waits for another.
                let [mut rr, mut ii, mut ri, mut ir] = [simd.splat_f32s(0.0); 4];
                for row in 0..n - ly {
                    // Lag -(n - 1) of column `col` is n - 1 columns before it.
                    let (from, to) = (row * self.stride + n - 1, (row + ly) * self.stride + v);
                    let a = re[from..from + n].iter().zip(&im[from..from + n]);
                    for (col, (&a_re, &a_im)) in a.enumerate() {
                        let (a_re, a_im) = (simd.splat_f32s(a_re), simd.splat_f32s(a_im));
                        let to = to + col..to + col + S::F32_LANES;
                        let b_re = S::as_simd_f32s(&re[to.clone()]).0[0];
                        let b_im = S::as_simd_f32s(&im[to]).0[0];
                        rr = simd.mul_add_e_f32s(a_re, b_re, rr);
                        ii = simd.mul_add_e_f32s(a_im, b_im, ii);
                        ri = simd.mul_add_e_f32s(a_re, b_im, ri);
                        ir = simd.mul_add_e_f32s(a_im, b_re, ir);
                    }
                }
                let here = v..v + S::F32_LANES;
                S::as_mut_simd_f32s(&mut sum_re[here.clone()]).0[0] = simd.add_f32s(rr, ii);
                S::as_mut_simd_f32s(&mut sum_im[here]).0[0] = simd.sub_f32s(ri, ir);
            }
            let row = ly * (2 * n - 1)..(ly + 1) * (2 * n - 1);
            lags.re[row.clone()].copy_from_slice(&sum_re[..2 * n - 1]);
            lags.im[row].copy_from_slice(&sum_im[..2 * n - 1]);
        }
    }
}
