//! The mirror's guard: what no mode gets past.

use super::*;
use splash_firmware::mirror::OtherHardware;
use splash_firmware::pipeline::Hold;
use splash_firmware::segments::Position;

/// Codes against an f64 model of the mechanics: one code an LSB of stroke / 65536.
pub(crate) struct Watch {
    limits: [[f64; 2]; 3],
    slew_codes: f64,
    last: Vec<[u16; 3]>,
}

impl Watch {
    pub(crate) fn new(instrument: &Instrument, codes: Vec<[u16; 3]>) -> Self {
        let codes_of = |m: f64| m / instrument.stroke_m * 65535.0;
        Self {
            limits: instrument.limits_m.at(0).map(|ends| ends.map(codes_of)),
            slew_codes: codes_of(instrument.slew_m_per_frame.expect("a limit")),
            last: codes,
        }
    }

    /// Each actuator within its limits on both sides, and no farther from the last codes than the slew
    /// limit; a code is off by half of itself at each end.
    #[track_caller]
    pub(crate) fn step(&mut self, codes: Vec<[u16; 3]>) {
        for (i, (codes, last)) in codes.iter().zip(&self.last).enumerate() {
            for (a, [low, high]) in self.limits.iter().enumerate() {
                let code = f64::from(codes[a]);
                assert!(
                    code >= low - 1.0 && code <= high + 1.0,
                    "segment {i}, actuator {a}: {code} is outside {low} to {high}"
                );
                let moved = f64::from(codes[a].abs_diff(last[a]));
                let most = self.slew_codes + 1.0;
                assert!(moved <= most, "segment {i}, actuator {a}: {moved} codes in a frame");
            }
        }
        self.last = codes;
    }
}

/// The flat map in codes, by hand.
fn flat_codes(flats: &[[f64; 3]], stroke: f64) -> Vec<[u16; 3]> {
    let code = |m: f64| ((m / stroke * 65536.0).round() * 65535.0 / 65536.0).round() as u16;
    flats.iter().map(|segment| segment.map(code)).collect()
}

fn near(found: &[[u16; 3]], expected: &[[u16; 3]], codes: u16) -> bool {
    let pairs = found.as_flattened().iter().zip(expected.as_flattened());
    found.len() == expected.len() && pairs.into_iter().all(|(a, b)| a.abs_diff(*b) <= codes)
}

#[test]
fn the_first_configuration_sets_the_flat_map_which_is_not_zero() {
    let instrument = instrument();
    let rig = Rig::new(&instrument);
    let expected = flat_codes(&flats(instrument.stroke_m, 0.0), instrument.stroke_m);
    assert!(near(&rig.codes(), &expected, 1), "{:?}", rig.codes());
    assert!(rig.codes().as_flattened().iter().all(|&code| code > 20_000));
    assert!(rig.controller.is_flat());
}

/// Frames of a configuration that was never taken over move nothing, and say so.
#[test]
fn nothing_begins_before_a_configuration_is_taken_over() {
    let config: Box<SmallConfig> = instrument().config();
    let controller = Box::new(Small::new(Serials::default(), TIMES, HZ));
    let mut rig = Rig { controller, config, number: 0, ticks: 0 };
    let result = rig.frame(&frame(SHIFT));
    assert_eq!(result.report.outcome, Outcome::Held(Hold::NotBegun));
    rig.missing();
    assert!(rig.codes().is_empty());
    assert_eq!(rig.controller.faults().counts().iter().sum::<u32>(), 1, "the frame");
    rig.up();
    let refused = rig.ask(Command::Enter(Mode::ClosedLoop));
    assert_eq!(refused, Err(Refusal::NoWay { from: Mode::Safe, to: Mode::ClosedLoop }));
}

/// Wherever a pattern asks a segment to go, every step is within limits and slew, and it arrives where
/// it may be.
#[test]
fn patterns_pass_the_guard_however_far_they_ask() {
    let instrument = instrument();
    for mode in [Mode::Calibrate, Mode::TestPattern] {
        for position in [
            Position { piston_ulp: i32::MAX, tilt_ulp: [0; 2] },
            Position { piston_ulp: i32::MIN, tilt_ulp: [0; 2] },
            Position { piston_ulp: 0, tilt_ulp: [i32::MAX, i32::MIN] },
            Position { piston_ulp: 9 << 20, tilt_ulp: [-(5 << 20), 3 << 20] },
        ] {
            let mut rig = Rig::in_mode(&instrument, mode);
            let mut watch = Watch::new(&instrument, rig.codes());
            for subaperture in 0..SUBAPERTURES as u16 {
                rig.ask(Command::Position { subaperture, position }).expect("a pattern");
            }
            let mut before = rig.codes();
            for step in 0.. {
                rig.frame(&frame(0));
                watch.step(rig.codes());
                if rig.codes() == before {
                    assert!(step > 2, "it moved");
                    break;
                }
                assert!(step < 200, "it arrives");
                before = rig.codes();
            }
        }
    }
}

