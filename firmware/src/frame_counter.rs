//! What a frame's number says of the frames before it.
//!
//! Up to [`MAX_MISSING`] ahead of the next number, those in between are missing. Any other number is wrong.
//! A frame with the last one's number came twice and takes no place; one from the past or from far ahead
//! counts as the one that was due, and the next one is expected behind that. Two frames whose numbers
//! follow one another are believed all the same: the detector counts anew.

use crate::fault::Fault;

/// How far ahead a frame's number may be for those in between to count as missing.
pub const MAX_MISSING: u32 = 1 << 16;

/// What a number says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counted {
    /// It follows, and so many frames are missing before it.
    Next {
        /// Frames between the last one and this one.
        missing: u32,
    },
    /// It does not follow.
    Wrong(Fault),
}

/// The numbers so far; they wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounter {
    /// Of the last frame, as it should have been.
    last: Option<u32>,
    /// Of the last frame, as it was, if that was wrong.
    astray: Option<u32>,
}

impl FrameCounter {
    /// Before the first frame.
    #[must_use]
    pub const fn new() -> Self {
        Self { last: None, astray: None }
    }

    /// The number of the frame that is due; the first may have any.
    #[must_use]
    pub fn due(&self) -> u32 {
        self.last.map_or(0, |last| last.wrapping_add(1))
    }

    /// A frame is due, and does not come.
    pub fn skip(&mut self) {
        self.last = Some(self.due());
        self.astray = self.astray.map(|number| number.wrapping_add(1));
    }

    /// A frame comes with this number.
    pub fn count(&mut self, found: u32) -> Counted {
        let expected = self.due();
        let missing = found.wrapping_sub(expected);
        let anew = self.astray.is_some_and(|number| number.wrapping_add(1) == found);
        if self.last.is_some() && missing > MAX_MISSING && !anew {
            if self.last != Some(found) {
                self.last = Some(expected);
                self.astray = Some(found);
            }
            return Counted::Wrong(Fault::FrameCounter { expected, found });
        }
        let first = self.last.is_none() || missing > MAX_MISSING;
        self.last = Some(found);
        self.astray = None;
        Counted::Next { missing: if first { 0 } else { missing } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn behind(last: u32) -> FrameCounter {
        FrameCounter { last: Some(last), astray: None }
    }

    const fn next(missing: u32) -> Counted {
        Counted::Next { missing }
    }

    #[test]
    fn numbers_follow_one_another_over_the_wrap() {
        assert_eq!(FrameCounter::new().count(17), next(0));
        assert_eq!(behind(4).count(5), next(0));
        assert_eq!(behind(u32::MAX).count(0), next(0));
        assert_eq!(behind(u32::MAX - 1).count(2), next(3));
        assert_eq!(behind(0).count(MAX_MISSING + 1), next(MAX_MISSING));
        for (last, found) in [(5, 5), (5, 4), (5, 0), (0, MAX_MISSING + 2)] {
            let fault = Fault::FrameCounter { expected: last + 1, found };
            assert_eq!(behind(last).count(found), Counted::Wrong(fault));
        }
    }

    #[test]
    fn one_wrong_number_harms_no_other_frame() {
        for wrong in [7, 3, 1 << 31] {
            let mut counter = behind(8);
            assert!(matches!(counter.count(wrong), Counted::Wrong(_)), "{wrong}");
            assert_eq!(counter.count(10), next(0), "behind {wrong}");
        }
        let mut counter = behind(8);
        counter.count(3);
        assert_eq!(counter.count(12), next(2), "missing ones are still seen");
    }

    #[test]
    fn a_frame_that_comes_twice_takes_no_place() {
        let mut counter = behind(8);
        assert!(matches!(counter.count(8), Counted::Wrong(_)));
        assert!(matches!(counter.count(3), Counted::Wrong(_)), "and no other wrong one's either");
        assert_eq!(counter.count(10), next(0));
    }

    #[test]
    fn a_detector_that_counts_anew_is_believed_at_its_second_frame() {
        let mut counter = behind(1 << 20);
        assert!(matches!(counter.count(0), Counted::Wrong(_)));
        assert_eq!(counter.count(1), next(0));
        assert_eq!(counter.count(2), next(0));
        let mut counter = behind(1 << 20);
        counter.count(0);
        counter.skip();
        assert_eq!(counter.count(2), next(0), "one of them lost, and noticed");
    }

    #[test]
    fn frames_that_are_known_to_be_lost_are_not_missing() {
        let mut counter = behind(8);
        counter.skip();
        assert_eq!((counter.due(), counter.count(10)), (10, next(0)));
    }
}
