//! Digests: what a stage computed, in 64 bits.

use core::fmt;

use crc::{CRC_64_XZ, Crc};
use splash_firmware::config::Config;

static CRC: Crc<u64> = Crc::<u64>::new(&CRC_64_XZ);

/// The CRC-64/XZ of everything that a stage computed in a case.
///
/// It is to tell bits that fell differently, not an adversary. Any difference within 64 bits in a row
/// changes it, any other but for one in 2^64; and it costs a soft core little code and time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest(u64);

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

/// A digest that is being made. Integers go in little-endian.
pub(crate) struct Hasher(crc::Digest<'static, u64>);

impl Default for Hasher {
    fn default() -> Self {
        Self(CRC.digest())
    }
}

impl Hasher {
    /// Not inlined: it is called in many places, and a board's code memory is small.
    #[inline(never)]
    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    pub(crate) fn u16(&mut self, value: u16) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn u32(&mut self, value: u32) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn i32(&mut self, value: i32) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn u64(&mut self, value: u64) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn finish(self) -> Digest {
        Digest(self.0.finalize())
    }
}

/// What a specification became: the image of the configuration.
pub(crate) fn configuration<const M: usize, const P: usize, const B: usize, const K: usize>(
    config: &Config<M, P, B, K>,
) -> Digest {
    let mut hasher = Hasher::default();
    config.save(&mut |bytes| hasher.bytes(bytes));
    hasher.finish()
}
