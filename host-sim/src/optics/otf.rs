//! Optical transfer functions at lags below one subaperture.
//!
//! OTF(l) = sum over x of conj(F(x)) F(x + l), F the complex amplitude. A wavefront of gradient g
//! has the phase + g . l. Only lags |lx|, |ly| < n are needed, and OTF(-l) = conj(OTF(l)): a
//! [`Lags`] holds ly = 0 .. n-1 and lx = -(n-1) .. n-1.

use super::lane_fft::{LANES, LaneFft};
use super::sampling::Taps;
use super::sincos::sin_cos;
use crate::pupil::Pupil;
use pulp::Simd;

/// Lags in y that one pass over the spectra correlates.
const PASS: usize = 8;

/// Half of an autocorrelation, `[ly][lx + n - 1]`.
#[derive(Clone, Default)]
pub(crate) struct Lags {
    pub(crate) re: Vec<f32>,
    pub(crate) im: Vec<f32>,
}

impl Lags {
    /// All zero, for `samples` = n.
    pub(crate) fn new(samples: usize) -> Self {
        let length = samples * (2 * samples - 1);
        Self { re: vec![0.0; length], im: vec![0.0; length] }
    }

    /// Zero again.
    pub(crate) fn clear(&mut self) {
        self.re.fill(0.0);
        self.im.fill(0.0);
    }
}

/// The phase of one spot's path over the pupil: a part common to all spots and, for each layer
/// above the ground, columns of texels already resampled in y.
///
/// Lane layout: rows are taken sixteen at a time; `[group][x][lane]`, row = 16 group + lane.
pub(crate) struct PathPhase<'a> {
    /// Phase in rad that all spots share, `[group][col][lane]`.
    pub(crate) common: &'a [f32],
    /// Amplitude at the samples, zero outside the pupil, `[group][col][lane]`; empty if it is one in all
    /// subapertures that are looked through one by one.
    pub(crate) mask: &'a [f32],
    /// Number of columns, S.
    pub(crate) side: usize,
    pub(crate) high: &'a [HighLayer<'a>],
}

/// One layer above the ground as seen from one spot.
#[derive(Clone, Copy)]
pub(crate) struct HighLayer<'a> {
    /// Phase in rad, `[group][texel column][lane]`.
    pub(crate) columns: &'a [f32],
    /// Number of texel columns.
    pub(crate) texels: usize,
    /// Interpolation in x, for each column of samples.
    pub(crate) taps: &'a [Taps],
}

impl PathPhase<'_> {
    /// Complex amplitude of one group, `[col][lane]`.
    #[inline(always)]
    fn amplitude<S: Simd>(&self, simd: S, group: usize, re: &mut [f32], im: &mut [f32]) {
        let vectors = LANES / S::F32_LANES;
        let here = group * self.side * LANES..(group + 1) * self.side * LANES;
        let common = S::as_simd_f32s(&self.common[here.clone()]).0;
        let mask = S::as_simd_f32s(&self.mask[here]).0;
        let re = S::as_mut_simd_f32s(&mut re[..self.side * LANES]).0;
        let im = S::as_mut_simd_f32s(&mut im[..self.side * LANES]).0;
        for col in 0..self.side {
            for v in 0..vectors {
                let at = col * vectors + v;
                let mut phase = common[at];
                for layer in self.high {
                    let columns = &layer.columns[group * layer.texels * LANES..];
                    let taps = &layer.taps[col];
                    let columns = &columns[taps.first * LANES..(taps.first + 4) * LANES];
                    let columns = S::as_simd_f32s(columns).0;
                    for (k, &weight) in taps.weights.iter().enumerate() {
                        let weight = simd.splat_f32s(weight);
                        phase = simd.mul_add_e_f32s(weight, columns[k * vectors + v], phase);
                    }
                }
                let (sin, cos) = sin_cos(simd, phase);
                re[at] = simd.mul_f32s(cos, mask[at]);
                im[at] = simd.mul_f32s(sin, mask[at]);
            }
        }
    }

    /// Amplitude at one sample.
    #[inline(always)]
    pub(crate) fn amplitude_at(&self, row: usize, col: usize) -> f32 {
        let (group, lane) = (row / LANES, row % LANES);
        self.mask.get((group * self.side + col) * LANES + lane).copied().unwrap_or(1.0)
    }

    /// Phase at one sample.
    #[inline(always)]
    pub(crate) fn at(&self, row: usize, col: usize) -> f32 {
        let (group, lane) = (row / LANES, row % LANES);
        let mut phase = self.common[(group * self.side + col) * LANES + lane];
        for layer in self.high {
            let taps = &layer.taps[col];
            let first = group * layer.texels + taps.first;
            for (k, weight) in taps.weights.iter().enumerate() {
                phase += weight * layer.columns[(first + k) * LANES + lane];
            }
        }
        phase
    }
}

