//! How the main loop asks, and waits for answers, without a lock.

use crate::answers::{Answer, Books, Command, Next, Snapshot};
use crate::bank::Half;
use heapless::Vec;
use heapless::spsc::{Consumer, Producer};
use splash_firmware::controller;
use splash_firmware::link::PIECE;
use splash_firmware::mode::Refusal;
use splash_firmware::pipeline::GlobalTilt;
use splash_firmware::telemetry::{Decimation, Dropped};

/// Asks the frames' exception, one thing at a time. `wait` lets it run, and returns whether to go on
/// waiting; what is answered at once, or at the next frame boundary, is waited for in any case.
pub struct Asking<'q, const M: usize, const P: usize, const B: usize> {
    commands: Producer<'q, Command<M, P, B>>,
    answers: Consumer<'q, Answer<M, P, B>>,
    /// The next frame's state was asked for and has not come.
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

    /// What `pick` takes of the answers.
    fn ask<T>(
        &mut self,
        command: Command<M, P, B>,
        wait: &mut dyn FnMut() -> bool,
        pick: fn(Answer<M, P, B>) -> Option<T>,
    ) -> T {
        self.tell(command, wait);
        loop {
            match self.answers.dequeue() {
                // Asked for before, and too late.
                Some(Answer::NextFrame(_)) => self.owed = false,
                Some(answer) => {
                    if let Some(answer) = pick(answer) {
                        return answer;
                    }
                }
                None => {
                    wait();
                }
            }
        }
    }

    /// Exchanges banks at the next frame boundary: the one that ran before, or the one that was to run
    /// and why it does not.
    ///
    /// # Errors
    /// A [`Refusal`], with the bank; what runs still does.
    pub fn exchange(
        &mut self,
        next: Next<M, P, B>,
        wait: &mut dyn FnMut() -> bool,
    ) -> Result<Half<M, P, B>, (Half<M, P, B>, Refusal)> {
        self.ask(Command::Exchange(next), wait, |answer| match answer {
            Answer::Exchanged(exchanged) => Some(exchanged),
            _ => None,
        })
    }

    /// Has the controller do what an operator asks for.
    ///
    /// # Errors
    /// A [`Refusal`]; nothing has changed.
    pub fn operator(
        &mut self,
        command: controller::Command,
        wait: &mut dyn FnMut() -> bool,
    ) -> Result<(), Refusal> {
        self.ask(Command::Operator(command), wait, |answer| match answer {
            Answer::Done(done) => Some(done),
            _ => None,
        })
    }

    /// The state that the last frame has left.
    pub fn state(&mut self, wait: &mut dyn FnMut() -> bool) -> Snapshot<M> {
        self.ask(Command::State, wait, |answer| match answer {
            Answer::State(state) => Some(state),
            _ => None,
        })
    }

    /// What the controller keeps books of.
    pub fn books(&mut self, wait: &mut dyn FnMut() -> bool) -> Books {
        self.ask(Command::Books, wait, |answer| match answer {
            Answer::Books(books) => Some(books),
            _ => None,
        })
    }

    /// Telemetry from now on, if another is wanted, and what was dropped.
    pub fn streams(
        &mut self,
        decimation: Option<Decimation>,
        wait: &mut dyn FnMut() -> bool,
    ) -> (Decimation, Dropped) {
        self.ask(Command::Streams(decimation), wait, |answer| match answer {
            Answer::Streams(decimation, dropped) => Some((decimation, dropped)),
            _ => None,
        })
    }

    /// Raw pixels, u16 little-endian, of a row of the next frame from a column on, and the frame's number;
    /// `None` if that frame lacks the row.
    pub fn row(
        &mut self,
        row: u16,
        first: u16,
        wait: &mut dyn FnMut() -> bool,
    ) -> Option<(u32, Vec<u8, PIECE>)> {
        self.ask(Command::Row(row, first), wait, |answer| match answer {
            Answer::Row(found) => Some(found),
            _ => None,
        })
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
            self.tell(Command::NextFrame, wait);
        }
        loop {
            match self.answers.dequeue() {
                Some(Answer::NextFrame(state)) => {
                    self.owed = false;
                    return Some(state);
                }
                // Of another request there is none: each waits for its own.
                Some(_) => {}
                None => {
                    if !wait() {
                        return None;
                    }
                }
            }
        }
    }
}
