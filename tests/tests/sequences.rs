//! The pipeline as a state machine: what is not a good frame leaves state and codes as they were,
//! says so, and the next good frame does what it would have done anyway. And what must not matter
//! to a result: capacities, placement and order of windows, which bank, what was refused.

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

/// What a sequence that is no good frame does, and what must come of it.
struct Fault {
    name: &'static str,
    /// What happens instead of a good frame; the last report, if it ends with `finish`.
    happens: fn(&mut SmallPipeline, &SmallConfig, &[u16]) -> Option<Report>,
    /// The hold in that report.
    hold: Option<Hold>,
    /// What it adds to the totals.
    adds: Totals,
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

fn sum(a: Totals, b: Totals) -> Totals {
    Totals {
        updated: a.updated + b.updated,
        cut_short: a.cut_short + b.cut_short,
        wrong_row: a.wrong_row + b.wrong_row,
        no_light: a.no_light + b.no_light,
        not_ready: a.not_ready + b.not_ready,
        restarted: a.restarted + b.restarted,
        extra_rows: a.extra_rows + b.extra_rows,
        stale_tilt: a.stale_tilt + b.stale_tilt,
        saturated_actuators: a.saturated_actuators + b.saturated_actuators,
        slewed_actuators: a.slewed_actuators + b.slewed_actuators,
    }
}

/// Pushes the first `count` rows.
fn push(pipeline: &mut SmallPipeline, config: &SmallConfig, pixels: &[u16], count: usize) {
    for (y, row) in rows(pixels, config.width()).take(count).enumerate() {
        let last = y + 1 == usize::from(config.height());
        let progress = if last { Progress::Complete } else { Progress::More };
        assert_eq!(pipeline.push_row(config, row), Ok(progress), "row {y}");
    }
}

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

fn wrong_row(
    pipeline: &mut SmallPipeline,
    config: &SmallConfig,
    pixels: &[u16],
    (after, length): (usize, usize),
) -> Option<Report> {
    pipeline.begin(config, 99);
    push(pipeline, config, pixels, after);
    let error = RowError::Length { found: length as u32, expected: config.width() };
    assert_eq!(pipeline.push_row(config, &vec![4095; length]), Err(error));
    // The rest of the frame makes it no better.
    for row in rows(pixels, config.width()).skip(after) {
        assert!(pipeline.push_row(config, row).is_ok());
    }
    Some(pipeline.finish(config))
}

/// Frames of 64 rows of 64 pixels.
fn faults() -> Vec<Fault> {
    let cut = Totals { cut_short: 1, ..NOTHING };
    let wrong = Totals { wrong_row: 1, ..NOTHING };
    let not_ready = Totals { not_ready: 1, ..NOTHING };
    let restarted = Totals { restarted: 1, ..NOTHING };
    let fault = |name, happens, hold, adds| Fault { name, happens, hold, adds };
    vec![
        fault("no row", |p, c, f| short(p, c, f, 0), Some(Hold::CutShort { rows: 0 }), cut),
        fault("one row", |p, c, f| short(p, c, f, 1), Some(Hold::CutShort { rows: 1 }), cut),
        fault(
            "half a window",
            |p, c, f| short(p, c, f, 12),
            Some(Hold::CutShort { rows: 12 }),
            cut,
        ),
        fault(
            "all but one row",
            |p, c, f| short(p, c, f, 63),
            Some(Hold::CutShort { rows: 63 }),
            cut,
        ),
        fault(
            "a short first row",
            |p, c, f| wrong_row(p, c, f, (0, 63)),
            Some(Hold::WrongRow),
            wrong,
        ),
        fault(
            "a long last row",
            |p, c, f| wrong_row(p, c, f, (63, 65)),
            Some(Hold::WrongRow),
            wrong,
        ),
        fault("an empty row", |p, c, f| wrong_row(p, c, f, (20, 0)), Some(Hold::WrongRow), wrong),
        fault(
            "a wrong row, then nothing",
            |p, c, f| {
                p.begin(c, 99);
                push(p, c, f, 3);
                let _ = p.push_row(c, &[0; 7]);
                Some(p.finish(c))
            },
            Some(Hold::WrongRow),
            wrong,
        ),
        fault("finish alone", |p, c, _| Some(p.finish(c)), Some(Hold::NotBegun), not_ready),
        fault(
            "rows and finish without begin",
            |p, c, f| {
                for row in rows(f, c.width()) {
                    assert_eq!(p.push_row(c, row), Err(RowError::NotBegun));
                }
                Some(p.finish(c))
            },
            Some(Hold::NotBegun),
            not_ready,
        ),
        fault(
            "rows without begin",
            |p, c, f| {
                assert_eq!(p.push_row(c, &f[..64]), Err(RowError::NotBegun));
                assert_eq!(p.push_row(c, &f[..7]), Err(RowError::NotBegun));
                None
            },
            None,
            NOTHING,
        ),
        fault(
            "a frame that is begun again",
            |p, c, f| {
                p.begin(c, 98);
                push(p, c, f, 30);
                None
            },
            None,
            restarted,
        ),
        fault(
            "a complete frame that is never finished",
            |p, c, f| {
                p.begin(c, 98);
                push(p, c, f, 64);
                None
            },
            None,
            restarted,
        ),
        fault(
            "a wrong row in a frame that is begun again",
            |p, c, f| {
                p.begin(c, 98);
                push(p, c, f, 30);
                let _ = p.push_row(c, &[]);
                None
            },
            None,
            restarted,
        ),
        fault(
            "measurements of another instrument",
            |p, c, _| {
                p.begin(c, 99);
                let error = RowError::Length { found: 51, expected: 52 };
                assert_eq!(p.push_measurements(c, &[Measurement::default(); 51]), Err(error));
                Some(p.finish(c))
            },
            Some(Hold::WrongRow),
            wrong,
        ),
    ]
}

/// Nothing that can be read changes, the report and the totals say what happened, and the frames
/// that follow do what they do in a pipeline that never saw it.
#[test]
fn a_fault_changes_nothing_and_is_counted() {
    for estimator in estimators() {
        let mut instrument = usual();
        instrument.estimator = estimator;
        let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
        let frames = frames(&instrument, 7);
        for Fault { name, happens, hold, adds } in faults() {
            let (mut twin, mut pipeline) = (pipeline(), pipeline());
            for (number, pixels) in (0..).zip(&frames[..3]) {
                step(&mut twin, &config, number, pixels);
                step(&mut pipeline, &config, number, pixels);
            }
            let (before, totals) = (state(&pipeline), pipeline.totals());
            // Full of another frame's light.
            let report = happens(&mut pipeline, &config, &frames[6]);
            assert_same(&state(&pipeline), &before, name);
            assert_eq!(report.map(|r| r.outcome), hold.map(Outcome::Held), "{name}");
            if let Some(report) = report {
                assert_eq!((report.valid, report.saturated_actuators), (0, 0), "{name}");
                assert!(!report.restarted, "{name}");
            }
            for (number, pixels) in (3..).zip(&frames[3..6]) {
                let expected = step(&mut twin, &config, number, pixels);
                let mut report = step(&mut pipeline, &config, number, pixels);
                // The frame after a dropped one says so.
                assert_eq!(report.restarted, number == 3 && adds.restarted == 1, "{name}");
                report.restarted = false;
                assert_eq!(report, expected, "{name}, frame {number}");
                assert_same(&state(&pipeline), &state(&twin), &format!("{name}, frame {number}"));
            }
            let good = Totals { updated: 3, ..NOTHING };
            assert_eq!(pipeline.totals(), sum(sum(totals, adds), good), "{name}");
        }
    }
}

/// Extra rows are refused and counted; the frame counts.
#[test]
fn rows_after_the_last_are_refused_and_counted() {
    let instrument = usual();
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let frames = frames(&instrument, 3);
    let (mut twin, mut pipeline) = (pipeline(), pipeline());
    for (number, extra) in [(0u32, 1u16), (1, 3), (2, 0)] {
        let pixels = &frames[number as usize];
        let expected = step(&mut twin, &config, number, pixels);
        pipeline.begin(&config, number);
        push(&mut pipeline, &config, pixels, 64);
        for k in 0..extra {
            // Whatever its length.
            let row = vec![4095; if k == 0 { 64 } else { 3 }];
            assert_eq!(pipeline.push_row(&config, &row), Err(RowError::Extra));
        }
        let measured = [Measurement::default(); 52];
        assert_eq!(pipeline.push_measurements(&config, &measured), Err(RowError::Extra));
        let report = pipeline.finish(&config);
        assert_eq!(report, Report { extra_rows: extra, ..expected });
        assert_same(&state(&pipeline), &state(&twin), "frame");
    }
    assert_eq!(pipeline.totals(), Totals { updated: 3, extra_rows: 4, ..NOTHING });
}

/// A dark frame holds. It is a complete frame, so its measurements are the last ones; without a
/// moving threshold the next frame does as if it had not been.
#[test]
fn a_dark_frame_is_held() {
    let mut instrument = usual();
    instrument.estimator = Estimator::CentreOfGravity;
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let frames = frames(&instrument, 4);
    let (mut twin, mut pipeline) = (pipeline(), pipeline());
    let dark = vec![100; 64 * 64];
    // A frame too bright is no better than a dark one.
    let mut glaring = vec![4095; 64 * 64];
    for p in glaring.iter_mut().step_by(2) {
        *p = 100;
    }
    instrument.flux_max_adu = Values::Uniform(100_000.0);
    let strict = instrument.config::<CELLS, PIXELS, BUFFERED>();
    for (number, pixels) in (0..).zip(&frames) {
        step(&mut twin, &config, number, pixels);
        step(&mut pipeline, &config, number, pixels);
        assert_eq!(pipeline.codes(), twin.codes(), "frame {number}");
        for (bank, light) in [(&config, &dark), (&strict, &glaring)] {
            let codes = pipeline.codes().to_vec();
            let report = run_frame(&mut pipeline, bank, number, light);
            assert_eq!(report.outcome, Outcome::Held(Hold::NoLight));
            assert_eq!(report.valid, 0);
            assert_eq!(pipeline.codes(), codes);
            assert!(pipeline.slopes().iter().all(|slope| !slope.valid));
        }
    }
    assert!(pipeline.measurements().iter().all(|m| m.flux > 100_000));
    assert_eq!(pipeline.totals(), Totals { updated: 4, no_light: 8, ..NOTHING });
}

/// After a dark frame the moving threshold starts again from the fixed one: the next frame has
/// the measurements of a first frame.
#[test]
fn a_dark_frame_forgets_the_moving_threshold() {
    let mut instrument = usual();
    instrument.estimator = Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.4 };
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let frames = frames(&instrument, 2);
    let (mut fresh, mut pipeline) = (pipeline(), pipeline());
    step(&mut pipeline, &config, 0, &frames[0]);
    run_frame(&mut pipeline, &config, 1, &[0; 64 * 64]);
    step(&mut pipeline, &config, 2, &frames[1]);
    step(&mut fresh, &config, 0, &frames[1]);
    assert_eq!(pipeline.measurements(), fresh.measurements());
}