/// Autocorrelation over the whole pupil: transforms along x, direct sums along y.
pub(crate) struct PupilOtf {
    samples: usize,
    side: usize,
    groups: usize,
    fft: LaneFft,
    /// Floats per frequency in the spectra: all rows, and zeros for the lags to reach into.
    stride: usize,
    /// cos and sin of 2 pi k lx / length over the length, `[lx][frequency position]`, lx < n.
    cosines: Vec<f32>,
    sines: Vec<f32>,
}

/// Buffers of [`PupilOtf::lags`].
pub(crate) struct PupilOtfScratch {
    group: [Vec<f32>; 2],
    spectra: [Vec<f32>; 2],
    /// Correlations for one pass of lags in y, `[frequency position][re, im][ly]`.
    sums: Vec<f32>,
}

impl PupilOtf {
    pub(crate) fn new(pupil: &Pupil) -> Self {
        let (samples, side) = (pupil.samples(), pupil.side());
        let groups = side.div_ceil(LANES);
        let fft = LaneFft::new(side + samples - 1);
        let length = fft.length();
        let table = |function: fn(f64) -> f64| -> Vec<f32> {
            let entries = (0..samples).flat_map(|lx| fft.frequencies().iter().map(move |k| k * lx));
            let turns = entries.map(|product| (product % length) as f64 / length as f64);
            turns.map(|t| (function(std::f64::consts::TAU * t) / length as f64) as f32).collect()
        };
        let (cosines, sines) = (table(f64::cos), table(f64::sin));
        let reach = samples.next_multiple_of(LANES);
        Self { samples, side, groups, fft, stride: groups * LANES + reach, cosines, sines }
    }

    pub(crate) fn scratch(&self) -> PupilOtfScratch {
        let length = self.fft.length();
        PupilOtfScratch {
            group: [0; 2].map(|_| vec![0.0; length * LANES]),
            spectra: [0; 2].map(|_| vec![0.0; length * self.stride]),
            sums: vec![0.0; length * 2 * PASS],
        }
    }

    /// The autocorrelation of `path`'s amplitude over the pupil, not normalised.
    #[inline(always)]
    pub(crate) fn lags<S: Simd>(
        &self,
        simd: S,
        path: &PathPhase,
        scratch: &mut PupilOtfScratch,
        lags: &mut Lags,
    ) {
        let PupilOtfScratch { group: [re, im], spectra: [spectra_re, spectra_im], sums } = scratch;
        for group in 0..self.groups {
            path.amplitude(simd, group, re, im);
            re[self.side * LANES..].fill(0.0);
            im[self.side * LANES..].fill(0.0);
            let out = [&mut spectra_re[group * LANES..], &mut spectra_im[group * LANES..]];
            self.fft.forward(simd, re, im, out, self.stride);
        }
        for first in (0..self.samples).step_by(PASS) {
            // Eight lags keep 16 accumulators, for which only 32 registers are enough.
            if S::REGISTER_COUNT >= 32 {
                self.correlate::<S, PASS>(simd, first, spectra_re, spectra_im, sums, 0);
            } else {
                for half in [0, PASS / 2] {
                    const HALF: usize = PASS / 2;
                    self.correlate::<S, HALF>(simd, first, spectra_re, spectra_im, sums, half);
                }
            }
            self.to_lags(simd, first, sums, lags);
        }
    }

