//! `host-sim centroids`: estimators on images against exact gradients.

use super::{increasing, output, progress};
use crate::centroid_study::{CentroidStudy, Estimate, STATES, State, Sums, jackknife};
use crate::cli::CentroidsArgs;
use crate::closed_loop::Sensing;
use crate::error::Error;
use crate::figures::{Measured, error_bars_up_to};
use crate::files::fits::{FitsWriter, Header};
use crate::instrument::Instrument;
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::cost::{DRAW_S, frame_s};
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;
use std::path::Path;
use std::time::Instant;

/// Of an estimator in a state, s on one core per subaperture: its configuration and its frames.
const ESTIMATE_S: f64 = 4e-5;
/// Colours of the curves.
const COLOURS: [&str; 8] =
    ["#555555", "#b3261e", "#4477aa", "#228833", "#aa3377", "#ccbb44", "#66ccee", "#000000"];

/// The JSON.
#[derive(Debug, Serialize)]
struct CentroidsResult {
    screens: u32,
    points: Vec<PointResult>,
}

/// One estimator in one state at one N. Errors are rms; standard errors have the same unit.
#[derive(Debug, Serialize)]
struct PointResult {
    n: usize,
    d_over_r0: f64,
    state: &'static str,
    estimator: String,
    error_px: f64,
    error_px_se: f64,
    /// Of phase from edge to edge of a subaperture.
    error_rad: f64,
    error_rad_se: f64,
    /// Null where the exact gradient is zero, as all that follows.
    gain: f64,
    gain_se: f64,
    fitted_px: f64,
    fitted_px_se: f64,
    exact_px: f64,
    invalid: f64,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &CentroidsArgs) -> Result<(), Error> {
    let start = Instant::now();
    let description = args.description.load()?.of_one_gate()?;
    let estimates = Estimate::all(&description, &args.peak_fractions);
    let across = increasing(&args.n, Ord::cmp);
    let study = |&n: &usize| CentroidStudy::new(&description, n, args.noise, &estimates);
    let studies = across.iter().map(study).collect::<Result<Vec<_>, Error>>()?;
    let directory = output::directory(args.output.out.as_deref(), "centroids")?;
    let costs = across.iter().zip(&studies).map(|(&n, study)| {
        let frames = STATES.len() as f64 * frame_s(Comparator::Splash, Sensing::Images, n as f64);
        let estimated = (STATES.len() * estimates.len() * n * n) as f64 * ESTIMATE_S;
        Ok(DRAW_S * study.texels()? as f64 + frames + estimated)
    });
    let costs = costs.collect::<Result<Vec<f64>, Error>>()?;
    let total_s = costs.iter().sum::<f64>() * f64::from(args.screens);
    let cores = rayon::current_num_threads();
    progress::say(&format!("estimate: {:.0} s on {cores} cores", total_s / cores as f64));
    let bar = progress::share("centroids".to_string());
    let per_mille: Vec<f64> = costs.iter().map(|cost| 1000.0 * cost / total_s).collect();
    let mut done = 0.0;
    let mut all = Vec::new();
    for ((&n, study), share) in across.iter().zip(&studies).zip(per_mille) {
        // As many screens at once as there are threads: a bar that moves.
        let mut screens = Vec::new();
        for first in (0..args.screens).step_by(cores) {
            let block = first..args.screens.min(first + cores as u32);
            done += share * block.len() as f64;
            let block = block.into_par_iter().map(|screen| study.screen(args.seed, screen));
            screens.extend(block.collect::<Result<Vec<_>, Error>>()?);
            bar.set_position(done as u64);
        }
        all.push((n, screens));
    }
    bar.finish_and_clear();
    let result = gather(args, &description, &estimates, &all);
    output::records(&directory.join("centroids.csv"), &result.points)?;
    write_fits(&directory.join("centroids.fits"), args, &estimates, &across, &result)?;
    for state in STATES {
        draw(&directory, state, &estimates, &result)?;
    }
    let mut table: Vec<(&str, String)> = Vec::new();
    let head =
        "  N  state        estimator           error (px)         (rad)    gain    fitted (px)";
    table.push(("slope errors", head.to_string()));
    table.extend(result.points.iter().map(|point| ("", point.line())));
    table.push(("screens", format!("{} for each N, seed {}", args.screens, args.seed)));
    output::finish(&args.output, start, &directory, &result, table)
}

/// Sums of each N: screens, then states and estimators.
type All = Vec<(usize, Vec<Vec<Sums>>)>;

