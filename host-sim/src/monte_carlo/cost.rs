//! What a run will take, before it starts.
//!
//! Times are a fit to one core of a virtual PC at 3.7 GHz with AVX-512: within a factor of
//! two there, of the right order elsewhere. Memory is counted from the sizes of the arrays.

use super::budget::{Case, Step};
use super::comparator::Comparator;
use super::point::Point;
use crate::atmosphere::Turbulence;
use crate::closed_loop::Sensing;
use crate::error::Error;

/// Drawing a screen, s per texel.
pub(crate) const DRAW_S: f64 = 3e-8;
/// A spot of a second gate with 80 samples across its subaperture, s.
const GATE_S: f64 = 4.5e-4;
/// Bytes per texel of a screen while it is drawn, of its spectrum, and once it is drawn.
const DRAWING: u64 = 24;
const SPECTRUM: u64 = 2;
const DRAWN: u64 = 4;
/// Bytes of everything that does not grow with the pupil.
const BASE: u64 = 64 << 20;

/// Time and memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// On one core, s.
    pub core_s: f64,
    /// Bytes that all threads share.
    pub shared: u64,
    /// Bytes for each thread.
    pub each: u64,
}

impl Cost {
    /// That of one screen at `point` with `cases`.
    ///
    /// # Errors
    /// [`Error::Config`] if a screen would be too large for any memory.
    pub fn of_screen(point: &Point, cases: &[Case]) -> Result<Self, Error> {
        let instrument = point.instrument();
        let pupil = point.pupil();
        let [largest, all] = Turbulence::texels(
            &instrument.layers(),
            pupil.diameter_m(),
            pupil.pitch_m(),
            point.duration_s(),
        )?;
        let sensing = point.conditions().sensing;
        let (n, samples) = (point.n() as f64, pupil.side() as u64);
        // All work is on samples.
        let scale = (pupil.samples() as f64 / 8.0).powi(2);
        let slices = instrument.slab()?.count() as f64;
        let gate = Self::of_second_gate(point)?;
        let one = |case: &Case| {
            let (frames, sensing) = match case.until {
                None if case.comparator == Comparator::Fit => (point.averaged().len(), sensing),
                Some(Step::Images) | None => (point.frames() as usize, sensing),
                Some(Step::Temporal | Step::Quantisation) => {
                    (point.frames() as usize, Sensing::Geometric)
                }
                Some(_) => (point.averaged().len(), Sensing::Geometric),
            };
            let slices = match (case.comparator, sensing) {
                (Comparator::Splash | Comparator::Lgs, Sensing::Images) => slices,
                _ => 1.0,
            };
            let frame_s = match (case.comparator, sensing) {
                (Comparator::Splash, Sensing::Images) => {
                    // The star is looked at in every frame, each spot once in a cycle.
                    let star_s = frame_s(Comparator::Fit, sensing, n);
                    let spots_s = frame_s(case.comparator, sensing, n) - star_s;
                    star_s + spots_s / f64::from(point.cycle())
                }
                (comparator, sensing) => frame_s(comparator, sensing, n),
            };
            let second_s = match (case.comparator, sensing) {
                (Comparator::Splash, Sensing::Images) => gate.core_s,
                _ => 0.0,
            };
            frames as f64 * (slices * scale * frame_s + second_s)
        };
        let loops = cases.iter().map(one);
        let detector = instrument.detector_side() as u64;
        // Phases; resampled rows of each layer above the ground; detector maps and frames.
        let arrays = 64 * samples * samples
            + 4 * instrument.atmosphere.layers.len() as u64
                * point.n() as u64
                * samples
                * 2
                * samples
            + match sensing {
                Sensing::Images => 80 * detector * detector,
                Sensing::Geometric => 0,
            };
        Ok(Self {
            core_s: DRAW_S * all as f64 + loops.sum::<f64>(),
            shared: BASE + SPECTRUM * all,
            each: DRAWING * largest + DRAWN * all + arrays + gate.each,
        })
    }

    /// That of a frame of a second gate.
    fn of_second_gate(point: &Point) -> Result<Self, Error> {
        let (instrument, pupil) = (point.instrument(), point.pupil());
        let images = point.conditions().sensing == Sensing::Images;
        let Some(gate) = instrument.gate()?.filter(|_| images) else { return Ok(Self::default()) };
        let scale = instrument.gate_pixels_per_lambda_d();
        let samples = gate.samples(pupil, scale, instrument.windows.size) as u64;
        let spots = pupil.subapertures().len() as u64;
        let side = instrument.detector_side() as u64;
        // Fields and their transforms; the slab's transfer functions, of each spot; the other half of the detector.
        let slab = if gate.slab.count() > 1 { spots * 2 * samples * samples * 8 } else { 0 };
        Ok(Self {
            core_s: spots as f64 * GATE_S * (samples as f64 / 80.0).powi(2),
            shared: 0,
            each: 7 * samples * samples * 8 + slab + 80 * side * side,
        })
    }
}

/// A frame with 8 samples per subaperture, s on one core: the time at N = 8 and the power of N with which it
/// grows, both measured at N = 8 and 32.
pub(crate) fn frame_s(comparator: Comparator, sensing: Sensing, n: f64) -> f64 {
    let (at_8, power) = match (comparator, sensing) {
        (Comparator::Fit, _) => (1.5e-4, 2.0),
        (Comparator::Splash, Sensing::Images) => (1.6e-3, 3.2),
        (Comparator::Splash, Sensing::Geometric) => (2.4e-4, 2.6),
        (_, Sensing::Images) => (5.5e-4, 2.4),
        (_, Sensing::Geometric) => (1.9e-4, 2.0),
    };
    at_8 * (n / 8.0_f64).powf(power)
}

/// Memory that is free to use, bytes; `None` where the system does not say.
pub fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes << 10)
}
