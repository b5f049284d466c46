//! What is done when the main loop asks: seldom, and so not in the memory of the frame path.

use crate::bank::Half;
use crate::dac_bus::DacBus;
use crate::frame_loop::{Counter, FrameLoop};
use crate::queues::{FrameSide, Hardware};
use crate::rounds::frame_cycles;
use crate::shape::Shape;
use heapless::Vec;
use splash_firmware::centroid::Measurement;
use splash_firmware::controller;
use splash_firmware::controller::FrameResult;
use splash_firmware::fault::{self, KINDS, RECORDS};
use splash_firmware::interlock::Outputs;
use splash_firmware::link::PIECE;
use splash_firmware::mirror::Serials;
use splash_firmware::mode::{Mode, Refusal, TRANSITIONS, Transition};
use splash_firmware::pipeline::{GlobalTilt, Totals};
use splash_firmware::segments::{ACTUATORS, Position};
use splash_firmware::slopes::Slope;
use splash_firmware::strehl;
use splash_firmware::telemetry::{Decimation, Dropped};
use splash_server::parameters::raw_pixels;

/// A bank that is to run.
#[derive(Debug)]
pub struct Next<const M: usize, const P: usize, const B: usize> {
    /// The bank.
    pub bank: Half<M, P, B>,
    /// Its hash.
    pub hash: u32,
    /// How its frames come.
    pub shape: Shape,
    /// Its calibration fits it.
    pub calibrated: bool,
}

/// What the main loop asks of the frames' exception. All but the global tilt is answered.
#[derive(Debug)]
pub enum Command<const M: usize, const P: usize, const B: usize> {
    /// Another bank, from the next boundary on.
    Exchange(Next<M, P, B>),
    /// What an operator asks for.
    Operator(controller::Command),
    /// A global tilt.
    GlobalTilt(GlobalTilt),
    /// The state that the next frame leaves.
    NextFrame,
    /// The state that the last frame has left.
    State,
    /// What the controller keeps books of.
    Books,
    /// Telemetry from now on, if another is wanted, and what was dropped.
    Streams(Option<Decimation>),
    /// Raw pixels of this row of the next frame, from this column on.
    Row(u16, u16),
}

/// What the frames' exception answers.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "without allocation nothing can be put elsewhere")]
pub enum Answer<const M: usize, const P: usize, const B: usize> {
    /// The bank that ran before; or the one that was to run, and why it does not.
    Exchanged(Result<Half<M, P, B>, (Half<M, P, B>, Refusal)>),
    /// What became of it.
    Done(Result<(), Refusal>),
    /// The state that the next frame has left.
    NextFrame(Snapshot<M>),
    /// The state.
    State(Snapshot<M>),
    /// The books.
    Books(Books),
    /// Telemetry.
    Streams(Decimation, Dropped),
    /// Pixels, u16 little-endian, and the frame they are of; `None` if the next frame lacks the row.
    Row(Option<(u32, Vec<u8, PIECE>)>),
}

/// A row that was asked for.
#[derive(Debug)]
pub(crate) struct Wanted {
    row: u16,
    first: u16,
    /// Frames that ended without it: the first may have been in its middle.
    ended: u8,
    found: Option<(u32, Vec<u8, PIECE>)>,
}

/// What the last frame left.
#[derive(Clone, Debug)]
pub struct Snapshot<const M: usize> {
    /// What became of it; `None` before the first.
    pub result: Option<FrameResult>,
    /// Totals since the start.
    pub totals: Totals,
    /// DAC codes.
    pub codes: Vec<[u16; ACTUATORS], M>,
    /// Measurements.
    pub measurements: Vec<Measurement, M>,
    /// Slopes.
    pub slopes: Vec<Slope, M>,
    /// Positions of the segments.
    pub positions: Vec<Position, M>,
}

/// What the controller keeps books of.
#[derive(Clone, Debug)]
pub struct Books {
    /// The mode.
    pub mode: Mode,
    /// The enables.
    pub outputs: Outputs,
    /// The hardware that is there.
    pub serials: Serials,
    /// What became of the last frame; `None` before the first.
    pub last: Option<FrameResult>,
    /// The time, cycles since the start.
    pub now: u64,
    /// Sum of tip^2 + tilt^2 over the last frame's valid slopes, ulp^2.
    pub tilt_squared_ulp2: u64,
    /// Frames since the start.
    pub totals: Totals,
    /// Faults by kind.
    pub faults: [u32; KINDS],
    /// Requests that were refused.
    pub refused: u32,
    /// The last faults, oldest first.
    pub last_faults: Vec<fault::Record, RECORDS>,
    /// The last transitions, oldest first.
    pub transitions: Vec<Transition, TRANSITIONS>,
}

/// As a list, which has room for all.
fn listed<T, const N: usize>(items: impl Iterator<Item = T>) -> Vec<T, N> {
    let mut list = Vec::new();
    for item in items {
        let _ = list.push(item);
    }
    list
}

