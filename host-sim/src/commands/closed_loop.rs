//! `host-sim loop`: the closed loop, its numbers and its pictures.

use super::{output, progress};
use crate::cli::LoopArgs;
use crate::closed_loop::{ClosedLoop, Run, Sensing};
use crate::error::{Error, refuse};
use crate::figures::{self, WindowMark};
use crate::files::csv::SeriesWriter;
use crate::files::fits::{CubeWriter, FitsWriter, Header};
use crate::instrument::Instrument;
use crate::optics::long_exposure::LongExposure;
use crate::reconstructor::Reconstructor;
use crate::summary::{CodeDigest, Series, faults};
use serde::Serialize;
use splash_firmware::centroid::Measurement;
use splash_firmware::fixed::CENTROID_BITS;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

/// Frames left out of the averages unless told otherwise, cycles with a schedule: at a gain of 0.5 the loop has
/// settled.
const SETTLE: u32 = 50;
/// Arcseconds in a radian.
const ARCSEC: f64 = 180.0 * 3600.0 / std::f64::consts::PI;

/// The JSON of `host-sim loop`.
#[derive(Debug, Serialize)]
struct LoopResult {
    n: usize,
    sensor: &'static str,
    board: &'static str,
    frames: u32,
    strehl: f64,
    strehl_se: f64,
    variance_rad2: f64,
    frames_per_second: f64,
    digest: String,
    faults: BTreeMap<&'static str, u32>,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &LoopArgs) -> Result<(), Error> {
    let sensor = args.sensor.sensor();
    let instrument = args.run.instrument()?.seen_by(sensor).with_lever_arm_of(sensor)?;
    let reconstructor = Reconstructor::new(&instrument)?;
    let cycle = reconstructor.lighting().count();
    let settle = args.settle.unwrap_or((SETTLE * cycle).min(args.run.frames / 2));
    if settle >= args.run.frames {
        let limit = format!("less than --frames = {}", args.run.frames);
        return Err(refuse("--settle", settle, &limit));
    }
    let reconstructor = progress::combine_gates(reconstructor)?;
    let reconstructor = match args.sensing {
        Sensing::Images => progress::calibrate(sensor, reconstructor)?,
        Sensing::Geometric => reconstructor,
    };
    let options = args.patience.options(false);
    let mut board = args.board.open(&reconstructor.spec(), options)?;
    let run = Run {
        sensor,
        sensing: args.sensing,
        frames: args.run.frames,
        seed: args.run.seed,
        noise_free: args.run.noise_free,
    };
    let mut closed = progress::close(&instrument, &reconstructor, board.as_mut(), run)?;

    let directory = output::directory(args.output.out.as_deref(), "loop")?;
    let mut files = Files::create(&directory, &instrument, &reconstructor, run)?;
    let mut series = Series::default();
    let mut second_valid = Vec::new();
    let mut digest = CodeDigest::default();
    let mut exposure = LongExposure::new(closed.pupil());
    let bar = progress::bar(u64::from(run.frames), "closed loop", "frames");
    let start = Instant::now();
    let mut simulated = Duration::ZERO;
    for frame in 0..run.frames {
        let before = Instant::now();
        closed.operate()?;
        let step = closed.step()?;
        simulated += before.elapsed();
        series.push(step.time_s, &step.observation, step.report);
        if run.frames - frame <= args.keep {
            files.keep_pixels(step.pixels)?;
            files.keep_phase(closed.residual())?;
        }
        if reconstructor.law().is_some() {
            let valid = closed.board().second_slopes().iter().filter(|slope| slope.valid);
            second_valid.push(valid.count());
        }
        if frame >= settle {
            exposure.add(closed.residual());
        }
        digest.add(closed.board().codes());
        files.commands.push(closed.board().codes().as_flattened())?;
        bar.inc(1);
    }
    bar.finish_and_clear();

