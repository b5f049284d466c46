//! The mode machine, checked exhaustively: every event in every state that events lead to, with mode,
//! interlock, ladder and mirror as one machine, against rules written down here and nowhere else.

use super::*;
use splash_firmware::fault::Fault;
use splash_firmware::interlock::Outputs;
use splash_firmware::mode::{MODES, Reason};
use splash_firmware::segments::Position;
use std::collections::hash_map::Entry;
use std::collections::{BTreeSet, HashMap, VecDeque};

/// Everything that can happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    Enter(Mode),
    EnterUncalibrated,
    Arm,
    Disarm,
    Poke,
    Flat,
    Good,
    Dark,
    Short,
    Repeated,
    Missing,
    Gap,
    Look { laser_permit: bool, high_voltage_ready: bool },
    Dacs,
    Readout,
}

fn events() -> Vec<Event> {
    let looks = [(true, true), (true, false), (false, true), (false, false)];
    let look =
        |(laser_permit, high_voltage_ready)| Event::Look { laser_permit, high_voltage_ready };
    let mut events: Vec<Event> = MODES.into_iter().map(Event::Enter).collect();
    events.extend([
        Event::EnterUncalibrated,
        Event::Arm,
        Event::Disarm,
        Event::Poke,
        Event::Flat,
        Event::Good,
        Event::Dark,
        Event::Short,
        Event::Repeated,
        Event::Missing,
        Event::Gap,
        Event::Dacs,
        Event::Readout,
    ]);
    events.extend(looks.map(look));
    events
}

/// What the rules speak of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct State {
    mode: Mode,
    outputs: Outputs,
    flat: bool,
    bad: u16,
    inputs: Inputs,
    /// The laser was lost, or disarmed, since the high voltage came on.
    falling: bool,
    /// Ticks since it came on or was armed again, as far as they matter.
    age: u64,
}

struct Machine {
    rig: Rig,
    inputs: Inputs,
    falling: bool,
    armed_at: u64,
}

impl Machine {
    fn new(instrument: &Instrument) -> Self {
        let rig = Rig::new(instrument);
        Self { rig, inputs: Inputs::default(), falling: false, armed_at: 0 }
    }

    fn state(&self) -> State {
        let controller = &self.rig.controller;
        // Outside of a closed loop its count means nothing.
        let closed = controller.mode() == Mode::ClosedLoop;
        let outputs = controller.outputs();
        let waits = outputs.high_voltage && !outputs.laser && !self.falling;
        let passed = (self.rig.ticks - self.armed_at).min(TIMES.settle_ticks);
        State {
            mode: controller.mode(),
            outputs,
            falling: self.falling && outputs.high_voltage,
            age: if waits { passed } else { 0 },
            flat: controller.is_flat(),
            bad: if closed { controller.ladder().bad() } else { 0 },
            inputs: self.inputs,
        }
    }

    /// Whether it was refused.
    fn apply(&mut self, event: Event) -> bool {
        let before = self.state();
        let refused = self.happen(event);
        let lost = matches!(event, Event::Look { laser_permit: false, .. });
        if before.outputs.high_voltage && (event == Event::Disarm || lost) {
            self.falling = true;
        }
        if event == Event::Arm && !refused && (self.falling || !before.outputs.high_voltage) {
            (self.falling, self.armed_at) = (false, self.rig.ticks);
        }
        refused
    }

