//! What is done beside the rows, and so not in their memory: once a frame behind its codes, and whenever
//! the frames' exception has run: interlock, missing frames, telemetry.

use crate::clocks::CORE_HZ;
use crate::dac_bus::DacBus;
use crate::frame_loop::{Counter, FrameLoop, Record};
use crate::gate::GateTimer;
use crate::queues::{FrameSide, Hardware, News, Order};
use crate::ring;
use splash_firmware::fault::{Fault, Moment};
use splash_firmware::gate::GateTiming;
use splash_firmware::interlock::Times;
use splash_firmware::mode::Mode;
use splash_firmware::telemetry::{Cycles, Stamp};

/// From the high voltage's enable to the laser's: 100 ms. The longest that the high voltage stays on for
/// the mirror to become flat: a second.
pub const TIMES: Times = Times { settle_ticks: CORE_HZ as u64 / 10, fall_ticks: CORE_HZ as u64 };

/// Cycles from one frame to the next.
#[must_use]
pub fn frame_cycles(timing: &GateTiming) -> u64 {
    // Cycles of a microsecond are whole.
    timing.frame_ns() * u64::from(CORE_HZ / 1_000_000) / 1000
}

impl<D: DacBus, C: Counter, const M: usize, const P: usize, const B: usize>
    FrameLoop<'_, D, C, M, P, B>
{
    /// The time, cycles since the start.
    pub(crate) fn now(&mut self) -> u64 {
        self.time.at(self.counter.now())
    }

    /// Mode and moment, for the last words of a program that has ended.
    pub fn end_of_program(&mut self) -> (Mode, Moment) {
        let at = Moment { ticks: self.now(), ..self.controller.at() };
        (self.controller.mode(), at)
    }

    /// Books a fault that the board found.
    #[inline(never)]
    pub(crate) fn fault(&mut self, fault: Fault) {
        let now = self.now();
        self.controller.fault(fault, now);
    }

    /// What is done with a frame once its codes are on their way.
    #[inline(never)]
    pub(crate) fn book(&mut self, record: &Record) {
        if !record.sent {
            self.fault(Fault::Dacs);
        }
        let stamp = Stamp { configuration: self.hash, cycles: record.cycles };
        self.telemetry.fill(self.controller.pipeline(), &record.result, &stamp);
        self.last = Some(record.result);
    }

    /// Ramps to the flat map when the program has ended, whatever state this is in; each step takes a
    /// frame's time, and the watchdog bounds them all. The last codes are out when this returns.
    #[inline(never)]
    pub fn emergency(&mut self) {
        let Self { controller, bank, dacs, counter, frame_cycles, .. } = self;
        // Half a turn of the counter is more than the watchdog leaves.
        let pause = (*frame_cycles).min(1 << 31) as u32;
        let wait = |counter: &C| {
            let start = counter.now();
            while counter.now().wrapping_sub(start) < pause {}
        };
        controller.emergency(&**bank, |codes| {
            wait(counter);
            let _ = dacs.update(codes);
        });
        wait(counter);
    }

    /// What becomes of a frame that is due and has not come: one that has not begun is missing, one that
    /// does not go on ends.
    fn overdue(&mut self) -> Option<Record> {
        let now = self.now();
        let due = self.due.filter(|due| *due <= now)?;
        let next = due.wrapping_add(self.frame_cycles.max(1));
        // Where time has passed unseen, its frames are not missing one by one.
        self.due = Some(if next > now { next } else { now.wrapping_add(self.frame_cycles) });
        if self.next > 0 {
            return self.end();
        }
        self.clock.give_up();
        let at = self.counter.now();
        let result = self.controller.missing(&self.bank, now);
        Some(self.hand_out(result, Cycles::default(), at))
    }
}

impl<D: DacBus, C: Counter, const M: usize, const P: usize, const B: usize>
    FrameSide<'_, D, C, M, P, B>
{
    /// A frame has ended, or is missing.
    #[inline(never)]
    pub(crate) fn record(&mut self, record: &Record) {
        // One that nobody fetched in time is not missed: others follow.
        let _ = self.ends.news.enqueue(News::Frame(*record));
        if self.asked {
            self.tell();
        }
        self.end_of_row();
    }

    /// Has the gate's timer gate what the controller says.
    #[inline(never)]
    pub(crate) fn gate(&mut self, hardware: &mut impl Hardware) {
        let timer = GateTimer::new(&self.frames.controller.gate().running());
        if timer != self.gate
            && let Some(timer) = timer
        {
            hardware.gate(timer);
            self.gate = Some(timer);
        }
    }

    /// Starts the detector anew.
    #[inline(never)]
    pub(crate) fn restart(&mut self, hardware: &mut impl Hardware) {
        if let Some(&shape) = self.frames.shape() {
            self.start = self.start.wrapping_add(1);
            // There is room: the interrupts take them before this goes on.
            let _ = self.ends.orders.enqueue(Order { start: self.start, shape });
            hardware.wake();
        }
    }

    /// Books that the detector's readout was lost, and starts it again.
    #[cold]
    #[inline(never)]
    pub(crate) fn astray(&mut self, fault: ring::Fault, hardware: &mut impl Hardware) {
        self.frames.fault(match fault {
            ring::Fault::Full => Fault::Deadline,
            ring::Fault::Late | ring::Fault::Overrun | ring::Fault::Astray => Fault::Readout,
        });
        let _ = self.ends.news.enqueue(News::Fault(fault));
        self.restart(hardware);
    }

    /// The end of a run: all that has come is done.
    #[inline(never)]
    pub(crate) fn round(&mut self, hardware: &mut impl Hardware) {
        if let Some(record) = self.frames.overdue() {
            self.record(&record);
        }
        self.exchange(hardware);
        let now = self.frames.now();
        let inputs = hardware.inputs();
        hardware.enable(self.frames.controller.interlock(inputs, now));
        self.gate(hardware);
        self.frames.telemetry.tell(self.frames.controller.faults());
        while self.ends.telemetry.ready()
            && let Some(record) = self.frames.telemetry.pop()
        {
            // There is room.
            let _ = self.ends.telemetry.enqueue(record);
        }
    }
}
