//! Digests: what a stage computed, in 64 bits.

use core::fmt;

use sha2::{Digest as _, Sha256};

/// The first eight bytes of the SHA-256 of everything that a stage computed in a case.
///
/// They are to tell a bit that fell differently, not an adversary: two results that differ agree
/// in 64 bits once in 2^64, and a line of them can still be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest([u8; 8]);

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// A digest that is being made. Integers go in little-endian.
#[derive(Clone, Debug, Default)]
pub(crate) struct Hasher(Sha256);

impl Hasher {
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
        let [a, b, c, d, e, f, g, h, ..] = self.0.finalize().0;
        Digest([a, b, c, d, e, f, g, h])
    }
}

use splash_firmware::config::Config;

/// What a specification became.
pub(crate) fn configuration<const M: usize, const P: usize, const B: usize>(
    config: &Config<M, P, B>,
) -> Digest {
    let mut hasher = Hasher::default();
    for value in [config.omega(), config.ulp_m(), config.adu_per_unit()] {
        hasher.u64(value.to_bits());
    }
    hasher.finish()
}
