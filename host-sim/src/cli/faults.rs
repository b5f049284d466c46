//! The arguments of `host-sim faults`.

use super::{DescriptionArgs, OutputArgs};
use clap::{Args, value_parser};

/// `host-sim faults`.
///
/// A closed loop on a quick sky, in this process, through the controller that boards run; an operator
/// closes it again whenever it was given up. Looked at after every step: codes within limits and slew, state
/// within its formats, legal modes, counters that add up, recovery, and spots in place. The first thing
/// that does not hold ends the run.
#[derive(Clone, Debug, Args)]
pub struct FaultsArgs {
    #[command(flatten)]
    pub(crate) description: DescriptionArgs,
    /// Faults; the default takes one to two minutes
    #[arg(
        long,
        value_name = "FAULTS",
        default_value_t = 10_000,
        value_parser = value_parser!(u64).range(1..=100_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) count: u64,
    /// Bad frames one after the other after which the loop is given up, if the description says more
    #[arg(
        long,
        value_name = "FRAMES",
        default_value_t = 30,
        value_parser = value_parser!(u16).range(1..),
        allow_negative_numbers = true
    )]
    pub(crate) safe_frames: u16,
    /// Seed of faults, waves and noise
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}
