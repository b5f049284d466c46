//! `host-sim endure`: a long run, and what must hold for ever.

use super::{output, progress};
use crate::cli::{BoardName, EndureArgs};
use crate::endurance::{Endurance, Stretch};
use crate::error::Error;
use crate::figures::{self, Curve, Panel};
use crate::files::csv::SeriesWriter;
use crate::reconstructor::Reconstructor;
use serde::Serialize;
use std::time::Instant;

/// Points of the series, at most.
const POINTS: u64 = 400;

/// The JSON of `host-sim endure`.
#[derive(Debug, Serialize)]
struct EndureResult {
    n: usize,
    board: &'static str,
    frames: u64,
    /// Farthest from zero, DAC LSB.
    mean_piston_lsb: f64,
    mean_tilt_lsb: f64,
    /// rms, px.
    offset_px: f64,
    /// Least and most of a frame, instructions or cycles; null on the host.
    frame_min: Option<u64>,
    frame_max: Option<u64>,
    frames_per_second: f64,
    digest: String,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &EndureArgs) -> Result<(), Error> {
    let mut instrument = args.description.load()?.of_one_gate()?;
    if let Some(n) = args.n {
        instrument.telescope.subapertures = n;
    }
    instrument.check()?;
    let reconstructor = Reconstructor::new(&instrument)?;
    let exact = args.board != BoardName::Host;
    let mut board = args.board.open(&reconstructor.spec(), args.patience.options(exact))?;
    let directory = output::directory(args.output.out.as_deref(), "endure")?;

    let start = Instant::now();
    let bar = progress::bar(args.frames, "frames", "frames");
    let mut run = Endurance::new(&instrument, &reconstructor, &mut *board, args.seed, exact)?;
    let every = args.frames.div_ceil(POINTS);
    let mut stretches = Vec::new();
    for frame in 1..=args.frames {
        run.step()?;
        if frame % every == 0 || frame == args.frames {
            stretches.push(run.stretch());
            bar.set_position(frame);
        }
    }
    let cost = run.cost();
    let digest = run.finish()?;
    bar.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();

    write(&directory.join("endurance.csv"), &stretches)?;
    draw(&directory.join("endurance.svg"), &stretches)?;
    let most = |pick: fn(&Stretch) -> f64| stretches.iter().map(pick).fold(0.0, f64::max);
    let count = stretches.len() as f64;
    let result = EndureResult {
        n: instrument.telescope.subapertures,
        board: args.board.name(),
        frames: args.frames,
        mean_piston_lsb: most(|s| s.piston_lsb),
        mean_tilt_lsb: most(|s| s.tilt_lsb),
        offset_px: (stretches.iter().map(|s| s.offset_px.powi(2)).sum::<f64>() / count).sqrt(),
        frame_min: cost.map(|[least, _]| least),
        frame_max: cost.map(|[_, most]| most),
        frames_per_second: args.frames as f64 / seconds,
        digest,
    };
    let cost = match cost {
        Some([least, most]) => format!("{least} to {most}"),
        None => "not exact here".into(),
    };
    let table = [
        ("subapertures", format!("{0} x {0}", result.n)),
        ("board", result.board.into()),
        ("frames", format!("{}, every one moved the mirror", result.frames)),
        ("mean piston", format!("{:.4} LSB at most", result.mean_piston_lsb)),
        ("mean tilt", format!("{:.4} LSB at most", result.mean_tilt_lsb)),
        ("spot offset", format!("{:.4} px rms", result.offset_px)),
        ("cost of a frame", cost),
        ("speed", format!("{:.0} frames/s", result.frames_per_second)),
        ("digest", result.digest.clone()),
        ("pictures and files", directory.display().to_string()),
    ];
    output::report(args.output.json, &result, &table)
}

fn write(path: &std::path::Path, stretches: &[Stretch]) -> Result<(), Error> {
    let columns =
        ["frame", "r0_ratio", "spot_offset_px_rms", "mean_piston_lsb_max", "mean_tilt_lsb_max"];
    let mut writer = SeriesWriter::create(path, &columns)?;
    for s in stretches {
        writer.push(&[s.frame as f64, s.seeing, s.offset_px, s.piston_lsb, s.tilt_lsb])?;
    }
    Ok(writer.finish()?)
}

fn draw(path: &std::path::Path, stretches: &[Stretch]) -> Result<(), Error> {
    let column = |pick: fn(&Stretch) -> f64| stretches.iter().map(pick).collect::<Vec<_>>();
    let x = column(|s| s.frame as f64 / 1000.0);
    let (seeing, offset) = (column(|s| s.seeing), column(|s| s.offset_px));
    let (piston, tilt) = (column(|s| s.piston_lsb), column(|s| s.tilt_lsb));
    let curve = |name, colour, y| Curve { name, colour, broken: false, y };
    let panels = [
        Panel {
            title: "seeing, and what the loop leaves of it".into(),
            x: x.clone(),
            curves: vec![
                curve("spot offset, px rms", "#b3261e", &offset),
                curve("r0 / nominal", "#7aa6c2", &seeing),
            ],
        },
        Panel {
            title: "what the sensor cannot see: must stay below 1".into(),
            x,
            curves: vec![
                curve("mean piston, DAC LSB", "#b3261e", &piston),
                curve("mean tip or tilt, DAC LSB", "#7aa6c2", &tilt),
            ],
        },
    ];
    Ok(figures::panels(path, "frame, thousands", "px, ratio, LSB", &panels)?)
}