    /// sum over y of conj(F(k, y)) F(k, y + ly) for the `L` lags from ly = `first` + `offset`;
    /// lags beyond the last needed one read the zeros that follow the rows.
    #[inline(always)]
    fn correlate<S: Simd, const L: usize>(
        &self,
        simd: S,
        first: usize,
        spectra_re: &[f32],
        spectra_im: &[f32],
        sums: &mut [f32],
        offset: usize,
    ) {
        let rows = self.groups * LANES;
        let vectors = rows / S::F32_LANES;
        let spectra =
            spectra_re.chunks_exact(self.stride).zip(spectra_im.chunks_exact(self.stride));
        for ((re, im), sums) in spectra.zip(sums.chunks_exact_mut(2 * PASS)) {
            let a_re = &S::as_simd_f32s(&re[..rows]).0[..vectors];
            let a_im = &S::as_simd_f32s(&im[..rows]).0[..vectors];
            let from = first + offset;
            let b_re: [&[S::f32s]; L] =
                std::array::from_fn(|l| &S::as_simd_f32s(&re[from + l..][..rows]).0[..vectors]);
            let b_im: [&[S::f32s]; L] =
                std::array::from_fn(|l| &S::as_simd_f32s(&im[from + l..][..rows]).0[..vectors]);
            let mut sum_re = [simd.splat_f32s(0.0); L];
            let mut sum_im = [simd.splat_f32s(0.0); L];
            for v in 0..vectors {
                for l in 0..L {
                    let (b_re, b_im) = (b_re[l][v], b_im[l][v]);
                    sum_re[l] = simd.mul_add_e_f32s(a_re[v], b_re, sum_re[l]);
                    sum_re[l] = simd.mul_add_e_f32s(a_im[v], b_im, sum_re[l]);
                    sum_im[l] = simd.mul_add_e_f32s(a_re[v], b_im, sum_im[l]);
                    sum_im[l] = simd.negate_mul_add_e_f32s(a_im[v], b_re, sum_im[l]);
                }
            }
            for l in 0..L {
                sums[offset + l] = simd.reduce_sum_f32s(sum_re[l]);
                sums[PASS + offset + l] = simd.reduce_sum_f32s(sum_im[l]);
            }
        }
    }

    /// Inverse transform along x of one pass's correlations, at the lags needed.
    #[inline(always)]
    fn to_lags<S: Simd>(&self, simd: S, first: usize, sums: &[f32], lags: &mut Lags) {
        let (n, length) = (self.samples, self.fft.length());
        for lx in 0..n {
            let cosines = &self.cosines[lx * length..][..length];
            let sines = &self.sines[lx * length..][..length];
            let (mut cos_sum, mut sin_sum) = ([0.0; 2 * PASS], [0.0; 2 * PASS]);
            let (with_cos, with_sin) =
                (S::as_mut_simd_f32s(&mut cos_sum).0, S::as_mut_simd_f32s(&mut sin_sum).0);
            for ((sums, &cos), &sin) in sums.chunks_exact(2 * PASS).zip(cosines).zip(sines) {
                let (cos, sin) = (simd.splat_f32s(cos), simd.splat_f32s(sin));
                for (v, &sum) in S::as_simd_f32s(sums).0.iter().enumerate() {
                    with_cos[v] = simd.mul_add_e_f32s(sum, cos, with_cos[v]);
                    with_sin[v] = simd.mul_add_e_f32s(sum, sin, with_sin[v]);
                }
            }
            for ly in first..n.min(first + PASS) {
                let (re, im) = (ly - first, ly - first + PASS);
                let row = ly * (2 * n - 1) + n - 1;
                lags.re[row + lx] = cos_sum[re] - sin_sum[im];
                lags.im[row + lx] = cos_sum[im] + sin_sum[re];
                lags.re[row - lx] = cos_sum[re] + sin_sum[im];
                lags.im[row - lx] = cos_sum[im] - sin_sum[re];
            }
        }
    }
}

/// `[row][col]` as `[group][col][lane]`, zero in lanes beyond the last row.
pub(crate) fn in_lanes(rows: &[f32], side: usize) -> Vec<f32> {
    let mut lanes = vec![0.0; side.div_ceil(LANES) * LANES * side];
    to_lanes(rows, side, &mut lanes);
    lanes
}

/// `[row][col]` to `[group][col][lane]`; lanes beyond the last row keep their value.
pub(crate) fn to_lanes(rows: &[f32], side: usize, lanes: &mut [f32]) {
    for (row, values) in rows.chunks_exact(side).enumerate() {
        let group = &mut lanes[row / LANES * side * LANES..];
        for (lanes, value) in group.chunks_exact_mut(LANES).zip(values) {
            lanes[row % LANES] = *value;
        }
    }
}
