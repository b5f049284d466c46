//! The processor's cycle counter (DWT).

use cortex_m::Peripherals;
use cortex_m::peripheral::DWT;
use stm32h743_logic::clocks::CORE_HZ;
use stm32h743_logic::frame_loop::Counter;

/// Cycles of the processor; they wrap after 8.9 s.
pub(crate) struct Cycles;

/// Starts it.
pub(crate) fn start(core: &mut Peripherals) {
    core.DCB.enable_trace();
    DWT::unlock();
    core.DWT.enable_cycle_counter();
}

/// Cycles of so many milliseconds, at most 8 s.
pub(crate) const fn milliseconds(ms: u32) -> u32 {
    CORE_HZ / 1000 * ms
}

impl Counter for Cycles {
    #[inline(always)]
    fn now(&self) -> u32 {
        DWT::cycle_count()
    }
}
