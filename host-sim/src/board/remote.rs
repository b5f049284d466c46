//! A board in another process: requests out, answers in.

use super::in_process::local;
use super::process::{Emulator, Failure, Pipe, Process, failed};
use super::{Board, BoardError, Frame, Options};
use splash_firmware::centroid::Measurement;
use splash_firmware::link::{
    self, Identity, LIST, List, Message, PIECE, Reason, Receiver, Request, Response, Stack,
};
use splash_firmware::pipeline::{Report, Totals};
use splash_firmware::segments::Position;
use splash_firmware::slopes::Slope;
use splash_firmware::spec::Spec;
use std::collections::VecDeque;
use std::io::{Read, Seek, SeekFrom};
use std::time::Instant;

/// Version of the firmware library, which this and every board are made with.
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// The file of marks.
pub(super) const MARKS: &str = "marks";

/// A board in another process.
pub struct Remote {
    board: &'static str,
    process: Process,
    receiver: Receiver,
    /// Bytes that came and were not looked at yet.
    inbox: VecDeque<u8>,
    sequence: u16,
    identity: Identity,
    /// Of the configuration.
    subapertures: usize,
    components: usize,
    ulp_m: f64,
    state: State,
    /// Bytes of the file of marks that were read.
    marks_read: u64,
}

/// What the board last said of itself.
#[derive(Default)]
struct State {
    codes: Vec<[u16; 3]>,
    measurements: Vec<Measurement>,
    slopes: Vec<Slope>,
    positions: Vec<Position>,
    totals: Totals,
}

impl Remote {
    /// Starts the emulator and loads the configuration.
    ///
    /// # Errors
    /// [`BoardError::Config`] for a specification that the library refuses, [`BoardError::Unfit`]
    /// for one that does not fit the board, [`BoardError::Process`].
    pub fn open(
        emulator: &Emulator,
        spec: &Spec<'_>,
        options: Options,
    ) -> Result<Self, BoardError> {
        let here = local(spec, Options::default())?;
        let board = emulator.board;
        let process = Process::start(emulator, options.patience)
            .map_err(failed(board, "when it was started"))?;
        let mut remote = Self {
            board,
            process,
            receiver: Receiver::new(),
            inbox: VecDeque::new(),
            sequence: 0,
            identity: Identity {
                board: heapless::String::new(),
                version: heapless::String::new(),
                cells: 0,
                pixels: 0,
                buffered: 0,
            },
            subapertures: spec.mask.count(),
            components: here.components(),
            ulp_m: here.ulp_m(),
            state: State::default(),
            marks_read: 0,
        };
        remote.identify().map_err(failed(board, "when it was asked what it is"))?;
        let loaded = remote.load(&here.image()).map_err(failed(board, "when it was configured"))?;
        if let Some(reason) = loaded {
            return Err(BoardError::Unfit { board, reason });
        }
        remote.reset()?;
        Ok(remote)
    }

    /// What the board says it is.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    fn identify(&mut self) -> Result<(), Failure> {
        let deadline = self.process.deadline();
        self.request(Request::Identify, deadline)?;
        match self.answer(deadline)? {
            Response::Identity(identity) if identity.version == VERSION => {
                self.identity = identity;
                Ok(())
            }
            Response::Identity(Identity { version, .. }) => Err(Failure::Answer(format!(
                "version {version} of the firmware: must be {VERSION}"
            ))),
            other => Err(unexpected(&other)),
        }
    }

    /// Loads an image, and returns why the board does not take it.
    fn load(&mut self, image: &[u8]) -> Result<Option<Reason>, Failure> {
        let deadline = self.process.deadline();
        let bytes = image.len() as u32;
        self.request(Request::Load { bytes }, deadline)?;
        for (i, piece) in image.chunks(PIECE).enumerate() {
            let offset = (i * PIECE) as u32;
            let bytes = piece.iter().copied().collect();
            self.send(Request::Piece { offset, bytes }, deadline)?;
        }
        match self.answer(deadline)? {
            Response::Ready => Ok(None),
            Response::Refused(reason) => Ok(Some(reason)),
            other => Err(unexpected(&other)),
        }
    }

    /// Flattens the mirror; what there was of measurements is gone.
    fn open_loop(&mut self) -> Result<(), Failure> {
        let deadline = self.process.deadline();
        self.request(Request::Reset, deadline)?;
        self.state = State::default();
        loop {
            match self.answer(deadline)? {
                Response::Ready => break,
                other => self.state.take(other)?,
            }
        }
        let count = self.subapertures;
        self.state.measurements.resize(count, Measurement::default());
        self.state.slopes.resize(count, Slope::default());
        self.state.positions.resize(count, Position::default());
        self.state.check(count)
    }

    /// Has a frame done.
    fn expose(&mut self, number: u32, frame: Frame<'_>) -> Result<Result<Report, Reason>, Failure> {
        let deadline = self.process.deadline();
        match frame {
            Frame::Pixels(pixels) => {
                let count = pixels.len() as u32;
                self.request(Request::Frame { number, pixels: count }, deadline)?;
                let bytes: Vec<u8> = pixels.iter().flat_map(|pixel| pixel.to_le_bytes()).collect();
                self.process.send(Pipe::Detector, &bytes, deadline)?;
            }
            Frame::Measurements(measurements) => {
                let count = measurements.len() as u32;
                self.sequence = self.sequence.wrapping_add(1).max(1);
                for (i, items) in measurements.chunks(LIST).enumerate() {
                    let first = (i * LIST) as u16;
                    let items = items.iter().copied().collect();
                    self.send(Request::Measurements { first, items }, deadline)?;
                }
                self.send(Request::MeasuredFrame { number, count }, deadline)?;
            }
        }
        let totals = self.state.totals;
        self.state = State { totals, ..State::default() };
        loop {
            match self.answer(deadline)? {
                Response::Refused(reason) => return Ok(Err(reason)),
                Response::Report(report) if report.frame == number => {
                    self.state.check(self.subapertures)?;
                    return Ok(Ok(report));
                }
                other => self.state.take(other)?,
            }
        }
    }

    /// Sends a request with a number of its own.
    fn request(&mut self, body: Request, deadline: Instant) -> Result<(), Failure> {
        self.sequence = self.sequence.wrapping_add(1).max(1);
        self.send(body, deadline)
    }

    fn send(&mut self, body: Request, deadline: Instant) -> Result<(), Failure> {
        let mut wire = [0; link::WIRE];
        let bytes = link::encode(&Message { sequence: self.sequence, body }, &mut wire)?;
        self.process.send(Pipe::Link, bytes, deadline)
    }

    /// The next answer to the last request.
    fn answer(&mut self, deadline: Instant) -> Result<Response, Failure> {
        loop {
            while let Some(byte) = self.inbox.pop_front() {
                match self.receiver.push::<Response>(byte).transpose()? {
                    Some(Message { sequence, body }) if sequence == self.sequence => {
                        return Ok(body);
                    }
                    // To a request that was given up.
                    Some(_) | None => {}
                }
            }
            let mut bytes = [0; 4096];
            let read = self.process.receive(&mut bytes, deadline)?;
            self.inbox.extend(bytes.iter().take(read));
        }
    }
}

