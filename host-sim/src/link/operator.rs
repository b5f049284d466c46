//! What an operator does with a board, in physical units.
//!
//! An emulated board takes a frame where a board at a telescope would have had one: whatever waits for a
//! frame has it exposed in simulation ([`Frames::Here`]) or waits for the next one ([`Frames::There`]).

use super::client::{Client, unexpected};
use super::frames::{self, State};
use super::light::{Light, Scene};
use super::parameters::{self, Bound, Entry, Parameter, quantise};
use super::transport::{Failure, Transport};
use crate::board::Frame;
use crate::error::Error;
use splash_firmware::adjust::{Adjustment, Parameter as Asked};
use splash_firmware::banks::DraftState;
use splash_firmware::calibration::Calibration;
use splash_firmware::controller::Command;
use splash_firmware::fault::Record as FaultRecord;
use splash_firmware::fixed::{PISTON_LIMIT, TILT_LIMIT};
use splash_firmware::gate::Range;
use splash_firmware::image::Head;
use splash_firmware::link::{Counters, Identity, Reason, Request, Response, Status};
use splash_firmware::mirror::Serials;
use splash_firmware::mode::{Mode, Refusal, Transition};
use splash_firmware::segments::Position;
use splash_firmware::store::Stored;
use splash_firmware::telemetry::{Decimation, Dropped, Record};
use std::time::{Duration, Instant};

/// How often a board is asked whether its next frame has come.
const POLL: Duration = Duration::from_millis(2);
/// Frames in which a mirror surely gets to flat, at a slew limit of a hundredth of its stroke.
pub(crate) const RAMP_FRAMES: u32 = 1000;
/// A place in a list that is longer than any: the refusal says how many there are.
const BEYOND: u16 = u16::MAX;

