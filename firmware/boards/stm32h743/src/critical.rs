//! Critical sections that leave the two interrupts alone: a line of the log is written in one, and takes
//! longer than the detector may be let wait.
#![allow(unsafe_code, reason = "the section that all of the program trusts in")]

use cortex_m::register::{basepri, basepri_max};
use critical_section::RawRestoreState;

/// Priority 0 is not masked; 1 to 15 are.
const MASK: u8 = 1 << 4;

struct BelowInterrupts;

critical_section::set_impl!(BelowInterrupts);

// SAFETY: all that takes a critical section runs at priority 1 to 15 or in the main loop: the two
// interrupts at priority 0 share nothing but queues of one producer and one consumer, and log nothing.
unsafe impl critical_section::Impl for BelowInterrupts {
    unsafe fn acquire() -> RawRestoreState {
        let before = basepri::read();
        basepri_max::write(MASK);
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::SeqCst);
        before
    }

    unsafe fn release(before: RawRestoreState) {
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::SeqCst);
        // SAFETY: it was so before the section.
        unsafe { basepri::write(before) };
    }
}
