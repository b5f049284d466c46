//! What the board does with the controller: interlock, gate, pulses, frames that do not come, telemetry, and
//! the ramp of a program that has ended.

use crate::rig::{FRAME_CYCLES, Main, PULSES, Rig, bank_of, detector_frames, instrument};
use splash_firmware::controller::Command;
use splash_firmware::fault::Fault;
use splash_firmware::gate::Range;
use splash_firmware::interlock::{Inputs, Outputs};
use splash_firmware::mode::{Mode, Reason};
use splash_firmware::segments::ACTUATORS;
use splash_firmware::telemetry::{Decimation, Record};
use splash_tests::instrument::Instrument;
use stm32h743_logic::clocks::CORE_HZ;
use stm32h743_logic::frame_loop::RECORDS;

const UP: Outputs = Outputs { high_voltage: true, laser: true };
const VOLTAGE: Outputs = Outputs { high_voltage: true, laser: false };
const DOWN: Outputs = Outputs { high_voltage: false, laser: false };

/// One whose actuators go a hundredth of their stroke in a frame, by a linear law: 655 codes of 65 536.
fn slow() -> Instrument {
    let mut instrument = instrument();
    instrument.law = splash_firmware::actuators::Law::Linear;
    instrument.slew_m_per_frame = Some(instrument.stroke_m / 100.0);
    instrument
}
const SLOW_CODES: u16 = 656;

/// The flat map: half of the stroke.
fn flat(codes: &[[u16; ACTUATORS]]) -> bool {
    codes.as_flattened().iter().all(|code| code.abs_diff(1 << 15) <= 1)
}

/// The farthest that an actuator goes between two sets of codes.
fn step(before: &[[u16; ACTUATORS]], after: &[[u16; ACTUATORS]]) -> u16 {
    let pairs = before.as_flattened().iter().zip(after.as_flattened());
    pairs.map(|(before, after)| before.abs_diff(*after)).max().unwrap_or(0)
}

#[test]
fn high_voltage_comes_first_and_the_laser_when_it_has_settled() {
    let (mut rig, mut main) = Rig::new();
    rig.run();
    assert_eq!(rig.hardware.outputs, DOWN);
    main.operator(&mut rig, Command::Arm);
    assert_eq!(rig.hardware.outputs, VOLTAGE);
    // 100 ms, less what the model's counter counts by itself.
    rig.pass(CORE_HZ / 10 - 1000);
    assert_eq!(rig.hardware.outputs, VOLTAGE);
    rig.pass(1000);
    assert_eq!(rig.hardware.outputs, UP);
}

#[test]
fn a_lost_permit_takes_the_laser_at_once_and_the_mirror_to_flat_before_the_high_voltage() {
    let (mut rig, mut main) = Rig::closed(bank_of(&slow()));
    let frames = detector_frames(12);
    for (pixels, number) in frames.iter().zip(0..) {
        rig.frame(PULSES * number, pixels);
    }
    let mut before = rig.sent().last().cloned().expect("codes");
    assert!(!flat(&before));
    rig.hardware.inputs = Inputs { laser_permit: false, high_voltage_ready: true };
    rig.run();
    assert_eq!(rig.hardware.outputs, VOLTAGE);
    let books = main.books(&mut rig);
    let last = books.transitions.last().expect("a transition");
    assert_eq!((last.to, last.reason), (Mode::Safe, Reason::Fault(Fault::LaserPermit)));
    // The detector stands still: the ramp goes on by the clock.
    let mut steps = 0;
    while rig.hardware.outputs == VOLTAGE {
        rig.pass(FRAME_CYCLES);
        for codes in rig.sent() {
            assert!(step(&before, &codes) <= SLOW_CODES);
            before = codes;
        }
        steps += 1;
        assert!(steps < 100, "the stroke is a hundred steps");
    }
    assert!(flat(&before) && steps > 1, "{steps}");
    assert_eq!(rig.hardware.outputs, DOWN);
}

#[test]
fn high_voltage_that_is_not_ready_takes_everything_at_once() {
    let (mut rig, mut main) = Rig::reading();
    assert_eq!(rig.hardware.outputs, UP);
    rig.hardware.inputs.high_voltage_ready = false;
    rig.run();
    assert_eq!(rig.hardware.outputs, DOWN);
    assert_eq!(main.books(&mut rig).mode, Mode::Safe);
}

