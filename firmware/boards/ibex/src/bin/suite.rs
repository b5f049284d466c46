//! The suite of named cases: lines on the console, to be compared with `tests/golden/suite.txt`.
#![no_std]
#![no_main]

use core::fmt::Write;
use ibex::{Console, Exit, Once, exit};
use splash_suite::{BUFFER, MODES, PIXELS, WINDOWS, Workspace};

static WORKSPACE: Once<Workspace<WINDOWS, PIXELS, BUFFER, MODES>> = Once::new(Workspace::new());

/// Where `start` goes.
// SAFETY: the name is that of the call in `start` and of nothing else.
#[allow(unsafe_code, reason = "an entry by its name")]
#[unsafe(no_mangle)]
extern "C" fn main() -> ! {
    let ran = WORKSPACE.take().map(|workspace| {
        workspace.run(&mut |line| {
            let _ = writeln!(Console, "{line}");
        })
    });
    match ran {
        Some(Ok(())) => exit(Exit::Done),
        Some(Err(error)) => {
            let _ = writeln!(Console, "{error}");
            exit(Exit::Refused)
        }
        None => exit(Exit::Refused),
    }
}