/// Why an operator's order was not carried out.
#[derive(Debug, thiserror::Error)]
pub enum OperatorError {
    /// The board does not do what it should.
    #[error("board {board}: {source}, {doing}")]
    Failed {
        /// The board.
        board: &'static str,
        /// What it was asked.
        doing: &'static str,
        /// What it did.
        source: Failure,
    },
    /// The board refuses.
    #[error("board {board}: {reason}, {doing}")]
    Refused {
        /// The board.
        board: &'static str,
        /// What it was asked.
        doing: &'static str,
        /// Why it does not.
        reason: Reason,
    },
    /// There is no parameter of that name.
    #[error("parameter {0:?}: there is none of that name; see host-sim link get --help")]
    Unknown(String),
    /// The parameter has no index, or needs none.
    #[error("parameter {0}: there is one for the whole board, without an index")]
    NotIndexed(&'static str),
    /// A value cannot be.
    #[error("{name}{bound}")]
    Value {
        /// The parameter.
        name: String,
        /// Why not.
        bound: Bound,
    },
    /// No frame came.
    #[error("board {board}: no frame within {} s", patience.as_secs_f64())]
    NoFrame {
        /// The board.
        board: &'static str,
        /// How long it had.
        patience: Duration,
    },
    /// The simulated light, or whoever sees to the real one, fails.
    #[error("{0}")]
    Light(#[from] Error),
}

impl From<OperatorError> for Error {
    fn from(error: OperatorError) -> Self {
        match error {
            OperatorError::Light(error) => error,
            OperatorError::Unknown(_)
            | OperatorError::NotIndexed(_)
            | OperatorError::Value { .. }
            | OperatorError::Refused {
                reason:
                    Reason::Value { .. }
                    | Reason::Place { .. }
                    | Reason::Mode(Refusal::NoSubaperture { .. } | Refusal::Gate(_)),
                ..
            } => Self::Config(error.to_string()),
            other => Self::Run(other.to_string()),
        }
    }
}

/// Where frames come from.
pub enum Frames {
    /// From here, by simulation.
    Here(Box<dyn Scene>),
    /// From the board's detector; light is seen to by whoever this asks.
    There(Box<dyn FnMut(Light) -> Result<(), Error>>),
}

/// An operator of one board.
pub struct Operator {
    board: &'static str,
    client: Client<Box<dyn Transport>>,
    frames: Frames,
    /// Number of the next frame from here, and what the last one left.
    number: u32,
    state: State,
    pixels: Vec<u16>,
}

impl Operator {
    /// One of the board of that name behind `transport`.
    ///
    /// # Errors
    /// [`OperatorError::Failed`] if it is no board, or one of another version.
    pub fn new(
        board: &'static str,
        transport: Box<dyn Transport>,
        frames: Frames,
    ) -> Result<(Self, Identity), OperatorError> {
        let client = Client::new(transport);
        let (state, pixels) = (State::default(), Vec::new());
        let mut operator = Self { board, client, frames, number: 0, state, pixels };
        let identity = operator.client.identify();
        let identity = identity.map_err(|f| operator.failed("when it was asked what it is", f))?;
        Ok((operator, identity))
    }

    /// The board's name.
    pub fn board(&self) -> &'static str {
        self.board
    }

    /// Whether frames come from here.
    pub fn is_emulated(&self) -> bool {
        matches!(self.frames, Frames::Here(_))
    }

    fn failed(&self, doing: &'static str, source: Failure) -> OperatorError {
        OperatorError::Failed { board: self.board, doing, source }
    }

    fn ask(&mut self, doing: &'static str, request: Request) -> Result<Response, OperatorError> {
        let answer = self.client.ask(request);
        self.client.transport().show_log();
        self.not_refused(doing, answer)
    }

    fn not_refused(
        &self,
        doing: &'static str,
        answer: Result<Response, Failure>,
    ) -> Result<Response, OperatorError> {
        match answer.map_err(|failure| self.failed(doing, failure))? {
            Response::Refused(reason) => {
                Err(OperatorError::Refused { board: self.board, doing, reason })
            }
            response => Ok(response),
        }
    }

    fn out_of_turn<T>(&self, doing: &'static str, response: &Response) -> Result<T, OperatorError> {
        Err(self.failed(doing, unexpected(response)))
    }

    /// Asks what is answered in pieces and [`Response::Ready`]; `take` returns those that are no
    /// piece.
    fn ask_list(
        &mut self,
        doing: &'static str,
        request: Request,
        mut take: impl FnMut(Response) -> Option<Response>,
    ) -> Result<(), OperatorError> {
        let deadline = self.client.deadline();
        let asked = self.client.request(request, deadline);
        asked.map_err(|failure| self.failed(doing, failure))?;
        loop {
            // Each piece shows that the board lives.
            let deadline = self.client.deadline();
            let answer = self.client.answer(deadline);
            match self.not_refused(doing, answer)? {
                Response::Ready => return Ok(()),
                piece => {
                    if let Some(other) = take(piece) {
                        return self.out_of_turn(doing, &other);
                    }
                }
            }
        }
    }

    /// How the board is.
    ///
    /// # Errors
    /// [`OperatorError`], as of everything below.
    pub fn status(&mut self) -> Result<Status, OperatorError> {
        let doing = "when it was asked for its status";
        match self.ask(doing, Request::Status)? {
            Response::Status(status) => Ok(status),
            other => self.out_of_turn(doing, &other),
        }
    }

    /// What the board has counted.
    #[allow(missing_docs, reason = "errors as of Operator::status")]
    pub fn counters(&mut self) -> Result<Counters, OperatorError> {
        let doing = "when it was asked for its counters";
        match self.ask(doing, Request::Counters)? {
            Response::Counters(counters) => Ok(counters),
            other => self.out_of_turn(doing, &other),
        }
    }

    /// The last faults and the last transitions, oldest first.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn history(&mut self) -> Result<(Vec<FaultRecord>, Vec<Transition>), OperatorError> {
        let (mut faults, mut transitions) = (Vec::new(), Vec::new());
        let doing = "when it was asked for its history";
        self.ask_list(doing, Request::Faults, |piece| match piece {
            Response::Faults { items, .. } => {
                faults.extend(items);
                None
            }
            other => Some(other),
        })?;
        self.ask_list(doing, Request::Transitions, |piece| match piece {
            Response::Transitions { items, .. } => {
                transitions.extend(items);
                None
            }
            other => Some(other),
        })?;
        Ok((faults, transitions))
    }

    fn value(&mut self, asked: Asked) -> Result<Adjustment, OperatorError> {
        let doing = "when it was asked for a parameter";
        match self.ask(doing, Request::Get(asked))? {
            Response::Value(value) => Ok(value),
            other => self.out_of_turn(doing, &other),
        }
    }

