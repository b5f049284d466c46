//! The flash of a board that has none.

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// A device without a byte.
#[derive(Clone, Copy, Debug)]
pub enum NoFlash {}

/// Nothing can be done to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Never {}

impl NorFlashError for Never {
    fn kind(&self) -> NorFlashErrorKind {
        match *self {}
    }
}

impl ErrorType for NoFlash {
    type Error = Never;
}

impl ReadNorFlash for NoFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, _: u32, _: &mut [u8]) -> Result<(), Never> {
        match *self {}
    }

    fn capacity(&self) -> usize {
        match *self {}
    }
}

impl NorFlash for NoFlash {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = 64;

    fn erase(&mut self, _: u32, _: u32) -> Result<(), Never> {
        match *self {}
    }

    fn write(&mut self, _: u32, _: &[u8]) -> Result<(), Never> {
        match *self {}
    }
}
