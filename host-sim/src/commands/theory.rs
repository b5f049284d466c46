//! `host-sim theory`: residual variance by radial order, in numbers and pictures.

mod results;

use super::{output, progress};
use crate::cli::TheoryArgs;
use crate::error::{Error, refuse};
use crate::instrument::Instrument;
use crate::theory::reconstructor::Degenerate;
use crate::theory::{BETAS, Layer, Reconstruction, Residuals, Theory, default_order};
use serde::Serialize;
use splash_firmware::geometry::Mask;
use std::path::Path;
use std::time::Instant;

/// The layer of the paper: at a quarter of the beacon's height.
const BETA: f64 = 0.75;
/// The arrays of the paper.
const ACROSS: [usize; 2] = [8, 12];

/// What is written.
const FILES: [&str; 4] = ["residuals.csv", "residuals.fits", "sensed.svg", "total.svg"];

/// The JSON of `host-sim theory`.
#[derive(Debug, Serialize)]
pub(super) struct TheoryResult {
    pub(super) arrays: Vec<ArrayResult>,
}

#[derive(Debug, Serialize)]
pub(super) struct ArrayResult {
    pub(super) n: usize,
    /// Null if there are several layers.
    pub(super) beta: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    layers: Option<Vec<Layer>>,
    #[serde(flatten)]
    pub(super) residuals: Residuals,
}

/// An array to compute.
struct Array {
    n: usize,
    subapertures: usize,
    layers: Vec<Layer>,
    theory: Theory,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &TheoryArgs) -> Result<(), Error> {
    let start = Instant::now();
    let arrays = arrays(args)?;
    let directory = output::directory(args.output.out.as_deref(), "theory")?;
    let result = compute(&arrays, &directory, args.reconstructor)?;
    let mut table: Vec<(&str, String)> = Vec::new();
    for (array, result) in arrays.iter().zip(&result.arrays) {
        table.push(("array", array.title()));
        table.extend(results::rows(&result.residuals).map(|row| ("", row)));
        if result.residuals.ngs.total.iter().any(|&total| total > 1.0) {
            let note =
                "a natural guide star adds to some orders: the pupil suits a lower --max-order";
            table.push(("note", note.into()));
        }
    }
    table.push(("reconstructor", in_words(args.reconstructor).into()));
    table.push(("time", format!("{:.2} s", start.elapsed().as_secs_f64())));
    table.push(("pictures and files", directory.display().to_string()));
    output::report(args.output.json, &result, &table)
}

