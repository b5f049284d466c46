//! The two interrupts, and the exception that works on the frames. All lie in ITCM, and with them what is
//! done once in a row; what is done once in a frame lies in flash.
//!
//! | | block: `DMA1_STREAM0` | end: `DCMI` | frames: `PendSV` |
//! |---|---|---|---|
//! | raised by | the DMA, when a block of k rows is complete | VSYNC, when a frame ends | both interrupts, and the main loop in every round |
//! | priority | 0 | 0: neither interrupts the other | 15, the lowest |
//! | does | aims the DMA at another block, hands the block on | looks whether the frame ended with a block | blocks through the controller; after the last one the tail, and starts the DACs; interlock, gate, missing frames |
//! | must be over | before the next block is complete | before the next frame's first block is | before the ring is full: a frame's work in a frame's time, on average |
//! | if it is late | the DMA goes on where it was aimed before: seen from which buffer it is in, the frame is held, the detector started again | a frame of which rows were missing, and the next one, are held | the ring says that it is full before anything is overwritten; a frame is held, the detector started again |
//!
//! Critical sections do not mask the interrupts ([`crate::critical`]), and these have no part in any: they log
//! nothing. Both only keep books, so that a frame's work may take longer than its rows do to arrive.
#![allow(unsafe_code, reason = "vectors, their sections, and what is handed to them")]

use crate::counter::Cycles;
use crate::dacs::DmaDacs;
use crate::detector::Dma;
use crate::geometry::{B, M, P};
use crate::handed::Handed;
use crate::memory::RowRing;
use crate::{enables, gate};
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::{NVIC, SCB};
use embassy_stm32::pac::Interrupt;
use splash_firmware::fault::Moment;
use splash_firmware::interlock::{Inputs, Outputs};
use splash_firmware::mode::Mode;
use stm32h743_logic::frame_loop::Counter;
use stm32h743_logic::gate::GateTimer;
use stm32h743_logic::queues::{FrameSide, Hardware, RowSide};
use stm32h743_logic::ring::Fault;
use stm32h743_logic::shape::Shape;

/// What both interrupts have.
pub(crate) struct Rows {
    pub(crate) side: RowSide<'static>,
    pub(crate) detector: Dma,
}

/// What the frames' exception has.
pub(crate) struct Frames {
    pub(crate) side: FrameSide<'static, DmaDacs, Cycles, M, P, B>,
    pub(crate) ring: RowRing,
}

static ROWS: Handed<Rows> = Handed::new();
static FRAMES: Handed<Frames> = Handed::new();
/// The frames' exception has run to its end, and looked at the interlock.
static RAN: AtomicBool = AtomicBool::new(false);

/// Priority in the upper four bits of the register's byte.
const fn priority(level: u8) -> u8 {
    level << 4
}

/// Hands all of them what they have, and enables them.
pub(crate) fn start(core: &mut cortex_m::Peripherals, rows: Rows, frames: Frames) {
    NVIC::mask(Interrupt::DMA1_STREAM0);
    NVIC::mask(Interrupt::DCMI);
    // SAFETY: both are masked, nothing has raised the exception, and the main program does this once.
    // Critical sections mask the exception, and not the interrupts, which have no part in them.
    unsafe {
        ROWS.give(rows);
        FRAMES.give(frames);
        core.NVIC.set_priority(Interrupt::DMA1_STREAM0, priority(0));
        core.NVIC.set_priority(Interrupt::DCMI, priority(0));
        core.SCB.set_priority(SystemHandler::PendSV, priority(15));
        NVIC::unmask(Interrupt::DMA1_STREAM0);
        NVIC::unmask(Interrupt::DCMI);
    }
}

/// Lets the frames' exception look at its queues and the interlock.
pub(crate) fn wake() {
    SCB::set_pendsv();
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Whether it has, since this was last called.
pub(crate) fn ran() -> bool {
    RAN.swap(false, Ordering::Relaxed)
}

/// Ramps the mirror to the flat map, and tells mode and moment of the end; nothing before the start.
///
/// # Safety
/// The program has ended: neither the frames' exception nor the main loop runs on.
pub(crate) unsafe fn emergency() -> (Mode, Moment) {
    // SAFETY: as the caller says; if the exception was running, it never goes on.
    let Some(frames) = (unsafe { FRAMES.mine() }) else { return (Mode::Safe, Moment::default()) };
    let frames = frames.side.frames();
    let end = frames.end_of_program();
    frames.emergency();
    end
}

/// A block of k rows is complete, or there is an order to start the detector.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.block")]
extern "C" fn DMA1_STREAM0() {
    // SAFETY: of the two interrupts that use it neither interrupts the other.
    let Some(rows) = (unsafe { ROWS.mine() }) else { return };
    match rows.side.order() {
        Some(shape) => rows.detector.start(&shape),
        None => rows.block(),
    }
    wake();
}

/// A frame has ended.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.end")]
extern "C" fn DCMI() {
    // SAFETY: as above.
    let Some(rows) = (unsafe { ROWS.mine() }) else { return };
    if rows.detector.ended() {
        // Its last block may be complete only now, or be so since this interrupt was raised.
        rows.block();
        if !rows.side.end(rows.detector.left()) {
            rows.detector.stop();
        }
    }
    wake();
}

impl Rows {
    /// Books a block, if one is complete.
    #[inline(always)]
    fn block(&mut self) {
        let at = Cycles.now();
        let Some(second) = self.detector.complete() else { return };
        let aimed = if self.detector.overrun() {
            self.side.lost(Fault::Overrun);
            None
        } else {
            self.side.complete(second, gate::take_stamp, at)
        };
        match aimed {
            Some((complete, shape)) => self.detector.aim(&shape, &complete),
            None => self.detector.stop(),
        }
    }
}

/// The hardware, as the frames' exception sees it.
struct Board<'a>(&'a mut RowRing);

impl Hardware for Board<'_> {
    #[inline(always)]
    fn pixels(&mut self, shape: &Shape, slot: u16) -> &[u16] {
        self.0.pixels(shape, slot)
    }

    fn wake(&mut self) {
        NVIC::pend(Interrupt::DMA1_STREAM0);
    }

    fn inputs(&mut self) -> Inputs {
        enables::inputs()
    }

    fn enable(&mut self, outputs: Outputs) {
        enables::set(outputs);
    }

    fn gate(&mut self, timer: GateTimer) {
        gate::set(timer);
    }
}

/// Blocks or commands have come, or the main loop begins a round.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.frames")]
extern "C" fn PendSV() {
    // SAFETY: this is the exception that it was given to.
    if let Some(Frames { side, ring }) = unsafe { FRAMES.mine() } {
        side.run(&mut Board(ring));
        RAN.store(true, Ordering::Relaxed);
    }
}