    /// What the running configuration has once.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn head(&mut self) -> Result<Head, OperatorError> {
        match self.value(Asked::Head)? {
            Adjustment::Head(head) => Ok(head),
            other => self.out_of_turn("when it was asked for a parameter", &Response::Value(other)),
        }
    }

    /// What the running configuration has for a subaperture in the place that `parameter` is in.
    fn entry(&mut self, parameter: &Parameter, index: u16) -> Result<Entry, OperatorError> {
        match self.value(parameter.entry(index))? {
            Adjustment::Subaperture { entry, .. } => Ok(Entry::Subaperture(entry)),
            Adjustment::SecondGate { entry, .. } => Ok(Entry::SecondGate(entry)),
            other => self.out_of_turn("when it was asked for a parameter", &Response::Value(other)),
        }
    }

    /// How many subapertures the running configuration has.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn subapertures(&mut self) -> Result<usize, OperatorError> {
        self.entries(Asked::Subaperture { index: BEYOND })
    }

    /// How many windows it has: with a second gate two a subaperture.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn windows(&mut self) -> Result<usize, OperatorError> {
        Ok(self.subapertures()? + self.entries(Asked::SecondGate { index: BEYOND })?)
    }

    /// How many there are of what this asks for one beyond.
    fn entries(&mut self, beyond: Asked) -> Result<usize, OperatorError> {
        match self.value(beyond) {
            Err(OperatorError::Refused { reason: Reason::Place { entries, .. }, .. }) => {
                Ok(entries as usize)
            }
            Err(error) => Err(error),
            Ok(value) => {
                let doing = "when it was asked how many subapertures it has";
                self.out_of_turn(doing, &Response::Value(value))
            }
        }
    }

    /// The values of a parameter: of one subaperture, or of all.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn get(
        &mut self,
        name: &str,
        index: Option<u16>,
    ) -> Result<(&'static Parameter, Vec<Vec<f64>>), OperatorError> {
        let parameter = find(name, index)?;
        let head = self.head()?;
        let refused = |bound| OperatorError::Value { name: name.into(), bound };
        if !parameter.is_indexed() {
            return Ok((parameter, vec![parameter.read(&head, None).map_err(refused)?]));
        }
        let mut all = Vec::new();
        for index in self.places(parameter, index)? {
            let entry = self.entry(parameter, index)?;
            all.push(parameter.read(&head, Some(&entry)).map_err(refused)?);
        }
        Ok((parameter, all))
    }

    /// The subapertures of which a parameter is asked for; an error where there is none at all.
    fn places(
        &mut self,
        parameter: &Parameter,
        index: Option<u16>,
    ) -> Result<std::ops::Range<u16>, OperatorError> {
        match (self.entries(parameter.entry(BEYOND))? as u16, index) {
            (0, _) => {
                let name = parameter.name.into();
                Err(OperatorError::Value { name, bound: Bound::Absent })
            }
            // A subaperture that there is not is refused by the board.
            (_, Some(index)) => Ok(index..index.saturating_add(1)),
            (entries, None) => Ok(0..entries),
        }
    }

    /// Sets a parameter: of one subaperture, or of all. It runs from the next frame on, all at once.
    ///
    /// # Errors
    /// [`OperatorError`]; then the board runs what it ran.
    pub fn set(
        &mut self,
        name: &str,
        values: &[f64],
        index: Option<u16>,
    ) -> Result<u32, OperatorError> {
        let parameter = find(name, index)?;
        let mut head = self.head()?;
        let refused = |place: Option<u16>| {
            let place = place.map(|place| format!("[{place}]")).unwrap_or_default();
            move |bound| OperatorError::Value { name: format!("{name}{place}"), bound }
        };
        let mut adjustments = Vec::new();
        if parameter.is_indexed() {
            for index in self.places(parameter, index)? {
                let mut entry = self.entry(parameter, index)?;
                let written = parameter.write_entry(&head, &mut entry, values);
                written.map_err(refused(Some(index)))?;
                adjustments.push(entry.adjustment(index));
            }
        } else {
            parameter.write_head(&mut head, values).map_err(refused(None))?;
            adjustments.push(Adjustment::Head(head));
        }
        self.adjust(adjustments)
    }

    /// Changes what runs, from the next frame on, all at once.
    ///
    /// # Errors
    /// [`OperatorError`]; then the board runs what it ran.
    pub fn adjust(&mut self, adjustments: Vec<Adjustment>) -> Result<u32, OperatorError> {
        let doing = "when its configuration was changed";
        self.ask(doing, Request::Copy)?;
        let requests = adjustments.into_iter().map(Request::Adjust);
        self.draft(doing, requests.collect(), &mut |_| ())?;
        self.switch()
    }

    /// Loads an image into the other bank and has it run from the next frame on. `progress` is told
    /// the fraction done.
    ///
    /// # Errors
    /// [`OperatorError`]; then the board runs what it ran.
    pub fn upload(
        &mut self,
        image: &[u8],
        progress: &mut dyn FnMut(f64),
    ) -> Result<u32, OperatorError> {
        let doing = "when an image was uploaded";
        self.draft(doing, frames::upload(image).collect(), progress)?;
        self.switch()
    }

    /// Loads an image into an emulated board at its start, with the mirror flat.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn start(&mut self, image: &[u8], subapertures: usize) -> Result<(), OperatorError> {
        let doing = "when it was configured";
        let loaded = self.client.load(image).map_err(|failure| self.failed(doing, failure))?;
        loaded.map_err(|reason| OperatorError::Refused { board: self.board, doing, reason })?;
        let state = self.client.reset(subapertures);
        self.state = state.map_err(|failure| self.failed(doing, failure))?;
        Ok(())
    }

    /// Does these things to the other bank; where one is refused, it is given up.
    fn draft(
        &mut self,
        doing: &'static str,
        requests: Vec<Request>,
        progress: &mut dyn FnMut(f64),
    ) -> Result<(), OperatorError> {
        let count = requests.len() as f64;
        for (i, request) in requests.into_iter().chain([Request::Check]).enumerate() {
            progress(i as f64 / count);
            if let Err(error) = self.ask(doing, request) {
                if matches!(error, OperatorError::Refused { .. }) {
                    // The refusal is what counts.
                    let _ = self.ask(doing, Request::Discard);
                }
                return Err(error);
            }
        }
        Ok(())
    }

    /// Has what is in the other bank run, waits until it does, and returns its hash.
    fn switch(&mut self) -> Result<u32, OperatorError> {
        let doing = "when the other bank was to run";
        let hash = match self.ask(doing, Request::Switch)? {
            Response::Draft(DraftState::Ordered { hash }) => hash,
            other => return self.out_of_turn(doing, &other),
        };
        let deadline = self.client.deadline();
        loop {
            self.wait_for_frames(1)?;
            let status = self.status()?;
            if let Some(refusal) = status.draft_refused {
                self.ask(doing, Request::Discard)?;
                let reason = Reason::Mode(refusal);
                return Err(OperatorError::Refused { board: self.board, doing, reason });
            }
            if status.configuration == hash {
                return Ok(hash);
            }
            if Instant::now() >= deadline {
                let patience = self.client.transport().patience();
                return Err(self.failed("before it did", Failure::Silent { patience }));
            }
        }
    }

    /// The image of what runs.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn read_back(&mut self) -> Result<Vec<u8>, OperatorError> {
        let doing = "when its image was read back";
        let (mut image, mut lost) = (Vec::new(), None);
        let request = Request::ReadBack { offset: 0, bytes: u32::MAX };
        self.ask_list(doing, request, |piece| match piece {
            Response::Image { offset, bytes } => {
                if offset as usize != image.len() {
                    lost.get_or_insert((offset, image.len()));
                }
                image.extend(bytes);
                None
            }
            other => Some(other),
        })?;
        match lost {
            Some((offset, due)) => {
                let what = format!("an image from byte {offset} on: must be from {due}");
                Err(self.failed(doing, Failure::Answer(what)))
            }
            None => Ok(image),
        }
    }

    /// Stores what runs in the board's flash.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn store(&mut self) -> Result<Option<Stored>, OperatorError> {
        self.flash("when its configuration was to be stored", Request::Store)
    }

    /// What is stored in the board's flash.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn stored(&mut self) -> Result<Option<Stored>, OperatorError> {
        self.flash("when it was asked what is stored", Request::Stored)
    }

    fn flash(
        &mut self,
        doing: &'static str,
        request: Request,
    ) -> Result<Option<Stored>, OperatorError> {
        match self.ask(doing, request)? {
            Response::Stored(stored) => Ok(stored),
            other => self.out_of_turn(doing, &other),
        }
    }

    /// Has what is stored run from the next frame on.
    ///
    /// # Errors
    /// [`OperatorError`]; then the board runs what it ran.
    pub fn restore(&mut self) -> Result<u32, OperatorError> {
        self.draft("when what is stored was to be loaded", vec![Request::Restore], &mut |_| ())?;
        self.switch()
    }

    /// The calibration of what runs.
    ///
    /// # Errors
    /// [`OperatorError`]: what is missing.
    pub fn calibration(&mut self) -> Result<Calibration, OperatorError> {
        let doing = "when it was asked for its calibration";
        match self.ask(doing, Request::Calibration)? {
            Response::Calibration(calibration) => Ok(calibration),
            other => self.out_of_turn(doing, &other),
        }
    }

    /// Gives the board a command.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn command(&mut self, doing: &'static str, command: Command) -> Result<(), OperatorError> {
        match self.ask(doing, Request::Command(command))? {
            Response::Ready => Ok(()),
            other => self.out_of_turn(doing, &other),
        }
    }

    /// Another mode.
    ///
    /// # Errors
    /// [`OperatorError`]; a refusal to close the loop says what its calibration lacks.
    pub fn enter(&mut self, mode: Mode) -> Result<(), OperatorError> {
        let entered = self.command("when its mode was to change", Command::Enter(mode));
        match entered {
            Err(OperatorError::Refused {
                reason: Reason::Mode(Refusal::NotCalibrated), ..
            }) => {
                // It says more than that.
                self.calibration()?;
                entered
            }
            other => other,
        }
    }

    /// High voltage, then the laser; waits until both are on.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn arm(&mut self) -> Result<(), OperatorError> {
        self.command("when it was to be armed", Command::Arm)?;
        let deadline = self.client.deadline();
        while !self.status()?.outputs.laser {
            self.wait_for_frames(1)?;
            if Instant::now() >= deadline {
                let patience = self.client.transport().patience();
                return Err(self.failed("before its laser was on", Failure::Silent { patience }));
            }
        }
        Ok(())
    }

    /// Safe, laser and high voltage off.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn disarm(&mut self) -> Result<(), OperatorError> {
        self.command("when it was to be disarmed", Command::Disarm)
    }

    /// A segment to a piston, tip and tilt, m of optical path; the last two from centre to edge.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn poke(&mut self, subaperture: u16, position_m: [f64; 3]) -> Result<(), OperatorError> {
        let per_m = 1.0 / parameters::ulp_m(&self.head()?);
        let ulp = |name: &str, value, limit: i32| {
            let limits = [-f64::from(limit), f64::from(limit)];
            let rounded = quantise(value, per_m, limits);
            rounded
                .map(|ulp| ulp as i32)
                .map_err(|bound| OperatorError::Value { name: name.into(), bound })
        };
        let [piston, tip, tilt] = position_m;
        let position = Position {
            piston_ulp: ulp("poke.piston_m", piston, PISTON_LIMIT)?,
            tilt_ulp: [ulp("poke.tip_m", tip, TILT_LIMIT)?, ulp("poke.tilt_m", tilt, TILT_LIMIT)?],
        };
        let command = Command::Position { subaperture, position };
        self.command("when a segment was to be poked", command)
    }

    /// Which mirror and detector the board has.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn state_hardware(&mut self, serials: Serials) -> Result<(), OperatorError> {
        self.command("when its hardware was stated", Command::Hardware(serials))
    }

    /// Another range: altitude and depth of the gate, m, and zenith angle, degrees.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn gate(&mut self, [altitude, depth, zenith]: [f64; 3]) -> Result<(), OperatorError> {
        let thousandths = |name: &str, value| {
            let rounded = quantise(value, 1e3, [0.0, f64::from(u32::MAX)]);
            rounded
                .map(|value| value as u32)
                .map_err(|bound| OperatorError::Value { name: name.into(), bound })
        };
        let range = Range {
            altitude_mm: thousandths("gate.beacon_height_m", altitude)?,
            depth_mm: thousandths("gate.depth_m", depth)?,
            zenith_mdeg: thousandths("gate.zenith_angle_deg", zenith)?,
        };
        self.command("when its gate was to change", Command::Gate(range))
    }

    /// This light on the detector, from the next frame on.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn set_light(&mut self, light: Light) -> Result<(), OperatorError> {
        match &mut self.frames {
            Frames::Here(scene) => scene.set_light(light)?,
            Frames::There(ask) => ask(light)?,
        }
        Ok(())
    }

    /// Waits until the board has had so many frames more.
    ///
    /// # Errors
    /// [`OperatorError`], [`OperatorError::NoFrame`].
    pub fn wait_for_frames(&mut self, frames: u32) -> Result<(), OperatorError> {
        if self.is_emulated() {
            for _ in 0..frames {
                self.expose()?;
            }
            return Ok(());
        }
        let first = self.status()?.at.frame;
        let (mut last, mut deadline) = (first, self.client.deadline());
        loop {
            let frame = self.status()?.at.frame;
            if frame.wrapping_sub(first) >= frames {
                return Ok(());
            }
            if frame != last {
                (last, deadline) = (frame, self.client.deadline());
            } else if Instant::now() >= deadline {
                let patience = self.client.transport().patience();
                return Err(OperatorError::NoFrame { board: self.board, patience });
            }
            std::thread::sleep(POLL);
        }
    }

    /// Exposes a frame here and has the board do it; its pixels.
    fn expose(&mut self) -> Result<&[u16], OperatorError> {
        let Self { board, client, frames, number, state, pixels } = self;
        let board = *board;
        if let Frames::Here(scene) = frames {
            let exposed = scene.expose(&state.codes)?;
            pixels.clear();
            pixels.extend_from_slice(exposed);
            let done = client.frame(*number, Frame::Pixels(pixels), None, state);
            let doing = "when it was given a frame";
            let done = done.map_err(|source| OperatorError::Failed { board, doing, source })?;
            done.map_err(|reason| OperatorError::Refused { board, doing, reason })?;
            *number = number.wrapping_add(1);
        }
        Ok(&self.pixels)
    }

    /// Hands the raw pixels of so many frames to `take`, `[width, height]` of the detector. Where frames do
    /// not come from here, each row is of a frame of its own.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn raw_frames(
        &mut self,
        frames: u32,
        [width, height]: [usize; 2],
        take: &mut dyn FnMut(&[u16]),
    ) -> Result<(), OperatorError> {
        for _ in 0..frames {
            if self.is_emulated() {
                take(self.expose()?);
                continue;
            }
            let mut pixels = Vec::with_capacity(width * height);
            for row in 0..height {
                let end = (row + 1) * width;
                while pixels.len() < end {
                    let first = (pixels.len() % width) as u16;
                    pixels.extend(self.raw_pixels(row as u16, first)?);
                }
                pixels.truncate(end);
            }
            take(&pixels);
        }
        Ok(())
    }

    /// Raw pixels of a row of the next frame, at least one.
    fn raw_pixels(&mut self, row: u16, first: u16) -> Result<Vec<u16>, OperatorError> {
        let doing = "when it was asked for raw pixels";
        match self.ask(doing, Request::Pixels { row, first })? {
            Response::Pixels { bytes, .. } if bytes.len() >= 2 => {
                let (pixels, _) = bytes.as_chunks();
                Ok(pixels.iter().map(|&pixel| u16::from_le_bytes(pixel)).collect())
            }
            other => self.out_of_turn(doing, &other),
        }
    }

    /// Asks for telemetry; `None`: as much as suits the link.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn subscribe(
        &mut self,
        decimation: Option<Decimation>,
    ) -> Result<Decimation, OperatorError> {
        let streams = self.streams(Request::Subscribe(decimation))?.0;
        // What came for the one before.
        self.client.told().for_each(drop);
        Ok(streams)
    }

    /// What was dropped of each stream since the subscription.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn dropped(&mut self) -> Result<Dropped, OperatorError> {
        Ok(self.streams(Request::Streams)?.1)
    }

    fn streams(&mut self, request: Request) -> Result<(Decimation, Dropped), OperatorError> {
        let doing = "when it was asked for telemetry";
        match self.ask(doing, request)? {
            Response::Streams { decimation, dropped } => Ok((decimation, dropped)),
            other => self.out_of_turn(doing, &other),
        }
    }

    /// The telemetry that has come, oldest first: with frames from here, of one frame more; from a board
    /// with frames of its own, at least a record.
    ///
    /// # Errors
    /// [`OperatorError`].
    pub fn listen(&mut self) -> Result<Vec<Record>, OperatorError> {
        self.expose()?;
        let mut records = Vec::new();
        if !self.is_emulated() {
            let deadline = self.client.deadline();
            let doing = "when its telemetry was waited for";
            records.push(self.client.telemetry(deadline).map_err(|f| self.failed(doing, f))?);
        }
        // What a board has to tell stands before its answer.
        self.streams(Request::Streams)?;
        records.extend(self.client.told());
        Ok(records)
    }
}

/// The parameter of that name, which takes an index if one is given.
fn find(name: &str, index: Option<u16>) -> Result<&'static Parameter, OperatorError> {
    let parameter = parameters::find(name).ok_or_else(|| OperatorError::Unknown(name.into()))?;
    if index.is_some() && !parameter.is_indexed() {
        return Err(OperatorError::NotIndexed(parameter.name));
    }
    Ok(parameter)
}
