//! The corrected star: residual phase, its variance and the Strehl ratio.

use super::OpticsError;
use super::error::positive;
use super::phase::{Path, PhaseSampler, check_geometry};
use crate::atmosphere::Atmosphere;
use crate::pupil::{Mirror, Pupil};

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
    sampler: PhaseSampler,
    mirror: Vec<f32>,
    residual: Vec<f32>,
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
        let mut normal = [[0.0; 3]; 3];
        for_samples(pupil, |_, basis| {
            for (row, a) in normal.iter_mut().zip(basis) {
                for (sum, b) in row.iter_mut().zip(basis) {
                    *sum += a * b;
                }
            }
        });
        let samples = pupil.side() * pupil.side();
        Ok(Self {
            pupil: pupil.clone(),
            phase_ratio,
            inverse: invert(normal),
            sampler: PhaseSampler::default(),
            mirror: vec![0.0; samples],
            residual: vec![0.0; samples],
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
        let (pupil, residual) = (&self.pupil, &mut self.residual);
        self.sampler.sample(Path::Star, pupil, atmosphere, time_s, residual);
        mirror.phase(pupil, &mut self.mirror);
        for (phase, mirror) in residual.iter_mut().zip(&self.mirror) {
            *phase = self.phase_ratio as f32 * (*phase - mirror);
        }
        let mut moments = [0.0; 3];
        for_samples(pupil, |at, basis| {
            for (moment, b) in moments.iter_mut().zip(basis) {
                *moment += b * f64::from(residual[at]);
            }
        });
        let plane =
            self.inverse.map(|row| row.iter().zip(moments).map(|(a, b)| a * b).sum::<f64>());

        let (mut square, mut re, mut im) = (0.0, 0.0, 0.0);
        for_samples(pupil, |at, basis| {
            let fitted: f64 = plane.iter().zip(basis).map(|(a, b)| a * b).sum();
            let phase = f64::from(residual[at]) - fitted;
            square += phase * phase;
            let (sin, cos) = phase.sin_cos();
            re += cos;
            im += sin;
            residual[at] = phase as f32;
        });
        let side = pupil.side();
        for (at, phase) in residual.iter_mut().enumerate() {
            if !pupil.illuminates(at / side, at % side) {
                *phase = 0.0;
            }
        }
        let count = pupil.illuminated_samples() as f64;
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

/// Calls `visit` with the index and [1, x, y] of every sample in use.
fn for_samples(pupil: &Pupil, mut visit: impl FnMut(usize, [f64; 3])) {
    let (n, side) = (pupil.samples(), pupil.side());
    let half_m = pupil.diameter_m() / 2.0;
    let coordinates: Vec<f64> = (0..side).map(|k| pupil.sample_m(k) / half_m).collect();
    for &[ix, iy] in pupil.subapertures() {
        for row in iy * n..(iy + 1) * n {
            for col in ix * n..(ix + 1) * n {
                visit(row * side + col, [1.0, coordinates[col], coordinates[row]]);
            }
        }
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
