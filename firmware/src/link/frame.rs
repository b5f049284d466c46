//! Messages to bytes and back: header, checksum, byte stuffing.

use super::{MESSAGE, VERSION};
use crate::image::CRC;
use cobs::{DecodeResult, DecoderState};
use core::fmt;
use serde::{Serialize, de::DeserializeOwned};

/// Version and sequence.
const HEADER: usize = 3;
const CHECKSUM: usize = 4;
/// Longest frame before stuffing.
const FRAME: usize = HEADER + MESSAGE + CHECKSUM;

/// Longest frame on the wire, its 0x00 included: stuffing adds a byte for every 254.
pub const WIRE: usize = FRAME + FRAME / 254 + 2;

/// A message and the number of the request it belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Message<T> {
    /// Number of the request.
    pub sequence: u16,
    /// What is said.
    pub body: T,
}

/// Why bytes are not a message. The next frame is unharmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LinkError {
    /// More than [`MESSAGE`] bytes.
    Long,
    /// Cut short, or its byte stuffing broken.
    Broken,
    /// The checksum is not that of the bytes.
    Checksum,
    /// Of another version.
    Version {
        /// What it has.
        found: u8,
    },
    /// The bytes arrived as they were sent, but are no message.
    Unreadable,
}

impl fmt::Display for LinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Long => write!(f, "message of more than {MESSAGE} bytes"),
            Self::Broken => f.write_str("message that is cut short"),
            Self::Checksum => f.write_str("message with a wrong checksum"),
            Self::Version { found } => write!(f, "message of version {found}, must be {VERSION}"),
            Self::Unreadable => f.write_str("message that cannot be read"),
        }
    }
}

impl core::error::Error for LinkError {}

/// The frame of a message, in `wire`.
///
/// # Errors
/// [`LinkError::Long`] if it has more than [`MESSAGE`] bytes, which no [`super::Request`] and no
/// [`super::Response`] has.
pub fn encode<'w, T: Serialize>(
    message: &Message<T>,
    wire: &'w mut [u8; WIRE],
) -> Result<&'w [u8], LinkError> {
    let mut frame = [0; FRAME];
    let [version, low, high, rest @ ..] = &mut frame;
    *version = VERSION;
    [*low, *high] = message.sequence.to_le_bytes();
    let body = rest.get_mut(..MESSAGE).ok_or(LinkError::Long)?;
    let end = HEADER + postcard::to_slice(&message.body, body).map_err(|_| LinkError::Long)?.len();
    let (used, rest) = frame.split_at_mut_checked(end).ok_or(LinkError::Long)?;
    let checksum = CRC.checksum(used);
    rest.iter_mut().zip(checksum.to_le_bytes()).for_each(|(to, byte)| *to = byte);
    let frame = frame.get(..end + CHECKSUM).ok_or(LinkError::Long)?;
    let used = cobs::try_encode(frame, wire).map_err(|_| LinkError::Long)?;
    if let Some(last) = wire.get_mut(used) {
        *last = 0;
    }
    wire.get(..=used).ok_or(LinkError::Long)
}

/// Finds messages in a stream of bytes.
#[derive(Debug)]
pub struct Receiver {
    state: DecoderState,
    frame: [u8; FRAME],
    used: usize,
    refused: u32,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// One that waits for the first byte of a frame.
    #[must_use]
    pub const fn new() -> Self {
        Self { state: DecoderState::Idle, frame: [0; FRAME], used: 0, refused: 0 }
    }

    /// Frames that were no message; saturates.
    #[must_use]
    pub const fn refused(&self) -> u32 {
        self.refused
    }

    /// Takes the next byte: `None` before the end of a frame.
    pub fn push<T: DeserializeOwned>(&mut self, byte: u8) -> Option<Result<Message<T>, LinkError>> {
        let found = self.found(byte);
        if let Some(Err(_)) = found {
            self.refused = self.refused.saturating_add(1);
        }
        found
    }

    fn found<T: DeserializeOwned>(&mut self, byte: u8) -> Option<Result<Message<T>, LinkError>> {
        match self.state.feed(byte) {
            Ok(DecodeResult::NoData) => None,
            Ok(DecodeResult::DataContinue(byte)) => {
                if let Some(place) = self.frame.get_mut(self.used) {
                    *place = byte;
                }
                // One beyond the frame stands for anything longer.
                self.used = (self.used + 1).min(FRAME + 1);
                None
            }
            Ok(DecodeResult::DataComplete) => Some(self.take()),
            Err(_) => {
                self.used = 0;
                Some(Err(LinkError::Broken))
            }
        }
    }

    fn take<T: DeserializeOwned>(&mut self) -> Result<Message<T>, LinkError> {
        let used = core::mem::take(&mut self.used);
        let frame = self.frame.get(..used).ok_or(LinkError::Long)?;
        let (frame, checksum) = frame.split_last_chunk().ok_or(LinkError::Broken)?;
        let ([version, low, high], body) = frame.split_first_chunk().ok_or(LinkError::Broken)?;
        if CRC.checksum(frame) != u32::from_le_bytes(*checksum) {
            return Err(LinkError::Checksum);
        }
        if *version != VERSION {
            return Err(LinkError::Version { found: *version });
        }
        let sequence = u16::from_le_bytes([*low, *high]);
        match postcard::take_from_bytes(body) {
            Ok((body, [])) => Ok(Message { sequence, body }),
            _ => Err(LinkError::Unreadable),
        }
    }
}
