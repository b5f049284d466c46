//! What is not a good frame: it changes nothing, says so, and leaves no trace.

use super::*;

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
/// the sums of a first frame. (Its peaks are looked for where the spots last were.)
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
    let sums = |m: &Measurement| (m.centroid_q16, m.flux);
    assert!(pipeline.measurements().iter().map(sums).eq(fresh.measurements().iter().map(sums)));
}
