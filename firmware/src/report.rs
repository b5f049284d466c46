//! What goes in and out of the pipeline beside pixels and codes: progress, refusals, reports,
//! totals and the global tilt.

use serde::{Deserialize, Serialize};

/// How far a frame has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Progress {
    /// More rows are to come.
    More,
    /// That was the last row: `finish` is due.
    Complete,
}

/// Why a row was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RowError {
    /// No frame has begun.
    NotBegun,
    /// The row has not the detector's width, or the list not one entry a subaperture.
    Length {
        /// What it has.
        found: u32,
        /// What it must have.
        expected: u16,
    },
    /// The frame already has all its rows.
    Extra,
}

impl core::fmt::Display for RowError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NotBegun => f.write_str("row before the start of a frame"),
            Self::Length { found, expected } => {
                write!(f, "row of {found} entries, must have {expected}")
            }
            Self::Extra => f.write_str("row after the last of the frame"),
        }
    }
}

impl core::error::Error for RowError {}

/// Why a frame moved nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Hold {
    /// No frame had begun.
    NotBegun,
    /// The frame had only this many rows.
    CutShort {
        /// Rows that came.
        rows: u16,
    },
    /// A row had the wrong length.
    WrongRow,
    /// No subaperture's flux was within its limits.
    NoLight,
    /// The configuration has no subapertures.
    NotConfigured,
    /// The frame did not pass the quality gate.
    Poor,
    /// The mode does not follow frames: the mirror is where the mode wants it.
    Mode,
}

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// New codes.
    Updated,
    /// The codes of the frame before.
    Held(Hold),
}

/// What one frame did.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Report {
    /// The number given to `begin`.
    pub frame: u32,
    /// Whether the codes are new.
    pub outcome: Outcome,
    /// Subapertures whose flux was within its limits.
    pub valid: u16,
    /// Pixels at or above the saturation level.
    pub saturated_pixels: u32,
    /// Sum of (r / 8)^2 over the solver's nodes, ulp^2 / 64; r is the Laplacian's residual.
    pub residual_squared: u64,
    /// Actuators that the command would have taken beyond their limits.
    pub saturated_actuators: u16,
    /// Actuators that the command would have moved faster than the slew limit.
    pub slewed_actuators: u16,
    /// Rows refused since `begin` because the frame was full.
    pub extra_rows: u16,
    /// Whether `begin` dropped an unfinished frame.
    pub restarted: bool,
    /// Age of the global tilt in use, frames; `None` before the first, and in a held frame.
    pub global_tilt_age: Option<u32>,
    /// Whether that age is beyond the configured limit.
    pub global_tilt_stale: bool,
}

/// A global tip and tilt, as a natural guide star gives it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GlobalTilt {
    /// Tip and tilt to add to every segment: centre-to-edge path difference over one segment, ulp.
    /// Saturated to +-2^23.
    pub tilt_ulp: [i32; 2],
    /// The frame it belongs to.
    pub frame: u32,
}

/// Totals since the pipeline was made or reset; they saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Totals {
    /// Frames that moved the mirror.
    pub updated: u32,
    /// Frames held because rows were missing.
    pub cut_short: u32,
    /// Frames held because a row had the wrong length.
    pub wrong_row: u32,
    /// Frames held because nothing was lit.
    pub no_light: u32,
    /// `finish` without a frame, or without a configuration.
    pub not_ready: u32,
    /// Frames dropped by the next `begin`.
    pub restarted: u32,
    /// Rows refused because their frame was full.
    pub extra_rows: u32,
    /// Frames that used a stale global tilt.
    pub stale_tilt: u32,
    /// Actuator commands cut by a limit.
    pub saturated_actuators: u32,
    /// Actuator commands cut by the slew limit.
    pub slewed_actuators: u32,
}
