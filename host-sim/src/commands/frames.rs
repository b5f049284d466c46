//! `host-sim frames`: a recorded run.
//!
//! The file: FRAMES, a u16 cube (column, row, frame); TRUTH, the exact centroids of each frame in
//! pixels (axis, subaperture, frame); STREHL, one value a frame; REFERENCE and GAIN, the slope
//! calibration (axis, subaperture; column, row, subaperture); CONFIG, the instrument as TOML.

use super::{output, progress};
use crate::board::in_process;
use crate::cli::FramesArgs;
use crate::closed_loop::{Run, Sensing};
use crate::error::Error;
use crate::files::fits::FitsWriter;
use crate::optics::geometric::Sensor;
use crate::reconstructor::Reconstructor;
use crate::summary::CodeDigest;
use serde::Serialize;

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
    let slopes = progress::calibrate(Sensor::Splash, &instrument)?;
    let reconstructor = Reconstructor::new(&instrument)?.with_slopes(slopes);
    let mut board = in_process(&reconstructor.spec())?;
    let run = Run {
        sensor: Sensor::Splash,
        sensing: Sensing::Images,
        frames: args.run.frames,
        seed: args.run.seed,
        noise_free: args.run.noise_free,
    };
    let mut closed = progress::close(&instrument, &reconstructor, board.as_mut(), run)?;
    let side = instrument.detector_side();
    let writable = |error| Error::Config(format!("{error}"));
    let header = output::header(&instrument, run.seed, "ADU");
    let path = match &args.out {
        Some(out) => output::directory(Some(out), "frames")?.join(&args.file),
        None => args.file.clone(),
    };
    let mut frames = FitsWriter::create(&path).map_err(writable)?.cube::<u16>(
        "FRAMES",
        [side, side],
        &header,
    )?;
    let mut truth = closed.truth(&instrument)?;
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
    let segments = reconstructor.mask().count();
    let header = output::header(&instrument, run.seed, "pixel");
    file.image("TRUTH", &[2, segments, strehl.len()], &header, &centroids)?;
    file.image("STREHL", &[strehl.len()], &output::header(&instrument, run.seed, ""), &strehl)?;
    let slopes = reconstructor.slopes();
    let reference = slopes.reference_px.as_flattened();
    let gain = slopes.gain_m_per_px.as_flattened().as_flattened();
    let header = |unit| output::header(&instrument, run.seed, unit);
    file.image("REFERENCE", &[2, segments], &header("pixel"), reference)?;
    file.image("GAIN", &[2, 2, segments], &header("m/pixel"), gain)?;
    file.text("CONFIG", &instrument.to_toml()?)?;
    file.finish()?;
    let result = FramesResult {
        file: path.display().to_string(),
        frames: run.frames,
        shape: [strehl.len(), side, side],
        digest: digest.hex(),
    };
    output::report(
        args.json,
        &result,
        &[
            ("file", result.file.clone()),
            ("frames", format!("{} of {side} x {side} pixels", run.frames)),
            ("digest", result.digest.clone()),
        ],
    )
}