#[test]
fn without_a_configuration_every_frame_is_held() {
    let config = SmallConfig::new();
    let mut pipeline = pipeline();
    assert!(pipeline.codes().is_empty());
    for number in 0..3 {
        pipeline.begin(&config, number);
        assert!(pipeline.push_row(&config, &[1, 2, 3]).is_err());
        let report = pipeline.finish(&config);
        assert_eq!(report.outcome, Outcome::Held(Hold::NotConfigured));
        assert!(pipeline.codes().is_empty());
    }
    assert_eq!(pipeline.totals().not_ready, 3);
    // As if nothing had been, once there is one.
    let instrument = usual();
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let frames = frames(&instrument, 3);
    let mut twin = self::pipeline();
    pipeline.reset(&config);
    for (number, pixels) in (0..).zip(&frames) {
        step(&mut pipeline, &config, number, pixels);
        step(&mut twin, &config, number, pixels);
        assert_same(&state(&pipeline), &state(&twin), "frame");
    }
}

/// The codes become those of the flat mirror with the first `begin` that has a configuration.
#[test]
fn a_configuration_may_come_after_the_first_begin() {
    let mut pipeline = pipeline();
    pipeline.begin(&SmallConfig::new(), 0);
    pipeline.finish(&SmallConfig::new());
    let instrument = usual();
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    pipeline.begin(&config, 1);
    // Half of the stroke of 2^16 LSB, in 2^16 codes.
    first_difference(pipeline.codes(), &[[1 << 15; 3]; 52], "flat");
}

