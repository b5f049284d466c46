//! `host-sim faults`: the fault campaign.

use super::{output, progress};
use crate::cli::FaultsArgs;
use crate::error::Error;
use crate::fault_campaign::{FaultCampaign, Line, Memory};
use crate::reconstructor::Reconstructor;
use serde::Serialize;
use std::time::Instant;

/// The JSON of `host-sim faults`.
#[derive(Debug, Serialize)]
struct FaultsResult {
    count: u64,
    frames: u64,
    seed: u64,
    mishaps: Vec<Line>,
    digest: String,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &FaultsArgs) -> Result<(), Error> {
    let mut instrument = args.description.load()?.of_one_gate()?;
    instrument.check()?;
    // Faults come by the thousand: a loop that is given up only after a second would never be.
    instrument.safety.safe_frames = instrument.safety.safe_frames.min(args.safe_frames);
    let reconstructor = Reconstructor::new(&instrument)?;
    let directory = output::directory(args.output.out.as_deref(), "faults")?;

    let start = Instant::now();
    let mut memory = Memory::default();
    let bar = progress::bar(args.count, "faults", "faults");
    let mut campaign = FaultCampaign::new(&mut memory, &instrument, &reconstructor, args.seed)?;
    for _ in 0..args.count {
        campaign.step()?;
        bar.inc(1);
    }
    campaign.settle()?;
    bar.finish_and_clear();

    let result = FaultsResult {
        count: args.count,
        frames: campaign.frames(),
        seed: args.seed,
        mishaps: campaign.lines(),
        digest: campaign.digest(),
    };
    output::records(&directory.join("faults.csv"), &result.mishaps)?;
    let head = "      count  followed      held    leaked     ended  closed again within";
    let mut table = vec![("mishap", head.to_string())];
    let names: Vec<String> =
        result.mishaps.iter().map(|line| format!("{:?}", line.mishap)).collect();
    for (line, name) in result.mishaps.iter().zip(&names) {
        let Line { count, followed, held, leaked, ended, longest_recovery, .. } = line;
        let row = format!(
            "{count:>11} {followed:>9} {held:>9} {leaked:>9} {ended:>9}  {longest_recovery} frames"
        );
        table.push((name.as_str(), row));
    }
    table.extend([
        ("", String::new()),
        ("frames", format!("{}, after each of which everything held", result.frames)),
        ("time", format!("{:.1} s", start.elapsed().as_secs_f64())),
        ("digest", result.digest.clone()),
        ("files", directory.display().to_string()),
    ]);
    output::report(args.output.json, &result, &table)
}
