//! Last words: what ended the program, kept for its next start.
//!
//! A board puts one [`LastWords`] in memory that a reset does not clear. The panic handler and the fault
//! handlers fill it in; the next start takes it out. Any bytes are a valid value: whether they mean
//! something is for the checksum to say, as after a power-up they do not.

use crate::fault::Moment;
use crate::image::CRC;
use crate::mode::{MODES, Mode};
use core::fmt::{self, Write};

/// Bytes of the message that are kept.
pub const TEXT: usize = 96;

const MAGIC: u32 = u32::from_le_bytes(*b"LAST");

/// What ended it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Cause {
    /// A panic.
    Panic,
    /// A hard fault.
    HardFault,
    /// An interrupt that has no handler.
    Interrupt,
}

const CAUSES: [Cause; 3] = [Cause::Panic, Cause::HardFault, Cause::Interrupt];

/// As it lies in memory: words and bytes without gaps.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct LastWords {
    magic: u32,
    cause: u32,
    mode: u32,
    frame: u32,
    ticks: [u32; 2],
    /// Program counter and link register.
    place: [u32; 2],
    length: u32,
    text: [u8; TEXT],
    checksum: u32,
}

/// What was kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Words {
    /// What ended it.
    pub cause: Cause,
    /// The mode it was in.
    pub mode: Mode,
    /// When.
    pub at: Moment,
    /// Program counter and link register; 0 where unknown.
    pub place: [u32; 2],
    /// The message, as much of it as was kept.
    pub text: heapless::String<TEXT>,
}

impl Default for LastWords {
    fn default() -> Self {
        Self::new()
    }
}

impl LastWords {
    /// Nothing said.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            magic: 0,
            cause: 0,
            mode: 0,
            frame: 0,
            ticks: [0; 2],
            place: [0; 2],
            length: 0,
            text: [0; TEXT],
            checksum: 0,
        }
    }

    /// Says what ends the program. A message that is too long is cut.
    pub fn say(
        &mut self,
        cause: Cause,
        mode: Mode,
        at: Moment,
        place: [u32; 2],
        message: impl fmt::Display,
    ) {
        // Not valid until all of it is there, should this fail as well.
        *self = Self {
            cause: position(&CAUSES, cause),
            mode: position(&MODES, mode),
            frame: at.frame,
            ticks: [at.ticks as u32, (at.ticks >> 32) as u32],
            place,
            ..Self::new()
        };
        let mut text = Text { bytes: &mut self.text, used: 0 };
        // It ends with an error where the message is cut.
        let _ = write!(text, "{message}");
        self.length = text.used as u32;
        self.checksum = self.sum();
        self.magic = MAGIC;
    }

    /// Takes the words out, if there are any: they are there once.
    pub fn take(&mut self) -> Option<Words> {
        let said = self.magic == MAGIC && self.checksum == self.sum();
        self.magic = 0;
        let bytes = self.text.get(..self.length as usize).filter(|_| said)?;
        // Cut between the bytes of a character, what is whole of it remains.
        let valid = match core::str::from_utf8(bytes) {
            Ok(text) => text,
            Err(error) => core::str::from_utf8(bytes.get(..error.valid_up_to())?).ok()?,
        };
        let [low, high] = self.ticks.map(u64::from);
        Some(Words {
            cause: *CAUSES.get(self.cause as usize)?,
            mode: *MODES.get(self.mode as usize)?,
            at: Moment { frame: self.frame, ticks: low | high << 32 },
            place: self.place,
            text: heapless::String::try_from(valid).ok()?,
        })
    }

    /// Over everything but itself and the magic number.
    fn sum(&self) -> u32 {
        let mut digest = CRC.digest();
        let [low, high] = self.ticks;
        let [counter, link] = self.place;
        for word in [self.cause, self.mode, self.frame, low, high, counter, link, self.length] {
            digest.update(&word.to_le_bytes());
        }
        digest.update(&self.text);
        digest.finalize()
    }
}

fn position<T: PartialEq>(all: &[T], one: T) -> u32 {
    all.iter().position(|other| *other == one).unwrap_or(all.len()) as u32
}

/// Takes a message as far as there is room.
struct Text<'a> {
    bytes: &'a mut [u8],
    used: usize,
}

impl Write for Text<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let room = self.bytes.get_mut(self.used..).unwrap_or_default();
        let places = room.iter_mut().zip(text.bytes());
        self.used += places.map(|(place, byte)| *place = byte).count();
        if self.used < self.bytes.len() { Ok(()) } else { Err(fmt::Error) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT: Moment = Moment { frame: 123_456, ticks: 0x1234_5678_9abc };

    fn said(message: &str) -> LastWords {
        let mut words = LastWords::new();
        words.say(Cause::HardFault, Mode::ClosedLoop, AT, [0x0800_1234, 7], message);
        words
    }

    #[test]
    fn what_was_said_is_there_once() {
        let mut words = said("bus fault");
        let expected = Words {
            cause: Cause::HardFault,
            mode: Mode::ClosedLoop,
            at: AT,
            place: [0x0800_1234, 7],
            text: heapless::String::try_from("bus fault").expect("short"),
        };
        assert_eq!(words.take(), Some(expected));
        assert_eq!(words.take(), None);
    }

    #[test]
    fn long_messages_are_cut_between_characters() {
        let long = "a".repeat(TEXT - 1) + "\u{e9}b";
        assert_eq!(said(&long).take().expect("words").text.as_str(), "a".repeat(TEXT - 1));
        let exact = "b".repeat(TEXT);
        assert_eq!(said(&exact).take().expect("words").text.as_str(), exact);
    }

    #[test]
    fn what_memory_holds_by_chance_is_nothing() {
        assert_eq!(LastWords::new().take(), None);
        for (place, damage) in [
            (0, (|w| w.magic ^= 1) as fn(&mut LastWords)),
            (1, |w| w.frame ^= 1 << 31),
            (2, |w| w.text[TEXT - 1] ^= 1),
            (3, |w| w.length += 1),
            (4, |w| w.checksum ^= 1 << 7),
            (5, |w| w.cause = 9),
            (6, |w| w.place[1] ^= 4),
        ] {
            let mut words = said("stack overflow");
            damage(&mut words);
            assert_eq!(words.take(), None, "{place}");
        }
    }
}
