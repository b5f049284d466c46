//! The running configuration in flash: two slots in turn, so that a power cut loses nothing.
//!
//! ```text
//! slot     header of 64 bytes, then the image, padded with 0xff
//! header   "SPLT"  sequence u32  length u32  hash u32  serial numbers of mirror and detector u32
//!          CRC-32 (ISO-HDLC) of these
//! ```
//!
//! little-endian. A store erases the slot that has not the newest whole image, writes the image and,
//! last, the header. Until the header is whole the other slot counts: at every step of a store there
//! is one whole image at least, the one before or the new one. A slot counts only if header and image
//! are whole, so that an erase cut short cannot pass for either.

use crate::config::Config;
use crate::image::{CRC, ImageError};
use crate::mirror::Serials;
use core::fmt;
use embedded_storage::nor_flash::NorFlash;
use serde::{Deserialize, Serialize};

const MAGIC: [u8; 4] = *b"SPLT";
/// Bytes that are read and written at once: whole flash words of every device in use.
const BLOCK: usize = 64;
/// Bytes of the header that say something.
const HEADER: usize = 28;

/// Why nothing was stored or restored.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoreError<E> {
    /// The device refused.
    Flash(E),
    /// There is no configuration to store.
    NotConfigured,
    /// The image is longer than a slot.
    Long {
        /// With its header, bytes.
        found: u32,
        /// Bytes of a slot.
        slot: u32,
    },
    /// What was written is not what is read back.
    Unreliable,
    /// Neither slot has a whole image.
    Nothing,
    /// The stored image does not fit this firmware or this board.
    Image(ImageError),
}

impl<E: fmt::Debug> fmt::Display for StoreError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Flash(error) => write!(f, "flash: {error:?}"),
            Self::NotConfigured => f.write_str("no configuration to store"),
            Self::Long { found, slot } => {
                write!(f, "configuration of {found} bytes: a slot of the flash has {slot}")
            }
            Self::Unreliable => f.write_str("the flash does not keep what is written to it"),
            Self::Nothing => f.write_str("no configuration is stored"),
            Self::Image(error) => write!(f, "stored {error}"),
        }
    }
}

impl<E: fmt::Debug> core::error::Error for StoreError<E> {}

/// A whole image in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Stored {
    /// Counts the stores; wraps.
    pub sequence: u32,
    /// Hash of the configuration.
    pub hash: u32,
    /// Length of its image, bytes.
    pub length: u32,
    /// The hardware that was there.
    pub serials: Serials,
}

/// Two slots, the halves of a flash device.
#[derive(Debug)]
pub struct Store<F> {
    flash: F,
}

impl<F: NorFlash> Store<F> {
    /// Whether [`BLOCK`] is whole words of the device.
    const FITS: () = assert!(
        BLOCK.is_multiple_of(F::WRITE_SIZE)
            && BLOCK.is_multiple_of(F::READ_SIZE)
            && F::ERASE_SIZE.is_multiple_of(BLOCK),
        "flash words must be parts of 64 bytes, and pages multiples of it"
    );

    /// The store in `flash`.
    pub const fn new(flash: F) -> Self {
        let () = Self::FITS;
        Self { flash }
    }

    /// Gives the device back.
    pub fn into_inner(self) -> F {
        self.flash
    }

    /// Bytes of a slot: whole pages.
    fn slot(&self) -> u32 {
        let half = self.flash.capacity() / 2;
        (half - half % F::ERASE_SIZE) as u32
    }

    fn start(&self, slot: usize) -> u32 {
        if slot == 0 { 0 } else { self.slot() }
    }

    /// The newest whole image, and its slot.
    fn newest(&mut self) -> Result<Option<(usize, Stored)>, StoreError<F::Error>> {
        let (first, second) = (self.stored(0)?, self.stored(1)?);
        Ok(match (first, second) {
            // Newer by less than half of all numbers.
            (Some(a), Some(b)) if (b.sequence.wrapping_sub(a.sequence) as i32) > 0 => Some((1, b)),
            (Some(a), _) => Some((0, a)),
            (None, Some(b)) => Some((1, b)),
            (None, None) => None,
        })
    }

    /// What would be restored.
    ///
    /// # Errors
    /// [`StoreError::Flash`].
    pub fn newest_stored(&mut self) -> Result<Option<Stored>, StoreError<F::Error>> {
        Ok(self.newest()?.map(|(_, stored)| stored))
    }

    /// What a slot has, if all of it is whole.
    fn stored(&mut self, slot: usize) -> Result<Option<Stored>, StoreError<F::Error>> {
        let mut block = [0; BLOCK];
        let start = self.start(slot);
        self.flash.read(start, &mut block).map_err(StoreError::Flash)?;
        let Some(stored) = parse(&block) else { return Ok(None) };
        if stored.length > self.slot().saturating_sub(BLOCK as u32) {
            return Ok(None);
        }
        // The last four bytes of an image are the checksum of those before, and its hash.
        let mut digest = CRC.digest();
        let mut end = [0; 4];
        let mut left = stored.length as usize;
        let checked = left.saturating_sub(end.len());
        let mut at = start;
        while left > 0 {
            at += BLOCK as u32;
            self.flash.read(at, &mut block).map_err(StoreError::Flash)?;
            let done = stored.length as usize - left;
            for (i, &byte) in block.iter().take(left).enumerate() {
                match (done + i).checked_sub(checked) {
                    None => digest.update(&[byte]),
                    Some(place) => {
                        if let Some(place) = end.get_mut(place) {
                            *place = byte;
                        }
                    }
                }
            }
            left = left.saturating_sub(BLOCK);
        }
        let hash = u32::from_le_bytes(end);
        let whole = hash == stored.hash && hash == digest.finalize();
        Ok(whole.then_some(stored))
    }

