//! `host-sim strehl`: Strehl ratios over independent screens.

mod results;

use super::{output, progress};
use crate::cli::StrehlArgs;
use crate::closed_loop::Sensing;
use crate::error::{Error, refuse};
use crate::instrument::Instrument;
use crate::monte_carlo::campaign::{self, Job};
use crate::monte_carlo::checkpoint::Checkpoint;
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::cost::{self, Cost};
use crate::monte_carlo::point::{Conditions, Point};
use std::time::Instant;

/// Frames that a loop gets to close: at a gain of 0.5 and N/2 sweeps a frame, to 3e-4 in the Strehl
/// ratio of any frozen screen, 5e-5 in their mean (N = 8 and 16).
const SETTLE: u32 = 40;
/// Frames averaged under frozen screens, and under moving ones.
const STATIC_FRAMES: u32 = 10;
const MOVING_FRAMES: u32 = 100;
/// Fastest wind, pitches per frame.
const MAX_WIND: f64 = 10.0;
/// A run that takes longer, s, says so instead.
const LONG_S: f64 = 86400.0;

/// One size of pupil with what is to be done for it.
struct Task {
    point: Point,
    checkpoint: Checkpoint,
    jobs: Vec<Job>,
    /// Of each job, s on one core.
    core_s: Vec<f64>,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &StrehlArgs) -> Result<(), Error> {
    let start = Instant::now();
    let comparators = distinct(&args.sensors);
    let points = points(args)?;
    let directory = output::directory(args.output.out.as_deref(), "strehl")?;
    let kept = output::directory(Some(&directory.join("screens")), "strehl")?;
    let mut tasks = Vec::new();
    for point in points {
        let name = format!("n{}-{}.csv", point.n(), point.digest()?);
        let checkpoint = Checkpoint::open(&kept.join(name))?;
        tasks.push(Task::new(point, checkpoint, args.screens, &comparators)?);
    }
    let estimate = estimate(&tasks, args.long)?;
    let total_s: f64 = tasks.iter().flat_map(|task| &task.core_s).sum();
    let mut done_s = 0.0;
    for task in &mut tasks {
        task.run(&mut done_s, total_s)?;
    }
    let result = results::gather(&tasks, args.screens, &comparators);
    results::write_csv(&directory, &tasks, &result, &comparators)?;
    let each = results::Screens { tasks: &tasks, screens: args.screens, comparators: &comparators };
    results::write_fits(&directory.join("strehl.fits"), &each, args.seed)?;
    let title = format!("{} screens, {}", args.screens, sky(&tasks[0].point));
    results::draw(&directory.join("strehl.svg"), &title, &tasks, &result, &comparators)?;
    let mut table = results::table(&result, &comparators);
    table
        .push(("screens", format!("{} for each N, {}", args.screens, conditions(&tasks[0].point))));
    table.push(("estimate", estimate));
    table.push(("time", format!("{:.1} s", start.elapsed().as_secs_f64())));
    table.push(("pictures and files", directory.display().to_string()));
    output::report(args.output.json, &result, &table)
}

/// In the order of [`Comparator::ALL`], each once.
fn distinct(sensors: &[Comparator]) -> Vec<Comparator> {
    Comparator::ALL.into_iter().filter(|comparator| sensors.contains(comparator)).collect()
}

/// The points that the arguments ask for, by increasing N, each once.
fn points(args: &StrehlArgs) -> Result<Vec<Point>, Error> {
    let mut description = match &args.config {
        Some(file) => Instrument::load(file)?,
        None => Instrument::standard()?,
    };
    let moving = args.wind.is_some();
    let pitch_m_per_s = description.telescope.pitch_m / description.frame_s();
    let speed = match args.wind {
        None => Some(0.0),
        Some(given) => given,
    };
    if let Some(wind) = speed {
        if !(0.0..=MAX_WIND).contains(&wind) {
            return Err(refuse("--wind", wind, &format!("from 0 to {MAX_WIND} pitches per frame")));
        }
        for layer in &mut description.atmosphere.layers {
            layer.wind_speed_m_per_s = wind * pitch_m_per_s;
        }
    }
    description.control.gain = args.gain.unwrap_or(description.control.gain);
    description.control.delay_frames = args.delay.unwrap_or(description.control.delay_frames);
    let frames = args.frames.unwrap_or(if moving { MOVING_FRAMES } else { STATIC_FRAMES });
    let conditions = Conditions {
        sensing: args.sensing,
        // Exact gradients have no noise: a run is the same with the flag and without.
        noise_free: !args.noise || args.sensing == Sensing::Geometric,
        settle: SETTLE,
        frames,
        seed: args.seed,
    };
    let mut across = args.n.clone();
    across.sort_unstable();
    across.dedup();
    across.into_iter().map(|n| Point::new(&description, n, conditions)).collect()
}

