//! The results of `host-sim theory` as a table, CSV, FITS and figures.

use super::{Array, ArrayResult, FILES, TheoryResult};
use crate::commands::output;
use crate::error::Error;
use crate::figures::{Curve, Panel, panels};
use crate::files::csv::SeriesWriter;
use crate::files::fits::FitsWriter;
use crate::theory::{Fractions, Reconstruction, Residuals};
use clap::ValueEnum;
use std::path::Path;

const PLAIN: &str = "#000000";
const LEVER_ARM: &str = "#4477aa";
const FLOOR: &str = "#b3261e";
/// Names of the columns of [`columns`].
const COLUMNS: [&str; 9] = [
    "splash_sensed",
    "splash_total",
    "splash_lever_sensed",
    "splash_lever_total",
    "lgs_sensed",
    "lgs_total",
    "lgs_lever_sensed",
    "lgs_lever_total",
    "ngs_total",
];

/// All fractions of a result, in the order of [`COLUMNS`].
fn columns(residuals: &Residuals) -> [&[f64]; 9] {
    let Residuals { orders: _, splash, splash_lever, lgs, lgs_lever, ngs } = residuals;
    [
        &splash.sensed,
        &splash.total,
        &splash_lever.sensed,
        &splash_lever.total,
        &lgs.sensed,
        &lgs.total,
        &lgs_lever.sensed,
        &lgs_lever.total,
        &ngs.total,
    ]
}

/// The table of a result, line by line.
pub(super) fn rows(residuals: &Residuals) -> impl Iterator<Item = String> {
    let width = 10;
    let groups = ["SPLASH", "", "lever arm", "", "LGS", "", "lever arm", "", "NGS"];
    let kinds = COLUMNS.map(|name| name.rsplit('_').next().unwrap_or_default());
    let line = |first: &str, cells: [String; 9]| {
        let cells = cells.map(|cell| format!("{cell:>width$}")).concat();
        format!("{first:>5}{cells}")
    };
    let columns = columns(residuals);
    let numbers = residuals.orders.iter().enumerate().map(|(index, order)| {
        line(&order.to_string(), columns.map(|column| number(column[index])))
    });
    let head = [line("", groups.map(String::from)), line("order", kinds.map(String::from))];
    head.into_iter().chain(numbers.collect::<Vec<_>>())
}

/// Five digits behind the point, or four significant ones where a fit runs away.
fn number(value: f64) -> String {
    if value < 100.0 { format!("{value:.5}") } else { format!("{value:.3e}") }
}

/// One line a radial order. The beta of several layers is their mean by weight.
pub(super) fn write_csv(path: &Path, result: &TheoryResult) -> Result<(), Error> {
    let names = [&["n", "mean_beta", "radial_order"], &COLUMNS[..]].concat();
    let mut file = SeriesWriter::create(path, &names)?;
    for array in &result.arrays {
        let columns = columns(&array.residuals);
        for (index, &order) in array.residuals.orders.iter().enumerate() {
            let mut row = vec![array.n as f64, array.mean_beta(), order as f64];
            row.extend(columns.map(|column| column[index]));
            file.push(&row)?;
        }
    }
    Ok(file.finish()?)
}

/// One image an array: radial order along the rows, the columns of the table one after the other.
pub(super) fn write_fits(
    path: &Path,
    result: &TheoryResult,
    reconstruction: Reconstruction,
) -> Result<(), Error> {
    let reconstructor = reconstruction.to_possible_value();
    let reconstructor = reconstructor.map_or(String::new(), |value| value.get_name().into());
    let mut file = FitsWriter::create(path)?;
    for array in &result.arrays {
        let columns = columns(&array.residuals);
        let header = output::cards("fraction of the variance")
            .with("NSUB", array.n as i64, "subapertures across the pupil")
            .with("BETA", array.mean_beta(), "1 - height / beacon height, mean of layers")
            .with("RECONSTR", reconstructor.as_str(), "reconstructor of SPLASH")
            .with("CRPIX1", 1.0, "axis 1: radial order")
            .with("CRVAL1", 2.0, "first radial order")
            .with("CDELT1", 1.0, "");
        let header = output::along(header, 2, "ROW", COLUMNS);
        let shape = [array.residuals.orders.len(), columns.len()];
        file.image(&format!("N{}", array.n), &shape, &header, &columns.concat())?;
    }
    Ok(file.finish()?)
}

/// The paper's figure, and the same for the whole wavefront.
pub(super) fn draw(directory: &Path, arrays: &[Array], result: &TheoryResult) -> Result<(), Error> {
    let figure = |name: &str, y_label: &str, total: bool| {
        let both = arrays.iter().zip(&result.arrays);
        let all: Vec<_> = both.map(|(array, result)| panel(array, result, total)).collect();
        panels(directory.join(name), "radial order", y_label, &all)
    };
    let [.., sensed, whole] = FILES;
    figure(sensed, "residual / sensed variance", false)?;
    figure(whole, "residual / wavefront variance", true)?;
    Ok(())
}

fn panel<'a>(array: &Array, result: &'a ArrayResult, total: bool) -> Panel<'a> {
    let Residuals { orders, splash, splash_lever, lgs, lgs_lever, ngs } = &result.residuals;
    let curve = |name, colour, broken, fractions: &'a Fractions| Curve {
        name,
        colour,
        broken,
        y: if total { &fractions.total } else { &fractions.sensed },
    };
    let mut curves = vec![
        curve("SPLASH", PLAIN, false, splash),
        curve("LGS", PLAIN, true, lgs),
        curve("SPLASH, lever arm", LEVER_ARM, false, splash_lever),
        curve("LGS, lever arm", LEVER_ARM, true, lgs_lever),
    ];
    if total {
        curves.push(Curve { name: "NGS", colour: FLOOR, broken: false, y: &ngs.total });
    }
    Panel { title: array.title(), x: orders.iter().map(|&order| order as f64).collect(), curves }
}
