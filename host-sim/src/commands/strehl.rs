//! `host-sim strehl`: Strehl ratios over independent screens.

pub(super) mod budget;
pub(super) mod results;

use super::campaign::{Campaign, Progress};
use super::output;
use crate::cli::{StrehlArgs, WindowsName};
use crate::closed_loop::Sensing;
use crate::error::{Error, refuse};
use crate::files::lock::Lock;
use crate::instrument::Instrument;
use crate::monte_carlo::point::Conditions;
use crate::monte_carlo::settings::Settings;
use serde::Serialize;
use std::time::Instant;

/// Frames that a loop gets to close: at a gain of 0.5 and N/2 sweeps a frame, to 3e-4 in the Strehl
/// ratio of any frozen screen, 5e-5 in their mean (N = 8 and 16).
pub(in crate::commands) const SETTLE: u32 = 40;
/// Frames averaged under frozen screens, and under moving ones.
pub(super) const STATIC_FRAMES: u32 = 10;
pub(super) const MOVING_FRAMES: u32 = 100;
/// Fastest wind, pitches per frame.
const MAX_WIND: f64 = 10.0;

/// The JSON of a part of a run.
#[derive(Debug, Serialize)]
struct ShardResult {
    shard: String,
    /// Of this part.
    run: usize,
    /// Of the whole, what is in this directory.
    points: Vec<Progress>,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &StrehlArgs) -> Result<(), Error> {
    let start = Instant::now();
    let settings = settings(args)?;
    let points = settings.points()?.into_iter().map(|point| (point, args.screens)).collect();
    let directory = output::directory(args.output.out.as_deref(), "strehl")?;
    let _lock = Lock::take(&directory, "host-sim strehl")?;
    settings.of_shard(args.shard).write(&directory)?;
    let mut campaign =
        Campaign::open_part(&directory, points, &args.sensors, args.budget, args.shard)?;
    let estimate = campaign.estimate(args.long)?;
    let to_run = campaign.to_run();
    campaign.run()?;
    if let Some(shard) = args.shard {
        let points = campaign.progress();
        let result = ShardResult { shard: shard.to_string(), run: to_run, points };
        let mut table = results::progress(&result.points);
        table.push(("shard", format!("{shard}, {to_run} screens run")));
        table.push(("estimate", estimate));
        table.push(("time", format!("{:.1} s", start.elapsed().as_secs_f64())));
        table.push(("directory, for host-sim merge", directory.display().to_string()));
        return output::report(args.output.json, &result, &table);
    }
    let result = results::gather(&campaign);
    results::write(&directory, &campaign, &result, args.seed)?;
    let mut table = results::table(&campaign, &result);
    let screens = format!("{} for each N, {}", args.screens, campaign.conditions());
    table.push(("screens", screens));
    table.push(("estimate", estimate));
    output::finish(&args.output, start, &directory, &result, table)
}

/// What the arguments ask for.
fn settings(args: &StrehlArgs) -> Result<Settings, Error> {
    let mut description = args.description.load()?;
    if args.budget || args.sensing == Sensing::Geometric {
        // The steps of a budget and loops of double precision know one.
        description = description.of_one_gate()?;
    }
    let moving = args.wind.is_some();
    let speed = match args.wind {
        None => Some(0.0),
        Some(given) => given,
    };
    if let Some(wind) = speed {
        set_wind(&mut description, wind)?;
    }
    description.control.gain = args.gain.unwrap_or(description.control.gain);
    description.control.delay_frames = args.delay.unwrap_or(description.control.delay_frames);
    // Exact gradients have no noise, and no windows: a run is the same with the flags and without.
    let images = args.sensing == Sensing::Images;
    let usual = if args.noise { WindowsName::Described } else { WindowsName::Whole };
    if images && args.windows.unwrap_or(usual) == WindowsName::Whole {
        description = description.with_whole_spots();
    }
    let frames = args.frames.unwrap_or(if moving { MOVING_FRAMES } else { STATIC_FRAMES });
    let conditions = Conditions {
        sensing: args.sensing,
        noise_free: !args.noise || !images,
        settle: SETTLE,
        frames,
        seed: args.seed,
    };
    let StrehlArgs { n, screens, sensors, budget, .. } = args;
    Ok(Settings::new(description, n.clone(), *screens, sensors, *budget, conditions))
}

/// Gives all layers a wind, pitches per frame.
pub(super) fn set_wind(description: &mut Instrument, wind: f64) -> Result<(), Error> {
    if !(0.0..=MAX_WIND).contains(&wind) {
        return Err(refuse("--wind", wind, &format!("from 0 to {MAX_WIND} pitches per frame")));
    }
    let wind_speed_m_per_s = wind * (description.telescope.pitch_m / description.frame_s());
    for layer in &mut description.atmosphere.layers {
        layer.wind_speed_m_per_s = wind_speed_m_per_s;
    }
    Ok(())
}
