//! What goes wrong.

use serde::Serialize;

/// A kind of mishap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mishap {
    /// A frame does not come, and the board notices.
    Dropped,
    /// Frames do not come, and nobody notices before the next one's number.
    Skipped,
    /// The last rows of a frame do not come.
    Short,
    /// A frame comes twice.
    Doubled,
    /// A frame begins anew in its middle.
    Restarted,
    /// Any bits in any pixels.
    Corrupted,
    /// A row has another length.
    WrongRow,
    /// Every pixel is at its highest.
    Saturated,
    /// A frame has a number from long ago.
    WrongCounter,
    /// Subapertures without light, for a while.
    DeadSubapertures,
    /// Next to no light, for a while.
    FluxDropout,
    /// Laser pulses are missing from a frame.
    MissedPulses,
    /// Actuators that do not follow their codes, for a while.
    StuckActuators,
    /// The DACs do not take the codes.
    Dacs,
    /// The laser's permit is taken away, for a while.
    LaserPermit,
    /// The high voltage is not ready, for a while.
    HighVoltage,
    /// An operator asks for anything, sensible or not.
    Commands,
    /// The program panics: the mirror is brought to flat, and everything starts anew.
    Crash,
}

/// All kinds.
pub const MISHAPS: [Mishap; 18] = [
    Mishap::Dropped,
    Mishap::Skipped,
    Mishap::Short,
    Mishap::Doubled,
    Mishap::Restarted,
    Mishap::Corrupted,
    Mishap::WrongRow,
    Mishap::Saturated,
    Mishap::WrongCounter,
    Mishap::DeadSubapertures,
    Mishap::FluxDropout,
    Mishap::MissedPulses,
    Mishap::StuckActuators,
    Mishap::Dacs,
    Mishap::LaserPermit,
    Mishap::HighVoltage,
    Mishap::Commands,
    Mishap::Crash,
];
