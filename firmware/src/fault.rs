//! Faults: typed, counted, and the last of them kept with frame and time.
//!
//! Nothing that goes wrong is silent: whoever finds a fault books it here. Counters saturate; the ring
//! keeps the last [`RECORDS`] and is read from the oldest.

use heapless::Deque;
use serde::{Deserialize, Serialize};

/// Faults that are kept with their circumstances.
pub const RECORDS: usize = 16;

/// When something happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Moment {
    /// The frame that was the last to begin.
    pub frame: u32,
    /// Time, ticks of the board's clock since its start.
    pub ticks: u64,
}

/// What has gone wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// A frame that was due did not come.
    FrameMissing,
    /// A frame had only so many rows.
    FrameShort {
        /// Rows that came.
        rows: u16,
    },
    /// A row had the wrong length.
    WrongRow,
    /// A frame was begun before the one before it had ended.
    FrameUnfinished,
    /// A frame's number is not the next one.
    FrameCounter {
        /// The next one.
        expected: u32,
        /// What the frame has.
        found: u32,
    },
    /// Fewer subapertures had a valid flux than must have.
    TooFewValid {
        /// Those that had.
        valid: u16,
        /// Those that must have.
        least: u16,
    },
    /// The flux of all windows together is out of its limits, flux units.
    TotalFlux {
        /// The sum over the windows.
        flux: u64,
        /// The limit it broke.
        limit: u64,
    },
    /// More pixels were saturated than may be.
    SaturatedPixels {
        /// Those that were.
        pixels: u32,
        /// Those that may be.
        most: u32,
    },
    /// A frame had fewer laser pulses than asked.
    PulsesMissed {
        /// Pulses asked for.
        asked: u32,
        /// Pulses that came.
        seen: u32,
    },
    /// More actuators were at their limits than may be, for as many frames as end the loop.
    ActuatorsSaturated {
        /// Actuators at their limits in the last of them.
        actuators: u16,
        /// Those that may be.
        most: u16,
    },
    /// So many bad or missing frames in a row that the loop was given up.
    FramesLost {
        /// Frames.
        frames: u16,
    },
    /// The laser's permit was taken away while the laser was on, or on its way.
    LaserPermit,
    /// The high voltage was not ready while it was on, or on its way.
    HighVoltage,
    /// The DACs did not take a frame's codes.
    Dacs,
    /// The detector's readout went astray and was started again.
    Readout,
    /// A frame's work was not done when the next one's began.
    Deadline,
    /// The watchdog started the board anew.
    Watchdog,
    /// The program before this start ended with a panic or a hard fault.
    Crash,
}

/// Kinds of faults.
pub const KINDS: usize = 18;

impl Fault {
    /// Its place among the counters: 0 to [`KINDS`] - 1, in the order of the variants.
    #[must_use]
    pub const fn kind(self) -> usize {
        match self {
            Self::FrameMissing => 0,
            Self::FrameShort { .. } => 1,
            Self::WrongRow => 2,
            Self::FrameUnfinished => 3,
            Self::FrameCounter { .. } => 4,
            Self::TooFewValid { .. } => 5,
            Self::TotalFlux { .. } => 6,
            Self::SaturatedPixels { .. } => 7,
            Self::PulsesMissed { .. } => 8,
            Self::ActuatorsSaturated { .. } => 9,
            Self::FramesLost { .. } => 10,
            Self::LaserPermit => 11,
            Self::HighVoltage => 12,
            Self::Dacs => 13,
            Self::Readout => 14,
            Self::Deadline => 15,
            Self::Watchdog => 16,
            Self::Crash => 17,
        }
    }

    /// Whether it takes the mirror to safe at once, whatever the mode: what made the codes, or what
    /// carries them, can no longer be trusted.
    #[must_use]
    pub const fn is_hard(self) -> bool {
        matches!(
            self,
            Self::LaserPermit | Self::HighVoltage | Self::Dacs | Self::Watchdog | Self::Crash
        )
    }
}

/// Names of the kinds, as telemetry and results show them.
pub const NAMES: [&str; KINDS] = [
    "frame_missing",
    "frame_short",
    "wrong_row",
    "frame_unfinished",
    "frame_counter",
    "too_few_valid",
    "total_flux",
    "saturated_pixels",
    "pulses_missed",
    "actuators_saturated",
    "frames_lost",
    "laser_permit",
    "high_voltage",
    "dacs",
    "readout",
    "deadline",
    "watchdog",
    "crash",
];

