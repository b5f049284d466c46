//! The results of `host-sim scale` as a table, JSON, CSV, FITS and figures.

use super::plan::Curve;
use crate::commands::campaign::Campaign;
use crate::commands::{once, output};
use crate::error::Error;
use crate::figures::{Measured, error_bars_up_to};
use crate::files::csv::SeriesWriter;
use crate::files::fits::{FitsWriter, Header};
use crate::monte_carlo::point::Outcome;
use crate::monte_carlo::statistics::Mean;
use serde::Serialize;
use std::path::Path;

/// The JSON.
#[derive(Debug, Serialize)]
pub(super) struct ScaleResult {
    points: Vec<PointResult>,
    paired: Vec<PairResult>,
}

#[derive(Debug, Serialize)]
struct PointResult {
    n: usize,
    curve: String,
    /// f; null where there is no beacon.
    lever_arm: Option<f64>,
    screens: u32,
    strehl: f64,
    strehl_se: f64,
    variance_rad2: f64,
    variance_se: f64,
}

/// The difference a - b under the same screens.
#[derive(Debug, Serialize)]
struct PairResult {
    n: usize,
    a: String,
    b: String,
    screens: usize,
    strehl: f64,
    strehl_se: f64,
    variance_rad2: f64,
    variance_se: f64,
}

const STREHL: fn(&Outcome) -> f64 = |outcome| outcome.strehl;
const VARIANCE: fn(&Outcome) -> f64 = |outcome| outcome.variance_rad2;

/// Means and differences.
pub(super) fn gather(campaign: &Campaign, curves: &[Curve]) -> ScaleResult {
    let values = |curve: &Curve, of| campaign.tasks[curve.point].values(curve.case, of);
    let (mut points, mut paired) = (Vec::new(), Vec::new());
    for curve in curves {
        let (strehl, variance) = (values(curve, STREHL), values(curve, VARIANCE));
        let [s, v] = [Mean::of(&strehl), Mean::of(&variance)];
        points.push(PointResult {
            n: curve.n,
            curve: curve.name.clone(),
            lever_arm: curve.lever_arm,
            screens: strehl.len() as u32,
            strehl: s.mean,
            strehl_se: s.standard_error,
            variance_rad2: v.mean,
            variance_se: v.standard_error,
        });
        for other in &curve.against {
            let of = curves.iter().find(|o| o.n == curve.n && o.name == *other);
            let Some(of) = of else { continue };
            let (b_strehl, b_variance) = (values(of, STREHL), values(of, VARIANCE));
            // Screens of a point begin with the same ones, however many there are.
            let screens = strehl.len().min(b_strehl.len());
            let difference =
                |a: &[f64], b: &[f64]| Mean::of_differences(&a[..screens], &b[..screens]);
            let [s, v] = [difference(&strehl, &b_strehl), difference(&variance, &b_variance)];
            paired.push(PairResult {
                n: curve.n,
                a: curve.name.clone(),
                b: other.clone(),
                screens,
                strehl: s.mean,
                strehl_se: s.standard_error,
                variance_rad2: v.mean,
                variance_se: v.standard_error,
            });
        }
    }
    ScaleResult { points, paired }
}

impl ScaleResult {
    /// Sizes by increasing N.
    fn sizes(&self) -> Vec<usize> {
        let mut sizes: Vec<usize> = self.points.iter().map(|point| point.n).collect();
        sizes.dedup();
        sizes
    }

    /// Names of curves in the order in which they come.
    fn names(&self) -> Vec<&str> {
        once(self.points.iter().map(|point| point.curve.as_str()))
    }

    fn at(&self, n: usize, name: &str) -> Option<&PointResult> {
        self.points.iter().find(|point| point.n == n && point.curve == name)
    }
}