/// The paper's arrays, computed and drawn: with the names of the files.
pub(super) fn paper(directory: &Path) -> Result<(TheoryResult, [&'static str; 4]), Error> {
    let array = |n: usize| {
        let mask = Mask::circle(n)?;
        let layers = vec![Layer { weight: 1.0, beta: BETA }];
        let order = default_order(n);
        let theory = Theory::new(&mask, order, &layers, Reconstruction::Mixed)
            .map_err(|error| refuse_order(order, n, mask.count(), error))?;
        Ok(Array { n, subapertures: mask.count(), layers, theory })
    };
    let arrays: Vec<Array> = ACROSS.into_iter().map(array).collect::<Result<_, Error>>()?;
    let result = compute(&arrays, directory, Reconstruction::Mixed)?;
    Ok((result, FILES))
}

/// Computes behind a bar, and writes [`FILES`].
fn compute(
    arrays: &[Array],
    directory: &Path,
    reconstruction: Reconstruction,
) -> Result<TheoryResult, Error> {
    let steps: usize = arrays.iter().map(|array| array.theory.steps()).sum();
    let bar = progress::bar(steps as u64, "theory", "matrices");
    let results = arrays.iter().map(|array| {
        let one = array.layers.len() == 1;
        ArrayResult {
            n: array.n,
            beta: one.then(|| array.layers[0].beta),
            layers: (!one).then(|| array.layers.clone()),
            residuals: array.theory.residuals(&mut || bar.inc(1)),
        }
    });
    let result = TheoryResult { arrays: results.collect() };
    bar.finish_and_clear();

    let [csv, fits, ..] = FILES;
    results::write_csv(&directory.join(csv), &result)?;
    results::write_fits(&directory.join(fits), &result, reconstruction)?;
    results::draw(directory, arrays, &result)?;
    Ok(result)
}

/// The arrays that the arguments ask for, checked before anything long begins.
fn arrays(args: &TheoryArgs) -> Result<Vec<Array>, Error> {
    let instrument = Instrument::described(args.config.as_deref())?;
    instrument.check()?;
    let across = match (&args.n[..], &args.config) {
        ([], None) => ACROSS.to_vec(),
        ([], Some(_)) => vec![instrument.telescope.subapertures],
        (given, _) => given.to_vec(),
    };
    if args.max_order.len() > 1 && args.max_order.len() != across.len() {
        let limit = format!("one order, or one for each of {} N", across.len());
        let given: Vec<_> = args.max_order.iter().map(usize::to_string).collect();
        return Err(refuse("--max-order", given.join(","), &limit));
    }
    let atmospheres = atmospheres(args, &instrument)?;
    let mut arrays = Vec::new();
    for (index, &n) in across.iter().enumerate() {
        let mask = mask(args, &instrument, n)?;
        let given = args.max_order.get(index).or(args.max_order.first()).copied();
        for layers in &atmospheres {
            let new = |order| Theory::new(&mask, order, layers, args.reconstructor);
            let order = given.unwrap_or_else(|| default_order(n));
            let theory = match (new(order), given) {
                // Few subapertures: as many orders as they tell apart.
                (Err(error), None) if error.highest >= 2 => new(error.highest),
                (theory, _) => theory,
            };
            let theory = theory.map_err(|error| refuse_order(order, n, mask.count(), error))?;
            arrays.push(Array { n, subapertures: mask.count(), layers: layers.clone(), theory });
        }
    }
    Ok(arrays)
}

fn refuse_order(order: usize, n: usize, subapertures: usize, error: Degenerate) -> Error {
    if error.highest < 2 {
        return refuse("telescope.pupil", subapertures, "subapertures enough for radial order 2");
    }
    let limit = format!(
        "at most {} with the {subapertures} subapertures of N = {n}: they do not tell higher radial \
         orders apart",
        error.highest
    );
    refuse("--max-order", order, &limit)
}

fn mask(args: &TheoryArgs, instrument: &Instrument, n: usize) -> Result<Mask, Error> {
    let mut instrument = instrument.clone();
    let telescope = &mut instrument.telescope;
    telescope.subapertures = n;
    telescope.obstruction = args.obstruction.unwrap_or(telescope.obstruction);
    match args.pupil {
        Some(rule) => Ok(rule.mask(n, telescope.obstruction)?),
        None => instrument.mask(),
    }
}

/// Sets of layers: one for each beta, or the layers named.
fn atmospheres(args: &TheoryArgs, instrument: &Instrument) -> Result<Vec<Vec<Layer>>, Error> {
    let single = |&beta: &f64| vec![Layer { weight: 1.0, beta }];
    if !args.beta.is_empty() {
        return Ok(args.beta.iter().map(single).collect());
    }
    if !args.layers.is_empty() {
        if args.layers.iter().all(|layer| layer.weight == 0.0) {
            return Err(refuse("--layers: sum of weights", 0, "above 0"));
        }
        return Ok(vec![args.layers.clone()]);
    }
    if args.config.is_none() {
        return Ok(vec![single(&BETA)]);
    }
    let beacon_m = instrument.laser.beacon_height_m;
    let layer = |(index, layer): (usize, &crate::atmosphere::Layer)| {
        let beta = 1.0 - layer.height_m / beacon_m;
        if !BETAS.contains(&beta) {
            let field = format!("atmosphere.layers[{index}].height_m");
            let highest_m = (1.0 - BETAS.start()) * beacon_m;
            let limit = format!("below {highest_m:.0}, 0.9 of laser.beacon_height_m");
            return Err(refuse(&field, layer.height_m, &limit));
        }
        Ok(Layer { weight: layer.weight, beta })
    };
    Ok(vec![instrument.layers().iter().enumerate().map(layer).collect::<Result<_, _>>()?])
}

impl Array {
    fn title(&self) -> String {
        format!("N = {}, {} subapertures, {}", self.n, self.subapertures, sky(&self.layers))
    }
}

impl ArrayResult {
    /// The beta, or the mean of several layers by weight.
    fn mean_beta(&self) -> f64 {
        self.beta.unwrap_or_else(|| {
            let layers = self.layers.iter().flatten();
            let sums = layers.fold([0.0, 0.0], |[beta, weight], layer| {
                [beta + layer.weight * layer.beta, weight + layer.weight]
            });
            sums[0] / sums[1]
        })
    }
}

/// The layers in a few words: up to three of them one by one.
fn sky(layers: &[Layer]) -> String {
    let short = |value: f64| (value * 1e4).round() / 1e4;
    match layers {
        [layer] => format!("beta = {}", short(layer.beta)),
        [_, _] | [_, _, _] => {
            let one = |layer: &Layer| format!("{}:{}", short(layer.weight), short(layer.beta));
            format!("weight:beta {}", layers.iter().map(one).collect::<Vec<_>>().join(", "))
        }
        _ => format!("{} layers", layers.len()),
    }
}

fn in_words(reconstruction: Reconstruction) -> &'static str {
    match reconstruction {
        Reconstruction::Mixed => "matched for SPLASH without the lever arm, nominal for all others",
        Reconstruction::Matched => "matched for SPLASH, nominal for the guide stars",
        Reconstruction::Nominal => "nominal",
    }
}
