//! What interrupts, frames and main loop pass to one another: values, never shared memory.
//!
//! ```text
//! both interrupts --- blocks ---> frames (PendSV) --- news, answers, telemetry --> main loop
//!                 <-- orders ----                 <-- commands -------------------
//! ```
//!
//! A bank is one of the values ([`crate::bank`]): who has it may use it, so none can change in a frame.

use crate::answers::{Answer, Command, Next, Wanted};
use crate::asking::Asking;
use crate::dac_bus::DacBus;
use crate::frame_loop::{Counter, FrameLoop, Record, Taken};
use crate::gate::GateTimer;
use crate::ring::{Complete, Fault, Ring};
use crate::shape::{SLOTS, Shape};
use heapless::spsc::{Consumer, Producer, Queue};
use splash_firmware::interlock::{Inputs, Outputs};
use splash_firmware::telemetry;

/// A block that is complete, or blocks that are lost, since the detector was last started.
#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// A block.
    Block {
        /// Its place.
        slot: u16,
        /// Pulses when its frame began, if it began since the last block.
        start: Option<u32>,
        /// The cycle at which it was complete.
        at: u32,
    },
    /// VSYNC, at the end of a block: the frame has no more.
    End,
    /// The detector is stopped, because of this.
    Lost(Fault),
}

/// An event, and the number of the start that it belongs to.
#[derive(Clone, Copy, Debug)]
pub struct Tagged {
    start: u8,
    event: Event,
}

/// To start the detector anew: what is older is not looked at.
#[derive(Clone, Copy, Debug)]
pub struct Order {
    pub(crate) start: u8,
    pub(crate) shape: Shape,
}

/// What the frames' exception tells without being asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum News {
    /// A frame has ended.
    Frame(Record),
    /// The detector is started again, because of this.
    Fault(Fault),
}

/// Room for every block of the ring, an end behind each, and a loss.
type Events = Queue<Tagged, { 2 * SLOTS + 4 }>;

/// The queues. Two answers can be on their way: a state that is not waited for any more, and one that is.
pub struct Queues<const M: usize, const P: usize, const B: usize> {
    events: Events,
    orders: Queue<Order, 4>,
    commands: Queue<Command<M, P, B>, 4>,
    answers: Queue<Answer<M, P, B>, 3>,
    news: Queue<News, 16>,
    telemetry: Queue<telemetry::Record, 4>,
}

impl<const M: usize, const P: usize, const B: usize> Default for Queues<M, P, B> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const M: usize, const P: usize, const B: usize> Queues<M, P, B> {
    /// Empty ones.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            events: Queue::new(),
            orders: Queue::new(),
            commands: Queue::new(),
            answers: Queue::new(),
            news: Queue::new(),
            telemetry: Queue::new(),
        }
    }

    /// Their ends.
    pub fn split(&mut self) -> Ends<'_, M, P, B> {
        let (event_in, event_out) = self.events.split();
        let (order_in, order_out) = self.orders.split();
        let (command_in, command_out) = self.commands.split();
        let (answer_in, answer_out) = self.answers.split();
        let (news_in, news_out) = self.news.split();
        let (telemetry_in, telemetry_out) = self.telemetry.split();
        Ends {
            rows: RowSide { ring: None, place: 0, start: 0, events: event_in, orders: order_out },
            frames: FrameEnds {
                events: event_out,
                orders: order_in,
                commands: command_out,
                answers: answer_in,
                news: news_in,
                telemetry: telemetry_in,
            },
            asking: Asking::new(command_in, answer_out),
            news: news_out,
            telemetry: telemetry_out,
        }
    }
}

/// The ends of the queues.
pub struct Ends<'q, const M: usize, const P: usize, const B: usize> {
    /// Of the interrupts.
    pub rows: RowSide<'q>,
    /// Of the frames' exception.
    pub frames: FrameEnds<'q, M, P, B>,
    /// Of the main loop.
    pub asking: Asking<'q, M, P, B>,
    /// Of the main loop, too.
    pub news: Consumer<'q, News>,
    /// And these.
    pub telemetry: Consumer<'q, telemetry::Record>,
}

/// What both interrupts do, but for the registers.
pub struct RowSide<'q> {
    /// `None` while the detector is stopped.
    ring: Option<Ring>,
    /// The block of its frame that is complete next.
    place: u16,
    start: u8,
    events: Producer<'q, Tagged>,
    orders: Consumer<'q, Order>,
}

