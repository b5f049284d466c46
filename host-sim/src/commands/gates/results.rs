//! The results of `host-sim gates` as a table, JSON, CSV, FITS and figures.

use super::{Measured, Terms};
use crate::commands::output;
use crate::commands::strehl::budget::with_error;
use crate::error::Error;
use crate::figures::{Measured as Curve, error_bars};
use crate::files::csv::SeriesWriter;
use crate::files::fits::{FitsWriter, Header};
use crate::monte_carlo::gates::View;
use crate::monte_carlo::point::Outcome;
use crate::monte_carlo::statistics::Mean;
use serde::Serialize;
use std::path::Path;

/// The JSON.
#[derive(Debug, Serialize)]
pub(super) struct GatesResult {
    gate_height_m: f64,
    /// Of the gate at the beacon's height and of the second one.
    slope_noise_rad: [f64; 2],
    points: Vec<PointResult>,
}

/// One contender at one N. Errors are null for a single screen.
#[derive(Debug, Serialize)]
struct PointResult {
    n: usize,
    diameter_in_r0: f64,
    law: String,
    /// f; null for guide stars and fit.
    lever_arm: Option<f64>,
    screens: u32,
    strehl: f64,
    strehl_se: f64,
    variance_rad2: f64,
    variance_se: f64,
    /// Less that of the fit, screen by screen.
    beyond_fit_rad2: f64,
    beyond_fit_se: f64,
    /// The same by theory; null where there is none.
    expected_rad2: Option<f64>,
    /// Variance over that of one gate with f = 1, and the same with the fit's taken off both.
    ratio: f64,
    ratio_se: f64,
    ratio_beyond_fit: f64,
    ratio_beyond_fit_se: f64,
    /// Variance less that of one gate with the best f, screen by screen.
    minus_splash_f_rad2: f64,
    minus_splash_f_se: f64,
}

/// Variances of those with whom all others are compared.
struct Standards {
    fit: Vec<f64>,
    splash: Vec<f64>,
    splash_f: Vec<f64>,
}

impl Standards {
    /// # Errors
    /// [`Error::Run`] if one is not among the contenders.
    fn of(measured: &Measured) -> Result<Self, Error> {
        let variances = |name: &str| {
            let place = measured.contenders.iter().position(|c| c.name == name);
            let place =
                place.ok_or_else(|| Error::Run(format!("no contender is called {name}")))?;
            Ok::<_, Error>(column(measured, place, |o| o.variance_rad2))
        };
        Ok(Self {
            fit: variances("fit")?,
            splash: variances("splash")?,
            splash_f: variances("splash_f")?,
        })
    }
}

fn column(measured: &Measured, contender: usize, of: fn(&Outcome) -> f64) -> Vec<f64> {
    measured.outcomes.iter().map(|screen| of(&screen[contender])).collect()
}

/// The ratio of two means over the same screens; its error is that of a - r b over the mean of b.
fn ratio(a: &[f64], b: &[f64]) -> Mean {
    let under = Mean::of(b).mean;
    let mean = Mean::of(a).mean / under;
    let scaled: Vec<f64> = b.iter().map(|b| mean * b).collect();
    Mean { mean, standard_error: Mean::of_differences(a, &scaled).standard_error / under }
}

/// Means and ratios.
///
/// # Errors
/// As [`Standards::of`].
pub(super) fn gather(all: &[Measured], terms: &Terms) -> Result<GatesResult, Error> {
    let mut points = Vec::new();
    for measured in all {
        let standards = Standards::of(measured)?;
        let contenders = 0..measured.contenders.len();
        points.extend(contenders.map(|contender| point(measured, contender, &standards, terms)));
    }
    let Terms { gate_height_m, noise_rad, .. } = *terms;
    Ok(GatesResult { gate_height_m, slope_noise_rad: noise_rad, points })
}