    let standing = closed.standing()?;
    let settle = settle as usize;
    let strehl = series.mean_strehl(settle);
    let result = LoopResult {
        n: instrument.telescope.subapertures,
        sensor: args.sensor.name(),
        board: args.board.name(),
        frames: run.frames,
        strehl: strehl.mean,
        strehl_se: strehl.standard_error,
        variance_rad2: series.mean_variance(settle).mean,
        frames_per_second: f64::from(run.frames) / simulated.as_secs_f64(),
        digest: digest.hex(),
        faults: faults(&closed.board().totals(), &standing.faults),
    };
    files.finish()?;
    write_series(&directory, &series, &second_valid, settle)?;
    draw(&directory, &closed, &reconstructor, &instrument, &series, settle)?;
    draw_psf(&directory, &exposure, &instrument, run.seed)?;
    output::report(
        args.output.json,
        &result,
        &[
            (
                "subapertures",
                format!(
                    "{} across, {} in the pupil{}",
                    result.n,
                    closed.pupil().subapertures().len(),
                    match closed.board().components() {
                        1 => String::new(),
                        parts => format!(", {parts} parts whose relative pistons are not measured"),
                    }
                ),
            ),
            ("sensor", format!("{}, {:?}", result.sensor, args.sensing).to_lowercase()),
            (
                "frames",
                format!(
                    "{} at {} ms, {} to settle{}",
                    result.frames,
                    1e3 * instrument.frame_s(),
                    settle,
                    match cycle {
                        1 => String::new(),
                        _ => format!(", spots lit in turn in {cycle} of them"),
                    }
                ),
            ),
            (
                "Strehl ratio",
                format!("{:.4} +- {:.4}, tip and tilt removed", result.strehl, result.strehl_se),
            ),
            ("residual variance", format!("{:.4} rad^2", result.variance_rad2)),
            (
                "speed",
                format!(
                    "{:.0} frames/s of the loop, {:.1} s in all",
                    result.frames_per_second,
                    start.elapsed().as_secs_f64()
                ),
            ),
            ("faults", output::faults_in_words(&result.faults)),
            ("at the end", standing.mode.to_string()),
            ("digest", result.digest.clone()),
            ("pictures and files", directory.display().to_string()),
        ],
    )
}

/// The FITS files that grow with the run.
struct Files {
    commands: CubeWriter<u16>,
    phases: CubeWriter<f32>,
    frames: Option<CubeWriter<u16>>,
    /// Column and row of each subaperture.
    cells: Vec<i32>,
}

impl Files {
    fn create(
        directory: &Path,
        instrument: &Instrument,
        reconstructor: &Reconstructor,
        run: Run,
    ) -> Result<Self, Error> {
        let header = |unit| output::header(instrument, run.seed, unit);
        let cube = |name: &str| FitsWriter::create(directory.join(name));
        let segments = reconstructor.mask().count();
        let side = instrument.telescope.subapertures * instrument.telescope.samples;
        let detector = reconstructor.detector().spec();
        let frames = match run.sensing {
            Sensing::Geometric => {
                // What a run with images left here is not of this one. It need not be there.
                for stale in ["frames.fits", "detector.svg"] {
                    let _ = std::fs::remove_file(directory.join(stale));
                }
                None
            }
            Sensing::Images => {
                let last = header("ADU").with("CONTENT", "last frames of the run", "");
                let shape = [detector.width, detector.height];
                Some(cube("frames.fits")?.cube("FRAMES", shape, &last)?)
            }
        };
        Ok(Self {
            commands: cube("commands.fits")?.cube("CODES", [3, segments], &header("DAC code"))?,
            phases: cube("phases.fits")?.cube("RESIDUAL", [side, side], &header("rad"))?,
            frames,
            cells: reconstructor.mask().cells().flat_map(|(x, y)| [x as i32, y as i32]).collect(),
        })
    }

    fn keep_pixels(&mut self, pixels: &[u16]) -> Result<(), Error> {
        match &mut self.frames {
            Some(frames) => Ok(frames.push(pixels)?),
            None => Ok(()),
        }
    }

    fn keep_phase(&mut self, phase: &[f32]) -> Result<(), Error> {
        Ok(self.phases.push(phase)?)
    }

    fn finish(self) -> Result<(), Error> {
        let mut commands = self.commands.finish()?;
        let header = Header::new().with("CONTENT", "column, row of each subaperture of CODES", "");
        commands.image("CELLS", &[2, self.cells.len() / 2], &header, &self.cells)?;
        commands.finish()?;
        self.phases.finish()?.finish()?;
        if let Some(frames) = self.frames {
            frames.finish()?.finish()?;
        }
        Ok(())
    }
}

/// All series, one line a frame; of a second gate, if there is one, how many of its windows were valid.
fn write_series(
    directory: &Path,
    series: &Series,
    second_valid: &[usize],
    settle: usize,
) -> Result<(), Error> {
    let mut columns = vec![
        "frame",
        "time_s",
        "strehl",
        "mean_strehl",
        "variance_rad2",
        "valid_subapertures",
        "saturated_pixels",
        "saturated_actuators",
        "slewed_actuators",
        "solver_residual_squared",
    ];
    if !second_valid.is_empty() {
        columns.push("second_gate_valid");
    }
    let mut file = SeriesWriter::create(directory.join("series.csv"), &columns)?;
    let running = series.running_strehl(settle);
    for (k, report) in series.reports.iter().enumerate() {
        let mut line = vec![
            k as f64,
            series.time_s[k],
            series.strehl[k],
            running[k],
            series.variance_rad2[k],
            f64::from(report.valid),
            f64::from(report.saturated_pixels),
            f64::from(report.saturated_actuators),
            f64::from(report.slewed_actuators),
            report.residual_squared as f64,
        ];
        line.extend(second_valid.get(k).map(|&valid| valid as f64));
        file.push(&line)?;
    }
    Ok(file.finish()?)
}

