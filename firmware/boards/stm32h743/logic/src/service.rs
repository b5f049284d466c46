//! Requests of the link, on a board whose frames come by themselves. What they mean is said in
//! [`Request`]; where frames that come by themselves make a difference:
//!
//! | request | |
//! |---|---|
//! | `Load` and its pieces | into the other bank; if it fits this board, disarms and has it run. A refused image changes nothing |
//! | `Switch` | answered when the frame boundary has come; why the controller refused is in the status |
//! | `Reset` | disarms: safe, the mirror ramps to the flat map |
//! | `Frame` | answered by what the detector's next frame leaves, whatever its number; refused if none comes |
//! | `MeasuredFrame` | refused: there is a detector |

use crate::answers::{Books, Next, Snapshot};
use crate::asking::Asking;
use crate::bank::{Half, join, split};
use crate::clocks::{CORE_HZ, LINK_BAUD};
use crate::shape::{Shape, ShapeError};
use embedded_storage::nor_flash::NorFlash;
use heapless::spsc::Consumer;
use splash_firmware::banks::{BankError, Draft, DraftState};
use splash_firmware::config::Config;
use splash_firmware::controller::Command;
use splash_firmware::error::Field;
use splash_firmware::fault::Moment;
use splash_firmware::gate::GateStamp;
use splash_firmware::identity;
use splash_firmware::link::{
    Counters, Message, Reason, Receiver, Request, Response, Stack, Status,
};
use splash_firmware::mirror::Serials;
use splash_firmware::mode::{Mode, Refusal};
use splash_firmware::pipeline::RowError;
use splash_firmware::store::Store;
use splash_firmware::strehl;
use splash_firmware::telemetry::{self, Decimation};
use splash_server::{Left, Link, Outbox, Pieces, identity, parameters};

/// Serial numbers of mirror and detector: this board cannot read them, and nobody has stated them yet.
pub const SERIALS: Serials = Serials { mirror: 0, detector: 0 };

/// Bytes that the link carries in a second: each has a start and a stop bit.
const LINK_BYTES_PER_S: u32 = LINK_BAUD / 10;

/// What a board gives to the service.
pub trait Board: Link {
    /// Where configurations are stored.
    type Flash<'a>: NorFlash
    where
        Self: 'a;

    /// The next byte of the link, if it has come.
    ///
    /// # Errors
    /// If the link has ended.
    fn next(&mut self) -> Result<Option<u8>, Self::Error>;

    /// A wait begins.
    fn begin_wait(&mut self);

    /// Lets the frames' exception see its commands, does whatever else the main loop has to do, and
    /// returns whether to go on waiting.
    fn wait(&mut self) -> bool;

    /// How deep the stack went since the start.
    fn stack(&self) -> Stack;

    /// Where configurations are stored. What takes long there lets the main loop do the rest.
    fn flash(&mut self) -> Self::Flash<'_>;

    /// Another configuration runs: the length unit of what is told of its frames, m.
    fn configured(&mut self, ulp_m: f64);
}

/// How the frames of a configuration come on this board.
///
/// # Errors
/// The field that the board cannot do.
pub fn fit<const M: usize, const P: usize, const B: usize>(
    config: &Config<M, P, B>,
) -> Result<Shape, Reason> {
    let refuse = |field, value: f64, limits| Reason::Value { field, index: None, value, limits };
    let shape = Shape::new(config.width(), config.height(), config.bits());
    shape.map_err(|error| match error {
        ShapeError::OddWidth { width } => refuse(Field::DetectorWidth, width.into(), None),
        ShapeError::Bits { bits } => refuse(Field::DetectorBits, bits.into(), Some([10.0, 14.0])),
    })
}

/// Answers requests, one after the other, and sends telemetry between them.
pub struct Service<'q, const M: usize, const P: usize, const B: usize> {
    name: &'static str,
    asking: Asking<'q, M, P, B>,
    telemetry: Consumer<'q, telemetry::Record>,
    running: Half<M, P, B>,
    /// Its hash; 0 without a configuration.
    hash: u32,
    /// The other bank; not here while it is handed over.
    draft: Option<Draft<'static, M, P, B>>,
    /// Why it was not let run.
    refused: Option<Refusal>,
    receiver: Receiver,
}

