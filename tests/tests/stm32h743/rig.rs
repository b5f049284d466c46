//! A model of the board's hardware around what it decides: a detector, a DMA that knows two buffers, the
//! two interrupts, DACs, and the main loop's ends of the queues.

use heapless::spsc::Consumer;
use splash_firmware::config::Config;
use splash_firmware::pipeline::Pipeline;
use splash_tests::frames::{Background, Rng, frame, scattered};
use splash_tests::instrument::Instrument;
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use stm32h743_logic::asking::Asking;
use stm32h743_logic::dac_bus::DacBus;
use stm32h743_logic::frame_loop::{Counter, FrameLoop};
use stm32h743_logic::queues::{Detector, FrameSide, News, Queues, RowSide};
use stm32h743_logic::ring::Fault;
use stm32h743_logic::shape::{RING_BYTES, Shape};

pub(crate) const M: usize = 64;
pub(crate) const P: usize = 4096;
pub(crate) type Bank = Config<M, P, 0>;
/// Laser pulses of a frame.
pub(crate) const PULSES: u32 = 10;

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
    let bank = Box::leak(Box::new(Config::new()));
    bank.build(&instrument().spec()).expect("valid");
    bank
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

/// A counter that counts how often it is read.
#[derive(Default)]
pub(crate) struct Reads(Cell<u32>);

impl Counter for Reads {
    fn now(&self) -> u32 {
        self.0.set(self.0.get() + 1);
        self.0.get()
    }
}

/// DCMI, its DMA and both interrupts.
pub(crate) struct Hardware {
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
}

impl Hardware {
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
            self.rows.complete(self.second, || self.stamp.take(), 0)
        };
        match aimed {
            Some((complete, _)) => self.aim[usize::from(complete.second)] = complete.next,
            None => self.shape = None,
        }
    }
}

impl Detector for Hardware {
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
}

/// All of it.
pub(crate) struct Rig {
    pub(crate) hardware: Hardware,
    pub(crate) frames: FrameSide<'static, Dacs, Reads, M, P, 0>,
    pub(crate) news: Consumer<'static, News>,
    pub(crate) dacs: Dacs,
    /// Frames are worked on after each row; else only when it is told to.
    pub(crate) prompt: bool,
}

impl Rig {
    /// A board as it is after its start, and the main loop's way to ask.
    pub(crate) fn new() -> (Self, Asking<'static, M, P, 0>) {
        let ends = Box::leak(Box::new(Queues::<M, P, 0>::new())).split();
        let dacs = Dacs::default();
        let frames = FrameLoop::new(
            Box::leak(Box::new(Pipeline::new())),
            Box::leak(Box::new(Config::new())),
            dacs.clone(),
            Reads::default(),
        );
        let hardware = Hardware {
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
        };
        let frames = FrameSide::new(frames, ends.frames);
        (Self { hardware, frames, news: ends.news, dacs, prompt: true }, ends.asking)
    }

    /// One that reads the instrument's detector.
    pub(crate) fn reading() -> (Self, Asking<'static, M, P, 0>) {
        let (mut rig, mut asking) = Self::new();
        let bank = bank();
        let shape = Shape::new(bank.width(), bank.height(), bank.bits()).expect("readable");
        asking.exchange(bank, shape, &mut || {
            rig.run();
            true
        });
        rig.dacs.sent.borrow_mut().clear();
        (rig, asking)
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
