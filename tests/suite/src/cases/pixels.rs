//! Calibration, moments and centroids alone: two windows, every kind of pixel.
//!
//! Kernels differ with the window's size and place, the bits, the convention, the estimator and
//! whether there is a flat field. A row starts at a word; windows lie at words, or at odd columns.

use splash_firmware::pixels::Convention::{self, Subtract, ZeroBelow};
use splash_firmware::spec::Estimator;

use crate::cases::Subject;
use crate::instrument::{DEFAULT, Instrument, Pupil};
use crate::play::{Case, Input};
use crate::scene::{Light, Spots};
use crate::stages::Stage;

pub(super) const PLAIN: Estimator = Estimator::CentreOfGravity;
pub(super) const THRESHOLDED: Estimator =
    Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.25 };
pub(super) const WEIGHTED: Estimator =
    Estimator::WeightedCentreOfGravity { peak_fraction: 0.125, fwhm_px: 4.0, gain: 1.5 };
pub(super) const BRIGHTEST: Estimator = Estimator::Brightest { count: 12 };

const fn case(name: &'static str, light: Light, frames: u32) -> Case {
    let shown = &[Stage::Measurements];
    Case { name, input: Input::Rows(light), frames, events: &[], shown }
}

const CASES: &[Case] = &[
    case("edges", Light::Edges, 4),
    case("spots", Light::Spots(SPOTS), 4),
    case("white", Light::Level(u16::MAX), 2),
    case("black", Light::Level(0), 1),
];

/// Some of them saturate, some leave their window.
const SPOTS: Spots = Spots { peak: 300, radius: 2, wander_q8: 512, noise_adu: 2, dead: 0 };

/// Pixels with a calibration of their own, flat field included, or all with the same.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Each {
    Same,
    Own,
}

const fn subject(
    name: &'static str,
    estimator: Estimator,
    (window, gap): (u8, u16),
    bits: u8,
    convention: Convention,
    each: Each,
) -> Subject {
    let calibrated = matches!(each, Own);
    let pupil = Pupil::Pair;
    let instrument =
        Instrument { name, pupil, window, gap, bits, calibrated, convention, estimator, ..DEFAULT };
    Subject { instrument, tilts: &[], cases: CASES }
}

const fn with(subject: Subject, dark_adu: u16, noise_adu: f64, saturation_adu: u16) -> Subject {
    let saturation_adu = Some(saturation_adu);
    let instrument = Instrument { dark_adu, noise_adu, saturation_adu, ..subject.instrument };
    Subject { instrument, ..subject }
}

use Each::{Own, Same};

pub(super) const SUBJECTS: &[Subject] = &[
    subject("plain-4px-8bit", PLAIN, (4, 0), 8, Subtract, Same),
    subject("plain-5px-12bit-zero-below-flat", PLAIN, (5, 1), 12, ZeroBelow, Own),
    subject("plain-8px-16bit", PLAIN, (8, 0), 16, Subtract, Same),
    subject("plain-16px-10bit-flat", PLAIN, (16, 0), 10, Subtract, Own),
    subject("thresholded-7px-12bit", THRESHOLDED, (7, 2), 12, Subtract, Same),
    subject("thresholded-8px-12bit", THRESHOLDED, (8, 0), 12, Subtract, Same),
    subject("thresholded-8px-12bit-odd", THRESHOLDED, (8, 1), 12, Subtract, Same),
    subject("thresholded-8px-12bit-flat", THRESHOLDED, (8, 1), 12, Subtract, Own),
    subject("thresholded-8px-12bit-zero-below", THRESHOLDED, (8, 3), 12, ZeroBelow, Same),
    subject("thresholded-8px-15bit-zero-below-flat", THRESHOLDED, (8, 0), 15, ZeroBelow, Own),
    subject("thresholded-8px-16bit", THRESHOLDED, (8, 1), 16, Subtract, Same),
    subject("thresholded-8px-16bit-zero-below-flat", THRESHOLDED, (8, 0), 16, ZeroBelow, Own),
    subject("thresholded-12px-12bit", THRESHOLDED, (12, 2), 12, Subtract, Same),
    subject("thresholded-12px-12bit-flat", THRESHOLDED, (12, 0), 12, Subtract, Own),
    subject("thresholded-16px-12bit", THRESHOLDED, (16, 0), 12, Subtract, Same),
    subject("thresholded-16px-12bit-flat", THRESHOLDED, (16, 0), 12, Subtract, Own),
    subject("thresholded-16px-15bit", THRESHOLDED, (16, 2), 15, Subtract, Same),
    subject("thresholded-16px-14bit-zero-below", THRESHOLDED, (16, 0), 14, ZeroBelow, Same),
    subject("thresholded-16px-16bit", THRESHOLDED, (16, 0), 16, Subtract, Same),
    subject("thresholded-16px-16bit-zero-below-flat", THRESHOLDED, (16, 0), 16, ZeroBelow, Own),
    subject("thresholded-32px-16bit", THRESHOLDED, (32, 0), 16, Subtract, Same),
    subject("weighted-8px-12bit", WEIGHTED, (8, 0), 12, Subtract, Same),
    subject("weighted-9px-12bit-zero-below-flat", WEIGHTED, (9, 1), 12, ZeroBelow, Own),
    subject("weighted-16px-16bit-flat", WEIGHTED, (16, 0), 16, Subtract, Own),
    subject("brightest-5px-12bit-flat", BRIGHTEST, (5, 1), 12, Subtract, Own),
    subject("brightest-8px-12bit", BRIGHTEST, (8, 0), 12, Subtract, Same),
    subject("brightest-16px-16bit-zero-below-flat", BRIGHTEST, (16, 0), 16, ZeroBelow, Own),
    // Thresholds that take more than eight bits; floors in the upper half of the range.
    with(
        subject("high-threshold-8px-16bit", THRESHOLDED, (8, 0), 16, ZeroBelow, Same),
        1000,
        2000.0,
        60_000,
    ),
    with(
        subject("high-dark-8px-16bit", THRESHOLDED, (8, 0), 16, Subtract, Same),
        40_000,
        1.0,
        50_000,
    ),
    with(
        subject("high-dark-16px-16bit-flat", THRESHOLDED, (16, 0), 16, Subtract, Own),
        40_000,
        1.0,
        50_000,
    ),
];