impl<'q, const M: usize, const P: usize, const B: usize> Service<'q, M, P, B> {
    /// One for the board of this name, at most 16 bytes, with its half of the bank that runs, and the
    /// other bank.
    pub fn new(
        name: &'static str,
        asking: Asking<'q, M, P, B>,
        telemetry: Consumer<'q, telemetry::Record>,
        running: Half<M, P, B>,
        other: &'static mut Config<M, P, B>,
    ) -> Self {
        Self {
            name,
            asking,
            telemetry,
            running,
            hash: 0,
            draft: Some(Draft::new(other)),
            refused: None,
            receiver: Receiver::new(),
        }
    }

    /// At the start: has the configuration run that is stored, if there is one, with the hardware that
    /// was there.
    ///
    /// # Errors
    /// Why it does not run. The board then waits for one from the link.
    pub fn restore<T: Board>(&mut self, board: &mut T) -> Result<(), Reason> {
        if let Some(draft) = &mut self.draft {
            let stored = draft.restore(&mut Store::new(board.flash()))?;
            self.operator(board, Command::Hardware(stored.serials))?;
        }
        self.switch(board)?;
        self.refused.map_or(Ok(()), |refusal| Err(refusal.into()))
    }

    /// Answers until the link ends, and returns why it did.
    pub fn run<T: Board>(&mut self, board: &mut T) -> T::Error {
        let mut next = None;
        loop {
            if let Err(end) = self.step(board, &mut next) {
                return end;
            }
        }
    }

    /// The next request, or what telemetry there is while none comes.
    fn step<T: Board>(
        &mut self,
        board: &mut T,
        next: &mut Option<Message<Request>>,
    ) -> Result<(), T::Error> {
        if let Some(request) = next.take() {
            *next = self.answer(board, request)?;
            return Ok(());
        }
        board.wait();
        match board.next()? {
            Some(byte) => {
                if let Some(Ok(request)) = self.receiver.push(byte) {
                    *next = Some(request);
                }
            }
            None => {
                if let Some(record) = self.telemetry.dequeue() {
                    Outbox { port: board, sequence: 0 }.send(Response::Telemetry(record))?;
                }
            }
        }
        Ok(())
    }

