//! Detector frames from integer arithmetic alone: the same bits on every machine.

use crate::instrument::Instrument;

/// SplitMix64 (Steele, Lea & Flood 2014): `z` is a counter in steps of the golden ratio, mixed.
#[derive(Clone, Debug)]
pub struct Rng(u64);

impl Rng {
    /// A sequence of its own for each seed.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// 64 uniform bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `0 .. n`.
    pub const fn below(&mut self, n: u32) -> u32 {
        (((self.bits() >> 32) * n as u64) >> 32) as u32
    }

    /// Uniform in `low ..= high`.
    pub const fn between(&mut self, low: i32, high: i32) -> i32 {
        low.wrapping_add(self.below(high.wrapping_sub(low) as u32 + 1) as i32)
    }

    /// Nearly normal with a standard deviation of 2^16: the sum of twelve uniform 16-bit numbers
    /// less its mean, within +-6 x 2^16.
    pub const fn normal_q16(&mut self) -> i64 {
        let mut sum = 0;
        let mut word = 0;
        while word < 3 {
            let bits = self.bits();
            sum += (bits & 0xffff) + (bits >> 16 & 0xffff) + (bits >> 32 & 0xffff) + (bits >> 48);
            word += 1;
        }
        // The mean of a uniform 16-bit number is 65535/2.
        sum as i64 - 6 * 65535
    }

    /// Uniform in 0 .. 1, with 53 bits.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform between two values.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Nearly normal, of unit variance.
    pub fn normal(&mut self) -> f64 {
        self.normal_q16() as f64 / 65536.0
    }
}

/// The image of one beacon: peak x w^4 / (w^2 + r^2)^2, a Moffat profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spot {
    /// Column and row of its centre, from the centre of the window, pixels in Q8.
    pub centre_q8: [i32; 2],
    /// Signal at its centre, ADU.
    pub peak_adu: u32,
    /// w, pixels in Q8, 1 to 2^11; the full width at half maximum is 1.29 w.
    pub width_q8: u32,
}

impl Spot {
    /// Signal in the pixel at column `x`, row `y` of a window of `size`, ADU, rounded down.
    pub fn signal(&self, size: u8, x: u8, y: u8) -> u32 {
        let offset = |i: u8, centre: i32| {
            i64::from(256 * i32::from(i) - 128 * (i32::from(size) - 1) - centre)
        };
        let [cx, cy] = self.centre_q8;
        let (dx, dy) = (offset(x, cx), offset(y, cy));
        let w2 = u64::from(self.width_q8) * u64::from(self.width_q8);
        // Below 2^22 + 2^28, so that its square fits 64 bits, as does 2^16 w^4.
        let denominator = w2 + (dx * dx + dy * dy) as u64;
        (u64::from(self.peak_adu) * w2 * w2 / (denominator * denominator)) as u32
    }
}

/// What surrounds the spots on the detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Background {
    /// Dark level, ADU.
    pub level_adu: u32,
    /// Read noise, ADU rms in Q8.
    pub noise_q8: u32,
    /// Electrons per ADU, which set the photon noise; none if zero.
    pub electrons_per_adu: u32,
}

impl Background {
    /// The default instrument's: 100 ADU, 3 e- of read noise, 4 e-/ADU.
    pub const DEFAULT: Self = Self { level_adu: 100, noise_q8: 192, electrons_per_adu: 4 };
    /// Nothing.
    pub const NONE: Self = Self { level_adu: 0, noise_q8: 0, electrons_per_adu: 0 };
}

/// Spots whose centres are uniform within `wander_q8` of their windows' centres.
pub fn scattered(
    instrument: &Instrument,
    (peak_adu, width_q8, wander_q8): (u32, u32, i32),
    rng: &mut Rng,
) -> Vec<Spot> {
    let spot = |_| Spot {
        centre_q8: [0; 2].map(|_: i32| rng.between(-wander_q8, wander_q8)),
        peak_adu,
        width_q8,
    };
    (0..instrument.count()).map(spot).collect()
}