/// One actuator alone goes where it is asked to, the others stay; in LSB, at a height per piston of 1.
#[test]
fn a_poke_moves_one_actuator() {
    let instrument = instrument();
    let mut rig = Rig::in_mode(&instrument, Mode::TestPattern);
    let flat = rig.codes();
    let asked = 1000;
    let command = Command::Heights { subaperture: 5, heights_ulp: [0, asked * 512, 0] };
    rig.ask(command).expect("a poke");
    for _ in 0..10 {
        rig.frame(&frame(0));
    }
    for (i, (codes, flat)) in rig.codes().iter().zip(&flat).enumerate() {
        for a in 0..3 {
            let moved = i32::from(codes[a]) - i32::from(flat[a]);
            let expected = if (i, a) == (5, 1) { asked } else { 0 };
            assert!((moved - expected).abs() <= 1, "segment {i}, actuator {a}: {moved}");
        }
    }
}

#[test]
fn a_poke_stops_at_its_limit_on_either_side() {
    let instrument = instrument();
    let stroke = instrument.stroke_m;
    for (height, expected) in [(i32::MAX, 0.8), (i32::MIN, 0.05)] {
        let mut rig = Rig::in_mode(&instrument, Mode::TestPattern);
        let flat = rig.codes()[7];
        let heights_ulp = [0, height, 0];
        rig.ask(Command::Heights { subaperture: 7, heights_ulp }).expect("a poke");
        for _ in 0..100 {
            rig.frame(&frame(0));
        }
        let codes = rig.codes()[7];
        // Tip and tilt of more than half the stroke are not in their format: it gets as far as they do.
        let reached = f64::from(codes[1]) * stroke / 65535.0;
        let toward = (expected * stroke - f64::from(flat[1]) * stroke / 65535.0).signum();
        assert!(toward * (expected * stroke - reached) >= -stroke / 65535.0, "{codes:?}");
        assert!(codes[1].abs_diff(flat[1]) > 15_000, "{codes:?} from {flat:?}");
    }
}

/// Another flat map: the codes stay, and safe ramps to the new one within limits and slew.
#[test]
fn a_configuration_with_another_flat_map_does_not_jump() {
    let first = instrument();
    let mut second = instrument();
    second.flat_m = Values::Each(flats(second.stroke_m, 0.15));
    let mut rig = Rig::closed(&first);
    for _ in 0..5 {
        rig.frame(&frame(SHIFT));
    }
    let (before, mut watch) = (rig.codes(), Watch::new(&first, rig.codes()));
    let config: Box<SmallConfig> = second.config();
    rig.controller.exchange(&rig.config, &config, true).expect("the same mask");
    rig.config = config;
    assert_eq!(rig.codes(), before);
    rig.ask(Command::Enter(Mode::Safe)).expect("always");
    while !rig.controller.is_flat() {
        rig.missing();
        watch.step(rig.codes());
    }
    let expected = flat_codes(&flats(second.stroke_m, 0.15), second.stroke_m);
    assert!(near(&rig.codes(), &expected, 1));
}

#[test]
fn a_configuration_for_another_mirror_is_refused_and_changes_nothing() {
    let known = Serials { mirror: 17, detector: 4 };
    let mut controller = Box::new(Small::new(known, TIMES, HZ));
    let nothing = Box::new(SmallConfig::new());
    let config = |mirror, detector| -> Box<SmallConfig> {
        let mut instrument = instrument();
        instrument.serials = Serials { mirror, detector };
        instrument.config()
    };
    for (mirror, detector) in [(18, 4), (17, 5), (18, 0)] {
        let refused = controller.exchange(&nothing, &config(mirror, detector), true);
        let Err(Refusal::OtherHardware(other)) = refused else { panic!("{refused:?}") };
        assert_eq!(other.made_for, Serials { mirror, detector });
        assert!(controller.codes().is_empty());
    }
    assert_eq!(controller.modes().refused(), 3);
    for (mirror, detector) in [(17, 4), (0, 4), (17, 0), (0, 0)] {
        let mut controller = Box::new(Small::new(known, TIMES, HZ));
        assert_eq!(controller.exchange(&nothing, &config(mirror, detector), true), Ok(()));
    }
}

