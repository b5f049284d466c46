//! Bad frames: what they do to a closed loop, and what is booked.

use super::*;
use splash_firmware::fault::{Fault, NAMES};
use splash_firmware::ladder::Rung;
use splash_firmware::mode::{Reason, Transition};
use splash_firmware::pipeline::Hold;

fn count(rig: &Rig, name: &str) -> u32 {
    let kind = NAMES.iter().position(|&kind| kind == name).expect("a name");
    rig.controller.faults().counts()[kind]
}

/// n1 = 2 are held, n2 = 5: three leak a quarter each, the next one gives up; the ramp ends at the flat
/// map, and only the operator closes again.
#[test]
fn bad_frames_hold_leak_and_give_up_and_only_the_operator_closes_again() {
    let instrument = instrument();
    let mut rig = Rig::closed(&instrument);
    let flat = rig.codes();
    for _ in 0..8 {
        assert_eq!(rig.frame(&frame(SHIFT)).rung, Some(Rung::Follow));
    }
    let mut watch = guard::Watch::new(&instrument, rig.codes());
    let followed = rig.codes();
    let far = |codes: &[[u16; 3]]| -> i64 {
        let pairs = codes.as_flattened().iter().zip(flat.as_flattened());
        pairs.map(|(a, b)| i64::from(a.abs_diff(*b))).sum()
    };
    assert!(far(&followed) > 10_000);
    for _ in 0..2 {
        let result = rig.frame(&dark());
        assert_eq!(result.rung, Some(Rung::Hold));
        assert_eq!(result.report.outcome, Outcome::Held(Hold::NoLight));
        assert_eq!(rig.codes(), followed);
    }
    let mut distance = far(&followed);
    for _ in 0..3 {
        assert_eq!(rig.missing().rung, Some(Rung::Leak));
        watch.step(rig.codes());
        let left = far(&rig.codes());
        // Three quarters of it, to half a code each.
        assert!((left - distance * 3 / 4).abs() <= 48, "{left} of {distance}");
        distance = left;
    }
    let result = rig.frame(&dark());
    let lost = Fault::FramesLost { frames: 6 };
    assert_eq!((result.rung, result.mode), (Some(Rung::GiveUp(lost)), Mode::Safe));
    let last = *rig.controller.modes().last().last().expect("a transition");
    let expected = Transition {
        from: Mode::ClosedLoop,
        to: Mode::Safe,
        reason: Reason::Fault(lost),
        at: result.at,
    };
    assert_eq!(last, expected);
    for _ in 0..100 {
        rig.frame(&frame(SHIFT));
        watch.step(rig.codes());
        assert_eq!(rig.controller.mode(), Mode::Safe, "never by itself");
    }
    assert_eq!(rig.codes(), flat);
    assert_eq!((count(&rig, "too_few_valid"), count(&rig, "frame_missing")), (3, 3));
    assert_eq!(count(&rig, "frames_lost"), 1);

    for mode in [Mode::Standby, Mode::ClosedLoop] {
        rig.ask(Command::Enter(mode)).expect("the operator's way");
    }
    assert_eq!(rig.frame(&frame(SHIFT)).rung, Some(Rung::Follow));
    watch.step(rig.codes());
    assert_ne!(rig.codes(), flat);
}

/// A loop that was held goes on as one that never was; what was leaked is taken up without a jump.
#[test]
fn a_good_frame_goes_on_from_where_the_mirror_is() {
    let instrument = instrument();
    let (mut rig, mut twin) = (Rig::closed(&instrument), Rig::closed(&instrument));
    for rig in [&mut rig, &mut twin] {
        for _ in 0..6 {
            rig.frame(&frame(SHIFT));
        }
    }
    rig.frame(&dark());
    // Its atmosphere and mirror did not move: the centroids are the same.
    for _ in 0..3 {
        assert_eq!(rig.frame(&frame(SHIFT)).rung, Some(Rung::Follow));
        twin.frame(&frame(SHIFT));
        assert_eq!(rig.codes(), twin.codes());
    }
    for _ in 0..4 {
        rig.missing();
    }
    let mut watch = guard::Watch::new(&instrument, rig.codes());
    assert_eq!(rig.frame(&frame(SHIFT)).rung, Some(Rung::Follow));
    watch.step(rig.codes());
    assert_eq!(rig.controller.mode(), Mode::ClosedLoop);
}