/// Totals count from when the pipeline was made.
#[test]
fn the_first_begin_keeps_the_totals() {
    let config = usual().config::<CELLS, PIXELS, BUFFERED>();
    let mut pipeline = pipeline();
    pipeline.finish(&config);
    assert_eq!(pipeline.totals(), Totals { not_ready: 1, ..NOTHING });
    pipeline.begin(&config, 0);
    assert_eq!(pipeline.totals(), Totals { not_ready: 1, ..NOTHING });
}

/// A global tilt is used from the next `finish` on, be it the first.
#[test]
fn the_first_begin_keeps_the_global_tilt() {
    let instrument = usual();
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let mut pipeline = pipeline();
    pipeline.set_global_tilt(GlobalTilt { tilt_ulp: [1000, 0], frame: 0 });
    let report = step(&mut pipeline, &config, 0, &frames(&instrument, 1)[0]);
    assert_eq!(report.global_tilt_age, Some(0));
}

/// After a reset for another mask nothing is left of the first one.
#[test]
fn a_reset_forgets_another_mask() {
    let square = Instrument { law: Law::Linear, ..Instrument::new(Mask::square(8).unwrap(), 8) };
    let smaller = Instrument { law: Law::Linear, ..Instrument::circle(6, 8) };
    let annulus = Mask::annulus(8, 0.4).unwrap().with_spider();
    let annulus = Instrument { law: Law::Linear, ..Instrument::new(annulus, 8) };
    for instrument in [usual(), smaller, annulus] {
        let first = square.config::<CELLS, PIXELS, BUFFERED>();
        let second = instrument.config::<CELLS, PIXELS, BUFFERED>();
        let (mut fresh, mut pipeline) = (pipeline(), pipeline());
        for (number, pixels) in (0..).zip(&frames(&square, 3)) {
            step(&mut pipeline, &first, number, pixels);
        }
        pipeline.reset(&second);
        let mut lights = frames(&instrument, 4);
        // One subaperture in the dark takes its neighbours' mean, and theirs alone.
        let [x0, y0] = instrument.origins[9].map(usize::from);
        for y in y0..y0 + 8 {
            let start = y * usize::from(instrument.detector.width) + x0;
            lights[2][start..start + 8].fill(0);
        }
        for (number, pixels) in (0..).zip(&lights) {
            step(&mut fresh, &second, number, pixels);
            step(&mut pipeline, &second, number, pixels);
            let count = instrument.count();
            assert_same(
                &state(&pipeline),
                &state(&fresh),
                &format!("{count} after 64, frame {number}"),
            );
        }
    }
}

