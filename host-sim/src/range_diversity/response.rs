//! What a star and both gates see of a wave exp(i k.x) in a layer at height h, in tips and tilts of the segments.
//!
//! The mean gradient over a square of side a around y is i k S_a(k) exp(i k.y), S_a the product of
//! sinc(k_x a / 2) and sinc(k_y a / 2), sinc u = sin u / u. With b = 1 - h/H, b_z = 1 - h/z (0 above z) and
//! P(k) = (1/n) sum_j exp(i k.x_j), the mean over all subapertures j,
//!
//! star:        (d/2) i k S_d(k) exp(i k.x_i)
//! gate at H:   (d/2) i k b S_bd(k) [exp(i k.x_i) - P(b k) exp(i (1-b) k.x_i)]
//! gate at z:   (d/2) i k b_z [S_bd(k) exp(i k.x_i) - S_(b_z d)(k) P(b_z k) exp(i (1-b_z) k.x_i)]
//!
//! The mean gradient over the pupil, on the way back, is the mean of those over its subapertures: from spot i, their
//! squares at the layer have sides b d and centres b x_j + (1-b) x_i, with b_z in place of b for the gate at z.
//!
//! The best fit of piston, tip and tilt to the star's phase has, with j(u) = (sin u - u cos u) / u^2, the piston
//! S_d(k) exp(i k.x_i) and the tip 3 i j(k_x d/2) sinc(k_y d/2) exp(i k.x_i). A factor i is left out everywhere.
//!
//! Lengths are in units of half the grid's side.

use super::waves::Wave;
use crate::optics::sinc::sinc;
use crate::pupil::Pupil;
use nalgebra::DMatrix;

/// A layer's place below both gates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arms {
    /// Share of the turbulence.
    pub weight: f64,
    /// b = 1 - h/H.
    pub focus: f64,
    /// b_z = 1 - h/z, 0 for a layer above the second gate.
    pub gate: f64,
}

/// Subapertures in units of half the grid's side.
#[derive(Clone, Debug)]
pub struct Response {
    across: usize,
    cells: Vec<[usize; 2]>,
}

/// Responses to some waves, each multiplied by the root of its weight: two columns a wave, real and imaginary part;
/// rows are tip and tilt of the first segment, of the second, and so on, rad from centre to edge for D / r0 = 1. The
/// mean over the segments is taken off slopes.
#[derive(Clone, Debug)]
pub struct Responses {
    /// Mean gradient of the star's phase over each subaperture.
    pub star: DMatrix<f64>,
    /// Tips and tilts of the best fit to the star's phase; their mean is not off.
    pub fit: DMatrix<f64>,
    /// Its pistons, a row a segment.
    pub pistons: DMatrix<f64>,
    /// Slopes of the gate at H.
    pub first: DMatrix<f64>,
    /// Slopes of the gate at z.
    pub second: DMatrix<f64>,
}

impl Response {
    /// That of the subapertures of `pupil`.
    pub fn new(pupil: &Pupil) -> Self {
        Self { across: pupil.across(), cells: pupil.subapertures().to_vec() }
    }

    /// The longest distance of two points of the pupil, at most.
    pub fn longest(&self) -> f64 {
        let half_pitch = 1.0 / self.across as f64;
        let distance = |cell: &[usize; 2]| {
            let [x, y] = cell.map(|index| self.centre(index).abs() + half_pitch);
            x.hypot(y)
        };
        2.0 * self.cells.iter().map(distance).fold(0.0, f64::max)
    }

    fn centre(&self, index: usize) -> f64 {
        (2.0 * index as f64 + 1.0) / self.across as f64 - 1.0
    }

    /// What is seen of `waves` in the layer at `arms`.
    pub fn to(&self, waves: &[Wave], arms: Arms) -> Responses {
        let segments = self.cells.len();
        let slopes = || DMatrix::zeros(2 * segments, 2 * waves.len());
        let mut all = Responses {
            star: slopes(),
            fit: slopes(),
            pistons: DMatrix::zeros(segments, 2 * waves.len()),
            first: slopes(),
            second: slopes(),
        };
        for (column, wave) in waves.iter().enumerate() {
            self.star(wave, arms.weight, column, &mut all);
            for (gate, matrix) in [(arms.focus, &mut all.first), (arms.gate, &mut all.second)] {
                self.gate(wave, arms, gate, column, matrix);
            }
        }
        for matrix in [&mut all.star, &mut all.first, &mut all.second] {
            remove_mean(matrix);
        }
        all
    }

