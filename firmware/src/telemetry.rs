//! Telemetry: what frames leave, kept until the link has time for it.
//!
//! The loop fills a ring of [`Record`]s behind each frame; the link empties it. A full ring drops its
//! oldest records and counts them, by stream: the loop never waits. Every record has its frame's
//! number, so that a gap shows. A stream comes with every n-th frame, those whose number n divides.
//!
//! | stream | of a frame |
//! |---|---|
//! | frames | report, residual, mode, fault, time stamp, gate stamp, configuration, cycles, sum of squared tilts |
//! | slopes | tip and tilt, validity, of each window |
//! | commands | piston, tip and tilt of each segment after all limits |
//! | codes | DAC codes of each segment's actuators |
//! | fluxes | centroid, flux, peak, saturated pixels of each window |
//! | faults | each, as it is booked, of a frame or not: with every subscription but to nothing |
//!
//! A subaperture has one window; with a second gate another, and those come behind all of the first's.

use crate::centroid::Measurement;
use crate::controller::FrameResult;
use crate::fault::{self, Faults};
use crate::link::{LIST, List};
use crate::pipeline::Pipeline;
use crate::segments::{ACTUATORS, Position};
use crate::slopes::Slope;
use crate::strehl;
use serde::{Deserialize, Serialize};

/// Streams, in the order of [`Record`]'s variants.
pub const STREAMS: usize = 6;

/// Those that come with every n-th frame.
const WITH_FRAMES: usize = STREAMS - 1;

/// What a frame took, in a board's own units: processor cycles, or those of its counter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Cycles {
    /// All its rows.
    pub rows: u32,
    /// Slopes, control, pistons, segments, actuators.
    pub stages: [u32; 5],
    /// From the arrival of the last row to the hand-over of the codes.
    pub latency: u32,
}

/// What a board knows of a frame beside what the controller does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    /// Hash of the configuration that it ran with.
    pub configuration: u32,
    /// What it took.
    pub cycles: Cycles,
}

/// A frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameRecord {
    /// What became of it: with its number, time stamp, gate stamp and mode.
    pub result: FrameResult,
    /// Hash of the configuration that it ran with.
    pub configuration: u32,
    /// Sum of tip^2 + tilt^2 over the valid slopes, ulp^2: see [`strehl`].
    pub tilt_squared_ulp2: u64,
    /// What it took.
    pub cycles: Cycles,
}

/// What is sent at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "without allocation nothing can be put elsewhere")]
pub enum Record {
    /// A frame.
    Frame(FrameRecord),
    /// Slopes from window `first` on.
    Slopes {
        /// The frame's number.
        frame: u32,
        /// Window of the first.
        first: u16,
        /// In mask order, gate by gate.
        items: List<Slope>,
    },
    /// Positions from subaperture `first` on.
    Commands {
        /// The frame's number.
        frame: u32,
        /// Subaperture of the first.
        first: u16,
        /// In mask order.
        items: List<Position>,
    },
    /// DAC codes from subaperture `first` on.
    Codes {
        /// The frame's number.
        frame: u32,
        /// Subaperture of the first.
        first: u16,
        /// In mask order.
        items: List<[u16; ACTUATORS]>,
    },
    /// Measurements from window `first` on.
    Fluxes {
        /// The frame's number.
        frame: u32,
        /// Window of the first.
        first: u16,
        /// In mask order, gate by gate.
        items: List<Measurement>,
    },
    /// A fault.
    Fault(fault::Record),
}

impl Record {
    const fn stream(&self) -> usize {
        match self {
            Self::Frame(_) => 0,
            Self::Slopes { .. } => 1,
            Self::Commands { .. } => 2,
            Self::Codes { .. } => 3,
            Self::Fluxes { .. } => 4,
            Self::Fault(_) => 5,
        }
    }
}

/// Most bytes on the wire of a frame's record, and of an item of each of the other streams.
const FRAME_BYTES: u64 = 240;
const ITEM_BYTES: [u64; WITH_FRAMES - 1] = [11, 15, 9, 21];
/// Most bytes on the wire of a piece of a list beside its items.
const PIECE_BYTES: u64 = 24;

/// Of each stream, every how many frames it comes: 0 for never.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Decimation {
    /// Reports, stamps and cycles.
    pub frames: u32,
    /// Slopes.
    pub slopes: u32,
    /// Positions.
    pub commands: u32,
    /// DAC codes.
    pub codes: u32,
    /// Measurements.
    pub fluxes: u32,
}

impl Decimation {
    /// Nothing.
    pub const OFF: Self = Self { frames: 0, slopes: 0, commands: 0, codes: 0, fluxes: 0 };

