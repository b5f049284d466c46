//! The flash controller, bank 2: what the store asks for step by step. The steps are in
//! `stm32h743_logic::flash`.
#![allow(
    unsafe_code,
    reason = "flash at its addresses, and faults that are let pass while it is read"
)]

use crate::desk::Desk;
use core::arch::asm;
use core::sync::atomic::{Ordering, compiler_fence};
use cortex_m::peripheral::SCB;
use embassy_stm32::pac::FLASH;
use embassy_stm32::pac::flash::Bank;
use embassy_stm32::pac::flash::regs::Ccr;
use stm32h743_logic::flash::{BASE, Registers, WORD};

/// What unlocks the control register, one after the other.
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];
/// Bits that are written to the cells at once: 64.
const PARALLEL: u8 = 3;
/// SCB_CCR: no fault for an access that fails at the priority of a hard fault.
const BFHFNMIGN: u32 = 1 << 8;

/// Bank 2, with the main loop's other duties for the time it takes.
pub(crate) struct Bank2<'a> {
    pub(crate) desk: &'a mut Desk,
}

fn bank() -> Bank {
    FLASH.bank(1)
}

/// Forgets all errors.
fn clear() {
    bank().ccr().write_value(Ccr(u32::MAX));
}

impl Registers for Bank2<'_> {
    fn read(&mut self, offset: u32, bytes: &mut [u8]) {
        // Slots are read from end to end, block by block.
        self.desk.round();
        let first: *const u8 = core::ptr::with_exposed_provenance((BASE + offset) as usize);
        clear();
        // A word whose writing was cut short gives a bus error, which is ignored while faults are masked.
        // SAFETY: the mask is held for as long as the bytes take and no longer; they are inside the
        // bank, as the caller has checked, uncached, and not being written.
        unsafe {
            let scb = &*SCB::PTR;
            scb.ccr.modify(|ccr| ccr | BFHFNMIGN);
            asm!("cpsid f", "dsb", "isb");
            for (i, byte) in bytes.iter_mut().enumerate() {
                *byte = first.add(i).read_volatile();
            }
            asm!("dsb", "cpsie f");
            scb.ccr.modify(|ccr| ccr & !BFHFNMIGN);
        }
        if bank().sr().read().dbeccerr() {
            bytes.fill(0);
            clear();
        }
    }

    fn unlock(&mut self) {
        if bank().cr().read().lock() {
            KEYS.iter().for_each(|&key| bank().keyr().write_value(key));
        }
        clear();
    }

    fn erase(&mut self, sector: u8) {
        bank().cr().modify(|w| {
            w.set_ser(true);
            w.set_snb(sector);
            w.set_psize(PARALLEL);
        });
        bank().cr().modify(|w| w.set_start(true));
    }

    fn program(&mut self, offset: u32, word: &[u8; WORD]) {
        bank().cr().modify(|w| {
            w.set_pg(true);
            w.set_psize(PARALLEL);
        });
        cortex_m::asm::dsb();
        let first: *mut u32 = core::ptr::with_exposed_provenance_mut((BASE + offset) as usize);
        for (i, &part) in word.as_chunks().0.iter().enumerate() {
            // SAFETY: inside the bank, as the caller has checked, aligned, and open for writing.
            unsafe { first.add(i).write_volatile(u32::from_le_bytes(part)) };
        }
        compiler_fence(Ordering::SeqCst);
        cortex_m::asm::dsb();
    }

    fn busy(&mut self) -> bool {
        // From the command to its end; a moment passes between the last write and its first sign.
        let status = bank().sr().read();
        let busy = status.qw() || status.bsy();
        if busy {
            self.desk.round();
        }
        busy
    }

    fn lock(&mut self) -> bool {
        let status = bank().sr().read();
        bank().cr().modify(|w| {
            w.set_pg(false);
            w.set_ser(false);
        });
        bank().cr().modify(|w| w.set_lock(true));
        let failed = status.wrperr()
            || status.pgserr()
            || status.strberr()
            || status.incerr()
            || status.operr()
            || status.wbne();
        !failed
    }
}