#[test]
fn a_reset_is_a_fresh_start() {
    for estimator in estimators() {
        let mut instrument = usual();
        instrument.estimator = estimator;
        instrument.delay_frames = 2;
        let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
        let frames = frames(&instrument, 6);
        let (mut fresh, mut pipeline) = (pipeline(), pipeline());
        pipeline.set_global_tilt(GlobalTilt { tilt_ulp: [9999; 2], frame: 0 });
        for (number, pixels) in (0..).zip(&frames[..3]) {
            step(&mut pipeline, &config, number, pixels);
        }
        pipeline.begin(&config, 3);
        push(&mut pipeline, &config, &frames[3], 20);
        pipeline.reset(&config);
        first_difference(pipeline.codes(), &[[1 << 15; 3]; 52], "flat");
        assert_eq!(pipeline.totals(), NOTHING);
        assert_eq!(pipeline.push_row(&config, &[0; 64]), Err(RowError::NotBegun));
        for (number, pixels) in (0..).zip(&frames[2..]) {
            let expected = step(&mut fresh, &config, number, pixels);
            assert_eq!(step(&mut pipeline, &config, number, pixels), expected);
            assert_same(&state(&pipeline), &state(&fresh), &format!("frame {number}"));
        }
    }
}

// --- the mirror's past ---

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

/// What goes wrong in one frame of a closed loop.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Loss {
    None,
    /// Rows are missing, and `finish` says so.
    CutShort,
    /// The next frame begins before this one was finished.
    Restarted,
}

/// The commands of every frame of a loop that is closed on a constant atmosphere.
///
/// Frame k is exposed while the mirror shows what it was told after frame k - 1 - L; a frame that
/// is lost leaves the mirror as it is.
fn closed_loop(delay: u8, losses: &[Loss], global: Option<[i32; 2]>) -> Vec<Vec<[i32; 2]>> {
    let instrument = transparent(delay);
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let mut pipeline = pipeline();
    let mut rng = Rng::new(5);
    let count = instrument.count();
    let mut any = || rng.between(-1 << 18, 1 << 18);
    let atmosphere: Vec<_> = (0..count).map(|_| [any(), any()]).collect();
    // What the mirror showed, the latest last, without the global tilt.
    let mut shown = vec![vec![[0; 2]; count]; 1 + usize::from(delay)];
    let mut commands = Vec::new();
    if let Some(tilt_ulp) = global {
        pipeline.reset(&config);
        pipeline.set_global_tilt(GlobalTilt { tilt_ulp, frame: 0 });
    }
    for (number, &loss) in (0..).zip(losses) {
        let exposed = &shown[shown.len() - 1 - usize::from(delay)];
        pipeline.begin(&config, number);
        match loss {
            Loss::Restarted => {}
            Loss::CutShort => {
                let held = pipeline.finish(&config).outcome;
                assert_eq!(held, Outcome::Held(Hold::CutShort { rows: 0 }));
            }
            Loss::None => {
                pipeline.push_measurements(&config, &seen(&atmosphere, exposed)).expect("a frame");
                let report = pipeline.finish(&config);
                assert_eq!((report.outcome, report.saturated_actuators), (Outcome::Updated, 0));
                commands.push(pipeline.commands().to_vec());
            }
        }
        let [tip, tilt] = global.unwrap_or_default();
        let now = pipeline.positions().iter().map(|p| [p.tilt_ulp[0] - tip, p.tilt_ulp[1] - tilt]);
        let now = if commands.is_empty() { vec![[0; 2]; count] } else { now.collect() };
        shown.push(now);
    }
    commands
}

/// s + c_applied is the atmosphere, however late the mirror: the commands do not know the delay.
#[test]
fn the_delay_is_made_up_for() {
    let prompt = closed_loop(0, &[Loss::None; 12], None);
    for delay in 1..=3 {
        let late = closed_loop(delay, &[Loss::None; 12], None);
        for (k, (late, prompt)) in late.iter().zip(&prompt).enumerate() {
            first_difference(late, prompt, &format!("delay {delay}, frame {k}"));
        }
    }
    // Of 2^18 ulp, (1 - g)^12 is left at g = 1/2.
    for (last, before) in prompt[11].as_flattened().iter().zip(prompt[10].as_flattened()) {
        assert!((last - before).abs() <= (1 << 18 >> 11) + 2, "{last} after {before}");
    }
}

/// A lost frame is one during which the mirror kept its shape, whichever way it was lost.
#[test]
fn a_lost_frame_is_part_of_the_past() {
    let good = closed_loop(0, &[Loss::None; 10], None);
    for loss in [Loss::CutShort, Loss::Restarted] {
        for delay in 0..=3 {
            for lost in [vec![4], vec![4, 5], vec![3, 5], vec![0, 6]] {
                let mut losses = [Loss::None; 12];
                lost.iter().for_each(|&k| losses[k] = loss);
                let commands = closed_loop(delay, &losses, None);
                let kept = commands.len();
                assert_eq!(kept, 12 - lost.len());
                for (k, (found, expected)) in commands.iter().zip(&good).enumerate() {
                    let context = format!("{loss:?} at {lost:?}, delay {delay}, update {k}");
                    first_difference(found, expected, &context);
                }
            }
        }
    }
}

