//! Calibration of an instrument over the link: darks, flats, reference slopes, pokes.
//!
//! ```text
//! dark = mean, noise = rms over frames without light      flat = (mean of even light - dark) / median
//! K    = sum (flat - dark) / sum (variance of flats - variance of darks)          electrons per ADU
//! c0   = mean centroid with the mirror flat               y = c - c0, px
//! u_j  = t (1 if the segment of spot j is poked, else 0) - t / M       M spots see no mean tilt
//! R_j  = - (sum y u^T) (sum u u^T)^-1                     px per m of wavefront, over all pokes
//! G_j  = R_j^-1                                           m of wavefront per px
//! quality = 1 - sum |y + R u|^2 / sum |y|^2               over each spot's own pokes
//! ```
//!
//! Each segment is tilted by itself, to both sides along both axes; the spot that moves most is its own.
//! The mirror is taken off the wavefront: a poke of t is a wavefront of -t. A window follows its segment:
//! the loaded windows are in the order of the segments whose spots are in them. The gains are those of a
//! bench: spots under turbulence are broader, and move a little less.
//!
//! With a second gate all of it is done for each, with pokes that fit its pixels; the rows behind the first gate's are a
//! detector of their own.

use super::light::Light;
use super::operator::{Operator, OperatorError};
use super::recording::Recording;
use crate::board::image;
use crate::calibration::{SlopeCalibration, determinant, over, paths_m_per_px};
use crate::error::{Error, refuse};
use crate::reconstructor::{PixelMaps, Reconstructor};
use splash_firmware::calibration::Step;
use splash_firmware::controller::Command;
use splash_firmware::fixed::CENTROID_BITS;
use splash_firmware::geometry::Mask;
use splash_firmware::link::Reason;
use splash_firmware::mode::{Mode, Refusal};
use splash_firmware::telemetry::Decimation;

/// How far a poke moves a spot, pixels: within the linear range of a spot two pixels wide.
const POKE_PX: f64 = 0.5;
/// Frames from a command to the first that shows its end: the one in which it comes, the one that has
/// the mirror move, and one with a peak to follow.
const SETTLE: u32 = 3;
/// The least share of the variance of the pokes that the gains must explain.
const QUALITY_MIN: f64 = 0.8;
/// A spot moves at least so many times more with its own segment than any other spot does.
const CONTRAST_MIN: f64 = 3.0;
/// A pixel with so many times the median noise carries no information.
const NOISE_MAX: f64 = 5.0;
/// A pixel answers light at least by this share of the median, and at most by its inverse.
const RESPONSE_MIN: f64 = 0.25;

/// What is not as a working instrument has it.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NotAsItShouldBe {
    /// Flats without light.
    #[error("calibration: flats: median signal = {adu} ADU: must be at least 1")]
    Flats {
        /// What they have above the darks.
        adu: f64,
    },
    /// A window without a spot.
    #[error("calibration: window {window}: flux = 0: must be above 0 with the mirror flat")]
    Unlit {
        /// Which, in the description's order, gate by gate.
        window: usize,
    },
    /// No spot moves with a segment as its own would.
    #[error(
        "calibration: segment {segment}: motion of spot {} = {} px: must be at least {CONTRAST_MIN} \
         times that of spot {}, {} px", spots[0], moved[0], spots[1], moved[1]
    )]
    Unclear {
        /// The segment.
        segment: usize,
        /// The windows of the two spots that move most.
        spots: [usize; 2],
        /// By how much, px.
        moved: [f64; 2],
    },
    /// A spot moves with two segments.
    #[error(
        "calibration: window {window}: its spot follows segments {} and {}: must be one", segments[0],
        segments[1]
    )]
    Shared {
        /// Which.
        window: usize,
        /// Both.
        segments: [usize; 2],
    },
    /// The gains do not explain the pokes.
    #[error(
        "calibration: quality = {quality}: must be at least {QUALITY_MIN} of the pokes' variance"
    )]
    Quality {
        /// What they explain.
        quality: f64,
    },
}

impl From<NotAsItShouldBe> for Error {
    fn from(found: NotAsItShouldBe) -> Self {
        Self::Run(found.to_string())
    }
}

