//! A second gate for a profile, whose time does not depend on what its modes are.

use splash_firmware::spec::{Map, ModalSpec, PixelSpec, Spec};
use std::f64::consts::PI;

/// Windows below the first gate's on a detector of twice the height, and modes that do nothing.
pub struct SecondGate {
    origins: Vec<[u16; 2]>,
    modes: Vec<[f64; 2]>,
    coupling: Vec<f64>,
    height: u16,
    /// Dark level, gain and noise of each pixel, where they have one each.
    pixels: [Vec<f64>; 3],
}

impl SecondGate {
    /// One of so many modes beside the gate of `spec`: cosines of 1, 2, 3 ... half waves over the
    /// subapertures in their order, 3/5 along x and 4/5 along y, which are orthonormal.
    pub fn new(spec: &Spec<'_>, modes: usize) -> Self {
        let height = spec.detector.height;
        let origins: Vec<_> =
            spec.windows.origins.iter().map(|&[x, y]| [x, y.saturating_add(height)]).collect();
        let count = origins.len() as f64;
        let cosine = |k: usize, i: usize| {
            let q = (2.0 / count).sqrt() * (PI * k as f64 * (i as f64 + 0.5) / count).cos();
            [0.6 * q, 0.8 * q]
        };
        let of_mode = |k| (0..origins.len()).map(move |i| cosine(k, i));
        let gradients = (1..=modes).flat_map(of_mode).collect();
        let coupling = vec![0.0; 2 * modes * modes];
        let PixelSpec { dark_adu, gain, noise_adu, .. } = spec.pixels;
        let pixels = [dark_adu, gain, noise_adu].map(|map| match map {
            Map::Uniform(_) => Vec::new(),
            Map::Each(values) => values.repeat(2),
        });
        Self { origins, modes: gradients, coupling, height: height.saturating_mul(2), pixels }
    }

    /// `spec` with it, calibrated like the first.
    pub fn beside<'a>(&'a self, spec: Spec<'a>) -> Spec<'a> {
        let mut spec = spec;
        spec.detector.height = self.height;
        let PixelSpec { dark_adu, gain, noise_adu, .. } = &mut spec.pixels;
        for (map, twice) in [dark_adu, gain, noise_adu].into_iter().zip(&self.pixels) {
            if matches!(map, Map::Each(_)) {
                *map = Map::Each(twice);
            }
        }
        spec.modal = Some(ModalSpec {
            origins: &self.origins,
            reference_px: spec.slopes.reference_px,
            gain_m_per_px: spec.slopes.gain_m_per_px,
            flux_min_adu: spec.slopes.flux_min_adu,
            flux_max_adu: spec.slopes.flux_max_adu,
            modes: &self.modes,
            coupling: &self.coupling,
        });
        spec
    }
}
