//! Requests, one after the other.

use crate::image::Pieces;
use crate::outbox::Outbox;
use crate::{Link, Port, parameters};
use splash_firmware::banks::{BankError, Banks};
use splash_firmware::centroid::Measurement;
use splash_firmware::controller::{Command, Controller, FrameResult, Start};
use splash_firmware::fault::Moment;
use splash_firmware::gate::GateStamp;
use splash_firmware::identity;
use splash_firmware::interlock::{Inputs, Times};
use splash_firmware::link::{
    Counters, Identity, Message, PIECE, Reason, Receiver, Request, Response, Status,
};
use splash_firmware::mirror::Serials;
use splash_firmware::mode::{Mode, Refusal};
use splash_firmware::pipeline::{Probe, Report, RowError, Stage};
use splash_firmware::strehl;
use splash_firmware::telemetry::{Cycles, Decimation, Ring, Stamp};

/// The clock of an emulated board is that of its frames: one tick a nanosecond.
const TICKS_PER_SECOND: u32 = 1_000_000_000;
/// What stands before an emulated mirror and laser lets them on, and they need no time.
pub const PERMITTED: Inputs = Inputs { laser_permit: true, high_voltage_ready: true };
const TIMES: Times = Times { settle_ticks: 0, fall_ticks: 0 };

/// The controller of an emulated board.
#[must_use]
pub const fn controller<const M: usize, const B: usize, const K: usize>() -> Controller<M, B, K> {
    Controller::new(Serials { mirror: 0, detector: 0 }, TIMES, TICKS_PER_SECOND)
}

/// Serves host-sim until a transfer fails, and returns why it did.
///
/// `board` is the board's name, at most 16 bytes. Configurations come over the link; before the first,
/// every frame is held. Frames go through the frame path by itself, as on a bench, until the first
/// [`Request::Command`] that is not about hardware; from it to the next [`Request::Reset`] or
/// [`Request::Load`] they go through the controller. In a frame there are marks before and after `begin`,
/// before and after each `push_rows` (the wait for the rows is outside), before `finish`, after each of
/// its stages and after its end; two in a row at the start tell what a mark itself costs. Telemetry is
/// sent behind the answers to a request.
pub fn serve<
    T: Port,
    const M: usize,
    const P: usize,
    const B: usize,
    const K: usize,
    const R: usize,
