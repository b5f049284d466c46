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
    /// Bytes on the link that are no message.
    Garbage,
    /// A message that is cut short, with the next one behind it.
    Truncated,
    /// A message that comes twice.
    Replayed,
    /// Another configuration, uploaded and switched to: no fault, and no frame may miss it.
    Upload,
    /// An upload with a wrong byte, or one that ends early and is switched to all the same.
    BrokenUpload,
    /// A store of what runs, and a power cut in it.
    StoreCut,
    /// The program panics: the mirror is brought to flat, and everything starts anew.
    Crash,
}

/// All kinds.
pub const MISHAPS: [Mishap; 24] = [
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
    Mishap::Garbage,
    Mishap::Truncated,
    Mishap::Replayed,
    Mishap::Upload,
    Mishap::BrokenUpload,
    Mishap::StoreCut,
    Mishap::Crash,
];