impl State {
    /// Takes a piece of the state.
    fn take(&mut self, response: Response) -> Result<(), Failure> {
        match response {
            Response::Codes { first, items } => append("codes", &mut self.codes, first, &items),
            Response::Measurements { first, items } => {
                append("measurements", &mut self.measurements, first, &items)
            }
            Response::Slopes { first, items } => append("slopes", &mut self.slopes, first, &items),
            Response::Positions { first, items } => {
                append("positions", &mut self.positions, first, &items)
            }
            Response::Totals(totals) => {
                self.totals = totals;
                Ok(())
            }
            other => Err(unexpected(&other)),
        }
    }

    /// Whether all of it came.
    fn check(&self, subapertures: usize) -> Result<(), Failure> {
        let lists = [
            ("codes", self.codes.len()),
            ("measurements", self.measurements.len()),
            ("slopes", self.slopes.len()),
            ("positions", self.positions.len()),
        ];
        match lists.into_iter().find(|&(_, found)| found != subapertures) {
            Some((what, found)) => {
                Err(Failure::Answer(format!("{found} {what}: must be {subapertures}")))
            }
            None => Ok(()),
        }
    }
}

fn append<T: Copy>(
    what: &str,
    all: &mut Vec<T>,
    first: u16,
    items: &List<T>,
) -> Result<(), Failure> {
    if usize::from(first) != all.len() {
        let due = all.len();
        return Err(Failure::Answer(format!("{what} from {first} on: must be from {due}")));
    }
    all.extend_from_slice(items);
    Ok(())
}

/// A message that has no place here, by the name of its variant.
fn unexpected(response: &Response) -> Failure {
    let text = format!("{response:?}");
    let name = text.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
    Failure::Answer(format!("the message {name}, out of turn"))
}

impl Board for Remote {
    fn reset(&mut self) -> Result<(), BoardError> {
        let done = self.open_loop().map_err(failed(self.board, "when the loop was opened"));
        self.process.show_log();
        done
    }

    fn frame(&mut self, number: u32, frame: Frame<'_>) -> Result<Report, BoardError> {
        let done = self
            .expose(number, frame)
            .map_err(|failure| failed(self.board, format!("frame {number}"))(failure));
        self.process.show_log();
        match done? {
            Ok(report) => Ok(report),
            Err(Reason::Row(source)) => Err(BoardError::Refused { frame: number, source }),
            Err(reason) => Err(BoardError::Unfit { board: self.board, reason }),
        }
    }

    fn codes(&self) -> &[[u16; 3]] {
        &self.state.codes
    }

    fn measurements(&self) -> &[Measurement] {
        &self.state.measurements
    }

    fn slopes(&self) -> &[Slope] {
        &self.state.slopes
    }

    fn positions(&self) -> &[Position] {
        &self.state.positions
    }

    fn components(&self) -> usize {
        self.components
    }

    fn ulp_m(&self) -> f64 {
        self.ulp_m
    }

    fn totals(&self) -> Totals {
        self.state.totals
    }

    fn marks(&mut self) -> Result<Vec<u64>, BoardError> {
        let read = || {
            let mut file = std::fs::File::open(self.process.directory().join(MARKS))?;
            file.seek(SeekFrom::Start(self.marks_read))?;
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        let bytes = read().map_err(|error: std::io::Error| {
            failed(self.board, "when its marks were read")(Failure::System(error))
        })?;
        let (marks, _) = bytes.as_chunks();
        self.marks_read += 8 * marks.len() as u64;
        Ok(marks.iter().map(|&mark| u64::from_le_bytes(mark)).collect())
    }

    fn stack(&mut self) -> Result<Option<Stack>, BoardError> {
        let deadline = self.process.deadline();
        let asked = self.request(Request::Stack, deadline).and_then(|()| self.answer(deadline));
        let stack = asked.and_then(|answer| match answer {
            Response::Stack(stack) => Ok(Some(stack)),
            other => Err(unexpected(&other)),
        });
        stack.map_err(failed(self.board, "when it was asked for its stack"))
    }
}
