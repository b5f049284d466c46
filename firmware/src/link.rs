//! Messages between a board and a PC, on any stream of bytes.
//!
//! ```text
//! COBS( version u8, sequence u16, postcard(message), CRC-32 (ISO-HDLC) of all before ) 0x00
//! ```
//!
//! little-endian. A message takes at most [`MESSAGE`] bytes before the stuffing; lists go in pieces
//! of at most [`LIST`]. A receiver that has lost its place is back in step at the next 0x00. The PC
//! numbers its requests, from 1 on; an answer carries the number of its request, and what comes
//! unasked the number 0.

mod frame;
mod message;

pub use frame::{LinkError, Message, Receiver, WIRE, encode};
pub use message::{
    Counters, HISTORY, Identity, LIST, List, PIECE, Reason, Request, Response, Stack, Status,
};

/// Version of the framing and of the messages.
pub const VERSION: u8 = 2;

/// Longest message, bytes, as postcard writes it.
pub const MESSAGE: usize = 512;
