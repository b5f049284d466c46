//! The server of the emulated boards, in a thread of this process.

use super::transport::{DetectorPort, Failure, Transport, wait};
use crate::board::capacity::smallest;
use crate::nor_flash::{Nor, PAGE};
use rustix::event::PollFlags;
use splash_firmware::banks::Banks;
use splash_firmware::config::Config;
use splash_firmware::link::{LIST, Stack};
use splash_firmware::spec::Spec;
use splash_firmware::telemetry::Ring;
use splash_server::{Port, controller, serve};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Rows that are handed over at once, as on the emulated boards.
const BLOCK: usize = 16;
/// Bytes of the flash's words.
const WORD: usize = 32;
/// Stack of the thread: the largest board is made on it before it is boxed.
const STACK: usize = 256 << 20;

/// The PC's end.
pub struct Threaded {
    /// `None` once the link was ended.
    link: UnixStream,
    detector: mpsc::Sender<Vec<u16>>,
    patience: Duration,
}

impl Threaded {
    /// Starts a server with the smallest capacities that hold the instrument. It ends with its link.
    ///
    /// # Errors
    /// The system's.
    pub fn start(spec: &Spec<'_>, patience: Duration) -> io::Result<Self> {
        let (link, board) = UnixStream::pair()?;
        link.set_nonblocking(true)?;
        let (detector, frames) = mpsc::channel();
        let port = Here {
            link: board,
            frames,
            frame: Vec::new(),
            read: 0,
            width: 1,
            flash: Nor::new(0, 0, true),
        };
        macro_rules! with {
            ($cells:literal, $pixels:literal, $modes:expr) => {
                // Of telemetry, what a frame leaves: itself, a fault, and four lists.
                run::<$cells, $pixels, $pixels, { $modes }, { 2 + 4 * ($cells / LIST) }>
            };
        }
        let run: fn(Here) = smallest!(spec, with);
        std::thread::Builder::new().stack_size(STACK).spawn(move || run(port))?;
        Ok(Self { link, detector, patience })
    }
}

/// Serves until the link ends.
fn run<const M: usize, const P: usize, const B: usize, const K: usize, const R: usize>(
    mut port: Here,
) {
    // A slot for the largest image: at most 5 bytes a window pixel, and less than 256 for each record of
    // a cell.
    let pages = (5 * P + 512 * M).div_ceil(PAGE) + 1;
    port.flash = Nor::new(2 * pages, 0, true);
    let [mut running, mut other] = [(); 2].map(|()| Box::new(Config::<M, P, B, K>::new()));
    let (mut control, mut telemetry) = (Box::new(controller()), Box::new(Ring::<R>::new()));
    let banks = Banks::new(&mut running, &mut other);
    // It ends in one way only: the other end of the link is gone.
    let _ = serve(&mut port, "host", banks, &mut control, &mut telemetry);
}

impl Transport for Threaded {
    fn patience(&self) -> Duration {
        self.patience
    }

    fn send(&mut self, mut bytes: &[u8], deadline: Instant) -> Result<(), Failure> {
        while !bytes.is_empty() {
            match self.link.write(bytes) {
                Ok(written) => bytes = bytes.get(written..).unwrap_or_default(),
                Err(error) => self.wait(error, PollFlags::OUT, deadline)?,
            }
        }
        Ok(())
    }

    fn receive(&mut self, bytes: &mut [u8], deadline: Instant) -> Result<usize, Failure> {
        loop {
            match self.link.read(bytes) {
                Ok(0) => return Err(Failure::Closed),
                Ok(read) => return Ok(read),
                Err(error) => self.wait(error, PollFlags::IN, deadline)?,
            }
        }
    }

    fn detector(&mut self) -> Option<&mut dyn DetectorPort> {
        Some(self)
    }
}

impl Threaded {
    fn wait(&self, error: io::Error, flags: PollFlags, deadline: Instant) -> Result<(), Failure> {
        match error.kind() {
            ErrorKind::Interrupted => Ok(()),
            ErrorKind::WouldBlock if Instant::now() >= deadline => {
                Err(Failure::Silent { patience: self.patience })
            }
            ErrorKind::WouldBlock => wait(&self.link, flags).map(|_| ()),
            _ => Err(error.into()),
        }
    }
}

impl DetectorPort for Threaded {
    fn pixels(&mut self, pixels: &[u16], _: Instant) -> Result<(), Failure> {
        self.detector.send(pixels.to_vec()).map_err(|_| Failure::Closed)
    }
}

/// The board's end.
struct Here {
    link: UnixStream,
    frames: mpsc::Receiver<Vec<u16>>,
    frame: Vec<u16>,
    /// Pixels of it that were read.
    read: usize,
    width: usize,
    flash: Nor<WORD>,
}

impl Port for Here {
    type Error = io::Error;
    type Flash = Nor<WORD>;

    fn receive(&mut self, bytes: &mut [u8]) -> io::Result<()> {
        self.link.read_exact(bytes)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.link.write_all(bytes)
    }

    fn expose(&mut self, _: usize, width: usize) -> io::Result<()> {
        self.frame = self.frames.recv().map_err(|_| io::Error::from(ErrorKind::UnexpectedEof))?;
        (self.read, self.width) = (0, width);
        Ok(())
    }

    fn rows(&mut self) -> io::Result<Option<&[u16]>> {
        let rest = self.frame.get(self.read..).unwrap_or_default();
        // A row that is cut short comes alone.
        let rows = match rest.len() / self.width {
            0 => rest.len(),
            rows => rows.min(BLOCK) * self.width,
        };
        self.read += rows;
        Ok(rest.get(..rows).filter(|rows| !rows.is_empty()))
    }

    fn actuate(&mut self, _: &[[u16; 3]]) -> io::Result<()> {
        Ok(())
    }

    fn stack(&self) -> Stack {
        Stack { used: 0, reserved: STACK as u32 }
    }

    fn flash(&mut self) -> Option<&mut Nor<WORD>> {
        Some(&mut self.flash)
    }

    fn mark() {}
}