/// The detector, the mirror, the residual phase and the Strehl ratio against time.
fn draw(
    directory: &Path,
    closed: &ClosedLoop<'_>,
    reconstructor: &Reconstructor,
    instrument: &Instrument,
    series: &Series,
    settle: usize,
) -> Result<(), Error> {
    let at = |name: &str| directory.join(name);
    let pupil = closed.pupil();
    if !closed.pixels().is_empty() {
        let detector = reconstructor.detector().spec();
        let [width, height] = [detector.width, detector.height];
        let marks = window_marks(closed, reconstructor, instrument.windows.size);
        let title = match reconstructor.law() {
            None => "last detector frame (ADU), windows and centroids",
            Some(_) => "last detector frame (ADU), second gate on top",
        };
        figures::detector_frame(at("detector.svg"), closed.pixels(), width, height, &marks, title)?;
    }
    let across = pupil.across();
    let mut pistons = vec![None; across * across];
    let nm_per_rad = 1e9 / instrument.rad_per_m();
    for (&[x, y], [piston, _, _]) in pupil.subapertures().iter().zip(&closed.mirror().segments) {
        pistons[y * across + x] = Some(piston * nm_per_rad);
    }
    let title = "mirror pistons, last frame";
    figures::segment_map(at("pistons.svg"), &pistons, across, "piston, optical path (nm)", title)?;
    let samples = pupil.side();
    let inside: Vec<bool> =
        (0..samples * samples).map(|i| pupil.illuminates(i / samples, i % samples)).collect();
    let title = "residual phase, last frame";
    let extent_m = pupil.diameter_m();
    figures::phase_map(at("residual.svg"), closed.residual(), samples, &inside, extent_m, title)?;
    let (times, running) = (&series.time_s, series.running_strehl(settle));
    let settle_s = settle as f64 * instrument.frame_s();
    let title = "Strehl ratio, piston, tip and tilt removed";
    figures::strehl_series(at("strehl.svg"), times, &series.strehl, &running, settle_s, title)?;
    Ok(())
}

/// The windows of each gate with what was measured in them.
fn window_marks(
    closed: &ClosedLoop<'_>,
    reconstructor: &Reconstructor,
    size: usize,
) -> Vec<WindowMark> {
    let board = closed.board();
    let origins = [reconstructor.origins(), reconstructor.second_origins().unwrap_or_default()];
    let measured = [board.measurements(), board.second_measurements()];
    let valid = board.slopes().iter().chain(board.second_slopes()).map(|slope| slope.valid);
    let windows = origins.into_iter().flatten().zip(measured.into_iter().flatten());
    let centre = (size as f64 - 1.0) / 2.0;
    let mark = |((&[x0, y0], measurement), valid): ((&[u16; 2], &Measurement), bool)| {
        let place = |origin: u16, c: i32| {
            f64::from(origin) + centre + f64::from(c) / f64::from(1u32 << CENTROID_BITS)
        };
        let [cx, cy] = measurement.centroid_q16;
        WindowMark {
            x0: usize::from(x0),
            y0: usize::from(y0),
            size,
            centroid: valid.then(|| [place(x0, cx), place(y0, cy)]),
            valid,
        }
    };
    windows.zip(valid).map(mark).collect()
}

/// The long exposure, and the same as FITS.
fn draw_psf(
    directory: &Path,
    exposure: &LongExposure,
    instrument: &Instrument,
    seed: u64,
) -> Result<(), Error> {
    let (side, image) = (exposure.side(), exposure.image());
    let diameter_m = instrument.telescope.pitch_m * instrument.telescope.subapertures as f64;
    let lambda_d = instrument.science.wavelength_m / diameter_m * ARCSEC;
    let arcsec_per_px = exposure.pixel_in_lambda_over_diameter() * lambda_d;
    // The corrected core and its halo: 2 N lambda/D across reaches beyond the control radius.
    let half = (instrument.telescope.subapertures as f64 / exposure.pixel_in_lambda_over_diameter())
        .ceil() as usize;
    let (first, crop) = (side / 2 - half.min(side / 2), 2 * half.min(side / 2));
    let rows = image.chunks_exact(side).skip(first).take(crop);
    let core: Vec<f32> = rows.flat_map(|row| row[first..first + crop].iter().copied()).collect();
    let title = "long exposure";
    figures::psf(directory.join("psf.svg"), &core, crop, arcsec_per_px, title)?;
    let header = output::header(instrument, seed, "fraction of diffraction limit").with(
        "PIXSCALE",
        arcsec_per_px,
        "[arcsec] pixel",
    );
    let mut file = FitsWriter::create(directory.join("psf.fits"))?;
    file.image("PSF", &[side, side], &header, &image)?;
    Ok(file.finish()?)
}
