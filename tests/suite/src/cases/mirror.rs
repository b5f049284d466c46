//! Segments and actuators alone: commands within what they reach, and far beyond it.

use splash_firmware::actuators::Law;

use crate::cases::Subject;
use crate::instrument::{DEFAULT, Instrument, Pupil};
use crate::play::{Case, Event, Input};
use crate::stages::Stage;

const fn case(name: &'static str, wander_q16: i32, events: &'static [Event]) -> Case {
    let shown = &[Stage::Positions, Stage::Codes];
    Case { name, input: Input::Centroids(wander_q16, 0), frames: 6, events, shown }
}

const CASES: &[Case] = &[
    case("within", 1 << 14, &[]),
    case("beyond", 30 << 16, &[]),
    case("tilted", 1 << 14, &[Event::Tilt([1 << 21, -(1 << 20)]), Event::Tilt([i32::MAX; 2])]),
];

/// Of one segment: its mean is its piston, and it has no tilt but a common one.
const ALONE: &[Case] = &[case("within", 1 << 14, &[])];

const fn subject(instrument: Instrument) -> Subject {
    Subject { instrument, tilts: &[], cases: CASES }
}

/// Half the stroke, so that the steepest tilts are beyond it.
const SMALL: Instrument = Instrument {
    window: 4,
    control_gain: 1.0,
    quarter_waves: 4.0,
    limits: [0.25, 0.75],
    ..DEFAULT
};

pub(super) const SUBJECTS: &[Subject] = &[
    subject(Instrument { name: "quadratic-16bit", ..SMALL }),
    Subject {
        instrument: Instrument { name: "lone-8", pupil: Pupil::Lone, across: 8, ..SMALL },
        tilts: &[],
        cases: ALONE,
    },
    subject(Instrument { name: "quadratic-12bit", dac_bits: 12, ..SMALL }),
    subject(Instrument { name: "linear-16bit", law: Law::Linear, limits: [0.0, 0.625], ..SMALL }),
    subject(Instrument { name: "linear-8bit", law: Law::Linear, dac_bits: 8, ..SMALL }),
    subject(Instrument { name: "reversed", response: [1.25, -0.125], ..SMALL }),
    subject(Instrument { name: "long-response", response: [-1.0, 3.0], ..SMALL }),
    subject(Instrument { name: "short-stroke", limits: [0.46875, 0.53125], ..SMALL }),
    subject(Instrument { name: "slew", slew: Some(1.0 / 256.0), ..SMALL }),
    subject(Instrument {
        name: "slew-short-stroke",
        slew: Some(1.0 / 64.0),
        limits: [0.25, 0.5],
        ..SMALL
    }),
    subject(Instrument { name: "own", calibrated: true, ..SMALL }),
    subject(Instrument {
        name: "own-linear-slew",
        calibrated: true,
        law: Law::Linear,
        dac_bits: 14,
        slew: Some(1.0 / 32.0),
        ..SMALL
    }),
];
