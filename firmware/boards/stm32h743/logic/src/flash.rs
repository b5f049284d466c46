//! The store's flash: two sectors of bank 2, on the registers of the flash controller.
//!
//! The program runs from bank 1, which can be read while bank 2 is erased or written: frames go on. A
//! sector takes a second or two to erase and a word of 32 bytes a few hundred microseconds to write;
//! in both the main loop goes on with its other duties. Each word has a checksum of its own: one of which
//! the writing was cut short cannot be read, and reads as zeros here.

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read,
    check_write,
};

/// First address of bank 2, `STORE` in memory.x.
pub const BASE: u32 = 0x0810_0000;
/// Bytes of a sector: what is erased at once, and what a slot of the store is.
pub const SECTOR: usize = 128 << 10;
/// Sectors in use, from the first of the bank on.
pub const SECTORS: usize = 2;
/// Bytes that are written at once.
pub const WORD: usize = 32;

/// The flash controller's registers of bank 2.
pub trait Registers {
    /// Reads from so many bytes behind the bank's start; zeros for a word that is broken.
    fn read(&mut self, offset: u32, bytes: &mut [u8]);

    /// Lets the bank be changed, forgetting errors of before.
    fn unlock(&mut self);

    /// Begins to erase a sector.
    fn erase(&mut self, sector: u8);

    /// Begins to write a word.
    fn program(&mut self, offset: u32, word: &[u8; WORD]);

    /// Whether the bank is busy; other duties are done meanwhile.
    fn busy(&mut self) -> bool;

    /// Ends it: nothing can be changed any more. Whether all went well.
    fn lock(&mut self) -> bool;
}

/// Why nothing was read or written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FlashError {
    /// Beyond the end, or not whole words or sectors.
    Place,
    /// The controller reports an error.
    Refused,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Place => NorFlashErrorKind::OutOfBounds,
            Self::Refused => NorFlashErrorKind::Other,
        }
    }
}

impl From<NorFlashErrorKind> for FlashError {
    fn from(_: NorFlashErrorKind) -> Self {
        Self::Place
    }
}

/// The two sectors.
#[derive(Debug)]
pub struct Flash<R> {
    registers: R,
}

impl<R: Registers> Flash<R> {
    /// On these registers.
    pub const fn new(registers: R) -> Self {
        Self { registers }
    }

    /// One change, from its beginning to its end.
    fn change(&mut self, begin: impl FnOnce(&mut R)) -> Result<(), FlashError> {
        self.registers.unlock();
        begin(&mut self.registers);
        while self.registers.busy() {}
        if self.registers.lock() { Ok(()) } else { Err(FlashError::Refused) }
    }
}

impl<R> ErrorType for Flash<R> {
    type Error = FlashError;
}

impl<R: Registers> ReadNorFlash for Flash<R> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check_read(self, offset, bytes.len())?;
        self.registers.read(offset, bytes);
        Ok(())
    }

    fn capacity(&self) -> usize {
        SECTORS * SECTOR
    }
}

impl<R: Registers> NorFlash for Flash<R> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        check_erase(self, from, to)?;
        let sector = |offset: u32| (offset / SECTOR as u32) as u8;
        (sector(from)..sector(to)).try_for_each(|sector| self.change(|r| r.erase(sector)))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check_write(self, offset, bytes.len())?;
        let words = bytes.as_chunks().0.iter().zip((offset..).step_by(WORD));
        words.into_iter().try_for_each(|(word, offset)| self.change(|r| r.program(offset, word)))
    }
}
