//! What carries the link's bytes: no wait on it is without an end.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use splash_firmware::link::LinkError;
use std::io;
use std::os::fd::AsFd;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

/// How often a wait looks around.
const LOOK: Duration = Duration::from_millis(20);

/// What a board did in place of answering.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// It said nothing, or did not finish.
    #[error("no answer within {} s", patience.as_secs_f64())]
    Silent {
        /// How long it had.
        patience: Duration,
    },
    /// It said nothing that can be read.
    #[error("no answer within {} s, but {messages} messages that cannot be read", patience.as_secs_f64())]
    Noise {
        /// How long it had.
        patience: Duration,
        /// What came.
        messages: u32,
    },
    /// It ended.
    #[error("its program ended ({0})")]
    Ended(ExitStatus),
    /// It closed its end of the link and lives on.
    #[error("it closed the link")]
    Closed,
    /// What came is not a message.
    #[error("it sent a {0}")]
    Link(#[from] LinkError),
    /// It answered something else.
    #[error("it answered with {0}")]
    Answer(String),
    /// The link or a process failed here.
    #[error("{0}")]
    System(#[from] io::Error),
}

/// A way to a board and back.
pub trait Transport {
    /// The longest wait for an answer.
    fn patience(&self) -> Duration;

    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// [`Failure`], [`Failure::Silent`] if they are not taken before `deadline`.
    fn send(&mut self, bytes: &[u8], deadline: Instant) -> Result<(), Failure>;

    /// Takes what has come: at least one byte.
    ///
    /// # Errors
    /// [`Failure`], [`Failure::Silent`] if none has come before `deadline`.
    fn receive(&mut self, bytes: &mut [u8], deadline: Instant) -> Result<usize, Failure>;

    /// Puts pixels, row-major, on the detector port; `None` where frames come by themselves.
    fn detector(&mut self) -> Option<&mut dyn DetectorPort> {
        None
    }

    /// Whether bytes may be damaged on the way: then a message that cannot be read is passed over.
    fn is_noisy(&self) -> bool {
        false
    }

    /// Shows what the board has logged elsewhere.
    fn show_log(&mut self) {}
}

/// The detector port of a board whose frames come from here.
pub trait DetectorPort {
    /// Sends the pixels of a frame, row-major.
    ///
    /// # Errors
    /// [`Failure`].
    fn pixels(&mut self, pixels: &[u16], deadline: Instant) -> Result<(), Failure>;
}

impl<T: Transport + ?Sized> Transport for Box<T> {
    fn patience(&self) -> Duration {
        (**self).patience()
    }

    fn send(&mut self, bytes: &[u8], deadline: Instant) -> Result<(), Failure> {
        (**self).send(bytes, deadline)
    }

    fn receive(&mut self, bytes: &mut [u8], deadline: Instant) -> Result<usize, Failure> {
        (**self).receive(bytes, deadline)
    }

    fn detector(&mut self) -> Option<&mut dyn DetectorPort> {
        (**self).detector()
    }

    fn is_noisy(&self) -> bool {
        (**self).is_noisy()
    }

    fn show_log(&mut self) {
        (**self).show_log();
    }
}

/// Waits until a file is ready, or it is time to look around.
pub(crate) fn wait(file: impl AsFd, flags: PollFlags) -> Result<PollFlags, Failure> {
    let mut fds = [PollFd::new(&file, flags)];
    let look = Timespec { tv_sec: 0, tv_nsec: LOOK.subsec_nanos().into() };
    match poll(&mut fds, Some(&look)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(fds[0].revents()),
        Err(error) => Err(io::Error::from(error).into()),
    }
}
