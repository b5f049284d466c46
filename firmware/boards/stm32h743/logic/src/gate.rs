//! The range gate: a gate's ticks in the registers of the timer that the laser's sync starts.
//!
//! In one-pulse mode the output is low from the trigger to the compare value and high from there to
//! the end: delay = compare, width = end + 1 - compare. The sync passes a synchroniser first: a constant
//! delay of a few ticks, and one tick of jitter, since laser and board have clocks of their own. How
//! ticks follow from altitude and zenith angle is the library's.

use splash_firmware::gate::Ticks;

/// Values of the timer's registers: 32 bits, without prescaler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GateTimer {
    /// From the trigger to the opening, ticks: the compare register. At least 1.
    pub compare: u32,
    /// The auto-reload register: the last tick of the gate.
    pub reload: u32,
}

impl GateTimer {
    /// For a gate that was asked for; `None` before the first.
    #[must_use]
    pub const fn new(ticks: &Ticks) -> Option<Self> {
        let Ticks { delay, width, .. } = *ticks;
        if delay == 0 || width == 0 {
            return None;
        }
        // A gate ends within a pulse period, which the timer can count.
        Some(Self { compare: delay, reload: delay.saturating_add(width - 1) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clocks::TIMER_HZ;
    use splash_firmware::gate::{GateTiming, Range};

    /// 12 km at 300 m of depth, straight up: 79.0547 us and 2.00138 us, of which 240 ticks are one.
    #[test]
    fn a_beacon_at_12_km() {
        let timing =
            GateTiming { delay_ns: 0, width_ns: 0, period_ns: 100_000, pulses_per_frame: 10 };
        let range = Range { altitude_mm: 12_000_000, depth_mm: 300_000, zenith_mdeg: 0 };
        let ticks = range.ticks(&timing, TIMER_HZ).expect("fits");
        let timer = GateTimer::new(&ticks).expect("a gate");
        assert_eq!((timer.compare, timer.reload + 1 - timer.compare), (18_973, 480));
    }

    #[test]
    fn no_gate_is_shut() {
        assert_eq!(GateTimer::new(&Ticks::default()), None);
    }
}
