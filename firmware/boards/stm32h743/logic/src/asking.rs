//! How the main loop asks, and waits for answers, without a lock.

use crate::answers::Snapshot;
use crate::queues::{Answer, Command};
use crate::shape::Shape;
use heapless::spsc::{Consumer, Producer};
use splash_firmware::config::Config;
use splash_firmware::pipeline::GlobalTilt;

/// Asks the frames' exception, one thing at a time. `wait` lets it run, and returns whether to go on
/// waiting.
pub struct Asking<'q, const M: usize, const P: usize, const B: usize> {
    commands: Producer<'q, Command<M, P, B>>,
    answers: Consumer<'q, Answer<M, P, B>>,
    /// A snapshot was asked for and has not come.
    owed: bool,
}

impl<'q, const M: usize, const P: usize, const B: usize> Asking<'q, M, P, B> {
    pub(crate) const fn new(
        commands: Producer<'q, Command<M, P, B>>,
        answers: Consumer<'q, Answer<M, P, B>>,
    ) -> Self {
        Self { commands, answers, owed: false }
    }

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
            // One of a frame was asked for before; if it has not come, this is the answer to both.
            if let Some(Answer::State(state)) = self.answer(wait)
                && state.report.is_none()
            {
                self.owed = false;
                return state;
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
