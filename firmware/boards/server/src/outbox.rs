//! Answers, piece by piece.

use crate::Link;
use splash_firmware::link::{self, HISTORY, List, Message, Response};

/// Sends the answers to one request.
pub struct Outbox<'a, T> {
    /// Where to.
    pub port: &'a mut T,
    /// Number of the request.
    pub sequence: u16,
}

impl<T: Link> Outbox<'_, T> {
    /// Sends one.
    ///
    /// # Errors
    /// If the link has ended.
    pub fn send(&mut self, body: Response) -> Result<(), T::Error> {
        let mut wire = [0; link::WIRE];
        match link::encode(&Message { sequence: self.sequence, body }, &mut wire) {
            Ok(bytes) => self.port.send(bytes),
            // No response is that long; the other end misses it and says so.
            Err(_) => Ok(()),
        }
    }

    /// Sends a list in pieces.
    ///
    /// # Errors
    /// If the link has ended.
    pub fn list<E: Copy>(
        &mut self,
        items: &[E],
        piece: fn(u16, List<E>) -> Response,
    ) -> Result<(), T::Error> {
        for (i, items) in items.chunks(link::LIST).enumerate() {
            let mut list = List::new();
            // There is room: chunks have no more.
            let _ = list.extend_from_slice(items);
            self.send(piece((i * link::LIST) as u16, list))?;
        }
        Ok(())
    }

    /// Sends a history in pieces.
    ///
    /// # Errors
    /// If the link has ended.
    pub fn history<E>(
        &mut self,
        mut items: impl Iterator<Item = E>,
        piece: fn(u16, heapless::Vec<E, HISTORY>) -> Response,
    ) -> Result<(), T::Error> {
        let mut first = 0;
        loop {
            let mut next = heapless::Vec::<E, HISTORY>::new();
            while !next.is_full()
                && let Some(item) = items.next()
            {
                // There is room.
                let _ = next.push(item);
            }
            if next.is_empty() {
                return Ok(());
            }
            let count = next.len() as u16;
            self.send(piece(first, next))?;
            first += count;
        }
    }
}
