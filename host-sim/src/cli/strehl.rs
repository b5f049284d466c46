//! The arguments of `host-sim strehl` and `host-sim merge`.

use super::{DescriptionArgs, OutputArgs};
use crate::closed_loop::Sensing;
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::shard::Shard;
use clap::{Args, ValueEnum, value_parser};
use std::path::PathBuf;

/// `host-sim strehl`.
///
/// Each screen is a sky of its own; all sensors close their loop under the same ones. A frame's Strehl ratio
/// is that over the pupil with piston, tip and tilt removed, the mean is over frames and screens, its error
/// from the scatter of the screens. A screen that is finished is kept in the output directory and not run
/// again: an interrupted run takes up where it was, and a longer one adds to it.
#[derive(Clone, Debug, Args)]
pub struct StrehlArgs {
    #[command(flatten)]
    pub(crate) description: DescriptionArgs,
    /// Subapertures across the pupil, of the same size: 4 to 40, or to 128 with --sensing geometric
    #[arg(
        long,
        value_name = "N",
        default_value = "4,6,8,10,12,16",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) n: Vec<usize>,
    /// Independent screens for each N
    #[arg(
        long,
        value_name = "SCREENS",
        default_value_t = 30,
        value_parser = value_parser!(u32).range(1..=10_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) screens: u32,
    /// Frozen screens and a loop that has converged [this is the default]
    #[arg(long = "static", conflicts_with = "wind")]
    pub(crate) still: bool,
    /// Moving screens: pitches per frame, of every layer in its direction; without a value, the
    /// description's winds
    #[arg(long, value_name = "PITCHES", num_args = 0..=1, allow_negative_numbers = true)]
    pub(crate) wind: Option<Option<f64>>,
    /// Loop gain [default: the description's, 0.5]
    #[arg(long, value_name = "GAIN", allow_negative_numbers = true)]
    pub(crate) gain: Option<f64>,
    /// L, frames of delay beyond the one of any loop [default: the description's, 0]
    #[arg(long, value_name = "FRAMES", allow_negative_numbers = true)]
    pub(crate) delay: Option<u8>,
    /// Images through detector and firmware, or exact gradients in a loop of double precision
    #[arg(long, value_enum, default_value_t = Sensing::Images)]
    pub(crate) sensing: Sensing,
    /// What to compare; fit is the best piston, tip and tilt of each segment
    #[arg(long, value_enum, default_value = "splash,lgs,ngs,fit", value_delimiter = ',')]
    pub(crate) sensors: Vec<Comparator>,
    /// Frames averaged for each screen [default: 10 if static, else 100], after 40 to settle
    #[arg(
        long,
        value_name = "FRAMES",
        value_parser = value_parser!(u32).range(1..=1_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) frames: Option<u32>,
    /// Photon, dark and read noise of the description's detector, and its bits
    #[arg(long)]
    pub(crate) noise: bool,
    /// Detector without noise, with 16 bits over its range, as in the paper [this is the default]
    #[arg(long, conflicts_with = "noise")]
    pub(crate) noise_free: bool,
    /// What images have of a spot [default: whole without noise, described with noise]
    #[arg(long, value_enum)]
    pub(crate) windows: Option<WindowsName>,
    /// Seed of turbulence and noise
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    /// What the residual variance is made of: fitting, aliasing, cone, lever arm, return path, time,
    /// quantisation, images and noise, each switched on in turn under the same screens
    #[arg(long)]
    pub(crate) budget: bool,
    /// Run one part of n, such as 2/8, for host-sim merge to join: every part has its share of the screens
    /// of each N, and whatever the parts, the whole is the same to the last bit
    #[arg(long, value_name = "I/N", allow_negative_numbers = true)]
    pub(crate) shard: Option<Shard>,
    /// Start even if it takes more than a day
    #[arg(long)]
    pub(crate) long: bool,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// What images have of a spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum WindowsName {
    /// The description's windows, samples and threshold
    Described,
    /// Windows of at least 12 lambda/d, the samples that these take, and no part of the peak as threshold
    Whole,
}

/// `host-sim merge`.
///
/// Joins the directories of host-sim strehl --shard into one like that of a run on one machine, to the last bit.
/// Parts may be unfinished, or going on: what is missing is counted, and means are over the screens that are
/// there. Parts of other settings are refused. host-sim strehl with the same settings and the joined directory
/// as --out runs what is missing.
#[derive(Clone, Debug, Args)]
pub struct MergeArgs {
    /// Directories of parts
    #[arg(required = true, value_name = "DIR")]
    pub(crate) parts: Vec<PathBuf>,
    /// Fail if a screen is missing, and write no results
    #[arg(long)]
    pub(crate) complete: bool,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}
