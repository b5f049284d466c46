//! Interpolation of the phase screens: separable cubic convolution (Catmull-Rom).

use crate::atmosphere::{Atmosphere, Flow};
use crate::screen::Screen;
use std::ops::Range;

/// The part of a layer's screen that is above the telescope at one instant: a square of texels.
#[derive(Debug, Default)]
pub(crate) struct Footprint {
    /// Phase in rad, `[row][col]`, the screen's gradient included.
    texels: Vec<f32>,
    /// The screen's gradient along x, rad, for each column.
    ramp: Vec<f32>,
    side: usize,
    texel_m: f64,
    /// Position of the optical axis in texels along x and y.
    axis: [f64; 2],
}

impl Footprint {
    /// Copies what `flow` has above the telescope at `time_s`.
    ///
    /// # Panics
    /// If `time_s` lies outside the duration of the atmosphere.
    pub(crate) fn cut(&mut self, flow: &Flow, atmosphere: &Atmosphere, time_s: f64) {
        let duration_s = atmosphere.duration_s();
        // A frame's time is a product: it may round to just beyond the end.
        let valid = (0.0..=duration_s * (1.0 + 1e-9)).contains(&time_s);
        assert!(valid, "time_s = {time_s}: the atmosphere lasts {duration_s} s");
        let screen = &flow.screen;
        let centre = flow.centre_m(time_s);
        let place = [0, 1].map(|axis| (centre[axis] - screen.first_m[axis]) / screen.texel_m);
        let first = place.map(|place| place.floor() as i64);
        // A cubic needs one texel before and two after the one it starts from.
        let half = (atmosphere.footprint_m() / 2.0 / screen.texel_m).ceil() as usize + 2;
        self.side = 2 * half + 2;
        self.texel_m = screen.texel_m;
        self.axis = [0, 1].map(|axis| half as f64 + place[axis] - place[axis].floor());
        let gradient = screen.gradient_rad_per_m.map(|g| g * screen.texel_m);
        let columns = runs(screen, first[0] - half as i64, self.side);
        let plane = |axis: usize, k: usize| (gradient[axis] * (k as f64 - self.axis[axis])) as f32;
        self.ramp.clear();
        self.ramp.extend((0..self.side).map(|col| plane(0, col)));
        self.texels.clear();
        self.texels.reserve(self.side * self.side);
        for row in 0..self.side {
            let source = screen.index(first[1] - half as i64 + row as i64, screen.height);
            let source = &screen.texels[source * screen.width..][..screen.width];
            let rise = plane(1, row);
            let mut ramp = self.ramp.as_slice();
            for run in &columns {
                let (here, rest) = ramp.split_at(run.len());
                let texels = source[run.clone()].iter().zip(here);
                self.texels.extend(texels.map(|(texel, along_x)| texel + (rise + along_x)));
                ramp = rest;
            }
        }
    }

    /// Texels on a side.
    pub(crate) fn side(&self) -> usize {
        self.side
    }

    /// The row of texels that `taps` interpolate along y.
    #[inline]
    pub(crate) fn between_rows(&self, taps: &Taps, line: &mut [f32]) {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| &self.row(taps.first + k)[..line.len()]);
        let [wa, wb, wc, wd] = taps.weights;
        for (k, value) in line.iter_mut().enumerate() {
            *value = wa * a[k] + wb * b[k] + wc * c[k] + wd * d[k];
        }
    }

    /// One row of texels.
    pub(crate) fn row(&self, row: usize) -> &[f32] {
        &self.texels[row * self.side..][..self.side]
    }

    /// Texel below and cubic weights for the coordinate `offset_m` from the optical axis.
    fn cubic(&self, axis: usize, offset_m: f64) -> (usize, [f64; 4]) {
        let place = self.axis[axis] + offset_m / self.texel_m;
        let f = place - place.floor();
        let weights = [
            f * (f * (1.0 - 0.5 * f) - 0.5),
            1.0 + f * f * (1.5 * f - 2.5),
            f * (0.5 + f * (2.0 - 1.5 * f)),
            f * f * 0.5 * (f - 1.0),
        ];
        (place.floor() as usize - 1, weights)
    }

    /// Taps for a list of coordinates along `axis`, in metres from the optical axis.
    pub(crate) fn taps(&self, axis: usize, offsets_m: impl Iterator<Item = f64>) -> Vec<Taps> {
        offsets_m
            .map(|offset_m| {
                let (first, weights) = self.cubic(axis, offset_m);
                Taps { first, weights: weights.map(|weight| weight as f32) }
            })
            .collect()
    }

    /// The mean over a list of coordinates along `axis`, as weights of neighbouring texels.
    pub(crate) fn mean(&self, axis: usize, offsets_m: &[f64]) -> Stencil {
        self.stencil(axis, offsets_m, |_, weight| weight / offsets_m.len() as f64)
    }

    /// The sum over such a list with a weight for each coordinate.
    pub(crate) fn weighted(&self, axis: usize, offsets_m: &[f64], weights: &[f64]) -> Stencil {
        self.stencil(axis, offsets_m, |k, weight| weight * weights[k])
    }

    /// Interpolation at all coordinates, `scaled` by their number in the list, in one.
    fn stencil(
        &self,
        axis: usize,
        offsets_m: &[f64],
        scaled: impl Fn(usize, f64) -> f64,
    ) -> Stencil {
        let cubics: Vec<_> = offsets_m.iter().map(|&offset| self.cubic(axis, offset)).collect();
        let first = cubics.iter().map(|cubic| cubic.0).min().unwrap_or(0);
        let last = cubics.iter().map(|cubic| cubic.0 + 3).max().unwrap_or(0);
        let mut weights = vec![0.0; last + 1 - first];
        for (k, (start, cubic)) in cubics.into_iter().enumerate() {
            for (sum, weight) in weights[start - first..].iter_mut().zip(cubic) {
                *sum += scaled(k, weight);
            }
        }
        Stencil { first, weights }
    }

    /// The phase in rad averaged over the product of two stencils.
    pub(crate) fn integrate(&self, x: &Stencil, y: &Stencil) -> f64 {
        let along_x = |row: usize| -> f64 {
            let texels = &self.row(row)[x.first..];
            texels.iter().zip(&x.weights).map(|(&texel, weight)| f64::from(texel) * weight).sum()
        };
        y.weights.iter().enumerate().map(|(k, weight)| along_x(y.first + k) * weight).sum()
    }
}

/// Columns `first` to `first` + `count` of a screen, in stretches that lie side by side: a torus goes on at
/// its other edge, any other screen repeats its last texel.
fn runs(screen: &Screen, first: i64, count: usize) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = vec![];
    for column in first..first + count as i64 {
        let index = screen.index(column, screen.width);
        match runs.last_mut() {
            Some(run) if run.end == index => run.end += 1,
            _ => runs.push(index..index + 1),
        }
    }
    runs
}

/// Cubic interpolation at one coordinate: four neighbouring texels and their weights.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Taps {
    /// Index of the first of the four texels.
    pub(crate) first: usize,
    pub(crate) weights: [f32; 4],
}

impl Taps {
    /// The value at the coordinate, from a line of texels.
    #[inline]
    pub(crate) fn on(&self, line: &[f32]) -> f32 {
        let t = &line[self.first..self.first + 4];
        let w = self.weights;
        (t[0] * w[0] + t[1] * w[1]) + (t[2] * w[2] + t[3] * w[3])
    }
}

/// A linear functional of neighbouring texels along one axis.
#[derive(Debug, Clone)]
pub(crate) struct Stencil {
    first: usize,
    weights: Vec<f64>,
}
