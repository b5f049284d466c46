//! Requests, one after the other.

use crate::image::Pieces;
use crate::outbox::Outbox;
use crate::{Link, Port, parameters};
use splash_firmware::banks::{BankError, Banks};
use splash_firmware::centroid::Measurement;
use splash_firmware::fault::Moment;
use splash_firmware::gate::GateStamp;
use splash_firmware::identity;
use splash_firmware::image::ImageError;
use splash_firmware::interlock::Outputs;
use splash_firmware::link::{
    Counters, Identity, Message, PIECE, Reason, Receiver, Request, Response, Status,
};
use splash_firmware::mirror::Serials;
use splash_firmware::mode::Mode;
use splash_firmware::pipeline::{Pipeline, Probe, Report, RowError, Stage};
use splash_firmware::strehl;
use splash_firmware::telemetry::{Cycles, Decimation, Ring, Stamp};

/// Serves host-sim until a transfer fails, and returns why it did.
///
/// `board` is the board's name, at most 16 bytes. Configurations come over the link; before the first,
/// every frame is held. In a frame there are marks before and after `begin`, before and after each
/// `push_rows` (the wait for the rows is outside), before `finish`, after each of its stages and
/// after its end; two in a row at the start tell what a mark itself costs. Telemetry is sent behind
/// the answers to a request.
pub fn serve<T: Port, const M: usize, const P: usize, const B: usize, const R: usize>(
    port: &mut T,
    board: &str,
    banks: Banks<'_, M, P, B>,
    pipeline: &mut Pipeline<M, B>,
    telemetry: &mut Ring<R>,
) -> T::Error {
    mark_twice::<T>();
    let measurements = heapless::Vec::new();
    let mut server = Server { board, banks, pipeline, telemetry, measurements, last: None };
    let mut receiver = Receiver::new();
    let mut next = None;
    loop {
        let request = match next.take() {
            Some(request) => Ok(request),
            None => receive(port, &mut receiver),
        };
        let answered = request.and_then(|request| {
            let interrupt = server.answer(port, &mut receiver, request)?;
            server.tell(port)?;
            Ok(interrupt)
        });
        match answered {
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
        version: identity::VERSION.try_into().unwrap_or_default(),
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

struct Server<'a, const M: usize, const P: usize, const B: usize, const R: usize> {
    board: &'a str,
    banks: Banks<'a, M, P, B>,
    pipeline: &'a mut Pipeline<M, B>,
    telemetry: &'a mut Ring<R>,
    /// Of the measured frame to come.
    measurements: heapless::Vec<Measurement, M>,
    /// Of the last frame.
    last: Option<Report>,
}

impl<const M: usize, const P: usize, const B: usize, const R: usize> Server<'_, M, P, B, R> {
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
                let loaded = self.load(&mut pieces, bytes);
                let interrupt = pieces.drain()?;
                self.pipeline.reset(self.banks.running());
                out.send(match loaded {
                    Ok(()) => Response::Ready,
                    Err(error) => Response::Refused(error.into()),
                })?;
                return Ok(interrupt);
            }
            // One of an image that was given up.
            Request::Piece { .. } => {}
            Request::Reset => {
                self.pipeline.reset(self.banks.running());
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
            Request::ReadBack { offset, bytes } => {
                parameters::read_back(self.banks.running(), &mut out, offset, bytes)?;
                out.send(Response::Ready)?;
            }
            Request::Copy => {
                let copied = self.banks.copy();
                out.send(match copied {
                    Ok(()) => Response::Draft(self.banks.draft.state()),
                    Err(error) => Response::Refused(error.into()),
                })?;
            }
            Request::Subscribe(decimation) => {
                self.telemetry.subscribe(decimation.unwrap_or_else(|| self.usual_streams()));
                out.send(self.streams())?;
            }
            Request::Streams => out.send(self.streams())?,
            Request::Status => out.send(Response::Status(self.status()))?,
            Request::Counters => {
                let totals = self.pipeline.totals();
                out.send(Response::Counters(Counters { totals, ..Counters::default() }))?;
            }
            other => {
                let answer = parameters::draft(&mut self.banks.draft, &other)
                    .or_else(|| parameters::running(self.banks.running(), &other))
                    .or_else(|| {
                        parameters::stored(out.port.flash(), &mut self.banks, &other, Ok(()))
                    });
                out.send(answer.unwrap_or(Response::Refused(Reason::Unsupported)))?;
            }
        }
        Ok(None)
    }

    /// An image from the link, to run at once.
    fn load<T: Link>(&mut self, pieces: &mut Pieces<'_, T>, length: u32) -> Result<(), BankError> {
        let draft = &mut self.banks.draft;
        draft.begin(length)?;
        let mut due = 0;
        while due < length {
            let mut piece = [0; PIECE];
            let room = PIECE.min(length.saturating_sub(due) as usize);
            let bytes = piece.get_mut(..room).unwrap_or_default();
            if !pieces.fill(bytes) {
                draft.discard();
                return Err(BankError::Image(ImageError::Cut));
            }
            due = draft.chunk(due, bytes)?;
        }
        draft.switch()?;
        self.banks.frame_boundary();
        Ok(())
    }

    /// Sends the telemetry that there is.
    fn tell<T: Port>(&mut self, port: &mut T) -> Result<(), T::Error> {
        let mut out = Outbox { port, sequence: 0 };
        while let Some(record) = self.telemetry.pop() {
            out.send(Response::Telemetry(record))?;
        }
        Ok(())
    }

    fn streams(&self) -> Response {
        let decimation = self.telemetry.decimation();
        Response::Streams { decimation, dropped: self.telemetry.dropped() }
    }

    /// What the ring holds of each frame: a pipe has no rate that is too low.
    fn usual_streams(&self) -> Decimation {
        let timing = self.banks.running().timing();
        let frame_ns = u64::from(timing.period_ns) * u64::from(timing.pulses_per_frame);
        Decimation::for_link(u32::MAX, frame_ns, self.banks.running().subapertures())
    }

    fn status(&self) -> Status {
        let config = self.banks.running();
        let valid = self.last.map_or(0, |report| report.valid);
        let squared = strehl::tilt_squared(self.pipeline.slopes());
        Status {
            build: identity::BUILD,
            configuration: self.banks.hash(),
            serials: Serials::default(),
            draft: self.banks.draft.state(),
            mode: Mode::ClosedLoop,
            outputs: Outputs::default(),
            at: Moment { frame: self.last.map_or(0, |report| report.frame), ticks: 0 },
            ticks_per_second: 0,
            gate: GateStamp::default(),
            tilt_rms_nm: strehl::tilt_rms_nm(squared, valid, config.ulp_m()),
        }
    }

    fn begin<T: Port>(&mut self, number: u32) {
        if self.banks.frame_boundary().is_some_and(|switched| switched.restart) {
            self.pipeline.reset(self.banks.running());
        }
        T::mark();
        self.pipeline.begin(self.banks.running(), number);
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
        let width = usize::from(self.banks.running().width()).max(1);
        port.expose(pixels, width)?;
        let mut read = Ok(());
        while let Some(rows) = port.rows()? {
            let count = rows.len().div_ceil(width) as u16;
            if read.is_ok() {
                T::mark();
                let pushed = self.pipeline.push_rows(self.banks.running(), rows, count);
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
        let pushed = self.pipeline.push_measurements(self.banks.running(), measurements);
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
        let report = self
            .pipeline
            .finish_probed(self.banks.running(), &mut Marks::<T>(core::marker::PhantomData));
        T::mark();
        out.port.actuate(self.pipeline.codes())?;
        let stamp = Stamp {
            time_ticks: 0,
            configuration: self.banks.hash(),
            gate: GateStamp::default(),
            mode: Mode::ClosedLoop,
            cycles: Cycles::default(),
        };
        self.telemetry.fill(self.pipeline, &report, &stamp);
        self.last = Some(report);
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
