//! `host-sim profile`: what a frame costs on a board.

use super::{output, progress};
use crate::cli::{BoardName, ProfileArgs};
use crate::error::Error;
use crate::figures::{Timeline, timeline};
use crate::instrument::Instrument;
use crate::profile::{FRAMES, Profile, ROUNDS, SecondGate, Sizes, TAIL, every_flux, measure};
use crate::reconstructor::Reconstructor;
use serde::Serialize;
use splash_firmware::link::Stack;
use std::path::Path;

/// What is added to the stack that was seen, as a fraction of it: for paths that no frame of the
/// profile took.
const STACK_MARGIN: f64 = 0.25;

/// The JSON of `host-sim profile`.
#[derive(Debug, Serialize)]
struct ProfileResult {
    board: &'static str,
    unit: &'static str,
    n: usize,
    window: usize,
    bits: u32,
    sweeps: u16,
    modes: u8,
    stages: Vec<Stage>,
    frame_min: u64,
    frame_max: u64,
    tail: u64,
    flash_bytes: Option<u64>,
    ram_bytes: Option<u64>,
    stack_bytes: Option<u32>,
}

#[derive(Debug, Serialize)]
struct Stage {
    name: &'static str,
    count: u64,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &ProfileArgs) -> Result<(), Error> {
    let instrument = instrument(args)?;
    let reconstructor = Reconstructor::new(&instrument)?;
    let alone = every_flux(reconstructor.spec());
    let second = args.modes.map(|modes| SecondGate::new(&alone, usize::from(modes)));
    let spec = second.as_ref().map_or(alone, |second| second.beside(alone));
    let mut board = args.board.open(&spec, args.patience.options(true))?;
    let bar = progress::bar(FRAMES.into(), "profile", "frames");
    let profile = measure(board.as_mut(), &spec, args.seed, &mut || bar.inc(1))?;
    bar.finish_and_clear();
    let sizes = args.board.program()?.map(|file| Sizes::of(&file)).transpose()?;
    let stack_bytes = profile.stack.map(bound).transpose()?;

    let directory = output::directory(args.output.out.as_deref(), "profile")?;
    let stages = profile.stages();
    let (frame_min, frame_max) = profile.range();
    let result = ProfileResult {
        board: args.board.name(),
        unit: unit(args.board),
        n: instrument.telescope.subapertures,
        window: instrument.windows.size,
        bits: instrument.detector.bits,
        sweeps: instrument.control.sweeps,
        modes: args.modes.unwrap_or(0),
        stages: stages.iter().map(|&(name, count)| Stage { name, count }).collect(),
        frame_min,
        frame_max,
        tail: profile.tail(),
        flash_bytes: sizes.map(|sizes| sizes.flash),
        ram_bytes: sizes.map(|sizes| sizes.ram),
        stack_bytes,
    };
    write_csv(&directory.join("profile.csv"), &profile)?;
    let clock_hz = args.clock_mhz.unwrap_or(clock_mhz(args.board)) * 1e6;
    draw(&directory.join("timeline.svg"), &result, &profile, &instrument, clock_hz)?;

    let rate_hz = clock_hz / result.frame_max as f64;
    let mut table: Vec<(&str, String)> = vec![
        ("board", format!("{}, {}", result.board, result.unit)),
        ("instrument", shape(&result)),
        ("frames", format!("{ROUNDS} each: dark, bright, noise, saturated, half dead")),
    ];
    table.extend(stages.iter().map(|&(name, count)| (name, count.to_string())));
    table.push(("tail", format!("{} ({:.1} %)", result.tail, percent(result.tail, frame_max))));
    table.push(("frame", format!("{frame_min} to {frame_max}")));
    table.push(("frame rate", format!("{rate_hz:.0} Hz, {}", assumption(args.board, clock_hz))));
    if let (Some(sizes), Some(stack)) = (sizes, stack_bytes) {
        table.push(("flash", format!("{} bytes", sizes.flash)));
        table.push(("RAM", format!("{} bytes, without the stack", sizes.ram)));
        table.push(("stack", format!("{stack} bytes, with a margin of a quarter")));
    }
    table.push(("pictures and files", directory.display().to_string()));
    output::report(args.output.json, &result, &table)
}