    /// Fills a wave's columns of what the star has.
    fn star(&self, wave: &Wave, weight: f64, column: usize, all: &mut Responses) {
        let root = (weight * wave.weight).sqrt();
        let half = wave.vector.map(|k| k / self.across as f64);
        let [x, y] = half.map(sinc);
        let slopes = half.map(|half| root * half * x * y);
        let tips = [root * fitted_tip(half[0]) * y, root * x * fitted_tip(half[1])];
        let here = self.grid(wave, 1.0);
        for (segment, &cell) in self.cells.iter().enumerate() {
            let own = here.at(cell);
            set(&mut all.star, segment, column, slopes, own);
            set(&mut all.fit, segment, column, tips, own);
            // exp(i k.x) without a factor i is -i exp(i k.x).
            let piston = root * x * y;
            all.pistons[(segment, 2 * column)] = piston * own[1];
            all.pistons[(segment, 2 * column + 1)] = -piston * own[0];
        }
    }

    /// Fills a wave's columns of what a gate sees that sees the layer with `arm`.
    fn gate(&self, wave: &Wave, arms: Arms, arm: f64, column: usize, seen: &mut DMatrix<f64>) {
        let scale = arm * (arms.weight * wave.weight).sqrt();
        let half = wave.vector.map(|k| k / self.across as f64);
        let square = |side: f64| sinc(side * half[0]) * sinc(side * half[1]);
        let up = square(arms.focus);
        let over_pupil = {
            let grid = self.grid(wave, arm);
            self.cells.iter().fold([0.0; 2], |sum, &cell| add(sum, grid.at(cell)))
        };
        let back = over_pupil.map(|sum| sum * square(arm) / self.cells.len() as f64);
        let (here, from) = (self.grid(wave, 1.0), self.grid(wave, 1.0 - arm));
        for (segment, &cell) in self.cells.iter().enumerate() {
            let (own, back) = (here.at(cell), times(back, from.at(cell)));
            let value = [up * own[0] - back[0], up * own[1] - back[1]];
            set(seen, segment, column, half.map(|half| scale * half), value);
        }
    }

    /// exp(i s k.x) at the centres of the grid.
    fn grid(&self, wave: &Wave, scale: f64) -> Grid {
        let line = |k: f64| {
            let at = |index| {
                let (sin, cos) = (scale * k * self.centre(index)).sin_cos();
                [cos, sin]
            };
            (0..self.across).map(at).collect()
        };
        Grid(wave.vector.map(line))
    }
}

/// Sets tip and tilt of a segment to a complex value times a factor for each.
fn set(
    matrix: &mut DMatrix<f64>,
    segment: usize,
    column: usize,
    factors: [f64; 2],
    value: [f64; 2],
) {
    for (axis, factor) in factors.into_iter().enumerate() {
        for (part, value) in value.into_iter().enumerate() {
            matrix[(2 * segment + axis, 2 * column + part)] = factor * value;
        }
    }
}

/// exp(i k.x) along each axis.
struct Grid([Vec<[f64; 2]>; 2]);

impl Grid {
    fn at(&self, [x, y]: [usize; 2]) -> [f64; 2] {
        times(self.0[0][x], self.0[1][y])
    }
}

fn times(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

fn add(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

/// 3 (sin u - u cos u) / u^2: the tip, from centre to edge, of the line that fits sin(u x) best for |x| < 1.
fn fitted_tip(u: f64) -> f64 {
    // The series where the difference would lose digits.
    if u.abs() < 1e-2 { u * (1.0 - u * u / 10.0) } else { 3.0 * (u.sin() - u * u.cos()) / (u * u) }
}

/// Takes the mean over the segments off, axis by axis.
pub(super) fn remove_mean(slopes: &mut DMatrix<f64>) {
    let segments = slopes.nrows() as f64 / 2.0;
    for mut column in slopes.column_iter_mut() {
        for axis in 0..2 {
            let mean = column.iter().skip(axis).step_by(2).sum::<f64>() / segments;
            column.iter_mut().skip(axis).step_by(2).for_each(|slope| *slope -= mean);
        }
    }
}