/// The global tilt is the natural guide star's business: the commands do not know it.
#[test]
fn commands_do_not_know_the_global_tilt() {
    let without = closed_loop(0, &[Loss::None; 8], None);
    for delay in [0, 2] {
        let with = closed_loop(delay, &[Loss::None; 8], Some([70_000, -50_000]));
        assert_eq!(with, without, "delay {delay}");
    }
}

// --- the global tilt ---

/// T (2x - (N - 1)) of piston and T of tilt are added to every segment, to the ulp.
#[test]
fn a_global_tilt_is_a_plane() {
    let instrument = usual();
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let frames = frames(&instrument, 4);
    let (mut twin, mut pipeline) = (pipeline(), pipeline());
    for (number, pixels) in (0..).zip(&frames) {
        let tilts = [[0, 0], [12_345, -6789], [-200_001, 3], [7, 150_000]];
        let [tip, tilt] = tilts[number as usize];
        pipeline.begin(&config, number);
        pipeline.set_global_tilt(GlobalTilt { tilt_ulp: [tip, tilt], frame: number });
        push(&mut pipeline, &config, pixels, 64);
        let report = pipeline.finish(&config);
        let expected = step(&mut twin, &config, number, pixels);
        assert_eq!(report.saturated_actuators, 0);
        assert_eq!(report.residual_squared, expected.residual_squared);
        assert_eq!(pipeline.commands(), twin.commands());
        let positions = pipeline.positions().iter().zip(twin.positions());
        for ((x, y), (found, plain)) in instrument.mask.cells().zip(positions) {
            let [x, y] = [x, y].map(|i| 2 * i as i32 - 7);
            assert_eq!(found.piston_ulp, plain.piston_ulp + tip * x + tilt * y);
            assert_eq!(found.tilt_ulp, [plain.tilt_ulp[0] + tip, plain.tilt_ulp[1] + tilt]);
        }
    }
}

#[test]
fn a_global_tilt_ages_and_stays() {
    let mut instrument = usual();
    instrument.global_tilt_max_age = 2;
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let pixels = &frames(&instrument, 1)[0];
    let mut pipeline = pipeline();
    let report = step(&mut pipeline, &config, 0, pixels);
    assert_eq!((report.global_tilt_age, report.global_tilt_stale), (None, false));
    // Frame numbers wrap.
    let given = u32::MAX - 1;
    pipeline.set_global_tilt(GlobalTilt { tilt_ulp: [50_000, 0], frame: given });
    for age in 0..6u32 {
        let frame = given.wrapping_add(age);
        let report = step(&mut pipeline, &config, frame, pixels);
        assert_eq!(report.frame, frame);
        assert_eq!(report.global_tilt_age, Some(age));
        assert_eq!(report.global_tilt_stale, age > 2);
        let [tip, _] = pipeline.positions()[0].tilt_ulp;
        assert_eq!(tip - pipeline.commands()[0][0], 50_000, "in use, however old");
    }
    assert_eq!(pipeline.totals(), Totals { updated: 7, stale_tilt: 3, ..NOTHING });
    pipeline.set_global_tilt(GlobalTilt { tilt_ulp: [0; 2], frame: 10 });
    let report = step(&mut pipeline, &config, 11, pixels);
    assert_eq!((report.global_tilt_age, report.global_tilt_stale), (Some(1), false));
}

/// A tilt stamped with a frame that is yet to come is the freshest there is.
#[test]
fn a_global_tilt_from_ahead_is_not_stale() {
    let instrument = usual();
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let pixels = &frames(&instrument, 1)[0];
    let mut pipeline = pipeline();
    pipeline.reset(&config);
    pipeline.set_global_tilt(GlobalTilt { tilt_ulp: [0; 2], frame: 6 });
    let report = step(&mut pipeline, &config, 5, pixels);
    assert_eq!((report.global_tilt_age, report.global_tilt_stale), (Some(0), false));
}

#[test]
fn a_global_tilt_saturates() {
    let mut instrument = usual();
    instrument.estimator = Estimator::CentreOfGravity;
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let pixels = &frames(&instrument, 1)[0];
    for (given, used) in [(i32::MAX, TILT_LIMIT), (i32::MIN, -TILT_LIMIT)] {
        let (mut twin, mut pipeline) = (pipeline(), pipeline());
        pipeline.reset(&config);
        twin.reset(&config);
        pipeline.set_global_tilt(GlobalTilt { tilt_ulp: [given; 2], frame: 0 });
        twin.set_global_tilt(GlobalTilt { tilt_ulp: [used; 2], frame: 0 });
        let expected = step(&mut twin, &config, 0, pixels);
        assert_eq!(step(&mut pipeline, &config, 0, pixels), expected);
        assert_same(&state(&pipeline), &state(&twin), "frame");
        assert!(expected.saturated_actuators > 0);
    }
}

