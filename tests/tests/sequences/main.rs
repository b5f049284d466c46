//! The pipeline as a state machine: what is not a good frame leaves state and codes as they were,
//! says so, and the next good frame does what it would have done anyway. And what must not matter
//! to a result: capacities, placement and order of windows, which bank, what was refused.

mod banks;
mod faults;
mod global_tilt;
mod limits;
mod past;
mod placement;
mod start;

use splash_firmware::actuators::Law;
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::fixed::TILT_LIMIT;
use splash_firmware::geometry::Mask;
use splash_firmware::pipeline::{
    GlobalTilt, Hold, Outcome, Pipeline, Progress, Report, RowError, Totals,
};
use splash_firmware::segments::Position;
use splash_firmware::slopes::{MeanSlope, Slope};
use splash_firmware::spec::Estimator;
use splash_tests::frames::{Background, Rng, frame, scattered};
use splash_tests::instrument::{Instrument, Values, run_frame, step};
use splash_tests::with_big_stack;

const CELLS: usize = 8 * 8;
const PIXELS: usize = CELLS * 8 * 8;
const BUFFERED: usize = CELLS * 8 * 8;

type SmallConfig = Config<CELLS, PIXELS, BUFFERED>;
type SmallPipeline = Pipeline<CELLS, BUFFERED>;

/// 8 x 8 subapertures in a circle, windows of 8 x 8 pixels, and a code for every height LSB.
fn usual() -> Instrument {
    let mut instrument = Instrument::circle(8, 8);
    instrument.law = Law::Linear;
    instrument
}

fn estimators() -> [Estimator; 4] {
    [
        Estimator::CentreOfGravity,
        Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.1 },
        Estimator::WeightedCentreOfGravity { peak_fraction: 0.1, fwhm_px: 4.0, gain: 1.5 },
        Estimator::Brightest { count: 12 },
    ]
}

/// Frames of spots that wander by two pixels, with noise.
fn frames(instrument: &Instrument, count: usize) -> Vec<Vec<u16>> {
    let mut rng = Rng::new(11);
    let mut one = || {
        let spots = scattered(instrument, (900, 400, 512), &mut rng);
        frame(instrument, &spots, &Background::DEFAULT, &mut rng)
    };
    (0..count).map(|_| one()).collect()
}

fn pipeline() -> Box<SmallPipeline> {
    Box::new(Pipeline::new())
}

fn rows(pixels: &[u16], width: u16) -> impl Iterator<Item = &[u16]> {
    pixels.chunks_exact(usize::from(width))
}

/// Everything that can be read from a pipeline but its totals.
#[derive(Clone, PartialEq)]
struct State {
    codes: Vec<[u16; 3]>,
    positions: Vec<Position>,
    commands: Vec<[i32; 2]>,
    slopes: Vec<Slope>,
    measurements: Vec<Measurement>,
}

fn state(pipeline: &SmallPipeline) -> State {
    State {
        codes: pipeline.codes().to_vec(),
        positions: pipeline.positions().to_vec(),
        commands: pipeline.commands().to_vec(),
        slopes: pipeline.slopes().to_vec(),
        measurements: pipeline.measurements().to_vec(),
    }
}

/// Asserts that two states are one, and says where they first differ.
#[track_caller]
fn assert_same(found: &State, expected: &State, context: &str) {
    first_difference(&found.measurements, &expected.measurements, context);
    first_difference(&found.slopes, &expected.slopes, context);
    first_difference(&found.commands, &expected.commands, context);
    first_difference(&found.positions, &expected.positions, context);
    first_difference(&found.codes, &expected.codes, context);
}

#[track_caller]
fn first_difference<T: PartialEq + std::fmt::Debug>(found: &[T], expected: &[T], context: &str) {
    assert_eq!(found.len(), expected.len(), "{context}: subapertures");
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert_eq!(found, expected, "{context}: subaperture {i}");
    }
}

const NOTHING: Totals = Totals {
    updated: 0,
    cut_short: 0,
    wrong_row: 0,
    no_light: 0,
    not_ready: 0,
    restarted: 0,
    extra_rows: 0,
    stale_tilt: 0,
    saturated_actuators: 0,
    slewed_actuators: 0,
};

/// Pushes the first `count` rows.
fn push(pipeline: &mut SmallPipeline, config: &SmallConfig, pixels: &[u16], count: usize) {
    for (y, row) in rows(pixels, config.width()).take(count).enumerate() {
        let last = y + 1 == usize::from(config.height());
        let progress = if last { Progress::Complete } else { Progress::More };
        assert_eq!(pipeline.push_row(config, row), Ok(progress), "row {y}");
    }
}

/// An instrument for which a centroid of 1 (Q16 px) is a tilt of 1 ulp exactly, and nothing is
/// limited: what is left is integer arithmetic that the tests do by themselves.
fn transparent(delay_frames: u8) -> Instrument {
    let mut instrument = usual();
    instrument.delay_frames = delay_frames;
    // 2^16 ulp a pixel: a Q16 pixel to the ulp.
    let gain = 65536.0 * instrument.ulp_m();
    instrument.slope_gain_m_per_px = Values::Uniform([[gain, 0.0], [0.0, gain]]);
    instrument
}

/// Measurements of an atmosphere's tilts less what the mirror shows.
fn seen(atmosphere: &[[i32; 2]], shown: &[[i32; 2]]) -> Vec<Measurement> {
    let one = |(a, m): (&[i32; 2], &[i32; 2])| Measurement {
        centroid_q16: [a[0] - m[0], a[1] - m[1]],
        flux: 10_000,
        peak: 1000,
        saturated: 0,
    };
    atmosphere.iter().zip(shown).map(one).collect()
}

/// A frame of which only the first `count` rows come.
fn short(
    pipeline: &mut SmallPipeline,
    config: &SmallConfig,
    pixels: &[u16],
    count: usize,
) -> Option<Report> {
    pipeline.begin(config, 99);
    push(pipeline, config, pixels, count);
    Some(pipeline.finish(config))
}