>(
    port: &mut T,
    board: &str,
    banks: Banks<'_, M, P, B, K>,
    controller: &mut Controller<M, B, K>,
    telemetry: &mut Ring<R>,
) -> T::Error {
    mark_twice::<T>();
    let mut server = Server {
        board,
        banks,
        controller,
        telemetry,
        measurements: heapless::Vec::new(),
        last: None,
        controlled: false,
        ticks: 0,
        wanted: None,
    };
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
pub fn identity<const M: usize, const P: usize, const B: usize, const K: usize>(
    board: &str,
) -> Identity {
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

struct Server<'a, const M: usize, const P: usize, const B: usize, const K: usize, const R: usize> {
    board: &'a str,
    banks: Banks<'a, M, P, B, K>,
    controller: &'a mut Controller<M, B, K>,
    telemetry: &'a mut Ring<R>,
    /// Of the measured frame to come.
    measurements: heapless::Vec<Measurement, M>,
    last: Option<FrameResult>,
    /// Frames go through the controller.
    controlled: bool,
    /// The clock, at the start of the last frame.
    ticks: u64,
    wanted: Option<Wanted>,
}

/// Raw pixels that were asked for.
struct Wanted {
    /// Number of the request.
    sequence: u16,
    row: usize,
    /// Column of the first.
    first: usize,
    /// Empty before the row has come.
    bytes: heapless::Vec<u8, PIECE>,
}

impl<const M: usize, const P: usize, const B: usize, const K: usize, const R: usize>
    Server<'_, M, P, B, K, R>
{
    /// Answers a request, and returns the one that interrupted it.
    fn answer<T: Port>(
        &mut self,
        port: &mut T,
        receiver: &mut Receiver,
        request: Message<Request>,
    ) -> crate::Left<T::Error> {
        let mut out = Outbox { port, sequence: request.sequence };
        match request.body {
            Request::Identify => {
                out.send(Response::Identity(identity::<M, P, B, K>(self.board)))?;
            }
            Request::Load { bytes } => {
                let mut pieces = Pieces::new(out.port, receiver, bytes);
                let loaded = self.load(&mut pieces, bytes);
                let interrupt = pieces.drain()?;
                out.send(done(loaded))?;
                return Ok(interrupt);
            }
            // One of an image that was given up.
            Request::Piece { .. } => {}
            Request::Reset => {
                self.open_on_the_bench();
                out.port.actuate(self.controller.codes())?;
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
                self.controller.set_global_tilt(tilt);
                out.send(Response::Ready)?;
            }
            Request::Stack => {
                let stack = out.port.stack();
                out.send(Response::Stack(stack))?;
            }
            Request::Command(command) => out.send(done(self.command(command)))?,
            Request::ReadBack { offset, bytes } => {
                parameters::read_back(self.banks.running(), &mut out, offset, bytes)?;
                out.send(Response::Ready)?;
            }
            Request::Copy => {
                let copied = self.banks.copy();
                let state = self.banks.draft.state();
                out.send(copied.map_or_else(refused, |()| Response::Draft(state)))?;
            }
            Request::Subscribe(decimation) => {
                self.telemetry.subscribe(decimation.unwrap_or_else(|| self.usual_streams()));
                out.send(self.streams())?;
            }
            Request::Streams => out.send(self.streams())?,
            Request::Status => out.send(Response::Status(self.status()))?,
            Request::Counters => out.send(Response::Counters(self.counters(receiver)))?,
            Request::Faults => {
                let last = self.controller.faults().last().copied();
                out.history(last, |first, items| Response::Faults { first, items })?;
                out.send(Response::Ready)?;
            }
            Request::Transitions => {
                let last = self.controller.modes().last().copied();
                out.history(last, |first, items| Response::Transitions { first, items })?;
                out.send(Response::Ready)?;
            }
            Request::Pixels { row, first } => {
                match parameters::find_pixel(self.banks.running(), row, first) {
                    Ok(()) => {
                        let (sequence, bytes) = (request.sequence, heapless::Vec::new());
                        let (row, first) = (row.into(), first.into());
                        self.wanted = Some(Wanted { sequence, row, first, bytes });
                    }
                    Err(reason) => out.send(Response::Refused(reason))?,
                }
            }
            other => {
                let answer = parameters::draft(&mut self.banks.draft, &other)
                    .or_else(|| parameters::running(self.banks.running(), &other))
                    .or_else(|| {
                        let serials = self.may_store().map(|()| self.controller.serials());
                        parameters::stored(out.port.flash(), &mut self.banks, &other, serials)
                    });
                out.send(answer.unwrap_or(Response::Refused(Reason::Unsupported)))?;
            }
        }
        Ok(None)
    }

    /// What an operator asks for: from now on frames go through the controller.
    fn command(&mut self, command: Command) -> Result<(), Refusal> {
        let config = self.banks.running();
        let calibrated = config.calibration().is_ok();
        // What hardware there is can be said while what runs does not fit it.
        if !self.controlled && !matches!(command, Command::Hardware(_)) {
            self.controller.exchange(config, config, calibrated)?;
            self.controlled = true;
        }
        self.controller.interlock(PERMITTED, self.ticks);
        let asked = self.controller.request(config, command, calibrated, self.ticks);
        self.controller.interlock(PERMITTED, self.ticks);
        asked
    }

    /// Opens the loop: frames go through the frame path alone.
    fn open_on_the_bench(&mut self) {
        let config = self.banks.running();
        if self.controlled {
            // Into safe leads a way from everywhere.
            let _ = self.controller.request(config, Command::Disarm, false, self.ticks);
            self.controlled = false;
        }
        self.controller.reset_bench(config);
        self.last = None;
    }

    /// Stores take longer than a frame: the loop must not need one.
    fn may_store(&self) -> Result<(), Reason> {
        match self.controller.mode() {
            Mode::Safe | Mode::Standby => Ok(()),
            mode => Err(Refusal::WrongMode { mode }.into()),
        }
    }

    /// An image from the link, to run at once.
    fn load<T: Link>(&mut self, pieces: &mut Pieces<'_, T>, length: u32) -> Result<(), BankError> {
        parameters::load(&mut self.banks.draft, pieces, length)?;
        self.banks.draft.switch()?;
        self.controlled = false;
        self.boundary();
        self.open_on_the_bench();
        Ok(())
    }

    /// Between two frames: the other bank runs, if that was ordered and the controller lets it.
    fn boundary(&mut self) {
        let (controller, controlled) = (&mut *self.controller, self.controlled);
        self.banks.frame_boundary(|before, next| {
            if controlled {
                return controller.exchange(before, next, next.calibration().is_ok());
            }
            if !next.continues(before) {
                controller.reset_bench(next);
            }
            Ok(())
        });
    }

    /// Sends the telemetry that there is.
    fn tell<T: Port>(&mut self, port: &mut T) -> Result<(), T::Error> {
        self.telemetry.tell(self.controller.faults());
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

    /// A pipe has no rate that is too low.
    fn usual_streams(&self) -> Decimation {
        let config = self.banks.running();
        Decimation::for_link(u32::MAX, self.frame_ns(), config.subapertures(), config.windows())
    }

    fn status(&self) -> Status {
        let pipeline = self.controller.pipeline();
        let valid = self.last.map_or(0, |last| last.report.valid);
        let squared = strehl::tilt_squared(pipeline.slopes());
        Status {
            build: identity::BUILD,
            configuration: self.banks.hash(),
            serials: self.controller.serials(),
            draft: self.banks.draft.state(),
            draft_refused: self.banks.refused(),
            mode: self.controller.mode(),
            outputs: self.controller.outputs(),
            at: self.last.map_or_else(Moment::default, |last| last.at),
            ticks_per_second: TICKS_PER_SECOND,
            gate: self.last.map_or_else(GateStamp::default, |last| last.gate),
            tilt_rms_nm: strehl::tilt_rms_nm(squared, valid, self.banks.running().ulp_m()),
        }
    }

    fn counters(&self, receiver: &Receiver) -> Counters {
        Counters {
            totals: self.controller.pipeline().totals(),
            faults: *self.controller.faults().counts(),
            refused_transitions: self.controller.modes().refused(),
            unreadable_messages: receiver.refused(),
        }
    }

    fn begin<T: Port>(&mut self, number: u32) {
        self.boundary();
        let config = self.banks.running();
        let pulses = config.timing().pulses_per_frame;
        self.ticks = self.ticks.wrapping_add(self.frame_ns());
        T::mark();
        if self.controlled {
            self.controller.begin(config, Start { number, pulses, ticks: self.ticks });
        } else {
            self.controller.bench().begin(config, number);
        }
        T::mark();
    }

    fn frame_ns(&self) -> u64 {
        self.banks.running().timing().frame_ns()
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
        let (mut read, mut start) = (Ok(()), 0);
        while let Some(rows) = port.rows()? {
            let count = rows.len().div_ceil(width) as u16;
            if let Some(Wanted { row, first, bytes, .. }) = &mut self.wanted
                && let Some(pixels) = parameters::raw_pixels((*row, *first), rows, start, width)
            {
                *bytes = pixels;
            }
            start += usize::from(count);
            if read.is_ok() {
                T::mark();
                let pushed = self.controller.push_rows(self.banks.running(), rows, count);
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
        let pushed = self.controller.push_measurements(self.banks.running(), measurements);
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
        let config = self.banks.running();
        let probe = &mut Marks::<T>(core::marker::PhantomData);
        T::mark();
        let result = if self.controlled {
            self.controller.finish(config, probe)
        } else {
            let report = self.controller.bench().finish_probed(config, probe);
            self.on_the_bench(report)
        };
        T::mark();
        out.port.actuate(self.controller.codes())?;
        if self.controlled {
            self.controller.interlock(PERMITTED, self.ticks);
        }
        let stamp = Stamp { configuration: self.banks.hash(), cycles: Cycles::default() };
        self.telemetry.fill(self.controller.pipeline(), &result, &stamp);
        self.last = Some(result);
        if let Some(Wanted { sequence, bytes, .. }) = self.wanted.take_if(|w| !w.bytes.is_empty()) {
            let frame = result.report.frame;
            Outbox { port: &mut *out.port, sequence }.send(Response::Pixels { frame, bytes })?;
        }
        self.state(out)?;
        let pipeline = self.controller.pipeline();
        let (measurements, slopes) = (pipeline.window_measurements(), pipeline.window_slopes());
        out.measured(measurements, slopes, pipeline.positions())?;
        out.send(Response::Report(result.report))
    }

    /// A frame of which no controller knows.
    fn on_the_bench(&self, report: Report) -> FrameResult {
        let at = Moment { frame: report.frame, ticks: self.ticks };
        let (mode, gate) = (self.controller.mode(), GateStamp::default());
        FrameResult { report, mode, rung: None, fault: None, gate, at }
    }

    fn state<T: Port>(&self, out: &mut Outbox<'_, T>) -> Result<(), T::Error> {
        let pipeline = self.controller.pipeline();
        out.state(pipeline.codes(), pipeline.totals())
    }
}

fn refused(error: impl Into<Reason>) -> Response {
    Response::Refused(error.into())
}

fn done<E: Into<Reason>>(result: Result<(), E>) -> Response {
    result.map_or_else(refused, |()| Response::Ready)
}
