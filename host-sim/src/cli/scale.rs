//! The arguments of `host-sim scale`.

use super::{KeptArgs, StillArgs, screens};
use crate::instrument::LeverArm;
use clap::Args;

/// `host-sim scale`.
///
/// Strehl ratio and residual variance against D/r0, under skies that stand still, with loops that have converged:
/// SPLASH and a laser guide star with each control law, a natural guide star and the best fit by exact gradients,
/// which need no images and reach 128 subapertures; images without noise through the firmware beside them as far
/// as they go, and what speckle, window and threshold add there. All under the same screens: differences are
/// paired. A screen that is finished is kept and not run again.
#[derive(Clone, Debug, Args)]
pub struct ScaleArgs {
    #[command(flatten)]
    pub(crate) description: StillArgs,
    /// Subapertures across the pupil, of the same size, 4 to 128: by exact gradients
    #[arg(
        long,
        value_name = "N",
        default_value = "4,8,16,24,32,48,64,96,128",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) n: Vec<usize>,
    /// Of these, those with images beside them, 4 to 40; none to go without [default: those of 8,16,32]
    #[arg(
        long,
        value_name = "N",
        value_delimiter = ',',
        num_args = 0..,
        allow_negative_numbers = true
    )]
    pub(crate) images: Option<Vec<usize>>,
    /// Control laws beside f = 1: numbers, profile or best, as lever_arm in [control]
    #[arg(long, value_name = "F", default_value = "profile,best", value_delimiter = ',')]
    pub(crate) lever_arm: Vec<LeverArm>,
    /// Independent screens for each N, in place of 200 up to N = 32, 100 up to 64 and 48 beyond
    #[arg(
        long,
        value_name = "SCREENS",
        value_parser = screens(),
        allow_negative_numbers = true
    )]
    pub(crate) screens: Option<u32>,
    /// The same for images, in place of 100 up to N = 8, 50 up to 16 and 16 beyond; never more than for gradients
    #[arg(
        long,
        value_name = "SCREENS",
        value_parser = screens(),
        allow_negative_numbers = true
    )]
    pub(crate) image_screens: Option<u32>,
    #[command(flatten)]
    pub(crate) kept: KeptArgs,
}