/// A fault and when it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Record {
    /// What went wrong.
    pub fault: Fault,
    /// When.
    pub at: Moment,
}

/// All faults since the start.
#[derive(Debug)]
pub struct Faults {
    counts: [u32; KINDS],
    last: Deque<Record, RECORDS>,
    records: u32,
}

impl Default for Faults {
    fn default() -> Self {
        Self::new()
    }
}

impl Faults {
    /// None yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { counts: [0; KINDS], last: Deque::new(), records: 0 }
    }

    /// Books a fault.
    pub fn book(&mut self, fault: Fault, at: Moment) {
        self.book_times(fault, 1, at);
    }

    /// Books a fault that was there so many times at once: one record.
    ///
    /// Not inlined: faults are seldom, and booked in many places.
    #[inline(never)]
    pub fn book_times(&mut self, fault: Fault, times: u32, at: Moment) {
        if let Some(count) = self.counts.get_mut(fault.kind()) {
            *count = count.saturating_add(times);
        }
        if self.last.is_full() {
            self.last.pop_front();
        }
        // There is room now.
        let _ = self.last.push_back(Record { fault, at });
        self.records = self.records.wrapping_add(1);
    }

    /// How often each kind has been, in the order of [`NAMES`].
    #[must_use]
    pub const fn counts(&self) -> &[u32; KINDS] {
        &self.counts
    }

    /// The last faults, oldest first.
    pub fn last(&self) -> impl Iterator<Item = &Record> {
        self.last.iter()
    }

    /// How many records there have been in all; wraps.
    #[must_use]
    pub const fn records(&self) -> u32 {
        self.records
    }

    /// Counts from zero again, and forgets the records.
    pub fn clear(&mut self) {
        *self = Self { records: self.records, ..Self::new() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One fault of each kind.
    fn each() -> [Fault; KINDS] {
        [
            Fault::FrameMissing,
            Fault::FrameShort { rows: 3 },
            Fault::WrongRow,
            Fault::FrameUnfinished,
            Fault::FrameCounter { expected: 1, found: 2 },
            Fault::TooFewValid { valid: 1, least: 2 },
            Fault::TotalFlux { flux: 1, limit: 2 },
            Fault::SaturatedPixels { pixels: 2, most: 1 },
            Fault::PulsesMissed { asked: 2, seen: 1 },
            Fault::ActuatorsSaturated { actuators: 2, most: 1 },
            Fault::FramesLost { frames: 7 },
            Fault::LaserPermit,
            Fault::HighVoltage,
            Fault::Dacs,
            Fault::Readout,
            Fault::Deadline,
            Fault::Watchdog,
            Fault::Crash,
        ]
    }

    /// The name of a variant is that of its counter, in snake case.
    #[test]
    fn every_kind_has_a_counter_of_its_own_by_its_name() {
        for (kind, fault) in each().into_iter().enumerate() {
            assert_eq!(fault.kind(), kind);
            let debug = format!("{fault:?}");
            let variant = debug.split_whitespace().next().expect("a name");
            assert_eq!(variant.to_lowercase(), NAMES[kind].replace('_', ""));
            let mut faults = Faults::new();
            faults.book(fault, Moment::default());
            faults.book(fault, Moment::default());
            let expected: Vec<u32> = (0..KINDS).map(|k| 2 * u32::from(k == kind)).collect();
            assert_eq!(faults.counts()[..], expected);
        }
    }

    #[test]
    fn the_ring_keeps_the_last_in_order() {
        let mut faults = Faults::new();
        for frame in 0..RECORDS as u32 + 5 {
            faults.book(Fault::FrameMissing, Moment { frame, ticks: u64::from(frame) << 40 });
        }
        let frames: Vec<u32> = faults.last().map(|record| record.at.frame).collect();
        assert_eq!(frames, (5..RECORDS as u32 + 5).collect::<Vec<_>>());
        assert!(faults.last().all(|r| r.at.ticks == u64::from(r.at.frame) << 40));
    }

    #[test]
    fn counters_saturate() {
        let mut faults = Faults::new();
        faults.counts = [u32::MAX; KINDS];
        faults.book(Fault::WrongRow, Moment::default());
        assert_eq!(faults.counts(), &[u32::MAX; KINDS]);
        faults.clear();
        assert_eq!((faults.counts(), faults.last().count()), (&[0; KINDS], 0));
    }
}
