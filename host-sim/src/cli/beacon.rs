//! Arguments of the studies of beacons and beams.

use super::{DescriptionArgs, KeptArgs, OutputArgs, screens, subapertures};
use clap::{Args, ValueEnum, value_parser};

/// A kind of beacon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BeaconName {
    /// Air: laser, height and pulses of the description.
    Rayleigh,
    /// Sodium: 589.159 nm, the middle of the layer, a pulse a frame of 1 ms.
    Sodium,
}

impl BeaconName {
    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rayleigh => "rayleigh",
            Self::Sodium => "sodium",
        }
    }
}

/// `host-sim power`.
///
/// Photo-electrons from the lidar equation (the description's table photons), images through detector and firmware
/// with their noise, frozen screens that are the same for all powers and for the loop without noise. The gate's
/// depth is given in depths of focus of the whole telescope, lambda H^2 / (d D): the slab is simulated in as many
/// slices as its blur asks for. Spots are relayed edge to edge: none falls into another's window.
#[derive(Clone, Debug, Args)]
pub struct PowerArgs {
    #[command(flatten)]
    pub(crate) description: DescriptionArgs,
    /// Subapertures across the pupil, 4 to 40 [default: the description's, 8]
    #[arg(long, value_name = "N", value_parser = subapertures(), allow_negative_numbers = true)]
    pub(crate) n: Option<usize>,
    /// Beacons
    #[arg(long, value_enum, default_value = "rayleigh,sodium", value_delimiter = ',')]
    pub(crate) beacons: Vec<BeaconName>,
    /// Mean powers of the laser, W, shared by all spots
    #[arg(
        long,
        value_name = "W",
        default_value = "10,20,40,80,160,320,640",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) powers: Vec<f64>,
    /// Depth of the gate in depths of focus, 0.01 to 10
    #[arg(long, value_name = "DEPTHS", default_value_t = 1.0, allow_negative_numbers = true)]
    pub(crate) depth: f64,
    /// Independent screens
    #[arg(
        long,
        value_name = "SCREENS",
        default_value_t = 12,
        value_parser = screens(),
        allow_negative_numbers = true
    )]
    pub(crate) screens: u32,
    /// Frames averaged for each screen, after 40 to settle
    #[arg(
        long,
        value_name = "FRAMES",
        default_value_t = 20,
        value_parser = value_parser!(u32).range(1..=1_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) frames: u32,
    /// Seed of turbulence and noise
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    /// Start even if it takes more than a day
    #[arg(long)]
    pub(crate) long: bool,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// `host-sim beam`.
///
/// Noise-free images of SPLASH, frozen screens, uniform beams and Gaussian ones of each waist; the fit beside them
/// is the best that segments of that size can do. N stays, so that larger subapertures make a larger telescope.
#[derive(Clone, Debug, Args)]
pub struct BeamArgs {
    #[command(flatten)]
    pub(crate) description: DescriptionArgs,
    /// Subapertures across the pupil, 4 to 40 [default: the description's, 8]
    #[arg(long, value_name = "N", value_parser = subapertures(), allow_negative_numbers = true)]
    pub(crate) n: Option<usize>,
    /// Sides of a subaperture in r0, 0.1 to 4
    #[arg(
        long,
        value_name = "R0",
        default_value = "1,2,3",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) pitches: Vec<f64>,
    /// 1/e^2 radii of the intensity in sides of a subaperture, 0.2 to 10
    #[arg(
        long,
        value_name = "PITCHES",
        default_value = "0.25,0.35,0.5,0.7,1",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) waists: Vec<f64>,
    /// Independent screens
    #[arg(
        long,
        value_name = "SCREENS",
        default_value_t = 12,
        value_parser = screens(),
        allow_negative_numbers = true
    )]
    pub(crate) screens: u32,
    #[command(flatten)]
    pub(crate) kept: KeptArgs,
}
