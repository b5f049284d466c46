//! Slope calibration: what an instrument's team measures before it closes the loop for good.
//!
//! The centroid of a real estimator moves by less than the spot: the window cuts the wings and the
//! threshold what is faint. So, through the firmware's own centroids and without noise:
//!
//! 1. On the bench, with a flat wavefront: reference slopes are the centroids of the flat mirror,
//!    and the 2 x 2 gain of a subaperture is the inverse of how far its centroid moves when its
//!    segment tilts.
//! 2. On the sky, with the loop closed on a frozen atmosphere: the same pokes, as a dither on top
//!    of the correction. Spots are broader there and lose more; one factor for all makes up for it.

use crate::atmosphere::Atmosphere;
use crate::board::{Board, Frame, in_process};
use crate::closed_loop::{ClosedLoop, Run, Sensing};
use crate::error::Error;
use crate::imager::Imager;
use crate::instrument::Instrument;
use crate::optics::geometric::Sensor;
use crate::pupil::{Mirror, Pupil};
use crate::reconstructor::Reconstructor;
use splash_firmware::centroid::Measurement;
use splash_firmware::fixed::CENTROID_BITS;

/// How far a poke moves a spot, pixels: well within the linear range of a spot two pixels wide.
const POKE_PX: f64 = 0.25;
/// Frames that the loop gets to settle before the dither; cycles, with a schedule.
const SETTLE: u32 = 20;
/// Spots over which the sky's factor is averaged at least, with as many skies as that takes.
const SPOTS: usize = 200;
/// Seed of the first of these skies: the calibration is the same in every run.
const SKY_SEED: u64 = 0x5eed_ca11;
/// The sky's factor stays within this and its inverse: beyond, the loop had not closed.
const MOST: f64 = 2.0;

/// Reference slopes and gains, one a subaperture in mask order.
#[derive(Clone, Debug, PartialEq)]
pub struct SlopeCalibration {
    /// Centroid of the flat wavefront from the window's centre, pixels.
    pub reference_px: Vec<[f64; 2]>,
    /// Centre-to-edge optical path per pixel of centroid, m: rows tip and tilt, columns x and y.
    pub gain_m_per_px: Vec<[[f64; 2]; 2]>,
}

impl SlopeCalibration {
    /// That of a sensor which measures mean gradients: a pixel is lambda / (p d) on the sky, and
    /// half a subaperture turns it into a path of lambda / (2 p).
    pub fn ideal(instrument: &Instrument, subapertures: usize) -> Self {
        Self::uniform(path_m_per_px(instrument), subapertures)
    }

    /// The same of the second gate.
    pub fn ideal_at_gate(instrument: &Instrument, subapertures: usize) -> Self {
        Self::uniform(gate_path_m_per_px(instrument), subapertures)
    }

    fn uniform(path_m: f64, subapertures: usize) -> Self {
        Self {
            reference_px: vec![[0.0; 2]; subapertures],
            gain_m_per_px: vec![[[path_m, 0.0], [0.0, path_m]]; subapertures],
        }
    }

    /// That of SPLASH's images: [`SlopeCalibration::of`].
    ///
    /// # Errors
    /// As there.
    pub fn measure(instrument: &Instrument, progress: &mut dyn FnMut(f64)) -> Result<Self, Error> {
        Self::of(Sensor::Splash, instrument, progress)
    }

    /// Cycles that are run under each sky.
    pub(crate) const CYCLES: u32 = SETTLE + 4;

    /// Skies under which so many subapertures are calibrated.
    pub(crate) const fn skies(subapertures: usize) -> usize {
        SPOTS.div_ceil(subapertures)
    }

