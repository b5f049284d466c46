//! The suite of named cases: lines on the console, to be compared with `tests/golden/suite.txt`.
#![no_std]
#![no_main]

use mps2_an500::{Exit, exit};
use semihosting::println;
use splash_suite::{BUFFER, MODES, PIXELS, WINDOWS, Workspace};
use static_cell::ConstStaticCell;

static WORKSPACE: ConstStaticCell<Workspace<WINDOWS, PIXELS, BUFFER, MODES>> =
    ConstStaticCell::new(Workspace::new());

#[cortex_m_rt::entry]
fn main() -> ! {
    match WORKSPACE.take().run(&mut |line| println!("{line}")) {
        Ok(()) => exit(Exit::Done),
        Err(error) => {
            println!("{error}");
            exit(Exit::Refused)
        }
    }
}
