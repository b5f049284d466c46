//! `host-sim crosstalk`: spots whose light falls into each other's windows, lit at once and in turn.

use super::{increasing, output, progress};
use crate::calibration::SlopeCalibration;
use crate::centroid_study::{CentroidStudy, Estimate, STATES, Sums, jackknife};
use crate::cli::{CrosstalkArgs, Turns};
use crate::closed_loop::Sensing;
use crate::error::Error;
use crate::figures::{Measured, error_bars};
use crate::files::fits::{FitsWriter, Header};
use crate::instrument::{Colours, Instrument, Lattice, LayoutName, ScheduleSection};
use crate::lighting::Lighting;
use crate::monte_carlo::campaign::{self, Job};
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::cost::Cost;
use crate::monte_carlo::point::{Conditions, Point};
use crate::monte_carlo::statistics::Mean;
use rayon::prelude::*;
use serde::Serialize;
use splash_firmware::centroid::MIN_WINDOW;
use std::path::Path;
use std::time::Instant;

/// Cycles that each loop gets to close.
const SETTLE: u32 = 40;
/// Frames averaged under screens that stand still, and under moving ones.
const STATIC_FRAMES: u32 = 1;
const MOVING_FRAMES: u32 = 100;
/// Colours of the curves.
const COLOURS: [&str; 7] =
    ["#b3261e", "#4477aa", "#228833", "#aa3377", "#ccbb44", "#66ccee", "#555555"];

/// The JSON.
#[derive(Debug, Serialize)]
struct CrosstalkResult {
    n: usize,
    screens: u32,
    wind: f64,
    points: Vec<PointResult>,
}

/// One distance and lattice. Numbers are null where one of its loops was refused.
#[derive(Debug, Serialize)]
struct PointResult {
    spacing_lambda_d: f64,
    pitch_m: f64,
    spacing_px: f64,
    lattice: &'static str,
    groups: u32,
    /// Side of the windows; 0 where none fit.
    window_px: usize,
    strehl: f64,
    strehl_se: f64,
    /// The same windows without light of others.
    isolated: f64,
    isolated_se: f64,
    /// With it less without, under the same screens.
    difference: f64,
    difference_se: f64,
    /// Slope errors against exact gradients, px rms: without correction and with all of it.
    open_px: f64,
    open_px_se: f64,
    corrected_px: f64,
    corrected_px_se: f64,
    isolated_open_px: f64,
    isolated_open_px_se: f64,
    isolated_corrected_px: f64,
    isolated_corrected_px_se: f64,
    /// Why there is none.
    refused: Option<String>,
}

/// What is to be run at a distance and lattice: on the sky, and isolated.
struct Task {
    spacing_lambda_d: f64,
    pitch_m: f64,
    spacing_px: f64,
    lattice: &'static str,
    groups: u32,
    window_px: usize,
    points: Vec<Point>,
    /// Of each point; none if one was refused.
    ran: Vec<Ran>,
    refused: Option<String>,
}

/// What a point came to, screen by screen.
struct Ran {
    strehl: Vec<f64>,
    /// Slope errors, open and corrected.
    slopes: Vec<[Sums; 2]>,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &CrosstalkArgs) -> Result<(), Error> {
    let start = Instant::now();
    let mut sorted = args.clone();
    sorted.spacing = increasing(&args.spacing, f64::total_cmp);
    let args = &sorted;
    let mut tasks = tasks(args)?;
    let directory = output::directory(args.output.out.as_deref(), "crosstalk")?;
    let total_s = tasks.iter().map(|task| task.core_s(args.screens)).sum::<Result<f64, Error>>()?;
    let workers = campaign::workers(args.screens as usize);
    progress::say(&format!("estimate: {:.0} s on {workers} cores", total_s / workers as f64));
    let bar = progress::share("crosstalk".to_string());
    let mut done_s = 0.0;
    for task in &mut tasks {
        let task_s = task.core_s(args.screens)?;
        let share = task_s / f64::from(args.screens) / task.points.len().max(1) as f64;
        task.run(args.screens, workers, &mut || {
            done_s += share;
            bar.set_position((1000.0 * done_s / total_s) as u64);
        })?;
    }
    bar.finish_and_clear();
    let result = CrosstalkResult {
        n: args.n,
        screens: args.screens,
        wind: args.wind,
        points: tasks.iter().map(Task::result).collect(),
    };
    output::records(&directory.join("crosstalk.csv"), &result.points)?;
    write_fits(&directory.join("crosstalk.fits"), args, &tasks)?;
    draw(&directory.join("crosstalk.svg"), args, &result)?;
    let mut table: Vec<(&str, String)> = Vec::new();
    let head = "lambda/d lattice groups  window  Strehl ratio      isolated          difference         \
                slope error (isolated), px: open, corrected";
    table.push(("distance", head.to_string()));
    table.extend(result.points.iter().map(|point| ("", point.line())));
    table.push(("screens", format!("{}, wind {} pitches per frame", args.screens, args.wind)));
    output::finish(&args.output, start, &directory, &result, table)
}

