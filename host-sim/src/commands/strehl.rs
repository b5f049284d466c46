//! `host-sim strehl`: Strehl ratios over independent screens.

pub(super) mod budget;
pub(super) mod results;

use super::campaign::Campaign;
use super::output;
use crate::cli::{StrehlArgs, WindowsName};
use crate::closed_loop::Sensing;
use crate::error::{Error, refuse};
use crate::files::lock::Lock;
use crate::instrument::Instrument;
use crate::monte_carlo::point::{Conditions, Point};
use std::time::Instant;

/// Frames that a loop gets to close: at a gain of 0.5 and N/2 sweeps a frame, to 3e-4 in the Strehl
/// ratio of any frozen screen, 5e-5 in their mean (N = 8 and 16).
pub(super) const SETTLE: u32 = 40;
/// Frames averaged under frozen screens, and under moving ones.
pub(super) const STATIC_FRAMES: u32 = 10;
const MOVING_FRAMES: u32 = 100;
/// Fastest wind, pitches per frame.
const MAX_WIND: f64 = 10.0;

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &StrehlArgs) -> Result<(), Error> {
    let start = Instant::now();
    let points = points(args)?.into_iter().map(|point| (point, args.screens)).collect();
    let directory = output::directory(args.output.out.as_deref(), "strehl")?;
    let _lock = Lock::take(&directory, "host-sim strehl")?;
    let mut campaign = Campaign::open(&directory, points, &args.sensors, args.budget)?;
    let estimate = campaign.estimate(args.long)?;
    campaign.run()?;
    let result = results::gather(&campaign);
    results::write(&directory, &campaign, &result, args.seed)?;
    let mut table = results::table(&campaign, &result);
    let screens = format!("{} for each N, {}", args.screens, campaign.conditions());
    table.push(("screens", screens));
    table.push(("estimate", estimate));
    table.push(("time", format!("{:.1} s", start.elapsed().as_secs_f64())));
    table.push(("pictures and files", directory.display().to_string()));
    output::report(args.output.json, &result, &table)
}

/// The points that the arguments ask for, by increasing N, each once.
fn points(args: &StrehlArgs) -> Result<Vec<Point>, Error> {
    let mut description = Instrument::described(args.config.as_deref())?;
    let moving = args.wind.is_some();
    let pitch_m_per_s = description.telescope.pitch_m / description.frame_s();
    let speed = match args.wind {
        None => Some(0.0),
        Some(given) => given,
    };
    if let Some(wind) = speed {
        if !(0.0..=MAX_WIND).contains(&wind) {
            return Err(refuse("--wind", wind, &format!("from 0 to {MAX_WIND} pitches per frame")));
        }
        for layer in &mut description.atmosphere.layers {
            layer.wind_speed_m_per_s = wind * pitch_m_per_s;
        }
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
    let mut across = args.n.clone();
    across.sort_unstable();
    across.dedup();
    across.into_iter().map(|n| Point::new(&description, n, conditions)).collect()
}
