//! `host-sim beam`: uniform and Gaussian launch beams over subapertures of one to three r0.
//!
//! Measured with the defaults (N = 8, images without noise, star at the laser's wavelength, 12 screens, seed 1):
//! Strehl ratio less that of the uniform beam under the same screens, in brackets one standard error,
//!
//! | d / r0 | uniform | fit | w = 0.25 d | 0.35 d | 0.5 d | 0.7 d | d |
//! |---|---|---|---|---|---|---|---|
//! | 1 | 0.529(40) | 0.838 | -0.152(22) | -0.064(14) | -0.013(6) | +0.001(3) | +0.003(1) |
//! | 2 | 0.163(28) | 0.574 | -0.101(23) | -0.052(15) | -0.013(7) | -0.000(3) | +0.002(1) |
//! | 3 | 0.045(9) | 0.345 | -0.034(10) | -0.022(8) | -0.007(5) | -0.001(2) | +0.000(1) |
//! | passes | 1 | | 1.000 | 0.991 | 0.911 | 0.717 | 0.466 |
//!
//! A narrow beam senses the middle of its subaperture only, and aliases more. From w = d/2 on, where 9 % of the light
//! is lost, there is little to gain.

use super::campaign::{Campaign, Task};
use super::strehl::{SETTLE, STATIC_FRAMES};
use super::{increasing, output};
use crate::cli::BeamArgs;
use crate::closed_loop::Sensing;
use crate::error::{Error, refuse};
use crate::figures::{Measured, error_bars};
use crate::files::csv::SeriesWriter;
use crate::files::fits::{FitsWriter, Header};
use crate::files::lock::Lock;
use crate::instrument::{Instrument, LaunchName};
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::point::{Conditions, Point};
use crate::monte_carlo::statistics::Mean;
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// Optical samples in r0 at least.
const SAMPLES_PER_R0: f64 = 4.0;
const COLOURS: [&str; 4] = ["#b3261e", "#4477aa", "#228833", "#aa7733"];

/// The JSON.
#[derive(Debug, Serialize)]
struct BeamResult {
    n: usize,
    screens: u32,
    points: Vec<BeamPoint>,
}

#[derive(Debug, Serialize)]
struct BeamPoint {
    pitch_r0: f64,
    /// Null for the uniform beam.
    waist_pitches: Option<f64>,
    /// Part of the beam that its subaperture lets pass.
    transmitted: f64,
    strehl: f64,
    strehl_se: f64,
    /// Less that of the uniform beam under the same screens.
    gain: f64,
    gain_se: f64,
    /// The best that the segments can do.
    fit: f64,
    fit_se: f64,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &BeamArgs) -> Result<(), Error> {
    let start = Instant::now();
    let pitches = increasing(&args.pitches, f64::total_cmp);
    let waists = increasing(&args.waists, f64::total_cmp);
    let description = args.description.load()?.of_one_gate()?;
    let mut points = Vec::new();
    for &pitch in &pitches {
        for waist in [None].into_iter().chain(waists.iter().copied().map(Some)) {
            points.push((point(args, &description, pitch, waist)?, args.screens));
        }
    }
    let directory = output::directory(args.kept.output.out.as_deref(), "beam")?;
    let _lock = Lock::take(&directory, "host-sim beam")?;
    let sensors = [Comparator::Splash, Comparator::Fit];
    let mut campaign = Campaign::open(&directory, points, &sensors, false)?;
    let estimate = campaign.estimate(args.kept.long)?;
    campaign.run()?;
    let beams = waists.len() + 1;
    let rows = campaign.tasks.chunks(beams).zip(&pitches);
    let points = rows
        .flat_map(|(tasks, &pitch)| tasks.iter().map(move |task| gather(task, &tasks[0], pitch)));
    let first = &campaign.tasks[0];
    let result = BeamResult { n: first.point.n(), screens: args.screens, points: points.collect() };
    write_csv(&directory.join("beam.csv"), &result)?;
    write_fits(&directory.join("beam.fits"), &campaign, beams, args.kept.seed)?;
    draw(&directory.join("beam.svg"), &result, beams, &waists)?;
    let mut table: Vec<(&str, String)> = result.points.iter().map(row).collect();
    table.push(("screens", format!("{}, {}", args.screens, campaign.conditions())));
    table.push(("estimate", estimate));
    output::finish(&args.kept.output, start, &directory, &result, table)
}

/// The point of a pitch in r0 with a waist, or with the uniform beam.
fn point(
    args: &BeamArgs,
    description: &Instrument,
    pitch_r0: f64,
    waist: Option<f64>,
) -> Result<Point, Error> {
    if !(0.1..=4.0).contains(&pitch_r0) {
        return Err(refuse("--pitches", pitch_r0, "from 0.1 to 4 r0"));
    }
    let mut instrument = description.clone().frozen();
    let r0_m = instrument.r0_m();
    let Instrument { telescope, laser, .. } = &mut instrument;
    telescope.subapertures = args.n.unwrap_or(telescope.subapertures);
    telescope.pitch_m = pitch_r0 * r0_m;
    telescope.samples = telescope.samples.max((SAMPLES_PER_R0 * pitch_r0).ceil() as usize);
    laser.launch = LaunchName::Uniform;
    if let Some(waist_pitches) = waist {
        laser.launch = LaunchName::Gaussian;
        laser.launch_waist_pitches = waist_pitches;
    }
    let conditions = Conditions {
        sensing: Sensing::Images,
        noise_free: true,
        settle: SETTLE,
        frames: STATIC_FRAMES,
        seed: args.kept.seed,
    };
    Point::new(&instrument, instrument.telescope.subapertures, conditions)
}