/// All distances and lattices.
fn tasks(args: &CrosstalkArgs) -> Result<Vec<Task>, Error> {
    let description = args.description.load()?.of_one_gate()?;
    let mut instruments = Vec::new();
    for &spacing in &args.spacing {
        for &turns in &args.lattices {
            let instrument = instrument(&description, args, spacing, turns);
            let groups = Lighting::new(&instrument)?.count();
            instruments.push((spacing, turns, groups, instrument));
        }
    }
    // Loops of different cycles are run for the same time: under the same piece of moving sky.
    let cycles = || instruments.iter().map(|&(_, _, groups, _)| groups);
    let (common, longest) = (cycles().fold(1, lcm), cycles().max().unwrap_or(1));
    let moving_settle = common * (SETTLE * longest).div_ceil(common);
    let task = |(spacing, turns, groups, instrument): (f64, Turns, u32, Instrument)| {
        let (settle, frames) = match args.wind > 0.0 {
            true => (moving_settle / groups, MOVING_FRAMES),
            false => (SETTLE, STATIC_FRAMES),
        };
        let conditions = Conditions {
            sensing: Sensing::Images,
            noise_free: !args.noise,
            settle,
            frames,
            seed: args.seed,
        };
        Task::new(args.n, spacing, turns, groups, instrument, conditions)
    };
    instruments.into_iter().map(task).collect()
}

/// The description with spots so far apart on the sky, and subapertures of a Fried parameter.
fn instrument(
    description: &Instrument,
    args: &CrosstalkArgs,
    spacing: f64,
    turns: Turns,
) -> Instrument {
    let mut instrument = description.clone();
    let frame_s = instrument.frame_s();
    let pitch_m = (spacing * args.wavelength * args.beacon).sqrt();
    instrument.telescope.subapertures = args.n;
    instrument.second_gate.height_m = 0.0;
    instrument.telescope.pitch_m = pitch_m;
    instrument.atmosphere.r0_m = pitch_m;
    instrument.atmosphere.r0_wavelength_m = 0.0;
    for layer in &mut instrument.atmosphere.layers {
        layer.wind_speed_m_per_s = args.wind * pitch_m / frame_s;
    }
    let laser = &mut instrument.laser;
    (laser.beacon_height_m, laser.wavelength_m) = (args.beacon, args.wavelength);
    // From a height like that the light of one pulse comes back before the next.
    (laser.pulse_rate_hz, laser.pulses_per_frame) = (1.0 / frame_s, 1);
    instrument.science.wavelength_m = args.wavelength;
    instrument.windows.layout = LayoutName::Sky;
    instrument.schedule = ScheduleSection {
        lattice: match turns {
            Turns::All => Lattice::Numbers(Vec::new()),
            Turns::Lattice(name) => Lattice::Named(name),
        },
        colours: Colours::List(Vec::new()),
        separation: 0.0,
        ..description.schedule.clone()
    };
    instrument
}

fn lcm(a: u32, b: u32) -> u32 {
    let (mut x, mut y) = (a, b);
    while y > 0 {
        (x, y) = (y, x % y);
    }
    a / x.max(1) * b
}

