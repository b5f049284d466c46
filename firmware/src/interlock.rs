//! Interlock: when high voltage and laser are enabled, in which order they come and go.
//!
//! ```text
//! down --arm--> rising --settled--> up
//!  ^              |                  |   permit lost, or disarmed: the laser goes at once
//!  |              v                  v
//!  +---flat, or too late---------- falling
//! ```
//!
//! | state | high voltage | laser |
//! |---|---|---|
//! | down | off | off |
//! | rising | on | off |
//! | up | on | on |
//! | falling | on, so that the mirror can ramp to the flat map | off |
//!
//! High voltage that is not ready takes everything down at once, whatever the state. Nothing comes back
//! by itself: after any loss it must be armed again. This is the firmware's part only: whatever protects
//! people is wired, and breaks the same lines without a processor.

use serde::{Deserialize, Serialize};

/// The inputs, as they are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Inputs {
    /// The laser may be on.
    pub laser_permit: bool,
    /// The high voltage may be on, and its supply is well.
    pub high_voltage_ready: bool,
}

/// The outputs, as they must be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Outputs {
    /// The high voltage is enabled.
    pub high_voltage: bool,
    /// The laser is enabled.
    pub laser: bool,
}

/// What was lost in a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lost {
    /// The laser's permit, while the laser was on or on its way.
    pub laser_permit: bool,
    /// The high voltage's readiness, while it was on.
    pub high_voltage: bool,
}

/// How long things take, ticks of the board's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Times {
    /// From the high voltage's enable to the laser's.
    pub settle_ticks: u64,
    /// The longest that the high voltage stays for the mirror to become flat.
    pub fall_ticks: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
enum State {
    #[default]
    Down,
    Rising {
        since: u64,
    },
    Up,
    Falling {
        since: u64,
    },
}

/// The state of the enables.
#[derive(Clone, Copy, Debug, Default)]
pub struct Interlock {
    state: State,
    times: Times,
}

impl Interlock {
    /// Everything off.
    #[must_use]
    pub const fn new(times: Times) -> Self {
        Self { state: State::Down, times }
    }

    /// Asks for both enables. What is up, or on its way up, goes on as it is.
    ///
    /// # Errors
    /// The inputs, if one is missing; nothing changes.
    pub fn arm(&mut self, inputs: Inputs, now: u64) -> Result<(), Inputs> {
        if !(inputs.laser_permit && inputs.high_voltage_ready) {
            return Err(inputs);
        }
        if matches!(self.state, State::Down | State::Falling { .. }) {
            self.state = State::Rising { since: now };
        }
        Ok(())
    }

    /// The laser goes now, the high voltage when the mirror is flat.
    pub fn disarm(&mut self, now: u64) {
        if matches!(self.state, State::Rising { .. } | State::Up) {
            self.state = State::Falling { since: now };
        }
    }

    /// Looks at the inputs. `flat`: the mirror shows the flat map.
    pub fn step(&mut self, inputs: Inputs, flat: bool, now: u64) -> Lost {
        let Inputs { laser_permit, high_voltage_ready } = inputs;
        let wants_laser = matches!(self.state, State::Rising { .. } | State::Up);
        let lost = Lost {
            laser_permit: wants_laser && !laser_permit,
            high_voltage: self.state != State::Down && !high_voltage_ready,
        };
        if lost.high_voltage {
            self.state = State::Down;
        } else if lost.laser_permit {
            self.state = State::Falling { since: now };
        }
        let passed = |since: u64, ticks: u64| now.wrapping_sub(since) >= ticks;
        match self.state {
            State::Rising { since } if passed(since, self.times.settle_ticks) => {
                self.state = State::Up;
            }
            State::Falling { since } if flat || passed(since, self.times.fall_ticks) => {
                self.state = State::Down;
            }
            _ => {}
        }
        lost
    }

    /// Whether the high voltage is on to stay: not about to go down.
    #[must_use]
    pub const fn keeps_voltage(&self) -> bool {
        matches!(self.state, State::Rising { .. } | State::Up)
    }

