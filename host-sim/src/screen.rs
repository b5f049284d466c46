//! Phase screens: a layer's phase on a grid of texels, and its place in the layer's plane.

mod brownian;

pub(crate) use brownian::BrownianTorus;

use crate::optics::OpticsError;

/// Largest screen, in texels: that of a layer that stands still over 128 subapertures, six footprints of 16 texels
/// for each on a side. One screen of this size takes 3.6 GB while it is generated.
pub const MAX_TEXELS: u64 = 12_288 * 12_288;

/// 2 [24/5 Gamma(6/5)]^(5/6): the phase structure function is this times (r/r0)^(5/3).
pub const STRUCTURE_CONSTANT: f64 = 6.883_877_182_293_811;

/// Phase of one turbulent layer in rad at the sensing wavelength: a grid of texels plus a
/// constant gradient.
///
/// A periodic screen is a torus without an edge; the gradient is kept apart from it because a
/// plane cannot be periodic. It contributes gradient . (x - c), c being the centre of the
/// footprint sampled: the piston that this leaves undetermined has no optical effect.
#[derive(Debug, Clone)]
pub struct Screen {
    pub(crate) texels: Vec<f32>,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) texel_m: f64,
    /// Position of texel (0, 0) in metres.
    pub(crate) first_m: [f64; 2],
    pub(crate) gradient_rad_per_m: [f64; 2],
    pub(crate) periodic: bool,
}

impl Screen {
    /// A screen that is not random: `phase_rad(x_m, y_m)` evaluated every `texel_m` over the
    /// rectangle of sides `extent_m` centred on the origin, and a margin for the interpolation.
    pub fn from_fn(
        extent_m: [f64; 2],
        texel_m: f64,
        mut phase_rad: impl FnMut(f64, f64) -> f64,
    ) -> Result<Self, OpticsError> {
        use crate::optics::error::positive;
        positive("texel_m", texel_m)?;
        let mut sides = [0; 2];
        for (side, extent) in sides.iter_mut().zip(extent_m) {
            let texels = (positive("extent_m", extent)? / texel_m).ceil() + 8.0;
            if texels > MAX_TEXELS as f64 {
                let limit = format!("<= {MAX_TEXELS}");
                return Err(OpticsError::range("extent_m / texel_m", texels, limit));
            }
            *side = texels as usize;
        }
        let [width, height] = sides;
        if (width * height) as u64 > MAX_TEXELS {
            let value = (width * height) as f64;
            return Err(OpticsError::range(
                "texels of a screen",
                value,
                format!("<= {MAX_TEXELS}"),
            ));
        }
        let first_m = sides.map(|side| -(side as f64 - 1.0) / 2.0 * texel_m);
        let mut texels = Vec::with_capacity(width * height);
        for row in 0..height {
            let y = first_m[1] + row as f64 * texel_m;
            for col in 0..width {
                let phase = phase_rad(first_m[0] + col as f64 * texel_m, y);
                if !phase.is_finite() {
                    return Err(OpticsError::range("phase_rad", phase, "finite"));
                }
                texels.push(phase as f32);
            }
        }
        let gradient_rad_per_m = [0.0; 2];
        Ok(Self { texels, width, height, texel_m, first_m, gradient_rad_per_m, periodic: false })
    }

    /// Number of texels along x and y.
    pub fn texels(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Spacing of the texels in metres.
    pub fn texel_m(&self) -> f64 {
        self.texel_m
    }

    /// Position of texel (0, 0) in the layer's plane, in metres.
    pub fn first_m(&self) -> [f64; 2] {
        self.first_m
    }

    /// The constant gradient that adds to the texels, in rad per metre.
    pub fn gradient_rad_per_m(&self) -> [f64; 2] {
        self.gradient_rad_per_m
    }

    /// Phase at a texel in rad, without the gradient; the indices wrap around a periodic screen
    /// and stop at the edge of any other.
    pub fn texel(&self, col: i64, row: i64) -> f32 {
        self.texels[self.index(row, self.height) * self.width + self.index(col, self.width)]
    }

    /// Texel number `index` along an axis of `length` texels.
    pub(crate) fn index(&self, index: i64, length: usize) -> usize {
        if self.periodic {
            index.rem_euclid(length as i64) as usize
        } else {
            index.clamp(0, length as i64 - 1) as usize
        }
    }

    /// Whether a square of side `side_m` centred on `centre_m` can be interpolated everywhere.
    pub(crate) fn covers(&self, centre_m: [f64; 2], side_m: f64) -> bool {
        self.periodic
            || (0..2).all(|axis| {
                let texels = [self.width, self.height][axis] as f64;
                let near = (centre_m[axis] - side_m / 2.0 - self.first_m[axis]) / self.texel_m;
                let far = near + side_m / self.texel_m;
                near >= 1.0 && far <= texels - 3.0
            })
    }
}
