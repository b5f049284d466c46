//! Requests of the link, on a board whose frames come by themselves.
//!
//! | request | |
//! |---|---|
//! | `Load` and its pieces | into the bank that is not in use; if it fits, the banks are exchanged, the loop is opened and the enables go down. A refused image changes nothing |
//! | `Reset` | opens the loop, and asks for the enables |
//! | `Frame` | answered by what the detector's next frame leaves, whatever its number; refused if none comes |
//! | `MeasuredFrame` | refused: there is a detector |
//! | others | refused |

use crate::answers::Snapshot;
use crate::asking::Asking;
use crate::gate::{GateError, GateTicks};
use crate::shape::{Shape, ShapeError};
use splash_firmware::config::Config;
use splash_firmware::error::Field;
use splash_firmware::link::{Message, Reason, Receiver, Request, Response, Stack};
use splash_firmware::pipeline::RowError;
use splash_server::{Left, Link, Outbox, Pieces, identity, receive};

/// What a board gives to the service.
pub trait Board: Link {
    /// A wait begins.
    fn begin_wait(&mut self);

    /// Lets the frames' exception see its commands, does whatever else the main loop has to do, and
    /// returns whether to go on waiting.
    fn wait(&mut self) -> bool;

    /// The gate of the frames to come, and the length unit of what is told of them, m.
    fn configured(&mut self, gate: GateTicks, ulp_m: f64);

    /// Asks for the enables.
    fn arm(&mut self);

    /// Takes the enables down.
    fn disarm(&mut self);

    /// How deep the stack went since the start.
    fn stack(&self) -> Stack;
}

/// Whether this board can do what a configuration asks for.
///
/// # Errors
/// The field that it cannot.
pub fn fit<const M: usize, const P: usize, const B: usize>(
    config: &Config<M, P, B>,
) -> Result<(Shape, GateTicks), Reason> {
    let refuse = |field, value: f64, limits| Reason::Value { field, index: None, value, limits };
    let shape = Shape::new(config.width(), config.height(), config.bits());
    let shape = shape.map_err(|error| match error {
        ShapeError::OddWidth { width } => refuse(Field::DetectorWidth, width.into(), None),
        ShapeError::Bits { bits } => refuse(Field::DetectorBits, bits.into(), Some([10.0, 14.0])),
    })?;
    let gate = GateTicks::new(&config.timing()).map_err(|error| match error {
        GateError::Delay { ns } => refuse(Field::BeaconHeight, ns.into(), None),
        GateError::Width { ns } => refuse(Field::GateDepth, ns.into(), None),
    })?;
    Ok((shape, gate))
}

/// Answers requests, one after the other.
pub struct Service<'q, const M: usize, const P: usize, const B: usize> {
    name: &'static str,
    asking: Asking<'q, M, P, B>,
    /// The bank that is not in use.
    spare: Option<&'static mut Config<M, P, B>>,
    receiver: Receiver,
}

impl<'q, const M: usize, const P: usize, const B: usize> Service<'q, M, P, B> {
    /// One for the board of this name, at most 16 bytes, with the bank that is not in use.
    pub const fn new(
        name: &'static str,
        asking: Asking<'q, M, P, B>,
        spare: &'static mut Config<M, P, B>,
    ) -> Self {
        Self { name, asking, spare: Some(spare), receiver: Receiver::new() }
    }

    /// Answers until the link ends, and returns why it did.
    pub fn run<T: Board>(&mut self, board: &mut T) -> T::Error {
        let mut next = None;
        loop {
            let request = match next.take() {
                Some(request) => Ok(request),
                None => receive(board, &mut self.receiver),
            };
            match request.and_then(|request| self.answer(board, request)) {
                Ok(interrupt) => next = interrupt,
                Err(error) => return error,
            }
        }
    }

    fn answer<T: Board>(&mut self, board: &mut T, request: Message<Request>) -> Left<T::Error> {
        let mut out = Outbox { port: board, sequence: request.sequence };
        match request.body {
            Request::Identify => out.send(Response::Identity(identity::<M, P, B>(self.name)))?,
            Request::Load { bytes } => {
                let mut pieces = Pieces::new(out.port, &mut self.receiver, bytes);
                let Some(spare) = self.spare.take() else { return pieces.drain() };
                let loaded = spare.load(&mut |bytes| pieces.fill(bytes));
                let interrupt = pieces.drain()?;
                let (spare, answer) = match loaded.map_err(Reason::from).and_then(|()| fit(spare)) {
                    Ok((shape, gate)) => {
                        let ulp_m = spare.ulp_m();
                        out.port.disarm();
                        let before = self.asking.exchange(spare, shape, &mut waiting(out.port));
                        out.port.configured(gate, ulp_m);
                        (before, Response::Ready)
                    }
                    Err(reason) => (spare, Response::Refused(reason)),
                };
                self.spare = Some(spare);
                out.send(answer)?;
                return Ok(interrupt);
            }
            // One of an image that was given up, or of a frame that will be refused.
            Request::Piece { .. } | Request::Measurements { .. } => {}
            Request::Reset => {
                let state = self.asking.reset(&mut waiting(out.port));
                // The flat mirror's codes are on their way.
                out.port.arm();
                codes(&mut out, &state)?;
                out.send(Response::Ready)?;
            }
            Request::Frame { .. } => {
                let state = self.asking.next_frame(&mut waiting(out.port));
                match state {
                    Some(state) => frame(&mut out, &state)?,
                    None => out.send(Response::Refused(Reason::Row(RowError::NotBegun)))?,
                }
            }
            Request::MeasuredFrame { .. } => {
                out.send(Response::Refused(Reason::Row(RowError::NotBegun)))?;
            }
            Request::GlobalTilt(tilt) => {
                self.asking.global_tilt(tilt, &mut waiting(out.port));
                out.send(Response::Ready)?;
            }
            Request::Stack => {
                let stack = out.port.stack();
                out.send(Response::Stack(stack))?;
            }
            _ => out.send(Response::Refused(Reason::Unsupported))?,
        }
        Ok(None)
    }
}

/// A wait that begins now.
fn waiting<T: Board>(board: &mut T) -> impl FnMut() -> bool {
    board.begin_wait();
    || board.wait()
}

fn codes<T: Link, const M: usize>(
    out: &mut Outbox<'_, T>,
    state: &Snapshot<M>,
) -> Result<(), T::Error> {
    out.list(&state.codes, |first, items| Response::Codes { first, items })?;
    out.send(Response::Totals(state.totals))
}

fn frame<T: Link, const M: usize>(
    out: &mut Outbox<'_, T>,
    state: &Snapshot<M>,
) -> Result<(), T::Error> {
    codes(out, state)?;
    out.list(&state.measurements, |first, items| Response::Measurements { first, items })?;
    out.list(&state.slopes, |first, items| Response::Slopes { first, items })?;
    out.list(&state.positions, |first, items| Response::Positions { first, items })?;
    match state.report {
        Some(report) => out.send(Response::Report(report)),
        // A frame's state always has one.
        None => Ok(()),
    }
}
