//! The results of `host-sim strehl` as a table, JSON, CSV, FITS and a figure.

use super::budget::{self, BudgetResult};
use crate::commands::campaign::{Campaign, Progress};
use crate::commands::output;
use crate::error::Error;
use crate::figures::{Measured, error_bars};
use crate::files::csv::SeriesWriter;
use crate::files::fits::{FitsWriter, Header};
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::point::Outcome;
use crate::monte_carlo::statistics::Mean;
use serde::Serialize;
use std::path::Path;

/// The JSON.
#[derive(Debug, Serialize)]
pub(in crate::commands) struct StrehlResult {
    pub(in crate::commands) points: Vec<PointResult>,
    pub(in crate::commands) paired: Vec<PairResult>,
    /// Empty unless it was asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(in crate::commands) budget: Vec<BudgetResult>,
}

#[derive(Debug, Serialize)]
pub(in crate::commands) struct PointResult {
    pub(in crate::commands) n: usize,
    pub(in crate::commands) sensor: &'static str,
    pub(in crate::commands) strehl: f64,
    /// Null for a single screen.
    pub(in crate::commands) strehl_se: f64,
    pub(in crate::commands) variance_rad2: f64,
    pub(in crate::commands) screens: u32,
}

/// The difference a - b under the same screens.
#[derive(Debug, Serialize)]
pub(in crate::commands) struct PairResult {
    pub(in crate::commands) n: usize,
    pub(in crate::commands) a: &'static str,
    pub(in crate::commands) b: &'static str,
    pub(in crate::commands) difference: f64,
    /// Null for a single screen.
    pub(in crate::commands) se: f64,
}

/// Means and differences.
pub(in crate::commands) fn gather(campaign: &Campaign) -> StrehlResult {
    let comparators = &campaign.comparators;
    let (mut points, mut paired) = (Vec::new(), Vec::new());
    for task in &campaign.tasks {
        let n = task.point.n();
        let strehl = |c: Comparator| task.values(c, |outcome| outcome.strehl);
        for (index, &a) in comparators.iter().enumerate() {
            let Mean { mean, standard_error } = Mean::of(&strehl(a));
            points.push(PointResult {
                n,
                sensor: a.name(),
                strehl: mean,
                strehl_se: standard_error,
                variance_rad2: Mean::of(&task.values(a, |o| o.variance_rad2)).mean,
                screens: task.finished.len() as u32,
            });
            for &b in &comparators[index + 1..] {
                let Mean { mean, standard_error } = Mean::of_differences(&strehl(a), &strehl(b));
                let (a, b) = (a.name(), b.name());
                paired.push(PairResult { n, a, b, difference: mean, se: standard_error });
            }
        }
    }
    StrehlResult { points, paired, budget: budget::gather(campaign) }
}

/// Tables and pictures: their names.
pub(in crate::commands) fn write(
    directory: &Path,
    campaign: &Campaign,
    result: &StrehlResult,
    seed: u64,
) -> Result<Vec<&'static str>, Error> {
    let mut files = write_csv(directory, campaign, result)?;
    write_fits(&directory.join("strehl.fits"), campaign, seed)?;
    draw(&directory.join("strehl.svg"), campaign, result)?;
    files.extend(["strehl.fits", "strehl.svg"]);
    if !result.budget.is_empty() {
        files.extend(budget::write(directory, campaign, &result.budget, seed)?);
    }
    Ok(files)
}

/// `strehl.csv`, one line an N; `paired.csv`, the same for differences; `screens.csv`, one line a screen.
fn write_csv(
    directory: &Path,
    campaign: &Campaign,
    result: &StrehlResult,
) -> Result<Vec<&'static str>, Error> {
    let StrehlResult { points, paired, .. } = result;
    let Campaign { tasks, comparators, .. } = campaign;
    let mut files = vec!["strehl.csv", "screens.csv"];
    let head = |first: &[&str], rest: Vec<String>| -> Vec<String> {
        first.iter().map(|name| (*name).to_string()).chain(rest).collect()
    };
    let create =
        |name: &str, columns: &[String]| SeriesWriter::create(directory.join(name), columns);
    let three =
        |c: &Comparator| ["", "_se", "_variance_rad2"].map(|end| c.name().to_string() + end);
    let columns = head(&["n", "screens"], comparators.iter().flat_map(three).collect());
    let mut file = create("strehl.csv", &columns)?;
    for row in points.chunks(comparators.len()) {
        let mut line = vec![row[0].n as f64, f64::from(row[0].screens)];
        line.extend(row.iter().flat_map(|p| [p.strehl, p.strehl_se, p.variance_rad2]));
        file.push(&line)?;
    }
    file.finish()?;

    let pairs = comparators.len() * (comparators.len() - 1) / 2;
    if pairs > 0 {
        let two = |p: &PairResult| ["", "_se"].map(|end| format!("{}_minus_{}{end}", p.a, p.b));
        let columns = head(&["n"], paired[..pairs].iter().flat_map(two).collect());
        let mut file = create("paired.csv", &columns)?;
        for row in paired.chunks(pairs) {
            let mut line = vec![row[0].n as f64];
            line.extend(row.iter().flat_map(|pair| [pair.difference, pair.se]));
            file.push(&line)?;
        }
        file.finish()?;
        files.push("paired.csv");
    }

    let two = |c: &Comparator| ["", "_variance_rad2"].map(|end| c.name().to_string() + end);
    let columns = head(&["n", "screen"], comparators.iter().flat_map(two).collect());
    let mut file = create("screens.csv", &columns)?;
    for task in tasks {
        for &screen in &task.finished {
            let mut line = vec![task.point.n() as f64, f64::from(screen)];
            for &comparator in comparators {
                let outcome = task.outcome(screen, comparator);
                line.extend([outcome.strehl, outcome.variance_rad2]);
            }
            file.push(&line)?;
        }
    }
    file.finish()?;
    Ok(files)
}

