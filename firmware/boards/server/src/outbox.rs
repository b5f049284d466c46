//! Answers, piece by piece.

use crate::Link;
use splash_firmware::centroid::Measurement;
use splash_firmware::link::{self, HISTORY, List, Message, Response};
use splash_firmware::pipeline::Totals;
use splash_firmware::segments::{ACTUATORS, Position};
use splash_firmware::slopes::Slope;

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

    /// Sends DAC codes and totals.
    ///
    /// # Errors
    /// If the link has ended.
    pub fn state(&mut self, codes: &[[u16; ACTUATORS]], totals: Totals) -> Result<(), T::Error> {
        self.list(codes, |first, items| Response::Codes { first, items })?;
        self.send(Response::Totals(totals))
    }

    /// Sends what a frame measured, and where the segments are.
    ///
    /// # Errors
    /// If the link has ended.
    pub fn measured(
        &mut self,
        measurements: &[Measurement],
        slopes: &[Slope],
        positions: &[Position],
    ) -> Result<(), T::Error> {
        self.list(measurements, |first, items| Response::Measurements { first, items })?;
        self.list(slopes, |first, items| Response::Slopes { first, items })?;
        self.list(positions, |first, items| Response::Positions { first, items })
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
