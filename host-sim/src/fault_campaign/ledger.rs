//! What happened and what the controller must have counted.

use super::mishap::{MISHAPS, Mishap};
use serde::Serialize;
use splash_firmware::controller::FrameResult;
use splash_firmware::fault::{Fault, Faults, KINDS, NAMES};
use splash_firmware::ladder::Rung;
use splash_firmware::mode::Mode;

/// What came of the mishaps of a kind.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Line {
    /// The kind.
    pub mishap: Mishap,
    /// How many there were.
    pub count: u64,
    /// Of those that met a closed loop: frames that were followed,
    pub followed: u64,
    /// held,
    pub held: u64,
    /// leaked,
    pub leaked: u64,
    /// and loops that ended there or in the frames behind, before another mishap.
    pub ended: u64,
    /// Longest time until such a loop was closed again, frames in which nothing kept it open.
    pub longest_recovery: u64,
}

/// The books.
pub(super) struct Ledger {
    lines: [Line; MISHAPS.len()],
    /// The last mishap.
    last: Option<Mishap>,
    /// What the controller must have counted since its start.
    expected: [u64; KINDS],
    closed: bool,
    /// Frames since the loop was last closed in which nothing kept it open.
    open_frames: u64,
}

impl Ledger {
    pub(super) fn new() -> Self {
        let line = |mishap| Line {
            mishap,
            count: 0,
            followed: 0,
            held: 0,
            leaked: 0,
            ended: 0,
            longest_recovery: 0,
        };
        Self {
            lines: MISHAPS.map(line),
            last: None,
            expected: [0; KINDS],
            closed: false,
            open_frames: 0,
        }
    }

    /// The controller counts from zero.
    pub(super) fn start(&mut self) {
        self.expected = [0; KINDS];
    }

    fn line(&mut self) -> Option<&mut Line> {
        let last = self.last?;
        self.lines.iter_mut().find(|line| line.mishap == last)
    }

    pub(super) fn happens(&mut self, mishap: Mishap) {
        self.last = Some(mishap);
        if let Some(line) = self.line() {
            line.count += 1;
        }
    }

    /// The controller must book this fault so many times.
    pub(super) fn expect(&mut self, fault: Fault, times: u32) {
        self.expected[fault.kind()] += u64::from(times);
    }

    /// What a frame was found to be must be booked as that. `mishap`: in its own frame.
    pub(super) fn frame(&mut self, mishap: Option<Mishap>, before: Mode, result: &FrameResult) {
        // The other two are known beforehand.
        if let Some(fault) = result.fault
            && !matches!(fault, Fault::FrameMissing | Fault::PulsesMissed { .. })
        {
            self.expect(fault, 1);
        }
        if let Some(Rung::GiveUp(fault)) = result.rung {
            self.expect(fault, 1);
        }
        if before == Mode::ClosedLoop && result.mode == Mode::OpenLoop {
            self.expect(Fault::ActuatorsSaturated { actuators: 0, most: 0 }, 1);
        }
        if mishap.is_none() {
            return;
        }
        let rung = result.rung;
        if let Some(line) = self.line() {
            match rung {
                Some(Rung::Follow) => line.followed += 1,
                Some(Rung::Hold) => line.held += 1,
                Some(Rung::Leak) => line.leaked += 1,
                Some(Rung::GiveUp(_)) | None => {}
            }
        }
    }

    /// Compares with what the controller counted.
    pub(super) fn check(&self, faults: &Faults) -> Result<(), String> {
        let pairs = NAMES.iter().zip(faults.counts()).zip(self.expected);
        for ((name, &counted), expected) in pairs {
            if u64::from(counted) != expected {
                return Err(format!("{name}: counted {counted} times, were {expected}"));
            }
        }
        Ok(())
    }

    /// Follows the loop: `blocked` frames do not count for a recovery.
    pub(super) fn recovery(
        &mut self,
        closed: bool,
        blocked: bool,
        most: u64,
    ) -> Result<(), String> {
        let was = std::mem::replace(&mut self.closed, closed);
        if was && !closed {
            self.open_frames = 0;
            if let Some(line) = self.line() {
                line.ended += 1;
            }
        }
        if closed && !was {
            let frames = self.open_frames;
            if let Some(line) = self.line() {
                line.longest_recovery = line.longest_recovery.max(frames);
            }
        }
        self.open_frames += u64::from(!closed && !blocked);
        if !closed && self.open_frames > most {
            return Err(format!("the loop has not closed for {} frames", self.open_frames));
        }
        Ok(())
    }

    pub(super) fn lines(&self) -> Vec<Line> {
        self.lines.to_vec()
    }
}

/// Whether a frame of this mishap may have been found to be that. `lit`: there was all the light.
pub(super) fn explains(mishap: Option<Mishap>, lit: bool, found: Option<Fault>) -> bool {
    let dim = matches!(found, Some(Fault::TooFewValid { .. } | Fault::TotalFlux { .. }));
    match mishap {
        Some(Mishap::Short) => matches!(found, Some(Fault::FrameShort { .. })),
        Some(Mishap::WrongRow) => found == Some(Fault::WrongRow),
        Some(Mishap::WrongCounter) => {
            matches!(found, Some(Fault::FrameCounter { .. })) || (!lit && dim)
        }
        Some(Mishap::Saturated) => matches!(found, Some(Fault::SaturatedPixels { .. })) || dim,
        Some(Mishap::Corrupted) => true,
        Some(Mishap::MissedPulses) => found.is_none() || dim,
        _ => found.is_none() || (!lit && dim),
    }
}
