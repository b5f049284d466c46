//! The command line.

mod beacon;
mod centroids;
mod crosstalk;
mod layers;
mod link;

use crate::board::{self, Board, BoardError, Options};
use crate::closed_loop::Sensing;
use crate::commands;
use crate::error::Error;
use crate::instrument::{EstimatorName, Instrument, LeverArm};
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::shard::Shard;
use crate::optics::geometric::Sensor;
use crate::theory::{Layer, PupilRule, Reconstruction};
use clap::builder::RangedI64ValueParser;
use clap::{Args, Parser, Subcommand, ValueEnum, value_parser};
use splash_firmware::geometry::{MAX_ACROSS, MIN_ACROSS};
use splash_firmware::modal::MAX_MODES;
use splash_firmware::spec::Spec;
use std::path::PathBuf;
use std::time::Duration;

pub use beacon::{BeaconName, BeamArgs, PowerArgs};
pub use centroids::CentroidsArgs;
pub use crosstalk::{CrosstalkArgs, Turns};
pub use link::{Action, LinkArgs, Place};

/// Simulates a SPLASH adaptive-optics system around the firmware library.
///
/// Without a command, closes the loop with the default instrument: numbers on the screen,
/// pictures, CSV and FITS in the output directory.
#[derive(Debug, Parser)]
#[command(name = "host-sim", version, args_conflicts_with_subcommands = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    closed_loop: LoopArgs,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Closes the loop through the firmware library.
    Loop(LoopArgs),
    /// Runs the loop and records every detector frame, with truth and configuration, as FITS.
    Frames(FramesArgs),
    /// Feeds recorded frames to the firmware library with the configuration found beside them.
    Replay(ReplayArgs),
    /// Measures what a frame costs on a board, stage by stage.
    Profile(ProfileArgs),
    /// Computes how much of each radial order of Zernike modes a sensor leaves uncorrected.
    Theory(TheoryArgs),
    /// Compares sensors over independent phase screens: the paper's Strehl ratios against D/r0.
    Strehl(StrehlArgs),
    /// Shows what a second gate, which images the spots on their way, does for SPLASH.
    Gates(GatesArgs),
    /// Compares centroids of images with exact gradients, with the return path corrected or not.
    Centroids(CentroidsArgs),
    /// Studies spots whose light falls into each other's windows, lit at once and in turn.
    Crosstalk(CrosstalkArgs),
    /// Follows sensors and control laws to extremely large telescopes, and images beside exact gradients.
    Scale(ScaleArgs),
    /// Joins the parts of a Strehl run made with --shard, finished or not.
    Merge(MergeArgs),
    /// Finds the laser power that a Rayleigh and a sodium beacon need: Strehl ratio against power.
    Power(PowerArgs),
    /// Compares launch beams: Strehl ratio against waist and size of subapertures.
    Beam(BeamArgs),
    /// Operates a board over its link.
    Link(LinkArgs),
    /// Makes the paper's figures, the error budget and a page that explains them.
    Reproduce(ReproduceArgs),
    /// Runs frames by the million on a quick sky, and looks after each at what must hold for ever.
    Endure(EndureArgs),
    /// Throws faults by the thousand at a closed loop, and looks after each step at what must hold.
    Faults(FaultsArgs),
    /// Prints the default instrument description (TOML) with comments.
    Config,
}

/// What every command takes.
#[derive(Clone, Debug, Args)]
pub struct OutputArgs {
    /// Output directory [default: target/splash/COMMAND]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// One JSON object on stdout, everything else on stderr
    #[arg(long)]
    pub json: bool,
}

/// What describes a run.
#[derive(Clone, Debug, Args)]
pub struct RunArgs {
    /// Instrument description (TOML), laid over the default one
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Subapertures across the pupil, 4 to 40, of the same size [default: the description's, 8]
    #[arg(long, value_name = "N", value_parser = subapertures(), allow_negative_numbers = true)]
    pub n: Option<usize>,
    /// Frames to run, of 1 ms unless the description says otherwise
    #[arg(
        long,
        value_name = "FRAMES",
        default_value_t = 500,
        value_parser = value_parser!(u32).range(1..),
        allow_negative_numbers = true
    )]
    pub frames: u32,
    /// Seed of turbulence and noise
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Detector without photon, dark and read noise, with 16 bits over its range
    #[arg(long)]
    pub noise_free: bool,
}

