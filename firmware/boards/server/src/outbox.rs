//! Answers, piece by piece.

use crate::Port;
use splash_firmware::link::{self, List, Message, Response};

/// Sends the answers to one request.
pub(crate) struct Outbox<'a, T> {
    pub(crate) port: &'a mut T,
    pub(crate) sequence: u16,
}

impl<T: Port> Outbox<'_, T> {
    pub(crate) fn send(&mut self, body: Response) -> Result<(), T::Error> {
        let mut wire = [0; link::WIRE];
        match link::encode(&Message { sequence: self.sequence, body }, &mut wire) {
            Ok(bytes) => self.port.send(bytes),
            // No response is that long; the other end misses it and says so.
            Err(_) => Ok(()),
        }
    }

    /// Sends a list in pieces.
    pub(crate) fn list<E: Copy>(
        &mut self,
        items: &[E],
        piece: fn(u16, List<E>) -> Response,
    ) -> Result<(), T::Error> {
        for (i, items) in items.chunks(link::LIST).enumerate() {
            let first = (i * link::LIST) as u16;
            self.send(piece(first, items.iter().copied().collect()))?;
        }
        Ok(())
    }
}