/// What a task came to beside the uniform beam's.
fn gather(task: &Task, uniform: &Task, pitch_r0: f64) -> BeamPoint {
    let strehl = |task: &Task, of| task.values(of, |outcome| outcome.strehl);
    let values = strehl(task, Comparator::Splash);
    let all = Mean::of(&values);
    let gain = Mean::of_differences(&values, &strehl(uniform, Comparator::Splash));
    let fit = Mean::of(&strehl(task, Comparator::Fit));
    let instrument = task.point.instrument();
    let laser = &instrument.laser;
    BeamPoint {
        pitch_r0,
        waist_pitches: (laser.launch == LaunchName::Gaussian).then_some(laser.launch_waist_pitches),
        transmitted: instrument.launch().transmitted(),
        strehl: all.mean,
        strehl_se: all.standard_error,
        gain: gain.mean,
        gain_se: gain.standard_error,
        fit: fit.mean,
        fit_se: fit.standard_error,
    }
}

/// A line of the table.
fn row(p: &BeamPoint) -> (&'static str, String) {
    let beam = p.waist_pitches.map_or("uniform".into(), |waist| format!("waist {waist:.2} d"));
    let words = format!(
        "d = {} r0, {beam:<12} {:.3} passes, {:.4} +- {:.4}, {:+.4} +- {:.4} of uniform, fit {:.4}",
        p.pitch_r0, p.transmitted, p.strehl, p.strehl_se, p.gain, p.gain_se, p.fit
    );
    ("Strehl ratio", words)
}

/// One line a pitch and beam; a uniform beam's waist is infinite.
fn write_csv(path: &Path, result: &BeamResult) -> Result<(), Error> {
    let columns = [
        "pitch_r0",
        "waist_pitches",
        "transmitted",
        "strehl",
        "strehl_se",
        "minus_uniform",
        "minus_uniform_se",
        "fit",
        "fit_se",
    ];
    let mut file = SeriesWriter::create(path, &columns)?;
    for p in &result.points {
        let waist = p.waist_pitches.unwrap_or(f64::INFINITY);
        file.push(&[
            p.pitch_r0,
            waist,
            p.transmitted,
            p.strehl,
            p.strehl_se,
            p.gain,
            p.gain_se,
            p.fit,
            p.fit_se,
        ])?;
    }
    Ok(file.finish()?)
}

/// STREHL (screen, uniform and then by waist, pitch).
fn write_fits(path: &Path, campaign: &Campaign, beams: usize, seed: u64) -> Result<(), Error> {
    let tasks = &campaign.tasks;
    let strehl = |task: &Task| task.values(Comparator::Splash, |outcome| outcome.strehl);
    let values: Vec<f64> = tasks.iter().flat_map(strehl).collect();
    let header = Header::new()
        .with("ORIGIN", "host-sim", "SPLASH simulator")
        .with("NSUB", tasks[0].point.n() as i64, "subapertures across the pupil")
        .with("SEED", seed.to_string(), "seed of turbulence");
    let shape = [tasks[0].screens as usize, beams, tasks.len() / beams];
    let waist = |task: &Task| match task.point.instrument().laser.launch {
        LaunchName::Uniform => f64::INFINITY,
        LaunchName::Gaussian => task.point.instrument().laser.launch_waist_pitches,
    };
    let waists: Vec<f64> = tasks[..beams].iter().map(waist).collect();
    let pitches: Vec<f64> =
        tasks.chunks(beams).map(|tasks| tasks[0].point.instrument().telescope.pitch_m).collect();
    let mut file = FitsWriter::create(path)?;
    file.image("STREHL", &shape, &header, &values)?;
    let unit = Header::new().with("BUNIT", "pitches", "waist; infinite for the uniform beam");
    file.image("WAIST", &[beams], &unit, &waists)?;
    let unit = Header::new().with("BUNIT", "m", "side of a subaperture");
    file.image("PITCH", &[pitches.len()], &unit, &pitches)?;
    Ok(file.finish()?)
}

/// Strehl ratio against waist, a curve for each pitch, and the uniform beam's as a line.
fn draw(path: &Path, result: &BeamResult, beams: usize, waists: &[f64]) -> Result<(), Error> {
    let mut curves = Vec::new();
    for (points, colour) in result.points.chunks(beams).zip(COLOURS.into_iter().cycle()) {
        let (uniform, waisted) = (&points[0], &points[1..]);
        let y: Vec<f64> = waisted.iter().map(|point| point.strehl).collect();
        let error: Vec<f64> = waisted.iter().map(|point| point.strehl_se).collect();
        let name = format!("Gaussian, d = {} r0", uniform.pitch_r0);
        curves.push(Measured { name, colour, y, error });
        let name = format!("uniform, d = {} r0", uniform.pitch_r0);
        curves.push(Measured::level(name, uniform.strehl, waists.len()));
    }
    let title = format!("N = {}, {} screens, no noise", result.n, result.screens);
    let labels = ["waist (subapertures)", "Strehl ratio"];
    Ok(error_bars(path, labels, &title, waists, &curves)?)
}