/// How much is averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Frames for darks, and for flats: at least 2.
    pub frames: u32,
    /// Frames for each position of the mirror: at least 1.
    pub averaged: u32,
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibrated {
    /// Hash of the configuration that runs with it.
    pub hash: u32,
    /// Detector pixels in use no more.
    pub bad_pixels: usize,
    /// Median dark level and noise of the pixels, ADU.
    pub dark_adu: f64,
    /// See there.
    pub noise_adu: f64,
    /// Electrons per ADU, by photon transfer.
    pub gain_e_per_adu: f64,
    /// One a gate.
    pub gates: Vec<CalibratedGate>,
}

/// What was found of the spots behind a gate.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibratedGate {
    /// For each segment, the gate's window (in the description's order) that its spot is in.
    pub windows: Vec<usize>,
    /// That arrangement as a quarter turn and a reflection of the pupil, if it is one: degrees from +x
    /// towards +y, after x was reflected if so.
    pub arrangement: Option<(u16, bool)>,
    /// Mean rotation of the spots' motion, degrees from +x towards +y, after x was reflected if so.
    pub rotation_deg: f64,
    /// Whether the motion is reflected.
    pub reflected: bool,
    /// Spots' motion per motion of an ideal spot, mean.
    pub centroid_gain: f64,
    /// Rms of a centroid from frame to frame, px.
    pub noise_px: f64,
    /// Rms motion of spots by pistons of a quarter wavelength, px; an ideal sensor has none.
    pub piston_px: f64,
    /// Share of the variance of the pokes that the gains explain.
    pub quality: f64,
}