/// What the board cannot read is stated, where nothing can come of it; what runs for other hardware stays
/// safe.
#[test]
fn hardware_is_stated_in_safe_without_high_voltage() {
    let mut made_for = instrument();
    made_for.serials = Serials { mirror: 17, detector: 4 };
    let mut rig = Rig::closed(&made_for);
    let other = Serials { mirror: 18, detector: 4 };
    let refused = rig.ask(Command::Hardware(other));
    assert_eq!(refused, Err(Refusal::WrongMode { mode: Mode::ClosedLoop }));
    rig.ask(Command::Enter(Mode::Safe)).expect("always");
    assert_eq!(rig.ask(Command::Hardware(other)), Err(Refusal::HighVoltage));
    assert_eq!(rig.controller.serials(), Serials::default());
    rig.ask(Command::Disarm).expect("always");
    while rig.controller.outputs().high_voltage {
        rig.missing();
        rig.look(READY);
    }
    assert_eq!(rig.ask(Command::Hardware(other)), Ok(()));
    assert_eq!(rig.controller.serials(), other);
    let unfit = OtherHardware { made_for: made_for.serials, found: other };
    for command in [Command::Arm, Command::Enter(Mode::Standby)] {
        let refusals = rig.controller.modes().refused();
        assert_eq!(rig.ask(command), Err(Refusal::OtherHardware(unfit)));
        assert_eq!(rig.controller.modes().refused(), refusals + 1);
    }
    assert_eq!(
        rig.ask(Command::Enter(Mode::Safe)),
        Err(Refusal::NoWay { from: Mode::Safe, to: Mode::Safe })
    );
    rig.ask(Command::Hardware(made_for.serials)).expect("safe");
    rig.close();
}

/// Another mask means another order of the actuators: only for a mirror that is safe and flat.
#[test]
fn another_mask_waits_for_a_flat_mirror() {
    let mut other = instrument();
    let hole = |x: usize, y: usize| (x, y) != (1, 2);
    other.mask = Mask::from_fn(4, hole).expect("a mask");
    other.origins.remove(9);
    other.flat_m = Values::Uniform([other.stroke_m / 2.0; 3]);
    let config: Box<SmallConfig> = other.config();
    let mut rig = Rig::closed(&instrument());
    rig.frame(&frame(SHIFT));
    let refused = rig.controller.exchange(&rig.config, &config, true);
    assert_eq!(refused, Err(Refusal::WrongMode { mode: Mode::ClosedLoop }));
    rig.ask(Command::Enter(Mode::Safe)).expect("always");
    assert_eq!(rig.controller.exchange(&rig.config, &config, true), Err(Refusal::NotFlat));
    rig.settle();
    rig.controller.exchange(&rig.config, &config, true).expect("flat");
    assert_eq!(rig.controller.codes().len(), SUBAPERTURES - 1);
}

/// From any shape, in no more steps than the longest way takes at half the slew limit.
#[test]
fn the_emergency_ramp_arrives_within_limits_and_slew() {
    let instrument = instrument();
    let mut rig = Rig::in_mode(&instrument, Mode::TestPattern);
    for subaperture in 0..SUBAPERTURES as u16 {
        let piston_ulp = if subaperture.is_multiple_of(2) { i32::MAX } else { i32::MIN };
        let position = Position { piston_ulp, tilt_ulp: [0; 2] };
        rig.ask(Command::Position { subaperture, position }).expect("a pattern");
    }
    for _ in 0..60 {
        rig.frame(&frame(0));
    }
    assert!(!rig.controller.is_flat());
    let mut watch = Watch::new(&instrument, rig.codes());
    let mut steps = 0;
    rig.controller.emergency(&rig.config, |codes| {
        watch.step(codes.to_vec());
        steps += 1;
    });
    assert!(rig.controller.is_flat());
    assert!(steps > 10 && steps <= 2 * 50 + 3, "{steps}");
}