    fn happen(&mut self, event: Event) -> bool {
        let rig = &mut self.rig;
        let refused = match event {
            Event::Enter(mode) => rig.ask(Command::Enter(mode)),
            Event::EnterUncalibrated => rig.ask_calibrated(Command::Enter(Mode::ClosedLoop), false),
            Event::Arm => rig.ask(Command::Arm),
            Event::Disarm => rig.ask(Command::Disarm),
            Event::Poke => {
                let position = Position { piston_ulp: 1 << 20, tilt_ulp: [0; 2] };
                rig.ask(Command::Position { subaperture: 3, position })
            }
            Event::Flat => rig.ask(Command::Flat),
            _ => Ok(()),
        }
        .is_err();
        let next = rig.number.wrapping_add(1);
        let exposure = match event {
            Event::Good => Some((next, frame(SHIFT))),
            Event::Dark => Some((next, dark())),
            Event::Short => Some((next, frame(SHIFT)[..3].to_vec())),
            Event::Repeated => Some((rig.number, frame(SHIFT))),
            Event::Gap => Some((next.wrapping_add(8), frame(SHIFT))),
            _ => None,
        };
        if let Some((number, measurements)) = exposure {
            rig.numbered(number, 10, &measurements);
        }
        match event {
            Event::Missing => {
                rig.missing();
            }
            Event::Look { laser_permit, high_voltage_ready } => {
                self.inputs = Inputs { laser_permit, high_voltage_ready };
                rig.look(self.inputs);
            }
            Event::Dacs => rig.controller.fault(Fault::Dacs, rig.ticks),
            Event::Readout => rig.controller.fault(Fault::Readout, rig.ticks),
            _ => {}
        }
        refused
    }
}

/// Ways of an operator, as the requirements have them: what must be there, and whether it leads on.
fn way(state: &State, to: Mode, calibrated: bool) -> bool {
    let State { mode, outputs, flat, .. } = *state;
    let voltage = outputs.high_voltage && !state.falling;
    match to {
        Mode::Safe => mode != Mode::Safe,
        Mode::Standby => match mode {
            Mode::Standby => false,
            Mode::Safe => flat,
            _ => true,
        },
        Mode::Calibrate | Mode::TestPattern => mode == Mode::Standby && voltage,
        Mode::OpenLoop => mode == Mode::ClosedLoop || mode == Mode::Standby && voltage,
        Mode::ClosedLoop => {
            let from = mode == Mode::Standby || mode == Mode::OpenLoop;
            from && voltage && outputs.laser && calibrated
        }
    }
}

/// The mode after an event: n1 = 2, n2 = 5.
fn next_mode(state: &State, event: Event) -> Mode {
    let State { mode, outputs, bad, .. } = *state;
    let armed = outputs.high_voltage;
    let wants_laser = armed && !state.falling;
    let bad_frames = |count: u16| {
        let lost = mode == Mode::ClosedLoop && bad + count > 5;
        if lost { Mode::Safe } else { mode }
    };
    match event {
        Event::Enter(to) if way(state, to, true) => to,
        Event::Disarm | Event::Dacs => Mode::Safe,
        Event::Dark | Event::Short | Event::Repeated | Event::Missing => bad_frames(1),
        Event::Gap => bad_frames(8),
        Event::Look { high_voltage_ready: false, .. } if armed => Mode::Safe,
        Event::Look { laser_permit: false, .. } if wants_laser => Mode::Safe,
        _ => mode,
    }
}

