//! Whatever goes wrong takes both enables down, says so, and leaves the rest to the watchdog.
#![allow(unsafe_code, reason = "cortex-m-rt asks for unsafe fault handlers")]

use crate::enables;
use cortex_m_rt::{ExceptionFrame, exception};

/// Enables down, for good: the watchdog, if it runs, starts the board anew.
pub(crate) fn halt() -> ! {
    cortex_m::interrupt::disable();
    loop {
        enables::off();
    }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    enables::off();
    defmt::error!("{}", defmt::Display2Format(info));
    halt()
}

// SAFETY: it takes the enables down, logs and stays; nothing runs on after it.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    enables::off();
    defmt::error!("hard fault at {=u32:#010x}, from {=u32:#010x}", frame.pc(), frame.lr());
    halt()
}

// SAFETY: as above.
#[exception]
unsafe fn DefaultHandler(interrupt: i16) {
    enables::off();
    defmt::error!("unexpected interrupt {}", interrupt);
    halt()
}
