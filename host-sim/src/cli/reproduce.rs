//! The arguments of `host-sim reproduce`.

use super::{OutputArgs, subapertures};
use clap::{Args, value_parser};
use std::path::PathBuf;

/// `host-sim reproduce`.
///
/// Both figures of the paper (Butterley et al. 2006): what each sensor can sense by radial order, section 3, and
/// the Strehl ratio against D/r0, section 4, with the error budget, all tables, and a page that explains them and
/// says where they differ from the paper's text. A screen that is finished is kept and not run again.
#[derive(Clone, Debug, Args)]
pub struct ReproduceArgs {
    /// 30 screens for each N: one to two minutes on two cores [this is the default]
    #[arg(long, conflicts_with = "full")]
    pub(crate) quick: bool,
    /// 150 screens for N up to 12, 50 for 16
    #[arg(long)]
    pub(crate) full: bool,
    /// Instrument description (TOML), laid over the default one; its layers are held still
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// Subapertures across the pupil, of the same size, 4 to 40
    #[arg(
        long,
        value_name = "N",
        default_value = "4,6,8,10,12,16",
        value_parser = subapertures(),
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) n: Vec<usize>,
    /// Independent screens for each N, in place of 30, or of 150 and 50
    #[arg(
        long,
        value_name = "SCREENS",
        value_parser = value_parser!(u32).range(2..=10_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) screens: Option<u32>,
    /// Seed of turbulence
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    /// Start even if it takes more than a day
    #[arg(long)]
    pub(crate) long: bool,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}