fn check(before: &State, after: &State, event: Event, refused: bool) {
    let context = format!("{before:?} -> {event:?} -> {after:?}");
    assert_eq!(after.mode, next_mode(before, event), "{context}");
    let expects_refusal = match event {
        Event::Enter(to) => !way(before, to, true),
        Event::EnterUncalibrated => true,
        Event::Arm => !(before.inputs.laser_permit && before.inputs.high_voltage_ready),
        Event::Poke | Event::Flat => !matches!(before.mode, Mode::Calibrate | Mode::TestPattern),
        _ => false,
    };
    assert_eq!(refused, expects_refusal, "{context}");
    if refused {
        assert_eq!(before, after, "{context}: what is refused changes nothing");
    }

    let Outputs { high_voltage, laser } = after.outputs;
    assert!(high_voltage || !laser, "{context}: no laser without high voltage");
    if let Event::Look { laser_permit, high_voltage_ready } = event {
        assert!(high_voltage_ready || !high_voltage, "{context}");
        assert!(laser_permit || !laser, "{context}");
        let dropped = before.outputs.high_voltage && !high_voltage && high_voltage_ready;
        assert!(!dropped || before.flat, "{context}: it waits for the mirror");
    } else {
        let rises = high_voltage && !before.outputs.high_voltage;
        assert!(!rises || event == Event::Arm, "{context}: only arming raises");
        assert!(!laser || before.outputs.laser, "{context}: the laser comes by time alone");
    }
    if after.mode == Mode::ClosedLoop {
        assert!(laser, "{context}");
        let closes = before.mode != Mode::ClosedLoop;
        assert!(!closes || event == Event::Enter(Mode::ClosedLoop), "{context}: by itself");
    }
    if !matches!(after.mode, Mode::Safe | Mode::Standby) {
        assert!(high_voltage, "{context}");
    }
    let moves = matches!(
        event,
        Event::Good | Event::Dark | Event::Short | Event::Repeated | Event::Missing | Event::Gap
    );
    assert!(moves || before.flat == after.flat, "{context}: only a frame's time moves the mirror");
    if before.mode == Mode::Safe && before.flat {
        assert!(after.flat, "{context}: safe is flat");
    }
}

/// Breadth first from the start, each state by the shortest way to it.
#[test]
fn every_event_in_every_state_keeps_the_rules() {
    let mut instrument = instrument();
    // A ramp of few steps.
    instrument.slew_m_per_frame = Some(instrument.stroke_m / 8.0);
    let mut ways: HashMap<State, Vec<Event>> = HashMap::new();
    let mut open = VecDeque::new();
    ways.insert(Machine::new(&instrument).state(), Vec::new());
    open.push_back(Machine::new(&instrument).state());
    let (mut steps, mut seen) = (0, BTreeSet::new());
    while let Some(state) = open.pop_front() {
        let way = ways[&state].clone();
        for event in events() {
            let mut machine = Machine::new(&instrument);
            for &event in &way {
                machine.apply(event);
            }
            let before = machine.state();
            assert_eq!(before, state, "the way leads there");
            let history = transitions(&machine);
            let refusals = machine.rig.controller.modes().refused();
            let refused = machine.apply(event);
            let after = machine.state();
            check(&before, &after, event, refused);
            check_history(&machine, history, &before, &after, event);
            let counted = machine.rig.controller.modes().refused() - refusals;
            assert_eq!(counted, u32::from(refused), "{before:?}, {event:?}");
            steps += 1;
            seen.insert((format!("{:?}", before.mode), format!("{event:?}")));
            if let Entry::Vacant(place) = ways.entry(after) {
                place.insert(way.iter().copied().chain([event]).collect());
                open.push_back(after);
            }
        }
    }
    println!("{} states, {steps} steps", ways.len());
    assert_eq!(seen.len(), MODES.len() * events().len(), "every event in every mode");
    assert!(ways.len() > 50, "{}", ways.len());
}

fn transitions(machine: &Machine) -> usize {
    machine.rig.controller.modes().last().count()
}

/// A change of mode is one record, with who did it; nothing else is any.
fn check_history(
    machine: &Machine,
    before_count: usize,
    before: &State,
    after: &State,
    event: Event,
) {
    let modes = machine.rig.controller.modes();
    let context = format!("{before:?} -> {event:?} -> {after:?}");
    let changed = before.mode != after.mode;
    let count = modes.last().count();
    // The ring holds 16, and the shortest ways are shorter.
    assert_eq!(count, before_count + usize::from(changed), "{context}");
    if changed {
        let last = modes.last().last().expect("a record");
        assert_eq!((last.from, last.to), (before.mode, after.mode), "{context}");
        let operator = matches!(event, Event::Enter(_) | Event::Disarm);
        assert_eq!(last.reason == Reason::Operator, operator, "{context}");
    }
}
