//! Arguments of `host-sim link`.

use super::in_one_line;
use crate::error::Error;
use crate::link::light::Light;
use crate::link::parameters::PARAMETERS;
use clap::{Args, Parser, Subcommand, ValueEnum, value_parser};
use splash_firmware::mode::Mode;
use std::path::{Path, PathBuf};

/// `host-sim link`.
///
/// On host, qemu and ibex the board is made for the command: it is loaded with the description's
/// configuration and sees the description's spots, on a bench until `light sky`. On a serial line nothing
/// is loaded but by `upload`, `restore` and `calibrate`. Several actions go in a script.
#[derive(Clone, Debug, Args)]
#[command(subcommand_required = false)]
pub struct LinkArgs {
    /// host, qemu, ibex, or serial:DEVICE such as serial:/dev/ttyUSB0
    #[arg(long, value_parser = place)]
    pub(crate) board: Place,
    /// Instrument description (TOML), laid over the default one
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// Bits a second on a serial line
    #[arg(
        long,
        value_name = "BAUD",
        default_value_t = 115_200,
        value_parser = value_parser!(u32).range(1200..=12_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) baud: u32,
    /// Seconds without an answer after which the board is given up [default: 60 where it is emulated, 5
    /// on a serial line]
    #[arg(
        long,
        value_name = "SECONDS",
        value_parser = value_parser!(u32).range(1..),
        allow_negative_numbers = true
    )]
    pub(crate) patience: Option<u32>,
    /// Seed of turbulence and noise of an emulated board's frames
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    /// Actions, one a line, quoted as in a shell, from # on a comment; - for standard input
    #[arg(long, value_name = "FILE")]
    pub(crate) script: Option<PathBuf>,
    /// One JSON object on stdout, everything else on stderr
    #[arg(long)]
    pub(crate) json: bool,
    #[command(subcommand)]
    action: Option<Action>,
}

/// Where the board is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// The server of the emulated boards, in this process.
    Host,
    /// The Cortex-M7 that QEMU emulates.
    Qemu,
    /// The Ibex soft core.
    Ibex,
    /// At the end of a serial line.
    Serial(PathBuf),
}

fn place(text: &str) -> Result<Place, String> {
    match (text, text.strip_prefix("serial:")) {
        ("host", _) => Ok(Place::Host),
        ("qemu", _) => Ok(Place::Qemu),
        ("ibex", _) => Ok(Place::Ibex),
        (_, Some(device)) if !device.is_empty() => Ok(Place::Serial(device.into())),
        _ => Err("must be host, qemu, ibex or serial:DEVICE".into()),
    }
}

/// One number, or several with commas between.
#[derive(Clone, Debug, PartialEq)]
pub struct Numbers(pub Vec<f64>);

fn numbers(text: &str) -> Result<Numbers, String> {
    let number = |text: &str| {
        text.parse()
            .map_err(|_| format!("{text:?} must be a number, or several with commas between"))
    };
    text.split(',').map(number).collect::<Result<_, _>>().map(Numbers)
}

/// What to do with a board.
#[derive(Clone, Debug, Subcommand)]
pub enum Action {
    /// Mode, outputs, gate, hashes of build and configuration, serial numbers
    Status,
    /// Frames, faults by kind, refused transitions, unreadable messages
    Counters,
    /// The last faults and the last transitions between modes
    Faults,
    /// Prints a parameter
    #[command(after_help = parameters())]
    Get {
        /// Its name
        name: String,
        /// Subaperture, in mask order [default: all]
        index: Option<u16>,
    },
    /// Sets a parameter, from the next frame on
    #[command(after_help = parameters())]
    Set {
        /// Its name
        name: String,
        /// Value in the parameter's unit; several with commas between
        #[arg(value_parser = numbers, allow_hyphen_values = true)]
        values: Numbers,
        /// Subaperture, in mask order [default: all]
        index: Option<u16>,
    },
    /// Loads the configuration of an instrument description (TOML), checks it and has it run
    Upload {
        /// The description, laid over the default one
        file: PathBuf,
    },
    /// Writes the image of the configuration that runs
    ReadBack {
        /// The file to write
        file: PathBuf,
    },
    /// Stores the configuration that runs in the board's flash
    Store,
    /// What is stored in the board's flash
    Stored,
    /// Has the stored configuration run
    Restore,
    /// Another mode
    Mode {
        /// Which
        #[arg(value_enum)]
        mode: ModeName,
    },
    /// High voltage on, then the laser
    Arm,
    /// Safe: laser and high voltage off
    Disarm,
    /// A segment to a position, in modes calibrate and test-pattern
    #[command(allow_hyphen_values = true)]
    Poke {
        /// Subaperture, in mask order
        subaperture: u16,
        /// Optical path, m
        piston: f64,
        /// Optical path from centre to edge along x, m
        tip: f64,
        /// Optical path from centre to edge along y, m
        tilt: f64,
    },
    /// Another range for the gate
    #[command(allow_hyphen_values = true)]
    Gate {
        /// Of the beacon's middle above the telescope, m
        altitude: f64,
        /// Of the gate, m of altitude
        depth: f64,
        /// Degrees
        zenith_angle: f64,
    },
    /// States which mirror and detector the board has, in mode safe and without high voltage; store keeps it
    Hardware {
        /// The mirror's serial number; 0: not stated
        mirror: u32,
        /// The detector's
        detector: u32,
    },
    /// What an emulated board's detector sees
    Light {
        /// Which
        #[arg(value_enum)]
        light: LightName,
    },
    /// Waits for frames, or gives them to an emulated board
    Frames {
        /// How many
        #[arg(value_parser = value_parser!(u32).range(1..), allow_negative_numbers = true)]
        frames: u32,
    },
    /// Records telemetry as FITS tables
    Record {
        /// The file to write
        file: PathBuf,
        /// So many frames
        #[arg(
            long,
            default_value_t = 100,
            value_parser = value_parser!(u32).range(1..),
            allow_negative_numbers = true
        )]
        frames: u32,
        /// In place of that, so many seconds
        #[arg(long, conflicts_with = "frames", allow_negative_numbers = true)]
        seconds: Option<f64>,
    },
    /// Measures and loads darks, flats, reference slopes, the map from spots to segments and their gains
    ///
    /// The light is seen to on an emulated board; on a serial line, whoever operates it is asked for it.
    Calibrate {
        /// Frames for darks, and for flats
        #[arg(
            long,
            default_value_t = 32,
            value_parser = value_parser!(u32).range(2..=100_000),
            allow_negative_numbers = true
        )]
        frames: u32,
        /// Frames averaged for each position of the mirror
        #[arg(
            long,
            default_value_t = 8,
            value_parser = value_parser!(u32).range(1..=100_000),
            allow_negative_numbers = true
        )]
        averaged: u32,
    },
    /// The calibration that runs, or what is missing
    Calibration,
}

