//! `host-sim reproduce`: the paper's two figures, the error budget, all tables, and a page about them.

mod html;
mod page;

use super::campaign::Campaign;
use super::strehl::results::{self, StrehlResult};
use super::strehl::{SETTLE, STATIC_FRAMES};
use super::theory::{self, TheoryResult};
use super::{increasing, output, progress};
use crate::cli::ReproduceArgs;
use crate::closed_loop::Sensing;
use crate::error::Error;
use crate::files::lock::Lock;
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::point::{Conditions, Point};
use serde::Serialize;
use std::time::Instant;

/// Screens for each N.
const QUICK: u32 = 30;
/// The same for N up to the largest of these, and beyond.
const FULL: u32 = 150;
const FULL_UP_TO: usize = 12;
const FULL_BEYOND: u32 = 50;
/// The page.
const PAGE: &str = "index.html";

/// The JSON.
#[derive(Debug, Serialize)]
struct ReproduceResult {
    directory: String,
    page: String,
    /// In the directory.
    files: Vec<String>,
    seed: u64,
    theory: TheoryResult,
    #[serde(flatten)]
    strehl: StrehlResult,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &ReproduceArgs) -> Result<(), Error> {
    let start = Instant::now();
    let points = points(args)?;
    let directory = output::directory(args.kept.output.out.as_deref(), "reproduce")?;
    let _lock = Lock::take(&directory, "host-sim reproduce")?;
    let mut campaign = Campaign::open(&directory, points, &Comparator::ALL, true)?;
    let estimate = campaign.estimate(args.kept.long)?;
    progress::say(&format!("{}: about {estimate}", campaign.asked()));
    let (theory, theory_files) = theory::paper(&directory)?;
    campaign.run()?;
    let strehl = results::gather(&campaign);
    let mut files = results::write(&directory, &campaign, &strehl, args.kept.seed)?;
    files.extend(theory_files);
    files.sort_unstable();
    let page = page::page(&directory, &campaign, &theory, &strehl, &files)?;
    std::fs::write(directory.join(PAGE), page)?;
    files.insert(0, PAGE);

    let mut table = results::table(&campaign, &strehl);
    table.push(("screens", format!("{}, {}", campaign.screens(), campaign.conditions())));
    table.push(("estimate", estimate));
    table.push(("time", format!("{:.1} s", start.elapsed().as_secs_f64())));
    let page = directory.join(PAGE).display().to_string();
    table.push(("page", page.clone()));
    let files = files.into_iter().map(String::from).collect();
    let directory = directory.display().to_string();
    let result = ReproduceResult { directory, page, files, seed: args.kept.seed, theory, strehl };
    output::report(args.kept.output.json, &result, &table)
}

/// The sizes of pupil by increasing N, each once, under skies that stand still and with images that have no noise.
fn points(args: &ReproduceArgs) -> Result<Vec<(Point, u32)>, Error> {
    let description = args.description.load()?.with_whole_spots();
    let conditions = Conditions {
        sensing: Sensing::Images,
        noise_free: true,
        settle: SETTLE,
        frames: STATIC_FRAMES,
        seed: args.kept.seed,
    };
    let screens = |n: usize| {
        args.screens.unwrap_or(match (args.full, n) {
            (false, _) => QUICK,
            (true, ..=FULL_UP_TO) => FULL,
            (true, _) => FULL_BEYOND,
        })
    };
    let across = increasing(&args.n, Ord::cmp);
    let point = |n| Ok((Point::new(&description, n, conditions)?, screens(n)));
    across.into_iter().map(point).collect()
}
