//! The checksum of FITS 4.0, section 4.4.2.7 and appendix J: a ones'-complement sum of 32-bit
//! big-endian words.

/// A ones'-complement sum of a stream of bytes.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Sum {
    words: u64,
    /// Bytes of the word that the last call left incomplete.
    phase: usize,
}

impl Sum {
    pub(super) fn add(&mut self, bytes: &[u8]) {
        let (head, body) = bytes.split_at(((4 - self.phase) % 4).min(bytes.len()));
        for &byte in head {
            self.add_byte(byte);
        }
        let (words, tail) = body.as_chunks();
        // 64 bits hold the sum of any slice below 16 GiB: carries can wait.
        self.words += words.iter().map(|&word| u64::from(u32::from_be_bytes(word))).sum::<u64>();
        self.carry();
        for &byte in tail {
            self.add_byte(byte);
        }
    }

    fn add_byte(&mut self, byte: u8) {
        self.words += u64::from(byte) << (24 - 8 * self.phase);
        self.carry();
        self.phase = (self.phase + 1) % 4;
    }

    /// Adds the carries at the bottom, as ones' complement does; twice, for a carry of carries.
    fn carry(&mut self) {
        for _ in 0..2 {
            self.words = (self.words & 0xffff_ffff) + (self.words >> 32);
        }
    }

    pub(super) fn value(self) -> u32 {
        self.words as u32
    }
}

/// The 16 characters which bring a header and its data, CHECKSUM being 16 zeros before, to a sum
/// of -0.
pub(super) fn encode(sum: u32) -> String {
    const ZERO: u8 = b'0';
    let mut encoded = [0_u8; 16];
    for (index, byte) in (!sum).to_be_bytes().into_iter().enumerate() {
        let quarter = byte / 4 + ZERO;
        let mut four = [quarter + byte % 4, quarter, quarter, quarter];
        // Only digits and letters: move punctuation away in pairs, which keeps the sum.
        while !four.iter().all(u8::is_ascii_alphanumeric) {
            for pair in four.chunks_exact_mut(2) {
                if !pair.iter().all(u8::is_ascii_alphanumeric) {
                    pair[0] += 1;
                    pair[1] -= 1;
                }
            }
        }
        for (place, &character) in four.iter().enumerate() {
            // The value field starts at column 12: one byte past a word boundary.
            encoded[(4 * place + index + 1) % 16] = character;
        }
    }
    encoded.iter().map(|&byte| char::from(byte)).collect()
}
