//! The corrected star: residual phase, its variance and the Strehl ratio.

use super::OpticsError;
use super::error::positive;
use super::lane_fft::LANES;
use super::phase::{Path, PhaseSampler, check_geometry};
use super::sincos::sin_cos;
use crate::atmosphere::Atmosphere;
use crate::pupil::{Mirror, Pupil};
use pulp::{Arch, Simd, WithSimd};

/// What the science camera sees in one frame, at the science wavelength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Mean square of the residual phase over the pupil, rad^2.
    pub variance_rad2: f64,
    /// |<exp(i phi)>|^2 over the pupil.
    pub strehl: f64,
    /// Piston removed, rad.
    pub piston_rad: f64,
    /// Gradient removed along x and y, rad per metre.
    pub gradient_rad_per_m: [f64; 2],
}

/// The science path: the star's phase less the mirror's, with the least-squares plane over the
/// pupil removed (what a perfect natural-star tip/tilt loop does).
pub struct Science {
    pupil: Pupil,
    /// Sensing wavelength over science wavelength.
    phase_ratio: f64,
    /// Inverse of the normal matrix of [1, x, y] over the pupil's samples, x and y in units of
    /// half the grid's side.
    inverse: [[f64; 3]; 3],
    /// Of a column or row of samples, in units of half the grid's side.
    coordinates: Vec<f64>,
    /// One at the samples that have light, zero elsewhere, `[row][col]`.
    lit: Vec<f32>,
    /// Their amplitudes, by which the sums are weighted.
    amplitude: Vec<f32>,
    sampler: PhaseSampler,
    mirror: Vec<f32>,
    residual: Vec<f32>,
    columns: Columns,
}

/// Sums along each column of samples, and buffers of one row: additions side by side, and in the same
/// order whatever the length of a vector.
struct Columns {
    /// Whole vectors, zero beyond the last column.
    phase: Vec<f32>,
    sin: Vec<f32>,
    cos: Vec<f32>,
    sums: [Vec<f64>; 3],
}

impl Science {
    /// A science camera at `science_wavelength_m` behind a sensor at `sensing_wavelength_m`, for
    /// atmospheres like `atmosphere` (whose phase is at the sensing wavelength).
    pub fn new(
        pupil: &Pupil,
        atmosphere: &Atmosphere,
        sensing_wavelength_m: f64,
        science_wavelength_m: f64,
    ) -> Result<Self, OpticsError> {
        check_geometry(pupil, atmosphere, None)?;
        let phase_ratio = positive("sensing_wavelength_m", sensing_wavelength_m)?
            / positive("science_wavelength_m", science_wavelength_m)?;
        let side = pupil.side();
        let half_m = pupil.diameter_m() / 2.0;
        let coordinates: Vec<f64> = (0..side).map(|k| pupil.sample_m(k) / half_m).collect();
        let mut normal = [[0.0; 3]; 3];
        let amplitude = pupil.amplitudes();
        let mut lit = vec![0.0; side * side];
        for (k, lit) in lit.iter_mut().enumerate() {
            if amplitude[k] > 0.0 {
                *lit = 1.0;
                let basis = [1.0, coordinates[k % side], coordinates[k / side]];
                for (row, a) in normal.iter_mut().zip(basis) {
                    for (sum, b) in row.iter_mut().zip(basis) {
                        *sum += f64::from(amplitude[k]) * a * b;
                    }
                }
            }
        }
        let padded = || vec![0.0; side.next_multiple_of(LANES)];
        let columns = Columns {
            phase: padded(),
            sin: padded(),
            cos: padded(),
            sums: [0; 3].map(|_| vec![0.0; side]),
        };
        Ok(Self {
            pupil: pupil.clone(),
            phase_ratio,
            inverse: invert(normal),
            coordinates,
            lit,
            amplitude,
            sampler: PhaseSampler::default(),
            mirror: vec![0.0; side * side],
            residual: vec![0.0; side * side],
            columns,
        })
    }

