//! FITS files (FITS standard 4.0): images and cubes with their headers, read and written.
//!
//! What is here is what a recorded run needs, no more: a primary array and IMAGE extensions of
//! u8, u16, i32, f32 and f64, header cards with comments, text, checksums, cubes that are
//! written and read one frame at a time, so that a cube may be larger than the memory, and binary
//! tables, which are only written.
//!
//! Axes are in the order of the standard, fastest first: `[columns, rows, frames]` is NAXIS1,
//! NAXIS2, NAXIS3. An array indexed `[y][x]` in memory is written as it lies; Python shows the
//! shape reversed, `(frames, rows, columns)`.
//!
//! Unsigned 16-bit numbers are stored as the standard prescribes, BITPIX = 16 with BZERO = 32768.
//!
//! Text, such as a run's configuration, is an array of its UTF-8 bytes, which keeps it exactly:
//! in Python, `bytes(hdus["CONFIG"].data).decode()`.

mod checksum;
mod error;
mod header;
mod read;
mod sample;
mod scan;
mod table;
mod write;

pub use error::FitsError;
pub use header::{Header, Value};
pub use read::{CubeReader, FitsReader};
pub use sample::Sample;
pub use scan::Hdu;
pub use table::{Column, Values};
pub use write::{CubeWriter, FitsWriter};

/// Everything in a FITS file comes in blocks of this many bytes.
const BLOCK: usize = 2880;

/// A header line, bytes.
const CARD: usize = 80;

/// What follows the last byte of data up to the end of its block.
fn padding(bytes: u64) -> usize {
    (BLOCK - (bytes % BLOCK as u64) as usize) % BLOCK
}
