//! Requests, one after the other.

use crate::image::Pieces;
use crate::outbox::Outbox;
use crate::{Link, Port};
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::link::{Identity, Message, Reason, Receiver, Request, Response};
use splash_firmware::pipeline::{Pipeline, Probe, RowError, Stage};

/// Serves host-sim until a transfer fails, and returns why it did.
///
/// `board` is the board's name, at most 16 bytes. `config` is loaded from the link; before, every
/// frame is held. In a frame there are marks before and after `begin`, before and after each
/// `push_rows` (the wait for the rows is outside), before `finish`, after each of its stages and
/// after its end; two in a row at the start tell what a mark itself costs.
pub fn serve<T: Port, const M: usize, const P: usize, const B: usize>(
    port: &mut T,
    board: &str,
    config: &mut Config<M, P, B>,
    pipeline: &mut Pipeline<M, B>,
) -> T::Error {
    mark_twice::<T>();
    let measurements = heapless::Vec::new();
    let mut server = Server { board, config, pipeline, measurements };
    let mut receiver = Receiver::new();
    let mut next = None;
    loop {
        let request = match next.take() {
            Some(request) => Ok(request),
            None => receive(port, &mut receiver),
        };
        match request.and_then(|request| server.answer(port, &mut receiver, request)) {
            Ok(interrupt) => next = interrupt,
            Err(error) => return error,
        }
    }
}

/// What a board of that name, at most 16 bytes, and these capacities says of itself.
#[must_use]
pub fn identity<const M: usize, const P: usize, const B: usize>(board: &str) -> Identity {
    Identity {
        board: board.try_into().unwrap_or_default(),
        version: env!("CARGO_PKG_VERSION").try_into().unwrap_or_default(),
        cells: M as u32,
        pixels: P as u32,
        buffered: B as u32,
    }
}

/// Its own function, so that nothing is done between the two.
#[inline(never)]
fn mark_twice<T: Port>() {
    T::mark();
    T::mark();
}

/// The next request; what cannot be read is passed over.
///
/// # Errors
/// If the link ends.
pub fn receive<T: Link>(
    port: &mut T,
    receiver: &mut Receiver,
) -> Result<Message<Request>, T::Error> {
    loop {
        let mut byte = [0];
        port.receive(&mut byte)?;
        if let Some(Ok(request)) = receiver.push(u8::from_le_bytes(byte)) {
            return Ok(request);
        }
    }
}

/// Passes the end of each stage on as a mark.
struct Marks<T>(core::marker::PhantomData<T>);

impl<T: Port> Probe for Marks<T> {
    #[inline(always)]
    fn after(&mut self, _: Stage) {
        T::mark();
    }
}

struct Server<'a, const M: usize, const P: usize, const B: usize> {
    board: &'a str,
    config: &'a mut Config<M, P, B>,
    pipeline: &'a mut Pipeline<M, B>,
    /// Of the measured frame to come.
    measurements: heapless::Vec<Measurement, M>,
}

impl<const M: usize, const P: usize, const B: usize> Server<'_, M, P, B> {
    /// Answers a request, and returns the one that interrupted it.
    fn answer<T: Port>(
        &mut self,
        port: &mut T,
        receiver: &mut Receiver,
        request: Message<Request>,
    ) -> crate::Left<T::Error> {
        let mut out = Outbox { port, sequence: request.sequence };
        match request.body {
            Request::Identify => out.send(Response::Identity(identity::<M, P, B>(self.board)))?,
            Request::Load { bytes } => {
                let mut pieces = Pieces::new(out.port, receiver, bytes);
                let loaded = self.config.load(&mut |bytes| pieces.fill(bytes));
                let interrupt = pieces.drain()?;
                self.pipeline.reset(self.config);
                out.send(match loaded {
                    Ok(()) => Response::Ready,
                    Err(error) => Response::Refused(error.into()),
                })?;
                return Ok(interrupt);
            }
            // One of an image that was given up.
            Request::Piece { .. } => {}
            Request::Reset => {
                self.pipeline.reset(self.config);
                out.port.actuate(self.pipeline.codes())?;
                self.state(&mut out)?;
                out.send(Response::Ready)?;
            }
            Request::Frame { number, pixels } => {
                let read = self.read(out.port, number, pixels as usize)?;
                self.finish(&mut out, read)?;
            }
            Request::Measurements { first, items } => {
                if first == 0 {
                    self.measurements.clear();
                }
                if usize::from(first) == self.measurements.len() {
                    // Without room the frame is refused for its count.
                    let _ = self.measurements.extend_from_slice(&items);
                }
            }
            Request::MeasuredFrame { number, count } => {
                let read = self.take::<T>(number, count);
                self.finish(&mut out, read)?;
            }
            Request::GlobalTilt(tilt) => {
                self.pipeline.set_global_tilt(tilt);
                out.send(Response::Ready)?;
            }
            Request::Stack => {
                let stack = out.port.stack();
                out.send(Response::Stack(stack))?;
            }
        }
        Ok(None)
    }

    fn begin<T: Port>(&mut self, number: u32) {
        T::mark();
        self.pipeline.begin(self.config, number);
        T::mark();
    }

    /// Rows from the detector; those behind a refused one are read and left.
    fn read<T: Port>(
        &mut self,
        port: &mut T,
        number: u32,
        pixels: usize,
    ) -> Result<Result<(), RowError>, T::Error> {
        self.begin::<T>(number);
        let width = usize::from(self.config.width()).max(1);
        port.expose(pixels, width)?;
        let mut read = Ok(());
        while let Some(rows) = port.rows()? {
            let count = rows.len().div_ceil(width) as u16;
            if read.is_ok() {
                T::mark();
                let pushed = self.pipeline.push_rows(self.config, rows, count);
                T::mark();
                read = pushed.map(|_| ());
            }
        }
        Ok(read)
    }

    /// The measurements that came before.
    fn take<T: Port>(&mut self, number: u32, count: u32) -> Result<(), RowError> {
        self.begin::<T>(number);
        // Where some are missing, none are good.
        let complete = self.measurements.len() == count as usize;
        let measurements = if complete { self.measurements.as_slice() } else { &[] };
        let pushed = self.pipeline.push_measurements(self.config, measurements);
        self.measurements.clear();
        pushed.map(|_| ()).map_err(|error| match error {
            RowError::Length { expected, .. } => RowError::Length { found: count, expected },
            other => other,
        })
    }

    /// What a frame leaves; a refused one is not finished, and the next one will say so.
    fn finish<T: Port>(
        &mut self,
        out: &mut Outbox<'_, T>,
        read: Result<(), RowError>,
    ) -> Result<(), T::Error> {
        if let Err(error) = read {
            return out.send(Response::Refused(Reason::Row(error)));
        }
        T::mark();
        let report =
            self.pipeline.finish_probed(self.config, &mut Marks::<T>(core::marker::PhantomData));
        T::mark();
        out.port.actuate(self.pipeline.codes())?;
        self.state(out)?;
        out.list(self.pipeline.measurements(), |first, items| Response::Measurements {
            first,
            items,
        })?;
        out.list(self.pipeline.slopes(), |first, items| Response::Slopes { first, items })?;
        out.list(self.pipeline.positions(), |first, items| Response::Positions { first, items })?;
        out.send(Response::Report(report))
    }

    fn state<T: Port>(&self, out: &mut Outbox<'_, T>) -> Result<(), T::Error> {
        out.list(self.pipeline.codes(), |first, items| Response::Codes { first, items })?;
        out.send(Response::Totals(self.pipeline.totals()))
    }
}
