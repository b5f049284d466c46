//! Frame numbers, from laser pulses and VSYNC.
//!
//! A timer counts the pulses of the laser's sync and stamps each VSYNC with that count, both without
//! the processor. A frame is an exposure of a known number of pulses: from the stamps follows which
//! frame it is, even where frames in between were never seen. Without pulses, VSYNC alone counts.

/// Numbers frames.
#[derive(Debug, Default)]
pub struct FrameClock {
    /// Stamp of the last frame.
    stamp: Option<u32>,
    number: u32,
}

/// A frame has begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tick {
    /// Its number; the first one is 0, and they wrap.
    pub number: u32,
    /// Frames between the last one and this one.
    pub missed: u32,
    /// Pulses more than a whole number of frames has, at most half a frame's either way.
    pub slip: i32,
}

impl FrameClock {
    /// One that has seen no frame.
    #[must_use]
    pub const fn new() -> Self {
        Self { stamp: None, number: 0 }
    }

    /// A frame has begun after `stamp` pulses (they wrap), when a frame takes `pulses`, at least 1.
    pub fn tick(&mut self, stamp: u32, pulses: u32) -> Tick {
        let Some(last) = self.stamp.replace(stamp) else {
            return Tick { number: self.number, missed: 0, slip: 0 };
        };
        let (passed, pulses) = (stamp.wrapping_sub(last), pulses.max(1));
        // The nearest number of frames; VSYNC says that it is at least one.
        let frames = passed.saturating_add(pulses / 2) / pulses;
        let frames = frames.max(1);
        self.number = self.number.wrapping_add(frames);
        // It is between -pulses and pulses / 2.
        let slip = passed.wrapping_sub(frames.wrapping_mul(pulses)) as i32;
        Tick { number: self.number, missed: frames - 1, slip }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks(stamps: &[u32], pulses: u32) -> Vec<(u32, u32, i32)> {
        let mut clock = FrameClock::new();
        let tick = |&stamp: &u32| clock.tick(stamp, pulses);
        stamps.iter().map(tick).map(|tick| (tick.number, tick.missed, tick.slip)).collect()
    }

    #[test]
    fn regular_frames_are_numbered_one_by_one_over_the_wrap_of_the_count() {
        let start = u32::MAX - 14;
        let stamps: Vec<_> = (0..4).map(|i| start.wrapping_add(10 * i)).collect();
        assert_eq!(ticks(&stamps, 10), [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]);
    }

    #[test]
    fn a_gap_is_counted_in_frames() {
        assert_eq!(ticks(&[100, 110, 150, 160], 10), [(0, 0, 0), (1, 0, 0), (5, 3, 0), (6, 0, 0)]);
    }

    #[test]
    fn a_missed_pulse_is_a_slip_and_no_frame() {
        assert_eq!(ticks(&[0, 9, 20, 29], 10), [(0, 0, 0), (1, 0, -1), (2, 0, 1), (3, 0, -1)]);
    }

    #[test]
    fn without_pulses_vsync_counts() {
        assert_eq!(ticks(&[7, 7, 7], 10), [(0, 0, 0), (1, 0, -10), (2, 0, -10)]);
    }

    #[test]
    fn one_pulse_a_frame_and_half_a_frame() {
        assert_eq!(ticks(&[0, 1, 3], 1), [(0, 0, 0), (1, 0, 0), (3, 1, 0)]);
        assert_eq!(ticks(&[0, 15], 10), [(0, 0, 0), (2, 1, -5)], "ties go up");
    }
}