/// Calibrates what `reconstructor` is for, with each of its gates, loads the result and leaves the board in standby.
/// `progress` is told what is being done, and the fraction of it that is.
///
/// # Errors
/// [`Error::Run`] for what is not as a working instrument has it, and errors of the board.
pub fn calibrate(
    operator: &mut Operator,
    reconstructor: Reconstructor,
    effort: Effort,
    progress: &mut dyn FnMut(&'static str, f64),
) -> Result<Calibrated, Error> {
    let count = reconstructor.mask().count();
    if count < 2 {
        return Err(refuse("pupil.subapertures", count, "at least 2: one has no tilt of its own"));
    }
    let (pixels, gain_e_per_adu) = pixels(operator, &reconstructor, effort.frames, progress)?;
    let (dark_adu, noise_adu) = (median(&pixels.dark_adu), median(&pixels.noise_adu));
    let bad_pixels = pixels.bad.len();
    let mut reconstructor = reconstructor.with_pixels(pixels);
    operator
        .upload(&image(&reconstructor.spec(), &[], 0)?, &mut |done| progress("upload", done))?;

    operator.set_light(Light::Bench)?;
    to_calibrate(operator)?;
    let bench = Bench::new(operator, &reconstructor, effort.averaged)?;
    let origins = [Some(reconstructor.origins()), reconstructor.second_origins()];
    let origins: Vec<_> = origins.into_iter().flatten().map(<[_]>::to_vec).collect();
    let found = bench.gates(origins.len(), progress)?;
    let mut gates = Vec::new();
    for (gate, (Pokes { references, windows, tilts, noise_px, piston_px, poke_m }, origins)) in
        found.into_iter().zip(origins).enumerate()
    {
        let gains = fit(&windows, &tilts, poke_m)?;
        let origins = windows.iter().map(|&j| origins[j]).collect();
        let slopes = SlopeCalibration {
            reference_px: windows.iter().map(|&j| references[j]).collect(),
            gain_m_per_px: gains.responses.iter().map(|response| over(1.0, *response)).collect(),
        };
        let path_m = paths_m_per_px(&reconstructor)[gate];
        let (rotation_deg, reflected, response) = mean_motion(&gains.responses);
        gates.push(CalibratedGate {
            arrangement: arrangement(reconstructor.mask(), &windows),
            windows,
            rotation_deg,
            reflected,
            centroid_gain: response * path_m,
            noise_px,
            piston_px,
            quality: gains.quality,
        });
        reconstructor = match gate {
            0 => reconstructor.with_origins(origins).with_slopes(slopes),
            _ => reconstructor.with_second_origins(origins).with_second_slopes(slopes),
        };
    }
    let quality = gates.iter().map(|gate| gate.quality).fold(1.0, f64::min);
    let quality_q16 = (quality * 65535.0).round() as u16;
    let image = image(&reconstructor.spec(), &Step::ALL, quality_q16)?;
    let hash = operator.upload(&image, &mut |done| progress("upload", done))?;
    // The board's own word that it fits.
    operator.calibration()?;
    operator.enter(Mode::Standby)?;
    Ok(Calibrated { hash, bad_pixels, dark_adu, noise_adu, gain_e_per_adu, gates })
}

/// Sum and sum of squares of every pixel.
struct Moments {
    frames: f64,
    sum: Vec<f64>,
    squares: Vec<f64>,
}

impl Moments {
    fn of(
        operator: &mut Operator,
        frames: u32,
        [width, height]: [usize; 2],
        progress: &mut dyn FnMut(f64),
    ) -> Result<Self, OperatorError> {
        let zeros = || vec![0.0; width * height];
        let mut moments = Self { frames: frames.into(), sum: zeros(), squares: zeros() };
        let mut done = 0.0;
        operator.raw_frames(frames, [width, height], &mut |pixels| {
            for ((sum, square), &pixel) in
                moments.sum.iter_mut().zip(&mut moments.squares).zip(pixels)
            {
                let pixel = f64::from(pixel);
                *sum += pixel;
                *square += pixel * pixel;
            }
            done += 1.0;
            progress(done / moments.frames);
        })?;
        Ok(moments)
    }

    fn means(&self) -> Vec<f64> {
        self.sum.iter().map(|sum| sum / self.frames).collect()
    }

    /// Variances over the frames, unbiased.
    fn variances(&self) -> Vec<f64> {
        let moments = self.sum.iter().zip(&self.squares);
        moments
            .map(|(sum, square)| {
                ((square - sum * sum / self.frames) / (self.frames - 1.0)).max(0.0)
            })
            .collect()
    }
}

/// Darks and flats: the maps of the pixels, and electrons per ADU.
fn pixels(
    operator: &mut Operator,
    reconstructor: &Reconstructor,
    frames: u32,
    progress: &mut dyn FnMut(&'static str, f64),
) -> Result<(PixelMaps, f64), Error> {
    let spec = reconstructor.detector().spec();
    let size = [spec.width, spec.height];
    operator.disarm()?;
    operator.set_light(Light::Dark)?;
    let dark = Moments::of(operator, frames, size, &mut |done| progress("darks", done))?;
    operator.set_light(Light::Even)?;
    let even = Moments::of(operator, frames, size, &mut |done| progress("flats", done))?;

    let (dark_adu, dark_variance) = (dark.means(), dark.variances());
    let (even_adu, even_variance) = (even.means(), even.variances());
    let signal: Vec<f64> = even_adu.iter().zip(&dark_adu).map(|(even, dark)| even - dark).collect();
    // A pixel that never changes has the noise of its rounding.
    let noise_adu: Vec<f64> = dark_variance.iter().map(|v| v.max(1.0 / 12.0).sqrt()).collect();
    let top = f64::from((1u32 << spec.bits) - 1);
    let mut maps = PixelMaps { gain: Vec::new(), dark_adu, noise_adu, bad: Vec::new() };
    let (mut light, mut variance) = (0.0, 0.0);
    // Each gate has a detector of its own, which answers its own light.
    let of_gate = spec.width * reconstructor.instrument().detector_side();
    for start in (0..signal.len()).step_by(of_gate) {
        let gate = start..(start + of_gate).min(signal.len());
        let usual = median(&signal[gate.clone()]);
        let usual_noise = median(&maps.noise_adu[gate.clone()]);
        if usual.is_nan() || usual < 1.0 {
            return Err(NotAsItShouldBe::Flats { adu: usual }.into());
        }
        for i in gate {
            let response = signal[i] / usual;
            maps.gain.push(1.0 / response);
            if !(RESPONSE_MIN..=1.0 / RESPONSE_MIN).contains(&response)
                || even_adu[i] >= top
                || maps.noise_adu[i] > NOISE_MAX * usual_noise
            {
                maps.bad.push([i % spec.width, i / spec.width].map(|i| i as u16));
                continue;
            }
            light += signal[i];
            variance += even_variance[i] - dark_variance[i];
        }
    }
    Ok((maps, light / variance))
}

/// The mode in which segments go where they are told: from safe by way of standby.
fn to_calibrate(operator: &mut Operator) -> Result<(), OperatorError> {
    // A mirror on its way to flat gets there at the slew limit.
    for _ in 0..crate::link::operator::RAMP_FRAMES {
        match operator.enter(Mode::Standby) {
            Err(OperatorError::Refused { reason: Reason::Mode(Refusal::NotFlat), .. }) => {
                operator.wait_for_frames(1)?;
            }
            other => {
                other?;
                break;
            }
        }
    }
    operator.arm()?;
    operator.enter(Mode::Calibrate)
}

/// A board whose segments are poked.
struct Bench<'a> {
    operator: &'a mut Operator,
    averaged: u32,
    settle: u32,
    /// Segments, and windows of a gate.
    count: usize,
    /// Of each gate.
    pokes_m: Vec<f64>,
    piston_m: f64,
}

/// Centroids' motions by the tilts of the segments, px.
#[derive(Default)]
struct Tilts {
    /// For each segment, axis and side: of every spot.
    motions: Vec<[[Vec<[f64; 2]>; 2]; 2]>,
}

/// What the pokes showed of a gate.
struct Pokes {
    references: Vec<[f64; 2]>,
    windows: Vec<usize>,
    tilts: Tilts,
    noise_px: f64,
    piston_px: f64,
    poke_m: f64,
}

impl<'a> Bench<'a> {
    fn new(
        operator: &'a mut Operator,
        reconstructor: &Reconstructor,
        averaged: u32,
    ) -> Result<Self, OperatorError> {
        // As often as suits the link, if it is not a pipe.
        let every = if operator.is_emulated() { 1 } else { operator.subscribe(None)?.fluxes };
        let decimation = Decimation { fluxes: every.max(1), ..Decimation::OFF };
        operator.subscribe(Some(decimation))?;
        let instrument = reconstructor.instrument();
        let paths_m = paths_m_per_px(reconstructor);
        let pokes_m: Vec<f64> = paths_m.into_iter().map(|path_m| POKE_PX * path_m).collect();
        let piston_m = instrument.laser.wavelength_m / 4.0;
        // From one side to the other an actuator goes no further than twice the sum of both tilts.
        let longest_m = pokes_m.iter().copied().fold(piston_m, f64::max);
        let settle = SETTLE + (4.0 * longest_m / instrument.mirror.slew_m_per_frame).ceil() as u32;
        let count = reconstructor.mask().count();
        Ok(Self { operator, averaged, settle, count, pokes_m, piston_m })
    }

    /// What the pokes show of so many gates; whatever is found, nothing is left tilted.
    fn gates(
        mut self,
        gates: usize,
        progress: &mut dyn FnMut(&'static str, f64),
    ) -> Result<Vec<Pokes>, Error> {
        let found = (0..gates).map(|gate| self.pokes(gate, progress)).collect();
        self.operator.subscribe(Some(Decimation::OFF))?;
        self.operator.command("when the mirror was to be flat", Command::Flat)?;
        self.operator.wait_for_frames(self.settle)?;
        found
    }

    /// Mean centroids of a gate with the mirror as it was told to be, px, and their variance from frame
    /// to frame.
    fn centroids(&mut self, gate: usize) -> Result<(Vec<[f64; 2]>, f64), Error> {
        let told = self.operator.status()?.at.frame;
        let first = gate * self.count;
        let mut recording = Recording::new(self.count, self.pokes_m.len() * self.count);
        let (mut sums, mut squares) = (vec![[0.0; 2]; self.count], 0.0);
        let (mut taken, mut last) = (0, None);
        let px = 1.0 / f64::from(1u32 << CENTROID_BITS);
        while taken < self.averaged {
            for record in self.operator.listen()? {
                recording.take(record);
                let Some((frame, measurements)) = recording.measurements() else { continue };
                // Modulo 2^32, as frames are counted.
                if last == Some(frame)
                    || frame.wrapping_sub(told).wrapping_sub(self.settle) > i32::MAX as u32
                {
                    continue;
                }
                last = Some(frame);
                for (j, (sum, measurement)) in
                    sums.iter_mut().zip(&measurements[first..]).enumerate()
                {
                    if measurement.flux == 0 {
                        return Err(NotAsItShouldBe::Unlit { window: first + j }.into());
                    }
                    for (sum, q16) in sum.iter_mut().zip(measurement.centroid_q16) {
                        let centroid = f64::from(q16) * px;
                        *sum += centroid;
                        squares += centroid * centroid;
                    }
                }
                taken += 1;
            }
            recording.forget();
        }
        let n = f64::from(taken);
        sums.as_flattened_mut().iter_mut().for_each(|sum| *sum /= n);
        let of_means: f64 = sums.as_flattened().iter().map(|mean| n * mean * mean).sum();
        let freedom = (n - 1.0).max(1.0) * 2.0 * self.count as f64;
        Ok((sums, ((squares - of_means) / freedom).max(0.0)))
    }

    /// Where a gate's spots are with segment `i` there and all others flat.
    fn poked(
        &mut self,
        gate: usize,
        i: usize,
        position_m: [f64; 3],
    ) -> Result<Vec<[f64; 2]>, Error> {
        self.operator.command("when the mirror was to be flat", Command::Flat)?;
        self.operator.poke(i as u16, position_m)?;
        Ok(self.centroids(gate)?.0)
    }

    fn pokes(
        &mut self,
        gate: usize,
        progress: &mut dyn FnMut(&'static str, f64),
    ) -> Result<Pokes, Error> {
        let [references_name, pokes_name] =
            [["references", "pokes"], ["references, second gate", "pokes, second gate"]][gate];
        progress(references_name, 0.0);
        self.operator.command("when the mirror was to be flat", Command::Flat)?;
        let (references, variance) = self.centroids(gate)?;
        let from_reference = |spots: Vec<[f64; 2]>| -> Vec<[f64; 2]> {
            let pairs = spots.iter().zip(&references);
            pairs
                .map(|(spot, reference)| [spot[0] - reference[0], spot[1] - reference[1]])
                .collect()
        };
        let first = gate * self.count;
        let poke_m = self.pokes_m[gate];
        let (mut tilts, mut windows) = (Tilts::default(), Vec::new());
        let mut piston_square = 0.0;
        for i in 0..self.count {
            progress(pokes_name, i as f64 / self.count as f64);
            let mut motions = <[[Vec<[f64; 2]>; 2]; 2]>::default();
            for (axis, sides) in motions.iter_mut().enumerate() {
                for (side, motion) in [1.0, -1.0].into_iter().zip(sides) {
                    let mut position_m = [0.0; 3];
                    position_m[axis + 1] = side * poke_m;
                    *motion = from_reference(self.poked(gate, i, position_m)?);
                }
            }
            windows.push(follower(i, first, &motions)?);
            let piston = from_reference(self.poked(gate, i, [self.piston_m, 0.0, 0.0])?);
            piston_square += square(piston.as_flattened());
            tilts.motions.push(motions);
        }
        let mut seen = vec![None; self.count];
        for (i, &j) in windows.iter().enumerate() {
            if let Some(other) = seen[j].replace(i) {
                let (window, segments) = (first + j, [other, i]);
                return Err(NotAsItShouldBe::Shared { window, segments }.into());
            }
        }
        let pistons = (self.count * self.count) as f64;
        let (noise_px, piston_px) = (variance.sqrt(), (piston_square / pistons).sqrt());
        Ok(Pokes { references, windows, tilts, noise_px, piston_px, poke_m })
    }
}

fn square(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum()
}

/// The spot that moves most with segment `i`; the gate's windows count from `first` on.
fn follower(i: usize, first: usize, [x, y]: &[[Vec<[f64; 2]>; 2]; 2]) -> Result<usize, Error> {
    let moved = |j: usize| {
        let along = |[plus, minus]: &[Vec<[f64; 2]>; 2]| {
            square(&[plus[j][0] - minus[j][0], plus[j][1] - minus[j][1]])
        };
        (along(x) + along(y)).sqrt()
    };
    let mut order: Vec<(f64, usize)> = (0..x[0].len()).map(|j| (moved(j), j)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    match order[..] {
        [(most, j), (next, _), ..] if most >= CONTRAST_MIN * next => Ok(j),
        [(most, spot), (next, other), ..] => {
            let (segment, moved) = (i, [most, next]);
            let spots = [first + spot, first + other];
            Err(NotAsItShouldBe::Unclear { segment, spots, moved }.into())
        }
        _ => Err(NotAsItShouldBe::Unlit { window: first + i }.into()),
    }
}

/// What the pokes say of the spots.
struct Gains {
    /// For each segment: px per m of wavefront, rows x and y, columns tip and tilt.
    responses: Vec<[[f64; 2]; 2]>,
    quality: f64,
}

/// Fits every spot's response to all pokes.
fn fit(windows: &[usize], tilts: &Tilts, poke_m: f64) -> Result<Gains, Error> {
    let count = windows.len();
    let mean = 1.0 / count as f64;
    // Pokes are along one axis, to both sides: sum u u^T is the same for both, and diagonal.
    let own = (1.0 - mean).powi(2) + (count as f64 - 1.0) * mean * mean;
    let u_square = 2.0 * poke_m * poke_m * own;
    let mut responses = Vec::with_capacity(count);
    let (mut left, mut all) = (0.0, 0.0);
    for (segment, &spot) in windows.iter().enumerate() {
        let seen = |i: usize, side: f64| side * poke_m * (f64::from(i == segment) - mean);
        let each = || {
            tilts.motions.iter().enumerate().flat_map(move |(i, axes)| {
                axes.iter().enumerate().flat_map(move |(axis, sides)| {
                    let both = [1.0, -1.0].into_iter().zip(sides);
                    both.map(move |(side, motion)| (axis, seen(i, side), motion[spot]))
                })
            })
        };
        let mut response = [[0.0; 2]; 2];
        for (axis, u, [x, y]) in each() {
            response[0][axis] -= x * u / u_square;
            response[1][axis] -= y * u / u_square;
        }
        // Of its own pokes: what is explained of the others' is little, and noise is not.
        for (axis, sides) in tilts.motions[segment].iter().enumerate() {
            for (side, motion) in [1.0, -1.0].into_iter().zip(sides) {
                let ([x, y], u) = (motion[spot], seen(segment, side));
                left += square(&[x + response[0][axis] * u, y + response[1][axis] * u]);
                all += square(&[x, y]);
            }
        }
        responses.push(response);
    }
    let quality = 1.0 - left / all;
    if quality.is_nan() || quality < QUALITY_MIN {
        return Err(NotAsItShouldBe::Quality { quality }.into());
    }
    Ok(Gains { responses, quality })
}

/// Mean rotation, degrees; whether there is a reflection of x before it; and mean scale.
fn mean_motion(responses: &[[[f64; 2]; 2]]) -> (f64, bool, f64) {
    let n = responses.len() as f64;
    let mut mean = [[0.0; 2]; 2];
    for response in responses {
        let entries = mean.as_flattened_mut().iter_mut().zip(response.as_flattened());
        entries.for_each(|(mean, entry)| *mean += entry / n);
    }
    let [[a, b], [c, d]] = mean;
    let reflected = determinant(mean) < 0.0;
    let angle = if reflected { (-c - b).atan2(d - a) } else { (c - b).atan2(a + d) };
    (angle.to_degrees(), reflected, determinant(mean).abs().sqrt())
}

/// The quarter turn, after a reflection of x, of the pupil that takes each segment to its window.
fn arrangement(mask: &Mask, windows: &[usize]) -> Option<(u16, bool)> {
    let cells: Vec<(usize, usize)> = mask.cells().collect();
    let last = mask.across() - 1;
    let turned = |(x, y): (usize, usize), turns: u16, reflected: bool| {
        let start = if reflected { (last - x, y) } else { (x, y) };
        // A quarter turn takes +x to +y.
        (0..turns).fold(start, |(x, y), _| (last - y, x))
    };
    let all = [false, true].into_iter().flat_map(|reflected| (0..4).map(move |t| (t, reflected)));
    let fits = |&(turns, reflected): &(u16, bool)| {
        cells
            .iter()
            .zip(windows)
            .all(|(&cell, &j)| cells.get(j) == Some(&turned(cell, turns, reflected)))
    };
    all.into_iter().find(fits).map(|(turns, reflected)| (90 * turns, reflected))
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}
