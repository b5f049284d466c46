//! What is done when the main loop asks: seldom, and so not in the memory of the frame path.

use crate::dac_bus::DacBus;
use crate::frame_loop::{Counter, FrameLoop};
use crate::queues::{Answer, Command, Detector, FrameSide};
use crate::shape::Shape;
use heapless::Vec;
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::pipeline::{Report, Totals};
use splash_firmware::segments::{ACTUATORS, Position};
use splash_firmware::slopes::Slope;

/// What the last frame left.
#[derive(Clone, Debug)]
pub struct Snapshot<const M: usize> {
    /// Its report; `None` before the first frame, and after a reset.
    pub report: Option<Report>,
    /// Totals since the last reset.
    pub totals: Totals,
    /// DAC codes.
    pub codes: Vec<[u16; ACTUATORS], M>,
    /// Measurements.
    pub measurements: Vec<Measurement, M>,
    /// Slopes.
    pub slopes: Vec<Slope, M>,
    /// Positions of the segments.
    pub positions: Vec<Position, M>,
}

impl<'a, D: DacBus, C: Counter, const M: usize, const P: usize, const B: usize>
    FrameLoop<'a, D, C, M, P, B>
{
    /// Takes another bank, whose frames come as `shape` says, opens the loop and returns the bank
    /// before. A frame that is being read is dropped.
    fn exchange(&mut self, bank: &'a mut Config<M, P, B>, shape: Shape) -> &'a mut Config<M, P, B> {
        self.shape = Some(shape);
        let before = core::mem::replace(&mut self.bank, bank);
        self.reset();
        before
    }

    /// Opens the loop: the flat mirror's codes, if the DACs are free; else the next frame's follow.
    fn reset(&mut self) {
        self.next = 0;
        self.report = None;
        self.pipeline.reset(self.bank);
        let _ = self.dacs.update(self.pipeline.codes());
    }

    fn snapshot(&self) -> Snapshot<M> {
        // Each has at most M entries.
        Snapshot {
            report: self.report,
            totals: self.pipeline.totals(),
            codes: Vec::from_slice(self.pipeline.codes()).unwrap_or_default(),
            measurements: Vec::from_slice(self.pipeline.measurements()).unwrap_or_default(),
            slopes: Vec::from_slice(self.pipeline.slopes()).unwrap_or_default(),
            positions: Vec::from_slice(self.pipeline.positions()).unwrap_or_default(),
        }
    }
}

impl<D: DacBus, C: Counter, const M: usize, const P: usize, const B: usize>
    FrameSide<'_, D, C, M, P, B>
{
    /// The state that a frame has left, which was asked for.
    #[inline(never)]
    pub(crate) fn tell(&mut self) {
        self.asked = false;
        // There is room: the main loop asks for one thing at a time.
        let _ = self.ends.answers.enqueue(Answer::State(self.frames.snapshot()));
    }

    #[inline(never)]
    pub(crate) fn command(&mut self, command: Command<M, P, B>, detector: &mut impl Detector) {
        match command {
            Command::Exchange(bank, shape) => {
                let before = self.frames.exchange(bank, shape);
                self.restart(detector);
                let _ = self.ends.answers.enqueue(Answer::Bank(before));
            }
            Command::Reset => {
                self.frames.reset();
                self.tell();
                // The frame that is being read is given up: the next blocks are in its middle.
                self.restart(detector);
            }
            Command::GlobalTilt(tilt) => self.frames.pipeline.set_global_tilt(tilt),
            Command::Snapshot => self.asked = true,
        }
    }
}
