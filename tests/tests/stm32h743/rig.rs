//! A model of the board's hardware around what it decides: a detector, a DMA that knows two buffers, the
//! two interrupts, DACs, and the main loop's ends of the queues.

use heapless::spsc::Consumer;
use splash_firmware::config::Config;
use splash_firmware::controller::{Command, Controller};
use splash_firmware::interlock::{Inputs, Outputs};
use splash_firmware::mode::Mode;
use splash_firmware::telemetry::{Record as Telemetry, Ring};
use splash_tests::frames::{Background, Rng, frame, scattered};
use splash_tests::instrument::Instrument;
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use stm32h743_logic::answers::{Books, Next};
use stm32h743_logic::asking::Asking;
use stm32h743_logic::bank::{Half, split};
use stm32h743_logic::clocks::{CORE_HZ, TIMER_HZ};
use stm32h743_logic::dac_bus::DacBus;
use stm32h743_logic::frame_loop::{Counter, FrameLoop};
use stm32h743_logic::gate::GateTimer;
use stm32h743_logic::queues::{FrameSide, Hardware, News, Queues, RowSide};
use stm32h743_logic::ring::Fault;
use stm32h743_logic::rounds::TIMES;
use stm32h743_logic::service::{SERIALS, fit};
use stm32h743_logic::shape::{RING_BYTES, Shape};

pub(crate) const M: usize = 64;
pub(crate) const P: usize = 4096;
pub(crate) type Bank = Config<M, P, 0>;
/// Laser pulses of a frame.
pub(crate) const PULSES: u32 = 10;
/// Cycles of a frame: those pulses at 10 kHz.
pub(crate) const FRAME_CYCLES: u32 = CORE_HZ / 10_000 * PULSES;

/// 8 x 8 subapertures in a circle, windows of 8 x 8 pixels.
pub(crate) fn instrument() -> Instrument {
    Instrument::circle(8, 8)
}

/// Frames of spots that wander by two pixels, with noise.
pub(crate) fn detector_frames(count: usize) -> Vec<Vec<u16>> {
    let (instrument, mut rng) = (instrument(), Rng::new(743));
    let mut one = || {
        let spots = scattered(&instrument, (900, 400, 512), &mut rng);
        frame(&instrument, &spots, &Background::DEFAULT, &mut rng)
    };
    (0..count).map(|_| one()).collect()
}

/// A bank for that instrument.
pub(crate) fn bank() -> &'static mut Bank {
    bank_of(&instrument())
}

/// A bank for another one.
pub(crate) fn bank_of(instrument: &Instrument) -> &'static mut Bank {
    let bank = Box::leak(Box::new(Config::new()));
    bank.build(&instrument.spec()).expect("valid");
    bank
}

/// As the main loop hands it over, with a calibration that fits.
pub(crate) fn next(bank: &'static mut Bank) -> Next<M, P, 0> {
    let (hash, shape) = (bank.hash(), fit(bank).expect("readable"));
    Next { bank: split(bank).0, hash, shape, calibrated: true }
}

/// DACs that keep what they were given, and are busy when they are told to.
#[derive(Clone, Default)]
pub(crate) struct Dacs {
    pub(crate) sent: Rc<RefCell<Vec<Vec<[u16; 3]>>>>,
    pub(crate) busy: Rc<Cell<bool>>,
}

impl DacBus for Dacs {
    type Error = ();

    fn update(&mut self, codes: &[[u16; 3]]) -> Result<(), ()> {
        if self.busy.get() {
            return Err(());
        }
        self.sent.borrow_mut().push(codes.to_vec());
        Ok(())
    }
}

/// A counter that counts how often it is read, and which the test moves on.
#[derive(Clone, Default)]
pub(crate) struct Reads(pub(crate) Rc<Cell<u32>>);

impl Counter for Reads {
    fn now(&self) -> u32 {
        self.0.set(self.0.get().wrapping_add(1));
        self.0.get()
    }
}

/// Both chains closed.
pub(crate) const PERMITTED: Inputs = Inputs { laser_permit: true, high_voltage_ready: true };

