//! The controller as an operator and a broken instrument see it: modes, faults, guard, gate, schedule.

mod campaign;
mod gate;
mod guard;
mod ladder;
mod model;
mod schedule;

use splash_firmware::actuators::Law;
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::controller::{Command, Controller, FrameResult, Start};
use splash_firmware::geometry::Mask;
use splash_firmware::interlock::{Inputs, Times};
use splash_firmware::mirror::Serials;
use splash_firmware::mode::{Mode, Refusal};
use splash_firmware::pipeline::{Outcome, Progress};
use splash_tests::instrument::{Instrument, Values};

const CELLS: usize = 16;
const PIXELS: usize = CELLS * 4 * 4;
const SUBAPERTURES: usize = 16;

type SmallConfig = Config<CELLS, PIXELS, 0>;
type Small = Controller<CELLS, 0>;

const READY: Inputs = Inputs { laser_permit: true, high_voltage_ready: true };
const TIMES: Times = Times { settle_ticks: 2, fall_ticks: 1000 };
/// Of the gate's timer.
const HZ: u32 = 240_000_000;
/// Of a frame, ADU and flux units.
const FLUX: u32 = 10_000;

/// 4 x 4 subapertures, a code an LSB, limits that leave out both ends of the stroke, a flat map that is
/// nowhere the middle and everywhere another, and a slew limit of a fiftieth of the stroke.
fn instrument() -> Instrument {
    let mut instrument = Instrument::new(Mask::square(4).expect("a mask"), 4);
    let stroke = instrument.stroke_m;
    instrument.law = Law::Linear;
    instrument.flat_m = Values::Each(flats(stroke, 0.0));
    instrument.limits_m = Values::Uniform([
        [0.1 * stroke, 0.9 * stroke],
        [0.05 * stroke, 0.8 * stroke],
        [0.2 * stroke, 0.95 * stroke],
    ]);
    instrument.slew_m_per_frame = Some(stroke / 50.0);
    instrument.safety.hold_frames = 2;
    instrument.safety.safe_frames = 5;
    instrument.safety.leak = 0.25;
    instrument
}

/// Flat maps from 0.4 to 0.6 of the stroke, moved by a part of it.
fn flats(stroke: f64, by: f64) -> Vec<[f64; 3]> {
    let flat = |i: usize| stroke * (0.4 + by + 0.2 * i as f64 / (3 * SUBAPERTURES) as f64);
    (0..SUBAPERTURES).map(|i| [0, 1, 2].map(|a| flat(3 * i + a))).collect()
}

/// A controller, the configuration it runs, and a clock.
struct Rig {
    controller: Box<Small>,
    config: Box<SmallConfig>,
    number: u32,
    ticks: u64,
}

impl Rig {
    /// Configured and safe.
    fn new(instrument: &Instrument) -> Self {
        let config: Box<SmallConfig> = instrument.config();
        let mut controller = Box::new(Controller::new(Serials::default(), TIMES, HZ));
        let nothing = Box::new(SmallConfig::new());
        controller.exchange(&nothing, &config, true).expect("the first configuration");
        Self { controller, config, number: 0, ticks: 0 }
    }

    /// In closed loop, with everything on.
    fn closed(instrument: &Instrument) -> Self {
        let mut rig = Self::new(instrument);
        rig.close();
        rig
    }

    /// From safe, flat, to closed loop.
    fn close(&mut self) {
        self.up();
        for mode in [Mode::Standby, Mode::ClosedLoop] {
            self.ask(Command::Enter(mode)).expect("a way");
        }
    }

    /// In a mode that is entered from standby.
    fn in_mode(instrument: &Instrument, mode: Mode) -> Self {
        let mut rig = Self::new(instrument);
        rig.up();
        for mode in [Mode::Standby, mode] {
            rig.ask(Command::Enter(mode)).expect("a way");
        }
        rig
    }

    /// High voltage and laser on.
    fn up(&mut self) {
        self.look(READY);
        self.ask(Command::Arm).expect("ready");
        for _ in 0..=TIMES.settle_ticks {
            self.look(READY);
        }
        let outputs = self.controller.outputs();
        assert!(outputs.laser && outputs.high_voltage);
    }

    fn look(&mut self, inputs: Inputs) {
        self.ticks += 1;
        self.controller.interlock(inputs, self.ticks);
    }

    fn ask(&mut self, command: Command) -> Result<(), Refusal> {
        self.ask_calibrated(command, true)
    }

    fn ask_calibrated(&mut self, command: Command, calibrated: bool) -> Result<(), Refusal> {
        self.controller.request(&self.config, command, calibrated, self.ticks)
    }

    /// A frame of these measurements, all pulses there.
    fn frame(&mut self, measurements: &[Measurement]) -> FrameResult {
        self.number = self.number.wrapping_add(1);
        self.numbered(self.number, 10, measurements)
    }

    fn numbered(&mut self, number: u32, pulses: u32, all: &[Measurement]) -> FrameResult {
        self.ticks += 1;
        let start = Start { number, pulses, ticks: self.ticks };
        self.controller.begin(&self.config, start);
        let pushed = self.controller.push_measurements(&self.config, all);
        assert!(pushed != Ok(Progress::More));
        self.number = number;
        self.controller.finish(&self.config, &mut ())
    }

    fn missing(&mut self) -> FrameResult {
        self.number = self.number.wrapping_add(1);
        self.ticks += 1;
        self.controller.missing(&self.config, self.ticks)
    }

    fn codes(&self) -> Vec<[u16; 3]> {
        self.controller.codes().to_vec()
    }

    /// Missing frames until the mirror is flat.
    fn settle(&mut self) {
        for _ in 0..1000 {
            if self.controller.is_flat() {
                return;
            }
            self.missing();
        }
        panic!("the mirror does not become flat");
    }
}

/// The same centroid everywhere but for a sign that alternates, Q16 px: no global tilt.
fn frame(x_q16: i32) -> Vec<Measurement> {
    lit(x_q16, FLUX)
}

fn lit(x_q16: i32, flux: u32) -> Vec<Measurement> {
    let one = |i: usize| Measurement {
        centroid_q16: [
            if i.is_multiple_of(2) { x_q16 } else { -x_q16 },
            x_q16 / 3 * (i as i32 % 3 - 1),
        ],
        flux,
        peak: 1000,
        saturated: 0,
    };
    (0..SUBAPERTURES).map(one).collect()
}

fn dark() -> Vec<Measurement> {
    lit(0, 0)
}

/// A fifth of a pixel.
const SHIFT: i32 = 13_107;
