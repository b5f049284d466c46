//! A detector's frame in blocks: rows of each, and their places in memory.

use core::fmt;

/// Memory of the ring, bytes.
pub const RING_BYTES: usize = 64 << 10;
/// Most blocks in it.
pub const SLOTS: usize = 62;
/// Least: one that is filled, one that is filled next, one that is read.
const LEAST_SLOTS: usize = 3;
/// Most rows of a block, k: README.md says what they cost.
pub const MOST_ROWS: u16 = 16;
/// Bytes that the cache fetches at once; no two blocks share them.
pub const LINE_BYTES: usize = 32;

/// How frames come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Shape {
    /// Pixels of a row.
    pub width: u16,
    /// Rows of a block, k: they divide the frame's.
    pub rows: u16,
    /// Blocks of a frame.
    pub blocks: u16,
    /// Blocks in the ring.
    pub slots: u16,
    /// Bits of a pixel: 10, 12 or 14.
    pub bits: u8,
}

/// This detector cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ShapeError {
    /// Pixels come two by two.
    OddWidth {
        /// What it has.
        width: u16,
    },
    /// The camera interface takes 10, 12 or 14 bits in 16.
    Bits {
        /// What it has.
        bits: u8,
    },
}

impl fmt::Display for ShapeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OddWidth { width } => write!(f, "rows of {width} pixels, must be even"),
            Self::Bits { bits } => write!(f, "pixels of {bits} bits, must be 10, 12 or 14"),
        }
    }
}

impl core::error::Error for ShapeError {}

impl Shape {
    /// Of frames of `height` rows of `width` pixels: as many rows a block as divide the frame, up to
    /// [`MOST_ROWS`], and leave the ring the blocks that it needs.
    ///
    /// # Errors
    /// A [`ShapeError`].
    pub fn new(width: u16, height: u16, bits: u8) -> Result<Self, ShapeError> {
        if width == 0 || width % 2 == 1 {
            return Err(ShapeError::OddWidth { width });
        }
        if ![10, 12, 14].contains(&bits) {
            return Err(ShapeError::Bits { bits });
        }
        let of = |rows: u16| {
            let blocks = height / rows;
            let mut shape = Self { width, rows, blocks, slots: 0, bits };
            shape.slots = (RING_BYTES / shape.stride()).min(SLOTS) as u16;
            shape
        };
        let fits = |shape: &Self| {
            height.is_multiple_of(shape.rows) && usize::from(shape.slots) >= LEAST_SLOTS
        };
        // One row of up to 4096 pixels always fits.
        Ok((1..=MOST_ROWS).rev().map(of).find(fits).unwrap_or_else(|| of(1)))
    }

    /// Pixels of a block.
    #[must_use]
    pub fn pixels(&self) -> usize {
        usize::from(self.width) * usize::from(self.rows)
    }

    /// Transfers of the DMA for a block: two pixels each.
    #[must_use]
    pub fn transfers(&self) -> u16 {
        // A block is at most a third of the ring.
        (self.pixels() / 2) as u16
    }

    /// Whether the DMA can write a block in bursts of four transfers.
    #[must_use]
    pub fn bursts(&self) -> bool {
        self.transfers().is_multiple_of(4)
    }

    /// Bytes from one block to the next.
    #[must_use]
    pub fn stride(&self) -> usize {
        (2 * self.pixels()).next_multiple_of(LINE_BYTES)
    }

    /// Where block `slot` begins, bytes from the ring's start.
    #[must_use]
    pub fn offset(&self, slot: u16) -> usize {
        usize::from(slot) * self.stride()
    }

    /// Field EDM of the camera interface: how many of its data pins count.
    #[must_use]
    pub const fn data_mode(&self) -> u8 {
        (self.bits - 8) / 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_detector_comes_in_eight_blocks() {
        let shape = Shape::new(128, 128, 12).expect("readable");
        assert_eq!((shape.rows, shape.blocks, shape.slots), (16, 8, 16), "two frames of room");
        assert_eq!((shape.transfers(), shape.stride(), shape.data_mode()), (1024, 4096, 2));
    }

    #[test]
    fn every_detector_that_is_taken_fits_the_ring() {
        for width in (2..=4096).step_by(2) {
            for height in [1, 7, 8, 60, 127, 128, 560, 4096] {
                let shape = Shape::new(width, height, 14).expect("readable");
                assert_eq!(shape.rows * shape.blocks, height);
                assert!(usize::from(shape.slots) >= LEAST_SLOTS, "{shape:?}");
                assert!(usize::from(shape.slots) <= SLOTS);
                assert!(shape.offset(shape.slots) <= RING_BYTES);
                assert_eq!(usize::from(shape.transfers()) * 2, shape.pixels());
                assert_eq!(shape.offset(1) % LINE_BYTES, 0);
            }
        }
    }

    #[test]
    fn what_the_camera_interface_cannot_take_is_refused() {
        let error = Shape::new(127, 128, 12).expect_err("odd").to_string();
        assert_eq!(error, "rows of 127 pixels, must be even");
        let error = Shape::new(128, 128, 16).expect_err("bits").to_string();
        assert_eq!(error, "pixels of 16 bits, must be 10, 12 or 14");
        assert_eq!(Shape::new(0, 1, 12), Err(ShapeError::OddWidth { width: 0 }));
    }
}