/// DCMI, its DMA and both interrupts; pins and the gate's timer.
pub(crate) struct Parts {
    rows: RowSide<'static>,
    ring: Vec<u16>,
    shape: Option<Shape>,
    aim: [u16; 2],
    second: bool,
    /// Pixels of the block that is being written.
    filled: usize,
    /// Waiting for a VSYNC since it was started.
    waiting: bool,
    stamp: Option<u32>,
    /// Pixels are lost before the next block is complete.
    pub(crate) overrun: bool,
    /// Blocks for which the interrupts are held up.
    pub(crate) masked: usize,
    pub(crate) inputs: Inputs,
    pub(crate) outputs: Outputs,
    /// What the gate's timer was set to.
    pub(crate) gates: Vec<GateTimer>,
    time: Rc<Cell<u32>>,
}

impl Parts {
    pub(crate) fn begin(&mut self, stamp: u32) {
        self.stamp = Some(stamp);
        self.waiting = false;
    }

    fn end(&mut self) {
        let Some(shape) = self.shape.filter(|_| !self.waiting) else { return };
        let left = shape.transfers() - (self.filled / 2) as u16;
        if !self.rows.end(left) {
            self.shape = None;
        }
    }

    fn pixel(&mut self, pixel: u16) {
        let Some(shape) = self.shape.filter(|_| !self.waiting) else { return };
        let slot = self.aim[usize::from(self.second)];
        self.ring[shape.offset(slot) / 2 + self.filled] = pixel;
        self.filled += 1;
        if self.filled == shape.pixels() {
            self.filled = 0;
            self.second = !self.second;
            if self.masked > 0 {
                self.masked -= 1;
            } else {
                self.interrupt();
            }
        }
    }

    fn interrupt(&mut self) {
        let aimed = if std::mem::take(&mut self.overrun) {
            self.rows.lost(Fault::Overrun);
            None
        } else {
            self.rows.complete(self.second, || self.stamp.take(), self.time.get())
        };
        match aimed {
            Some((complete, _)) => self.aim[usize::from(complete.second)] = complete.next,
            None => self.shape = None,
        }
    }
}

impl Hardware for Parts {
    fn pixels(&mut self, shape: &Shape, slot: u16) -> &[u16] {
        let first = shape.offset(slot) / 2;
        &self.ring[first..first + shape.pixels()]
    }

    fn wake(&mut self) {
        let Some(shape) = self.rows.order() else { return };
        self.shape = Some(shape);
        self.stamp = None;
        (self.aim, self.second, self.filled, self.waiting) = ([0, 1], false, 0, true);
    }

    fn inputs(&mut self) -> Inputs {
        self.inputs
    }

    fn enable(&mut self, outputs: Outputs) {
        self.outputs = outputs;
    }

    fn gate(&mut self, timer: GateTimer) {
        self.gates.push(timer);
    }
}

/// All of it.
pub(crate) struct Rig {
    pub(crate) hardware: Parts,
    pub(crate) frames: FrameSide<'static, Dacs, Reads, M, P, 0>,
    pub(crate) news: Consumer<'static, News>,
    pub(crate) dacs: Dacs,
    /// Cycles.
    pub(crate) time: Rc<Cell<u32>>,
    /// Frames are worked on after each row; else only when it is told to.
    pub(crate) prompt: bool,
}

/// The main loop's ends.
pub(crate) struct Main {
    pub(crate) asking: Asking<'static, M, P, 0>,
    pub(crate) telemetry: Consumer<'static, Telemetry>,
    /// Its half of the bank that runs.
    pub(crate) running: Half<M, P, 0>,
}

