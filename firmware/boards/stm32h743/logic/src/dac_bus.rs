//! Codes to DACs: which channel is whose, and the bus that takes a frame's codes.
//!
//! Segment s is on chip s mod 6, its three actuators side by side: all chips have equally much to do
//! whatever the pupil, and a segment is on one chip.

use crate::ad5370;
use core::fmt;
use embedded_hal::digital::OutputPin;
use embedded_hal::spi::SpiDevice;
use splash_firmware::segments::ACTUATORS;

/// Chips, two on each of three buses.
pub const CHIPS: usize = 6;
/// Segments that they have channels for: 13 a chip.
pub const SEGMENTS: usize = CHIPS * (ad5370::CHANNELS / ACTUATORS);

/// Chip and first channel of a segment.
#[must_use]
pub const fn place(segment: usize) -> (usize, usize) {
    (segment % CHIPS, segment / CHIPS * ACTUATORS)
}

/// What takes the codes of a frame.
pub trait DacBus {
    /// Why it did not.
    type Error;

    /// Writes all codes, in the order of the subapertures, and lets the outputs change together. May
    /// return before they have.
    ///
    /// # Errors
    /// If the codes were not taken, or not all of them: outputs then keep what they had.
    fn update(&mut self, codes: &[[u16; ACTUATORS]]) -> Result<(), Self::Error>;
}

/// AD5370s behind any `embedded-hal` bus in SPI mode 1, with an LDAC in common; blocks. Each word is a
/// transaction of its own, since the part takes it at the end of its chip select.
#[derive(Debug)]
pub struct SpiDacs<S, L> {
    chips: [S; CHIPS],
    ldac: L,
}

/// Why codes did not get there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpiDacsError<S, L> {
    /// There is no channel for so many segments.
    Segments {
        /// How many there were.
        found: usize,
    },
    /// The bus.
    Spi(S),
    /// LDAC.
    Ldac(L),
}

impl<S: fmt::Debug, L: fmt::Debug> fmt::Display for SpiDacsError<S, L> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Segments { found } => write!(f, "{found} segments, {SEGMENTS} have channels"),
            Self::Spi(error) => write!(f, "DAC bus: {error:?}"),
            Self::Ldac(error) => write!(f, "LDAC: {error:?}"),
        }
    }
}

impl<S: fmt::Debug, L: fmt::Debug> core::error::Error for SpiDacsError<S, L> {}

impl<S: SpiDevice, L: OutputPin> SpiDacs<S, L> {
    /// Chips in their order, and their LDAC, which becomes high: outputs wait for it.
    ///
    /// # Errors
    /// If LDAC cannot be set.
    pub fn new(chips: [S; CHIPS], mut ldac: L) -> Result<Self, L::Error> {
        ldac.set_high()?;
        Ok(Self { chips, ldac })
    }

    /// Gives back what it was made of.
    pub fn release(self) -> ([S; CHIPS], L) {
        (self.chips, self.ldac)
    }
}

impl<S: SpiDevice, L: OutputPin> DacBus for SpiDacs<S, L> {
    type Error = SpiDacsError<S::Error, L::Error>;

    fn update(&mut self, codes: &[[u16; ACTUATORS]]) -> Result<(), Self::Error> {
        if codes.len() > SEGMENTS {
            return Err(SpiDacsError::Segments { found: codes.len() });
        }
        for (segment, codes) in codes.iter().enumerate() {
            let (chip, first) = place(segment);
            let Some(chip) = self.chips.get_mut(chip) else { continue };
            for (actuator, &code) in codes.iter().enumerate() {
                let word = ad5370::write(first + actuator, code);
                chip.write(&ad5370::bytes(word)).map_err(SpiDacsError::Spi)?;
            }
        }
        self.ldac.set_low().map_err(SpiDacsError::Ldac)?;
        self.ldac.set_high().map_err(SpiDacsError::Ldac)
    }
}
