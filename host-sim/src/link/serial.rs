//! A serial line.

use super::transport::{Failure, Transport, wait};
use rustix::event::PollFlags;
use rustix::fs::OFlags;
use rustix::termios::{
    ControlModes, OptionalActions, QueueSelector, ioctl_tiocexcl, tcflush, tcgetattr, tcsetattr,
};
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

/// A serial line, eight bits, no parity, nothing added or taken away.
pub struct Serial {
    line: File,
    patience: Duration,
}

impl Serial {
    /// Opens `device` for this process alone. What came before is thrown away.
    ///
    /// # Errors
    /// The system's, for what cannot be opened, is no serial line, or has not this rate.
    pub fn open(device: &Path, baud: u32, patience: Duration) -> io::Result<Self> {
        // Without the second flag a line would become this process's terminal.
        let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits() as i32;
        let line = OpenOptions::new().read(true).write(true).custom_flags(flags).open(device)?;
        let mut settings = tcgetattr(&line)?;
        settings.make_raw();
        settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
        settings.set_speed(baud)?;
        tcsetattr(&line, OptionalActions::Now, &settings)?;
        ioctl_tiocexcl(&line)?;
        tcflush(&line, QueueSelector::IOFlush)?;
        Ok(Self { line, patience })
    }

    fn check(&self, deadline: Instant) -> Result<(), Failure> {
        if Instant::now() >= deadline {
            return Err(Failure::Silent { patience: self.patience });
        }
        Ok(())
    }
}

impl Transport for Serial {
    fn patience(&self) -> Duration {
        self.patience
    }

    fn send(&mut self, mut bytes: &[u8], deadline: Instant) -> Result<(), Failure> {
        while !bytes.is_empty() {
            match self.line.write(bytes) {
                Ok(written) => bytes = bytes.get(written..).unwrap_or_default(),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    wait(&self.line, PollFlags::OUT)?;
                    self.check(deadline)?;
                }
                Err(error) => return Err(hung_up(error)),
            }
        }
        Ok(())
    }

    fn receive(&mut self, bytes: &mut [u8], deadline: Instant) -> Result<usize, Failure> {
        loop {
            match self.line.read(bytes) {
                Ok(0) => return Err(Failure::Closed),
                Ok(read) => return Ok(read),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    self.check(deadline)?;
                    wait(&self.line, PollFlags::IN)?;
                }
                Err(error) => return Err(hung_up(error)),
            }
        }
    }

    fn is_noisy(&self) -> bool {
        true
    }
}

/// A line whose other end is gone gives this error (EIO).
fn hung_up(error: io::Error) -> Failure {
    if error.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error()) {
        Failure::Closed
    } else {
        error.into()
    }
}
