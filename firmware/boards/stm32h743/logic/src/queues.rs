//! What the two interrupts and the main loop pass to one another: values, never shared memory.
//!
//! ```text
//! rows interrupt --- blocks ---> frame interrupt ---- news, answers -----> main loop
//!                <-- orders ----                 <-- commands -------------
//! ```
//!
//! A calibration bank is one of the values: who has it may use it, so none can change in a frame.

use crate::dac_bus::DacBus;
use crate::frame_loop::{Counter, FrameLoop, Record, Snapshot, Taken};
use crate::ring::{Complete, Fault, Ring};
use crate::shape::{SLOTS, Shape};
use heapless::spsc::{Consumer, Producer, Queue};
use splash_firmware::config::Config;
use splash_firmware::pipeline::GlobalTilt;

/// A block that is complete, or blocks that are lost, since the detector was last started.
#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// A block.
    Block {
        /// Its place.
        slot: u16,
        /// Pulses at the VSYNC before it, if one came since the last block.
        start: Option<u32>,
        /// The cycle at which it was complete.
        at: u32,
    },
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
    start: u8,
    shape: Shape,
}

/// What the main loop asks of the frame interrupt.
#[derive(Debug)]
pub enum Command<const M: usize, const P: usize, const B: usize> {
    /// Another bank. Answered by the one before.
    Exchange(&'static mut Config<M, P, B>, Shape),
    /// Opens the loop. Answered by its state.
    Reset,
    /// A global tilt. Not answered.
    GlobalTilt(GlobalTilt),
    /// Answered by the state that the next frame leaves.
    Snapshot,
}

/// What the frame interrupt answers.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "without allocation nothing can be put elsewhere")]
pub enum Answer<const M: usize, const P: usize, const B: usize> {
    /// The bank that was in use.
    Bank(&'static mut Config<M, P, B>),
    /// The state.
    State(Snapshot<M>),
}

/// What the frame interrupt tells without being asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum News {
    /// A frame has ended.
    Frame(Record),
    /// The detector is started again, because of this.
    Fault(Fault),
}

/// Room for every block of the ring, and for one loss.
type Events = Queue<Tagged, { SLOTS + 2 }>;

/// The queues.
pub struct Queues<const M: usize, const P: usize, const B: usize> {
    events: Events,
    orders: Queue<Order, 4>,
    commands: Queue<Command<M, P, B>, 4>,
    answers: Queue<Answer<M, P, B>, 2>,
    news: Queue<News, 8>,
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
        }
    }

    /// Their ends.
    pub fn split(&mut self) -> Ends<'_, M, P, B> {
        let (event_in, event_out) = self.events.split();
        let (order_in, order_out) = self.orders.split();
        let (command_in, command_out) = self.commands.split();
        let (answer_in, answer_out) = self.answers.split();
        let (news_in, news_out) = self.news.split();
        Ends {
            rows: RowSide { ring: None, start: 0, events: event_in, orders: order_out },
            frames: FrameEnds {
                events: event_out,
                orders: order_in,
                commands: command_out,
                answers: answer_in,
                news: news_in,
            },
            asking: Asking { commands: command_in, answers: answer_out, owed: false },
            news: news_out,
        }
    }
}

/// The ends of the queues.
pub struct Ends<'q, const M: usize, const P: usize, const B: usize> {
    /// Of the rows interrupt.
    pub rows: RowSide<'q>,
    /// Of the frame interrupt.
    pub frames: FrameEnds<'q, M, P, B>,
    /// Of the main loop.
    pub asking: Asking<'q, M, P, B>,
    /// Of the main loop, too.
    pub news: Consumer<'q, News>,
}

/// What the rows interrupt does, but for the registers.
pub struct RowSide<'q> {
    /// `None` while the detector is stopped.
    ring: Option<Ring>,
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
        self.ring = Some(Ring::new(shape));
        Some(shape)
    }

    /// A block is complete: arguments as of [`Ring::complete`] and [`Event::Block`]. Where to aim the
    /// DMA, or `None` if the detector is to be stopped.
    pub fn complete(
        &mut self,
        second: bool,
        vsync: Option<u32>,
        at: u32,
    ) -> Option<(Complete, Shape)> {
        let ring = self.ring.as_mut()?;
        match ring.complete(second, self.events.len()) {
            Ok(complete) => {
                let event = Event::Block { slot: complete.slot, start: vsync, at };
                // There is room: the ring has fewer blocks than the queue.
                let _ = self.events.enqueue(Tagged { start: self.start, event });
                Some((complete, *ring.shape()))
            }
            Err(fault) => {
                self.lost(fault);
                None
            }
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

/// The frame interrupt's ends of the queues.
pub struct FrameEnds<'q, const M: usize, const P: usize, const B: usize> {
    events: Consumer<'q, Tagged>,
    orders: Producer<'q, Order>,
    commands: Consumer<'q, Command<M, P, B>>,
    answers: Producer<'q, Answer<M, P, B>>,
    news: Producer<'q, News>,
}

/// The detector, as the frame interrupt sees it.
pub trait Detector {
    /// The pixels of a complete block.
    fn pixels(&mut self, shape: &Shape, slot: u16) -> &[u16];

    /// Lets the rows interrupt see its orders.
    fn wake(&mut self);
}

/// What the frame interrupt does, but for the registers.
pub struct FrameSide<'q, D, C, const M: usize, const P: usize, const B: usize> {
    frames: FrameLoop<'static, D, C, M, P, B>,
    ends: FrameEnds<'q, M, P, B>,
    /// Number of the detector's last start.
    start: u8,
    /// The next frame's state is asked for.
    asked: bool,
}

