//! Blocks of rows through the pipeline, and the codes to the DACs: what is done with a frame.

use crate::dac_bus::DacBus;
use crate::frame_clock::{FrameClock, Tick};
use crate::shape::Shape;
use splash_firmware::config::Config;
use splash_firmware::pipeline::{Pipeline, Probe, Report, Stage};
use splash_firmware::strehl::tilt_squared;

/// Frames that were missed and are held one by one, so that the mirror's past is right: it goes back by
/// no more than these.
const HELD: u32 = 4;

/// Counts the processor's cycles; wraps.
pub trait Counter {
    /// The count.
    fn now(&self) -> u32;
}

/// What a frame took, cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Cycles {
    /// All its blocks of rows.
    pub rows: u32,
    /// The stages behind them.
    pub stages: [u32; 5],
    /// From the interrupt of its last block to the start of the DACs' transfer.
    pub latency: u32,
}

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Record {
    /// What the pipeline says.
    pub report: Report,
    /// What it took.
    pub cycles: Cycles,
    /// Its place among the laser's pulses.
    pub tick: Tick,
    /// Whether the DACs took its codes.
    pub sent: bool,
    /// Sum of tip^2 + tilt^2 over valid slopes, ulp^2.
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
    pub(crate) pipeline: &'a mut Pipeline<M, B>,
    pub(crate) bank: &'a mut Config<M, P, B>,
    pub(crate) dacs: D,
    counter: C,
    clock: FrameClock,
    pub(crate) shape: Option<Shape>,
    /// The block of the frame that is due.
    pub(crate) next: u16,
    tick: Tick,
    rows: u32,
    pub(crate) report: Option<Report>,
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
        pipeline: &'a mut Pipeline<M, B>,
        bank: &'a mut Config<M, P, B>,
        dacs: D,
        counter: C,
    ) -> Self {
        let tick = Tick { number: 0, missed: 0, slip: 0 };
        let clock = FrameClock::new();
        Self {
            pipeline,
            bank,
            dacs,
            counter,
            clock,
            shape: None,
            next: 0,
            tick,
            rows: 0,
            report: None,
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
            (0, Some(stamp)) => self.begin(stamp),
            (1.., None) => {}
            _ => return Taken::Astray,
        }
        let before = self.counter.now();
        // A refused block is not for here to judge: the frame will be held and say so.
        let _ = self.pipeline.push_rows(self.bank, pixels, shape.rows);
        self.rows = self.rows.wrapping_add(self.counter.now().wrapping_sub(before));
        self.next += 1;
        if self.next < shape.blocks { Taken::Part } else { Taken::Frame(self.finish(at)) }
    }

    /// VSYNC: no more rows of this frame come. One that is not complete ends here, held.
    pub fn end(&mut self) -> Option<Record> {
        (self.next > 0).then(|| self.finish(self.counter.now()))
    }

    fn begin(&mut self, stamp: u32) {
        self.tick = self.clock.tick(stamp, self.bank.timing().pulses_per_frame);
        for missed in (1..=self.tick.missed.min(HELD)).rev() {
            self.pipeline.begin(self.bank, self.tick.number.wrapping_sub(missed));
            self.pipeline.finish(self.bank);
        }
        self.rows = 0;
        self.pipeline.begin(self.bank, self.tick.number);
    }

    fn finish(&mut self, at: u32) -> Record {
        self.next = 0;
        let mut laps = Laps { counter: &self.counter, last: self.counter.now(), stages: [0; 5] };
        let report = self.pipeline.finish_probed(self.bank, &mut laps);
        let stages = laps.stages;
        let sent = self.dacs.update(self.pipeline.codes()).is_ok();
        let latency = self.counter.now().wrapping_sub(at);
        self.report = Some(report);
        Record {
            report,
            cycles: Cycles { rows: self.rows, stages, latency },
            tick: self.tick,
            sent,
            tilt_squared_ulp2: tilt_squared(self.pipeline.slopes()),
        }
    }
}