impl Rig {
    /// A board as it is after its start, and what its main loop has.
    pub(crate) fn new() -> (Self, Main) {
        let ends = Box::leak(Box::new(Queues::<M, P, 0>::new())).split();
        let (dacs, time) = (Dacs::default(), Reads::default());
        let (mine, theirs) = split(Box::leak(Box::new(Config::new())));
        let frames = FrameLoop::new(
            Box::leak(Box::new(Controller::new(SERIALS, TIMES, TIMER_HZ))),
            Box::leak(Box::new(Ring::new())),
            theirs,
            dacs.clone(),
            time.clone(),
        );
        let hardware = Parts {
            rows: ends.rows,
            ring: vec![0; RING_BYTES / 2],
            shape: None,
            aim: [0, 1],
            second: false,
            filled: 0,
            waiting: true,
            stamp: None,
            overrun: false,
            masked: 0,
            inputs: PERMITTED,
            outputs: Outputs::default(),
            gates: Vec::new(),
            time: time.0.clone(),
        };
        let frames = FrameSide::new(frames, ends.frames);
        let main = Main { asking: ends.asking, telemetry: ends.telemetry, running: mine };
        (Self { hardware, frames, news: ends.news, dacs, time: time.0, prompt: true }, main)
    }

    /// One that reads a detector, in a closed loop, with everything on.
    pub(crate) fn closed(bank: &'static mut Bank) -> (Self, Main) {
        let (mut rig, mut main) = Self::new();
        rig.run();
        main.operator(&mut rig, Command::Arm);
        // The high voltage settles before there is a detector whose frames could be missing.
        rig.pass(TIMES.settle_ticks as u32);
        main.exchange(&mut rig, bank);
        main.operator(&mut rig, Command::Enter(Mode::Standby));
        main.operator(&mut rig, Command::Enter(Mode::ClosedLoop));
        rig.sent();
        rig.told();
        (rig, main)
    }

    /// Such a one for the instrument.
    pub(crate) fn reading() -> (Self, Main) {
        Self::closed(bank())
    }

    /// Time passes, and the exception runs.
    pub(crate) fn pass(&mut self, cycles: u32) {
        self.time.set(self.time.get().wrapping_add(cycles));
        self.run();
    }

    /// Lets the frames' exception run.
    pub(crate) fn run(&mut self) {
        self.frames.run(&mut self.hardware);
    }

    /// A frame of rows, after so many pulses.
    pub(crate) fn frame(&mut self, stamp: u32, pixels: &[u16]) {
        self.rows(stamp, pixels);
        self.rest(&[]);
    }

    /// Its first rows.
    pub(crate) fn rows(&mut self, stamp: u32, pixels: &[u16]) {
        self.hardware.begin(stamp);
        self.read(pixels);
    }

    /// Its last rows.
    pub(crate) fn rest(&mut self, pixels: &[u16]) {
        self.read(pixels);
        self.hardware.end();
        if self.prompt {
            self.run();
        }
    }

    fn read(&mut self, pixels: &[u16]) {
        for row in pixels.chunks(instrument().detector.width.into()) {
            row.iter().for_each(|&pixel| self.hardware.pixel(pixel));
            if self.prompt {
                self.run();
            }
        }
    }

    /// What was told since this was last called.
    pub(crate) fn told(&mut self) -> Vec<News> {
        std::iter::from_fn(|| self.news.dequeue()).collect()
    }

    /// The codes that went to the DACs since this was last called.
    pub(crate) fn sent(&mut self) -> Vec<Vec<[u16; 3]>> {
        self.dacs.sent.take()
    }
}

impl Main {
    /// What an operator asks for and gets.
    pub(crate) fn operator(&mut self, rig: &mut Rig, command: Command) {
        let done = self.asking.operator(command, &mut || {
            rig.run();
            true
        });
        assert_eq!(done, Ok(()), "{command:?}");
    }

    /// Another bank at once.
    pub(crate) fn exchange(&mut self, rig: &mut Rig, bank: &'static mut Bank) {
        let exchanged = self.asking.exchange(next(bank), &mut || {
            rig.run();
            true
        });
        assert!(exchanged.is_ok(), "{exchanged:?}");
    }

    /// What the controller keeps books of.
    pub(crate) fn books(&mut self, rig: &mut Rig) -> Books {
        self.asking.books(&mut || {
            rig.run();
            true
        })
    }
}