/// How long an emulated board is waited for.
#[derive(Clone, Copy, Debug, Args)]
pub struct PatienceArgs {
    /// Seconds without an answer after which an emulated board is given up
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 60,
        value_parser = value_parser!(u32).range(1..),
        allow_negative_numbers = true
    )]
    patience: u32,
}

impl PatienceArgs {
    /// How a board is opened for that, with marks if they are asked for.
    pub(crate) fn options(self, marks: bool) -> Options {
        Options { patience: Duration::from_secs(self.patience.into()), marks }
    }
}

/// `host-sim loop`.
#[derive(Clone, Debug, Args)]
pub struct LoopArgs {
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// Frames left out of the averages [default: 50, times the groups of a schedule, or half of --frames if
    /// that is less]
    #[arg(long, value_name = "FRAMES", allow_negative_numbers = true)]
    pub(crate) settle: Option<u32>,
    /// The sensor
    #[arg(long, value_enum, default_value_t = SensorName::Splash)]
    pub(crate) sensor: SensorName,
    /// How the sensor is simulated
    #[arg(long, value_enum, default_value_t = Sensing::Images)]
    pub(crate) sensing: Sensing,
    /// Where the firmware library runs
    #[arg(long, value_enum, default_value_t = BoardName::Host)]
    pub(crate) board: BoardName,
    #[command(flatten)]
    pub(crate) patience: PatienceArgs,
    /// Last frames to keep in frames.fits and phases.fits
    #[arg(long, value_name = "FRAMES", default_value_t = 100, allow_negative_numbers = true)]
    pub(crate) keep: u32,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// `host-sim frames`.
#[derive(Clone, Debug, Args)]
pub struct FramesArgs {
    /// The file to write, in the output directory if one is given
    pub(crate) file: PathBuf,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// Output directory [default: the current one]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// One JSON object on stdout, everything else on stderr
    #[arg(long)]
    pub(crate) json: bool,
}

/// `host-sim replay`.
#[derive(Clone, Debug, Args)]
pub struct ReplayArgs {
    /// A file written by `host-sim frames`
    pub(crate) file: PathBuf,
    /// Instrument description (TOML) to use in place of the file's, laid over the default one
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// `host-sim profile`.
///
/// Complete frames of very different content are run in one configuration: a count is the largest
/// of all, and the worst case is the time.
#[derive(Clone, Debug, Args)]
pub struct ProfileArgs {
    /// Instrument description (TOML), laid over the default one
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// Where the firmware library runs: ns on the host, instructions on QEMU, cycles on Ibex
    #[arg(long, value_enum, default_value_t = BoardName::Host)]
    pub(crate) board: BoardName,
    /// Subapertures across the pupil, 4 to 40 [default: the description's, 8]
    #[arg(long, value_name = "N", value_parser = subapertures(), allow_negative_numbers = true)]
    pub(crate) n: Option<usize>,
    /// Pixels on a side of a window, 4 to 32, edge to edge [default: the description's, 16]
    #[arg(long, value_name = "PIXELS", allow_negative_numbers = true)]
    pub(crate) window: Option<usize>,
    /// Bits of a pixel, 8 to 16 [default: the description's, 12]
    #[arg(long, value_name = "BITS", allow_negative_numbers = true)]
    pub(crate) bits: Option<u32>,
    /// Relaxation sweeps per frame [default: the description's, or N/2]
    #[arg(long, value_name = "SWEEPS", allow_negative_numbers = true)]
    pub(crate) sweeps: Option<u16>,
    /// Modes of a second gate, 1 to 25, on as many rows again below the first [default: one gate]
    #[arg(
        long,
        value_name = "MODES",
        value_parser = value_parser!(u8).range(1..=MAX_MODES as i64),
        allow_negative_numbers = true
    )]
    pub(crate) modes: Option<u8>,
    /// Centroid estimator [default: the description's, thresholded]
    #[arg(long, value_enum)]
    pub(crate) estimator: Option<EstimatorName>,
    /// Clock of the board, MHz, for times [default: 480 for QEMU's Cortex-M7, 37.3 for Ibex]
    #[arg(long, value_name = "MHZ", allow_negative_numbers = true)]
    pub(crate) clock_mhz: Option<f64>,
    /// Seed of the frames
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) patience: PatienceArgs,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

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