fn point(
    measured: &Measured,
    contender: usize,
    Standards { fit, splash, splash_f }: &Standards,
    terms: &Terms,
) -> PointResult {
    let own = column(measured, contender, |o| o.variance_rad2);
    let less = |a: &[f64]| -> Vec<f64> { a.iter().zip(fit).map(|(a, fit)| a - fit).collect() };
    let strehl = Mean::of(&column(measured, contender, |o| o.strehl));
    let variance = Mean::of(&own);
    let beyond = Mean::of(&less(&own));
    let (whole, part) = (ratio(&own, splash), ratio(&less(&own), &less(splash)));
    let against = Mean::of_differences(&own, splash_f);
    let contestant = &measured.contenders[contender];
    PointResult {
        n: measured.point.n(),
        diameter_in_r0: diameter_in_r0(measured),
        law: contestant.name.clone(),
        lever_arm: (contestant.view == View::Splash).then_some(contestant.law.lever_arm),
        screens: terms.screens,
        strehl: strehl.mean,
        strehl_se: strehl.standard_error,
        variance_rad2: variance.mean,
        variance_se: variance.standard_error,
        beyond_fit_rad2: beyond.mean,
        beyond_fit_se: beyond.standard_error,
        expected_rad2: measured.expected[contender],
        ratio: whole.mean,
        ratio_se: whole.standard_error,
        ratio_beyond_fit: part.mean,
        ratio_beyond_fit_se: part.standard_error,
        minus_splash_f_rad2: against.mean,
        minus_splash_f_se: against.standard_error,
    }
}

fn diameter_in_r0(measured: &Measured) -> f64 {
    measured.point.pupil().diameter_m() / measured.point.instrument().r0_m()
}

/// Tables and pictures: their names.
pub(super) fn write(
    directory: &Path,
    all: &[Measured],
    result: &GatesResult,
    terms: &Terms,
) -> Result<[&'static str; 5], Error> {
    let files = ["gates.csv", "screens.csv", "gates.fits", "strehl.svg", "ratio.svg"];
    let names: Vec<&str> = all[0].contenders.iter().map(|c| c.name.as_str()).collect();
    write_means(&directory.join(files[0]), result, &names)?;
    write_screens(&directory.join(files[1]), all, &names)?;
    write_fits(&directory.join(files[2]), all, &names, terms)?;
    draw(directory, [files[3], files[4]], result, &names, terms)?;
    Ok(files)
}

/// One line an N.
fn write_means(path: &Path, result: &GatesResult, names: &[&str]) -> Result<(), Error> {
    let each = |name: &&str| {
        [
            "strehl",
            "strehl_se",
            "variance_rad2",
            "variance_se",
            "expected_rad2",
            "ratio",
            "ratio_se",
        ]
        .map(|what| format!("{name}_{what}"))
    };
    let head = ["n", "diameter_in_r0", "screens"].map(String::from);
    let columns: Vec<String> = head.into_iter().chain(names.iter().flat_map(each)).collect();
    let mut file = SeriesWriter::create(path, &columns)?;
    for row in result.points.chunks(names.len()) {
        let mut line = vec![row[0].n as f64, row[0].diameter_in_r0, f64::from(row[0].screens)];
        for p in row {
            let expected = p.expected_rad2.unwrap_or(f64::NAN);
            line.extend([p.strehl, p.strehl_se, p.variance_rad2, p.variance_se]);
            line.extend([expected, p.ratio, p.ratio_se]);
        }
        file.push(&line)?;
    }
    Ok(file.finish()?)
}

/// One line a screen.
fn write_screens(path: &Path, all: &[Measured], names: &[&str]) -> Result<(), Error> {
    let each = |name: &&str| ["strehl", "variance_rad2"].map(|what| format!("{name}_{what}"));
    let head = ["n", "screen"].map(String::from);
    let columns: Vec<String> = head.into_iter().chain(names.iter().flat_map(each)).collect();
    let mut file = SeriesWriter::create(path, &columns)?;
    for measured in all {
        for (screen, outcomes) in measured.outcomes.iter().enumerate() {
            let mut line = vec![measured.point.n() as f64, screen as f64];
            line.extend(outcomes.iter().flat_map(|o| [o.strehl, o.variance_rad2]));
            file.push(&line)?;
        }
    }
    Ok(file.finish()?)
}

/// STREHL and VARIANCE (screen, law, N); N, the sizes of the third axis.
fn write_fits(path: &Path, all: &[Measured], names: &[&str], terms: &Terms) -> Result<(), Error> {
    let header = |unit: &str| {
        let header = output::cards(unit)
            .with("SEED", terms.seed.to_string(), "seed of turbulence and noise")
            .with("GATE", terms.gate_height_m, "[m] height of the second gate")
            .with("NOISE", terms.noise_rad[0], "[rad] rms of a slope, edge to edge")
            .with("NOISE2", terms.noise_rad[1], "[rad] the same of the second gate");
        output::along(header, 2, "LAW", names.iter().copied())
    };
    let cube = |of: fn(&Outcome) -> f64| -> Vec<f64> {
        all.iter().flat_map(|m| (0..names.len()).flat_map(move |c| column(m, c, of))).collect()
    };
    let shape = [terms.screens as usize, names.len(), all.len()];
    let across: Vec<i32> = all.iter().map(|measured| measured.point.n() as i32).collect();
    let mut file = FitsWriter::create(path)?;
    file.image("STREHL", &shape, &header(""), &cube(|outcome| outcome.strehl))?;
    file.image("VARIANCE", &shape, &header("rad2"), &cube(|outcome| outcome.variance_rad2))?;
    file.image("N", &[across.len()], &Header::new(), &across)?;
    Ok(file.finish()?)
}

