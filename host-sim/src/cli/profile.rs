//! The arguments of `host-sim profile`.

use super::{BoardName, DescriptionArgs, OutputArgs, PatienceArgs, subapertures};
use crate::instrument::EstimatorName;
use clap::{Args, value_parser};
use splash_firmware::modal::MAX_MODES;

/// `host-sim profile`.
///
/// Complete frames of very different content are run in one configuration: a count is the largest
/// of all, and the worst case is the time.
#[derive(Clone, Debug, Args)]
pub struct ProfileArgs {
    #[command(flatten)]
    pub(crate) description: DescriptionArgs,
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