/// A held frame keeps its codes whatever tilt has come in the meantime.
#[test]
fn a_held_frame_does_not_take_the_global_tilt() {
    let instrument = usual();
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let frames = frames(&instrument, 2);
    let mut pipeline = pipeline();
    step(&mut pipeline, &config, 0, &frames[0]);
    let before = state(&pipeline);
    pipeline.set_global_tilt(GlobalTilt { tilt_ulp: [100_000; 2], frame: 1 });
    short(&mut pipeline, &config, &frames[1], 40);
    assert_same(&state(&pipeline), &before, "held");
}

// --- banks ---

/// A bank is its specification: which of two it is, and when they are exchanged, does not matter.
#[test]
fn equal_banks_are_one() {
    for estimator in estimators() {
        let mut instrument = usual();
        instrument.estimator = estimator;
        instrument.delay_frames = 1;
        let banks = [(); 2].map(|()| instrument.config::<CELLS, PIXELS, BUFFERED>());
        let (mut twin, mut pipeline) = (pipeline(), pipeline());
        for (number, pixels) in (0..).zip(&frames(&instrument, 6)) {
            step(&mut twin, &banks[0], number, pixels);
            step(&mut pipeline, &banks[number as usize % 2], number, pixels);
            assert_same(&state(&pipeline), &state(&twin), &format!("frame {number}"));
        }
    }
}

/// A new dark map for a detector whose dark level moved: nothing else moves.
#[test]
fn a_new_dark_map_takes_over_at_a_frame_boundary() {
    for estimator in estimators() {
        let mut instrument = usual();
        instrument.estimator = estimator;
        instrument.detector.bits = 16;
        let old = instrument.config::<CELLS, PIXELS, BUFFERED>();
        instrument.dark_adu = Values::Uniform(400.0);
        let new = instrument.config::<CELLS, PIXELS, BUFFERED>();
        let (mut twin, mut pipeline) = (pipeline(), pipeline());
        for (number, pixels) in (0..).zip(&frames(&instrument, 6)) {
            step(&mut twin, &old, number, pixels);
            let drifted: Vec<u16> = pixels.iter().map(|p| p + 300).collect();
            let (bank, pixels) = if number < 3 { (&old, pixels) } else { (&new, &drifted) };
            step(&mut pipeline, bank, number, pixels);
            assert_same(&state(&pipeline), &state(&twin), &format!("frame {number}"));
        }
    }
}

/// A new flat map moves the codes by its own difference.
#[test]
fn a_new_flat_map_takes_over_at_a_frame_boundary() {
    let mut instrument = usual();
    let old = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let lsb_m = instrument.stroke_m / 65536.0;
    instrument.flat_m = Values::Uniform([0.5 * instrument.stroke_m + 100.0 * lsb_m; 3]);
    let new = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let (mut twin, mut pipeline) = (pipeline(), pipeline());
    for (number, pixels) in (0..).zip(&frames(&instrument, 6)) {
        step(&mut twin, &old, number, pixels);
        let moved = number >= 3;
        let report = step(&mut pipeline, if moved { &new } else { &old }, number, pixels);
        assert_eq!(report.saturated_actuators, 0);
        let codes = pipeline.codes().as_flattened().iter().zip(twin.codes().as_flattened());
        for (&found, &plain) in codes {
            // 65535 codes over 65536 LSB: a hundred codes, but for the rounding.
            let moved_by = i32::from(found) - i32::from(plain);
            let expected = if moved { 99..=101 } else { 0..=0 };
            assert!(expected.contains(&moved_by), "frame {number}: by {moved_by}");
        }
    }
}

/// A refused specification leaves the bank as it was, however late it is refused.
#[test]
fn a_refused_specification_leaves_the_bank() {
    let mut instrument = usual();
    instrument.estimator =
        Estimator::WeightedCentreOfGravity { peak_fraction: 0.1, fwhm_px: 4.0, gain: 1.5 };
    let twin_config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let mut config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let (mut twin, mut pipeline) = (pipeline(), pipeline());
    // Different throughout, and wrong in one place.
    let mut other = Instrument { law: Law::Linear, ..Instrument::circle(6, 8) };
    other.dark_adu = Values::Uniform(0.0);
    other.control_gain = Values::Uniform(1.5);
    other.estimator =
        Estimator::WeightedCentreOfGravity { peak_fraction: 0.5, fwhm_px: 1.0, gain: 1.1 };
    let last = other.count() - 1;
    let wrong: [fn(&mut Instrument, usize); 8] = [
        |i, _| i.detector.bits = 99,
        |i, last| i.origins.truncate(last),
        |i, last| i.origins[last] = i.origins[0],
        |i, _| i.gate.readout_s = 1.0,
        |i, last| {
            let mut gains = vec![0.5; last + 1];
            gains[last] = 2.0;
            i.control_gain = Values::Each(gains);
        },
        |i, last| {
            let mut responses = vec![[[0.0, i.stroke_m]; 3]; last + 1];
            responses[last][2] = [0.0; 2];
            i.response_m = Values::Each(responses);
        },
        |i, _| i.sor.cold_sweeps = Some(0),
        |i, _| i.sor.omega = Some(2.0),
    ];
    for (number, pixels) in (0..).zip(&frames(&instrument, 8)) {
        let mut refused = other.clone();
        wrong[number as usize](&mut refused, last);
        config.build(&refused.spec()).expect_err("wrong");
        step(&mut twin, &twin_config, number, pixels);
        step(&mut pipeline, &config, number, pixels);
        assert_same(&state(&pipeline), &state(&twin), &format!("after refusal {number}"));
    }
    assert_eq!(format!("{config:?}"), format!("{twin_config:?}"));
}

