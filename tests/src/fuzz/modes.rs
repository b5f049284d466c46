//! An operator, an interlock and a detector in any order, through the controller.

use super::Bytes;
use super::rows::{SLEWS, instrument, measurement, within_slew};
use crate::instrument::Instrument;
use splash_firmware::actuators::Law;
use splash_firmware::config::Config;
use splash_firmware::controller::{Command, Controller, Start};
use splash_firmware::fault::{Fault, KINDS};
use splash_firmware::gate::Range;
use splash_firmware::interlock::{Inputs, Outputs, Times};
use splash_firmware::mirror::Serials;
use splash_firmware::mode::{MODES, Mode, Reason};
use splash_firmware::pipeline::Outcome;
use splash_firmware::segments::Position;

const CELLS: usize = 16;
const PIXELS: usize = CELLS * 16;

type Bank = Config<CELLS, PIXELS, PIXELS>;

/// Whatever is asked: only legal transitions, a closed loop with laser and voltage, nothing that moves
/// without a frame, no step beyond the slew limit, and counters that never go back.
pub(super) fn run(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    // Always with a slew limit.
    let instrument = instrument(bytes.u8() | SLEWS);
    let bank: Box<Bank> = instrument.config();
    let times = Times { settle_ticks: 2, fall_ticks: 50 };
    let mut controller = Box::new(Controller::new(Serials::default(), times, 240_000_000));
    controller.exchange(&Bank::new(), &bank, true).expect("the first configuration");
    let mut watched = Watched {
        codes: controller.codes().to_vec(),
        counts: [0; KINDS],
        mode: Mode::Safe,
        controller,
        bank,
        instrument,
        number: 0,
        ticks: 0,
    };
    while !bytes.is_empty() {
        watched.operate(&mut bytes);
    }
}

struct Watched {
    controller: Box<Controller<CELLS, PIXELS>>,
    bank: Box<Bank>,
    instrument: Instrument,
    number: u32,
    ticks: u64,
    codes: Vec<[u16; 3]>,
    counts: [u32; KINDS],
    mode: Mode,
}

impl Watched {
    fn operate(&mut self, bytes: &mut Bytes<'_>) {
        self.ticks += 1;
        let mut stepped = false;
        match bytes.u8() % 12 {
            0..=2 => {
                let command = command(bytes);
                let calibrated = bytes.u8() & 7 != 0;
                let mode = self.controller.mode();
                let asked = self.controller.request(&self.bank, command, calibrated, self.ticks);
                assert!(asked.is_ok() || self.controller.mode() == mode, "refused, and done");
                if command == Command::ClearFaults && asked.is_ok() {
                    self.counts = [0; KINDS];
                }
            }
            3 => {
                let bits = bytes.u8();
                let inputs =
                    Inputs { laser_permit: bits & 1 == 0, high_voltage_ready: bits & 2 == 0 };
                self.ready(inputs);
            }
            4 => {
                // The way up, or few sequences would find it.
                self.ready(Inputs { laser_permit: true, high_voltage_ready: true });
                let _ = self.controller.request(&self.bank, Command::Arm, true, self.ticks);
                for _ in 0..=3 {
                    self.ticks += 1;
                    self.ready(Inputs { laser_permit: true, high_voltage_ready: true });
                }
            }
            5 => {
                let fault = [Fault::Dacs, Fault::Readout, Fault::Deadline, Fault::Watchdog]
                    [usize::from(bytes.u8() & 3)];
                self.controller.fault(fault, self.ticks);
            }
            6 => {
                self.controller.missing(&self.bank, self.ticks);
                self.number = self.number.wrapping_add(1);
                stepped = true;
            }
            kind => {
                self.frame(kind, bytes);
                stepped = true;
            }
        }
        self.look(stepped);
    }

    fn ready(&mut self, inputs: Inputs) {
        let outputs = self.controller.interlock(inputs, self.ticks);
        assert!(inputs.high_voltage_ready || !outputs.high_voltage, "voltage without readiness");
        assert!(inputs.laser_permit || !outputs.laser, "laser without permit");
    }

    fn frame(&mut self, kind: u8, bytes: &mut Bytes<'_>) {
        self.number = match kind {
            7 => bytes.u32(),
            8 => self.number.wrapping_add(u32::from(bytes.u8())),
            _ => self.number.wrapping_add(1),
        };
        let pulses = if kind == 9 { u32::from(bytes.u8() % 12) } else { 10 };
        let start = Start { number: self.number, pulses, ticks: self.ticks };
        self.controller.begin(&self.bank, start);
        let count = self.bank.subapertures() - usize::from(kind == 10);
        let list: Vec<_> = (0..count).map(|_| measurement(bytes)).collect();
        // A list that is too short makes a bad frame, which `finish` books.
        let _ = self.controller.push_measurements(&self.bank, &list);
        let result = self.controller.finish(&self.bank, &mut ());
        let followed = result.report.outcome == Outcome::Updated;
        assert!(result.fault.is_none() || !followed, "a bad frame was followed: {result:?}");
    }

    fn look(&mut self, stepped: bool) {
        let codes = self.controller.codes();
        if !stepped {
            assert_eq!(codes, self.codes, "moved without a frame");
        }
        within_slew(self.instrument.law == Law::Linear, &self.codes, codes);
        self.codes = codes.to_vec();
        let counts = self.controller.faults().counts();
        assert!(counts.iter().zip(&self.counts).all(|(now, before)| now >= before), "counters");
        self.counts = *counts;
        let Outputs { high_voltage, laser } = self.controller.outputs();
        assert!(high_voltage || !laser, "laser without voltage");
        let mode = self.controller.mode();
        assert!(mode != Mode::ClosedLoop || laser, "closed loop without laser");
        let last = self.controller.modes().last().last().copied();
        if mode != self.mode {
            let last = last.expect("a change is recorded");
            assert_eq!(last.to, mode);
            let up = matches!(last.reason, Reason::Operator);
            let down =
                mode == Mode::Safe || (last.from == Mode::ClosedLoop && mode == Mode::OpenLoop);
            assert!(up || down, "{last:?}: a fault leads down only");
        }
        self.mode = mode;
    }
}

/// Any command.
fn command(bytes: &mut Bytes<'_>) -> Command {
    match bytes.u8() % 16 {
        0 => Command::Arm,
        1 => Command::Disarm,
        2 => Command::Flat,
        3 => Command::ClearFaults,
        4 => Command::Gate(Range {
            altitude_mm: bytes.u32(),
            depth_mm: bytes.u32(),
            zenith_mdeg: bytes.u32(),
        }),
        5 => {
            let subaperture = u16::from(bytes.u8() % 20);
            let position = Position {
                piston_ulp: bytes.u32() as i32,
                tilt_ulp: [(); 2].map(|()| bytes.u32() as i32),
            };
            Command::Position { subaperture, position }
        }
        6 => {
            let subaperture = u16::from(bytes.u8() % 20);
            let heights_ulp = [(); 3].map(|()| bytes.u32() as i32);
            Command::Heights { subaperture, heights_ulp }
        }
        _ => Command::Enter(MODES[usize::from(bytes.u8()) % MODES.len()]),
    }
}