    /// What the outputs must be.
    #[must_use]
    pub const fn outputs(&self) -> Outputs {
        Outputs {
            high_voltage: !matches!(self.state, State::Down),
            laser: matches!(self.state, State::Up),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const READY: Inputs = Inputs { laser_permit: true, high_voltage_ready: true };
    const NO_PERMIT: Inputs = Inputs { laser_permit: false, ..READY };
    const NO_VOLTAGE: Inputs = Inputs { high_voltage_ready: false, ..READY };
    const NEITHER: Inputs = Inputs { laser_permit: false, high_voltage_ready: false };
    const TIMES: Times = Times { settle_ticks: 10, fall_ticks: 100 };

    const NOTHING: Outputs = Outputs { high_voltage: false, laser: false };
    const VOLTAGE: Outputs = Outputs { high_voltage: true, laser: false };
    const BOTH: Outputs = Outputs { high_voltage: true, laser: true };

    /// Armed at 0.
    fn armed() -> Interlock {
        let mut interlock = Interlock::new(TIMES);
        interlock.arm(READY, 0).expect("ready");
        interlock
    }

    /// With everything on.
    fn up() -> Interlock {
        let mut interlock = armed();
        interlock.step(READY, true, 10);
        assert_eq!(interlock.outputs(), BOTH);
        interlock
    }

    #[test]
    fn nothing_is_enabled_before_it_is_asked_for() {
        let mut interlock = Interlock::new(TIMES);
        for now in 0..200 {
            assert_eq!(interlock.step(READY, true, now), Lost::default());
            assert_eq!(interlock.outputs(), NOTHING);
        }
    }

    #[test]
    fn high_voltage_comes_first_and_the_laser_when_it_has_settled() {
        let mut interlock = armed();
        for now in 0..10 {
            interlock.step(READY, true, now);
            assert_eq!(interlock.outputs(), VOLTAGE, "{now}");
        }
        interlock.step(READY, true, 10);
        assert_eq!(interlock.outputs(), BOTH);
    }

    #[test]
    fn the_laser_goes_first_and_the_high_voltage_when_the_mirror_is_flat() {
        let mut interlock = up();
        assert!(interlock.keeps_voltage());
        interlock.disarm(50);
        assert_eq!(interlock.outputs(), VOLTAGE);
        assert!(!interlock.keeps_voltage());
        assert_eq!(interlock.step(READY, false, 60), Lost::default());
        assert_eq!(interlock.outputs(), VOLTAGE);
        interlock.step(READY, true, 61);
        assert_eq!(interlock.outputs(), NOTHING);
    }

    #[test]
    fn the_high_voltage_does_not_wait_for_ever() {
        let mut interlock = up();
        interlock.disarm(50);
        interlock.step(READY, false, 149);
        assert_eq!(interlock.outputs(), VOLTAGE);
        interlock.step(READY, false, 150);
        assert_eq!(interlock.outputs(), NOTHING);
    }

    #[test]
    fn a_lost_permit_takes_the_laser_at_once() {
        for mut interlock in [armed(), up()] {
            let lost = interlock.step(NO_PERMIT, false, 20);
            assert_eq!(lost, Lost { laser_permit: true, high_voltage: false });
            assert_eq!(interlock.outputs(), VOLTAGE);
            assert_eq!(interlock.step(NO_PERMIT, false, 21), Lost::default(), "told once");
            interlock.step(NO_PERMIT, true, 22);
            assert_eq!(interlock.outputs(), NOTHING);
        }
    }

    #[test]
    fn lost_high_voltage_takes_everything_at_once() {
        let mut falling = up();
        falling.disarm(15);
        for (inputs, laser_permit) in [(NO_VOLTAGE, false), (NEITHER, true)] {
            for (mut interlock, wants_laser) in [(armed(), true), (up(), true), (falling, false)] {
                let lost = interlock.step(inputs, false, 20);
                let laser_permit = laser_permit && wants_laser;
                assert_eq!(lost, Lost { laser_permit, high_voltage: true });
                assert_eq!(interlock.outputs(), NOTHING);
            }
        }
    }

    #[test]
    fn nothing_comes_back_by_itself() {
        for inputs in [NO_PERMIT, NO_VOLTAGE, NEITHER] {
            let mut interlock = up();
            interlock.step(inputs, true, 20);
            for now in 21..200 {
                assert_eq!(interlock.step(READY, true, now), Lost::default());
                assert_eq!(interlock.outputs(), NOTHING);
            }
            interlock.arm(READY, 200).expect("ready again");
            interlock.step(READY, true, 210);
            assert_eq!(interlock.outputs(), BOTH);
        }
    }

    #[test]
    fn it_cannot_be_armed_without_both_inputs() {
        for inputs in [NO_PERMIT, NO_VOLTAGE, NEITHER] {
            let mut interlock = Interlock::new(TIMES);
            assert_eq!(interlock.arm(inputs, 0), Err(inputs));
            interlock.step(READY, true, 50);
            assert_eq!(interlock.outputs(), NOTHING);
        }
    }

    #[test]
    fn arming_what_is_up_changes_nothing_and_what_falls_rises_again() {
        let mut interlock = up();
        interlock.arm(READY, 20).expect("ready");
        assert_eq!(interlock.outputs(), BOTH);
        interlock.disarm(30);
        interlock.arm(READY, 35).expect("ready");
        interlock.step(READY, false, 44);
        assert_eq!(interlock.outputs(), VOLTAGE, "the laser waits again");
        interlock.step(READY, false, 45);
        assert_eq!(interlock.outputs(), BOTH);
    }
}
