//! The main loop's duties: the link, watchdog and log. They are done in every wait.

use crate::counter::{Cycles, milliseconds};
use crate::flash::Bank2;
use crate::{gate, interrupts, stack, uart};
use core::convert::Infallible;
use embassy_stm32::peripherals::IWDG1;
use embassy_stm32::wdg::IndependentWatchdog;
use heapless::spsc::Consumer;
use splash_firmware::fault::Fault;
use splash_firmware::link::Stack;
use splash_firmware::strehl;
use splash_firmware::watchdog::{Part, Watchdog};
use splash_server::Link;
use stm32h743_logic::flash::Flash;
use stm32h743_logic::frame_loop::{Counter, Record};
use stm32h743_logic::queues::News;
use stm32h743_logic::service::Board;

/// For how long a PC is let wait for a frame, ms.
const PATIENCE_MS: u32 = 1_000;
/// Bytes that are sent before the other duties are looked at again: 174 us.
const SENT_AT_ONCE: usize = 16;
/// Frames from one line of the log to the next.
const LOG_FRAMES: u32 = 1_000;
/// Wavelength of the Strehl ratio in the log, nm.
const WAVELENGTH_NM: f32 = 532.0;

/// What the main loop has.
pub(crate) struct Desk {
    link: uart::Link,
    watchdog: IndependentWatchdog<'static, IWDG1>,
    news: Consumer<'static, News>,
    cycle: Watchdog,
    /// Frames are taken from the detector.
    reading: bool,
    ulp_m: f64,
    /// Frames and faults of the detector since the start.
    frames: u32,
    faults: u32,
    /// Cycles, of the slowest of the frames since the last line of the log.
    slowest: u32,
    waiting_since: u32,
}

impl Desk {
    pub(crate) fn new(
        link: uart::Link,
        watchdog: IndependentWatchdog<'static, IWDG1>,
        news: Consumer<'static, News>,
    ) -> Self {
        Self {
            link,
            watchdog,
            news,
            cycle: Watchdog::new(),
            reading: false,
            ulp_m: 0.0,
            frames: 0,
            faults: 0,
            slowest: 0,
            waiting_since: 0,
        }
    }

    /// A round of all duties but the link. The interlock is the frames' exception's, which this wakes.
    pub(crate) fn round(&mut self) {
        interrupts::wake();
        if interrupts::ran() {
            self.cycle.done(Part::Interlock);
        }
        while let Some(news) = self.news.dequeue() {
            match news {
                News::Frame(record) => self.frame(&record),
                News::Fault(fault) => {
                    self.faults = self.faults.wrapping_add(1);
                    // A detector that never fits would fill the log.
                    if self.faults.is_power_of_two() {
                        defmt::warn!("detector started again ({}), fault {}", fault, self.faults);
                    }
                }
            }
        }
        self.cycle.done(Part::Service);
        if self.cycle.feed(self.reading, gate::stamp()) {
            self.watchdog.pet();
        }
    }

    fn frame(&mut self, record: &Record) {
        let result = &record.result;
        // One that never came has not shown that others could.
        if record.sent && result.fault != Some(Fault::FrameMissing) {
            self.cycle.done(Part::Frame);
        }
        self.frames = self.frames.wrapping_add(1);
        self.slowest = self.slowest.max(record.cycles.latency);
        if !self.frames.is_multiple_of(LOG_FRAMES) {
            return;
        }
        let report = &result.report;
        let rms_nm = strehl::tilt_rms_nm(record.tilt_squared_ulp2, report.valid, self.ulp_m);
        defmt::info!(
            "frame {} ({}): {}, {} valid, tilts {} nm rms, Strehl ratio of these {}; slowest tail {}, {}, {}",
            report.frame,
            result.mode,
            report.outcome,
            report.valid,
            rms_nm,
            strehl::strehl(rms_nm, WAVELENGTH_NM),
            self.slowest,
            record.cycles,
            result.gate,
        );
        self.slowest = 0;
    }
}

impl Link for Desk {
    /// A wire does not end.
    type Error = Infallible;

    fn receive(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
        for byte in bytes {
            *byte = loop {
                if let Some(byte) = self.link.next() {
                    break byte;
                }
                self.round();
            };
        }
        // A link that is never silent does not keep it from its duties.
        self.round();
        Ok(())
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), Infallible> {
        for bytes in bytes.chunks(SENT_AT_ONCE) {
            self.link.send(bytes);
            self.round();
        }
        Ok(())
    }
}

impl Board for Desk {
    type Flash<'a> = Flash<Bank2<'a>>;

    fn next(&mut self) -> Result<Option<u8>, Infallible> {
        Ok(self.link.next())
    }

    fn begin_wait(&mut self) {
        self.waiting_since = Cycles.now();
    }

    fn wait(&mut self) -> bool {
        self.round();
        Cycles.now().wrapping_sub(self.waiting_since) < milliseconds(PATIENCE_MS)
    }

    fn stack(&self) -> Stack {
        stack::stack()
    }

    fn flash(&mut self) -> Flash<Bank2<'_>> {
        Flash::new(Bank2 { desk: self })
    }

    fn configured(&mut self, ulp_m: f64) {
        self.ulp_m = ulp_m;
        self.reading = true;
    }
}