    /// Measures that of `sensor`'s images at the first gate; `progress` is told the fraction done.
    ///
    /// # Errors
    /// As [`calibrated`].
    pub fn of(
        sensor: Sensor,
        instrument: &Instrument,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Self, Error> {
        let reconstructor = calibrated(sensor, Reconstructor::new(instrument)?, progress)?;
        Ok(reconstructor.slopes().clone())
    }
}

/// A reconstructor with reference slopes and gains as `sensor`'s images have them, at each of its gates; `progress` is
/// told the fraction done.
///
/// # Errors
/// [`Error::Config`] for an instrument that the optics or the firmware refuse; [`Error::Uncalibrated`] for one whose
/// spots do not follow their segments: too faint, or windows too small.
pub fn calibrated(
    sensor: Sensor,
    reconstructor: Reconstructor,
    progress: &mut dyn FnMut(f64),
) -> Result<Reconstructor, Error> {
    let subapertures = reconstructor.mask().count();
    if subapertures == 1 {
        // Its tilt is the global tilt, which is not the sensor's to correct.
        return Ok(reconstructor);
    }
    let mut slopes = on_bench(sensor, &reconstructor)?;
    let on_bench = with_slopes(reconstructor, &slopes);
    let skies = SlopeCalibration::skies(subapertures);
    let mut sums = vec![[0.0; 2]; slopes.len()];
    for sky in 0..skies {
        let seed = SKY_SEED + sky as u64;
        let seen = on_sky(sensor, &on_bench, seed, &mut |done| {
            progress((sky as f64 + done) / skies as f64);
        })?;
        for (sum, seen) in sums.iter_mut().zip(seen) {
            *sum = [sum[0] + seen[0], sum[1] + seen[1]];
        }
    }
    for (slopes, [moved, square]) in slopes.iter_mut().zip(sums) {
        let factor = (square / moved).clamp(1.0 / MOST, MOST);
        let gains = slopes.gain_m_per_px.iter_mut().flatten().flatten();
        gains.for_each(|gain| *gain *= factor);
    }
    Ok(with_slopes(on_bench, &slopes))
}

/// With the slopes of each gate.
fn with_slopes(reconstructor: Reconstructor, slopes: &[SlopeCalibration]) -> Reconstructor {
    let [first, second @ ..] = slopes else { return reconstructor };
    let reconstructor = reconstructor.with_slopes(first.clone());
    second.iter().cloned().fold(reconstructor, Reconstructor::with_second_slopes)
}

/// Reference slopes and gains with a flat wavefront, of each gate.
fn on_bench(sensor: Sensor, reconstructor: &Reconstructor) -> Result<Vec<SlopeCalibration>, Error> {
    let diameter_m = reconstructor.instrument().pupil()?.diameter_m();
    let sky = Atmosphere::from_screens(Vec::new(), diameter_m, 0.0)?;
    let mut bench = Bench::new(sensor, reconstructor, &sky)?;
    let flat = Mirror::flat(bench.pupil.subapertures().len());
    let references = bench.centroids(&flat)?;
    let pokes = bench.pokes();
    let one_gate = |(gate, reference_px): (usize, Vec<[f64; 2]>)| {
        let columns = bench.dither(gate, &flat, &mut |_| ())?;
        let mut gain_m_per_px = Vec::with_capacity(pokes.len());
        for (i, poke) in pokes.iter().enumerate() {
            let response = |axis: usize, poked: usize| columns[poked][i][axis] / (2.0 * poke);
            let response = [[response(0, 0), response(0, 1)], [response(1, 0), response(1, 1)]];
            let determinant = determinant(response);
            // A spot that moves by less than a third of its segment's tilt is no measurement.
            if !(determinant.abs() > 0.1 && determinant.is_finite()) {
                let light = ["laser.electrons_per_spot", "second_gate.electrons_per_spot"][gate];
                return Err(Error::Uncalibrated(format!(
                    "calibration of subaperture {i}: determinant of the spot's response to its \
                     segment = {determinant}: must be above 0.1; check windows.size, {light} and the \
                     detector's range"
                )));
            }
            gain_m_per_px.push(over(bench.paths_m_per_px[gate], response));
        }
        Ok(SlopeCalibration { reference_px, gain_m_per_px })
    };
    references.into_iter().enumerate().map(one_gate).collect()
}

/// Closes the loop on a frozen sky and dithers: for each gate the sums, over all spots and both axes, of seen motion
/// times true motion and of true motion squared, pixels^2, in units of the reconstructor's calibration.
fn on_sky(
    sensor: Sensor,
    reconstructor: &Reconstructor,
    seed: u64,
    progress: &mut dyn FnMut(f64),
) -> Result<Vec<[f64; 2]>, Error> {
    let reconstructor = reconstructor.clone().without_delay();
    let frozen = reconstructor.instrument().clone().frozen();
    let mut board = in_process(&reconstructor.spec())?;
    let frames = SETTLE * reconstructor.lighting().count();
    let run = Run { sensor, sensing: Sensing::Images, frames, seed, noise_free: true };
    let mut closed = ClosedLoop::new(&frozen, &reconstructor, board.as_mut(), run, &mut |_| ())?;
    for frame in 0..frames {
        progress(f64::from(frame) / f64::from(frames + 4));
        closed.step()?;
    }
    let mut bench = Bench::new(sensor, &reconstructor, closed.atmosphere())?;
    let settled = f64::from(frames);
    let calibrations = [Some(reconstructor.slopes()), reconstructor.second_slopes()];
    let one_gate = |(gate, slopes): (usize, &SlopeCalibration)| {
        let columns = bench.dither(gate, closed.mirror(), &mut |done| {
            progress((settled + 4.0 * done) / (settled + 4.0));
        })?;
        let (mut moved, mut square) = (0.0, 0.0);
        for (axis, motions) in columns.iter().enumerate() {
            let pokes = bench.pokes();
            for ((motion, poke), gain) in motions.iter().zip(pokes).zip(&slopes.gain_m_per_px) {
                let [gx, gy] = gain[axis];
                let seen = (gx * motion[0] + gy * motion[1]) / bench.paths_m_per_px[gate];
                moved += 2.0 * poke * seen;
                square += (2.0 * poke).powi(2);
            }
        }
        Ok([moved, square])
    };
    calibrations.into_iter().flatten().enumerate().map(one_gate).collect()
}

/// Centre-to-edge optical path of a tilt that moves a spot by one pixel, m.
fn path_m_per_px(instrument: &Instrument) -> f64 {
    instrument.laser.wavelength_m / (2.0 * instrument.windows.pixels_per_lambda_d)
}

/// The same at each gate of a reconstructor.
pub(crate) fn paths_m_per_px(reconstructor: &Reconstructor) -> Vec<f64> {
    let instrument = reconstructor.instrument();
    let second = reconstructor.law().map(|_| gate_path_m_per_px(instrument));
    [Some(path_m_per_px(instrument)), second].into_iter().flatten().collect()
}

/// The same at the second gate.
fn gate_path_m_per_px(instrument: &Instrument) -> f64 {
    instrument.laser.wavelength_m / (2.0 * instrument.gate_pixels_per_lambda_d())
}

/// The determinant of a matrix.
pub(crate) fn determinant([[a, b], [c, d]]: [[f64; 2]; 2]) -> f64 {
    a * d - b * c
}

/// `value` times the inverse of a matrix.
pub(crate) fn over(value: f64, matrix: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let [[a, b], [c, d]] = matrix;
    let scale = value / determinant(matrix);
    [[d * scale, -b * scale], [-c * scale, a * scale]]
}

/// The instrument under a sky that stands still, without noise.
struct Bench<'a> {
    sensor: Sensor,
    pupil: Pupil,
    sky: &'a Atmosphere,
    imager: Imager,
    board: Box<dyn Board + Send>,
    /// Frames of a cycle.
    frames: u32,
    /// Of each gate.
    paths_m_per_px: Vec<f64>,
    rad_per_m: f64,
}

