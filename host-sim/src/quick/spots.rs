//! Gaussian spots on the detector: separable, with nearly normal noise.

use crate::instrument::Instrument;
use crate::reconstructor::Reconstructor;
use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Standard deviation of a spot, pixels: wide enough that samples of it have its centre, narrow
/// enough to stay in a window of 8.
const SIGMA_PX: f64 = 1.0;

/// The detector and its light.
#[derive(Clone, Debug)]
pub struct Spots {
    origins: Vec<[u16; 2]>,
    window: usize,
    width: usize,
    gain_e_per_adu: f32,
    read_noise_adu: f32,
    bias_adu: f32,
    top: f32,
    random: Xoshiro256PlusPlus,
    pixels: Vec<u16>,
}

impl Spots {
    /// Those of an instrument: its windows, its detector, and noise from `seed`.
    pub fn new(instrument: &Instrument, reconstructor: &Reconstructor, seed: u64) -> Self {
        let detector = &instrument.detector;
        let side = instrument.detector_side();
        Self {
            origins: reconstructor.origins().to_vec(),
            window: instrument.windows.size,
            width: side,
            gain_e_per_adu: detector.gain_e_per_adu as f32,
            read_noise_adu: (detector.read_noise_e / detector.gain_e_per_adu) as f32,
            bias_adu: detector.bias_adu as f32,
            top: ((1u32 << detector.bits) - 1) as f32,
            random: Xoshiro256PlusPlus::seed_from_u64(seed),
            pixels: vec![0; side * side],
        }
    }

    /// A frame of spots `centroids` pixels from the centres of their windows, with `fluxes_e`
    /// photo-electrons each; ADU, row-major.
    ///
    /// # Panics
    /// If there is not one of each for every subaperture.
    pub fn expose(&mut self, centroids: &[[f64; 2]], fluxes_e: &[f64]) -> &mut [u16] {
        assert_eq!(centroids.len(), self.origins.len(), "centroids");
        assert_eq!(fluxes_e.len(), self.origins.len(), "fluxes");
        self.pixels.fill(self.bias_adu as u16);
        let middle = (self.window as f64 - 1.0) / 2.0;
        let norm = 1.0 / (std::f64::consts::TAU * SIGMA_PX * SIGMA_PX);
        let mut profiles = [vec![0f32; self.window], vec![0f32; self.window]];
        for ((&[x0, y0], centroid), flux_e) in self.origins.iter().zip(centroids).zip(fluxes_e) {
            for (profile, centre) in profiles.iter_mut().zip(centroid) {
                for (i, value) in profile.iter_mut().enumerate() {
                    let offset = (i as f64 - middle - centre) / SIGMA_PX;
                    *value = (-0.5 * offset * offset).exp() as f32;
                }
            }
            let [along_x, along_y] = &profiles;
            let flux_adu = (flux_e * norm) as f32 / self.gain_e_per_adu;
            for (y, &profile) in along_y.iter().enumerate() {
                let start = (usize::from(y0) + y) * self.width + usize::from(x0);
                let row = &mut self.pixels[start..start + self.window];
                let level = flux_adu * profile;
                for (pairs, profile) in row.chunks_mut(2).zip(along_x.chunks(2)) {
                    let mut bits = self.random.next_u64();
                    for (pixel, profile) in pairs.iter_mut().zip(profile) {
                        let signal = level * profile;
                        // Photons: a variance of signal / gain, ADU^2.
                        let sigma = (signal / self.gain_e_per_adu
                            + self.read_noise_adu * self.read_noise_adu)
                            .sqrt();
                        let value =
                            self.bias_adu + signal + sigma * nearly_normal(bits as u32) + 0.5;
                        *pixel = value.clamp(0.0, self.top) as u16;
                        bits >>= 32;
                    }
                }
            }
        }
        &mut self.pixels
    }
}

/// The sum of four uniform bytes less its mean, over its standard deviation sqrt(4 (2^16 - 1) / 12).
fn nearly_normal(bits: u32) -> f32 {
    let pairs = (bits & 0x00ff_00ff) + ((bits >> 8) & 0x00ff_00ff);
    let sum = (pairs & 0xffff) + (pairs >> 16);
    (sum as f32 - 510.0) * (1.0 / 147.801)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_mean_zero_and_variance_one() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
        let count = 1_000_000;
        let (mut sum, mut square) = (0.0, 0.0);
        for _ in 0..count {
            let value = f64::from(nearly_normal(random.next_u32()));
            sum += value;
            square += value * value;
        }
        let count = f64::from(count);
        // Five standard errors: 1 / sqrt(n), and sqrt(2 / n) at most of the variance.
        assert!((sum / count).abs() < 0.005, "{sum}");
        assert!((square / count - 1.0).abs() < 0.007, "{square}");
    }

    #[test]
    fn spots_are_where_they_are_put_and_as_bright() {
        let mut instrument = Instrument::standard().expect("valid");
        instrument.detector.read_noise_e = 0.0;
        // So much light that photon noise is below the tolerance.
        instrument.detector.bits = 16;
        instrument.detector.gain_e_per_adu = 100.0;
        let reconstructor = Reconstructor::new(&instrument).expect("valid");
        let mut spots = Spots::new(&instrument, &reconstructor, 1);
        let (centroids, fluxes) = (vec![[1.3, -0.7]; 52], vec![2e7; 52]);
        let side = instrument.detector_side();
        let bias = f64::from(instrument.detector.bias_adu as f32);
        let [x0, y0] = reconstructor.origins()[20].map(usize::from);
        let pixels = spots.expose(&centroids, &fluxes);
        let (mut flux, mut mx, mut my) = (0.0, 0.0, 0.0);
        for y in 0..16 {
            for x in 0..16 {
                let signal = f64::from(pixels[(y0 + y) * side + x0 + x]) - bias;
                flux += signal;
                mx += signal * (x as f64 - 7.5);
                my += signal * (y as f64 - 7.5);
            }
        }
        assert!((flux * 100.0 / 2e7 - 1.0).abs() < 0.003, "{flux}");
        assert!((mx / flux - 1.3).abs() < 0.005 && (my / flux + 0.7).abs() < 0.005, "{mx} {my}");
    }
}
