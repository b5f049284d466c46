//! The command line.

mod beacon;
mod centroids;
mod crosstalk;
mod endure;
mod faults;
mod gates;
mod layers;
mod link;
mod names;
mod profile;
mod reproduce;
mod scale;
mod strehl;
mod theory;

use crate::board::Options;
use crate::closed_loop::Sensing;
use crate::commands;
use crate::error::Error;
use crate::instrument::Instrument;
use clap::builder::RangedI64ValueParser;
use clap::{Args, Parser, Subcommand, value_parser};
use splash_firmware::geometry::{MAX_ACROSS, MIN_ACROSS};
use std::path::PathBuf;
use std::time::Duration;

pub use beacon::{BeaconName, BeamArgs, PowerArgs};
pub use centroids::CentroidsArgs;
pub use crosstalk::{CrosstalkArgs, Turns};
pub use endure::EndureArgs;
pub use faults::FaultsArgs;
pub use gates::GatesArgs;
pub use link::{Action, LinkArgs, Place};
pub use names::{BoardName, SensorName};
pub use profile::ProfileArgs;
pub use reproduce::ReproduceArgs;
pub use scale::ScaleArgs;
pub use strehl::{MergeArgs, StrehlArgs, WindowsName};
pub use theory::TheoryArgs;

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

/// What a run takes last whose screens are kept, and which has no noise.
#[derive(Clone, Debug, Args)]
pub struct KeptArgs {
    /// Seed of turbulence
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    /// Start even if it takes more than a day
    #[arg(long)]
    pub(crate) long: bool,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// What an instrument with one gate is, of which the layers are held still.
#[derive(Clone, Debug, Args)]
pub struct StillArgs {
    /// Instrument description (TOML), laid over the default one; its layers are held still
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

impl StillArgs {
    /// The instrument that is described, or the default one, under layers that stand still.
    ///
    /// # Errors
    /// As [`Instrument::load`] and [`Instrument::of_one_gate`].
    pub(crate) fn load(&self) -> Result<Instrument, Error> {
        Ok(Instrument::described(self.config.as_deref())?.of_one_gate()?.frozen())
    }
}

/// What the instrument is.
#[derive(Clone, Debug, Args)]
pub struct DescriptionArgs {
    /// Instrument description (TOML), laid over the default one
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

impl DescriptionArgs {
    /// The instrument that is described, or the default one.
    ///
    /// # Errors
    /// As [`Instrument::load`].
    pub(crate) fn load(&self) -> Result<Instrument, Error> {
        Instrument::described(self.config.as_deref())
    }
}

/// What describes a run.
#[derive(Clone, Debug, Args)]
pub struct RunArgs {
    #[command(flatten)]
    description: DescriptionArgs,
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
impl RunArgs {
    /// The instrument that the arguments ask for.
    ///
    /// # Errors
    /// [`Error::Config`] if the description cannot be used.
    pub fn instrument(&self) -> Result<Instrument, Error> {
        let mut instrument = self.description.load()?;
        if let Some(n) = self.n {
            instrument.telescope.subapertures = n;
        }
        instrument.check()?;
        Ok(if self.noise_free { instrument.noise_free() } else { instrument })
    }
}

/// A number with limits.
fn between(text: &str, from: f64, to: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value >= from && value <= to => Ok(value),
        _ => Err(format!("must be a number from {from} to {to}")),
    }
}

/// What `--screens` takes where their scatter is an error.
pub(crate) fn screens() -> RangedI64ValueParser<u32> {
    RangedI64ValueParser::new().range(2..=10_000_000)
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
