//! The range gate: nanoseconds to ticks of the timer that the laser's sync starts.
//!
//! In one-pulse mode the output is low from the trigger to the compare value and high from there to
//! the end: delay = compare, width = end + 1 - compare. Both are rounded to the nearest tick, 25/6 ns, and
//! are off by at most 2.09 ns. The sync passes a synchroniser first: a constant delay of a few ticks, and
//! one tick of jitter, since laser and board have clocks of their own.

use crate::clocks::TIMER_HZ;
use core::fmt;
use splash_firmware::gate::GateTiming;

/// Values of the timer's registers: 32 bits, without prescaler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GateTicks {
    /// From the trigger to the opening, ticks: the compare register. At least 1.
    pub delay: u32,
    /// From the opening to the closing, ticks. At least 1.
    pub width: u32,
}

/// The timer cannot do it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum GateError {
    /// The delay is less than half a tick.
    Delay {
        /// What was asked for.
        ns: u32,
    },
    /// The width is less than half a tick.
    Width {
        /// What was asked for.
        ns: u32,
    },
}

impl fmt::Display for GateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Delay { ns } => write!(f, "gate delay of {ns} ns, must be at least 3 ns"),
            Self::Width { ns } => write!(f, "gate width of {ns} ns, must be at least 3 ns"),
        }
    }
}

impl core::error::Error for GateError {}

/// Nearest number of ticks, ties up.
const fn ticks(ns: u32) -> u64 {
    const SECOND_NS: u64 = 1_000_000_000;
    (ns as u64 * TIMER_HZ as u64 + SECOND_NS / 2) / SECOND_NS
}

impl GateTicks {
    /// Ticks of a timing. The opening and the closing are each rounded, so that no error adds up.
    ///
    /// # Errors
    /// [`GateError`] if delay or width is less than half a tick. There is no upper limit: 2^32 ns are
    /// 2^30 ticks.
    pub const fn new(timing: &GateTiming) -> Result<Self, GateError> {
        let GateTiming { delay_ns, width_ns, .. } = *timing;
        let (delay, width) = (ticks(delay_ns), ticks(width_ns));
        if delay == 0 {
            return Err(GateError::Delay { ns: delay_ns });
        }
        if width == 0 {
            return Err(GateError::Width { ns: width_ns });
        }
        // 2^32 ns are 1.03e9 ticks.
        Ok(Self { delay: delay as u32, width: width as u32 })
    }

    /// The auto-reload register: the last tick of the gate.
    #[must_use]
    pub const fn end(self) -> u32 {
        self.delay + (self.width - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timing(delay_ns: u32, width_ns: u32) -> GateTiming {
        GateTiming { delay_ns, width_ns, period_ns: 100_000, pulses_per_frame: 10 }
    }

    /// 12 km at 300 m of depth: 79.1 us and 2 us, at 240 ticks a microsecond.
    #[test]
    fn a_beacon_at_12_km() {
        let gate = GateTicks::new(&timing(79_055, 2_001)).expect("within range");
        assert_eq!((gate.delay, gate.width), (18_973, 480));
        assert_eq!(gate.end() + 1 - gate.delay, gate.width);
    }

    #[test]
    fn ticks_are_within_half_a_tick() {
        let tick_ns = 1e9 / 240e6;
        for ns in (3..5000).chain([600_000, 99_999_999, u32::MAX]) {
            let gate = GateTicks::new(&timing(ns, ns)).expect("within range");
            let error = f64::from(gate.delay) * tick_ns - f64::from(ns);
            assert!(error.abs() <= tick_ns / 2.0 + 1e-6, "{ns}: {error}");
            assert_eq!(gate.width, gate.delay);
            assert!(gate.end() >= gate.delay);
        }
    }

    #[test]
    fn what_is_less_than_half_a_tick_is_refused() {
        assert_eq!(GateTicks::new(&timing(2, 9)), Err(GateError::Delay { ns: 2 }));
        let error = GateTicks::new(&timing(9, 2)).expect_err("too short");
        assert_eq!(error.to_string(), "gate width of 2 ns, must be at least 3 ns");
    }
}
