//! Laser pulses and the range gate, frame by frame.

use super::*;
use splash_firmware::fault::Fault;
use splash_firmware::gate::{GateError, Range, ShortFrame};
use splash_firmware::ladder::Rung;

fn rig(short_frame: ShortFrame) -> Rig {
    let mut instrument = instrument();
    instrument.gate.short_frame = short_frame;
    instrument.flux_min_adu = Values::Uniform(0.6 * f64::from(FLUX));
    instrument.safety.flux_min_adu = 0.6 * f64::from(FLUX) * SUBAPERTURES as f64;
    let mut rig = Rig::closed(&instrument);
    rig.frame(&frame(SHIFT));
    rig
}

/// A frame with so many of its ten pulses, and light in proportion.
fn short(rig: &mut Rig, pulses: u32) -> FrameResult {
    rig.numbered(rig.number + 1, pulses, &lit(SHIFT, FLUX * pulses / 10))
}

/// Seven pulses pass limits of 60 %; five do where limits shrink with them.
#[test]
fn a_frame_with_fewer_pulses_is_marked_scaled_or_dropped() {
    for (rule, pulses, rung) in [
        (ShortFrame::Mark, 7, Rung::Follow),
        (ShortFrame::Mark, 5, Rung::Hold),
        (ShortFrame::Scale, 7, Rung::Follow),
        (ShortFrame::Scale, 5, Rung::Follow),
        (ShortFrame::Drop, 9, Rung::Hold),
        (ShortFrame::Drop, 10, Rung::Follow),
    ] {
        let mut rig = rig(rule);
        let result = short(&mut rig, pulses);
        assert_eq!(result.rung, Some(rung), "{rule:?}, {pulses} pulses");
        let missed = 10 - pulses;
        assert_eq!((result.gate.asked, result.gate.missed()), (10, missed));
        assert_eq!(rig.controller.gate().missed(), missed);
        let booked = rig
            .controller
            .faults()
            .last()
            .any(|record| record.fault == Fault::PulsesMissed { asked: 10, seen: pulses });
        assert_eq!(booked, missed > 0);
        if rule == ShortFrame::Drop && missed > 0 {
            assert_eq!(result.fault, Some(Fault::PulsesMissed { asked: 10, seen: pulses }));
            let kinds = rig.controller.faults().counts().iter().sum::<u32>();
            assert_eq!(kinds, 1, "booked once");
        }
        assert_eq!(short(&mut rig, 10).rung, Some(Rung::Follow), "the next one as ever");
    }
}

/// A frame with half the pulses and half the light gives the codes of a whole one, where limits shrink.
#[test]
fn a_scaled_frame_is_as_valid_as_a_whole_one() {
    let (mut whole, mut half) = (rig(ShortFrame::Scale), rig(ShortFrame::Scale));
    for _ in 0..3 {
        assert_eq!(short(&mut whole, 10).report.valid, 16);
        assert_eq!(short(&mut half, 5).report.valid, 16);
        assert_eq!(whole.codes(), half.codes());
    }
}

#[test]
fn the_gate_follows_the_zenith_angle_at_frame_boundaries() {
    let mut rig = rig(ShortFrame::Mark);
    let config_range = rig.config.range();
    assert_eq!(config_range, Range { altitude_mm: 12_000_000, depth_mm: 300_000, zenith_mdeg: 0 });
    let first = rig.controller.gate().running();
    let asked = Range { zenith_mdeg: 30_000, ..config_range };
    rig.ask(Command::Gate(asked)).expect("it fits");
    assert_eq!(rig.controller.gate().running(), first);
    let result = rig.frame(&frame(SHIFT));
    assert_eq!((result.gate.range, result.gate.delay), (config_range, first.delay));
    // Longer by 1 / cos 30 degrees.
    let second = rig.controller.gate().running();
    let expected = f64::from(first.delay) * 2.0 / 3f64.sqrt();
    assert!((f64::from(second.delay) - expected).abs() <= 1.1, "{second:?}");
    let result = rig.frame(&frame(SHIFT));
    assert_eq!((result.gate.range, result.gate.delay), (asked, second.delay));

    let low = Range { zenith_mdeg: 40_000, ..config_range };
    let refused = rig.ask(Command::Gate(low));
    let Err(Refusal::Gate(GateError::Overlap { least_elevation_mdeg, .. })) = refused else {
        panic!("{refused:?}")
    };
    assert_eq!(least_elevation_mdeg, Some(54_151));
    rig.frame(&frame(SHIFT));
    assert_eq!(rig.controller.gate().range(), asked);
}
