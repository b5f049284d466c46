//! Every end has an exit code, and a line in the log if it is a bad one.
#![allow(unsafe_code, reason = "cortex-m-rt asks for unsafe fault handlers")]

use cortex_m_rt::{ExceptionFrame, exception};

/// Exit code of the emulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// The link ended, or the program is done.
    Done = 0,
    /// An instrument was refused.
    Refused = 2,
    /// The link broke, or was never there.
    Link = 3,
    /// The processor met a fault, or an interrupt that nothing asked for.
    Fault = 4,
    /// The program panicked.
    Panic = 101,
}

/// Ends the program and the emulator.
pub fn exit(code: Exit) -> ! {
    semihosting::process::exit(code as i32)
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    defmt::error!("{}", defmt::Display2Format(info));
    exit(Exit::Panic)
}

// SAFETY: it logs and ends the program; nothing runs on after it.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    defmt::error!("hard fault at {=u32:#010x}, from {=u32:#010x}", frame.pc(), frame.lr());
    exit(Exit::Fault)
}

// SAFETY: as above.
#[exception]
unsafe fn DefaultHandler(interrupt: i16) {
    defmt::error!("unexpected interrupt {}", interrupt);
    exit(Exit::Fault)
}
