//! Words of the AD5370: 40 channels of 16 bits, SPI mode 1, 24-bit words, most significant bit first.
//!
//! ```text
//! 23 22 | 21 .. 16      | 15 .. 0
//! mode  | 8 + channel   | code        mode 3: to the channel's input register (X1A)
//! 0     | 0             | 0           no operation
//! ```
//!
//! A word is taken at the rising edge of SYNC. Outputs change together at the falling edge of LDAC, or,
//! if a channel is still being computed then (BUSY), as soon as it is done. The AD5360, 5362, 5372 (16, 8
//! and 32 channels) take the same words.

/// Channels of the part.
pub const CHANNELS: usize = 40;
/// Bits of a word.
pub const WORD_BITS: u32 = 24;
/// Least time from one word to the next, ns (t11).
pub const CYCLE_NS: u32 = 600;
/// Longest time from a word to its end of BUSY, ns (t9 + t10).
pub const BUSY_NS: u32 = 42 + 1_500;
/// Least time for which SYNC is high between two words, ns (t5).
pub const SYNC_HIGH_NS: u32 = 20;
/// Least time for which LDAC is low, ns (t13).
pub const LDAC_NS: u32 = 10;

/// Changes nothing.
pub const NO_OPERATION: u32 = 0;

/// Code to the input register of `channel`, 0 to 39; no operation for one that is not there.
#[must_use]
pub const fn write(channel: usize, code: u16) -> u32 {
    if channel >= CHANNELS {
        return NO_OPERATION;
    }
    0b11 << 22 | (channel as u32 + 8) << 16 | code as u32
}

/// The bytes of a word, in the order in which they are sent.
#[must_use]
pub const fn bytes(word: u32) -> [u8; 3] {
    let [_, high, middle, low] = word.to_be_bytes();
    [high, middle, low]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The data sheet's table of addresses: groups 0 to 4 of eight channels at 001000 to 101111.
    #[test]
    fn channels_are_where_the_data_sheet_has_them() {
        for channel in 0..CHANNELS {
            let word = write(channel, 0xA5C3);
            let (group, within) = (channel / 8, channel % 8);
            let expected = 0b11 << 22 | (group + 1) << 19 | within << 16 | 0xA5C3;
            assert_eq!(word, expected as u32, "{channel}");
            assert_eq!(word >> WORD_BITS, 0);
        }
    }

    #[test]
    fn a_channel_that_is_not_there_is_left_alone() {
        assert_eq!(write(CHANNELS, 1), NO_OPERATION);
        assert_eq!(bytes(NO_OPERATION), [0; 3]);
    }

    #[test]
    fn bytes_go_from_the_highest_to_the_lowest() {
        assert_eq!(bytes(write(0, 0x1234)), [0xC8, 0x12, 0x34]);
        assert_eq!(bytes(write(39, 0xFFFF)), [0xEF, 0xFF, 0xFF]);
    }
}