/// `host-sim strehl`.
///
/// Each screen is a sky of its own; all sensors close their loop under the same ones. A frame's Strehl ratio
/// is that over the pupil with piston, tip and tilt removed, the mean is over frames and screens, its error
/// from the scatter of the screens. A screen that is finished is kept in the output directory and not run
/// again: an interrupted run takes up where it was, and a longer one adds to it.
#[derive(Clone, Debug, Args)]
pub struct StrehlArgs {
    /// Instrument description (TOML), laid over the default one
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
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

/// `host-sim scale`.
///
/// Strehl ratio and residual variance against D/r0, under skies that stand still, with loops that have converged:
/// SPLASH and a laser guide star with each control law, a natural guide star and the best fit by exact gradients,
/// which need no images and reach 128 subapertures; images without noise through the firmware beside them as far
/// as they go, and what speckle, window and threshold add there. All under the same screens: differences are
/// paired. A screen that is finished is kept and not run again.
#[derive(Clone, Debug, Args)]
pub struct ScaleArgs {
    /// Instrument description (TOML), laid over the default one; its layers are held still
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// Subapertures across the pupil, of the same size, 4 to 128: by exact gradients
    #[arg(
        long,
        value_name = "N",
        default_value = "4,8,16,24,32,48,64,96,128",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) n: Vec<usize>,
    /// Of these, those with images beside them, 4 to 40; none to go without
    #[arg(
        long,
        value_name = "N",
        default_value = "8,16,32",
        value_delimiter = ',',
        num_args = 0..,
        allow_negative_numbers = true
    )]
    pub(crate) images: Vec<usize>,
    /// Control laws beside the description's with 1: numbers, profile or best, as lever_arm in [control]
    #[arg(long, value_name = "F", default_value = "profile,best", value_delimiter = ',')]
    pub(crate) lever_arm: Vec<LeverArm>,
    /// Independent screens for each N, in place of 200 up to N = 32, 100 up to 64 and 48 beyond
    #[arg(
        long,
        value_name = "SCREENS",
        value_parser = value_parser!(u32).range(2..=10_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) screens: Option<u32>,
    /// The same for images, in place of 100 up to N = 8, 50 up to 16 and 16 beyond; never more than for gradients
    #[arg(
        long,
        value_name = "SCREENS",
        value_parser = value_parser!(u32).range(2..=10_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) image_screens: Option<u32>,
    /// Seed of turbulence
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
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

/// `host-sim gates`.
///
/// One gate with the paper's null-seeking law and with the best number f, two gates combined in 12 and 25 modes,
/// laser and natural guide star and the best fit, under the same screens, with exact gradients in loops of double
/// precision. The combination is made for the description's layers, or for those of its second gate, which
/// is at half the beacon's height unless the description has one. `expected` is the residual variance beyond the
/// fitting error by theory; the rest is measured, with its standard error in brackets.
#[derive(Clone, Debug, Args)]
pub struct GatesArgs {
    /// Instrument description (TOML), laid over the default one
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
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
    /// subaperture; the combination is made for it [default: the description's, 0]
    #[arg(long, value_name = "RAD", allow_negative_numbers = true)]
    pub(crate) slope_noise: Option<f64>,
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

/// `host-sim endure`.
///
/// Gaussian spots move as drifting waves of changing seeing move them. Every frame has to move the
/// mirror; mean piston and tilt stay within a DAC LSB of zero; the totals are those counted here; on an
/// emulated board, least and most of a frame's cost are told.
#[derive(Clone, Debug, Args)]
pub struct EndureArgs {
    /// Instrument description (TOML), laid over the default one
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
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

/// `host-sim faults`.
///
/// A closed loop on a quick sky, in this process, through the controller that boards run; an operator
/// closes it again whenever it was given up. Looked at after every step: codes within limits and slew, state
/// within its formats, legal modes, counters that add up, recovery, and spots in place. The first thing
/// that does not hold ends the run.
#[derive(Clone, Debug, Args)]
pub struct FaultsArgs {
    /// Instrument description (TOML), laid over the default one
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
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

/// A sensor's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SensorName {
    /// Laser spots launched through the pupil.
    Splash,
    /// A conventional laser guide star.
    Lgs,
    /// A natural guide star.
    Ngs,
}

impl SensorName {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Splash => "splash",
            Self::Lgs => "lgs",
            Self::Ngs => "ngs",
        }
    }

    /// The optics of that name.
    pub fn sensor(self) -> Sensor {
        match self {
            Self::Splash => Sensor::Splash,
            Self::Lgs => Sensor::Lgs,
            Self::Ngs => Sensor::Ngs,
        }
    }
}

