//! Link, detector and DACs.
#![allow(unsafe_code, reason = "the ring that the detector port writes")]

use crate::STACK_BYTES;
use crate::map::Register;
use crate::start::stack_used;
use core::cell::UnsafeCell;
use core::sync::atomic::{Ordering, compiler_fence};
use splash_firmware::link::Stack;
use splash_server::{NoFlash, Port};

/// Words of the ring of rows: two rows of the widest detector.
const RING_WORDS: usize = 4096;
/// Rows taken at once at most. Half of the ring: the detector fills the other one meanwhile. A window
/// of 16 rows is fetched once a frame; what is left to do when the last pixel is in grows with it.
const BLOCK: usize = 16;
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
    /// Rows in half of the ring, and place of the next one.
    block: usize,
    next: usize,
    /// Rows that are out.
    lent: usize,
}

impl Ports {
    /// The ports. Rows are lent by the value that made them: make one only.
    pub const fn new() -> Self {
        Self { width: 0, left: 0, block: 0, next: 0, lent: 0 }
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
    type Flash = NoFlash;

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
        (self.width, self.left) = (width, pixels);
        // Rows of an odd number of pixels do not lie side by side.
        let most = if width.is_multiple_of(2) { BLOCK } else { 1 };
        self.block = (RING_WORDS / 2 / self.stride().max(1)).clamp(1, most);
        (self.next, self.lent) = (0, 0);
        let base = RING.0.get().addr() - DMEM;
        Register::DETECTOR_BASE.write((base / 4) as u32);
        Register::DETECTOR_WIDTH.write(width as u32);
        Register::DETECTOR_RING.write(2 * self.block as u32);
        Register::DETECTOR_CONTROL.write(pixels as u32);
        Ok(())
    }

    fn rows(&mut self) -> Result<Option<&[u16]>, Closed> {
        if self.left == 0 {
            return Ok(None);
        }
        // A row that is cut short comes alone.
        let rows = (self.left / self.width.max(1)).min(self.block);
        let pixels = if rows > 0 { rows * self.width } else { self.left };
        self.left -= pixels;
        Register::DETECTOR_TAKEN.write(self.lent as u32);
        self.lent = rows.max(1);
        while Register::DETECTOR_ROWS.read() < self.lent as u32 {}
        // The rows were written before the count that says so was read.
        compiler_fence(Ordering::Acquire);
        // All but the last begin a half of the ring: none reaches beyond its end.
        let at = self.next * self.stride();
        self.next = (self.next + self.lent) % (2 * self.block).max(1);
        let ring = RING.0.get().cast::<u32>();
        // SAFETY: the rows lie in the ring, at whole words; the port wrote all of them, and does not
        // write them again before they are given back, for which this value must be borrowed anew.
        Ok(Some(unsafe { core::slice::from_raw_parts(ring.add(at).cast(), pixels) }))
    }

    fn actuate(&mut self, codes: &[[u16; 3]]) -> Result<(), Closed> {
        codes.as_flattened().iter().for_each(|&code| Register::DAC_CODE.write(code.into()));
        Register::DAC_LOAD.write(1);
        Ok(())
    }

    fn stack(&self) -> Stack {
        Stack { used: stack_used() as u32, reserved: STACK_BYTES as u32 }
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
