//! Blocks of rows through the controller, and the codes to the DACs: what is done with a frame.

use crate::bank::Half;
use crate::dac_bus::DacBus;
use crate::frame_clock::{FrameClock, Tick};
use crate::shape::Shape;
use crate::time::Time;
use splash_firmware::controller::{Controller, FrameResult, Start};
use splash_firmware::pipeline::{Probe, Stage};
use splash_firmware::strehl::tilt_squared;
use splash_firmware::telemetry::{Cycles, Ring};

/// Records of telemetry that wait for the link.
pub const RECORDS: usize = 32;

/// Counts the processor's cycles; wraps.
pub trait Counter {
    /// The count.
    fn now(&self) -> u32;
}

/// What became of a frame, or of its absence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Record {
    /// What the controller says.
    pub result: FrameResult,
    /// What it took.
    pub cycles: Cycles,
    /// Whether the DACs took its codes.
    pub sent: bool,
    /// Sum of tip^2 + tilt^2 over the last complete frame's valid slopes, ulp^2.
    pub tilt_squared_ulp2: u64,
}

/// What a block was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// Part of a frame.
    Part,
    /// The last of a frame.
    Frame(Record),
    /// Not the one that was due: the detector must be started again.
    Astray,
}

/// Takes blocks one by one.
#[derive(Debug)]
pub struct FrameLoop<'a, D, C, const M: usize, const P: usize, const B: usize> {
    pub(crate) controller: &'a mut Controller<M, B>,
    pub(crate) telemetry: &'a mut Ring<RECORDS>,
    pub(crate) bank: Half<M, P, B>,
    pub(crate) dacs: D,
    pub(crate) counter: C,
    pub(crate) time: Time,
    pub(crate) clock: FrameClock,
    pub(crate) shape: Option<Shape>,
    /// Hash of the bank.
    pub(crate) hash: u32,
    /// A calibration of the bank fits it.
    pub(crate) calibrated: bool,
    /// The block of the frame that is due.
    pub(crate) next: u16,
    /// From one frame to the next, cycles.
    pub(crate) frame_cycles: u64,
    /// When a frame that has not come is missing, cycles; `None` without a detector.
    pub(crate) due: Option<u64>,
    rows: u32,
    pub(crate) last: Option<FrameResult>,
}

/// Reads the counter after each stage.
struct Laps<'a, C> {
    counter: &'a C,
    last: u32,
    stages: [u32; 5],
}

impl<C: Counter> Probe for Laps<'_, C> {
    #[inline(always)]
    fn after(&mut self, stage: Stage) {
        let now = self.counter.now();
        let place = match stage {
            Stage::Slopes => 0,
            Stage::Control => 1,
            Stage::Sor => 2,
            Stage::Segments => 3,
            Stage::Actuators => 4,
        };
        if let Some(cycles) = self.stages.get_mut(place) {
            *cycles = now.wrapping_sub(self.last);
        }
        self.last = now;
    }
}

impl<'a, D: DacBus, C: Counter, const M: usize, const P: usize, const B: usize>
    FrameLoop<'a, D, C, M, P, B>
{
    /// A loop without a detector: the first exchange of banks gives it one.
    pub const fn new(
        controller: &'a mut Controller<M, B>,
        telemetry: &'a mut Ring<RECORDS>,
        bank: Half<M, P, B>,
        dacs: D,
        counter: C,
    ) -> Self {
        Self {
            controller,
            telemetry,
            bank,
            dacs,
            counter,
            time: Time::new(),
            clock: FrameClock::new(),
            shape: None,
            hash: 0,
            calibrated: false,
            next: 0,
            frame_cycles: 0,
            due: None,
            rows: 0,
            last: None,
        }
    }

    /// How frames come.
    pub const fn shape(&self) -> Option<&Shape> {
        self.shape.as_ref()
    }

    /// The next block. `start`: the count of pulses when the frame began, if it began since the last
    /// block; `at`: the cycle at which the block was complete.
    #[inline]
    pub fn block(&mut self, start: Option<u32>, at: u32, pixels: &[u16]) -> Taken {
        let Some(shape) = self.shape else { return Taken::Astray };
        match (self.next, start) {
            (0, Some(stamp)) => self.begin(stamp, at),
            (1.., None) => {}
            _ => return Taken::Astray,
        }
        let before = self.counter.now();
        // A refused block is not for here to judge: the frame will be held and say so.
        let _ = self.controller.push_rows(&self.bank, pixels, shape.rows);
        self.rows = self.rows.wrapping_add(self.counter.now().wrapping_sub(before));
        self.next += 1;
        if self.next < shape.blocks { Taken::Part } else { Taken::Frame(self.finish(at)) }
    }

    /// VSYNC: no more rows of this frame come. One that is not complete ends here, held.
    pub fn end(&mut self) -> Option<Record> {
        (self.next > 0).then(|| self.finish(self.counter.now()))
    }

    fn begin(&mut self, stamp: u32, at: u32) {
        let Tick { number, pulses } = self.clock.tick(stamp, self.bank.timing().pulses_per_frame);
        let ticks = self.time.at(at);
        self.due = Some(ticks.wrapping_add(self.frame_cycles + self.frame_cycles / 2));
        self.rows = 0;
        self.controller.begin(&self.bank, Start { number, pulses, ticks });
    }

    fn finish(&mut self, at: u32) -> Record {
        self.next = 0;
        let mut laps = Laps { counter: &self.counter, last: self.counter.now(), stages: [0; 5] };
        let result = self.controller.finish(&self.bank, &mut laps);
        let cycles = Cycles { rows: self.rows, stages: laps.stages, latency: 0 };
        self.hand_out(result, cycles, at)
    }

    /// The codes to the DACs.
    #[inline(always)]
    pub(crate) fn hand_out(&mut self, result: FrameResult, cycles: Cycles, at: u32) -> Record {
        let sent = self.dacs.update(self.controller.codes()).is_ok();
        let latency = self.counter.now().wrapping_sub(at);
        let tilt_squared_ulp2 = tilt_squared(self.controller.pipeline().slopes());
        let cycles = Cycles { latency, ..cycles };
        let record = Record { result, cycles, sent, tilt_squared_ulp2 };
        self.book(&record);
        record
    }
}
