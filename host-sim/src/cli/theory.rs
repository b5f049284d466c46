//! The arguments of `host-sim theory`.

use super::{OutputArgs, layers, subapertures};
use crate::theory::{Layer, PupilRule, Reconstruction};
use clap::Args;
use clap::builder::RangedI64ValueParser;
use std::path::PathBuf;

/// `host-sim theory`.
///
/// Residual variance as a fraction of the variance, for SPLASH, a laser guide star and a natural
/// one, with and without the lever arm of high layers: `sensed`, of what the sensor would measure
/// without focal anisoplanatism, and `total`, of the wavefront, aliasing included. Exact, from the
/// covariances of Kolmogorov turbulence (Butterley et al. 2006, section 3); independent of r0.
#[derive(Clone, Debug, Args)]
pub struct TheoryArgs {
    /// Instrument description (TOML), laid over the default one: its layers, beacon height, pupil
    /// and subapertures
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// Subapertures across the pupil, 4 to 40, one array for each; 40 takes ten seconds or so, and
    /// 0.1 GB [default: the description's if one is given, else 8,12]
    #[arg(
        long,
        value_name = "N",
        value_parser = subapertures(),
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) n: Vec<usize>,
    /// 1 - height / beacon height of the only layer, 0.1 to 1, one array for each [default: the
    /// description's layers if one is given, else 0.75]
    #[arg(
        long,
        value_parser = layers::beta,
        value_delimiter = ',',
        conflicts_with = "layers",
        allow_negative_numbers = true
    )]
    pub(crate) beta: Vec<f64>,
    /// Several layers at once: share of the turbulence and beta of each, such as 0.6:1,0.4:0.75;
    /// shares are normalised
    #[arg(
        long,
        value_name = "WEIGHT:BETA",
        value_parser = layers::layer,
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) layers: Vec<Layer>,
    /// Highest radial order fitted, 2 to 40, one for all or one for each N [default: the smaller of
    /// 3N/4 + 1 and N/2 + 5, which is 7, 10 and 13 for N = 8, 12 and 16, or as many as the
    /// subapertures tell apart]
    #[arg(
        long,
        value_name = "ORDER",
        value_parser = RangedI64ValueParser::<usize>::new().range(2..=40),
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) max_order: Vec<usize>,
    /// Which squares of the grid are subapertures [default: the description's, circle]
    #[arg(long, value_name = "RULE", value_enum)]
    pub(crate) pupil: Option<PupilRule>,
    /// Central obstruction of an annulus, 0 to 0.99 of the diameter [default: the description's, 0]
    #[arg(long, value_name = "FRACTION", allow_negative_numbers = true)]
    pub(crate) obstruction: Option<f64>,
    /// SPLASH's reconstructor; guide stars have the nominal one
    #[arg(long, value_enum, default_value_t = Reconstruction::Mixed)]
    pub(crate) reconstructor: Reconstruction,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}