impl RowSide<'_> {
    /// Whether the detector is to be started anew, and how.
    pub fn order(&mut self) -> Option<Shape> {
        let mut last = None;
        while let Some(order) = self.orders.dequeue() {
            last = Some(order);
        }
        let Order { start, shape } = last?;
        self.start = start;
        self.place = 0;
        self.ring = Some(Ring::new(shape));
        Some(shape)
    }

    /// A block is complete: `second` as of [`Ring::complete`], `at` as of [`Event::Block`]. `begun` is
    /// asked for the first block of a frame only, what it is for another one may be the next frame's
    /// already. Where to aim the DMA, or `None` if the detector is to be stopped. Ends of frames that wait
    /// count as blocks.
    pub fn complete(
        &mut self,
        second: bool,
        begun: impl FnOnce() -> Option<u32>,
        at: u32,
    ) -> Option<(Complete, Shape)> {
        let ring = self.ring.as_mut()?;
        match ring.complete(second, self.events.len()) {
            Ok(complete) => {
                let shape = *ring.shape();
                let start = if self.place == 0 { begun() } else { None };
                self.place += 1;
                if self.place == shape.blocks {
                    self.place = 0;
                }
                let event = Event::Block { slot: complete.slot, start, at };
                // There is room: the ring has fewer blocks than the queue.
                let _ = self.events.enqueue(Tagged { start: self.start, event });
                Some((complete, shape))
            }
            Err(fault) => {
                self.lost(fault);
                None
            }
        }
    }

    /// VSYNC. `left`: transfers until the block that is being filled is complete. Whether the detector
    /// goes on: it has to be stopped where rows are missing, or the next frame's would come in their
    /// place.
    pub fn end(&mut self, left: u16) -> bool {
        match &self.ring {
            Some(ring) if left == ring.shape().transfers() => {
                // There is room for one behind each block, and frames without blocks need no end.
                let _ = self.events.enqueue(Tagged { start: self.start, event: Event::End });
                self.place = 0;
                true
            }
            Some(_) => {
                self.lost(Fault::Astray);
                false
            }
            None => false,
        }
    }

    /// Blocks are lost, and the detector is stopped.
    pub fn lost(&mut self, fault: Fault) {
        if self.ring.take().is_some() {
            // The place that blocks leave free.
            let _ = self.events.enqueue(Tagged { start: self.start, event: Event::Lost(fault) });
        }
    }
}

/// The frames' ends of the queues.
pub struct FrameEnds<'q, const M: usize, const P: usize, const B: usize> {
    events: Consumer<'q, Tagged>,
    pub(crate) orders: Producer<'q, Order>,
    commands: Consumer<'q, Command<M, P, B>>,
    pub(crate) answers: Producer<'q, Answer<M, P, B>>,
    pub(crate) news: Producer<'q, News>,
    pub(crate) telemetry: Producer<'q, telemetry::Record>,
}

/// The hardware, as the frames' exception sees it.
pub trait Hardware {
    /// The pixels of a complete block.
    fn pixels(&mut self, shape: &Shape, slot: u16) -> &[u16];

    /// Lets the interrupts see its orders.
    fn wake(&mut self);

    /// Reads the interlock's inputs.
    fn inputs(&mut self) -> Inputs;

    /// Sets both enables.
    fn enable(&mut self, outputs: Outputs);

    /// Sets the range gate, from the next pulse on.
    fn gate(&mut self, timer: GateTimer);
}

/// What is done with frames, but for the registers.
pub struct FrameSide<'q, D, C, const M: usize, const P: usize, const B: usize> {
    pub(crate) frames: FrameLoop<'static, D, C, M, P, B>,
    pub(crate) ends: FrameEnds<'q, M, P, B>,
    /// Number of the detector's last start.
    pub(crate) start: u8,
    /// The next frame's state is asked for.
    pub(crate) asked: bool,
    /// Raw pixels that were asked for.
    pub(crate) wanted: Option<Wanted>,
    /// A bank that is to run from the next boundary on.
    pub(crate) ordered: Option<Next<M, P, B>>,
    /// What the gate's timer was set to.
    pub(crate) gate: Option<GateTimer>,
}

impl<'q, D: DacBus, C: Counter, const M: usize, const P: usize, const B: usize>
    FrameSide<'q, D, C, M, P, B>
{
    /// A loop and its ends of the queues.
    pub fn new(frames: FrameLoop<'static, D, C, M, P, B>, ends: FrameEnds<'q, M, P, B>) -> Self {
        Self { frames, ends, start: 0, asked: false, wanted: None, ordered: None, gate: None }
    }

    /// The loop.
    pub const fn frames(&mut self) -> &mut FrameLoop<'static, D, C, M, P, B> {
        &mut self.frames
    }

    /// Takes all that has come.
    #[inline]
    pub fn run(&mut self, hardware: &mut impl Hardware) {
        loop {
            while let Some(command) = self.ends.commands.dequeue() {
                self.command(command, hardware);
            }
            // Its block is given back only once it was read.
            let Some(&tagged) = self.ends.events.peek() else { break };
            if tagged.start == self.start {
                self.event(tagged.event, hardware);
            }
            self.ends.events.dequeue();
        }
        self.round(hardware);
    }

    #[inline]
    fn event(&mut self, event: Event, hardware: &mut impl Hardware) {
        let fault = match event {
            Event::Block { slot, start, at } => {
                let Some(shape) = self.frames.shape().copied() else { return };
                let place = if start.is_some() { 0 } else { self.frames.next };
                let pixels = hardware.pixels(&shape, slot);
                let taken = self.frames.block(start, at, pixels);
                if self.wanted.is_some() {
                    self.look(place, shape.rows, shape.width, pixels);
                }
                if start.is_some() {
                    // What was asked for runs from this frame's beginning on.
                    self.gate(hardware);
                }
                match taken {
                    Taken::Part => return,
                    Taken::Frame(record) => {
                        self.record(&record);
                        return self.exchange(hardware);
                    }
                    Taken::Astray => Some(Fault::Astray),
                }
            }
            Event::End => None,
            Event::Lost(fault) => Some(fault),
        };
        if let Some(record) = self.frames.end() {
            self.record(&record);
        }
        self.exchange(hardware);
        if let Some(fault) = fault {
            self.astray(fault, hardware);
        }
    }
}
