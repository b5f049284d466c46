//! The arguments of `host-sim reproduce`.

use super::{KeptArgs, StillArgs, screens, subapertures};
use clap::Args;

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
    #[command(flatten)]
    pub(crate) description: StillArgs,
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
        value_parser = screens(),
        allow_negative_numbers = true
    )]
    pub(crate) screens: Option<u32>,
    #[command(flatten)]
    pub(crate) kept: KeptArgs,
}
