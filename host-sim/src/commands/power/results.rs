//! The results of `host-sim power` as a table, JSON, CSV, FITS and a figure.

use super::Study;
use crate::commands::campaign::{Campaign, Task};
use crate::commands::output;
use crate::error::Error;
use crate::figures::{Measured, error_bars};
use crate::files::csv::SeriesWriter;
use crate::files::fits::{FitsWriter, Header};
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::statistics::Mean;
use serde::Serialize;
use std::path::Path;

/// Part of the Strehl ratio without noise that the power asked for has to give.
const SHARE: f64 = 0.9;
/// Of the beacons in the figure.
const COLOURS: [&str; 2] = ["#228833", "#ee7733"];

/// The JSON.
#[derive(Debug, Serialize)]
pub(super) struct PowerResult {
    n: usize,
    screens: u32,
    beacons: Vec<BeaconResult>,
}

#[derive(Debug, Serialize)]
struct BeaconResult {
    beacon: &'static str,
    wavelength_m: f64,
    height_m: f64,
    gate_depth_m: f64,
    /// Without noise.
    strehl: f64,
    strehl_se: f64,
    points: Vec<PowerPoint>,
    /// Least power, by linear interpolation in its logarithm, for 90 % of the Strehl ratio without noise; null
    /// if the powers do not reach from below to above it.
    power_90_w: Option<f64>,
    power_90_se_w: Option<f64>,
}

#[derive(Debug, Serialize)]
struct PowerPoint {
    power_w: f64,
    electrons_per_spot: f64,
    strehl: f64,
    strehl_se: f64,
    /// Why there is no Strehl ratio: spots that do not follow their segments; else null.
    refused: Option<String>,
    /// Strehl ratio less 90 % of that without noise, under the same screens.
    margin: f64,
    margin_se: f64,
}

/// Means, and where they pass 90 %.
pub(super) fn gather(campaign: &Campaign, studies: &[Study], powers_w: &[f64]) -> PowerResult {
    let tasks = campaign.tasks.chunks(powers_w.len() + 1);
    let beacons = studies.iter().zip(tasks).map(|(study, tasks)| beacon(study, tasks, powers_w));
    let first = &campaign.tasks[0];
    PowerResult { n: first.point.n(), screens: first.screens, beacons: beacons.collect() }
}

fn beacon(study: &Study, tasks: &[Task], powers_w: &[f64]) -> BeaconResult {
    let strehl = |task: &Task| task.values(Comparator::Splash, |outcome| outcome.strehl);
    let free = strehl(&tasks[0]);
    let enough: Vec<f64> = free.iter().map(|strehl| SHARE * strehl).collect();
    let Mean { mean, standard_error } = Mean::of(&free);
    let points: Vec<PowerPoint> = tasks[1..]
        .iter()
        .zip(powers_w)
        .zip(&study.electrons)
        .map(|((task, &power_w), &electrons_per_spot)| {
            let values = strehl(task);
            let (all, above) = (Mean::of(&values), Mean::of_differences(&values, &enough));
            PowerPoint {
                power_w,
                electrons_per_spot,
                strehl: all.mean,
                strehl_se: all.standard_error,
                refused: task.refused.clone(),
                margin: above.mean,
                margin_se: above.standard_error,
            }
        })
        .collect();
    let (power, error) = crossing(&points).unzip();
    let laser = &study.instrument.laser;
    BeaconResult {
        beacon: study.beacon.name(),
        wavelength_m: laser.wavelength_m,
        height_m: laser.beacon_height_m,
        gate_depth_m: laser.gate_depth_m,
        strehl: mean,
        strehl_se: standard_error,
        points,
        power_90_w: power,
        power_90_se_w: error,
    }
}

/// The power at which the margin's last rise passes zero, and its error: that of the margins over their slope.
fn crossing(points: &[PowerPoint]) -> Option<(f64, f64)> {
    let pair =
        points.windows(2).rev().find(|pair| pair[0].margin < 0.0 && pair[1].margin >= 0.0)?;
    let logs = [pair[0].power_w.ln(), pair[1].power_w.ln()];
    let slope = (pair[1].margin - pair[0].margin) / (logs[1] - logs[0]);
    let power_w = (logs[0] - pair[0].margin / slope).exp();
    let margin_se = pair[0].margin_se.max(pair[1].margin_se);
    Some((power_w, power_w * margin_se / slope))
}

/// `power.csv`, `power.fits` and `power.svg`.
pub(super) fn write(
    directory: &Path,
    campaign: &Campaign,
    result: &PowerResult,
    seed: u64,
) -> Result<(), Error> {
    write_csv(&directory.join("power.csv"), result)?;
    write_fits(&directory.join("power.fits"), campaign, result, seed)?;
    draw(&directory.join("power.svg"), result)
}

/// One line a power: photo-electrons, Strehl ratio and its error for each beacon.
fn write_csv(path: &Path, result: &PowerResult) -> Result<(), Error> {
    let of = |b: &BeaconResult| {
        ["_electrons", "_strehl", "_strehl_se", "_margin_90", "_margin_90_se"]
            .map(|end| b.beacon.to_string() + end)
    };
    let columns: Vec<String> =
        ["power_w".to_string()].into_iter().chain(result.beacons.iter().flat_map(of)).collect();
    let mut file = SeriesWriter::create(path, &columns)?;
    for (index, power_w) in powers_w(result).into_iter().enumerate() {
        let mut line = vec![power_w];
        for beacon in &result.beacons {
            let p = &beacon.points[index];
            line.extend([p.electrons_per_spot, p.strehl, p.strehl_se, p.margin, p.margin_se]);
        }
        file.push(&line)?;
    }
    Ok(file.finish()?)
}

