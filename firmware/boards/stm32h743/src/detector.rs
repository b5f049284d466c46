//! The detector: DCMI, and DMA1 stream 0 in double-buffer mode.
//!
//! DCMI takes up to 14 bits with HSYNC and VSYNC of their own, one crop rectangle and no frame counter:
//! windows are cut out and frames numbered by the firmware.
#![allow(unsafe_code, reason = "the section of what the interrupts call")]

use embassy_stm32::pac::dma::vals::{Burst, Ct, Dir, Dmdis, Fth, Pl, Size};
use embassy_stm32::pac::{DCMI, DMA1, DMAMUX1, RCC};
use stm32h743_logic::requests::DETECTOR;
use stm32h743_logic::ring::Complete;
use stm32h743_logic::shape::Shape;

const STREAM: usize = DETECTOR.stream as usize;
/// How often the camera interface is asked whether its FIFO is empty: about 2 us.
const FIFO_READS: u32 = 100;

/// What the interrupts have of it.
pub(crate) struct Dma {
    ring: u32,
}

impl Dma {
    /// A stopped one that writes to the ring at this address.
    pub(crate) fn new(ring: u32) -> Self {
        RCC.ahb1enr().modify(|w| w.set_dma1en(true));
        RCC.ahb2enr().modify(|w| w.set_dcmien(true));
        let _ = RCC.ahb2enr().read();
        DMAMUX1.ccr(STREAM).write(|w| w.set_dmareq_id(DETECTOR.request));
        Self { ring }
    }

    #[inline(always)]
    fn address(&self, shape: &Shape, slot: u16) -> u32 {
        // Inside AXI SRAM.
        self.ring + shape.offset(slot) as u32
    }

    /// Stops whatever is being read, and waits for the next frame.
    #[unsafe(link_section = ".itcm.detector")]
    pub(crate) fn start(&mut self, shape: &Shape) {
        self.stop();
        let stream = DMA1.st(STREAM);
        stream.par().write_value(DCMI.dr().as_ptr().addr() as u32);
        stream.m0ar().write_value(self.address(shape, 0));
        stream.m1ar().write_value(self.address(shape, 1));
        stream.ndtr().write(|w| w.set_ndt(shape.transfers()));
        stream.fcr().write(|w| {
            w.set_dmdis(Dmdis::DISABLED);
            w.set_fth(Fth::HALF);
        });
        stream.cr().write(|w| {
            w.set_dir(Dir::PERIPHERAL_TO_MEMORY);
            w.set_psize(Size::BITS32);
            w.set_msize(Size::BITS32);
            w.set_minc(true);
            w.set_mburst(if shape.bursts() { Burst::INCR4 } else { Burst::SINGLE });
            w.set_pl(Pl::VERY_HIGH);
            w.set_circ(true);
            w.set_dbm(true);
            w.set_tcie(true);
        });
        stream.cr().modify(|w| w.set_en(true));
        // Pixels count at the rising edge of their clock, while HSYNC and VSYNC are high. VSYNC's
        // interrupt comes when it goes low: a frame has ended.
        DCMI.cr().write(|w| {
            w.set_pckpol(true);
            w.set_edm(shape.data_mode());
            w.set_enable(true);
        });
        DCMI.icr().write(|w| w.set_vsync_isc(true));
        DCMI.ier().write(|w| w.set_vsync_ie(true));
        DCMI.cr().modify(|w| w.set_capture(true));
    }

    /// Stops it at once.
    #[unsafe(link_section = ".itcm.detector")]
    pub(crate) fn stop(&mut self) {
        DCMI.ier().write(|_| ());
        DCMI.cr().modify(|w| w.set_capture(false));
        DCMI.cr().modify(|w| w.set_enable(false));
        let stream = DMA1.st(STREAM);
        stream.cr().modify(|w| w.set_en(false));
        // At most the burst that is under way.
        while stream.cr().read().en() {}
        self.clear();
        DCMI.icr().write(|w| w.set_ovr_isc(true));
        let _ = crate::gate::take_stamp();
    }

    #[inline(always)]
    fn clear(&mut self) {
        DMA1.ifcr(STREAM / 4).write(|w| {
            w.set_tcif(STREAM % 4, true);
            w.set_htif(STREAM % 4, true);
            w.set_teif(STREAM % 4, true);
            w.set_dmeif(STREAM % 4, true);
            w.set_feif(STREAM % 4, true);
        });
    }

    /// If a buffer is full, whether the DMA now fills the second one.
    #[inline(always)]
    pub(crate) fn complete(&mut self) -> Option<bool> {
        if !DMA1.isr(STREAM / 4).read().tcif(STREAM % 4) {
            return None;
        }
        self.clear();
        Some(DMA1.st(STREAM).cr().read().ct() == Ct::MEMORY1)
    }

    /// Whether a frame has ended, once. Its last pixels have then left the camera interface.
    #[inline(always)]
    pub(crate) fn ended(&mut self) -> bool {
        if !DCMI.ris().read().vsync_ris() {
            return false;
        }
        DCMI.icr().write(|w| w.set_vsync_isc(true));
        // Its FIFO has four words; a DMA that does not fetch them has other ways to be noticed.
        let _ = (0..FIFO_READS).find(|_| !DCMI.sr().read().fne());
        true
    }

    /// Transfers until the block that is being filled is complete; all of them before the first.
    #[inline(always)]
    pub(crate) fn left(&self) -> u16 {
        DMA1.st(STREAM).ndtr().read().ndt()
    }

    /// Whether pixels were lost.
    #[inline(always)]
    pub(crate) fn overrun(&self) -> bool {
        DCMI.ris().read().ovr_ris()
    }

    /// Aims the buffer that is not being filled.
    #[inline(always)]
    pub(crate) fn aim(&mut self, shape: &Shape, complete: &Complete) {
        let address = self.address(shape, complete.next);
        let stream = DMA1.st(STREAM);
        let register = if complete.second { stream.m1ar() } else { stream.m0ar() };
        register.write_value(address);
    }
}
