//! Which event feeds which stream of DMA1: numbers of the multiplexer's inputs (RM0433, chapter 18).
//! Stream n of DMA1 is channel n of the multiplexer.

/// A stream and the request it answers.
#[derive(Clone, Copy, Debug)]
pub struct Stream {
    /// 0 to 7.
    pub stream: u8,
    /// Input of the multiplexer.
    pub request: u8,
}

/// The detector: pixels from DCMI.
pub const DETECTOR: Stream = Stream { stream: 0, request: 75 };
/// The DAC buses: words to SPI1, SPI2 and SPI3.
pub const DACS: [Stream; 3] = [
    Stream { stream: 1, request: 38 },
    Stream { stream: 2, request: 40 },
    Stream { stream: 3, request: 62 },
];
/// The link: bytes from USART3.
pub const LINK: Stream = Stream { stream: 4, request: 45 };

#[cfg(test)]
mod tests {
    use super::*;
    use stm32_metapac::metadata::METADATA;

    #[test]
    fn requests_are_those_of_the_manufacturers_table() {
        let expected = [
            // The table names DCMI's by what its place is in other parts of the family.
            (DETECTOR, "DCMI", "PSSI"),
            (DACS[0], "SPI1", "TX"),
            (DACS[1], "SPI2", "TX"),
            (DACS[2], "SPI3", "TX"),
            (LINK, "USART3", "RX"),
        ];
        for (stream, name, signal) in expected {
            let peripheral = METADATA.peripherals.iter().find(|p| p.name == name).expect(name);
            let found = peripheral
                .dma_channels
                .iter()
                .find(|channel| channel.signal == signal && channel.dmamux == Some("DMAMUX1"));
            let request = found.and_then(|channel| channel.request);
            assert_eq!(request, Some(stream.request.into()), "{name}");
        }
    }

    #[test]
    fn no_stream_is_used_twice() {
        let mut streams = DACS.map(|stream| stream.stream).to_vec();
        streams.extend([DETECTOR.stream, LINK.stream]);
        streams.sort_unstable();
        assert_eq!(streams, [0, 1, 2, 3, 4]);
    }
}
