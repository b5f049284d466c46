//! A board that is an ordinary program: the server of the emulated boards on named pipes, as well
//! behaved as its argument says.
//!
//! | argument | does |
//! |---|---|
//! | `good` | serves until the link ends |
//! | `die AT` | ends with exit code 7 in place of the AT-th message |
//! | `hang AT` | sends nothing from the AT-th message on, and does not end with the link |
//! | `skip AT` | leaves the AT-th message out |
//! | `damage AT` | damages the AT-th message |
//! | `deaf` | opens its pipes, and reads none |

use splash_firmware::banks::Banks;
use splash_firmware::config::Config;
use splash_firmware::link::Stack;
use splash_firmware::telemetry::Ring;
use splash_server::{NoFlash, Port, controller, serve};
use splash_tests::with_big_stack;
use std::fs::{File, OpenOptions};
use std::io::{BufReader, Error, ErrorKind, Read, Write};

struct Pipes {
    requests: BufReader<File>,
    answers: File,
    detector: BufReader<File>,
    row: Vec<u16>,
    width: usize,
    left: usize,
    manner: String,
    /// The message that the manner is about.
    at: usize,
    sent: usize,
}

impl Port for Pipes {
    type Error = Error;
    type Flash = NoFlash;

    fn receive(&mut self, bytes: &mut [u8]) -> Result<(), Error> {
        self.requests.read_exact(bytes)
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.sent += 1;
        let late = self.sent >= self.at;
        match self.manner.as_str() {
            "die" if late => std::process::exit(7),
            "hang" if late => hang(),
            "skip" if self.sent == self.at => Ok(()),
            "damage" if self.sent == self.at => {
                let mut damaged = bytes.to_vec();
                damaged[2] ^= 0x40;
                self.answers.write_all(&damaged)
            }
            _ => self.answers.write_all(bytes),
        }
    }

    fn expose(&mut self, pixels: usize, width: usize) -> Result<(), Error> {
        (self.left, self.width) = (pixels, width);
        Ok(())
    }

    fn rows(&mut self) -> Result<Option<&[u16]>, Error> {
        let width = self.width.min(self.left);
        self.left -= width;
        self.row.clear();
        for _ in 0..width {
            let mut pixel = [0; 2];
            self.detector.read_exact(&mut pixel)?;
            self.row.push(u16::from_le_bytes(pixel));
        }
        Ok((width > 0).then_some(&self.row))
    }

    fn actuate(&mut self, _: &[[u16; 3]]) -> Result<(), Error> {
        Ok(())
    }

    fn stack(&self) -> Stack {
        Stack { used: 1000, reserved: 4000 }
    }

    fn mark() {}
}

fn hang() -> ! {
    loop {
        std::thread::park();
    }
}

fn main() -> std::process::ExitCode {
    let mut arguments = std::env::args().skip(1);
    let manner = arguments.next().unwrap_or_default();
    let at = arguments.next().and_then(|at| at.parse().ok()).unwrap_or(usize::MAX);
    println!("a board that is {manner}");
    let open = |name: &str| File::open(name).expect("a pipe");
    let requests = BufReader::new(open("link.in"));
    let answers = OpenOptions::new().write(true).open("link.out").expect("a pipe");
    let detector = BufReader::new(open("detector"));
    if manner == "deaf" {
        hang();
    }
    let (row, width, left, sent) = (Vec::new(), 0, 0, 0);
    let mut pipes = Pipes { requests, answers, detector, row, width, left, manner, at, sent };
    let ended = with_big_stack(move || {
        let [mut running, mut other] =
            [(); 2].map(|()| Box::new(Config::<256, 16_384, 2048>::new()));
        let (mut control, mut telemetry) = (Box::new(controller()), Box::new(Ring::<66>::new()));
        let banks = Banks::new(&mut running, &mut other);
        serve(&mut pipes, "pipe-board", banks, &mut control, &mut telemetry)
    });
    u8::from(ended.kind() != ErrorKind::UnexpectedEof).into()
}
