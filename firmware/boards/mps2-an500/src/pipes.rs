//! The board's ways in and out: named pipes in the emulator's working directory, by semihosting.

use crate::stack::stack_used;
use crate::{STACK_BYTES, mark};
use semihosting::fs::File;
use semihosting::io::{ErrorKind, Read, Result, Write};
use splash_firmware::link::Stack;
use splash_server::{NoFlash, Port};

/// Pixels of the longest row that a configuration may have.
const ROW: usize = 4096;
/// Rows taken at once, as far as they fit the place of the longest.
const BLOCK: usize = 16;

/// Bytes of the link that are read ahead: each read of the host stops the emulated processor.
const AHEAD: usize = 1024;

/// `link.in`, `link.out` and `detector` (raw pixels, u16 little-endian, row after row).
pub struct Pipes {
    requests: File,
    answers: File,
    detector: File,
    ahead: [u8; AHEAD],
    /// Bytes of `ahead` that were taken, and that are there.
    taken: usize,
    filled: usize,
    rows: [u16; ROW],
    /// Pixels of a row, and of the frame that are to come.
    width: usize,
    left: usize,
}

impl Pipes {
    /// Opens the pipes; waits until the other ends are there.
    ///
    /// # Errors
    /// If there are no such pipes in the emulator's working directory.
    pub fn open() -> Result<Self> {
        Ok(Self {
            requests: File::open(c"link.in")?,
            answers: File::create(c"link.out")?,
            detector: File::open(c"detector")?,
            ahead: [0; AHEAD],
            taken: 0,
            filled: 0,
            rows: [0; ROW],
            width: 0,
            left: 0,
        })
    }
}

impl Port for Pipes {
    type Error = semihosting::io::Error;
    type Flash = NoFlash;

    // None of the three is inlined: what semihosting may panic about is seen to be here.
    #[inline(never)]
    fn receive(&mut self, bytes: &mut [u8]) -> Result<()> {
        for byte in bytes {
            if self.taken == self.filled {
                self.filled = self.requests.read(&mut self.ahead)?;
                self.taken = 0;
            }
            let next = self.ahead.get(..self.filled).and_then(|ahead| ahead.get(self.taken));
            *byte = *next.ok_or(ErrorKind::UnexpectedEof)?;
            self.taken += 1;
        }
        Ok(())
    }

    #[inline(never)]
    fn send(&mut self, bytes: &[u8]) -> Result<()> {
        self.answers.write_all(bytes)
    }

    fn expose(&mut self, pixels: usize, width: usize) -> Result<()> {
        (self.left, self.width) = (pixels, width);
        Ok(())
    }

    #[inline(never)]
    fn rows(&mut self) -> Result<Option<&[u16]>> {
        let width = self.width.max(1);
        let rows = (self.left / width).min(ROW / width).min(BLOCK);
        let pixels = if rows > 0 { rows * width } else { self.left };
        self.left -= pixels;
        let rows = self.rows.get_mut(..pixels).ok_or(ErrorKind::InvalidInput)?;
        self.detector.read_exact(bytemuck::cast_slice_mut(rows))?;
        Ok((pixels > 0).then_some(rows))
    }

    /// There are no DACs: the codes leave by the link.
    fn actuate(&mut self, _: &[[u16; 3]]) -> Result<()> {
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