/// STREHL (screen, without noise and by power, beacon), POWER and ELECTRONS (power, beacon).
fn write_fits(
    path: &Path,
    campaign: &Campaign,
    result: &PowerResult,
    seed: u64,
) -> Result<(), Error> {
    let strehl = |task: &Task| task.values(Comparator::Splash, |outcome| outcome.strehl);
    let values: Vec<f64> = campaign.tasks.iter().flat_map(strehl).collect();
    let powers_w = powers_w(result);
    let header = Header::new()
        .with("ORIGIN", "host-sim", "SPLASH simulator")
        .with("NSUB", result.n as i64, "subapertures across the pupil")
        .with("SEED", seed.to_string(), "seed of turbulence and noise");
    let names = result.beacons.iter().map(|beacon| beacon.beacon);
    let header = output::along(header, 3, "BEACON", names);
    let shape = [result.screens as usize, powers_w.len() + 1, result.beacons.len()];
    let points = result.beacons.iter().flat_map(|beacon| &beacon.points);
    let electrons: Vec<f64> = points.map(|point| point.electrons_per_spot).collect();
    let mut file = FitsWriter::create(path)?;
    file.image("STREHL", &shape, &header, &values)?;
    let watts = Header::new().with("BUNIT", "W", "mean power of the laser");
    file.image("POWER", &[powers_w.len()], &watts, &powers_w)?;
    let unit = Header::new().with("BUNIT", "electron", "per spot and frame");
    file.image("ELECTRONS", &[powers_w.len(), result.beacons.len()], &unit, &electrons)?;
    Ok(file.finish()?)
}

/// Strehl ratio against the logarithm of the power, with a line at 90 % of that without noise for each beacon.
fn draw(path: &Path, result: &PowerResult) -> Result<(), Error> {
    let x: Vec<f64> = powers_w(result).iter().map(|power| power.log10()).collect();
    let mut curves = Vec::new();
    for (beacon, colour) in result.beacons.iter().zip(COLOURS.into_iter().cycle()) {
        let y: Vec<f64> = beacon.points.iter().map(|point| point.strehl).collect();
        let error: Vec<f64> = beacon.points.iter().map(|point| point.strehl_se).collect();
        curves.push(Measured { name: beacon.beacon.into(), colour, y, error });
        let name = format!("90 % without noise, {}", beacon.beacon);
        curves.push(Measured::level(name, SHARE * beacon.strehl, x.len()));
    }
    let title = format!("SPLASH, N = {}, {} screens", result.n, result.screens);
    Ok(error_bars(path, ["log10 of the laser's power (W)", "Strehl ratio"], &title, &x, &curves)?)
}

fn powers_w(result: &PowerResult) -> Vec<f64> {
    let first = result.beacons.first();
    first.map_or(vec![], |beacon| beacon.points.iter().map(|point| point.power_w).collect())
}

/// The table: a line a beacon and power, then the least powers.
pub(super) fn table(result: &PowerResult) -> Vec<(&'static str, String)> {
    let mut table = Vec::new();
    for beacon in &result.beacons {
        let BeaconResult { beacon: name, height_m, gate_depth_m, strehl, strehl_se, .. } = beacon;
        table.push((
            "beacon",
            format!(
                "{name}, {:.1} km, gate {gate_depth_m:.0} m; without noise {strehl:.4} +- \
                 {strehl_se:.4}",
                height_m / 1e3
            ),
        ));
        for p in &beacon.points {
            let found = match p.refused {
                Some(_) => "cannot be calibrated".to_string(),
                None => format!("{:.4} +- {:.4}", p.strehl, p.strehl_se),
            };
            let light = format!("{:>6} W {:>8.0} electrons", p.power_w, p.electrons_per_spot);
            table.push(("", format!("{light} {found}")));
        }
    }
    for beacon in &result.beacons {
        let words = match (beacon.power_90_w, beacon.power_90_se_w) {
            (Some(power), Some(error)) => format!("{power:.0} +- {error:.0} W"),
            _ => "not between the powers tried".to_string(),
        };
        table.push(("least power for 90 %", format!("{}: {words}", beacon.beacon)));
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(power_w: f64, margin: f64) -> PowerPoint {
        let (strehl, strehl_se, electrons_per_spot, margin_se) = (0.5, 0.01, 1.0, 0.01);
        let refused = None;
        PowerPoint { power_w, electrons_per_spot, strehl, strehl_se, refused, margin, margin_se }
    }

    /// Margins that are linear in ln P: a ln(P / P0) passes zero at P0, with the error P0 se / a.
    #[test]
    fn powers_are_interpolated_in_their_logarithm() {
        let line = |power: f64| point(power, 0.1 * (power / 30.0).ln());
        let (power, error) = crossing(&[line(10.0), line(20.0), line(80.0)]).unwrap();
        assert!((power - 30.0).abs() < 1e-9, "{power}");
        assert!((error - 30.0 * 0.01 / 0.1).abs() < 1e-9, "{error}");
        assert!(crossing(&[line(40.0), line(80.0)]).is_none());
        assert!(crossing(&[line(10.0), line(20.0)]).is_none());
    }
}
