//! The error budget as a table, JSON, CSV, FITS and a figure.

use crate::commands::campaign::{Campaign, Task};
use crate::commands::output;
use crate::error::Error;
use crate::figures::{Stack, StackPanel, Term, stacks};
use crate::files::csv::SeriesWriter;
use crate::files::fits::{FitsWriter, Header};
use crate::monte_carlo::budget::{Step, terms};
use crate::monte_carlo::statistics::Mean;
use serde::Serialize;
use std::path::Path;

/// The budget of one sensor's run.
#[derive(Clone, Debug, Serialize)]
pub(in crate::commands) struct BudgetResult {
    pub(in crate::commands) n: usize,
    pub(in crate::commands) sensor: &'static str,
    pub(in crate::commands) screens: u32,
    /// Only effects that the run has.
    pub(in crate::commands) terms: Vec<TermResult>,
    pub(in crate::commands) sum_rad2: f64,
    /// The run's own variance.
    pub(in crate::commands) run_rad2: f64,
    /// Null for a single screen.
    pub(in crate::commands) run_se: f64,
}

/// What an effect adds.
#[derive(Clone, Debug, Serialize)]
pub(in crate::commands) struct TermResult {
    #[serde(serialize_with = "by_name")]
    pub(in crate::commands) term: Step,
    pub(in crate::commands) variance_rad2: f64,
    /// Of the paired differences; null for a single screen.
    pub(in crate::commands) se: f64,
}

fn by_name<S: serde::Serializer>(step: &Step, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(step.name())
}

impl BudgetResult {
    /// The term of an effect that the run has.
    pub(in crate::commands) fn term(&self, step: Step) -> Option<&TermResult> {
        self.terms.iter().find(|term| term.term == step)
    }
}

/// The budgets of all sensors, by N; none unless they were asked for.
pub(super) fn gather(campaign: &Campaign) -> Vec<BudgetResult> {
    let mut all = Vec::new();
    if !campaign.budget {
        return all;
    }
    for task in &campaign.tasks {
        for &comparator in &campaign.comparators {
            let (steps, variances): (Vec<Step>, Vec<_>) =
                task.chain(comparator).into_iter().unzip();
            let Some(run) = variances.last() else { continue };
            let Mean { mean: run_rad2, standard_error: run_se } = Mean::of(run);
            let term = |(step, Mean { mean, standard_error })| TermResult {
                term: step,
                variance_rad2: mean,
                se: standard_error,
            };
            let terms: Vec<_> = steps.into_iter().zip(terms(&variances)).map(term).collect();
            all.push(BudgetResult {
                n: task.point.n(),
                sensor: comparator.name(),
                screens: task.finished.len() as u32,
                sum_rad2: terms.iter().map(|term| term.variance_rad2).sum(),
                terms,
                run_rad2,
                run_se,
            });
        }
    }
    all
}

/// The sensors in their order.
fn sensors(budgets: &[BudgetResult]) -> Vec<&'static str> {
    let first = budgets.first().map(|budget| budget.n);
    budgets.iter().filter(|b| Some(b.n) == first).map(|budget| budget.sensor).collect()
}

/// `budget.csv`, `budget.fits` and `budget.svg`: their names.
pub(super) fn write(
    directory: &Path,
    campaign: &Campaign,
    budgets: &[BudgetResult],
    seed: u64,
) -> Result<[&'static str; 3], Error> {
    let files = ["budget.csv", "budget.fits", "budget.svg"];
    write_csv(&directory.join(files[0]), budgets)?;
    write_fits(&directory.join(files[1]), budgets, seed)?;
    draw(&directory.join(files[2]), campaign, budgets)?;
    Ok(files)
}

/// One line an N; an effect that a sensor does not have has no column.
fn write_csv(path: &Path, budgets: &[BudgetResult]) -> Result<(), Error> {
    let sensors = sensors(budgets);
    let mut columns = vec!["n".to_string(), "screens".to_string()];
    for BudgetResult { sensor, terms, .. } in &budgets[..sensors.len()] {
        let names = terms.iter().map(|term| term.term.name());
        columns
            .extend(names.flat_map(|term| ["rad2", "se"].map(|w| format!("{sensor}_{term}_{w}"))));
        columns.extend(["sum_rad2", "run_rad2", "run_se"].map(|what| format!("{sensor}_{what}")));
    }
    let mut file = SeriesWriter::create(path, &columns)?;
    for row in budgets.chunks(sensors.len()) {
        let mut line = vec![row[0].n as f64, f64::from(row[0].screens)];
        for BudgetResult { terms, sum_rad2, run_rad2, run_se, .. } in row {
            line.extend(terms.iter().flat_map(|term| [term.variance_rad2, term.se]));
            line.extend([sum_rad2, run_rad2, run_se]);
        }
        file.push(&line)?;
    }
    Ok(file.finish()?)
}