impl Task {
    fn new(
        n: usize,
        spacing: f64,
        turns: Turns,
        groups: u32,
        mut instrument: Instrument,
        conditions: Conditions,
    ) -> Result<Self, Error> {
        let room = instrument.room_on_sky_px()?;
        let window_px =
            room.map_or(instrument.windows.size, |room| room.min(instrument.windows.size));
        let mut task = Self {
            spacing_lambda_d: spacing,
            pitch_m: instrument.telescope.pitch_m,
            spacing_px: instrument.spacing_on_sky_px(),
            lattice: turns.name(),
            groups,
            window_px,
            points: Vec::new(),
            ran: Vec::new(),
            refused: None,
        };
        if window_px < MIN_WINDOW {
            task.window_px = 0;
            let words =
                format!("{window_px} pixels between spots lit together: at least {MIN_WINDOW}");
            task.refused = Some(words);
            return Ok(task);
        }
        instrument.windows.size = window_px;
        let mut isolated = instrument.clone();
        isolated.windows = isolated.windows.relayed();
        let point = |instrument: &Instrument| Point::new(instrument, n, conditions);
        task.points = vec![point(&instrument)?, point(&isolated)?];
        Ok(task)
    }

    /// Time for so many screens, s on one core.
    fn core_s(&self, screens: u32) -> Result<f64, Error> {
        let cases = [Comparator::Splash.into()];
        let one = |point: &Point| {
            let screen_s = Cost::of_screen(point, &cases)?.core_s;
            // A calibration runs as many cycles under each of its own screens.
            let skies = SlopeCalibration::skies(point.pupil().subapertures().len()) as f64;
            let cycles = skies * f64::from(SlopeCalibration::CYCLES * point.cycle());
            let calibrations = cycles / f64::from(point.frames());
            // Slope errors take a cycle in each state.
            let slopes = f64::from(STATES.len() as u32 * point.cycle()) / f64::from(point.frames());
            Ok(screen_s * (calibrations + f64::from(screens) * (1.0 + slopes)))
        };
        self.points.iter().map(one).sum()
    }

    /// Runs all screens; `done` is called after each.
    fn run(&mut self, screens: u32, workers: usize, done: &mut dyn FnMut()) -> Result<(), Error> {
        let case = Comparator::Splash.into();
        let jobs: Vec<Job> = (0..screens).map(|screen| (screen, vec![case])).collect();
        let mut ran = Vec::new();
        for point in &self.points {
            let prepared = match point.prepare(&[case], &mut |_| ()) {
                Ok(prepared) => prepared,
                // A spot that does not follow its segment cannot be calibrated: that is a result.
                Err(Error::Config(words) | Error::Uncalibrated(words)) => {
                    self.refused = Some(words);
                    return Ok(());
                }
                Err(error) => return Err(error),
            };
            let mut strehl = vec![f64::NAN; screens as usize];
            campaign::run(&prepared, &jobs, workers, &mut |screen, outcomes| {
                done();
                for (_, outcome) in outcomes {
                    strehl[screen as usize] = outcome.strehl;
                }
                Ok(())
            })?;
            let instrument = point.instrument();
            let noise = !point.conditions().noise_free;
            let estimates = [Estimate::described(instrument)];
            let study = CentroidStudy::new(instrument, point.n(), noise, &estimates)?;
            let seed = point.conditions().seed;
            let sums = (0..screens).into_par_iter().map(|screen| {
                let states = study.screen(seed, screen)?;
                // The first state and the last.
                Ok([states[0], states[STATES.len() - 1]])
            });
            ran.push(Ran { strehl, slopes: sums.collect::<Result<_, Error>>()? });
        }
        self.ran = ran;
        Ok(())
    }

    /// Strehl ratio of each screen at a point; nothing, whose mean is NaN, where a loop was refused.
    fn strehl(&self, place: usize) -> &[f64] {
        self.ran.get(place).map_or(&[], |ran| &ran.strehl)
    }

