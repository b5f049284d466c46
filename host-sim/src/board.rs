//! Where the firmware library runs: a board takes rows and gives DAC codes.
//!
//! | board | is |
//! |---|---|
//! | [`in_process`] | the library in this process |
//! | [`qemu`] | the Cortex-M7 that QEMU emulates |
//! | [`ibex`] | the soft core, simulated at register-transfer level |
//!
//! The last two are a [`remote`] board: a program of its own (built by `program`) in a [`process`] that may
//! hang, die or talk nonsense, and is spoken to over pipes.

pub(crate) mod capacity;
pub mod ibex;
mod in_process;
mod log;
pub mod process;
pub mod program;
pub mod qemu;
pub mod remote;

pub use in_process::{image, in_process, open};
pub use log::Format;
pub use program::BuildError;

use crate::link::Failure;
use splash_firmware::centroid::Measurement;
use splash_firmware::controller::Command;
use splash_firmware::error::ConfigError;
use splash_firmware::fault::KINDS;
use splash_firmware::link::{Reason, Stack};
use splash_firmware::mode::{Mode, Refusal};
use splash_firmware::pipeline::{Report, RowError, Totals};
use splash_firmware::segments::Position;
use splash_firmware::slopes::Slope;
use std::time::Duration;

/// What a frame is made of.
#[derive(Clone, Copy, Debug)]
pub enum Frame<'a> {
    /// Detector pixels, row-major, ADU.
    Pixels(&'a [u16]),
    /// Measurements made elsewhere, in mask order.
    Measurements(&'a [Measurement]),
}

/// Why a board could not be had, or did not take a frame.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// A row, or a list of measurements, was refused.
    #[error("frame {frame}: {source}")]
    Refused {
        /// The frame.
        frame: u32,
        /// Why.
        source: RowError,
    },
    /// The configuration was refused.
    #[error("{0}")]
    Config(#[from] ConfigError),
    /// The configuration does not fit the board.
    #[error("board {board}: {reason}")]
    Unfit {
        /// The board.
        board: &'static str,
        /// Why.
        reason: Reason,
    },
    /// The controller refuses.
    #[error("controller: {0}")]
    Refusal(#[from] Refusal),
    /// Something that the board needs is missing.
    #[error("board {board}: {what}")]
    Missing {
        /// The board.
        board: &'static str,
        /// What, and where it comes from.
        what: String,
    },
    /// The board's program could not be built.
    #[error("board {board}: {source}")]
    Build {
        /// The board.
        board: &'static str,
        /// Why.
        source: BuildError,
    },
    /// The board's process does not do what it should.
    #[error("board {board}: {source}, {doing}")]
    Process {
        /// The board.
        board: &'static str,
        /// What it was asked.
        doing: String,
        /// What it did.
        source: Failure,
    },
}

/// How an emulated board is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// The longest wait for an answer. Then the board is given up.
    pub patience: Duration,
    /// Whether the emulator counts what happens between the marks of the program.
    pub marks: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { patience: Duration::from_secs(60), marks: false }
    }
}

/// What a controller says of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Standing {
    /// The mode.
    pub mode: Mode,
    /// Faults by kind, in the order of [`splash_firmware::fault::NAMES`].
    pub faults: [u32; KINDS],
}

/// What an operator does before frame `frame`: closes the loop before the first, or, if spots are lit in turn,
/// when each has been seen once. In standby until then, and with faults counted from there: a frame's light is
/// judged by what every window last had.
///
/// # Errors
/// As [`Board::command`].
pub fn operate(board: &mut dyn Board, frame: u32, cycle: u32) -> Result<(), BoardError> {
    if frame == 0 {
        board.command(Command::Arm)?;
        board.command(Command::Enter(Mode::Standby))?;
    }
    if frame == if cycle > 1 { cycle } else { 0 } {
        board.command(Command::ClearFaults)?;
        board.command(Command::Enter(Mode::ClosedLoop))?;
    }
    Ok(())
}

/// A reconstructor that runs somewhere.
///
/// Frames go through the frame path alone, which follows each that is complete, until the first
/// [`Board::command`]: from then on they go through the controller, with its quality gate, its ladder and
/// the modes that it is in.
pub trait Board {
    /// Opens the loop: forgets every frame and flattens the mirror.
    ///
    /// # Errors
    /// [`BoardError::Process`].
    fn reset(&mut self) -> Result<(), BoardError>;

    /// Has the controller do what an operator asks for; it stays in charge until the next reset.
    ///
    /// # Errors
    /// [`BoardError::Refusal`], [`BoardError::Unfit`], [`BoardError::Process`].
    fn command(&mut self, command: Command) -> Result<(), BoardError>;

    /// Where the controller is, and what it has booked since it was made.
    ///
    /// # Errors
    /// [`BoardError::Process`].
    fn standing(&mut self) -> Result<Standing, BoardError>;

    /// Feeds a frame and returns what became of it.
    ///
    /// # Errors
    /// [`BoardError::Refused`] if a row is refused; the rest of the frame is not used.
    /// [`BoardError::Process`].
    fn frame(&mut self, number: u32, frame: Frame<'_>) -> Result<Report, BoardError>;

    /// DAC codes of each segment's actuators.
    fn codes(&self) -> &[[u16; 3]];

    /// Measurements of the last frame.
    fn measurements(&self) -> &[Measurement];

    /// Those of the second gate; none without one.
    fn second_measurements(&self) -> &[Measurement];

    /// Slopes of the last frame.
    fn slopes(&self) -> &[Slope];

    /// Those of the second gate; none without one.
    fn second_slopes(&self) -> &[Slope];

    /// Positions of the segments.
    fn positions(&self) -> &[Position];

    /// Parts of the pupil that no edge connects: the relative pistons of two are not measured.
    fn components(&self) -> usize;

    /// Optical path per length ulp, m.
    fn ulp_m(&self) -> f64;

    /// What went wrong so far.
    fn totals(&self) -> Totals;

    /// The totals counted at each mark since the last call: ns, instructions or cycles. In a frame
    /// there is a mark before and after `begin`, before and after each `push_rows`, before `finish`,
    /// after each of its stages and after its end; the two before all frames tell what a mark costs.
    ///
    /// # Errors
    /// [`BoardError::Process`] if the board was opened without [`Options::marks`].
    fn marks(&mut self) -> Result<Vec<u64>, BoardError>;

    /// How deep the stack went; `None` where the system takes care of it.
    ///
    /// # Errors
    /// [`BoardError::Process`].
    fn stack(&mut self) -> Result<Option<Stack>, BoardError>;
}
