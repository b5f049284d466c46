//! The arguments of `host-sim gates`.

use super::{DescriptionArgs, OutputArgs, subapertures};
use clap::{Args, value_parser};

/// `host-sim gates`.
///
/// One gate with the paper's null-seeking law and with the best number f, two gates combined in 12 and 25 modes,
/// laser and natural guide star and the best fit, under the same screens, with exact gradients in loops of double
/// precision. The combination is made for the description's layers, or for those of its second gate, which
/// is at half the beacon's height unless the description has one. `expected` is the residual variance beyond the
/// fitting error by theory; the rest is measured, with its standard error in brackets.
#[derive(Clone, Debug, Args)]
pub struct GatesArgs {
    #[command(flatten)]
    pub(crate) description: DescriptionArgs,
    /// Subapertures across the pupil, of the same size, 4 to 40
    #[arg(
        long,
        value_name = "N",
        default_value = "8,16",
        value_parser = subapertures(),
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) n: Vec<usize>,
    /// Modes in which two gates are combined: 12, 25
    #[arg(long, value_name = "MODES", default_value = "12,25", value_delimiter = ',')]
    pub(crate) modes: Vec<usize>,
    /// Independent screens for each N
    #[arg(
        long,
        value_name = "SCREENS",
        default_value_t = 30,
        value_parser = value_parser!(u32).range(1..=1_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) screens: u32,
    /// Rms noise of a slope, for each gate, axis and frame, rad of phase at the laser's wavelength from edge to edge of a
    /// subaperture: of both gates, or of the beacon's and of the second one; the combination is made for it [default:
    /// the description's, 0,0]
    #[arg(
        long,
        value_name = "RAD",
        num_args = 1..=2,
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) slope_noise: Vec<f64>,
    /// Moving screens: pitches per frame, of every layer in its direction [default: frozen screens]
    #[arg(long, value_name = "PITCHES", allow_negative_numbers = true)]
    pub(crate) wind: Option<f64>,
    /// Frames averaged for each screen [default: 10 if static, else 100], after 40 to settle
    #[arg(
        long,
        value_name = "FRAMES",
        value_parser = value_parser!(u32).range(1..=1_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) frames: Option<u32>,
    /// Seed of turbulence and noise
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}