/// A bank that is built again is one that is built anew.
#[test]
fn a_bank_can_be_built_again() {
    let instrument = usual();
    let mut other = Instrument::new(Mask::square(7).unwrap(), 5);
    other.estimator = Estimator::Brightest { count: 3 };
    let mut config = other.config::<CELLS, PIXELS, BUFFERED>();
    config.build(&instrument.spec()).expect("valid");
    let anew = instrument.config::<CELLS, PIXELS, BUFFERED>();
    assert_eq!(format!("{config:?}"), format!("{anew:?}"));
}

// --- capacities and placement ---

fn codes_of<const M: usize, const P: usize, const B: usize>(
    instrument: &Instrument,
    frames: &[Vec<u16>],
) -> Vec<Vec<[u16; 3]>> {
    let config = instrument.config::<M, P, B>();
    let mut pipeline = Box::new(Pipeline::<M, B>::new());
    let numbered = (0..).zip(frames);
    numbered
        .map(|(number, pixels)| {
            step(&mut pipeline, &config, number, pixels);
            pipeline.codes().to_vec()
        })
        .collect()
}

#[test]
fn capacities_do_not_matter() {
    with_big_stack(|| {
        for estimator in estimators() {
            let mut instrument = usual();
            instrument.estimator = estimator;
            instrument.delay_frames = 1;
            let frames = frames(&instrument, 4);
            // The least that fits: 52 windows of 64 pixels, eight of them side by side.
            let least = codes_of::<64, { 52 * 64 }, { 8 * 64 }>(&instrument, &frames);
            assert_eq!(codes_of::<64, 16384, 2048>(&instrument, &frames), least);
            assert_eq!(codes_of::<256, 16384, 2048>(&instrument, &frames), least);
            assert_eq!(codes_of::<1600, 65536, 8192>(&instrument, &frames), least);
        }
    });
}

/// Each subaperture's window moved to another place of a larger detector, in another order and at
/// odd positions, with light in between: the same contents give the same measurements.
#[test]
fn placement_does_not_matter() {
    for estimator in estimators() {
        let mut near = usual();
        near.estimator = estimator;
        // A calibration of its own for each pixel, which moves with it.
        let mut rng = Rng::new(21);
        let count = near.count();
        let mut map = |low, high| -> Vec<f64> {
            (0..64 * 64).map(|_| f64::from(rng.between(low, high)) / 100.0).collect()
        };
        let (dark, gain, noise) = (map(5000, 15_000), map(50, 200), map(0, 300));
        near.bad = vec![[20, 4], [21, 4], [33, 30]];
        let frames = frames(&near, 4);

        // Cells of 13 pixels, nine by nine; windows at 0 to 5 pixels inside their cell.
        let side = 9 * 13;
        let mut cells: Vec<usize> = (0..81).collect();
        for i in (1..81).rev() {
            cells.swap(i, rng.below(i as u32 + 1) as usize);
        }
        let mut far = near.clone();
        far.detector.width = side as u16;
        far.detector.height = side as u16;
        far.origins = cells[..count]
            .iter()
            .map(|cell| [cell % 9, cell / 9].map(|i| (13 * i) as u16 + rng.below(6) as u16))
            .collect();

        // Where each pixel of the near detector went.
        let mut moved = Vec::new();
        for (from, to) in near.origins.iter().zip(&far.origins) {
            for (x, y) in (0..64u16).map(|i| (i % 8, i / 8)) {
                let [a, b] = [from, to].map(|o| [usize::from(o[0] + x), usize::from(o[1] + y)]);
                moved.push((a, b));
            }
        }
        let carry = |map: &[f64], elsewhere: f64| {
            let mut carried = vec![elsewhere; side * side];
            moved.iter().for_each(|&([x, y], [u, v])| carried[v * side + u] = map[y * 64 + x]);
            Values::Each(carried)
        };
        (far.dark_adu, far.pixel_gain) = (carry(&dark, 0.0), carry(&gain, 1.0));
        far.noise_adu = carry(&noise, 0.0);
        (near.dark_adu, near.pixel_gain) = (Values::Each(dark), Values::Each(gain));
        near.noise_adu = Values::Each(noise);
        let is_bad = |at: [usize; 2]| near.bad.contains(&at.map(|i| i as u16));
        let bad = moved.iter().filter(|(from, _)| is_bad(*from));
        far.bad = bad.map(|(_, to)| to.map(|i| i as u16)).collect();
        far.bad.sort_by_key(|&[x, y]| (y, x));

        let near_config = near.config::<CELLS, PIXELS, BUFFERED>();
        let far_config = far.config::<CELLS, PIXELS, BUFFERED>();
        let (mut here, mut there) = (pipeline(), pipeline());
        for (number, pixels) in (0..).zip(&frames) {
            let mut scattered: Vec<u16> =
                (0..side * side).map(|_| rng.below(4096) as u16).collect();
            moved.iter().for_each(|&([x, y], [u, v])| {
                scattered[v * side + u] = pixels[y * 64 + x];
            });
            let expected = step(&mut here, &near_config, number, pixels);
            let report = step(&mut there, &far_config, number, &scattered);
            assert_eq!(report, expected, "{estimator:?}, frame {number}");
            assert_same(&state(&there), &state(&here), &format!("{estimator:?}, frame {number}"));
        }
    }
}