impl Task {
    /// What is missing at a point.
    fn new(
        point: Point,
        checkpoint: Checkpoint,
        screens: u32,
        comparators: &[Comparator],
    ) -> Result<Self, Error> {
        let missing = |screen: u32| -> Option<Job> {
            let known = |comparator| checkpoint.finished().contains_key(&(screen, comparator));
            let missing: Vec<_> = comparators.iter().copied().filter(|&c| !known(c)).collect();
            (!missing.is_empty()).then_some((screen, missing))
        };
        let jobs: Vec<Job> = (0..screens).filter_map(missing).collect();
        let cost = |(_, comparators): &Job| Ok(Cost::of_screen(&point, comparators)?.core_s);
        let core_s = jobs.iter().map(cost).collect::<Result<_, Error>>()?;
        Ok(Self { point, checkpoint, jobs, core_s })
    }

    /// Runs what is missing, behind a bar that knows `done_s` of `total_s`.
    fn run(&mut self, done_s: &mut f64, total_s: f64) -> Result<(), Error> {
        let Self { point, checkpoint, jobs, core_s } = self;
        if jobs.is_empty() {
            return Ok(());
        }
        let (bar, mut progress) = progress::fraction("calibration");
        let needed: Vec<_> =
            jobs.iter().flat_map(|(_, comparators)| comparators).copied().collect();
        let prepared = point.prepare(&distinct(&needed), &mut progress)?;
        bar.finish_and_clear();
        let bar = progress::share(format!("N = {}", point.n()));
        let mean_s = core_s.iter().sum::<f64>() / core_s.len() as f64;
        bar.set_position((1000.0 * *done_s / total_s) as u64);
        bar.reset_eta();
        let workers = campaign::workers(jobs.len());
        campaign::run(&prepared, jobs, workers, &mut |screen, outcomes| {
            *done_s += mean_s;
            bar.set_position((1000.0 * *done_s / total_s) as u64);
            checkpoint.add(screen, outcomes)
        })?;
        bar.finish_and_clear();
        Ok(())
    }
}

/// Time and memory in words; an error where the memory is not there, or for more than a day.
fn estimate(tasks: &[Task], long: bool) -> Result<String, Error> {
    let (mut seconds, mut bytes) = (0.0, 0);
    for task in tasks.iter().filter(|task| !task.jobs.is_empty()) {
        let workers = campaign::workers(task.jobs.len());
        let most = task.jobs.iter().max_by_key(|(_, comparators)| comparators.len());
        let Some((_, comparators)) = most else { continue };
        let cost = Cost::of_screen(&task.point, comparators)?;
        seconds += task.core_s.iter().sum::<f64>() / workers as f64;
        bytes = bytes.max(cost.shared + workers as u64 * cost.each);
    }
    let gigabytes = bytes as f64 / 1e9;
    let words = format!("{}, {gigabytes:.1} GB", in_words(seconds));
    match cost::available() {
        Some(available) if bytes > available => Err(Error::Config(format!(
            "the run would take {words}, of which {:.1} GB are available: take a smaller --n, a lower --wind \
             or --frames, or RAYON_NUM_THREADS=1",
            available as f64 / 1e9
        ))),
        _ if seconds > LONG_S && !long => Err(Error::Config(format!(
            "the run would take about {words}: take fewer --screens or a smaller --n, or --long to start it"
        ))),
        _ => Ok(words),
    }
}

fn in_words(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} minutes", s / 60.0),
        s if s < 2.0 * LONG_S => format!("{:.0} hours", s / 3600.0),
        s => format!("{:.0} days", s / LONG_S),
    }
}

/// The sky and the sensing.
fn sky(point: &Point) -> String {
    let layers = &point.instrument().atmosphere.layers;
    let still = layers.iter().all(|layer| layer.wind_speed_m_per_s == 0.0);
    let sky = if still { "frozen" } else { "moving" };
    let Conditions { sensing, noise_free, .. } = point.conditions();
    let detector = match (sensing, noise_free) {
        (Sensing::Geometric, _) => "exact gradients",
        (Sensing::Images, true) => "images without noise",
        (Sensing::Images, false) => "images with noise",
    };
    format!("{sky}, {detector}")
}

fn conditions(point: &Point) -> String {
    let Conditions { frames, settle, seed, .. } = point.conditions();
    format!("{}, {frames} frames after {settle} to settle, seed {seed}", sky(point))
}
