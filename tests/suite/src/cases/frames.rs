//! Whole frames, from pixels to codes.

use splash_firmware::pixels::Convention;
use splash_firmware::spec::{Estimator, SorSpec};

use crate::cases::Subject;
use crate::cases::law::TILTS;
use crate::cases::pixels::{BRIGHTEST, PLAIN, THRESHOLDED, WEIGHTED};
use crate::instrument::{DEFAULT, Instrument, Pupil, Second};
use crate::play::{Case, Event, Input};
use crate::scene::{Light, Spots};
use crate::stages::ALL;

/// In the middle of its window, well above the noise.
const SPOTS: Spots = Spots { peak: 160, radius: 2, wander_q8: 256, noise_adu: 2, dead: 0 };

const fn spots(name: &'static str, spots: Spots, frames: u32) -> Case {
    Case { name, input: Input::Rows(Light::Spots(spots)), frames, events: &[], shown: ALL }
}

const BRIGHT: Case = spots("bright", SPOTS, 3);
const NOISY: Case = spots("noisy", Spots { peak: 6, noise_adu: 24, ..SPOTS }, 3);
const DEAD: Case = spots("dead", Spots { dead: 5, ..SPOTS }, 3);
const SATURATED: Case = spots("saturated", Spots { peak: 500, radius: 1, ..SPOTS }, 3);
const EDGES: Case =
    Case { name: "edges", input: Input::Rows(Light::Edges), frames: 4, events: &[], shown: ALL };
const EVENTS: Case = Case {
    events: &[
        Event::None,
        Event::Reset,
        Event::None,
        Event::Cut,
        Event::Wrong,
        Event::None,
        Event::Extra,
        Event::Restart,
        Event::Dark,
        Event::NotBegun,
        Event::Tilt([40_000, -70_000]),
    ],
    ..spots("events", SPOTS, 15)
};
/// The same, but measured elsewhere.
const MEASURED: Case = Case { name: "measured", input: Input::Centroids(1 << 16, 7), ..EVENTS };

/// Measurements at the edges of their types.
const ANY: Case = Case { name: "any", input: Input::Edges, frames: 4, events: &[], shown: ALL };

const fn subject(instrument: Instrument, cases: &'static [Case]) -> Subject {
    Subject { instrument, tilts: &[], cases }
}

const fn four(name: &'static str, estimator: Estimator) -> Instrument {
    Instrument { name, estimator, ..DEFAULT }
}

/// 16 bits, every pixel and subaperture with its own calibration, zero below.
const fn own(name: &'static str, estimator: Estimator) -> Instrument {
    let convention = Convention::ZeroBelow;
    Instrument { calibrated: true, window: 5, bits: 16, convention, ..four(name, estimator) }
}

const fn eight(name: &'static str, estimator: Estimator) -> Instrument {
    Instrument { across: 8, ..four(name, estimator) }
}

const ALL_LIGHTS: &[Case] = &[BRIGHT, NOISY, DEAD, SATURATED];

pub(super) const SUBJECTS: &[Subject] = &[
    subject(four("n4-plain", PLAIN), ALL_LIGHTS),
    subject(
        four("n4-thresholded", THRESHOLDED),
        &[BRIGHT, NOISY, DEAD, SATURATED, EDGES, EVENTS, MEASURED],
    ),
    subject(four("n4-weighted", WEIGHTED), ALL_LIGHTS),
    subject(four("n4-brightest", BRIGHTEST), ALL_LIGHTS),
    subject(own("n4-plain-own", PLAIN), ALL_LIGHTS),
    subject(
        own("n4-thresholded-own", THRESHOLDED),
        &[BRIGHT, NOISY, DEAD, SATURATED, EDGES, EVENTS],
    ),
    subject(own("n4-weighted-own", WEIGHTED), ALL_LIGHTS),
    subject(own("n4-brightest-own", BRIGHTEST), ALL_LIGHTS),
    subject(Instrument { window: 16, ..four("n4-16px", THRESHOLDED) }, &[NOISY, DEAD]),
    Subject {
        instrument: eight("n8-thresholded", THRESHOLDED),
        tilts: TILTS,
        cases: &[BRIGHT, NOISY, DEAD, SATURATED, EVENTS],
    },
    Subject {
        instrument: Instrument {
            pupil: Pupil::Spider,
            window: 6,
            gap: 2,
            sor: SorSpec { omega: None, sweeps: None, cold_sweeps: None },
            ..eight("n8-spider", BRIGHTEST)
        },
        tilts: TILTS,
        cases: &[NOISY, DEAD, EVENTS],
    },
    Subject {
        instrument: Instrument { across: 16, ..four("n16-thresholded", THRESHOLDED) },
        tilts: TILTS,
        cases: &[NOISY, DEAD],
    },
    subject(
        Instrument {
            second: Some(Second { modes: 12, beside: true }),
            window: 4,
            ..eight("n8-two-gates-12", THRESHOLDED)
        },
        &[NOISY, DEAD, EVENTS, MEASURED, ANY],
    ),
    subject(
        Instrument {
            second: Some(Second { modes: 25, beside: false }),
            window: 4,
            delay_frames: 1,
            ..eight("n8-two-gates-25", WEIGHTED)
        },
        &[DEAD, ANY],
    ),
    subject(
        Instrument {
            second: Some(Second { modes: 12, beside: false }),
            window: 4,
            across: 16,
            ..four("n16-two-gates-12", THRESHOLDED)
        },
        &[ANY],
    ),
    subject(
        Instrument {
            second: Some(Second { modes: 25, beside: false }),
            window: 4,
            across: 16,
            ..four("n16-two-gates-25", PLAIN)
        },
        &[DEAD, ANY],
    ),
];