/// A frame is missing half a frame's time after it was due; 10 are held, and after 1000 the loop is given up.
#[test]
fn frames_that_do_not_come_climb_the_ladder_by_the_clock() {
    let (mut rig, mut main) = Rig::reading();
    let frames = detector_frames(3);
    rig.frame(0, &frames[0]);
    rig.pass(FRAME_CYCLES);
    assert_eq!(main.books(&mut rig).faults[Fault::FrameMissing.kind()], 0, "not yet");
    let held = rig.sent().last().cloned().expect("codes");
    for missing in 1..=1001 {
        let passed = if missing == 1 { FRAME_CYCLES / 2 } else { FRAME_CYCLES };
        rig.pass(passed);
        let codes = rig.sent();
        assert_eq!(codes.len(), 1, "{missing}");
        assert_eq!(codes[0] == held, missing <= 10, "{missing}");
        rig.told();
    }
    let books = main.books(&mut rig);
    assert_eq!(books.faults[Fault::FrameMissing.kind()], 1001);
    assert_eq!(books.mode, Mode::Safe);
    // The next one that comes has the next number.
    rig.frame(PULSES * 1002, &frames[1]);
    assert_eq!(main.books(&mut rig).last.expect("a frame").report.frame, 1002);
    assert_eq!(
        main.books(&mut rig).faults[Fault::FrameCounter { expected: 0, found: 0 }.kind()],
        0
    );
}

/// A detector that stops in the middle of a frame.
#[test]
fn a_frame_that_does_not_go_on_ends() {
    let (mut rig, mut main) = Rig::reading();
    rig.rows(0, &detector_frames(1)[0][..20 * 64]);
    rig.pass(FRAME_CYCLES * 3 / 2);
    let last = main.books(&mut rig).last.expect("a frame");
    assert_eq!(last.fault, Some(Fault::FrameShort { rows: 16 }));
}

#[test]
fn pulses_of_each_frame_are_counted() {
    let (mut rig, mut main) = Rig::reading();
    let frames = detector_frames(4);
    for (stamp, seen) in [(0, PULSES), (10, PULSES), (18, 8), (28, PULSES)] {
        rig.frame(stamp, &frames[0]);
        assert_eq!(main.books(&mut rig).last.expect("a frame").gate.seen, seen, "{stamp}");
    }
    assert_eq!(main.books(&mut rig).faults[Fault::PulsesMissed { asked: 0, seen: 0 }.kind()], 1);
}

/// At 30 degrees from the zenith light takes 1 / cos 30 as long; at 60 twice as long, which is longer than
/// from one pulse to the next.
#[test]
fn the_gate_is_set_when_a_frame_begins() {
    let (mut rig, mut main) = Rig::reading();
    let frames = detector_frames(3);
    assert_eq!(rig.hardware.gates.len(), 0, "shut before the first frame");
    rig.frame(0, &frames[0]);
    let zenith = rig.hardware.gates.clone();
    assert_eq!((zenith.len(), zenith[0].compare), (1, 18_973));
    let range = Range { altitude_mm: 12_000_000, depth_mm: 300_000, zenith_mdeg: 30_000 };
    main.operator(&mut rig, Command::Gate(range));
    assert_eq!(rig.hardware.gates, zenith, "not in the middle of an exposure");
    rig.frame(PULSES, &frames[1]);
    let exact = 2.0 * 11_850.0 * 240e6 / (299_792_458.0 * 30f64.to_radians().cos());
    assert_eq!(rig.hardware.gates.len(), 2);
    assert_eq!(f64::from(rig.hardware.gates[1].compare), exact.round());
    // That frame was exposed through the gate before.
    let gate = |main: &mut Main, rig: &mut Rig| main.books(rig).last.expect("a frame").gate;
    assert_eq!(gate(&mut main, &mut rig).range.zenith_mdeg, 0);
    rig.frame(2 * PULSES, &frames[2]);
    assert_eq!(gate(&mut main, &mut rig).range.zenith_mdeg, 30_000);
    let steep = Range { zenith_mdeg: 60_000, ..range };
    let refused = main.asking.operator(Command::Gate(steep), &mut || {
        rig.run();
        true
    });
    assert!(refused.is_err(), "it overlaps the next pulse");
}