    /// Observes at `time_s` with `mirror` in the pupil.
    ///
    /// # Panics
    /// If `mirror` does not have one segment per subaperture or `time_s` is outside the
    /// atmosphere's duration.
    pub fn observe(
        &mut self,
        atmosphere: &Atmosphere,
        time_s: f64,
        mirror: &Mirror,
    ) -> Observation {
        let Self { pupil, coordinates, lit, amplitude, residual, columns, .. } = self;
        self.sampler.sample(Path::Star, pupil, atmosphere, time_s, residual);
        mirror.phase(pupil, &mut self.mirror);
        let ratio = self.phase_ratio as f32;
        for ((phase, mirror), lit) in residual.iter_mut().zip(&self.mirror).zip(&*lit) {
            *phase = lit * (ratio * (*phase - mirror));
        }
        let arch = Arch::new();
        let moments = arch.dispatch(|| columns.moments(residual, amplitude, coordinates));
        let plane =
            self.inverse.map(|row| row.iter().zip(moments).map(|(a, b)| a * b).sum::<f64>());
        let [square, re, im] =
            arch.dispatch(Flatten { plane, coordinates, lit, amplitude, residual, columns });
        let count = pupil.open_samples();
        let half_m = pupil.diameter_m() / 2.0;
        Observation {
            variance_rad2: square / count,
            strehl: (re * re + im * im) / (count * count),
            piston_rad: plane[0],
            gradient_rad_per_m: [plane[1] / half_m, plane[2] / half_m],
        }
    }

    /// The residual phase last observed, rad at the science wavelength, `[row][col]`, zero
    /// outside the pupil.
    pub fn residual(&self) -> &[f32] {
        &self.residual
    }
}

impl Columns {
    /// Sums of phase, x phase and y phase.
    #[inline(always)]
    fn moments(&mut self, phase: &[f32], amplitude: &[f32], coordinates: &[f64]) -> [f64; 3] {
        let [sums, sums_y, _] = &mut self.sums;
        sums.fill(0.0);
        sums_y.fill(0.0);
        let side = coordinates.len();
        let rows = phase.chunks_exact(side).zip(amplitude.chunks_exact(side));
        for ((row, amplitude), y) in rows.zip(coordinates) {
            let row = row.iter().zip(amplitude);
            for ((sum, sum_y), (&phase, &amplitude)) in
                sums.iter_mut().zip(sums_y.iter_mut()).zip(row)
            {
                let phase = f64::from(amplitude * phase);
                *sum += phase;
                *sum_y += y * phase;
            }
        }
        let along_x = sums.iter().zip(coordinates).map(|(sum, x)| sum * x).sum();
        [sums.iter().sum(), along_x, sums_y.iter().sum()]
    }
}

/// Takes the plane off the phase, and sums its square, cosine and sine.
struct Flatten<'a> {
    plane: [f64; 3],
    coordinates: &'a [f64],
    lit: &'a [f32],
    amplitude: &'a [f32],
    residual: &'a mut [f32],
    columns: &'a mut Columns,
}

impl WithSimd for Flatten<'_> {
    type Output = [f64; 3];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [f64; 3] {
        let Self { plane, coordinates, lit, amplitude, residual, columns } = self;
        let [piston, slope_x, slope_y] = plane;
        let Columns { phase: line, sin, cos, sums } = columns;
        let side = coordinates.len();
        sums.iter_mut().for_each(|sums| sums.fill(0.0));
        let [squares, cosines, sines] = sums;
        let light = lit.chunks_exact(side).zip(amplitude.chunks_exact(side));
        let rows = residual.chunks_exact_mut(side).zip(light).zip(coordinates);
        for ((row, (lit, amplitude)), y) in rows {
            let fitted = piston + slope_y * y;
            for (((phase, lit), x), kept) in
                row.iter_mut().zip(lit).zip(coordinates).zip(&mut *line)
            {
                *phase = lit * (f64::from(*phase) - (fitted + slope_x * x)) as f32;
                *kept = *phase;
            }
            let (phases, _) = S::as_simd_f32s(line);
            let vectors = S::as_mut_simd_f32s(sin).0.iter_mut().zip(S::as_mut_simd_f32s(cos).0);
            for ((sin, cos), &phase) in vectors.zip(phases) {
                (*sin, *cos) = sin_cos(simd, phase);
            }
            for (k, amplitude) in amplitude.iter().enumerate() {
                squares[k] += f64::from(*amplitude) * f64::from(row[k]).powi(2);
                cosines[k] += f64::from(amplitude * cos[k]);
                sines[k] += f64::from(amplitude * sin[k]);
            }
        }
        [squares, cosines, sines].map(|sums| sums.iter().sum())
    }
}

/// Inverse of a symmetric 3 x 3 matrix by cofactors.
fn invert(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let cofactor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * cofactor(0, c)).sum();
    [0, 1, 2].map(|r| [0, 1, 2].map(|c| cofactor(c, r) / determinant))
}
