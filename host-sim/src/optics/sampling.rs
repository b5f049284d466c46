//! Interpolation of the phase screens: separable cubic convolution (Catmull-Rom).

use crate::atmosphere::{Atmosphere, Flow};

/// The part of a layer's screen that is above the telescope at one instant: a square of texels.
#[derive(Debug, Default)]
pub(crate) struct Footprint {
    /// Phase in rad, `[row][col]`, the screen's gradient included.
    texels: Vec<f32>,
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
        self.texels.clear();
        self.texels.reserve(self.side * self.side);
        let gradient = screen.gradient_rad_per_m.map(|g| g * screen.texel_m);
        for row in 0..self.side {
            let source = screen.index(first[1] - half as i64 + row as i64, screen.height);
            let source = &screen.texels[source * screen.width..][..screen.width];
            let plane = gradient[1] * (row as f64 - self.axis[1]) - gradient[0] * self.axis[0];
            self.texels.extend((0..self.side).map(|col| {
                let texel = source[screen.index(first[0] - half as i64 + col as i64, screen.width)];
                texel + (plane + gradient[0] * col as f64) as f32
            }));
        }
    }

    /// Texels on a side.
    pub(crate) fn side(&self) -> usize {
        self.side
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
        let cubics: Vec<_> = offsets_m.iter().map(|&offset| self.cubic(axis, offset)).collect();
        let first = cubics.iter().map(|cubic| cubic.0).min().unwrap_or(0);
        let last = cubics.iter().map(|cubic| cubic.0 + 3).max().unwrap_or(0);
        let mut weights = vec![0.0; last + 1 - first];
        for (start, cubic) in cubics {
            for (sum, weight) in weights[start - first..].iter_mut().zip(cubic) {
                *sum += weight / offsets_m.len() as f64;
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

/// Cubic interpolation at one coordinate: four neighbouring texels and their weights.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Taps {
    /// Index of the first of the four texels.
    pub(crate) first: usize,
    pub(crate) weights: [f32; 4],
}

/// A linear functional of neighbouring texels along one axis.
#[derive(Debug, Clone)]
pub(crate) struct Stencil {
    first: usize,
    weights: Vec<f64>,
}