    /// Answers a request, and returns the one that interrupted it.
    fn answer<T: Board>(&mut self, board: &mut T, request: Message<Request>) -> Left<T::Error> {
        let mut out = Outbox { port: board, sequence: request.sequence };
        match request.body {
            Request::Identify => out.send(Response::Identity(identity::<M, P, B, 0>(self.name)))?,
            Request::Load { bytes } => {
                let mut pieces = Pieces::new(out.port, &mut self.receiver, bytes);
                let loaded = match &mut self.draft {
                    Some(draft) => parameters::load(draft, &mut pieces, bytes),
                    None => Err(BankError::Ordered),
                };
                let interrupt = pieces.drain()?;
                let ran = loaded.map_err(Reason::from).and_then(|()| self.run_at_once(out.port));
                out.send(ran.map_or_else(Response::Refused, |()| Response::Ready))?;
                return Ok(interrupt);
            }
            // One of an image that was given up, or of a frame that will be refused.
            Request::Piece { .. } | Request::Measurements { .. } => {}
            Request::Reset => {
                // Into safe leads a way from everywhere.
                let _ = self.operator(out.port, Command::Disarm);
                let state = self.asking.state(&mut waiting(out.port));
                out.state(&state.codes, state.totals)?;
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
            Request::Command(command) => {
                let done = self.operator(out.port, command);
                out.send(done.map_or_else(refused, |()| Response::Ready))?;
            }
            Request::ReadBack { offset, bytes } => {
                parameters::read_back(&self.running, &mut out, offset, bytes)?;
                out.send(Response::Ready)?;
            }
            Request::Subscribe(decimation) => {
                let decimation = decimation.unwrap_or_else(|| self.usual_streams());
                let streams = self.streams(out.port, Some(decimation));
                out.send(streams)?;
            }
            Request::Streams => {
                let streams = self.streams(out.port, None);
                out.send(streams)?;
            }
            Request::Status => {
                let books = self.asking.books(&mut waiting(out.port));
                out.send(Response::Status(self.status(&books)))?;
            }
            Request::Counters => {
                let books = self.asking.books(&mut waiting(out.port));
                out.send(Response::Counters(Counters {
                    totals: books.totals,
                    faults: books.faults,
                    refused_transitions: books.refused,
                    unreadable_messages: self.receiver.refused(),
                }))?;
            }
            Request::Faults => {
                let books = self.asking.books(&mut waiting(out.port));
                let last = books.last_faults.into_iter();
                out.history(last, |first, items| Response::Faults { first, items })?;
                out.send(Response::Ready)?;
            }
            Request::Transitions => {
                let books = self.asking.books(&mut waiting(out.port));
                let last = books.transitions.into_iter();
                out.history(last, |first, items| Response::Transitions { first, items })?;
                out.send(Response::Ready)?;
            }
            Request::Pixels { row, first } => {
                let answer = self.pixels(out.port, row, first);
                out.send(answer.unwrap_or_else(Response::Refused))?;
            }
            other => {
                let answer = self.configuration(out.port, &other);
                out.send(answer)?;
            }
        }
        Ok(None)
    }

    /// Requests about the two banks and the store.
    fn configuration<T: Board>(&mut self, board: &mut T, request: &Request) -> Response {
        let answer = match request {
            Request::Switch => self.switch(board).map(Response::Draft),
            Request::Copy => self.draft(|draft, running| draft.copy(running)),
            Request::Store => self.store(board),
            Request::Stored => {
                let stored = Store::new(board.flash()).newest_stored();
                stored.map(Response::Stored).map_err(Reason::from)
            }
            Request::Restore => {
                let mut store = Store::new(board.flash());
                self.draft(|draft, _| draft.restore(&mut store).map(|_| ()))
            }
            other => {
                let answer = self.draft.as_mut().and_then(|draft| parameters::draft(draft, other));
                let answer = answer.or_else(|| parameters::running(&*self.running, other));
                Ok(answer.unwrap_or(Response::Refused(Reason::Unsupported)))
            }
        };
        answer.unwrap_or_else(Response::Refused)
    }

    /// Does something to the other bank.
    fn draft<E: Into<Reason>>(
        &mut self,
        change: impl FnOnce(&mut Draft<'static, M, P, B>, &Config<M, P, B>) -> Result<(), E>,
    ) -> Result<Response, Reason> {
        let draft = self.draft.as_mut().ok_or(BankError::Ordered)?;
        change(draft, &self.running).map_err(E::into)?;
        Ok(Response::Draft(draft.state()))
    }

    /// Has the other bank run from the next frame boundary on, which it waits for.
    fn switch<T: Board>(&mut self, board: &mut T) -> Result<DraftState, Reason> {
        let draft = self.draft.as_mut().ok_or(BankError::Ordered)?;
        let shape = fit(draft.whole().ok_or(BankError::Empty)?)?;
        let hash = draft.switch()?;
        let Some(draft) = self.draft.take() else { return Err(BankError::Ordered.into()) };
        let bank = draft.into_bank();
        let (calibrated, ulp_m) = (bank.calibration().is_ok(), bank.ulp_m());
        let (mine, theirs) = split(bank);
        let next = Next { bank: theirs, hash, shape, calibrated };
        let exchanged = self.asking.exchange(next, &mut waiting(board));
        let other = match exchanged {
            Ok(before) => {
                (self.hash, self.refused) = (hash, None);
                board.configured(ulp_m);
                join(before, core::mem::replace(&mut self.running, mine))
            }
            Err((theirs, refusal)) => {
                self.refused = Some(refusal);
                join(theirs, mine)
            }
        };
        // Both halves are always those of one bank.
        self.draft = other.map(Draft::new);
        if self.refused.is_some()
            && let Some(draft) = &mut self.draft
        {
            // As it was.
            let _ = draft.check();
        }
        Ok(DraftState::Ordered { hash })
    }

    /// Has an image run that came by `Load`.
    fn run_at_once<T: Board>(&mut self, board: &mut T) -> Result<(), Reason> {
        let draft = self.draft.as_ref().ok_or(BankError::Ordered)?;
        fit(draft.whole().ok_or(BankError::Empty)?)?;
        // Into safe leads a way from everywhere.
        let _ = self.operator(board, Command::Disarm);
        self.switch(board)?;
        self.refused.map_or(Ok(()), |refusal| Err(refusal.into()))
    }

    fn operator<T: Board>(&mut self, board: &mut T, command: Command) -> Result<(), Refusal> {
        self.asking.operator(command, &mut waiting(board))
    }

    /// Stores what runs. It takes longer than a frame: the loop must not need one.
    fn store<T: Board>(&mut self, board: &mut T) -> Result<Response, Reason> {
        let books = self.asking.books(&mut waiting(board));
        match books.mode {
            Mode::Safe | Mode::Standby => {}
            mode => return Err(Refusal::WrongMode { mode }.into()),
        }
        let stored = Store::new(board.flash()).store(&*self.running, books.serials)?;
        Ok(Response::Stored(Some(stored)))
    }

    /// Raw pixels of a row of the next frame.
    fn pixels<T: Board>(
        &mut self,
        board: &mut T,
        row: u16,
        first: u16,
    ) -> Result<Response, Reason> {
        parameters::find_pixel(&*self.running, row, first)?;
        let found = self.asking.row(row, first, &mut waiting(board));
        let (frame, bytes) = found.ok_or(Reason::Row(RowError::NotBegun))?;
        Ok(Response::Pixels { frame, bytes })
    }

    fn streams<T: Board>(&mut self, board: &mut T, wanted: Option<Decimation>) -> Response {
        let (decimation, dropped) = self.asking.streams(wanted, &mut waiting(board));
        Response::Streams { decimation, dropped }
    }

    fn usual_streams(&self) -> Decimation {
        let (config, frame_ns) = (&self.running, self.running.timing().frame_ns());
        let (subapertures, windows) = (config.subapertures(), config.windows());
        Decimation::for_link(LINK_BYTES_PER_S, frame_ns, subapertures, windows)
    }

    fn status(&self, books: &Books) -> Status {
        let valid = books.last.map_or(0, |last| last.report.valid);
        let draft = self.draft.as_ref().map_or(DraftState::Empty, Draft::state);
        Status {
            build: identity::BUILD,
            configuration: self.hash,
            serials: books.serials,
            draft,
            draft_refused: self.refused,
            mode: books.mode,
            outputs: books.outputs,
            at: Moment { frame: books.last.map_or(0, |last| last.at.frame), ticks: books.now },
            ticks_per_second: CORE_HZ,
            gate: books.last.map_or_else(GateStamp::default, |last| last.gate),
            tilt_rms_nm: strehl::tilt_rms_nm(books.tilt_squared_ulp2, valid, self.running.ulp_m()),
        }
    }
}

fn refused(error: impl Into<Reason>) -> Response {
    Response::Refused(error.into())
}

/// A wait that begins now.
fn waiting<T: Board>(board: &mut T) -> impl FnMut() -> bool {
    board.begin_wait();
    || board.wait()
}

fn frame<T: Link, const M: usize>(
    out: &mut Outbox<'_, T>,
    state: &Snapshot<M>,
) -> Result<(), T::Error> {
    out.state(&state.codes, state.totals)?;
    out.measured(&state.measurements, &state.slopes, &state.positions)?;
    match state.result {
        Some(result) => out.send(Response::Report(result.report)),
        // A frame's state always has one.
        None => Ok(()),
    }
}
