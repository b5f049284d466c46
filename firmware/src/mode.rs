//! Modes: what the mirror is for, and which mode may follow which.
//!
//! | mode | frames | the mirror |
//! |---|---|---|
//! | safe | measured | ramps to the flat map and stays |
//! | standby | measured | holds |
//! | calibrate | measured | goes where the calibration asks |
//! | open loop | measured | ramps to the flat map and stays: the whole wavefront is seen |
//! | closed loop | reconstructed | follows the frames |
//! | test pattern | measured | goes where the operator asks |
//!
//! | from, to | safe | standby | calibrate | open loop | closed loop | test pattern |
//! |---|---|---|---|---|---|---|
//! | safe | - | flat | | | | |
//! | standby | yes | - | voltage | voltage | laser, calibrated | voltage |
//! | calibrate | yes | yes | - | | | |
//! | open loop | yes | yes | | - | laser, calibrated | |
//! | closed loop | yes | yes | | yes | - | |
//! | test pattern | yes | yes | | | | - |
//!
//! *flat*: the mirror shows the flat map. *voltage*: the high voltage is on to stay. *laser*: that and the laser
//! are. *calibrated*: the running configuration's calibration fits it. Out of safe there is one way, by
//! the operator; into safe there always is one. Every transition is recorded with its reason; what is
//! refused changes nothing, is counted, and says what is missing.

use crate::fault::{Fault, Moment};
use core::fmt;
use heapless::Deque;
use serde::{Deserialize, Serialize};

/// Transitions that are kept.
pub const TRANSITIONS: usize = 16;

/// What the mirror is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Mode {
    /// Flat, or on its way there.
    #[default]
    Safe,
    /// Held.
    Standby,
    /// Where the calibration asks.
    Calibrate,
    /// Flat, with everything on.
    OpenLoop,
    /// After the frames.
    ClosedLoop,
    /// Where the operator asks.
    TestPattern,
}

/// All modes.
pub const MODES: [Mode; 6] = [
    Mode::Safe,
    Mode::Standby,
    Mode::Calibrate,
    Mode::OpenLoop,
    Mode::ClosedLoop,
    Mode::TestPattern,
];

/// Why a mode was entered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reason {
    /// The operator asked for it.
    Operator,
    /// A fault leads there.
    Fault(Fault),
}

/// What must be there to enter some modes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Conditions {
    /// The configuration has subapertures.
    pub configured: bool,
    /// The mirror shows the flat map.
    pub flat: bool,
    /// The high voltage is on, and not about to go down.
    pub high_voltage: bool,
    /// The laser is on.
    pub laser: bool,
    /// The running configuration's calibration fits it.
    pub calibrated: bool,
}

/// Why something was not done. Nothing has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// No way leads from one mode to the other.
    NoWay {
        /// The mode that is.
        from: Mode,
        /// The mode that was asked for.
        to: Mode,
    },
    /// There is no configuration.
    NotConfigured,
    /// The mirror is not at the flat map yet.
    NotFlat,
    /// The high voltage is not up.
    NoHighVoltage,
    /// The laser is not on.
    NoLaser,
    /// The running configuration has no calibration that fits it.
    NotCalibrated,
    /// The laser's permit or the high voltage's readiness is missing.
    Interlock {
        /// The laser is permitted.
        laser_permit: bool,
        /// The high voltage is ready.
        high_voltage_ready: bool,
    },
    /// Not in this mode.
    WrongMode {
        /// The mode that is.
        mode: Mode,
    },
    /// There is no such subaperture.
    NoSubaperture {
        /// What was asked for.
        subaperture: u16,
        /// How many there are.
        subapertures: u16,
    },
    /// The configuration was made for another mirror or detector.
    OtherHardware(crate::mirror::OtherHardware),
    /// The heights belong to no position of a segment, whose matrix rounds to one that cannot be
    /// inverted.
    NoPosition {
        /// The subaperture.
        subaperture: u16,
    },
    /// The gate would not fit between two pulses, or the board's timer.
    Gate(crate::gate::GateError),
    /// The high voltage is on.
    HighVoltage,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoWay { from, to } => write!(f, "no way from {from} to {to}"),
            Self::NotConfigured => f.write_str("there is no configuration"),
            Self::NotFlat => f.write_str("the mirror is not at the flat map yet"),
            Self::NoHighVoltage => f.write_str("the high voltage is not up"),
            Self::NoLaser => f.write_str("the laser is not on"),
            Self::NotCalibrated => f.write_str("no calibration that fits the configuration"),
            Self::Interlock { laser_permit, high_voltage_ready } => write!(
                f,
                "interlock: laser permit {laser_permit}, high voltage ready {high_voltage_ready}: \
                 both must be true"
            ),
            Self::WrongMode { mode } => write!(f, "not in mode {mode}"),
            Self::NoSubaperture { subaperture, subapertures } => {
                write!(f, "subaperture = {subaperture}: must be below {subapertures}")
            }
            Self::OtherHardware(other) => other.fmt(f),
            Self::NoPosition { subaperture } => {
                write!(f, "subaperture {subaperture}: heights that no piston, tip and tilt have")
            }
            Self::Gate(error) => error.fmt(f),
            Self::HighVoltage => f.write_str("the high voltage is on"),
        }
    }
}

