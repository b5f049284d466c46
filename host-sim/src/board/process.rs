//! A program that emulates a board, and the named pipes to it.
//!
//! In a temporary directory, which is the program's working directory:
//!
//! | pipe | carries |
//! |---|---|
//! | `link.in`, `link.out` | requests to the board, its answers |
//! | `detector` | pixels to the board, u16 little-endian, row after row |
//!
//! and two files, `log` (the program's standard output) and, if it was asked for, `marks`. No wait is
//! without an end: each transfer has a deadline, and the program's death ends it at once. The
//! program ends with this process: `guard.sh` sees to it.

use super::BoardError;
use super::log::{Format, Log};
use crate::link::transport::{DetectorPort, Failure, Transport, wait};
use rustix::event::PollFlags;
use rustix::fs::{CWD, Mode, OFlags, mkfifoat};
use std::ffi::OsString;
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// What a program gets to end by itself once its link has ended.
const FAREWELL: Duration = Duration::from_millis(500);

/// A program to be run as a board.
#[derive(Clone, Debug)]
pub struct Emulator {
    /// The board's name.
    pub board: &'static str,
    /// The program and its arguments.
    pub command: Vec<OsString>,
    /// What its standard output is.
    pub log: Format,
}

/// A running emulator.
pub struct Process {
    patience: Duration,
    guard: Child,
    /// `None` once the link was ended.
    link: Option<(File, File)>,
    answers: File,
    log: Log,
    directory: TempDir,
}

impl Emulator {
    /// Starts it.
    ///
    /// # Errors
    /// [`BoardError::Process`].
    pub fn start(&self, patience: Duration) -> Result<Process, BoardError> {
        Process::start(self, patience).map_err(failed(self.board, "when it was started"))
    }
}

impl Process {
    /// Makes the pipes and starts the program.
    fn start(emulator: &Emulator, patience: Duration) -> Result<Self, Failure> {
        let directory = tempfile::Builder::new().prefix("splash-").tempdir()?;
        let path = |name: &str| directory.path().join(name);
        for name in ["link.in", "link.out", "detector"] {
            mkfifoat(CWD, path(name), Mode::RUSR | Mode::WUSR).map_err(io::Error::from)?;
        }
        // Open before the program starts, so that no open waits for the other side: of what is
        // written, both ends; of what is read, one, to see its end.
        let open = |name: &str, write: bool| {
            let flags = OFlags::NONBLOCK.bits() as i32;
            OpenOptions::new().read(true).write(write).custom_flags(flags).open(path(name))
        };
        let link = (open("link.in", true)?, open("detector", true)?);
        let answers = open("link.out", false)?;
        let output = File::create(path("log"))?;
        let guard = Command::new("sh")
            .args(["-c", include_str!("guard.sh"), "guard"])
            .arg(directory.path())
            .args(&emulator.command)
            .current_dir(directory.path())
            .stdin(Stdio::piped())
            .stdout(output)
            .process_group(0)
            .spawn()?;
        let log = Log::new(emulator.board, path("log"), emulator.log.clone());
        Ok(Self { patience, guard, link: Some(link), answers, log, directory })
    }

    /// The program's working directory.
    pub(super) fn directory(&self) -> &Path {
        self.directory.path()
    }

    /// Writes all of `bytes`.
    fn write(
        &mut self,
        pipe: fn(&(File, File)) -> &File,
        mut bytes: &[u8],
        deadline: Instant,
    ) -> Result<(), Failure> {
        while !bytes.is_empty() {
            let mut file = pipe(self.link.as_ref().ok_or(Failure::Closed)?);
            match file.write(bytes) {
                Ok(written) => bytes = bytes.get(written..).unwrap_or_default(),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    wait(file, PollFlags::OUT)?;
                    self.check(deadline)?;
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    fn check(&mut self, deadline: Instant) -> Result<(), Failure> {
        match self.guard.try_wait()? {
            Some(status) => Err(Failure::Ended(status)),
            None if Instant::now() >= deadline => Err(Failure::Silent { patience: self.patience }),
            None => Ok(()),
        }
    }

    fn hung_up(&mut self) -> Failure {
        match self.ended(FAREWELL) {
            Some(status) => Failure::Ended(status),
            None => Failure::Closed,
        }
    }

    /// Waits so long for the program's end.
    fn ended(&mut self, patience: Duration) -> Option<ExitStatus> {
        let until = Instant::now() + patience;
        loop {
            let status = self.guard.try_wait().ok()?;
            if status.is_some() || Instant::now() >= until {
                return status;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

impl Transport for Process {
    fn patience(&self) -> Duration {
        self.patience
    }

    fn send(&mut self, bytes: &[u8], deadline: Instant) -> Result<(), Failure> {
        self.write(|(requests, _)| requests, bytes, deadline)
    }

    fn receive(&mut self, bytes: &mut [u8], deadline: Instant) -> Result<usize, Failure> {
        loop {
            // A pipe that nobody has opened yet would look like one that has ended.
            let ready = wait(&self.answers, PollFlags::IN)?;
            match self.answers.read(bytes) {
                Ok(0) if ready.contains(PollFlags::HUP) => return Err(self.hung_up()),
                Ok(0) => self.check(deadline)?,
                Ok(read) => return Ok(read),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => self.check(deadline)?,
                Err(error) => return Err(error.into()),
            }
        }
    }

    fn detector(&mut self) -> Option<&mut dyn DetectorPort> {
        Some(self)
    }

    fn show_log(&mut self) {
        self.log.show();
    }
}

impl DetectorPort for Process {
    fn pixels(&mut self, pixels: &[u16], deadline: Instant) -> Result<(), Failure> {
        let bytes: Vec<u8> = pixels.iter().flat_map(|pixel| pixel.to_le_bytes()).collect();
        self.write(|(_, detector)| detector, &bytes, deadline)
    }
}

impl Drop for Process {
    /// Ends the link, and if the program does not follow, the program.
    fn drop(&mut self) {
        self.link = None;
        let ended = self.ended(FAREWELL);
        self.log.show();
        drop(self.guard.stdin.take());
        if ended.is_none() && self.ended(FAREWELL).is_none() {
            // The guard itself was stopped. Nothing can be done about an error here.
            let _ = self.guard.kill();
            let _ = self.guard.wait();
        }
    }
}

/// Names the board and what it was asked.
pub(super) fn failed(
    board: &'static str,
    doing: impl Into<String>,
) -> impl FnOnce(Failure) -> BoardError {
    let doing = doing.into();
    move |source| BoardError::Process { board, doing, source }
}
