//! The global tilt: a plane, to the ulp, of any age.

use super::*;

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
