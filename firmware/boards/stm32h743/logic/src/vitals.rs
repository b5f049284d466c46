//! When the watchdog is fed: whenever nothing that was due is missing.
//!
//! Due is, for each frame that the detector has begun while it is being read, a frame that went all the
//! way to the DACs. One watchdog period may pass without; then the board starts again, with both enables
//! down.

/// What was seen since the watchdog was last fed.
#[derive(Debug, Default)]
pub struct Vitals {
    /// Pulse count at the last VSYNC when it was.
    stamp: u32,
    /// A frame has gone all the way since.
    complete: bool,
}

impl Vitals {
    /// Nothing seen.
    #[must_use]
    pub const fn new() -> Self {
        Self { stamp: 0, complete: false }
    }

    /// A frame has ended. `sent`: its codes were handed to the DACs.
    pub fn frame(&mut self, sent: bool) {
        self.complete |= sent;
    }

    /// Whether to feed the watchdog, at the end of a round of the main loop. `reading`: frames are
    /// taken from the detector; `stamp` changes with every frame that it begins.
    pub fn feed(&mut self, reading: bool, stamp: u32) -> bool {
        let due = reading && stamp != self.stamp;
        if due && !self.complete {
            return false;
        }
        self.stamp = stamp;
        self.complete = false;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_frames_every_round_feeds() {
        let mut vitals = Vitals::new();
        assert!(vitals.feed(false, 0));
        assert!(vitals.feed(false, 5), "a detector that nobody reads");
        assert!(vitals.feed(true, 5), "a detector that has stopped");
    }

    #[test]
    fn a_frame_that_was_begun_must_arrive() {
        let mut vitals = Vitals::new();
        assert!(!vitals.feed(true, 10));
        assert!(!vitals.feed(true, 20));
        vitals.frame(false);
        assert!(!vitals.feed(true, 20), "its codes did not get to the DACs");
        vitals.frame(true);
        assert!(vitals.feed(true, 20));
        assert!(vitals.feed(true, 20));
        assert!(!vitals.feed(true, 30), "every period anew");
    }
}