impl core::error::Error for Refusal {}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Safe => "safe",
            Self::Standby => "standby",
            Self::Calibrate => "calibrate",
            Self::OpenLoop => "open loop",
            Self::ClosedLoop => "closed loop",
            Self::TestPattern => "test pattern",
        })
    }
}

/// A mode was left for another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Transition {
    /// The mode that was.
    pub from: Mode,
    /// The mode that is.
    pub to: Mode,
    /// Why.
    pub reason: Reason,
    /// When.
    pub at: Moment,
}

/// The mode, and how it came to be.
#[derive(Debug)]
pub struct Modes {
    mode: Mode,
    last: Deque<Transition, TRANSITIONS>,
    refused: u32,
}

impl Default for Modes {
    fn default() -> Self {
        Self::new()
    }
}

impl Modes {
    /// Safe.
    #[must_use]
    pub const fn new() -> Self {
        Self { mode: Mode::Safe, last: Deque::new(), refused: 0 }
    }

    /// The mode.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// The last transitions, oldest first.
    pub fn last(&self) -> impl Iterator<Item = &Transition> {
        self.last.iter()
    }

    /// Requests that were refused, of transitions and others; saturates.
    #[must_use]
    pub const fn refused(&self) -> u32 {
        self.refused
    }

    /// Counts a refused request.
    pub fn refuse(&mut self) {
        self.refused = self.refused.saturating_add(1);
    }

    /// Enters `to` at the operator's request.
    ///
    /// # Errors
    /// What is missing, by the table above.
    pub fn enter(&mut self, to: Mode, have: Conditions, at: Moment) -> Result<(), Refusal> {
        let allowed = allowed(self.mode, to, have);
        match allowed {
            Ok(()) => self.go(to, Reason::Operator, at),
            Err(_) => self.refuse(),
        }
        allowed
    }

    /// Enters [`Mode::Safe`] because of a fault; in safe it stays as it is.
    pub fn fall(&mut self, fault: Fault, at: Moment) {
        if self.mode != Mode::Safe {
            self.go(Mode::Safe, Reason::Fault(fault), at);
        }
    }

    /// Opens a closed loop because of a fault; any other mode stays.
    pub fn open(&mut self, fault: Fault, at: Moment) {
        if self.mode == Mode::ClosedLoop {
            self.go(Mode::OpenLoop, Reason::Fault(fault), at);
        }
    }

    fn go(&mut self, to: Mode, reason: Reason, at: Moment) {
        if self.last.is_full() {
            self.last.pop_front();
        }
        // There is room now.
        let _ = self.last.push_back(Transition { from: self.mode, to, reason, at });
        self.mode = to;
    }
}