impl<'q, D: DacBus, C: Counter, const M: usize, const P: usize, const B: usize>
    FrameSide<'q, D, C, M, P, B>
{
    /// A loop and its ends of the queues.
    pub fn new(
        frames: FrameLoop<'static, D, C, M, P, B>,
        ends: FrameEnds<'q, M, P, B>,
    ) -> Self {
        Self { frames, ends, start: 0, asked: false }
    }

    /// Takes all that has come.
    #[inline]
    pub fn run(&mut self, detector: &mut impl Detector) {
        loop {
            while let Some(command) = self.ends.commands.dequeue() {
                self.command(command, detector);
            }
            // Its block is given back only once it was read.
            let Some(&tagged) = self.ends.events.peek() else { return };
            if tagged.start == self.start {
                self.event(tagged.event, detector);
            }
            self.ends.events.dequeue();
        }
    }

    #[inline]
    fn event(&mut self, event: Event, detector: &mut impl Detector) {
        let taken = match event {
            Event::Block { slot, start, at } => {
                let Some(shape) = self.frames.shape().copied() else { return };
                self.frames.block(start, at, detector.pixels(&shape, slot))
            }
            Event::Lost(fault) => {
                if let Some(record) = self.frames.lost() {
                    self.record(record);
                }
                self.fault(fault);
                return self.restart(detector);
            }
        };
        match taken {
            Taken::Part => {}
            Taken::Frame(record) => self.record(record),
            Taken::Astray(record) => {
                if let Some(record) = record {
                    self.record(record);
                }
                self.fault(Fault::Astray);
                self.restart(detector);
            }
        }
    }

    fn record(&mut self, record: Record) {
        // One that nobody fetched in time is not missed: others follow.
        let _ = self.ends.news.enqueue(News::Frame(record));
        if self.asked {
            self.asked = false;
            // There is room: the main loop asks for one thing at a time.
            let _ = self.ends.answers.enqueue(Answer::State(self.frames.snapshot()));
        }
    }

    fn fault(&mut self, fault: Fault) {
        let _ = self.ends.news.enqueue(News::Fault(fault));
    }

    fn restart(&mut self, detector: &mut impl Detector) {
        if let Some(&shape) = self.frames.shape() {
            self.start = self.start.wrapping_add(1);
            // There is room: the rows interrupt takes them before this one goes on.
            let _ = self.ends.orders.enqueue(Order { start: self.start, shape });
            detector.wake();
        }
    }

    fn command(&mut self, command: Command<M, P, B>, detector: &mut impl Detector) {
        match command {
            Command::Exchange(bank, shape) => {
                let before = self.frames.exchange(bank, shape);
                self.restart(detector);
                let _ = self.ends.answers.enqueue(Answer::Bank(before));
            }
            Command::Reset => {
                self.frames.reset();
                let _ = self.ends.answers.enqueue(Answer::State(self.frames.snapshot()));
                // The frame that is being read is given up: the next blocks are in its middle.
                self.restart(detector);
            }
            Command::GlobalTilt(tilt) => self.frames.set_global_tilt(tilt),
            Command::Snapshot => self.asked = true,
        }
    }
}

/// Asks the frame interrupt, one thing at a time. `wait` lets it run, and returns whether to go on
/// waiting.
pub struct Asking<'q, const M: usize, const P: usize, const B: usize> {
    commands: Producer<'q, Command<M, P, B>>,
    answers: Consumer<'q, Answer<M, P, B>>,
    owed: bool,
}

impl<const M: usize, const P: usize, const B: usize> Asking<'_, M, P, B> {
    fn tell(&mut self, command: Command<M, P, B>, wait: &mut dyn FnMut() -> bool) {
        let mut command = Some(command);
        while let Some(one) = command.take() {
            command = self.commands.enqueue(one).err();
            wait();
        }
    }

    fn answer(&mut self, wait: &mut dyn FnMut() -> bool) -> Option<Answer<M, P, B>> {
        loop {
            if let Some(answer) = self.answers.dequeue() {
                return Some(answer);
            }
            if !wait() {
                return None;
            }
        }
    }

    /// Exchanges banks; comes back at once, whatever the detector does.
    pub fn exchange(
        &mut self,
        bank: &'static mut Config<M, P, B>,
        shape: Shape,
        wait: &mut dyn FnMut() -> bool,
    ) -> &'static mut Config<M, P, B> {
        self.tell(Command::Exchange(bank, shape), wait);
        loop {
            match self.answer(wait) {
                Some(Answer::Bank(bank)) => return bank,
                // Asked for before.
                Some(Answer::State(_)) => self.owed = false,
                None => {}
            }
        }
    }

    /// Opens the loop; comes back at once.
    pub fn reset(&mut self, wait: &mut dyn FnMut() -> bool) -> Snapshot<M> {
        self.tell(Command::Reset, wait);
        loop {
            if let Some(Answer::State(state)) = self.answer(wait) {
                // One of a frame was asked for before.
                if state.report.is_none() {
                    return state;
                }
                self.owed = false;
            }
        }
    }

    /// Gives a global tilt.
    pub fn global_tilt(&mut self, tilt: GlobalTilt, wait: &mut dyn FnMut() -> bool) {
        self.tell(Command::GlobalTilt(tilt), wait);
    }

    /// What the next frame leaves; `None` if none comes for as long as is waited.
    pub fn next_frame(&mut self, wait: &mut dyn FnMut() -> bool) -> Option<Snapshot<M>> {
        if self.owed && self.answers.dequeue().is_some() {
            // Asked for when none came in time: not the next one any more.
            self.owed = false;
        }
        if !self.owed {
            self.owed = true;
            self.tell(Command::Snapshot, wait);
        }
        match self.answer(wait) {
            Some(Answer::State(state)) => {
                self.owed = false;
                Some(state)
            }
            _ => None,
        }
    }
}
