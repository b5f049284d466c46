//! Frame numbers and pulses of a frame, from laser pulses and VSYNC.
//!
//! A timer counts the pulses of the laser's sync and stamps each VSYNC with that count, both without
//! the processor. A frame is an exposure of a known number of pulses: from the stamps follows which
//! frame it is, even where frames in between were never seen. Without pulses, VSYNC alone counts, and
//! the main loop's clock for what does not come at all.

/// Numbers frames.
#[derive(Debug, Default)]
pub struct FrameClock {
    /// Stamp of the last frame.
    stamp: Option<u32>,
    number: u32,
    /// Frames since the last one that were given up, with their numbers.
    given_up: u32,
}

/// A frame has begun.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tick {
    /// Its number; the first one is 0, and they wrap.
    pub number: u32,
    /// Laser pulses in its exposure: those since the last frame, less what frames in between had.
    pub pulses: u32,
}

impl FrameClock {
    /// One that has seen no frame.
    #[must_use]
    pub const fn new() -> Self {
        Self { stamp: None, number: 0, given_up: 0 }
    }

    /// A frame's time has passed without one: it had the next number.
    pub const fn give_up(&mut self) {
        self.number = self.number.wrapping_add(1);
        self.given_up = self.given_up.saturating_add(1);
    }

    /// A frame has begun after `stamp` pulses (they wrap), when a frame takes `pulses`, at least 1.
    ///
    /// What was exposed for the first one is not known: it counts as whole.
    pub fn tick(&mut self, stamp: u32, pulses: u32) -> Tick {
        let given_up = core::mem::take(&mut self.given_up);
        let Some(last) = self.stamp.replace(stamp) else {
            // Those that were given up before it have 0 and what follows.
            return Tick { number: self.number, pulses };
        };
        let (passed, pulses) = (stamp.wrapping_sub(last), pulses.max(1));
        // The nearest number of frames.
        let counted = passed.saturating_add(pulses / 2) / pulses;
        // VSYNC says that it is one at least, and none that was given up.
        let frames = counted.max(given_up.saturating_add(1));
        self.number = self.number.wrapping_add(frames - given_up);
        let before = counted.saturating_sub(1).wrapping_mul(pulses);
        Tick { number: self.number, pulses: passed.saturating_sub(before) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number and pulses of the frames that begin after so many pulses.
    fn ticks(stamps: &[u32], pulses: u32) -> Vec<(u32, u32)> {
        let mut clock = FrameClock::new();
        let tick = |&stamp: &u32| clock.tick(stamp, pulses);
        stamps.iter().map(tick).map(|tick| (tick.number, tick.pulses)).collect()
    }

    #[test]
    fn regular_frames_are_numbered_one_by_one_over_the_wrap_of_the_count() {
        let start = u32::MAX - 14;
        let stamps: Vec<_> = (0..4).map(|i| start.wrapping_add(10 * i)).collect();
        assert_eq!(ticks(&stamps, 10), [(0, 10), (1, 10), (2, 10), (3, 10)]);
    }

    #[test]
    fn a_gap_is_counted_in_frames() {
        assert_eq!(ticks(&[100, 110, 150, 160], 10), [(0, 10), (1, 10), (5, 10), (6, 10)]);
        assert_eq!(ticks(&[100, 110, 148], 10), [(0, 10), (1, 10), (5, 8)], "the last one's");
    }

    #[test]
    fn a_missed_pulse_is_missed_by_its_frame_and_no_frame() {
        assert_eq!(ticks(&[0, 9, 20, 29], 10), [(0, 10), (1, 9), (2, 11), (3, 9)]);
    }

    #[test]
    fn without_pulses_vsync_counts() {
        assert_eq!(ticks(&[7, 7, 7], 10), [(0, 10), (1, 0), (2, 0)]);
    }

    #[test]
    fn one_pulse_a_frame_and_half_a_frame() {
        assert_eq!(ticks(&[0, 1, 3], 1), [(0, 1), (1, 1), (3, 1)]);
        assert_eq!(ticks(&[0, 15], 10), [(0, 10), (2, 5)], "ties go up");
    }

    #[test]
    fn frames_that_were_given_up_have_their_numbers() {
        // Pulses that go on, and pulses that do not.
        for (stamp, pulses) in [(40, 10), (10, 0)] {
            let mut clock = FrameClock::new();
            clock.tick(0, 10);
            clock.tick(10, 10);
            clock.give_up();
            clock.give_up();
            assert_eq!(clock.tick(stamp, 10), Tick { number: 4, pulses });
            assert_eq!(clock.tick(stamp + 10, 10), Tick { number: 5, pulses: 10 });
        }
    }

    #[test]
    fn numbers_never_come_twice_even_before_the_first_frame() {
        let mut clock = FrameClock::new();
        clock.give_up();
        clock.give_up();
        // 0 and 1 are gone: see `Controller::missing`.
        assert_eq!(clock.tick(1000, 10).number, 2);
        assert_eq!(clock.tick(1010, 10).number, 3);
    }
}