/// The table.
fn allowed(from: Mode, to: Mode, have: Conditions) -> Result<(), Refusal> {
    let need = |there: bool, refusal| if there { Ok(()) } else { Err(refusal) };
    let voltage = || {
        need(have.configured, Refusal::NotConfigured)?;
        need(have.high_voltage, Refusal::NoHighVoltage)
    };
    match (from, to) {
        (
            Mode::Standby | Mode::Calibrate | Mode::OpenLoop | Mode::ClosedLoop | Mode::TestPattern,
            Mode::Safe,
        )
        | (
            Mode::Calibrate | Mode::OpenLoop | Mode::ClosedLoop | Mode::TestPattern,
            Mode::Standby,
        )
        | (Mode::ClosedLoop, Mode::OpenLoop) => Ok(()),
        (Mode::Safe, Mode::Standby) => {
            need(have.configured, Refusal::NotConfigured)?;
            need(have.flat, Refusal::NotFlat)
        }
        (Mode::Standby, Mode::Calibrate | Mode::OpenLoop | Mode::TestPattern) => voltage(),
        (Mode::Standby | Mode::OpenLoop, Mode::ClosedLoop) => {
            voltage()?;
            need(have.laser, Refusal::NoLaser)?;
            need(have.calibrated, Refusal::NotCalibrated)
        }
        _ => Err(Refusal::NoWay { from, to }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: Conditions = Conditions {
        configured: true,
        flat: true,
        high_voltage: true,
        laser: true,
        calibrated: true,
    };
    const AT: Moment = Moment { frame: 7, ticks: 1 << 40 };

    fn modes(mode: Mode) -> Modes {
        Modes { mode, ..Modes::new() }
    }

    /// The table of the module, row by row: which ways there are if nothing is missing.
    #[test]
    fn ways_are_those_of_the_table() {
        const WAYS: [[u8; 6]; 6] = [
            [0, 1, 0, 0, 0, 0],
            [1, 0, 1, 1, 1, 1],
            [1, 1, 0, 0, 0, 0],
            [1, 1, 0, 0, 1, 0],
            [1, 1, 0, 1, 0, 0],
            [1, 1, 0, 0, 0, 0],
        ];
        for (from, row) in MODES.into_iter().zip(WAYS) {
            for (to, way) in MODES.into_iter().zip(row) {
                let mut modes = modes(from);
                let entered = modes.enter(to, ALL, AT);
                if way == 1 {
                    assert_eq!((entered, modes.mode(), modes.refused()), (Ok(()), to, 0));
                    let expected = Transition { from, to, reason: Reason::Operator, at: AT };
                    assert_eq!(modes.last().collect::<Vec<_>>(), [&expected]);
                } else {
                    assert_eq!(entered, Err(Refusal::NoWay { from, to }));
                    assert_eq!((modes.mode(), modes.refused()), (from, 1));
                    assert_eq!(modes.last().count(), 0);
                }
            }
        }
    }

    #[test]
    fn what_is_missing_is_named() {
        use Mode::{Calibrate, ClosedLoop, OpenLoop, Safe, Standby, TestPattern};
        let refused = |from, to, have, refusal| {
            let mut modes = modes(from);
            assert_eq!(modes.enter(to, have, AT), Err(refusal), "{from} to {to}");
            assert_eq!(modes.mode(), from);
        };
        let without = |take: fn(&mut Conditions)| {
            let mut have = ALL;
            take(&mut have);
            have
        };
        refused(Safe, Standby, without(|c| c.flat = false), Refusal::NotFlat);
        refused(Safe, Standby, without(|c| c.configured = false), Refusal::NotConfigured);
        for to in [Calibrate, OpenLoop, ClosedLoop, TestPattern] {
            let cold = without(|c| c.high_voltage = false);
            refused(Standby, to, cold, Refusal::NoHighVoltage);
        }
        for from in [Standby, OpenLoop] {
            refused(from, ClosedLoop, without(|c| c.laser = false), Refusal::NoLaser);
            let uncalibrated = without(|c| c.calibrated = false);
            refused(from, ClosedLoop, uncalibrated, Refusal::NotCalibrated);
        }
    }

    #[test]
    fn a_fault_leads_to_safe_from_anywhere_and_opens_only_what_is_closed() {
        let fault = Fault::Dacs;
        for from in MODES {
            let mut modes = modes(from);
            modes.fall(fault, AT);
            assert_eq!(modes.mode(), Mode::Safe);
            let reasons: Vec<_> = modes.last().map(|t| t.reason).collect();
            let expected = usize::from(from != Mode::Safe);
            assert_eq!(reasons, vec![Reason::Fault(fault); expected]);
        }
        for from in MODES {
            let mut modes = modes(from);
            modes.open(fault, AT);
            let opened = from == Mode::ClosedLoop;
            assert_eq!(modes.mode(), if opened { Mode::OpenLoop } else { from });
            assert_eq!(modes.last().count(), usize::from(opened));
        }
    }
}
