//! A wavefront of plane waves that drift, each along its own direction.
//!
//! ```text
//! phi(x, t) = s(t) sum_w a_w cos(k_w . x - |k_w| v t + psi_w)
//! a_w^2 / 2 = 0.0229 (2 pi) (d / r0)^(5/3) f_w^(-5/3) d(ln f)      Kolmogorov, f = |k| / 2 pi
//! s(t)      = (r0 / r0(t))^(5/6)                                  the seeing changes
//! ```
//!
//! x in pitches d. The mean gradient over a subaperture is known in closed form, a factor
//! sinc(k_x / 2) sinc(k_y / 2), and costs a complex product a wave.

use crate::instrument::Instrument;
use crate::optics::sinc::sinc;
use crate::pupil::{Mirror, Pupil};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::TAU;

/// Waves: two to four a ring of an octave between the pupil's and the subaperture's size.
const WAVES: usize = 16;
/// Of Kolmogorov's power spectrum of phase.
const KOLMOGOROV: f64 = 0.0229;
/// Pitches that a wave moves in a frame: the default instrument's wind.
const DRIFT: f64 = 0.125;
/// Frames in which r0 goes up and down, a minute and a quarter of one; without a common divisor.
const SEEING_FRAMES: [f64; 2] = [70_001.0, 16_127.0];
/// ln of the farthest that each of them takes r0 from nominal: it stays within a factor of two.
const SEEING_SWING: f64 = 0.34;

/// One wave.
#[derive(Clone, Copy, Debug)]
struct Wave {
    /// e^(i phase) at the pupil's centre, and what turns it in a frame.
    phasor: [f64; 2],
    turn: [f64; 2],
    /// Amplitude of its mean gradient along x and y, rad per pitch.
    gradient: [f64; 2],
}

/// The wavefront, and how SPLASH sees it.
#[derive(Clone, Debug)]
pub struct Waves {
    waves: Vec<Wave>,
    /// e^(i k . x) of each wave at each subaperture, wave by wave.
    places: Vec<[f64; 2]>,
    pixels_per_rad: f64,
    frame: u64,
}

impl Waves {
    /// Those of a seed over the pupil of an instrument.
    pub fn new(instrument: &Instrument, pupil: &Pupil, seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let across = pupil.across() as f64;
        let (lowest, highest) = (0.5 / across, 0.5);
        let step = f64::ln(highest / lowest) / WAVES as f64;
        let pitches_per_r0 = pupil.pitch_m() / instrument.r0_m();
        let (mut waves, mut places) = (Vec::new(), Vec::new());
        for w in 0..WAVES {
            let frequency = lowest * f64::exp((w as f64 + 0.5) * step);
            let power =
                KOLMOGOROV * TAU * pitches_per_r0.powf(5.0 / 3.0) * frequency.powf(-5.0 / 3.0);
            let amplitude = (2.0 * power * step).sqrt();
            let direction: f64 = random.random_range(0.0..TAU);
            let k = [direction.cos(), direction.sin()].map(|c| TAU * frequency * c);
            let average = sinc(k[0] / 2.0) * sinc(k[1] / 2.0);
            let phase: f64 = random.random_range(0.0..TAU);
            waves.push(Wave {
                phasor: [phase.cos(), phase.sin()],
                turn: {
                    let angle = -TAU * frequency * DRIFT;
                    [angle.cos(), angle.sin()]
                },
                gradient: k.map(|k| amplitude * k * average),
            });
            places.extend(pupil.subapertures().iter().map(|&[x, y]| {
                let centre = |i: usize| i as f64 - (across - 1.0) / 2.0;
                let angle = k[0] * centre(x) + k[1] * centre(y);
                [angle.cos(), angle.sin()]
            }));
        }
        let pixels_per_rad = instrument.windows.pixels_per_lambda_d / TAU;
        Self { waves, places, pixels_per_rad, frame: 0 }
    }

    /// r0 of the frame to come over the nominal one.
    pub fn seeing(&self) -> f64 {
        let swing = SEEING_FRAMES.map(|frames| (TAU * self.frame as f64 / frames).sin());
        (SEEING_SWING * (swing[0] + swing[1])).exp()
    }

