//! `host-sim scale`: sensors and control laws against D/r0, to extremely large telescopes.

mod plan;
mod results;

use super::campaign::Campaign;
use super::{output, progress};
use crate::cli::ScaleArgs;
use crate::error::Error;
use crate::files::lock::Lock;
use plan::Plan;
use std::time::Instant;

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &ScaleArgs) -> Result<(), Error> {
    let start = Instant::now();
    let Plan { points, curves } = Plan::new(args)?;
    let directory = output::directory(args.kept.output.out.as_deref(), "scale")?;
    let _lock = Lock::take(&directory, "host-sim scale")?;
    let mut campaign = Campaign::of_cases(&directory, points)?;
    let estimate = campaign.estimate(args.kept.long)?;
    progress::say(&format!("{}: about {estimate}", campaign.asked()));
    campaign.run()?;
    let result = results::gather(&campaign, &curves);
    results::write(&directory, &campaign, &curves, &result, args.kept.seed)?;
    let mut table = results::table(&result);
    table.push(("screens", format!("{}, frozen, seed {}", campaign.screens(), args.kept.seed)));
    table.push(("estimate", estimate));
    output::finish(&args.kept.output, start, &directory, &result, table)
}