/// The instrument that the arguments ask for: windows edge to edge, no flat field.
fn instrument(args: &ProfileArgs) -> Result<Instrument, Error> {
    let mut instrument = args.description.load()?;
    if let Some(n) = args.n {
        instrument.telescope.subapertures = n;
    }
    if let Some(window) = args.window {
        (instrument.windows.size, instrument.windows.spacing_px) = (window, window);
    }
    if let Some(bits) = args.bits {
        instrument.detector.bits = bits;
    }
    if let Some(estimator) = args.estimator {
        instrument.centroids.estimator = estimator;
    }
    let control = &mut instrument.control;
    if let Some(sweeps) = args.sweeps {
        control.sweeps = sweeps;
    } else if control.sweeps == 0 {
        control.sweeps = instrument.telescope.subapertures.div_ceil(2) as u16;
    }
    instrument.check()?;
    Ok(instrument)
}

/// The stack that was seen and its margin.
fn bound(stack: Stack) -> Result<u32, Error> {
    let bound = (f64::from(stack.used) * (1.0 + STACK_MARGIN)).ceil() as u32;
    if bound > stack.reserved {
        return Err(Error::Run(format!(
            "stack = {} bytes and a margin of a quarter: must be at most the board's {}",
            stack.used, stack.reserved
        )));
    }
    Ok(bound)
}

fn unit(board: BoardName) -> &'static str {
    match board {
        BoardName::Host => "ns",
        BoardName::Qemu => "instructions",
        BoardName::Ibex => "cycles",
    }
}

/// The clock that turns a count into a time, MHz: that of the STM32H743, what the soft core reached in an
/// ECP5-85F of speed grade 6 (`firmware/boards/ibex/synth/run`), and nanoseconds.
fn clock_mhz(board: BoardName) -> f64 {
    match board {
        BoardName::Host => 1000.0,
        BoardName::Qemu => 480.0,
        BoardName::Ibex => 37.3,
    }
}

/// What a time stands for.
fn assumption(board: BoardName, clock_hz: f64) -> String {
    let mhz = clock_hz / 1e6;
    match board {
        BoardName::Host => "as measured here, now".into(),
        BoardName::Qemu => format!("estimate: an instruction a cycle at {mhz} MHz"),
        BoardName::Ibex => format!("at {mhz} MHz"),
    }
}

fn shape(result: &ProfileResult) -> String {
    let ProfileResult { n, window, bits, sweeps, modes, .. } = result;
    let one = format!("N = {n}, windows of {window} x {window} px, {bits} bits, {sweeps} sweeps");
    if *modes > 0 { format!("{one}, two gates, {modes} modes") } else { one }
}

fn percent(part: u64, whole: u64) -> f64 {
    100.0 * part as f64 / whole as f64
}

/// One line a frame.
fn write_csv(path: &Path, profile: &Profile) -> Result<(), Error> {
    let failed = |error: csv::Error| Error::Run(format!("{}: {error}", path.display()));
    let mut writer = csv::Writer::from_path(path).map_err(failed)?;
    let names = profile.stages().into_iter().map(|(name, _)| name);
    let header = std::iter::once("content").chain(names).chain(["tail", "frame"]);
    writer.write_record(header).map_err(failed)?;
    for (content, cost) in &profile.frames {
        let counts = std::iter::once(cost.centroid()).chain(cost.tail);
        let counts = counts.chain([cost.tail(), cost.total()]).map(|count| count.to_string());
        writer.write_record(std::iter::once(content.to_string()).chain(counts)).map_err(failed)?;
    }
    Ok(writer.flush()?)
}

fn draw(
    path: &Path,
    result: &ProfileResult,
    profile: &Profile,
    instrument: &Instrument,
    clock_hz: f64,
) -> Result<(), Error> {
    let us = |count: u64| count as f64 / clock_hz * 1e6;
    let worst = profile.worst();
    let title =
        format!("{}: {}, {} {}", result.board, shape(result), result.frame_max, result.unit);
    timeline(
        path,
        &Timeline {
            title: &title,
            readout_us: instrument.detector.readout_s * 1e6,
            begin_us: us(worst.begin),
            blocks_us: &worst.blocks.iter().map(|&block| us(block)).collect::<Vec<_>>(),
            tail_us: &std::array::from_fn(|i| (TAIL[i], us(worst.tail[i]))),
        },
    )?;
    Ok(())
}
