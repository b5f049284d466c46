//! Two banks: exchanged between frames, built again, refused.

use super::*;

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
