//! Link, detector and DACs.
#![allow(unsafe_code, reason = "the ring that the detector port writes")]

use crate::map::Register;
use core::cell::UnsafeCell;
use core::sync::atomic::{Ordering, compiler_fence};
use splash_server::Port;

/// Words of the ring of rows: two rows of the widest detector, 16 and more of a usual one.
const RING_WORDS: usize = 4096;
/// Rows in the ring at most.
const RING_ROWS: usize = 16;
/// Where data memory starts.
const DMEM: usize = 0x1000_0000;

/// The other end of the link is gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Closed;

/// Rows that the detector port has written and not yet been given back.
struct Ring(UnsafeCell<[u32; RING_WORDS]>);

// SAFETY: one hart, see `Once`.
unsafe impl Sync for Ring {}

static RING: Ring = Ring(UnsafeCell::new([0; RING_WORDS]));

/// The core's ways in and out. There is one of each: see [`Ports::new`].
pub struct Ports {
    /// Pixels in a row, and of the frame that are to come.
    width: usize,
    left: usize,
    /// Rows in the ring.
    rows: usize,
    /// Place of the next row, and whether the one before it is still out.
    next: usize,
    lent: bool,
}

impl Ports {
    /// The ports. Rows are lent by the value that made them: make one only.
    pub const fn new() -> Self {
        Self { width: 0, left: 0, rows: 0, next: 0, lent: false }
    }

    /// Words from one row of the ring to the next.
    fn stride(&self) -> usize {
        self.width.div_ceil(2)
    }
}

impl Default for Ports {
    fn default() -> Self {
        Self::new()
    }
}

impl Port for Ports {
    type Error = Closed;

    fn receive(&mut self, bytes: &mut [u8]) -> Result<(), Closed> {
        for byte in bytes {
            *byte = loop {
                let word = Register::LINK_IN.read();
                if word & (1 << 8) != 0 {
                    break word as u8;
                }
                if word & (1 << 9) != 0 {
                    return Err(Closed);
                }
            };
        }
        Ok(())
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), Closed> {
        for &byte in bytes {
            while Register::LINK_OUT.read() & 1 == 0 {}
            Register::LINK_OUT.write(byte.into());
        }
        Ok(())
    }

    fn expose(&mut self, pixels: usize, width: usize) -> Result<(), Closed> {
        self.width = width;
        self.left = pixels;
        self.rows = (RING_WORDS / self.stride().max(1)).min(RING_ROWS);
        self.next = 0;
        self.lent = false;
        let base = RING.0.get().addr() - DMEM;
        Register::DETECTOR_BASE.write((base / 4) as u32);
        Register::DETECTOR_WIDTH.write(width as u32);
        Register::DETECTOR_RING.write(self.rows as u32);
        Register::DETECTOR_CONTROL.write(pixels as u32);
        Ok(())
    }

    fn row(&mut self) -> Result<Option<&[u16]>, Closed> {
        let width = self.width.min(self.left);
        if width == 0 {
            return Ok(None);
        }
        self.left -= width;
        if self.lent {
            Register::DETECTOR_TAKEN.write(1);
        }
        while Register::DETECTOR_ROWS.read() == 0 {}
        // The row was written before the count that says so was read.
        compiler_fence(Ordering::Acquire);
        let at = self.next * self.stride();
        self.next = (self.next + 1) % self.rows.max(1);
        self.lent = true;
        let ring = RING.0.get().cast::<u32>();
        // SAFETY: the row lies in the ring, at whole words; the port wrote all of it, and does not
        // write it again before it is given back, for which this value must be borrowed anew.
        Ok(Some(unsafe { core::slice::from_raw_parts(ring.add(at).cast(), width) }))
    }

    fn actuate(&mut self, codes: &[[u16; 3]]) -> Result<(), Closed> {
        codes.as_flattened().iter().for_each(|&code| Register::DAC_CODE.write(code.into()));
        Register::DAC_LOAD.write(1);
        Ok(())
    }

    #[inline(always)]
    fn mark() {
        mark();
    }
}

/// Marks this moment for whoever counts cycles outside.
#[inline(always)]
pub fn mark() {
    compiler_fence(Ordering::SeqCst);
    Register::MARK.write(0);
    compiler_fence(Ordering::SeqCst);
}
