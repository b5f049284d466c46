//! The DACs by `embedded-hal`: every word, in its place.

use embedded_hal_mock::eh1::MockError;
use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction as Level};
use embedded_hal_mock::eh1::spi::{Mock as Spi, Transaction};
use std::io::ErrorKind;
use stm32h743_logic::dac_bus::{CHIPS, DacBus, SEGMENTS, SpiDacs, SpiDacsError};

fn codes(segments: usize) -> Vec<[u16; 3]> {
    (0..segments as u16).map(|s| [s, 0x8000 | s, 0xFFFF - s]).collect()
}

/// The words of a chip, from the data sheet: mode 3, eight plus the channel, the code; each between two
/// edges of its select line.
fn words(codes: &[[u16; 3]], chip: usize) -> Vec<Transaction<u8>> {
    let mine = codes.iter().enumerate().filter(|(segment, _)| segment % CHIPS == chip);
    let channels = mine.flat_map(|(segment, codes)| {
        codes.iter().enumerate().map(move |(k, &code)| (3 * (segment / CHIPS) + k, code))
    });
    let word = |(channel, code): (usize, u16)| {
        let [high, low] = code.to_be_bytes();
        vec![0b1100_0000 | (8 + channel as u8), high, low]
    };
    let transaction = |word| {
        [
            Transaction::transaction_start(),
            Transaction::write_vec(word),
            Transaction::transaction_end(),
        ]
    };
    channels.map(word).flat_map(transaction).collect()
}

#[test]
fn every_word_gets_to_its_chip_and_ldac_comes_last() {
    for segments in [1, 6, 52, 64, SEGMENTS] {
        let codes = codes(segments);
        let chips: [Spi<u8>; CHIPS] = std::array::from_fn(|chip| Spi::new(&words(&codes, chip)));
        let ldac = Pin::new(&[State::High, State::Low, State::High].map(Level::set));
        let mut dacs = SpiDacs::new(chips, ldac).expect("LDAC");
        dacs.update(&codes).expect("a bus");
        let (chips, mut ldac) = dacs.release();
        chips.into_iter().for_each(|mut chip| chip.done());
        ldac.done();
    }
}

#[test]
fn segments_without_a_channel_are_refused_before_anything_is_sent() {
    let chips: [Spi<u8>; CHIPS] = std::array::from_fn(|_| Spi::new(&[]));
    let mut dacs = SpiDacs::new(chips, Pin::new(&[Level::set(State::High)])).expect("LDAC");
    let error = dacs.update(&codes(SEGMENTS + 1)).expect_err("too many");
    assert_eq!(error, SpiDacsError::Segments { found: SEGMENTS + 1 });
    assert_eq!(error.to_string(), "79 segments, 78 have channels");
    let (chips, mut ldac) = dacs.release();
    chips.into_iter().for_each(|mut chip| chip.done());
    ldac.done();
}

#[test]
fn an_ldac_that_fails_is_told() {
    let codes = codes(1);
    let chips: [Spi<u8>; CHIPS] = std::array::from_fn(|chip| Spi::new(&words(&codes, chip)));
    let fails = Level::set(State::Low).with_error(MockError::Io(ErrorKind::Other));
    let ldac = Pin::new(&[Level::set(State::High), fails]);
    let mut dacs = SpiDacs::new(chips, ldac).expect("LDAC");
    assert!(matches!(dacs.update(&codes), Err(SpiDacsError::Ldac(_))));
    let (chips, mut ldac) = dacs.release();
    chips.into_iter().for_each(|mut chip| chip.done());
    ldac.done();
}
