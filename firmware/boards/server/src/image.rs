//! A configuration image that arrives in pieces, while it is being loaded.

use crate::Link;
use splash_firmware::link::{Message, PIECE, Receiver, Request};

/// The pieces of one image, read as one stream of bytes.
pub struct Pieces<'a, T: Link> {
    port: &'a mut T,
    receiver: &'a mut Receiver,
    piece: heapless::Vec<u8, PIECE>,
    /// Bytes of the piece that were read.
    read: usize,
    /// Where the next piece belongs.
    next: u32,
    length: u32,
    lost: bool,
    end: Option<T::Error>,
    /// A request that came where a piece was due.
    interrupt: Option<Message<Request>>,
}

/// How the link was left: with the request that came where a piece was due.
pub type Left<E> = Result<Option<Message<Request>>, E>;

impl<'a, T: Link> Pieces<'a, T> {
    /// Those of the image of `length` bytes that was announced on `port`.
    pub fn new(port: &'a mut T, receiver: &'a mut Receiver, length: u32) -> Self {
        Self {
            port,
            receiver,
            piece: heapless::Vec::new(),
            read: 0,
            next: 0,
            length,
            lost: false,
            end: None,
            interrupt: None,
        }
    }

    /// Fills `bytes`, or returns `false`: the image is shorter, or a piece was lost.
    pub fn fill(&mut self, bytes: &mut [u8]) -> bool {
        bytes.iter_mut().all(|byte| {
            while self.read == self.piece.len() {
                if !self.advance() {
                    return false;
                }
            }
            let found = self.piece.get(self.read);
            *byte = found.copied().unwrap_or_default();
            self.read += 1;
            found.is_some()
        })
    }

    /// Takes what is left of the image, so that the next request is found behind it, and returns
    /// the request that cut it short.
    ///
    /// # Errors
    /// If the link ended.
    pub fn drain(mut self) -> Left<T::Error> {
        while self.advance() {}
        match self.end {
            Some(error) => Err(error),
            None => Ok(self.interrupt),
        }
    }

    /// Waits for the next piece: `false` behind the last, and where one is missing.
    fn advance(&mut self) -> bool {
        if self.lost || self.next >= self.length {
            return false;
        }
        self.read = 0;
        self.piece.clear();
        self.lost = true;
        match crate::server::receive(self.port, self.receiver) {
            Ok(Message { body: Request::Piece { offset, bytes }, .. })
                if offset == self.next && !bytes.is_empty() =>
            {
                self.lost = false;
                self.next = self.next.saturating_add(bytes.len() as u32);
                self.piece = bytes;
            }
            Ok(Message { body: Request::Piece { .. }, .. }) => {}
            Ok(other) => self.interrupt = Some(other),
            Err(error) => self.end = Some(error),
        }
        !self.lost
    }
}
