//! Before the first frame, and after a reset.

use super::*;

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
