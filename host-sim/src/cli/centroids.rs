//! The arguments of `host-sim centroids`.

use super::{DescriptionArgs, OutputArgs, between, subapertures};
use clap::{Args, value_parser};

/// `host-sim centroids`.
///
/// SPLASH's spots are seen through all of the turbulence above the telescope: where that is not corrected on the
/// way back they are speckled, and what a threshold leaves of them is elsewhere than their gradient says. The
/// firmware's estimators on images of frozen screens, against exact gradients, with no correction (open), half of
/// it (half), all of it on the way up and none (launch), half (launch-half) or all (corrected) of it on the way
/// back.
#[derive(Clone, Debug, Args)]
pub struct CentroidsArgs {
    #[command(flatten)]
    pub(crate) description: DescriptionArgs,
    /// Subapertures across the pupil, of the same size, 4 to 40: D/r0 where the pitch is r0
    #[arg(
        long,
        value_name = "N",
        default_value = "4,6,8,12,16,24,32",
        value_parser = subapertures(),
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) n: Vec<usize>,
    /// Independent screens for each N
    #[arg(
        long,
        value_name = "SCREENS",
        default_value_t = 12,
        value_parser = value_parser!(u32).range(2..=1_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) screens: u32,
    /// Thresholds of the thresholded centre of gravity, parts of the peak, 0 to 0.9
    #[arg(
        long,
        value_name = "FRACTION",
        default_value = "0.02,0.1,0.3,0.5",
        value_parser = fraction,
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) peak_fractions: Vec<f64>,
    /// Photon, dark and read noise of the description's detector, and its bits
    #[arg(long)]
    pub(crate) noise: bool,
    /// Seed of turbulence and noise
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

fn fraction(text: &str) -> Result<f64, String> {
    between(text, 0.0, 0.9)
}
