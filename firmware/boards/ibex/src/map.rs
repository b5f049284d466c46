//! The address map: `rtl/splash_pkg.sv` has the same numbers, README.md explains them.
#![allow(unsafe_code, reason = "registers at fixed addresses")]

/// A register of the periphery.
#[derive(Clone, Copy)]
pub(crate) struct Register(u32);

/// Where the periphery's registers start.
const BASE: u32 = 0x2000_0000;

impl Register {
    /// A write marks the moment.
    pub(crate) const MARK: Self = Self(0x04);
    /// A write shows a character.
    pub(crate) const CONSOLE: Self = Self(0x08);
    /// A write ends the simulation with that exit code.
    pub(crate) const DONE: Self = Self(0x0c);
    /// Next byte in bits 0-7, taken by the read, if bit 8 is set; bit 9 if there will be none.
    pub(crate) const LINK_IN: Self = Self(0x10);
    /// A write sends a byte; bit 0 says whether one can be sent.
    pub(crate) const LINK_OUT: Self = Self(0x14);
    /// Word address in data memory of the ring of rows.
    pub(crate) const DETECTOR_BASE: Self = Self(0x20);
    /// Pixels in a row.
    pub(crate) const DETECTOR_WIDTH: Self = Self(0x24);
    /// Rows in the ring.
    pub(crate) const DETECTOR_RING: Self = Self(0x28);
    /// Rows that are there.
    pub(crate) const DETECTOR_ROWS: Self = Self(0x2c);
    /// A write gives that many of the oldest rows back.
    pub(crate) const DETECTOR_TAKEN: Self = Self(0x30);
    /// A write empties the ring, for a frame of that many pixels.
    pub(crate) const DETECTOR_CONTROL: Self = Self(0x34);
    /// A write hands on the next code.
    pub(crate) const DAC_CODE: Self = Self(0x40);
    /// A write makes the codes the outputs.
    pub(crate) const DAC_LOAD: Self = Self(0x44);

    /// Reads it.
    #[inline(always)]
    pub(crate) fn read(self) -> u32 {
        // SAFETY: the offsets above are registers of the soft core, word aligned; reading them has
        // no effect on memory.
        unsafe { ((BASE + self.0) as *const u32).read_volatile() }
    }

    /// Writes it.
    #[inline(always)]
    pub(crate) fn write(self, value: u32) {
        // SAFETY: as above. The detector port, the one master besides the core, writes nowhere but
        // in the ring that `DETECTOR_BASE`, `_WIDTH` and `_RING` describe: see `ports`.
        unsafe { ((BASE + self.0) as *mut u32).write_volatile(value) }
    }
}
