//! Whatever goes wrong takes the laser down, ramps the mirror to the flat map, takes the high voltage down,
//! keeps its last words and leaves the rest to the watchdog, which bounds all of it.
#![allow(unsafe_code, reason = "cortex-m-rt asks for unsafe fault handlers")]

use crate::{enables, interrupts, memory};
use core::fmt::Display;
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m_rt::{ExceptionFrame, exception};
use splash_firmware::last_words::Cause;

/// Enables down, for good: the watchdog, if it runs, starts the board anew.
pub(crate) fn halt() -> ! {
    cortex_m::interrupt::disable();
    loop {
        enables::off();
    }
}

/// The end of the program.
fn end(cause: Cause, place: [u32; 2], message: impl Display) -> ! {
    static ENDING: AtomicBool = AtomicBool::new(false);
    cortex_m::interrupt::disable();
    enables::laser_off();
    // What goes wrong in what follows is not tried again.
    if !ENDING.swap(true, Ordering::Relaxed) {
        // SAFETY: interrupts are masked, and nothing runs on after this; ENDING lets it happen once.
        unsafe {
            let (mode, at) = interrupts::emergency();
            enables::off();
            memory::last_words().say(cause, mode, at, place, message);
        }
    }
    halt()
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    end(Cause::Panic, [0; 2], info)
}

// SAFETY: it ends the program; nothing runs on after it.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    end(Cause::HardFault, [frame.pc(), frame.lr()], "hard fault")
}

// SAFETY: as above.
#[exception]
unsafe fn DefaultHandler(interrupt: i16) {
    end(Cause::Interrupt, [0; 2], format_args!("interrupt {interrupt}"))
}
