//! The ladder: what a closed loop does when frames are bad or missing, rung by rung.
//!
//! ```text
//! good frame                 follow
//! bad frames 1 ..= n1        hold the last command
//! bad frames n1 + 1 ..= n2   leak: the command shrinks by a fixed part of itself each frame
//! bad frame n2 + 1           give up: safe
//! more than p saturated actuators in n good frames one after the other: open
//! ```
//!
//! Bad frames are counted one after the other. A good one before the loop is given up starts from the
//! ground: the loop was closed all the while. One that was given up or opened is the operator's to close
//! again. Held and leaked frames show nothing new of saturation: they neither count for it nor start
//! its count anew.

use crate::fault::Fault;
use serde::{Deserialize, Serialize};

/// When the ladder is climbed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LadderLimits {
    /// n1: bad frames that are held.
    pub hold_frames: u16,
    /// n2: bad frames, with those, before the loop is given up; at least n1.
    pub safe_frames: u16,
    /// What a leak takes of a command each frame, Q16.
    pub leak_q16: u16,
    /// Actuators that may be at their limits.
    pub saturated_actuators: u16,
    /// n: frames with more of them that open the loop; 0 for never.
    pub saturated_frames: u16,
}

/// What a closed loop does with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Rung {
    /// The mirror follows the frame.
    Follow,
    /// The mirror holds.
    Hold,
    /// The mirror goes a part of its way to the flat map.
    Leak,
    /// The loop is given up: safe.
    GiveUp(Fault),
}

/// Where the loop is on the ladder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Ladder {
    /// Bad frames one after the other.
    bad: u16,
    /// Good frames one after the other with too many actuators at their limits.
    saturated: u16,
}

impl Ladder {
    /// On the ground.
    #[must_use]
    pub const fn new() -> Self {
        Self { bad: 0, saturated: 0 }
    }

    /// Bad frames one after the other.
    #[must_use]
    pub const fn bad(&self) -> u16 {
        self.bad
    }

    /// A frame that can be followed.
    pub fn good(&mut self) -> Rung {
        self.bad = 0;
        Rung::Follow
    }

    /// A frame that cannot be followed, or did not come.
    pub fn bad_frame(&mut self, limits: &LadderLimits) -> Rung {
        self.bad_frames(1, limits)
    }

    /// So many of them at once.
    pub fn bad_frames(&mut self, frames: u16, limits: &LadderLimits) -> Rung {
        self.bad = self.bad.saturating_add(frames);
        // With the largest n2 the count could not get beyond it.
        let given_up = self.bad > limits.safe_frames || self.bad == u16::MAX;
        if given_up {
            Rung::GiveUp(Fault::FramesLost { frames: self.bad })
        } else if self.bad > limits.hold_frames {
            Rung::Leak
        } else {
            Rung::Hold
        }
    }

    /// How many actuators a followed frame found at their limits; the fault that opens the loop.
    pub fn saturated(&mut self, actuators: u16, limits: &LadderLimits) -> Option<Fault> {
        let most = limits.saturated_actuators;
        self.saturated = if actuators > most { self.saturated.saturating_add(1) } else { 0 };
        let opens = limits.saturated_frames > 0 && self.saturated >= limits.saturated_frames;
        opens.then_some(Fault::ActuatorsSaturated { actuators, most })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: LadderLimits = LadderLimits {
        hold_frames: 2,
        safe_frames: 5,
        leak_q16: 1 << 12,
        saturated_actuators: 10,
        saturated_frames: 3,
    };

    #[test]
    fn bad_frames_climb_it_and_a_good_one_ends_that() {
        let mut ladder = Ladder::new();
        let lost = Rung::GiveUp(Fault::FramesLost { frames: 6 });
        let expected = [Rung::Hold, Rung::Hold, Rung::Leak, Rung::Leak, Rung::Leak, lost];
        for rung in expected {
            assert_eq!(ladder.bad_frame(&LIMITS), rung);
        }
        for bad in 1..=5 {
            let mut ladder = Ladder::new();
            let last = (0..bad).map(|_| ladder.bad_frame(&LIMITS)).last();
            assert_eq!(last, Some(expected[bad - 1]));
            assert_eq!(ladder.good(), Rung::Follow);
            assert_eq!(ladder.bad_frame(&LIMITS), Rung::Hold, "from the ground");
        }
    }

    #[test]
    fn without_rungs_the_first_bad_frame_gives_up() {
        let limits = LadderLimits { hold_frames: 0, safe_frames: 0, ..LIMITS };
        let lost = Rung::GiveUp(Fault::FramesLost { frames: 1 });
        assert_eq!(Ladder::new().bad_frame(&limits), lost);
        let limits = LadderLimits { hold_frames: 0, safe_frames: 1, ..LIMITS };
        assert_eq!(Ladder::new().bad_frame(&limits), Rung::Leak);
    }

    #[test]
    fn even_the_highest_ladder_ends() {
        let limits = LadderLimits { hold_frames: u16::MAX, safe_frames: u16::MAX, ..LIMITS };
        let mut ladder = Ladder::new();
        let rungs: Vec<_> = (0..u16::MAX).map(|_| ladder.bad_frame(&limits)).collect();
        assert!(rungs[..rungs.len() - 1].iter().all(|&rung| rung == Rung::Hold));
        assert_eq!(rungs.last(), Some(&Rung::GiveUp(Fault::FramesLost { frames: u16::MAX })));
    }

    #[test]
    fn saturation_that_lasts_opens() {
        let mut ladder = Ladder::new();
        let fault = Some(Fault::ActuatorsSaturated { actuators: 11, most: 10 });
        assert_eq!([11, 11].map(|n| ladder.saturated(n, &LIMITS)), [None, None]);
        assert_eq!(ladder.saturated(10, &LIMITS), None, "as many as may be");
        assert_eq!([11, 11, 11].map(|n| ladder.saturated(n, &LIMITS)), [None, None, fault]);
        let never = LadderLimits { saturated_frames: 0, ..LIMITS };
        assert!((0..100).all(|_| ladder.saturated(u16::MAX, &never).is_none()));
    }

    #[test]
    fn a_bad_frame_in_between_does_not_hide_saturation() {
        let mut ladder = Ladder::new();
        ladder.saturated(11, &LIMITS);
        ladder.saturated(11, &LIMITS);
        ladder.bad_frame(&LIMITS);
        ladder.good();
        assert!(ladder.saturated(11, &LIMITS).is_some());
    }
}
