//! Requests out, answers in, telemetry aside.

use super::transport::{Failure, Transport};
use splash_firmware::link::{self, Message, Receiver, Request, Response};
use splash_firmware::telemetry::Record;
use std::collections::VecDeque;
use std::time::Instant;

/// One end of a link.
pub struct Client<T> {
    transport: T,
    receiver: Receiver,
    /// Bytes that came and were not looked at yet.
    inbox: VecDeque<u8>,
    /// Number of the last request.
    sequence: u16,
    telemetry: VecDeque<Record>,
}

impl<T: Transport> Client<T> {
    /// A client that has asked nothing yet.
    pub fn new(transport: T) -> Self {
        let (inbox, telemetry) = (VecDeque::new(), VecDeque::new());
        Self { transport, receiver: Receiver::new(), inbox, sequence: 0, telemetry }
    }

    /// What the bytes go over.
    pub fn transport(&mut self) -> &mut T {
        &mut self.transport
    }

    /// When the board is to have answered what it is asked now.
    pub fn deadline(&self) -> Instant {
        Instant::now() + self.transport.patience()
    }

    /// Sends a request with a number of its own.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn request(&mut self, body: Request, deadline: Instant) -> Result<(), Failure> {
        self.sequence = self.sequence.wrapping_add(1).max(1);
        self.send(body, deadline)
    }

    /// Sends what belongs to the last request.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn send(&mut self, body: Request, deadline: Instant) -> Result<(), Failure> {
        let mut wire = [0; link::WIRE];
        let bytes = link::encode(&Message { sequence: self.sequence, body }, &mut wire)?;
        self.transport.send(bytes, deadline)
    }

    /// The next answer to the last request.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn answer(&mut self, deadline: Instant) -> Result<Response, Failure> {
        let refused = self.receiver.refused();
        loop {
            if let Some(response) = self.next_answer()? {
                return Ok(response);
            }
            self.read(deadline).map_err(|failure| self.in_noise(failure, refused))?;
        }
    }

    /// Asks what has one answer.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn ask(&mut self, body: Request) -> Result<Response, Failure> {
        let deadline = self.deadline();
        self.request(body, deadline)?;
        self.answer(deadline)
    }

    /// The telemetry that has come, oldest first, or that comes before `deadline`.
    ///
    /// # Errors
    /// [`Failure`], [`Failure::Silent`] if none comes.
    pub fn telemetry(&mut self, deadline: Instant) -> Result<Record, Failure> {
        let refused = self.receiver.refused();
        loop {
            // An answer to what was given up is no telemetry.
            while self.telemetry.is_empty() && self.next_answer()?.is_some() {}
            if let Some(record) = self.telemetry.pop_front() {
                return Ok(record);
            }
            self.read(deadline).map_err(|failure| self.in_noise(failure, refused))?;
        }
    }

    /// The telemetry that came with the answers so far.
    pub fn told(&mut self) -> impl Iterator<Item = Record> + '_ {
        self.telemetry.drain(..)
    }

    /// The next answer among the bytes that are here.
    fn next_answer(&mut self) -> Result<Option<Response>, Failure> {
        while let Some(byte) = self.inbox.pop_front() {
            match self.receiver.push::<Response>(byte) {
                None => {}
                Some(Ok(Message { sequence: 0, body: Response::Telemetry(record) })) => {
                    self.telemetry.push_back(record);
                    return Ok(None);
                }
                Some(Ok(Message { sequence, body })) if sequence == self.sequence => {
                    return Ok(Some(body));
                }
                // To a request that was given up.
                Some(Ok(_)) => {}
                Some(Err(_)) if self.transport.is_noisy() => {}
                Some(Err(error)) => return Err(error.into()),
            }
        }
        Ok(None)
    }

    fn read(&mut self, deadline: Instant) -> Result<(), Failure> {
        if !self.inbox.is_empty() {
            return Ok(());
        }
        // A board that talks on is not waited for longer than one that is silent.
        if Instant::now() >= deadline {
            return Err(Failure::Silent { patience: self.transport.patience() });
        }
        let mut bytes = [0; 4096];
        let read = self.transport.receive(&mut bytes, deadline)?;
        self.inbox.extend(bytes.iter().take(read));
        Ok(())
    }

    fn in_noise(&self, failure: Failure, refused: u32) -> Failure {
        match (failure, self.receiver.refused().saturating_sub(refused)) {
            (Failure::Silent { patience }, messages @ 1..) => Failure::Noise { patience, messages },
            (failure, _) => failure,
        }
    }
}

/// A message that has no place here, by the name of its variant.
pub(crate) fn unexpected(response: &Response) -> Failure {
    let text = format!("{response:?}");
    let name = text.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
    Failure::Answer(format!("the message {name}, out of turn"))
}