    fn result(&self) -> PointResult {
        let (strehl, isolated) = (Mean::of(self.strehl(0)), Mean::of(self.strehl(1)));
        let difference = Mean::of_differences(self.strehl(0), self.strehl(1));
        let slopes = |place: usize, state: usize| {
            let Some(Ran { slopes, .. }) = self.ran.get(place) else { return (f64::NAN, f64::NAN) };
            let sums: Vec<Sums> = slopes.iter().map(|sums| sums[state]).collect();
            jackknife(&sums, Sums::error_px)
        };
        let (open, corrected) = (slopes(0, 0), slopes(0, 1));
        let (isolated_open, isolated_corrected) = (slopes(1, 0), slopes(1, 1));
        PointResult {
            spacing_lambda_d: self.spacing_lambda_d,
            pitch_m: self.pitch_m,
            spacing_px: self.spacing_px,
            lattice: self.lattice,
            groups: self.groups,
            window_px: self.window_px,
            strehl: strehl.mean,
            strehl_se: strehl.standard_error,
            isolated: isolated.mean,
            isolated_se: isolated.standard_error,
            difference: difference.mean,
            difference_se: difference.standard_error,
            open_px: open.0,
            open_px_se: open.1,
            corrected_px: corrected.0,
            corrected_px_se: corrected.1,
            isolated_open_px: isolated_open.0,
            isolated_open_px_se: isolated_open.1,
            isolated_corrected_px: isolated_corrected.0,
            isolated_corrected_px_se: isolated_corrected.1,
            refused: self.refused.clone(),
        }
    }
}

impl PointResult {
    fn line(&self) -> String {
        let Self { spacing_lambda_d, lattice, groups, window_px, .. } = self;
        let head = format!("{spacing_lambda_d:<8} {lattice:<7} {groups:>6}  {window_px:>3} px ");
        match &self.refused {
            Some(words) => format!("{head} refused: {words}"),
            None => format!(
                "{head} {:.4} +- {:.4}  {:.4} +- {:.4}  {:+.4} +- {:.4}  {:.3} ({:.3})  {:.3} ({:.3})",
                self.strehl,
                self.strehl_se,
                self.isolated,
                self.isolated_se,
                self.difference,
                self.difference_se,
                self.open_px,
                self.isolated_open_px,
                self.corrected_px,
                self.isolated_corrected_px
            ),
        }
    }
}

/// STREHL (screen; sky, isolated; lattice; distance), NaN where one of the two loops was refused, and the axes.
fn write_fits(path: &Path, args: &CrosstalkArgs, tasks: &[Task]) -> Result<(), Error> {
    let screens = args.screens as usize;
    let column = |task: &Task, place: usize| {
        let mut values = task.strehl(place).to_vec();
        values.resize(screens, f64::NAN);
        values
    };
    let values: Vec<f64> =
        tasks.iter().flat_map(|task| [column(task, 0), column(task, 1)].concat()).collect();
    let shape = [screens, 2, args.lattices.len(), args.spacing.len()];
    let header = output::cards("")
        .with("NSUB", args.n as i64, "subapertures across the pupil")
        .with("BEACON", args.beacon, "[m] beacon height")
        .with("WAVELEN", args.wavelength, "[m] laser wavelength")
        .with("WIND", args.wind, "pitches per frame")
        .with("SEED", args.seed.to_string(), "seed of turbulence and noise");
    let header = output::along(header, 3, "LATTIC", args.lattices.iter().map(|turns| turns.name()));
    let mut file = FitsWriter::create(path)?;
    file.image("STREHL", &shape, &header, &values)?;
    let unit = Header::new().with("BUNIT", "lambda/d", "unit of the values");
    file.image("SPACING", &[args.spacing.len()], &unit, &args.spacing)?;
    Ok(file.finish()?)
}

/// Strehl ratio against distance, a curve a lattice.
fn draw(path: &Path, args: &CrosstalkArgs, result: &CrosstalkResult) -> Result<(), Error> {
    let column = |index: usize, of: fn(&PointResult) -> f64| -> Vec<f64> {
        result.points.iter().skip(index).step_by(args.lattices.len()).map(of).collect()
    };
    let curves: Vec<_> = args
        .lattices
        .iter()
        .zip(COLOURS.into_iter().cycle())
        .enumerate()
        .map(|(index, (turns, colour))| {
            let groups = result.points[index].groups;
            let name = match turns {
                Turns::All => "all at once".to_string(),
                Turns::Lattice(_) => format!("{groups} groups"),
            };
            let (y, error) = (column(index, |p| p.strehl), column(index, |p| p.strehl_se));
            Measured { name, colour, y, error }
        })
        .collect();
    let title = format!("N = D/r0 = {}, spots on one detector", args.n);
    let labels = ["distance of the spots (lambda / d)", "Strehl ratio"];
    Ok(error_bars(path, labels, &title, &args.spacing, &curves)?)
}