impl<'a> Bench<'a> {
    fn new(
        sensor: Sensor,
        reconstructor: &Reconstructor,
        sky: &'a Atmosphere,
    ) -> Result<Self, Error> {
        let instrument = reconstructor.instrument();
        let pupil = instrument.pupil()?;
        let imager = Imager::new(reconstructor, sensor, &pupil, sky)?;
        let board = in_process(&reconstructor.spec())?;
        Ok(Self {
            sensor,
            pupil,
            sky,
            imager,
            board,
            frames: reconstructor.lighting().count(),
            paths_m_per_px: paths_m_per_px(reconstructor),
            rad_per_m: instrument.rad_per_m(),
        })
    }

    /// The poke that each spot shows, pixels of its gate: SPLASH does not see their mean.
    fn pokes(&self) -> Vec<f64> {
        let mut pokes: Vec<f64> = self.signs().map(|sign| POKE_PX * sign).collect();
        if self.sensor == Sensor::Splash {
            let mean = pokes.iter().sum::<f64>() / pokes.len() as f64;
            pokes.iter_mut().for_each(|poke| *poke -= mean);
        }
        pokes
    }

    /// One segment up, the next one down.
    fn signs(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.pupil.subapertures().len()).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 })
    }

    /// How far each centroid of a gate moves, pixels, from minus the pokes to plus the pokes: for pokes
    /// along x, and along y.
    fn dither(
        &mut self,
        gate: usize,
        shape: &Mirror,
        progress: &mut dyn FnMut(f64),
    ) -> Result<[Vec<[f64; 2]>; 2], Error> {
        let poke_rad = POKE_PX * self.paths_m_per_px[gate] * self.rad_per_m;
        let mut moved = [Vec::new(), Vec::new()];
        for (axis, moved) in moved.iter_mut().enumerate() {
            let mut seen = Vec::new();
            for side in [1.0, -1.0] {
                progress((axis as f64 + (1.0 - side) / 4.0) / 2.0);
                let mut poked = shape.clone();
                for (segment, sign) in poked.segments.iter_mut().zip(self.signs()) {
                    // A mirror's shape is taken off the wavefront.
                    segment[axis + 1] -= side * sign * poke_rad;
                }
                seen.push(self.centroids(&poked)?.swap_remove(gate));
            }
            let pairs = seen[0].iter().zip(&seen[1]);
            *moved = pairs.map(|(plus, minus)| [plus[0] - minus[0], plus[1] - minus[1]]).collect();
        }
        Ok(moved)
    }

    /// The centroids with the mirror in this shape, pixels, of each gate.
    fn centroids(&mut self, mirror: &Mirror) -> Result<Vec<Vec<[f64; 2]>>, Error> {
        let mut cycle = Vec::new();
        for frame in 0..self.frames {
            self.imager.light(frame);
            cycle.push(self.imager.expose(self.sky, 0.0, mirror, None)?.to_vec());
        }
        self.board.reset()?;
        // The moving threshold and the weight follow the frame before.
        for (frame, pixels) in (0..).zip(std::iter::repeat_n(&cycle, 3).flatten()) {
            self.board.frame(frame, Frame::Pixels(pixels))?;
        }
        let px = 1.0 / f64::from(1u32 << CENTROID_BITS);
        let centroid = |q16: [i32; 2]| q16.map(|c| f64::from(c) * px);
        let gates = [self.board.measurements(), self.board.second_measurements()];
        let of = |seen: &[Measurement]| seen.iter().map(|m| centroid(m.centroid_q16)).collect();
        Ok(gates.into_iter().take(self.paths_m_per_px.len()).map(of).collect())
    }
}
