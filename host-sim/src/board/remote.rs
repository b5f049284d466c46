//! A board in another process: requests out, answers in.

use super::in_process::local;
use super::process::{Emulator, Process, failed};
use super::{Board, BoardError, Frame, Options, Standing};
use crate::link::client::unexpected;
use crate::link::frames::State;
use crate::link::{Client, Failure, Transport};
use splash_firmware::calibration::Step;
use splash_firmware::centroid::Measurement;
use splash_firmware::controller::Command;
use splash_firmware::link::{Identity, Reason, Request, Response, Stack};
use splash_firmware::pipeline::{Report, Totals};
use splash_firmware::segments::Position;
use splash_firmware::slopes::Slope;
use splash_firmware::spec::Spec;
use std::io::{Read, Seek, SeekFrom};

/// The file of marks.
pub(super) const MARKS: &str = "marks";

/// A board in another process.
pub struct Remote {
    board: &'static str,
    client: Client<Process>,
    identity: Identity,
    /// Of the configuration.
    subapertures: usize,
    components: usize,
    ulp_m: f64,
    state: State,
    /// Bytes of the file of marks that were read.
    marks_read: u64,
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
        let mut here = local(spec, Options::default())?;
        // What its slopes are calibrated by is in the specification.
        here.set_calibrated(&Step::ALL, u16::MAX);
        let board = emulator.board;
        let mut client = Client::new(emulator.start(options.patience)?);
        let identity = client.identify().map_err(failed(board, "when it was asked what it is"))?;
        let loaded = client.load(&here.image()).map_err(failed(board, "when it was configured"))?;
        if let Err(reason) = loaded {
            return Err(BoardError::Unfit { board, reason });
        }
        let mut remote = Self {
            board,
            client,
            identity,
            subapertures: spec.mask.count(),
            components: here.components(),
            ulp_m: here.ulp_m(),
            state: State::default(),
            marks_read: 0,
        };
        remote.reset()?;
        Ok(remote)
    }

    /// What the board says it is.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }
}

impl Board for Remote {
    fn reset(&mut self) -> Result<(), BoardError> {
        let done = self.client.reset(self.subapertures);
        self.client.transport().show_log();
        self.state = done.map_err(failed(self.board, "when the loop was opened"))?;
        Ok(())
    }

    fn command(&mut self, command: Command) -> Result<(), BoardError> {
        let answer = self.client.ask(Request::Command(command)).and_then(|answer| match answer {
            Response::Ready => Ok(None),
            Response::Refused(reason) => Ok(Some(reason)),
            other => Err(unexpected(&other)),
        });
        match answer.map_err(failed(self.board, "when its mode was to change"))? {
            None => Ok(()),
            Some(Reason::Mode(refusal)) => Err(refusal.into()),
            Some(reason) => Err(BoardError::Unfit { board: self.board, reason }),
        }
    }

    fn standing(&mut self) -> Result<Standing, BoardError> {
        let mut ask = || {
            let mode = match self.client.ask(Request::Status)? {
                Response::Status(status) => status.mode,
                other => return Err(unexpected(&other)),
            };
            match self.client.ask(Request::Counters)? {
                Response::Counters(counters) => Ok(Standing { mode, faults: counters.faults }),
                other => Err(unexpected(&other)),
            }
        };
        ask().map_err(failed(self.board, "when it was asked for its mode and faults"))
    }

    fn frame(&mut self, number: u32, frame: Frame<'_>) -> Result<Report, BoardError> {
        let done = self.client.frame(number, frame, Some(self.subapertures), &mut self.state);
        self.client.transport().show_log();
        match done.map_err(|failure| failed(self.board, format!("frame {number}"))(failure))? {
            Ok(report) => Ok(report),
            Err(Reason::Row(source)) => Err(BoardError::Refused { frame: number, source }),
            Err(reason) => Err(BoardError::Unfit { board: self.board, reason }),
        }
    }

    fn codes(&self) -> &[[u16; 3]] {
        &self.state.codes
    }

    fn measurements(&self) -> &[Measurement] {
        self.state.measurements.get(..self.subapertures).unwrap_or_default()
    }

    fn second_measurements(&self) -> &[Measurement] {
        self.state.measurements.get(self.subapertures..).unwrap_or_default()
    }

    fn slopes(&self) -> &[Slope] {
        self.state.slopes.get(..self.subapertures).unwrap_or_default()
    }

    fn second_slopes(&self) -> &[Slope] {
        self.state.slopes.get(self.subapertures..).unwrap_or_default()
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
        let mut read = || {
            let mut file = std::fs::File::open(self.client.transport().directory().join(MARKS))?;
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
        let stack = self.client.ask(Request::Stack).and_then(|answer| match answer {
            Response::Stack(stack) => Ok(Some(stack)),
            other => Err(unexpected(&other)),
        });
        stack.map_err(failed(self.board, "when it was asked for its stack"))
    }
}