    /// As much as a link of so many bytes a second carries with half of its rate, the streams with a
    /// fifth of that each. Nothing on a link that cannot carry a byte for each.
    #[must_use]
    pub fn for_link(bytes_per_s: u32, frame_ns: u64, subapertures: usize, windows: usize) -> Self {
        let share = u64::from(bytes_per_s) / (2 * WITH_FRAMES as u64);
        let every = |bytes: u64| {
            let ns = bytes.saturating_mul(1_000_000_000);
            match share.saturating_mul(frame_ns) {
                0 => 0,
                carried => u32::try_from(ns.div_ceil(carried)).unwrap_or(u32::MAX).max(1),
            }
        };
        let list = |items: usize, item| {
            every(items.div_ceil(LIST) as u64 * PIECE_BYTES + items as u64 * item)
        };
        let [slope, command, code, flux] = ITEM_BYTES;
        Self {
            frames: every(FRAME_BYTES),
            slopes: list(windows, slope),
            commands: list(subapertures, command),
            codes: list(subapertures, code),
            fluxes: list(windows, flux),
        }
    }
}

/// Records dropped since the last subscription, by stream in the order of [`Record`]'s variants; they
/// saturate.
pub type Dropped = [u32; STREAMS];

/// A ring of `R` records.
#[derive(Debug)]
pub struct Ring<const R: usize> {
    records: heapless::Deque<Record, R>,
    decimation: Decimation,
    dropped: Dropped,
    /// Faults that have been told, or were nobody's to be told.
    told: u32,
}

impl<const R: usize> Default for Ring<R> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const R: usize> Ring<R> {
    /// An empty one, which nothing is put into before [`Ring::subscribe`].
    #[must_use]
    pub const fn new() -> Self {
        Self {
            records: heapless::Deque::new(),
            decimation: Decimation::OFF,
            dropped: [0; STREAMS],
            told: 0,
        }
    }

    /// From now on, these; what there is goes, and the counts start again.
    pub fn subscribe(&mut self, decimation: Decimation) {
        self.records.clear();
        self.decimation = decimation;
        self.dropped = [0; STREAMS];
    }

    /// What comes.
    #[must_use]
    pub const fn decimation(&self) -> Decimation {
        self.decimation
    }

    /// What was dropped.
    #[must_use]
    pub const fn dropped(&self) -> Dropped {
        self.dropped
    }

    /// The oldest record.
    pub fn pop(&mut self) -> Option<Record> {
        self.records.pop_front()
    }

    /// Takes what a frame has left: between `finish` and the next `begin`.
    pub fn fill<const M: usize, const B: usize, const K: usize>(
        &mut self,
        pipeline: &Pipeline<M, B, K>,
        result: &FrameResult,
        stamp: &Stamp,
    ) {
        let frame = result.report.frame;
        let Decimation { frames, slopes, commands, codes, fluxes } = self.decimation;
        let due = |every: u32| every != 0 && frame.is_multiple_of(every);
        if due(frames) {
            self.push(Record::Frame(FrameRecord {
                result: *result,
                configuration: stamp.configuration,
                tilt_squared_ulp2: strehl::tilt_squared(pipeline.slopes()),
                cycles: stamp.cycles,
            }));
        }
        if due(slopes) {
            self.list(pipeline.window_slopes(), |first, items| Record::Slopes {
                frame,
                first,
                items,
            });
        }
        if due(commands) {
            let positions = pipeline.positions();
            self.list(positions, |first, items| Record::Commands { frame, first, items });
        }
        if due(codes) {
            self.list(pipeline.codes(), |first, items| Record::Codes { frame, first, items });
        }
        if due(fluxes) {
            let measurements = pipeline.window_measurements();
            self.list(measurements, |first, items| Record::Fluxes { frame, first, items });
        }
    }

    /// Takes the faults that were booked since the last time; what is no longer kept counts as dropped.
    pub fn tell(&mut self, faults: &Faults) {
        let new = faults.records().wrapping_sub(self.told);
        self.told = faults.records();
        if self.decimation == Decimation::OFF {
            return;
        }
        let kept = faults.last().count();
        let unknown = (new as usize).min(kept);
        faults.last().skip(kept - unknown).for_each(|record| self.push(Record::Fault(*record)));
        let [.., dropped] = &mut self.dropped;
        *dropped = dropped.saturating_add(new.saturating_sub(unknown as u32));
    }

    fn list<T: Copy>(&mut self, all: &[T], record: impl Fn(u16, List<T>) -> Record) {
        for (i, items) in all.chunks(LIST).enumerate() {
            let first = i.wrapping_mul(LIST) as u16;
            self.push(record(first, items.iter().copied().collect()));
        }
    }

    fn push(&mut self, record: Record) {
        let lost = match self.records.push_back(record) {
            Ok(()) => return,
            Err(record) => {
                let oldest = self.records.pop_front();
                // There is room now, unless R is 0.
                self.records.push_back(record).err().or(oldest)
            }
        };
        if let Some(count) = lost.and_then(|lost| self.dropped.get_mut(lost.stream())) {
            *count = count.saturating_add(1);
        }
    }
}