#[test]
fn telemetry_comes_while_the_link_takes_it_and_is_counted_where_not() {
    let (mut rig, mut main) = Rig::reading();
    let frames = detector_frames(1);
    let every_second = Decimation { frames: 2, ..Decimation::OFF };
    main.asking.streams(Some(every_second), &mut || {
        rig.run();
        true
    });
    let numbers = |main: &mut Main, rig: &mut Rig| {
        let mut numbers = Vec::new();
        loop {
            let Some(record) = main.telemetry.dequeue() else { return numbers };
            let Record::Frame(frame) = record else { panic!("{record:?}") };
            assert!(frame.configuration != 0 && frame.tilt_squared_ulp2 > 0);
            numbers.push(frame.result.report.frame);
            rig.run();
        }
    };
    for number in 0..10 {
        rig.frame(PULSES * number, &frames[0]);
    }
    assert_eq!(numbers(&mut main, &mut rig), [0, 2, 4, 6, 8]);
    for number in 10..200 {
        rig.frame(PULSES * number, &frames[0]);
    }
    // Three wait in the queue, the last ones in the ring; the 95 others are counted.
    let kept = numbers(&mut main, &mut rig);
    let last: Vec<_> = (200 - 2 * RECORDS as u32..200).step_by(2).collect();
    assert_eq!(kept, [[10, 12, 14].as_slice(), &last].concat());
    let (_, dropped) = main.asking.streams(None, &mut || {
        rig.run();
        true
    });
    assert_eq!(dropped[0] as usize, 95 - 3 - RECORDS);
}

/// As a panic handler does it, from the middle of a frame.
#[test]
fn a_program_that_has_ended_ramps_the_mirror_to_flat_in_frame_times() {
    let (mut rig, _main) = Rig::closed(bank_of(&slow()));
    let frames = detector_frames(12);
    for (pixels, number) in frames.iter().zip(0..) {
        rig.frame(PULSES * number, pixels);
    }
    rig.rows(PULSES * 12, &frames[0][..20 * 64]);
    let mut before = rig.sent().last().cloned().expect("codes");
    assert!(!flat(&before));
    let start = rig.time.get();
    let (mode, at) = rig.frames.frames().end_of_program();
    assert_eq!((mode, at.frame), (Mode::ClosedLoop, 12));
    rig.frames.frames().emergency();
    let sent = rig.sent();
    for codes in &sent {
        assert_eq!(codes.len(), 52);
        assert!(step(&before, codes) <= SLOW_CODES);
        before.clone_from(codes);
    }
    assert!(flat(&before) && sent.len() > 2);
    let took = u64::from(rig.time.get().wrapping_sub(start));
    let frames = sent.len() as u64 + 1;
    assert!(took >= frames * u64::from(FRAME_CYCLES), "the last codes are out");
    assert!(took < (frames + 1) * u64::from(FRAME_CYCLES));
}

#[test]
fn an_operator_shapes_the_mirror_in_a_test_pattern_only() {
    let (mut rig, mut main) = Rig::reading();
    let frames = detector_frames(4);
    let poke = Command::Heights { subaperture: 3, heights_ulp: [1000, 0, 0] };
    let mut ask = |rig: &mut Rig, command| {
        main.asking.operator(command, &mut || {
            rig.run();
            true
        })
    };
    assert!(ask(&mut rig, poke).is_err(), "in a closed loop");
    for command in [Command::Enter(Mode::Standby), Command::Enter(Mode::TestPattern), Command::Flat]
    {
        assert_eq!(ask(&mut rig, command), Ok(()));
    }
    rig.frame(0, &frames[0]);
    let flat = rig.sent().last().cloned().expect("codes");
    assert_eq!(ask(&mut rig, poke), Ok(()));
    rig.frame(PULSES, &frames[1]);
    let poked = rig.sent().last().cloned().expect("codes");
    let changed: Vec<_> = (0..flat.len()).filter(|&i| flat[i] != poked[i]).collect();
    assert_eq!(changed, [3]);
}