/// `scale.csv`, `differences.csv`, `scale.fits`, `strehl.svg` and `variance.svg`.
pub(super) fn write(
    directory: &Path,
    campaign: &Campaign,
    curves: &[Curve],
    result: &ScaleResult,
    seed: u64,
) -> Result<(), Error> {
    write_csv(&directory.join("scale.csv"), result)?;
    write_differences(&directory.join("differences.csv"), result)?;
    write_fits(&directory.join("scale.fits"), campaign, curves, result, seed)?;
    draw(directory, campaign, curves, result)
}

/// One line an N; NaN where a curve does not go.
fn write_csv(path: &Path, result: &ScaleResult) -> Result<(), Error> {
    let names = result.names();
    let ends = ["screens", "lever_arm", "strehl", "strehl_se", "variance_rad2", "variance_se"];
    let of = |name: &&str| ends.map(|end| format!("{name}_{end}"));
    let columns: Vec<String> =
        std::iter::once("n".to_string()).chain(names.iter().flat_map(of)).collect();
    let mut file = SeriesWriter::create(path, &columns)?;
    for n in result.sizes() {
        let mut line = vec![n as f64];
        for name in &names {
            line.extend(result.at(n, name).map_or([f64::NAN; 6], |point| {
                let PointResult { screens, lever_arm, .. } = point;
                [
                    f64::from(*screens),
                    lever_arm.unwrap_or(f64::NAN),
                    point.strehl,
                    point.strehl_se,
                    point.variance_rad2,
                    point.variance_se,
                ]
            }));
        }
        file.push(&line)?;
    }
    Ok(file.finish()?)
}

/// The same for differences.
fn write_differences(path: &Path, result: &ScaleResult) -> Result<(), Error> {
    let pairs = once(result.paired.iter().map(|p| (p.a.as_str(), p.b.as_str())));
    let ends = ["screens", "strehl", "strehl_se", "variance_rad2", "variance_se"];
    let of = |(a, b): &(&str, &str)| ends.map(|end| format!("{a}_minus_{b}_{end}"));
    let columns: Vec<String> =
        std::iter::once("n".to_string()).chain(pairs.iter().flat_map(of)).collect();
    let mut file = SeriesWriter::create(path, &columns)?;
    for n in result.sizes() {
        let mut line = vec![n as f64];
        for (a, b) in &pairs {
            let found = result.paired.iter().find(|p| p.n == n && p.a == *a && p.b == *b);
            line.extend(found.map_or([f64::NAN; 5], |pair| {
                let screens = pair.screens as f64;
                [screens, pair.strehl, pair.strehl_se, pair.variance_rad2, pair.variance_se]
            }));
        }
        file.push(&line)?;
    }
    Ok(file.finish()?)
}

/// STREHL and VARIANCE, screen by screen (screen, curve, N), NaN where there is none; N, the sizes of the third
/// axis. The curves' names are in the headers.
fn write_fits(
    path: &Path,
    campaign: &Campaign,
    curves: &[Curve],
    result: &ScaleResult,
    seed: u64,
) -> Result<(), Error> {
    let (names, sizes) = (result.names(), result.sizes());
    let most = campaign.tasks.iter().map(|task| task.screens as usize).max().unwrap_or(0);
    let header = |unit: &str| {
        let header = output::cards(unit).with("SEED", seed.to_string(), "seed of turbulence");
        output::along(header, 2, "CURVE", names.iter().copied())
    };
    let cube = |of: fn(&Outcome) -> f64| -> Vec<f64> {
        let mut cube = Vec::new();
        for &n in &sizes {
            for name in &names {
                let curve = curves.iter().find(|curve| curve.n == n && curve.name == *name);
                let values = curve.map(|curve| campaign.tasks[curve.point].values(curve.case, of));
                let mut values = values.unwrap_or_default();
                values.resize(most, f64::NAN);
                cube.extend(values);
            }
        }
        cube
    };
    let shape = [most, names.len(), sizes.len()];
    let across: Vec<i32> = sizes.iter().map(|&n| n as i32).collect();
    let mut file = FitsWriter::create(path)?;
    file.image("STREHL", &shape, &header(""), &cube(STREHL))?;
    file.image("VARIANCE", &shape, &header("rad2"), &cube(VARIANCE))?;
    file.image("N", &[across.len()], &Header::new(), &across)?;
    Ok(file.finish()?)
}

