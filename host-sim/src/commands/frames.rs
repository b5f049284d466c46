//! `host-sim frames`: a recorded run.
//!
//! The file: FRAMES, a u16 cube (column, row, frame); TRUTH, the exact centroids of each frame in
//! pixels (axis, window, frame); STREHL, one value a frame; REFERENCE and GAIN, the slope
//! calibration (axis, subaperture; column, row, subaperture); CONFIG, the instrument as TOML.
//! With a second gate, whose windows lie in the rows behind the others and come behind them: REFERENCE2 and GAIN2, its slope
//! calibration; MODES (axis, subaperture, mode) and COUPLING (gate and mode seen, mode), the law, with its factor f in
//! the header of MODES.

use super::{output, progress};
use crate::board::in_process;
use crate::calibration::SlopeCalibration;
use crate::cli::FramesArgs;
use crate::closed_loop::{Run, Sensing};
use crate::error::Error;
use crate::files::fits::FitsWriter;
use crate::optics::geometric::Sensor;
use crate::reconstructor::Reconstructor;
use crate::summary::CodeDigest;
use serde::Serialize;

/// Names of the arrays of each gate's references and gains.
pub(super) const CALIBRATIONS: [[&str; 2]; 2] = [["REFERENCE", "GAIN"], ["REFERENCE2", "GAIN2"]];
/// Names of the law's arrays, and of the card of its factor.
pub(super) const MODES: &str = "MODES";
pub(super) const COUPLING: &str = "COUPLING";
pub(super) const LEVER_ARM: &str = "LEVERARM";

/// The JSON of `host-sim frames`.
#[derive(Debug, Serialize)]
struct FramesResult {
    file: String,
    frames: u32,
    /// Frames, rows, columns.
    shape: [usize; 3],
    digest: String,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &FramesArgs) -> Result<(), Error> {
    let instrument = args.run.instrument()?;
    let reconstructor = progress::combine_gates(Reconstructor::new(&instrument)?)?;
    let reconstructor = progress::calibrate(Sensor::Splash, reconstructor)?;
    let mut board = in_process(&reconstructor.spec())?;
    let run = Run {
        sensor: Sensor::Splash,
        sensing: Sensing::Images,
        frames: args.run.frames,
        seed: args.run.seed,
        noise_free: args.run.noise_free,
    };
    let mut closed = progress::close(&instrument, &reconstructor, board.as_mut(), run)?;
    let detector = reconstructor.detector().spec();
    let [width, height] = [detector.width, detector.height];
    let writable = |error| Error::Config(format!("{error}"));
    let header = output::header(&instrument, run.seed, "ADU");
    let path = match &args.out {
        Some(out) => output::directory(Some(out), "frames")?.join(&args.file),
        None => args.file.clone(),
    };
    let mut frames = FitsWriter::create(&path).map_err(writable)?.cube::<u16>(
        "FRAMES",
        [width, height],
        &header,
    )?;
    let mut truth = closed.truth(&instrument, &reconstructor)?;
    let (mut centroids, mut strehl) = (Vec::<f32>::new(), Vec::<f64>::new());
    let mut digest = CodeDigest::default();
    let bar = progress::bar(u64::from(run.frames), "recording", "frames");
    for _ in 0..run.frames {
        centroids.extend(closed.look(&mut truth).as_flattened().iter().map(|c| *c as f32));
        closed.operate()?;
        let step = closed.step()?;
        strehl.push(step.observation.strehl);
        frames.push(step.pixels)?;
        digest.add(closed.board().codes());
        bar.inc(1);
    }
    bar.finish_and_clear();
    let mut file = frames.finish()?;
    let windows = centroids.len() / 2 / strehl.len().max(1);
    let header = output::header(&instrument, run.seed, "pixel");
    file.image("TRUTH", &[2, windows, strehl.len()], &header, &centroids)?;
    file.image("STREHL", &[strehl.len()], &output::header(&instrument, run.seed, ""), &strehl)?;
    write_calibration(&mut file, &reconstructor, run.seed)?;
    file.text("CONFIG", &instrument.to_toml()?)?;
    file.finish()?;
    let result = FramesResult {
        file: path.display().to_string(),
        frames: run.frames,
        shape: [strehl.len(), height, width],
        digest: digest.hex(),
    };
    output::report(
        args.json,
        &result,
        &[
            ("file", result.file.clone()),
            ("frames", format!("{} of {width} x {height} pixels", run.frames)),
            ("digest", result.digest.clone()),
        ],
    )
}

/// The slope calibration of each gate, and what is made of two.
fn write_calibration(
    file: &mut FitsWriter,
    reconstructor: &Reconstructor,
    seed: u64,
) -> Result<(), Error> {
    let segments = reconstructor.mask().count();
    let header = |unit| output::header(reconstructor.instrument(), seed, unit);
    let gates = [Some(reconstructor.slopes()), reconstructor.second_slopes()];
    for (slopes, names) in gates.into_iter().zip(CALIBRATIONS) {
        let Some(SlopeCalibration { reference_px, gain_m_per_px }) = slopes else { continue };
        let [reference, gain] = names;
        let gains = gain_m_per_px.as_flattened().as_flattened();
        file.image(reference, &[2, segments], &header("pixel"), reference_px.as_flattened())?;
        file.image(gain, &[2, 2, segments], &header("m/pixel"), gains)?;
    }
    let Some(law) = reconstructor.law() else { return Ok(()) };
    let modes = law.modes.len() / segments;
    let with_factor = header("").with(LEVER_ARM, law.lever_arm, "f");
    file.image(MODES, &[2, segments, modes], &with_factor, law.modes.as_flattened())?;
    Ok(file.image(COUPLING, &[2 * modes, modes], &header(""), &law.coupling)?)
}