// --- limits ---

/// A slew limit that was not in the way changes nothing; one that was bounds every actuator.
#[test]
fn a_slew_limit_acts_only_when_it_is_reached() {
    let mut instrument = transparent(0);
    instrument.mean = MeanSlope::Keep;
    instrument.dac_bits = 16;
    let lsb_m = instrument.stroke_m / 65536.0;
    let free = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let (mut reached, mut unreached) = (0, 0);
    for slew_lsb in [1.0, 1.3, 2.0, 10.0, 100.0] {
        instrument.slew_m_per_frame = Some(slew_lsb * lsb_m);
        let limited = instrument.config::<CELLS, PIXELS, BUFFERED>();
        for part in 1..40 {
            // One subaperture tilts, by a twentieth of the limit more at a time, times g = 1/2
            // and 0.6 of a lever.
            let tilt = (part as f64 * slew_lsb * 512.0 / 20.0 / 0.3) as i32;
            let mut atmosphere = vec![[0; 2]; 52];
            atmosphere[20] = [0, tilt];
            let measured = seen(&atmosphere, &vec![[0; 2]; 52]);
            let [mut a, mut b] = [(); 2].map(|()| pipeline());
            for (pipeline, config) in [(&mut a, &free), (&mut b, &limited)] {
                pipeline.begin(config, 0);
                pipeline.push_measurements(config, &measured).expect("a frame");
            }
            let (flat, moved) = (b.codes().to_vec(), a.finish(&free));
            let report = b.finish(&limited);
            assert_eq!(moved.slewed_actuators, 0);
            if report.slewed_actuators == 0 {
                unreached += 1;
                assert_same(&state(&b), &state(&a), &format!("{slew_lsb} LSB, part {part}"));
            } else {
                reached += 1;
            }
            let steps = b.codes().as_flattened().iter().zip(flat.as_flattened());
            for (&code, &from) in steps {
                // Half a code of rounding at either end.
                let step = f64::from(code.abs_diff(from));
                assert!(step <= slew_lsb + 1.0, "{step} codes in a frame of {slew_lsb}");
            }
        }
    }
    assert!(reached > 20 && unreached > 20, "{reached} and {unreached}");
}

/// The position that a segment is said to have is the one that its codes show, limits or not.
#[test]
fn positions_are_what_the_codes_show() {
    for piston in [1.0, 0.5, 3.0, 0.75, 3.5] {
        let mut instrument = transparent(0);
        // Multiples of 2^-13, which are stored exactly.
        let segment = [[piston, 0.0, 2.0], [piston, -1.5, -1.0], [piston, 1.5, -1.0]];
        instrument.matrix = Values::Uniform(segment);
        let [low, high] = [0.25, 0.625].map(|part| part * instrument.stroke_m);
        instrument.limits_m = Values::Uniform([[low, high]; 3]);
        let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
        let mut rng = Rng::new(31);
        let mut pipeline = pipeline();
        let mut limited = 0;
        for number in 0..20 {
            let largest = 1 << (14 + number / 2);
            let mut any = || rng.between(-largest, largest);
            let tilts: Vec<_> = (0..52).map(|_| [any(), any()]).collect();
            pipeline.begin(&config, number as u32);
            let measured = seen(&tilts, &vec![[0; 2]; 52]);
            pipeline.push_measurements(&config, &measured).expect("a frame");
            limited += pipeline.finish(&config).saturated_actuators;
            for (position, codes) in pipeline.positions().iter().zip(pipeline.codes()) {
                let [tip, tilt] = position.tilt_ulp.map(f64::from);
                for (row, &code) in segment.iter().zip(codes) {
                    let height =
                        row[0] * f64::from(position.piston_ulp) + row[1] * tip + row[2] * tilt;
                    // Code 65535 is the whole stroke of 2^25 ulp; flat is its middle.
                    let shown = f64::from(code) / 65535.0 * 33_554_432.0 - 16_777_216.0;
                    // Half a code, and an ulp for the rounding of the product.
                    let error = (shown - height).abs();
                    let context = format!("piston influence {piston}, frame {number}");
                    assert!(error <= 0.5 * 512.01 + 2.0 + piston, "{context}: {error} ulp");
                }
            }
        }
        assert!(limited > 100, "{limited} actuators at their limits");
    }
}