impl<D: DacBus, C: Counter, const M: usize, const P: usize, const B: usize>
    FrameLoop<'_, D, C, M, P, B>
{
    /// Between two frames: takes another bank if the controller lets it, and returns the one before.
    fn exchange(&mut self, next: Next<M, P, B>) -> Result<Half<M, P, B>, (Half<M, P, B>, Refusal)> {
        let Next { bank, hash, shape, calibrated } = next;
        if let Err(refusal) = self.controller.exchange(&self.bank, &bank, calibrated) {
            return Err((bank, refusal));
        }
        (self.shape, self.hash, self.calibrated) = (Some(shape), hash, calibrated);
        self.frame_cycles = frame_cycles(&bank.timing());
        self.due = Some(self.now().wrapping_add(2 * self.frame_cycles));
        // The first one's flat map, if the DACs are free; else the next frame's codes follow.
        let _ = self.dacs.update(self.controller.codes());
        Ok(core::mem::replace(&mut self.bank, bank))
    }

    fn snapshot(&self) -> Snapshot<M> {
        let pipeline = self.controller.pipeline();
        // Each has at most M entries.
        Snapshot {
            result: self.last,
            totals: pipeline.totals(),
            codes: Vec::from_slice(pipeline.codes()).unwrap_or_default(),
            measurements: Vec::from_slice(pipeline.window_measurements()).unwrap_or_default(),
            slopes: Vec::from_slice(pipeline.window_slopes()).unwrap_or_default(),
            positions: Vec::from_slice(pipeline.positions()).unwrap_or_default(),
        }
    }

    fn books(&mut self) -> Books {
        let now = self.now();
        let (pipeline, faults) = (self.controller.pipeline(), self.controller.faults());
        Books {
            mode: self.controller.mode(),
            outputs: self.controller.outputs(),
            serials: self.controller.serials(),
            last: self.last,
            now,
            tilt_squared_ulp2: strehl::tilt_squared(pipeline.slopes()),
            totals: pipeline.totals(),
            faults: *faults.counts(),
            refused: self.controller.modes().refused(),
            last_faults: listed(faults.last().copied()),
            transitions: listed(self.controller.modes().last().copied()),
        }
    }
}

impl<D: DacBus, C: Counter, const M: usize, const P: usize, const B: usize>
    FrameSide<'_, D, C, M, P, B>
{
    fn answer(&mut self, answer: Answer<M, P, B>) {
        // There is room: the main loop asks for one thing at a time, and one state may be owed.
        let _ = self.ends.answers.enqueue(answer);
    }

    /// The state that a frame has left, which was asked for.
    #[inline(never)]
    pub(crate) fn tell(&mut self) {
        self.asked = false;
        self.answer(Answer::NextFrame(self.frames.snapshot()));
    }

    /// Looks for the row that was asked for in the block that was the frame's `place`-th.
    #[inline(never)]
    pub(crate) fn look(&mut self, place: u16, rows: u16, width: u16, pixels: &[u16]) {
        let Some(wanted) = &mut self.wanted else { return };
        let pixel = (wanted.row.into(), wanted.first.into());
        let start = place.saturating_mul(rows).into();
        if let Some(bytes) = raw_pixels(pixel, pixels, start, width.into()) {
            wanted.found = Some((self.frames.controller.at().frame, bytes));
        }
    }

    /// A frame has ended: the row that was asked for, or that there was none.
    #[inline(never)]
    pub(crate) fn end_of_row(&mut self) {
        let Some(wanted) = &mut self.wanted else { return };
        wanted.ended += 1;
        if wanted.found.is_some() || wanted.ended > 1 {
            let found = wanted.found.take();
            self.wanted = None;
            self.answer(Answer::Row(found));
        }
    }

    /// Has the bank run that was ordered, unless a frame is being read.
    #[inline(never)]
    pub(crate) fn exchange(&mut self, hardware: &mut impl Hardware) {
        if self.frames.next > 0 {
            return;
        }
        let Some(next) = self.ordered.take() else { return };
        let before = self.frames.shape().copied();
        let exchanged = self.frames.exchange(next);
        let other_shape = self.frames.shape().copied() != before;
        self.answer(Answer::Exchanged(exchanged));
        if other_shape {
            // Blocks that wait are of another detector.
            self.restart(hardware);
        }
    }

    #[inline(never)]
    pub(crate) fn command(&mut self, command: Command<M, P, B>, hardware: &mut impl Hardware) {
        let frames = &mut self.frames;
        let answer = match command {
            Command::Exchange(next) => {
                self.ordered = Some(next);
                return self.exchange(hardware);
            }
            Command::Operator(command) => {
                let now = frames.now();
                let (bank, calibrated) = (&frames.bank, frames.calibrated);
                Answer::Done(frames.controller.request(bank, command, calibrated, now))
            }
            Command::GlobalTilt(tilt) => return frames.controller.set_global_tilt(tilt),
            Command::NextFrame => {
                self.asked = true;
                return;
            }
            Command::Row(row, first) => {
                self.wanted = Some(Wanted { row, first, ended: 0, found: None });
                return;
            }
            Command::State => Answer::State(frames.snapshot()),
            Command::Books => Answer::Books(frames.books()),
            Command::Streams(decimation) => {
                if let Some(decimation) = decimation {
                    frames.telemetry.subscribe(decimation);
                }
                Answer::Streams(frames.telemetry.decimation(), frames.telemetry.dropped())
            }
        };
        self.answer(answer);
    }
}
