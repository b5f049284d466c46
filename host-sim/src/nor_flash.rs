//! A NOR flash, with what it does when the power fails.

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read,
    check_write,
};
use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Bytes of a page.
pub const PAGE: usize = 4096;

/// A NOR flash of words of `WORD` bytes: an erase sets bits, a program clears them, each word once.
/// When its steps are used up the power fails in the middle of the next.
#[derive(Clone, Debug)]
pub struct Nor<const WORD: usize> {
    /// What is in it.
    pub bytes: Vec<u8>,
    /// Words and pages before the power fails; `None` for as many as are asked for.
    pub steps: Option<usize>,
    /// Words and pages so far.
    pub taken: usize,
    random: Xoshiro256PlusPlus,
}

/// Why the flash did not do something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NorError {
    /// The power has failed.
    PowerCut,
    /// A word that has been programmed since its page was erased.
    Programmed,
    /// A call that no such flash takes.
    Call(NorFlashErrorKind),
}

impl NorFlashError for NorError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::PowerCut | Self::Programmed => NorFlashErrorKind::Other,
            Self::Call(kind) => *kind,
        }
    }
}

impl<const WORD: usize> Nor<WORD> {
    /// As it comes from the factory, or from a use that left anything in it.
    pub fn new(pages: usize, seed: u64, blank: bool) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut byte = || if blank { 0xff } else { random.next_u32() as u8 };
        let bytes = (0..pages * PAGE).map(|_| byte()).collect();
        Self { bytes, steps: None, taken: 0, random }
    }

    /// Whether there is power for the whole of the next step.
    fn step(&mut self) -> bool {
        self.taken += 1;
        match &mut self.steps {
            None => true,
            Some(0) => false,
            Some(steps) => {
                *steps -= 1;
                true
            }
        }
    }

    /// Whether the power has failed.
    pub fn off(&self) -> bool {
        self.steps == Some(0) && self.taken > 0
    }
}

impl<const WORD: usize> ErrorType for Nor<WORD> {
    type Error = NorError;
}

impl<const WORD: usize> ReadNorFlash for Nor<WORD> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorError> {
        check_read(&*self, offset, bytes.len()).map_err(NorError::Call)?;
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const WORD: usize> NorFlash for Nor<WORD> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorError> {
        check_erase(&*self, from, to).map_err(NorError::Call)?;
        for start in (from as usize..to as usize).step_by(PAGE) {
            let whole = self.step();
            for byte in &mut self.bytes[start..start + PAGE] {
                // Bits of a page whose erase was cut short are anything between before and erased.
                *byte |= if whole { 0xff } else { self.random.next_u32() as u8 };
            }
            if !whole {
                return Err(NorError::PowerCut);
            }
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorError> {
        check_write(&*self, offset, bytes.len()).map_err(NorError::Call)?;
        for (i, word) in bytes.chunks(WORD).enumerate() {
            let start = offset as usize + i * WORD;
            let places = &self.bytes[start..start + WORD];
            if places.iter().any(|&byte| byte != 0xff) {
                return Err(NorError::Programmed);
            }
            let whole = self.step();
            for (place, &byte) in self.bytes[start..start + WORD].iter_mut().zip(word) {
                *place &= if whole { byte } else { byte | self.random.next_u32() as u8 };
            }
            if !whole {
                return Err(NorError::PowerCut);
            }
        }
        Ok(())
    }
}