/// Strehl ratio, and variance over that of one gate with f = 1, against D/r0.
fn draw(
    directory: &Path,
    [strehl, ratio]: [&str; 2],
    result: &GatesResult,
    names: &[&str],
    terms: &Terms,
) -> Result<(), Error> {
    let noise = match terms.noise_rad {
        [0.0, 0.0] => String::new(),
        noise_rad => format!(", noise {}", in_words(noise_rad)),
    };
    let title = format!("{} screens, exact gradients{noise}", terms.screens);
    let x: Vec<f64> = result.points.chunks(names.len()).map(|row| row[0].diameter_in_r0).collect();
    let figure = |name: &str, label, value: Columns, shown: &dyn Fn(&str) -> bool| {
        let column = |law: &str, of: fn(&PointResult) -> f64| -> Vec<f64> {
            result.points.iter().filter(|point| point.law == law).map(of).collect()
        };
        let curve = |law: &&str| {
            let (name, colour) = style(law);
            let [y, error] = value.map(|of| column(law, of));
            Curve { name: name.into(), colour, y, error }
        };
        let curves: Vec<_> = names.iter().filter(|name| shown(name)).map(curve).collect();
        error_bars(directory.join(name), ["D / r0", label], &title, &x, &curves)
    };
    figure(strehl, "Strehl ratio", [|p| p.strehl, |p| p.strehl_se], &|_| true)?;
    let ours = |name: &str| name.starts_with("splash_") || name.starts_with("gates_");
    let label = "residual variance over that of one gate, f = 1";
    Ok(figure(ratio, label, [|p| p.ratio, |p| p.ratio_se], &ours)?)
}

/// The noise of both gates.
fn in_words([first, second]: [f64; 2]) -> String {
    if first == second {
        return format!("{first} rad");
    }
    format!("{first} rad, at the second gate {second} rad")
}

/// A value and its error.
type Columns = [fn(&PointResult) -> f64; 2];

fn style(law: &str) -> (&str, &'static str) {
    match law {
        "splash" => ("SPLASH", "#b3261e"),
        "splash_f" => ("SPLASH, best f", "#ee7733"),
        "gates_12" => ("two gates, 12 modes", "#aa3377"),
        "gates_25" => ("two gates, 25 modes", "#332288"),
        "lgs" => ("LGS", "#4477aa"),
        "ngs" => ("NGS", "#228833"),
        "fit" => ("fit", "#555555"),
        other => (other, "#000000"),
    }
}

/// One line an N and contender.
pub(super) fn table(result: &GatesResult) -> Vec<(&'static str, String)> {
    let mut table = vec![
        ("second gate", format!("at {} m", result.gate_height_m)),
        ("slope noise", format!("{}, edge to edge", in_words(result.slope_noise_rad))),
        (
            "residual",
            format!(
                "{:<19}{:>8}{:>16}{:>16}{:>16}{:>10}{:>14}{:>14}",
                "", "f", "Strehl ratio", "rad^2", "beyond fit", "expected", "ratio", "beyond fit"
            ),
        ),
    ];
    for p in &result.points {
        let number =
            |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.4}"));
        table.push((
            "",
            format!(
                "N = {:<4}{:<11}{:>8}{:>16}{:>16}{:>16}{:>10}{:>14}{:>14}",
                p.n,
                p.law,
                number(p.lever_arm),
                with_error(p.strehl, p.strehl_se),
                with_error(p.variance_rad2, p.variance_se),
                with_error(p.beyond_fit_rad2, p.beyond_fit_se),
                number(p.expected_rad2),
                with_error(p.ratio, p.ratio_se),
                with_error(p.ratio_beyond_fit, p.ratio_beyond_fit_se),
            ),
        ));
    }
    table
}
