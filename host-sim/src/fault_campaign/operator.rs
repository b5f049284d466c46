//! Who closes the loop again: nobody else does. And who asks for what cannot be.

use rand::{Rng, RngExt};
use rand_xoshiro::Xoshiro256PlusPlus;
use splash_firmware::controller::Command;
use splash_firmware::gate::Range;
use splash_firmware::interlock::Outputs;
use splash_firmware::mode::{MODES, Mode};
use splash_firmware::segments::Position;

/// Frames between two attempts.
const EVERY: u64 = 10;

/// The operator.
pub(super) struct Operator {
    /// Armed, and not lost or disarmed since.
    armed: bool,
}

impl Operator {
    pub(super) const fn new() -> Self {
        Self { armed: false }
    }

    /// Whether the laser is on or on its way.
    pub(super) const fn has_armed(&self) -> bool {
        self.armed
    }

    /// An input was missing, or a command took everything down.
    pub(super) fn lost(&mut self) {
        self.armed = false;
    }

    /// A command was taken.
    pub(super) fn took(&mut self, command: &Command) {
        match command {
            Command::Arm => self.armed = true,
            Command::Disarm => self.armed = false,
            _ => {}
        }
    }

    /// The next step to a closed loop, if it is time for one.
    pub(super) fn next(&self, frame: u64, mode: Mode, outputs: Outputs) -> Option<Command> {
        if !frame.is_multiple_of(EVERY) || mode == Mode::ClosedLoop {
            return None;
        }
        Some(match mode {
            _ if !outputs.laser && !self.armed => Command::Arm,
            Mode::Safe | Mode::Calibrate | Mode::TestPattern => Command::Enter(Mode::Standby),
            Mode::Standby | Mode::OpenLoop | Mode::ClosedLoop => Command::Enter(Mode::ClosedLoop),
        })
    }
}

/// Any command, sensible or not, but for the one that clears the counters.
pub(super) fn any(random: &mut Xoshiro256PlusPlus, subapertures: u16) -> Command {
    let subaperture = random.random_range(0..subapertures + 2);
    let mut extreme = || match random.random_range(0..4) {
        0 => i32::MIN,
        1 => i32::MAX,
        2 => random.random_range(-1 << 20..1 << 20),
        _ => random.next_u32() as i32,
    };
    let heights_ulp = [extreme(), extreme(), extreme()];
    match random.random_range(0..12) {
        0 => Command::Arm,
        1 => Command::Disarm,
        2 => Command::Flat,
        3 => Command::Gate(Range {
            altitude_mm: random.random_range(0..40_000_000),
            depth_mm: random.random_range(0..1_000_000),
            zenith_mdeg: random.random_range(0..90_000),
        }),
        4..8 => Command::Enter(MODES[random.random_range(0..MODES.len())]),
        8 | 9 => Command::Heights { subaperture, heights_ulp },
        _ => {
            let [piston_ulp, tip, tilt] = heights_ulp;
            let position = Position { piston_ulp, tilt_ulp: [tip, tilt] };
            Command::Position { subaperture, position }
        }
    }
}
