//! `host-sim merge`: the parts of a Strehl run, joined.

use super::campaign::{Campaign, Progress};
use super::output;
use super::strehl::results::{self, StrehlResult};
use crate::cli::MergeArgs;
use crate::error::Error;
use crate::files::lock::Lock;
use crate::monte_carlo::settings::Settings;
use serde::Serialize;

/// The JSON.
#[derive(Debug, Serialize)]
struct MergeResult {
    /// Directories joined.
    parts: usize,
    /// What is there, by N.
    merged: Vec<Progress>,
    /// Screens that are in no part.
    missing: u32,
    /// An N without any screen is not in it.
    #[serde(flatten)]
    strehl: StrehlResult,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &MergeArgs) -> Result<(), Error> {
    let settings = Settings::common(&args.parts)?;
    let conditions = settings.conditions()?;
    let points = settings.points()?.into_iter().map(|point| (point, settings.screens())).collect();
    let directory = output::directory(args.output.out.as_deref(), "merge")?;
    let _lock = Lock::take(&directory, "host-sim merge")?;
    let mut campaign = Campaign::open(&directory, points, &settings.sensors()?, settings.budget())?;
    campaign.absorb(&args.parts)?;
    settings.write(&directory)?;
    let merged = campaign.progress();
    let missing = merged.iter().map(|point| point.missing).sum();
    if args.complete && missing > 0 {
        let of = merged.iter().filter(|point| point.missing > 0);
        let of = of.map(|point| format!("{} of N = {}", point.missing, point.n));
        let of = of.collect::<Vec<_>>().join(", ");
        return Err(Error::Run(format!("screens missing: {of}")));
    }
    campaign.tasks.retain(|task| !task.finished.is_empty());
    if campaign.tasks.is_empty() {
        return Err(Error::Run("no screen is finished in any part".into()));
    }
    let strehl = results::gather(&campaign);
    results::write(&directory, &campaign, &strehl, conditions.seed)?;
    let mut table = results::table(&campaign, &strehl);
    table.extend(results::progress(&merged));
    table.push(("missing", format!("{missing} screens")));
    table.push(("conditions", campaign.conditions()));
    table.push(("pictures and files", directory.display().to_string()));
    let result = MergeResult { parts: args.parts.len(), merged, missing, strehl };
    output::report(args.output.json, &result, &table)
}
