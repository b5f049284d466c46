//! The arguments of `host-sim endure`.

use super::{BoardName, DescriptionArgs, OutputArgs, PatienceArgs, subapertures};
use clap::{Args, value_parser};

/// `host-sim endure`.
///
/// Gaussian spots move as drifting waves of changing seeing move them. Every frame has to move the
/// mirror; mean piston and tilt stay within a DAC LSB of zero; the totals are those counted here; on an
/// emulated board, least and most of a frame's cost are told.
#[derive(Clone, Debug, Args)]
pub struct EndureArgs {
    #[command(flatten)]
    pub(crate) description: DescriptionArgs,
    /// Where the firmware library runs
    #[arg(long, value_enum, default_value_t = BoardName::Host)]
    pub(crate) board: BoardName,
    /// Subapertures across the pupil, 4 to 40 [default: the description's, 8]
    #[arg(long, value_name = "N", value_parser = subapertures(), allow_negative_numbers = true)]
    pub(crate) n: Option<usize>,
    /// Frames to run; the default takes about two minutes
    #[arg(
        long,
        value_name = "FRAMES",
        default_value_t = 1_000_000,
        value_parser = value_parser!(u64).range(1..=4_000_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) frames: u64,
    /// Seed of waves and noise
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) patience: PatienceArgs,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}