/// A mode's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "documented at the modes")]
pub enum ModeName {
    Safe,
    Standby,
    Calibrate,
    OpenLoop,
    ClosedLoop,
    TestPattern,
}

impl ModeName {
    /// The mode of that name.
    pub fn mode(self) -> Mode {
        match self {
            Self::Safe => Mode::Safe,
            Self::Standby => Mode::Standby,
            Self::Calibrate => Mode::Calibrate,
            Self::OpenLoop => Mode::OpenLoop,
            Self::ClosedLoop => Mode::ClosedLoop,
            Self::TestPattern => Mode::TestPattern,
        }
    }
}

/// A light's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "documented at the lights")]
pub enum LightName {
    Dark,
    Even,
    Bench,
    Sky,
}

impl LightName {
    /// The light of that name.
    pub fn light(self) -> Light {
        match self {
            Self::Dark => Light::Dark,
            Self::Even => Light::Even,
            Self::Bench => Light::Bench,
            Self::Sky => Light::Sky,
        }
    }
}

/// A line of a script.
#[derive(Debug, Parser)]
#[command(no_binary_name = true, name = "", disable_help_subcommand = true)]
struct Line {
    #[command(subcommand)]
    action: Action,
}

impl LinkArgs {
    /// The actions that the arguments ask for: all of them are read before the first is done.
    ///
    /// # Errors
    /// [`Error::Config`] with the line that cannot be.
    pub(crate) fn actions(&self) -> Result<Vec<Action>, Error> {
        match (&self.action, &self.script) {
            (Some(action), None) => Ok(vec![action.clone()]),
            (None, Some(script)) => script_of(script),
            _ => Err(Error::Config(
                "an action or --script FILE, one of the two; see host-sim link --help".into(),
            )),
        }
    }
}

fn script_of(file: &Path) -> Result<Vec<Action>, Error> {
    let name = file.display();
    let text = if file == Path::new("-") {
        std::io::read_to_string(std::io::stdin())
    } else {
        std::fs::read_to_string(file)
    };
    let text = text.map_err(|error| Error::Config(format!("--script {name}: {error}")))?;
    let mut actions = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let refuse =
            |what: String| Error::Config(format!("--script {name}: line {}: {what}", number + 1));
        let words = shlex::split(line).ok_or_else(|| refuse("a quote is not closed".into()))?;
        if words.is_empty() {
            continue;
        }
        let line = Line::try_parse_from(words);
        actions.push(line.map_err(|error| refuse(in_one_line(&error).to_string()))?.action);
    }
    if actions.is_empty() {
        return Err(Error::Config(format!("--script {name}: no action")));
    }
    Ok(actions)
}

/// The parameters and their units.
fn parameters() -> String {
    let width = PARAMETERS.iter().map(|p| p.name.len()).max().unwrap_or(0);
    let line = |p: &crate::link::parameters::Parameter| {
        let each = if p.is_indexed() { "each subaperture" } else { "" };
        let comma = if p.unit.is_empty() || each.is_empty() { "" } else { "; " };
        format!("  {:<width$}  {}{comma}{each}\n", p.name, p.unit).trim_end().to_owned()
    };
    let lines: Vec<String> = PARAMETERS.iter().map(line).collect();
    format!("Parameters:\n{}", lines.join("\n"))
}