/// A frame: `spots` in the instrument's windows over the background, clipped to its bits.
pub fn frame(
    instrument: &Instrument,
    spots: &[Spot],
    background: &Background,
    rng: &mut Rng,
) -> Vec<u16> {
    let (width, height) = (usize::from(instrument.detector.width), instrument.detector.height);
    let mut signal = vec![0u32; width * usize::from(height)];
    let size = instrument.window;
    for (spot, &[x0, y0]) in spots.iter().zip(&instrument.origins) {
        for y in 0..size {
            for x in 0..size {
                let place = usize::from(y0 + u16::from(y)) * width + usize::from(x0 + u16::from(x));
                signal[place] = spot.signal(size, x, y);
            }
        }
    }
    let top = (1i64 << instrument.detector.bits) - 1;
    let noisy = |signal: u32| {
        // Variances in ADU^2, Q16.
        let photons = match background.electrons_per_adu {
            0 => 0,
            electrons => (u64::from(signal) << 16) / u64::from(electrons),
        };
        let read = u64::from(background.noise_q8) * u64::from(background.noise_q8);
        let rms_q8 = (photons + read).isqrt() as i64;
        let noise = (rng.normal_q16() * rms_q8 + (1 << 23)) >> 24;
        (i64::from(background.level_adu) + i64::from(signal) + noise).clamp(0, top) as u16
    };
    signal.into_iter().map(noisy).collect()
}

/// A frame without background whose windows have their centre of gravity where it is asked for.
///
/// Each window's light is in its four corner pixels: `flux` in all, shared out bilinearly, so that
/// the centroid is within (W - 1) / `flux` pixels of `centroids_q16` (Q16 pixels from the window's
/// centre). A `None` leaves its window dark.
pub fn steered(
    instrument: &Instrument,
    centroids_q16: impl IntoIterator<Item = Option<[i32; 2]>>,
    flux: u16,
) -> Vec<u16> {
    let width = usize::from(instrument.detector.width);
    let mut pixels = vec![0u16; width * usize::from(instrument.detector.height)];
    let last = usize::from(instrument.window) - 1;
    let span = (last as i64) << 16;
    for (centroid, &[x0, y0]) in centroids_q16.into_iter().zip(&instrument.origins) {
        let Some(centroid) = centroid else { continue };
        // Parts of the light in the last column and in the last row, of `span`.
        let [east, south] = centroid.map(|c| (i64::from(c) + span / 2).clamp(0, span));
        let flux = i64::from(flux);
        let share = |amount: i64, part: i64| (amount * part + span / 2) / span;
        let below = share(flux, south);
        let (north_east, south_east) = (share(flux - below, east), share(below, east));
        let place = usize::from(y0) * width + usize::from(x0);
        pixels[place] = (flux - below - north_east) as u16;
        pixels[place + last] = north_east as u16;
        pixels[place + last * width] = (below - south_east) as u16;
        pixels[place + last * width + last] = south_east as u16;
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First outputs of SplitMix64 from seed 1234567, as its authors' C code prints them.
    #[test]
    fn generator_is_splitmix64() {
        let mut rng = Rng::new(1_234_567);
        let published = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
            4_593_380_528_125_082_431,
            16_408_922_859_458_223_821,
        ];
        assert_eq!([0; 5].map(|_| rng.bits()), published);
    }

    #[test]
    fn normal_has_its_moments() {
        let mut rng = Rng::new(1);
        let n = 200_000;
        let values: Vec<f64> = (0..n).map(|_| rng.normal()).collect();
        let mean = values.iter().sum::<f64>() / f64::from(n);
        let variance = values.iter().map(|v| v * v).sum::<f64>() / f64::from(n);
        // Standard errors 0.0022 and 0.0030.
        assert!(mean.abs() < 0.01, "{mean}");
        assert!((variance - 1.0).abs() < 0.015, "{variance}");
    }

    #[test]
    fn steered_light_is_where_it_is_asked_for() {
        let instrument = Instrument::ideal(Instrument::circle(4, 4).mask, 4);
        let mut rng = Rng::new(2);
        for _ in 0..100 {
            let asked: Vec<[i32; 2]> = (0..instrument.count())
                .map(|_| [0; 2].map(|_: i32| rng.between(-3 << 15, 3 << 15)))
                .collect();
            let pixels = steered(&instrument, asked.iter().copied().map(Some), 60_000);
            for (asked, &[x0, y0]) in asked.iter().zip(&instrument.origins) {
                let mut sums = [0.0; 3];
                for y in 0..4 {
                    for x in 0..4 {
                        let p = f64::from(pixels[usize::from(y0 + y) * 16 + usize::from(x0 + x)]);
                        sums[0] += p;
                        sums[1] += p * (f64::from(x) - 1.5);
                        sums[2] += p * (f64::from(y) - 1.5);
                    }
                }
                assert_eq!(sums[0], 60_000.0);
                for (sum, &asked) in sums[1..].iter().zip(asked) {
                    let error = sum / sums[0] - f64::from(asked) / 65536.0;
                    assert!(error.abs() <= 3.0 / 60_000.0, "{error}");
                }
            }
        }
    }
}