    /// Centroids of the next frame with `mirror` in the pupil, pixels: each subaperture's tilt less the
    /// mean over all.
    ///
    /// # Panics
    /// If `mirror` and `centroids` have not one entry a subaperture.
    pub fn centroids(&mut self, mirror: &Mirror, centroids: &mut [[f64; 2]]) {
        assert_eq!(centroids.len() * WAVES, self.places.len(), "centroids");
        assert_eq!(centroids.len(), mirror.segments.len(), "mirror segments");
        let scale = self.seeing().powf(-5.0 / 6.0);
        for (centroid, segment) in centroids.iter_mut().zip(&mirror.segments) {
            // The edges of a segment differ by twice its centre-to-edge phase.
            *centroid = [-2.0 * segment[1], -2.0 * segment[2]];
        }
        let all = self.waves.iter_mut().zip(self.places.chunks_exact(centroids.len()));
        for (wave, places) in all {
            let [re, im] = wave.phasor;
            for (centroid, place) in centroids.iter_mut().zip(places) {
                // d/dx of the cosine: minus the sine of both angles' sum.
                let sine = scale * (re * place[1] + im * place[0]);
                centroid[0] -= wave.gradient[0] * sine;
                centroid[1] -= wave.gradient[1] * sine;
            }
            let [c, s] = wave.turn;
            wave.phasor = [re * c - im * s, re * s + im * c];
        }
        self.frame += 1;
        for axis in 0..2 {
            let mean = centroids.iter().map(|c| c[axis]).sum::<f64>() / centroids.len() as f64;
            for centroid in &mut *centroids {
                centroid[axis] = (centroid[axis] - mean) * self.pixels_per_rad;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setup() -> (Instrument, Pupil) {
        let instrument = Instrument::standard().expect("valid");
        let pupil = instrument.pupil().expect("valid");
        (instrument, pupil)
    }

    #[test]
    fn gradients_are_those_of_the_phase() {
        // The phase itself, averaged along the edges of a subaperture by a midpoint sum.
        let (instrument, pupil) = setup();
        let mut waves = Waves::new(&instrument, &pupil, 3);
        waves.waves.truncate(1);
        let (wave, k) = (waves.waves[0], wave_vector(&waves, &pupil));
        let amplitude = wave.gradient[0] / (k[0] * sinc(k[0] / 2.0) * sinc(k[1] / 2.0));
        let phase = wave.phasor[1].atan2(wave.phasor[0]);
        let phi = |x: f64, y: f64| amplitude * (k[0] * x + k[1] * y + phase).cos();
        let steps = 200;
        let gradient_x = |cx: f64, cy: f64| {
            let sum: f64 = (0..steps)
                .map(|j| {
                    let y = cy - 0.5 + (f64::from(j) + 0.5) / f64::from(steps);
                    phi(cx + 0.5, y) - phi(cx - 0.5, y)
                })
                .sum();
            sum / f64::from(steps)
        };
        let expected: Vec<f64> = pupil
            .subapertures()
            .iter()
            .map(|&[x, y]| gradient_x(x as f64 - 3.5, y as f64 - 3.5))
            .collect();
        let mean = expected.iter().sum::<f64>() / expected.len() as f64;
        let mut centroids = vec![[0.0; 2]; expected.len()];
        waves.places.truncate(expected.len());
        let mut one = Waves { places: waves.places.repeat(WAVES), ..waves.clone() };
        one.centroids(&Mirror::flat(expected.len()), &mut centroids);
        for (centroid, expected) in centroids.iter().zip(expected) {
            let expected = (expected - mean) * waves.pixels_per_rad;
            assert!((centroid[0] - expected).abs() < 1e-4 * amplitude, "{centroid:?} {expected}");
        }
    }

    /// From how a wave's phase goes between neighbours.
    fn wave_vector(waves: &Waves, pupil: &Pupil) -> [f64; 2] {
        let at = |cell: [usize; 2]| {
            let i = pupil.subapertures().iter().position(|&s| s == cell).expect("lit");
            waves.places[i][1].atan2(waves.places[i][0])
        };
        let turn = |angle: f64| angle - TAU * (angle / TAU).round();
        [turn(at([4, 3]) - at([3, 3])), turn(at([3, 4]) - at([3, 3]))]
    }

    #[test]
    fn tilts_have_the_size_of_the_atmospheres() {
        // Mean-square tilt of a square subaperture of side d, rad per d, relative to a wide pupil's
        // mean: the two-dimensional integral of (2 pi f)^2 Phi(f) sinc^2 sinc^2, both axes. With
        // Phi = 0.0229 (d/r0)^(5/3) f^(-11/3) from 1/16 to 1/2, whose average of both sinc^2 over
        // directions is 0.99 to 0.43: 2 pi (0.0229) (2 pi)^2 times the integral of f^(-2/3) S(f).
        let (instrument, pupil) = setup();
        let integral: f64 = {
            let (low, high, steps) = (1.0 / 16.0, 0.5f64, 4000);
            let width = (high - low) / f64::from(steps);
            (0..steps)
                .map(|i| {
                    let f = low + (f64::from(i) + 0.5) * width;
                    let directions = 64;
                    let mean: f64 = (0..directions)
                        .map(|a| {
                            let angle = TAU * (f64::from(a) + 0.5) / f64::from(directions);
                            let (kx, ky) = (TAU * f * angle.cos(), TAU * f * angle.sin());
                            (sinc(kx / 2.0) * sinc(ky / 2.0)).powi(2)
                        })
                        .sum::<f64>()
                        / f64::from(directions);
                    f.powf(-2.0 / 3.0) * mean * width
                })
                .sum()
        };
        let expected = TAU * KOLMOGOROV * TAU * TAU * integral;
        let mut sum = 0.0;
        let seeds = 40;
        for seed in 0..seeds {
            let waves = Waves::new(&instrument, &pupil, seed);
            sum += waves.waves.iter().flat_map(|w| w.gradient).map(|g| g * g / 2.0).sum::<f64>();
        }
        // 16 rings stand for the integral: 1 % here; the directions' scatter is as large.
        let found = sum / seeds as f64;
        assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
    }

    #[test]
    fn seeing_stays_within_a_factor_of_two() {
        let (instrument, pupil) = setup();
        let mut waves = Waves::new(&instrument, &pupil, 1);
        let (mut least, mut most) = (f64::INFINITY, 0f64);
        for frame in (0..2_000_000).step_by(10) {
            waves.frame = frame;
            least = least.min(waves.seeing());
            most = most.max(waves.seeing());
        }
        assert!(least > 0.5 && least < 0.6 && most < 2.0 && most > 1.8, "{least} {most}");
    }
}
