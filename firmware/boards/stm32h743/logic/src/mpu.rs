//! The one region without a cache: SRAM1 to 3, where words for the DACs and bytes of the link lie.
//!
//! The processor writes a frame's words there once and the DMA reads them once: a cache would have
//! nothing to give and would have to be cleaned. The detector's blocks lie in the cached AXI SRAM,
//! since each pixel is read by the processor: 32 bytes at a time through the cache, where each access to
//! an uncached word would wait for the bus. They are invalidated before they are read.

/// First address of SRAM1, and of the region.
pub const BASE: u32 = 0x3000_0000;
/// The region: the least power of two that covers SRAM1 to 3.
pub const BYTES: u32 = 512 << 10;

/// MPU_RBAR: the address, for the region that MPU_RNR has chosen.
pub const RBAR: u32 = BASE;

/// MPU_RASR: normal memory that is not cached (TEX = 1, C = B = 0) and shared, read and written by
/// all, not executed.
pub const RASR: u32 = {
    let size = BYTES.trailing_zeros() - 1;
    let (not_executed, full_access, tex, shared, enable) = (1, 0b011, 0b001, 1, 1);
    not_executed << 28 | full_access << 24 | tex << 19 | shared << 18 | size << 1 | enable
};

#[cfg(test)]
mod tests {
    use super::*;

    /// Armv7-M architecture reference manual, B3.5.9.
    #[test]
    fn the_region_is_what_the_architecture_asks_for() {
        assert_eq!(RASR, 0x130C_0025);
        let size = RASR >> 1 & 0x1F;
        assert_eq!(1u32 << (size + 1), BYTES);
        assert_eq!(RBAR % BYTES, 0, "a region starts at a multiple of its size");
        const { assert!(BYTES >= (128 + 128 + 32) << 10, "it covers SRAM1 to 3") };
    }
}
