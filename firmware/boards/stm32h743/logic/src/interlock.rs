//! When laser and high voltage are enabled: never before they are asked for, and not a moment longer
//! than both chains are closed.
//!
//! A chain that opens drops both enables, and they stay down until they are asked for again: nothing
//! comes back by itself. This is the firmware's part only. Whatever protects people is wired, and breaks
//! the same lines without a processor.

/// The chains, as they are read: closed or open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Chains {
    /// The laser's is closed.
    pub laser: bool,
    /// The high voltage's is closed.
    pub high_voltage: bool,
}

impl Chains {
    const fn closed(self) -> bool {
        self.laser && self.high_voltage
    }
}

/// What becomes of the enables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Both are as they were.
    Kept {
        /// Both are up.
        enabled: bool,
    },
    /// A chain has opened: both go down now.
    Tripped(Chains),
}

/// The state of the enables.
#[derive(Debug, Default)]
pub struct Interlock {
    enabled: bool,
}

impl Interlock {
    /// Both down.
    #[must_use]
    pub const fn new() -> Self {
        Self { enabled: false }
    }

    /// Asks for both enables.
    ///
    /// # Errors
    /// The chains, if one is open; both stay down.
    pub fn arm(&mut self, chains: Chains) -> Result<(), Chains> {
        self.enabled = chains.closed();
        if self.enabled { Ok(()) } else { Err(chains) }
    }

    /// Takes both enables down.
    pub fn disarm(&mut self) {
        self.enabled = false;
    }

    /// Looks at the chains.
    pub fn step(&mut self, chains: Chains) -> Step {
        if self.enabled && !chains.closed() {
            self.enabled = false;
            return Step::Tripped(chains);
        }
        Step::Kept { enabled: self.enabled }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLOSED: Chains = Chains { laser: true, high_voltage: true };
    const OPEN: [Chains; 3] = [
        Chains { laser: false, high_voltage: true },
        Chains { laser: true, high_voltage: false },
        Chains { laser: false, high_voltage: false },
    ];

    #[test]
    fn nothing_is_enabled_before_it_is_asked_for() {
        let mut interlock = Interlock::new();
        assert_eq!(interlock.step(CLOSED), Step::Kept { enabled: false });
        assert_eq!(interlock.arm(CLOSED), Ok(()));
        assert_eq!(interlock.step(CLOSED), Step::Kept { enabled: true });
    }

    #[test]
    fn an_open_chain_drops_both_until_they_are_asked_for_again() {
        for open in OPEN {
            let mut interlock = Interlock::new();
            interlock.arm(CLOSED).expect("closed");
            assert_eq!(interlock.step(open), Step::Tripped(open));
            assert_eq!(interlock.step(open), Step::Kept { enabled: false });
            assert_eq!(interlock.step(CLOSED), Step::Kept { enabled: false }, "not by itself");
            interlock.arm(CLOSED).expect("closed again");
            assert_eq!(interlock.step(CLOSED), Step::Kept { enabled: true });
        }
    }

    #[test]
    fn an_open_chain_cannot_be_armed_and_takes_down_what_is_up() {
        for open in OPEN {
            let mut interlock = Interlock::new();
            interlock.arm(CLOSED).expect("closed");
            assert_eq!(interlock.arm(open), Err(open));
            assert_eq!(interlock.step(CLOSED), Step::Kept { enabled: false });
        }
    }

    #[test]
    fn disarmed_is_down() {
        let mut interlock = Interlock::new();
        interlock.arm(CLOSED).expect("closed");
        interlock.disarm();
        assert_eq!(interlock.step(CLOSED), Step::Kept { enabled: false });
    }
}