/// TERMS and ERRORS (term, sensor, N), NaN for an effect that a sensor does not have; N, the sizes of the third
/// axis.
fn write_fits(path: &Path, budgets: &[BudgetResult], seed: u64) -> Result<(), Error> {
    let sensors = sensors(budgets);
    let header =
        output::cards("rad2").with("SEED", seed.to_string(), "seed of turbulence and noise");
    let header = output::along(header, 1, "TERM", Step::ALL.map(Step::name));
    let header = output::along(header, 2, "SENSOR", sensors.iter().copied());
    let cube = |of: fn(&TermResult) -> f64| -> Vec<f64> {
        let all = budgets.iter().flat_map(|budget| Step::ALL.map(|step| budget.term(step)));
        all.map(|term| term.map_or(f64::NAN, of)).collect()
    };
    let across: Vec<i32> = budgets.chunks(sensors.len()).map(|row| row[0].n as i32).collect();
    let shape = [Step::ALL.len(), sensors.len(), across.len()];
    let mut file = FitsWriter::create(path)?;
    file.image("TERMS", &shape, &header, &cube(|term| term.variance_rad2))?;
    file.image("ERRORS", &shape, &header, &cube(|term| term.se))?;
    file.image("N", &[across.len()], &Header::new(), &across)?;
    Ok(file.finish()?)
}

/// Stacked terms against D/r0, one panel a sensor.
fn draw(path: &Path, campaign: &Campaign, budgets: &[BudgetResult]) -> Result<(), Error> {
    let sensors = sensors(budgets);
    let panel = |(index, sensor): (usize, &&str)| {
        let of_sensor = budgets.iter().skip(index).step_by(sensors.len());
        let stack = |(budget, task): (&BudgetResult, &Task)| {
            let value = |step| budget.term(step).map_or(0.0, |term| term.variance_rad2);
            Stack {
                x: task.diameter_in_r0(),
                terms: Step::ALL.map(value).to_vec(),
                total: budget.run_rad2,
                error: budget.run_se,
            }
        };
        StackPanel {
            title: format!("{}, {}", sensor.to_uppercase(), campaign.screens()),
            stacks: of_sensor.zip(&campaign.tasks).map(stack).collect(),
        }
    };
    let panels: Vec<_> = sensors.iter().enumerate().map(panel).collect();
    let used = |step: Step| budgets.iter().any(|budget| budget.term(step).is_some());
    let legend = Step::ALL.map(|step| Term {
        name: in_words(step),
        colour: colour(step),
        shown: used(step),
    });
    Ok(stacks(path, ["D / r0", "residual variance (rad\u{b2})"], &panels, &legend)?)
}

/// The name in pictures and tables.
pub(in crate::commands) fn in_words(step: Step) -> &'static str {
    match step {
        Step::LeverArm => "lever arm",
        Step::ReturnPath => "return path",
        _ => step.name(),
    }
}

/// Colours that remain distinct to the colour-blind (Paul Tol's muted set).
fn colour(step: Step) -> &'static str {
    match step {
        Step::Fitting => "#bbbbbb",
        Step::Aliasing => "#88ccee",
        Step::Cone => "#44aa99",
        Step::LeverArm => "#332288",
        Step::ReturnPath => "#cc6677",
        Step::Temporal => "#ddcc77",
        Step::Quantisation => "#117733",
        Step::Images => "#aa4499",
        Step::Noise => "#882255",
    }
}

/// A value and, in brackets, its standard error in units of the last digit: two digits of the error, as long as
/// that is three to six decimals.
pub(in crate::commands) fn with_error(value: f64, se: f64) -> String {
    let decimals = match se {
        se if !se.is_finite() => 4,
        se if se <= 0.0 => 6,
        se => (1.0 - se.log10().floor()).clamp(3.0, 6.0) as usize,
    };
    let unit = 10f64.powi(decimals as i32);
    // Zero has no sign.
    let value = (value * unit).round() / unit + 0.0;
    if se.is_finite() {
        format!("{value:.decimals$}({:.0})", se * unit)
    } else {
        format!("{value:.decimals$}")
    }
}

/// One block a sensor: terms across, N down.
pub(super) fn table(budgets: &[BudgetResult]) -> Vec<(&'static str, String)> {
    let mut table = Vec::new();
    for (index, sensor) in sensors(budgets).iter().enumerate() {
        let of_sensor: Vec<_> = budgets.iter().filter(|b| b.sensor == *sensor).collect();
        let Some(first) = of_sensor.first() else { continue };
        let cells = |cells: Vec<String>| -> String {
            cells.iter().map(|cell| format!("{cell:>14}")).collect()
        };
        let mut head: Vec<String> =
            first.terms.iter().map(|term| in_words(term.term).into()).collect();
        head.extend(["sum".into(), "run".into()]);
        let name = if index == 0 { "budget, rad^2" } else { "" };
        table.push((name, format!("{sensor:<7}{}", cells(head))));
        for budget in of_sensor {
            let each = budget.terms.iter().map(|term| with_error(term.variance_rad2, term.se));
            let mut row: Vec<String> = each.collect();
            row.push(format!("{:.4}", budget.sum_rad2));
            row.push(with_error(budget.run_rad2, budget.run_se));
            table.push(("", format!("N = {:<3}{}", budget.n, cells(row))));
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::with_error;

    #[test]
    fn errors_in_brackets() {
        assert_eq!(with_error(0.17043, 0.00123), "0.1704(12)");
        assert_eq!(with_error(-1.23456, 0.0876), "-1.235(88)");
        assert_eq!(with_error(-2e-9, 1e-9), "0.000000(0)");
        assert_eq!(with_error(0.25, f64::NAN), "0.2500");
        assert_eq!(with_error(0.5, 0.0), "0.500000(0)");
    }
}
