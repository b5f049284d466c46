//! The two interrupts. Both lie in ITCM with all that they call.
//!
//! | | rows: `DMA1_STREAM0` | frame: `DCMI` |
//! |---|---|---|
//! | raised by | the DMA, when a block of k rows is complete | the rows interrupt, and the main loop for its commands |
//! | priority | 0, the highest | 1 |
//! | does | aims the DMA at another block; hands the block on | blocks through the pipeline; after the last one the tail, and starts the DACs |
//! | must be over | before the next block is complete | before the ring of blocks is full: one frame period, on average |
//! | if it is late | the DMA goes on where it was aimed before: seen from which buffer it is in, the frame is held, the detector started again | the same: the ring says that it is full before anything is overwritten |
//!
//! The vector of `DCMI` is the frame interrupt's because it is free: DCMI's own requests stay masked, its
//! lost pixels are looked for with each block.
#![allow(unsafe_code, reason = "vectors, their sections, and what is handed to them")]

use crate::counter::Cycles;
use crate::dacs::DmaDacs;
use crate::detector::Dma;
use crate::geometry::{B, M, P};
use crate::handed::Handed;
use crate::memory::RowRing;
use cortex_m::peripheral::NVIC;
use embassy_stm32::pac::Interrupt;
use stm32h743_logic::frame_loop::Counter;
use stm32h743_logic::queues::{Detector, FrameSide, RowSide};
use stm32h743_logic::ring::Fault;
use stm32h743_logic::shape::Shape;

/// What the rows interrupt has.
pub(crate) struct Rows {
    pub(crate) side: RowSide<'static>,
    pub(crate) detector: Dma,
}

/// What the frame interrupt has.
pub(crate) struct Frames {
    pub(crate) side: FrameSide<'static, DmaDacs, Cycles, M, P, B>,
    pub(crate) ring: RowRing,
}

static ROWS: Handed<Rows> = Handed::new();
static FRAMES: Handed<Frames> = Handed::new();

/// Priority in the upper four bits of the register's byte.
const fn priority(level: u8) -> u8 {
    level << 4
}

/// Hands both what they have, and enables them.
pub(crate) fn start(core: &mut cortex_m::Peripherals, rows: Rows, frames: Frames) {
    NVIC::mask(Interrupt::DMA1_STREAM0);
    NVIC::mask(Interrupt::DCMI);
    // SAFETY: both are masked, and the main program does this once. Their priorities are not those of
    // a critical section, which masks all.
    unsafe {
        ROWS.give(rows);
        FRAMES.give(frames);
        core.NVIC.set_priority(Interrupt::DMA1_STREAM0, priority(0));
        core.NVIC.set_priority(Interrupt::DCMI, priority(1));
        NVIC::unmask(Interrupt::DMA1_STREAM0);
        NVIC::unmask(Interrupt::DCMI);
    }
}

/// Lets the frame interrupt look at its queues.
pub(crate) fn wake() {
    NVIC::pend(Interrupt::DCMI);
}

/// A block of k rows is complete, or the frame interrupt has an order.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.rows")]
extern "C" fn DMA1_STREAM0() {
    let at = Cycles.now();
    // SAFETY: this is the rows interrupt.
    let Some(Rows { side, detector }) = (unsafe { ROWS.mine() }) else { return };
    if let Some(shape) = side.order() {
        detector.start(&shape);
        return;
    }
    if let Some(second) = detector.complete() {
        let aimed = if detector.overrun() {
            side.lost(Fault::Overrun);
            None
        } else {
            side.complete(second, crate::gate::take_stamp(), at)
        };
        match aimed {
            Some((complete, shape)) => detector.aim(&shape, &complete),
            None => detector.stop(),
        }
        wake();
    }
}

/// The detector, as the frame interrupt sees it.
struct Blocks<'a>(&'a mut RowRing);

impl Detector for Blocks<'_> {
    #[inline(always)]
    fn pixels(&mut self, shape: &Shape, slot: u16) -> &[u16] {
        self.0.pixels(shape, slot)
    }

    fn wake(&mut self) {
        NVIC::pend(Interrupt::DMA1_STREAM0);
    }
}

/// Blocks or commands have come.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.frames")]
extern "C" fn DCMI() {
    // SAFETY: this is the frame interrupt.
    if let Some(Frames { side, ring }) = unsafe { FRAMES.mine() } {
        side.run(&mut Blocks(ring));
    }
}