/// A board's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BoardName {
    /// In this process.
    Host,
    /// On the Cortex-M7 that QEMU emulates.
    Qemu,
    /// On the Ibex soft core, simulated at register-transfer level.
    Ibex,
}

impl BoardName {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Host => "host",
            Self::Qemu => "qemu",
            Self::Ibex => "ibex",
        }
    }

    /// The program on that board, which is built where it is needed; `None` on the host.
    ///
    /// # Errors
    /// [`BoardError::Missing`], [`BoardError::Build`].
    pub fn program(self) -> Result<Option<PathBuf>, BoardError> {
        match self {
            Self::Host => Ok(None),
            Self::Qemu => board::qemu::program("server").map(Some),
            Self::Ibex => board::ibex::program("server").map(Some),
        }
    }

    /// The board of that name, with the configuration of `spec`.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn open(self, spec: &Spec<'_>, options: Options) -> Result<Box<dyn Board>, BoardError> {
        Ok(match self {
            Self::Host => board::open(spec, options)?,
            Self::Qemu => Box::new(board::qemu::open(spec, options)?),
            Self::Ibex => Box::new(board::ibex::open(spec, options)?),
        })
    }
}

impl RunArgs {
    /// The instrument that the arguments ask for.
    ///
    /// # Errors
    /// [`Error::Config`] if the description cannot be used.
    pub fn instrument(&self) -> Result<Instrument, Error> {
        let mut instrument = Instrument::described(self.config.as_deref())?;
        if let Some(n) = self.n {
            instrument.telescope.subapertures = n;
        }
        instrument.check()?;
        Ok(if self.noise_free { instrument.noise_free() } else { instrument })
    }
}

/// What `--n` takes.
pub(crate) fn subapertures() -> RangedI64ValueParser<usize> {
    RangedI64ValueParser::new().range(MIN_ACROSS as i64..=MAX_ACROSS as i64)
}

impl Cli {
    /// The process's arguments; prints help and ends the process where they ask for it.
    ///
    /// # Errors
    /// [`Error::Config`] for arguments that cannot be.
    pub fn from_args() -> Result<Self, Error> {
        Self::try_parse().map_err(|error| {
            if !error.use_stderr() {
                error.exit();
            }
            in_one_line(&error)
        })
    }

    /// Runs the command.
    ///
    /// # Errors
    /// [`Error`], whose exit code is the process's.
    pub fn run(self) -> Result<(), Error> {
        match self.command {
            None => commands::closed_loop::run(&self.closed_loop),
            Some(Command::Loop(args)) => commands::closed_loop::run(&args),
            Some(Command::Frames(args)) => commands::frames::run(&args),
            Some(Command::Replay(args)) => commands::replay::run(&args),
            Some(Command::Profile(args)) => commands::profile::run(&args),
            Some(Command::Theory(args)) => commands::theory::run(&args),
            Some(Command::Strehl(args)) => commands::strehl::run(&args),
            Some(Command::Gates(args)) => commands::gates::run(&args),
            Some(Command::Centroids(args)) => commands::centroids::run(&args),
            Some(Command::Crosstalk(args)) => commands::crosstalk::run(&args),
            Some(Command::Scale(args)) => commands::scale::run(&args),
            Some(Command::Merge(args)) => commands::merge::run(&args),
            Some(Command::Power(args)) => commands::power::run(&args),
            Some(Command::Beam(args)) => commands::beam::run(&args),
            Some(Command::Link(args)) => commands::link::run(&args),
            Some(Command::Reproduce(args)) => commands::reproduce::run(&args),
            Some(Command::Endure(args)) => commands::endure::run(&args),
            Some(Command::Faults(args)) => commands::faults::run(&args),
            Some(Command::Config) => commands::config::run(),
        }
    }
}

/// What is wrong with some arguments: paragraphs with what is wrong, tips, usage, where to find help.
fn in_one_line(error: &clap::Error) -> Error {
    let text = error.render().to_string();
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    let aside = |part: &&str| part.starts_with("Usage:") || part.starts_with("For more");
    let one_line = |part: &str| part.split_whitespace().collect::<Vec<_>>().join(" ");
    let parts = text.split("\n\n").filter(|part| !aside(part)).map(one_line);
    let line = parts.collect::<Vec<_>>().join("; ");
    Error::Config(format!("{line}; see host-sim --help"))
}