/// How a curve is drawn; those that are not, are in the tables.
fn style(name: &str) -> Option<(&'static str, &'static str)> {
    Some(match name {
        "splash" => ("SPLASH, f = 1", "#b3261e"),
        "splash_best" => ("SPLASH, best f", "#7b1fa2"),
        "lgs" => ("LGS, f = 1", "#4477aa"),
        "lgs_best" => ("LGS, best f", "#66ccee"),
        "ngs" => ("NGS", "#228833"),
        "fit" => ("fit", "#555555"),
        "images_splash" => ("images: SPLASH, f = 1", "#e07b39"),
        "images_splash_best" => ("images: SPLASH, best f", "#c77dbb"),
        _ => return None,
    })
}

/// Strehl ratio, and residual variance up to a radian squared or so, against D/r0.
fn draw(
    directory: &Path,
    campaign: &Campaign,
    curves: &[Curve],
    result: &ScaleResult,
) -> Result<(), Error> {
    let sizes = result.sizes();
    let ratio = |n: usize| {
        let curve = curves.iter().find(|curve| curve.n == n);
        curve.map_or(f64::NAN, |curve| campaign.tasks[curve.point].diameter_in_r0())
    };
    let x: Vec<f64> = sizes.iter().map(|&n| ratio(n)).collect();
    let column = |name: &str, of: fn(&PointResult) -> f64| -> Vec<f64> {
        sizes.iter().map(|&n| result.at(n, name).map_or(f64::NAN, of)).collect()
    };
    let title =
        format!("{}, frozen; exact gradients, and images as far as they go", campaign.screens());
    let names = result.names();
    let drawn: Vec<_> = names.iter().filter_map(|name| Some((*name, style(name)?))).collect();
    for (file, label, top, of, error) in [
        (
            "strehl.svg",
            "Strehl ratio",
            1.0,
            (|point| point.strehl) as fn(&PointResult) -> f64,
            (|point| point.strehl_se) as fn(&PointResult) -> f64,
        ),
        ("variance.svg", "residual variance (rad²)", 6.0, |p| p.variance_rad2, |p| p.variance_se),
    ] {
        let curve = |&(curve, (name, colour)): &(&str, (&str, &'static str))| Measured {
            name: name.into(),
            colour,
            y: column(curve, of),
            error: column(curve, error),
        };
        let curves: Vec<_> = drawn.iter().map(curve).collect();
        error_bars_up_to(directory.join(file), ["D / r0", label], &title, &x, &curves, top)?;
    }
    Ok(())
}

/// One line an N and curve, then one an N and pair.
pub(super) fn table(result: &ScaleResult) -> Vec<(&'static str, String)> {
    let mut table = Vec::new();
    let name = |first: bool, name: &'static str| if first { name } else { "" };
    for (index, point) in result.points.iter().enumerate() {
        let PointResult { n, curve, lever_arm, screens, .. } = point;
        let law = lever_arm.map_or_else(String::new, |f| format!(", f = {f:.4}"));
        table.push((
            name(index == 0, "Strehl ratio, variance"),
            format!(
                "N = {n:<3} {curve:<22} {:.4} +- {:.4}, {:.4} +- {:.4} rad^2, {screens} screens{law}",
                point.strehl, point.strehl_se, point.variance_rad2, point.variance_se
            ),
        ));
    }
    for (index, pair) in result.paired.iter().enumerate() {
        let PairResult { n, a, b, screens, .. } = pair;
        table.push((
            name(index == 0, "differences"),
            format!(
                "N = {n:<3} {a} - {b}: {:+.4} +- {:.4}, {:+.4} +- {:.4} rad^2, {screens} screens",
                pair.strehl, pair.strehl_se, pair.variance_rad2, pair.variance_se
            ),
        ));
    }
    table
}
