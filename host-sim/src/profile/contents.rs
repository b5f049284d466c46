//! Frames of very different content, all of them complete.

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use splash_firmware::spec::Spec;
use std::fmt;

/// What a frame shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Zeros, but for one spot: without any, a frame is held and does less.
    Dark,
    /// A spot in every window, just below saturation.
    Bright,
    /// Any value in every pixel.
    Noise,
    /// Every pixel saturated.
    Saturated,
    /// A spot in every other window.
    HalfDead,
}

impl Content {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Dark, Self::Bright, Self::Noise, Self::Saturated, Self::HalfDead];

    /// A frame for this specification, row-major, ADU.
    pub fn frame(self, spec: &Spec<'_>, seed: u64, number: u32) -> Vec<u16> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ u64::from(number) << 32);
        let (width, height) = (usize::from(spec.detector.width), usize::from(spec.detector.height));
        let top = ((1u32 << spec.detector.bits) - 1) as u16;
        let mut pixels = vec![0; width * height];
        match self {
            Self::Noise => pixels.fill_with(|| rng.random_range(0..=top)),
            Self::Saturated => pixels.fill(top),
            Self::Dark | Self::Bright | Self::HalfDead => {
                let level = if self == Self::Dark { 0 } else { top / 32 };
                pixels.fill_with(|| rng.random_range(0..=level));
                for (i, [x0, y0]) in spec.origins().enumerate() {
                    let lit = match self {
                        Self::Dark => i == 0,
                        Self::HalfDead => i % 2 == 0,
                        _ => true,
                    };
                    if !lit {
                        continue;
                    }
                    // Three pixels square, anywhere in the window.
                    let room = usize::from(spec.windows.size) - 3;
                    let (x0, y0) = (usize::from(x0), usize::from(y0));
                    let (dx, dy) = (rng.random_range(0..=room), rng.random_range(0..=room));
                    for y in y0 + dy..y0 + dy + 3 {
                        let start = y * width + x0 + dx;
                        pixels[start..start + 3].fill_with(|| rng.random_range(top / 2..top));
                    }
                }
            }
        }
        pixels
    }
}

impl fmt::Display for Content {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Dark => "dark",
            Self::Bright => "bright",
            Self::Noise => "noise",
            Self::Saturated => "saturated",
            Self::HalfDead => "half dead",
        })
    }
}
