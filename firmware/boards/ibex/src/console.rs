//! The console, and the end of a program.

use crate::map::Register;
use core::fmt::{self, Write};

/// Characters for the outside.
#[derive(Clone, Copy, Debug, Default)]
pub struct Console;

impl Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.bytes().for_each(|byte| Register::CONSOLE.write(byte.into()));
        Ok(())
    }
}

/// Exit code of the simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// The link ended, or the program is done.
    Done = 0,
    /// The program was given what it refuses.
    Refused = 1,
    /// The core met a fault.
    Fault = 4,
    /// The program panicked.
    Panic = 101,
}

/// Ends the program and the simulation.
pub fn exit(code: Exit) -> ! {
    Register::DONE.write(code as u32);
    loop {
        core::hint::spin_loop();
    }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    let _ = writeln!(Console, "{info}");
    exit(Exit::Panic)
}