#[test]
fn each_limit_of_a_frame_is_a_fault_of_its_own() {
    let mut strict = instrument();
    strict.safety.valid_min = 0.75;
    strict.safety.flux_min_adu = 0.5 * f64::from(FLUX) * SUBAPERTURES as f64;
    strict.safety.flux_max_adu = 2.0 * f64::from(FLUX) * SUBAPERTURES as f64;
    strict.safety.saturated_pixels_max = 4;
    let mut partly = frame(SHIFT);
    partly.iter_mut().take(5).for_each(|m| m.flux = 0);
    let mut saturated = frame(SHIFT);
    (saturated[0].saturated, saturated[9].saturated) = (3, 2);
    let total = |flux: u64| flux * SUBAPERTURES as u64;
    for (measurements, fault) in [
        (partly, Fault::TooFewValid { valid: 11, least: 12 }),
        (lit(0, 4_999), Fault::TotalFlux { flux: total(4_999), limit: total(5_000) }),
        (lit(0, 20_001), Fault::TotalFlux { flux: total(20_001), limit: total(20_000) }),
        (saturated, Fault::SaturatedPixels { pixels: 5, most: 4 }),
        (dark(), Fault::TooFewValid { valid: 0, least: 12 }),
        (frame(0)[..15].to_vec(), Fault::WrongRow),
    ] {
        let mut rig = Rig::closed(&strict);
        rig.frame(&frame(SHIFT));
        let codes = rig.codes();
        let result = rig.frame(&measurements);
        assert_eq!((result.fault, result.rung), (Some(fault), Some(Rung::Hold)));
        assert_eq!(rig.codes(), codes, "{fault:?}");
        let last = *rig.controller.faults().last().last().expect("a record");
        assert_eq!((last.fault, last.at), (fault, result.at));
        assert_eq!(result.at.frame, 2);
        assert_eq!(rig.frame(&frame(SHIFT)).fault, None);
    }
}

#[test]
fn numbers_that_do_not_follow_are_bad_frames_and_gaps_are_missing_ones() {
    let mut rig = Rig::closed(&instrument());
    rig.frame(&frame(SHIFT));
    for (expected, found) in [(2, 1), (2, 0)] {
        let result = rig.numbered(found, 10, &frame(SHIFT));
        let fault = Fault::FrameCounter { expected, found };
        assert_eq!((result.fault, result.rung), (Some(fault), Some(Rung::Hold)));
    }
    // The first came twice; the second took the place of the one that was due.
    rig.number = 2;
    assert_eq!(rig.frame(&frame(SHIFT)).rung, Some(Rung::Follow));
    let codes = rig.codes();
    let result = rig.numbered(rig.number + 4, 10, &frame(SHIFT));
    assert_eq!(result.rung, Some(Rung::Follow), "three that are missing, and a good one");
    assert_ne!(rig.codes(), codes);
    assert!(count(&rig, "frame_missing") >= 3);
    rig.numbered(rig.number + 9, 10, &frame(SHIFT));
    assert_eq!(rig.controller.mode(), Mode::Safe, "eight are more than n2");
}

/// A wavefront of more than the mirror's range: some actuator at its limit for 20 frames.
#[test]
fn saturation_that_lasts_opens_the_loop() {
    let mut instrument = instrument();
    instrument.safety.saturated_share = 0.0;
    instrument.safety.saturated_frames = 20;
    instrument.slope_gain_m_per_px = Values::Uniform([[2e-6, 0.0], [0.0, 2e-6]]);
    let mut rig = Rig::closed(&instrument);
    let mut watch = guard::Watch::new(&instrument, rig.codes());
    let (mut saturated, mut opened) = (0, None);
    for _ in 0..200 {
        let result = rig.frame(&frame(65536));
        watch.step(rig.codes());
        let over = result.report.saturated_actuators > 0;
        saturated = if over { saturated + 1 } else { 0 };
        if result.mode != Mode::ClosedLoop {
            opened = Some((result.mode, saturated));
            break;
        }
    }
    assert_eq!(opened, Some((Mode::OpenLoop, 20)));
    assert_eq!(count(&rig, "actuators_saturated"), 1);
    for _ in 0..100 {
        rig.frame(&frame(0));
        watch.step(rig.codes());
    }
    assert!(rig.controller.is_flat() && rig.controller.mode() == Mode::OpenLoop);
}