    /// Stores `config`, and the hardware that is there, in place of the older of the two stored images.
    ///
    /// # Errors
    /// A [`StoreError`]; the newer of them is still there.
    pub fn store<const M: usize, const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        serials: Serials,
    ) -> Result<Stored, StoreError<F::Error>> {
        let length = config.image_bytes() as u32;
        if length == 0 {
            return Err(StoreError::NotConfigured);
        }
        let (found, size) = (length + BLOCK as u32, self.slot());
        if found.next_multiple_of(BLOCK as u32) > size {
            return Err(StoreError::Long { found, slot: size });
        }
        let newest = self.newest()?;
        let slot = newest.map_or(0, |(slot, _)| 1 - slot);
        let sequence = newest.map_or(0, |(_, stored)| stored.sequence.wrapping_add(1));
        let stored = Stored { sequence, hash: config.hash(), length, serials };
        let start = self.start(slot);
        self.flash.erase(start, start + size).map_err(StoreError::Flash)?;
        let mut writer = Writer {
            flash: &mut self.flash,
            at: start + BLOCK as u32,
            block: [0xff; BLOCK],
            used: 0,
            result: Ok(()),
        };
        config.save(&mut |bytes| writer.take(bytes));
        writer.flush();
        writer.result.map_err(StoreError::Flash)?;
        self.flash.write(start, &header(&stored)).map_err(StoreError::Flash)?;
        match self.stored(slot)? {
            Some(found) if found == stored => Ok(stored),
            _ => Err(StoreError::Unreliable),
        }
    }

    /// Loads the newest whole image into `config`.
    ///
    /// # Errors
    /// A [`StoreError`]; after [`StoreError::Image`] `config` has no subapertures.
    pub fn restore<const M: usize, const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &mut Config<M, P, B, K>,
    ) -> Result<Stored, StoreError<F::Error>> {
        let (slot, stored) = self.newest()?.ok_or(StoreError::Nothing)?;
        let start = self.start(slot);
        let mut block = [0; BLOCK];
        let mut next = 0;
        let mut failed = None;
        let flash = &mut self.flash;
        let loaded = config.load(&mut |bytes| {
            bytes.iter_mut().all(|byte| {
                let place = next % BLOCK;
                if place == 0
                    && let Err(error) = flash.read(start + (BLOCK + next) as u32, &mut block)
                {
                    failed = Some(error);
                    return false;
                }
                *byte = block.get(place).copied().unwrap_or_default();
                next += 1;
                next <= stored.length as usize
            })
        });
        match (failed, loaded) {
            (Some(error), _) => Err(StoreError::Flash(error)),
            (None, loaded) => loaded.map(|()| stored).map_err(StoreError::Image),
        }
    }
}

fn header(stored: &Stored) -> [u8; BLOCK] {
    let mut block = [0xff; BLOCK];
    let Stored { sequence, hash, length, serials: Serials { mirror, detector } } = *stored;
    let words = [sequence, length, hash, mirror, detector].map(u32::to_le_bytes);
    let bytes = MAGIC.iter().chain(words.as_flattened());
    let mut digest = CRC.digest();
    bytes.clone().for_each(|&byte| digest.update(&[byte]));
    let checksum = digest.finalize().to_le_bytes();
    block.iter_mut().zip(bytes.chain(&checksum)).for_each(|(to, &byte)| *to = byte);
    block
}

fn parse(block: &[u8; BLOCK]) -> Option<Stored> {
    let (words, _) = block.get(..HEADER)?.as_chunks();
    let [magic, sequence, length, hash, mirror, detector, _] = *words else { return None };
    let [sequence, length, hash, mirror, detector] =
        [sequence, length, hash, mirror, detector].map(u32::from_le_bytes);
    let stored = Stored { sequence, hash, length, serials: Serials { mirror, detector } };
    (magic == MAGIC && header(&stored) == *block).then_some(stored)
}

/// Bytes of any number into whole blocks of a device.
struct Writer<'a, F: NorFlash> {
    flash: &'a mut F,
    at: u32,
    block: [u8; BLOCK],
    used: usize,
    result: Result<(), F::Error>,
}

impl<F: NorFlash> Writer<'_, F> {
    fn take(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if let Some(place) = self.block.get_mut(self.used) {
                *place = byte;
            }
            self.used += 1;
            if self.used == BLOCK {
                self.flush();
            }
        }
    }

    fn flush(&mut self) {
        if self.used > 0 && self.result.is_ok() {
            self.result = self.flash.write(self.at, &self.block);
        }
        self.at = self.at.wrapping_add(BLOCK as u32);
        self.block = [0xff; BLOCK];
        self.used = 0;
    }
}