fn gather(
    args: &CentroidsArgs,
    description: &Instrument,
    estimates: &[Estimate],
    all: &All,
) -> CentroidsResult {
    let rad_per_px = TAU / description.windows.pixels_per_lambda_d;
    let mut points = Vec::new();
    for (n, screens) in all {
        let cases = STATES.iter().flat_map(|state| estimates.iter().map(move |e| (state, e)));
        for (index, (state, estimate)) in cases.enumerate() {
            let sums: Vec<Sums> = screens.iter().map(|screen| screen[index]).collect();
            let (error_px, error_px_se) = jackknife(&sums, Sums::error_px);
            let (gain, gain_se) = jackknife(&sums, Sums::gain);
            let (fitted_px, fitted_px_se) = jackknife(&sums, Sums::fitted_px);
            points.push(PointResult {
                n: *n,
                d_over_r0: *n as f64 * description.telescope.pitch_m / description.r0_m(),
                state: state.name,
                estimator: estimate.name.clone(),
                error_px,
                error_px_se,
                error_rad: rad_per_px * error_px,
                error_rad_se: rad_per_px * error_px_se,
                gain,
                gain_se,
                fitted_px,
                fitted_px_se,
                exact_px: jackknife(&sums, Sums::exact_px).0,
                invalid: sums.iter().map(|sums| sums.invalid).sum(),
            });
        }
    }
    CentroidsResult { screens: args.screens, points }
}

impl PointResult {
    fn line(&self) -> String {
        let Self { n, state, estimator, error_px, error_px_se, error_rad, gain, .. } = self;
        let head = format!(
            "{n:>3}  {state:<12} {estimator:<17} {error_px:.4} +- {error_px_se:.4}  {error_rad:>7.4}"
        );
        match gain.is_finite() {
            true => {
                format!("{head}  {gain:>6.3}  {:.4} +- {:.4}", self.fitted_px, self.fitted_px_se)
            }
            false => head,
        }
    }
}

/// ERROR, FITTED and GAIN with their standard errors (value, standard error; estimator; state; N), and N.
fn write_fits(
    path: &Path,
    args: &CentroidsArgs,
    estimates: &[Estimate],
    across: &[usize],
    result: &CentroidsResult,
) -> Result<(), Error> {
    let shape = [2, estimates.len(), STATES.len(), across.len()];
    let header = |unit: &str| {
        let header = output::cards(unit)
            .with("SCREENS", i64::from(args.screens), "screens for each N")
            .with("SEED", args.seed.to_string(), "seed of turbulence and noise");
        let names = estimates.iter().map(|estimate| estimate.name.as_str());
        let header = output::along(header, 2, "ESTIM", names);
        output::along(header, 3, "STATE", STATES.iter().map(|state| state.name))
    };
    let values = |of: fn(&PointResult) -> [f64; 2]| -> Vec<f64> {
        result.points.iter().flat_map(of).collect()
    };
    let mut file = FitsWriter::create(path)?;
    let error = values(|p| [p.error_px, p.error_px_se]);
    file.image("ERROR", &shape, &header("pixel"), &error)?;
    let fitted = values(|p| [p.fitted_px, p.fitted_px_se]);
    file.image("FITTED", &shape, &header("pixel"), &fitted)?;
    file.image("GAIN", &shape, &header(""), &values(|p| [p.gain, p.gain_se]))?;
    let across: Vec<i32> = across.iter().map(|&n| n as i32).collect();
    file.image("N", &[across.len()], &Header::new(), &across)?;
    Ok(file.finish()?)
}

/// Slope error against D/r0 in a state, a curve an estimator.
fn draw(
    directory: &Path,
    state: State,
    estimates: &[Estimate],
    result: &CentroidsResult,
) -> Result<(), Error> {
    let of = |name: &str, of: fn(&PointResult) -> f64| -> Vec<f64> {
        let here = |p: &&PointResult| p.state == state.name && p.estimator == name;
        result.points.iter().filter(here).map(of).collect()
    };
    let x = of(&estimates[0].name, |p| p.d_over_r0);
    let curve = |(Estimate { name, .. }, colour): (&Estimate, &'static str)| Measured {
        name: name.clone(),
        colour,
        y: of(name, |p| p.error_px),
        error: of(name, |p| p.error_px_se),
    };
    let curves: Vec<_> = estimates.iter().zip(COLOURS.into_iter().cycle()).map(curve).collect();
    let path = directory.join(format!("centroids-{}.svg", state.name));
    let title = format!("centroid less exact gradient, {}", state.name);
    let highest = curves.iter().flat_map(|curve| &curve.y).copied().fold(0.0, f64::max);
    let labels = ["D / r0", "rms slope error (px)"];
    Ok(error_bars_up_to(path, labels, &title, &x, &curves, 1.1 * highest)?)
}
