//! `host-sim gates`: what a second gate does for SPLASH, beside one gate and guide stars under the same screens.

mod results;

use super::strehl::{MOVING_FRAMES, SETTLE, STATIC_FRAMES, set_wind};
use super::{increasing, output, progress};
use crate::cli::GatesArgs;
use crate::closed_loop::Sensing;
use crate::error::Error;
use crate::instrument::Instrument;
use crate::monte_carlo::gates::{Contender, Contest, View};
use crate::monte_carlo::point::{Conditions, Outcome, Point};
use crate::range_diversity::design::{Design, Purpose};
use crate::range_diversity::law::Law;
use rayon::prelude::*;
use std::time::Instant;

/// What was run.
struct Measured {
    point: Point,
    contenders: Vec<Contender>,
    /// Variance beyond the fitting error by theory, rad^2, of each contender that has a law by design.
    expected: Vec<Option<f64>>,
    /// `[screen][contender]`.
    outcomes: Vec<Vec<Outcome>>,
}

/// How it was run.
struct Terms {
    gate_height_m: f64,
    /// Of the gate at H and of the second one.
    noise_rad: [f64; 2],
    screens: u32,
    seed: u64,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &GatesArgs) -> Result<(), Error> {
    let start = Instant::now();
    let description = description(args)?;
    let beacon_m = description.laser.beacon_height_m;
    let terms = Terms {
        gate_height_m: match description.second_gate.height_m {
            0.0 => beacon_m / 2.0,
            height_m => height_m,
        },
        noise_rad: description.second_gate.slope_noise_rad,
        screens: args.screens,
        seed: args.seed,
    };
    let moving = args.wind.is_some_and(|wind| wind > 0.0);
    let conditions = Conditions {
        sensing: Sensing::Geometric,
        noise_free: true,
        // By gradients and at a gain of 0.5, to 1e-12 of what it began with.
        settle: SETTLE,
        frames: args.frames.unwrap_or(if moving { MOVING_FRAMES } else { STATIC_FRAMES }),
        seed: args.seed,
    };
    let directory = output::directory(args.output.out.as_deref(), "gates")?;
    let across = increasing(&args.n, Ord::cmp);
    let points: Vec<Point> = across
        .into_iter()
        .map(|n| Point::new(&description, n, conditions))
        .collect::<Result<_, _>>()?;
    let mut all = Vec::new();
    for point in points {
        let (contenders, expected) = contenders(&point, &terms, &args.modes)?;
        let outcomes = measure(&point, &contenders, &terms)?;
        all.push(Measured { point, contenders, expected, outcomes });
    }
    let result = results::gather(&all, &terms)?;
    let files = results::write(&directory, &all, &result, &terms)?;
    let mut table = results::table(&result);
    table.push(("time", format!("{:.1} s", start.elapsed().as_secs_f64())));
    table.push(("files", format!("{} in {}", files.join(", "), directory.display())));
    output::report(args.output.json, &result, &table)
}

/// The instrument with what the arguments change.
fn description(args: &GatesArgs) -> Result<Instrument, Error> {
    let mut description = args.description.load()?;
    set_wind(&mut description, args.wind.unwrap_or(0.0))?;
    match args.slope_noise[..] {
        [both] => description.second_gate.slope_noise_rad = [both; 2],
        [first, second] => description.second_gate.slope_noise_rad = [first, second],
        _ => {}
    }
    description.check()?;
    Ok(description)
}

/// One gate with f = 1 and with the best f, two gates with the modes asked for, guide stars and fit; beside each, the
/// variance that is expected.
fn contenders(
    point: &Point,
    terms: &Terms,
    modes: &[usize],
) -> Result<(Vec<Contender>, Vec<Option<f64>>), Error> {
    let instrument = point.instrument();
    let purpose = Purpose::of(instrument, terms.gate_height_m, terms.noise_rad);
    // Designs are at the laser's wavelength.
    let ratio = instrument.laser.wavelength_m / instrument.science.wavelength_m;
    let seen = |rad2: f64| Some(rad2 * ratio * ratio);
    let named = |name: &str, view, law| Contender { name: name.into(), view, law };
    let mut all = Vec::new();
    for count in increasing(&[modes, &[0]].concat(), Ord::cmp) {
        let bar = progress::share(format!("{count} modes"));
        let moved = |done: f64| bar.set_position((1000.0 * done) as u64);
        let design = Design::new(point.pupil(), &purpose, count, &moved)?;
        bar.finish_and_clear();
        let law = Law::from(&design);
        if count == 0 {
            let null = named("splash", View::Splash, Law::scalar(1.0));
            all.push((null, seen(design.null_seeking_rad2)));
            all.push((named("splash_f", View::Splash, law), seen(design.residual_rad2)));
        } else {
            let name = format!("gates_{count}");
            all.push((named(&name, View::Splash, law), seen(design.residual_rad2)));
        }
    }
    for (name, view) in [("lgs", View::Lgs), ("ngs", View::Ngs), ("fit", View::Fit)] {
        all.push((named(name, view, Law::scalar(1.0)), None));
    }
    Ok(all.into_iter().unzip())
}

/// All screens, each on one thread or as many as there are: the same outcomes.
fn measure(
    point: &Point,
    contenders: &[Contender],
    terms: &Terms,
) -> Result<Vec<Vec<Outcome>>, Error> {
    let contest = Contest::new(point, contenders, terms.gate_height_m, terms.noise_rad)?;
    let bar = progress::bar(terms.screens.into(), "screens", "screens");
    let one = |screen| {
        let outcomes = contest.run(screen);
        bar.inc(1);
        outcomes
    };
    let all = (0..terms.screens).into_par_iter().map(one).collect();
    bar.finish_and_clear();
    all
}
