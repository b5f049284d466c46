//! When the watchdog is fed: only when a whole cycle went well.
//!
//! A cycle is whole when the interlock was looked at, the board's other duties were done and, if the
//! detector has begun a frame while it is being read, a frame went all the way to the DACs. One watchdog
//! period may pass without; then the board starts anew, with both enables down.

/// A part of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The interlock's inputs were looked at and its outputs set.
    Interlock,
    /// Link and log were served.
    Service,
    /// A frame's codes were handed to the DACs.
    Frame,
}

/// What was seen since the watchdog was last fed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Watchdog {
    /// Stamp of the last frame that had begun when it was.
    stamp: u32,
    interlock: bool,
    service: bool,
    frame: bool,
}

impl Watchdog {
    /// Nothing seen.
    #[must_use]
    pub const fn new() -> Self {
        Self { stamp: 0, interlock: false, service: false, frame: false }
    }

    /// A part of the cycle went well.
    pub fn done(&mut self, part: Part) {
        match part {
            Part::Interlock => self.interlock = true,
            Part::Service => self.service = true,
            Part::Frame => self.frame = true,
        }
    }

    /// Whether to feed the watchdog, at the end of a round of the main loop. `reading`: frames are
    /// taken from the detector; `stamp` changes with every frame that it begins.
    pub fn feed(&mut self, reading: bool, stamp: u32) -> bool {
        let due = reading && stamp != self.stamp;
        let whole = self.interlock && self.service && (self.frame || !due);
        if whole {
            *self = Self { stamp, ..Self::new() };
        }
        whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A round of everything but a frame.
    fn round(watchdog: &mut Watchdog) {
        watchdog.done(Part::Interlock);
        watchdog.done(Part::Service);
    }

    #[test]
    fn without_frames_every_round_feeds() {
        let mut watchdog = Watchdog::new();
        for (reading, stamp, what) in [
            (false, 0, "a start"),
            (false, 5, "nobody reads"),
            (true, 5, "a detector that stopped"),
        ] {
            round(&mut watchdog);
            assert!(watchdog.feed(reading, stamp), "{what}");
        }
    }

    #[test]
    fn a_frame_that_was_begun_must_arrive() {
        let mut watchdog = Watchdog::new();
        round(&mut watchdog);
        assert!(!watchdog.feed(true, 10));
        assert!(!watchdog.feed(true, 20));
        watchdog.done(Part::Frame);
        assert!(watchdog.feed(true, 20));
        round(&mut watchdog);
        assert!(watchdog.feed(true, 20));
        round(&mut watchdog);
        assert!(!watchdog.feed(true, 30), "every period anew");
    }

    #[test]
    fn each_part_is_asked_for_every_time() {
        let parts = [Part::Interlock, Part::Service, Part::Frame];
        for missing in parts {
            let mut watchdog = Watchdog::new();
            for stamp in 1..4 {
                parts.iter().filter(|&&p| p != missing).for_each(|&p| watchdog.done(p));
                assert!(!watchdog.feed(true, stamp), "{missing:?}");
            }
            watchdog.done(missing);
            assert!(watchdog.feed(true, 4));
            assert!(!watchdog.feed(true, 5));
        }
    }
}
