//! What must hold after every step of the controller, from the instrument's description alone.

use crate::instrument::{Instrument, ResponseName};
use splash_firmware::fixed::TILT_LIMIT;
use splash_firmware::interlock::Outputs;
use splash_firmware::mode::Mode;
use splash_firmware::segments::Position;

/// A code of a quadratic response is up to two LSB of height, and each end of a step is rounded by half a
/// code at most, and a hundredth where codes are highest; 4 ulp and two of 2^24 of the stroke are less than a fiftieth.
const ROUNDING_LSB: f64 = 2.06;
/// LSB in the stroke.
const STROKE_LSB: f64 = 65536.0;

/// Modes that may follow one another: the operator's ways and the faults'.
const WAYS: [(Mode, &[Mode]); 6] = [
    (Mode::Safe, &[Mode::Standby]),
    (
        Mode::Standby,
        &[Mode::Safe, Mode::Calibrate, Mode::OpenLoop, Mode::ClosedLoop, Mode::TestPattern],
    ),
    (Mode::Calibrate, &[Mode::Safe, Mode::Standby]),
    (Mode::OpenLoop, &[Mode::Safe, Mode::Standby, Mode::ClosedLoop]),
    (Mode::ClosedLoop, &[Mode::Safe, Mode::Standby, Mode::OpenLoop]),
    (Mode::TestPattern, &[Mode::Safe, Mode::Standby]),
];

/// What was, and the limits.
pub(super) struct Invariants {
    /// Height over stroke of a code.
    height: fn(f64) -> f64,
    /// DAC LSB.
    slew_lsb: f64,
    codes: Vec<[u16; 3]>,
    mode: Mode,
}

impl Invariants {
    pub(super) fn new(instrument: &Instrument) -> Self {
        let mirror = &instrument.mirror;
        Self {
            height: match mirror.response {
                ResponseName::Linear => |part| part,
                ResponseName::Quadratic => |part| part * part,
            },
            slew_lsb: STROKE_LSB * mirror.slew_m_per_frame / mirror.stroke_m,
            codes: Vec::new(),
            mode: Mode::Safe,
        }
    }

    /// The controller has started anew, and whatever the mirror showed is shown no more.
    pub(super) fn start(&mut self, codes: &[[u16; 3]]) {
        self.codes = codes.to_vec();
        self.mode = Mode::Safe;
    }

    /// Looks at the codes of a step.
    ///
    /// # Errors
    /// What does not hold.
    pub(super) fn codes(&mut self, codes: &[[u16; 3]]) -> Result<(), String> {
        let lsb = |code: u16| STROKE_LSB * (self.height)(f64::from(code) / 65535.0);
        let pairs = codes.as_flattened().iter().zip(self.codes.as_flattened());
        for (i, (&now, &before)) in pairs.enumerate() {
            // The limits are the whole stroke, which no code leaves; what can be broken is the slew.
            let step = (lsb(now) - lsb(before)).abs();
            if step > self.slew_lsb + ROUNDING_LSB {
                let (segment, actuator) = (i / 3, i % 3);
                return Err(format!(
                    "segment {segment}, actuator {actuator}: code {before} to {now} is {step:.1} LSB, \
                     more than {:.1} in a step",
                    self.slew_lsb
                ));
            }
        }
        self.codes.copy_from_slice(codes);
        Ok(())
    }

    /// Looks at the formats of the state.
    ///
    /// # Errors
    /// What does not hold.
    pub(super) fn formats(
        &self,
        positions: &[Position],
        commands: &[[i32; 2]],
    ) -> Result<(), String> {
        for (i, position) in positions.iter().enumerate() {
            let Position { piston_ulp, tilt_ulp } = *position;
            if piston_ulp.unsigned_abs() >= 1 << 29 || tilt_ulp.iter().any(|t| t.abs() > TILT_LIMIT)
            {
                return Err(format!("segment {i}: {position:?}"));
            }
        }
        match commands.as_flattened().iter().find(|command| command.abs() > TILT_LIMIT) {
            Some(command) => Err(format!("command {command} ulp")),
            None => Ok(()),
        }
    }

    /// Looks at the mode; between two looks it changes once at most.
    ///
    /// # Errors
    /// What does not hold.
    pub(super) fn mode(&mut self, mode: Mode, outputs: Outputs) -> Result<(), String> {
        let before = std::mem::replace(&mut self.mode, mode);
        let may = WAYS.iter().any(|(from, ways)| *from == before && ways.contains(&mode));
        if mode != before && !may {
            return Err(format!("mode {before} to {mode}"));
        }
        let Outputs { high_voltage, laser } = outputs;
        if laser && !high_voltage {
            return Err("laser without high voltage".into());
        }
        if mode == Mode::ClosedLoop && !laser {
            return Err("closed loop without laser".into());
        }
        Ok(())
    }
}
