//! The cases.

use crate::frames::Case;
use crate::frames::{Event, Input};
use crate::instrument::{DEFAULT, Instrument, Pupil};
use crate::scene::{BRIGHT, Light};
use splash_firmware::spec::Estimator;

/// An instrument and what is done with it.
pub(crate) struct Subject {
    pub(crate) instrument: Instrument,
    /// Limits of the tilts that its solver gets alone, ulp.
    pub(crate) tilts: &'static [i32],
    pub(crate) cases: &'static [Case],
}

const A: &[Case] = &[Case {
    name: "bright",
    input: Input::Rows(Light::Spots(BRIGHT)),
    frames: 5,
    events: &[Event::None],
}];

pub(crate) const SUBJECTS: &[Subject] = &[
    Subject { instrument: Instrument { name: "n4", ..DEFAULT }, tilts: &[1 << 23], cases: A },
    Subject {
        instrument: Instrument {
            name: "n4-brightest",
            estimator: Estimator::Brightest { count: 16 },
            ..DEFAULT
        },
        tilts: &[],
        cases: A,
    },
    Subject {
        instrument: Instrument { name: "n4-own", calibrated: true, window: 5, ..DEFAULT },
        tilts: &[],
        cases: A,
    },
    Subject {
        instrument: Instrument { name: "n8", across: 8, ..DEFAULT },
        tilts: &[1 << 23],
        cases: A,
    },
    Subject {
        instrument: Instrument {
            name: "n8-spider",
            across: 8,
            pupil: Pupil::Spider,
            window: 4,
            sor: splash_firmware::spec::SorSpec { omega: None, sweeps: None, cold_sweeps: None },
            ..DEFAULT
        },
        tilts: &[1 << 23],
        cases: A,
    },
    Subject {
        instrument: Instrument { name: "n16", across: 16, ..DEFAULT },
        tilts: &[1 << 23],
        cases: A,
    },
];
