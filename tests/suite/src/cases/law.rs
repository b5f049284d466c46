//! Slopes, the control law and the solver alone, from measurements made elsewhere.

use splash_firmware::slopes::MeanSlope;
use splash_firmware::spec::SorSpec;

use crate::cases::Subject;
use crate::instrument::{DEFAULT, Instrument, Pupil};
use crate::play::{Case, Input};
use crate::stages::Stage;

/// Four pixels of each window are enough: none is looked at.
const SMALL: Instrument = Instrument { window: 4, ..DEFAULT };

const SLOPES: &[Case] = &[
    Case { name: "edges", input: Input::Edges, frames: 6, events: &[], shown: &[Stage::Slopes] },
    Case {
        name: "spread",
        input: Input::Centroids(4 << 16, 5),
        frames: 4,
        events: &[],
        shown: &[Stage::Slopes],
    },
];

const COMMANDS: &[Case] = &[
    Case { name: "edges", input: Input::Edges, frames: 6, events: &[], shown: &[Stage::Commands] },
    Case {
        name: "spread",
        input: Input::Centroids(1 << 15, 0),
        frames: 8,
        events: &[],
        shown: &[Stage::Commands],
    },
    Case {
        name: "dead",
        input: Input::Centroids(1 << 15, 2),
        frames: 8,
        events: &[],
        shown: &[Stage::Commands],
    },
];

/// Tips and tilts that saturate the pistons, and those of some waves.
pub(super) const TILTS: &[(&str, i32)] = &[("steepest", 1 << 23), ("tilts", 50_000)];

const fn slopes(instrument: Instrument) -> Subject {
    Subject { instrument, tilts: &[], cases: SLOPES }
}

const fn control(instrument: Instrument) -> Subject {
    Subject { instrument, tilts: &[], cases: COMMANDS }
}

const fn solver(name: &'static str, pupil: Pupil, across: usize) -> Subject {
    let sor = SorSpec { omega: None, sweeps: None, cold_sweeps: None };
    Subject {
        instrument: Instrument { name, pupil, across, sor, ..SMALL },
        tilts: TILTS,
        cases: &[],
    }
}

pub(super) const SUBJECTS: &[Subject] = &[
    slopes(Instrument { name: "slopes", calibrated: true, ..SMALL }),
    slopes(Instrument { name: "slopes-steep", quarter_waves: 200.0, ..SMALL }),
    slopes(Instrument { name: "slopes-shallow", quarter_waves: 0.01, ..SMALL }),
    control(Instrument { name: "control", ..SMALL }),
    control(Instrument { name: "control-delay-1", delay_frames: 1, ..SMALL }),
    control(Instrument { name: "control-delay-2", delay_frames: 2, ..SMALL }),
    control(Instrument { name: "control-delay-3", delay_frames: 3, control_gain: 0.25, ..SMALL }),
    control(Instrument { name: "control-mean-kept", mean: MeanSlope::Keep, ..SMALL }),
    control(Instrument {
        name: "control-steep",
        control_gain: 1.9,
        lever_arm: 1.9,
        quarter_waves: 50.0,
        ..SMALL
    }),
    control(Instrument { name: "control-spider", pupil: Pupil::Spider, across: 7, ..SMALL }),
    solver("solver-circle-4", Pupil::Circle, 4),
    solver("solver-square-5", Pupil::Square, 5),
    // Both kernels of the soft core: with nodes of one neighbour, and without.
    solver("solver-comb-8", Pupil::Comb, 8),
    solver("solver-circle-8", Pupil::Circle, 8),
];
