//! Bytes of the link as a circular DMA writes them: no interrupt, and none is lost while the main loop
//! is elsewhere for less than the ring takes to fill.

/// Where the reader is in a ring of `N` bytes, N a power of two up to 32768.
#[derive(Debug, Default)]
pub struct ByteRing<const N: usize> {
    read: usize,
}

impl<const N: usize> ByteRing<N> {
    /// A reader at the start of the ring.
    #[must_use]
    pub const fn new() -> Self {
        assert!(N.is_power_of_two() && N <= 32768, "the DMA's counter has 16 bits");
        Self { read: 0 }
    }

    /// The place of the next byte, or `None` if it has not come. `left` is the DMA's counter: transfers
    /// until it starts over, N to 1. A reader that is overtaken reads newer bytes in their place; the
    /// link's checksum tells.
    pub fn next(&mut self, left: u16) -> Option<usize> {
        let written = N.wrapping_sub(left.into()) % N;
        if written == self.read {
            return None;
        }
        let place = self.read;
        self.read = (place + 1) % N;
        Some(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_in_their_order_over_the_end_of_the_ring() {
        const N: usize = 16;
        let (mut ring, mut memory) = (ByteRing::<N>::new(), [0; N]);
        let (mut written, mut read) = (0u32, 0u32);
        for burst in (1..N as u32).cycle().take(200) {
            for _ in 0..burst {
                memory[written as usize % N] = written as u8;
                written += 1;
            }
            let left = (N - written as usize % N) as u16;
            while let Some(place) = ring.next(left) {
                assert_eq!(memory[place], read as u8);
                read += 1;
            }
            assert_eq!(read, written);
        }
    }

    #[test]
    fn nothing_has_come_at_the_start() {
        assert_eq!(ByteRing::<16>::new().next(16), None);
        // Before the DMA's first transfer its counter may read as none left.
        assert_eq!(ByteRing::<16>::new().next(0), None);
    }
}