/// STREHL and VARIANCE, screen by screen (screen, sensor, N), NaN beyond the screens of an N and for one that is
/// missing; N, the sizes of the third axis.
fn write_fits(path: &Path, campaign: &Campaign, seed: u64) -> Result<(), Error> {
    let Campaign { tasks, comparators, .. } = campaign;
    let most = tasks.iter().map(|task| task.screens as usize).max().unwrap_or(0);
    let header = |unit: &str| {
        let header =
            output::cards(unit).with("SEED", seed.to_string(), "seed of turbulence and noise");
        output::along(header, 2, "SENSOR", comparators.iter().map(|c| c.name()))
    };
    let cube = |of: fn(&Outcome) -> f64| -> Vec<f64> {
        let all = tasks.iter().flat_map(|task| comparators.iter().map(move |c| (task, *c)));
        let padded = all.flat_map(|(task, comparator)| {
            let mut values = vec![f64::NAN; most];
            for (&screen, value) in task.finished.iter().zip(task.values(comparator, of)) {
                values[screen as usize] = value;
            }
            values
        });
        padded.collect()
    };
    let shape = [most, comparators.len(), tasks.len()];
    let across: Vec<i32> = tasks.iter().map(|task| task.point.n() as i32).collect();
    let mut file = FitsWriter::create(path)?;
    file.image("STREHL", &shape, &header(""), &cube(|outcome| outcome.strehl))?;
    file.image("VARIANCE", &shape, &header("rad2"), &cube(|outcome| outcome.variance_rad2))?;
    file.image("N", &[across.len()], &Header::new(), &across)?;
    Ok(file.finish()?)
}

/// Strehl ratio against D/r0.
fn draw(path: &Path, campaign: &Campaign, result: &StrehlResult) -> Result<(), Error> {
    let Campaign { tasks, comparators, .. } = campaign;
    let title = format!("{}, {}", campaign.screens(), campaign.sky());
    let x: Vec<f64> = tasks.iter().map(|task| task.diameter_in_r0()).collect();
    let column = |name: &str, of: fn(&PointResult) -> f64| -> Vec<f64> {
        result.points.iter().filter(|point| point.sensor == name).map(of).collect()
    };
    let curve = |comparator: &Comparator| {
        let (name, colour) = style(*comparator);
        let of = |value| column(comparator.name(), value);
        Measured { name: name.into(), colour, y: of(|p| p.strehl), error: of(|p| p.strehl_se) }
    };
    let curves: Vec<_> = comparators.iter().map(curve).collect();
    Ok(error_bars(path, ["D / r0", "Strehl ratio"], &title, &x, &curves)?)
}

pub(in crate::commands) fn style(comparator: Comparator) -> (&'static str, &'static str) {
    match comparator {
        Comparator::Splash => ("SPLASH", "#b3261e"),
        Comparator::Lgs => ("LGS", "#4477aa"),
        Comparator::Ngs => ("NGS", "#228833"),
        Comparator::Fit => ("fit", "#555555"),
    }
}

/// What is there and what is missing, one line an N.
pub(in crate::commands) fn progress(points: &[Progress]) -> Vec<(&'static str, String)> {
    let line = |(index, point): (usize, &Progress)| {
        let Progress { n, screens, finished, missing } = point;
        let name = if index == 0 { "screens" } else { "" };
        (name, format!("N = {n:<3} {finished} of {screens}, {missing} missing"))
    };
    points.iter().enumerate().map(line).collect()
}

/// The table: one line an N and sensor, one an N and pair, then the budget.
pub(in crate::commands) fn table(
    campaign: &Campaign,
    result: &StrehlResult,
) -> Vec<(&'static str, String)> {
    let comparators = &campaign.comparators;
    let mut table = Vec::new();
    let pairs = comparators.len() * (comparators.len() - 1) / 2;
    for (index, row) in result.points.chunks(comparators.len()).enumerate() {
        for point in row {
            let PointResult { n, sensor, strehl, strehl_se, variance_rad2, .. } = point;
            table.push((
                if sensor == &row[0].sensor { "Strehl ratio" } else { "" },
                format!(
                    "N = {n:<3} {sensor:<6} {strehl:.4} +- {strehl_se:.4}, {variance_rad2:.4} rad^2"
                ),
            ));
        }
        for PairResult { n, a, b, difference, se } in &result.paired[index * pairs..][..pairs] {
            table.push(("", format!("N = {n:<3} {a} - {b}: {difference:+.4} +- {se:.4}")));
        }
    }
    table.extend(budget::table(&result.budget));
    table
}
