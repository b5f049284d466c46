//! The two regions without a cache: SRAM1 to 3, where words for the DACs and bytes of the link lie, and the
//! store's flash.
//!
//! The processor writes a frame's words there once and the DMA reads them once: a cache would have
//! nothing to give and would have to be cleaned. The detector's blocks lie in the cached AXI SRAM,
//! since each pixel is read by the processor: 32 bytes at a time through the cache, where each access to
//! an uncached word would wait for the bus. They are invalidated before they are read. Of the store a
//! cache would keep what was there before it was written.

use crate::flash;

/// A region of normal memory that is not cached and not executed.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    /// First address: a multiple of its size.
    pub base: u32,
    /// Its size, bytes: a power of two.
    pub bytes: u32,
}

/// The least power of two that covers SRAM1 to 3, and the store.
pub const REGIONS: [Region; 2] = [
    Region { base: 0x3000_0000, bytes: 512 << 10 },
    Region { base: flash::BASE, bytes: (flash::SECTORS * flash::SECTOR) as u32 },
];

impl Region {
    /// MPU_RBAR: the address, for the region that MPU_RNR has chosen.
    #[must_use]
    pub const fn rbar(self) -> u32 {
        self.base
    }

    /// MPU_RASR: normal memory that is not cached (TEX = 1, C = B = 0) and shared, read and written by
    /// all, not executed.
    #[must_use]
    pub const fn rasr(self) -> u32 {
        let size = self.bytes.trailing_zeros() - 1;
        let (not_executed, full_access, tex, shared, enable) = (1, 0b011, 0b001, 1, 1);
        not_executed << 28 | full_access << 24 | tex << 19 | shared << 18 | size << 1 | enable
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Armv7-M architecture reference manual, B3.5.9.
    #[test]
    fn regions_are_what_the_architecture_asks_for() {
        for (region, expected) in REGIONS.iter().zip([0x130C_0025, 0x130C_0023]) {
            assert_eq!(region.rasr(), expected);
            let size = region.rasr() >> 1 & 0x1F;
            assert_eq!(1u32 << (size + 1), region.bytes);
            assert_eq!(region.rbar() % region.bytes, 0, "it starts at a multiple of its size");
        }
        const { assert!(REGIONS[0].bytes >= (128 + 128 + 32) << 10, "it covers SRAM1 to 3") };
    }
}
