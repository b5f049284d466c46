//! What frames cost on a board, stage by stage: cycles, instructions or nanoseconds.

mod contents;
mod second_gate;
mod sizes;

pub use contents::Content;
pub use second_gate::SecondGate;
pub use sizes::Sizes;

use crate::board::{Board, BoardError, Frame};
use splash_firmware::link::Stack;
use splash_firmware::pipeline::Outcome;
use splash_firmware::spec::{Map, Spec};

/// What comes before the tail.
pub const CENTROID: &str = "centroid";
/// What is left when the last pixel is in, in its order.
pub const TAIL: [&str; 5] = ["slopes", "control", "sor", "segments", "actuators"];

/// Frames before the ones that count: the first relaxes longer, and thresholds follow the second.
const WARM_UP: u32 = 4;
/// Frames of each content.
pub const ROUNDS: u32 = 3;
/// Frames that [`measure`] runs.
pub const FRAMES: u32 = WARM_UP + ROUNDS * Content::ALL.len() as u32;

/// What one frame took.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameCost {
    /// `begin`.
    pub begin: u64,
    /// Each block of rows.
    pub blocks: Vec<u64>,
    /// The stages after the last row, as in [`TAIL`].
    pub tail: [u64; TAIL.len()],
}

impl FrameCost {
    /// From the totals at the marks of a frame (see [`Board::marks`]), of which each is `own` later
    /// for being made; a clock's jitter may be more than a step. `None` if they are not those of a
    /// complete frame.
    pub fn from_marks(marks: &[u64], own: u64) -> Option<Self> {
        let (frame, tail) = marks.split_at_checked(marks.len().checked_sub(TAIL.len() + 2)?)?;
        let steps = |marks: &[u64]| -> Option<Vec<u64>> {
            marks
                .windows(2)
                .map(|pair| Some(pair[1].checked_sub(pair[0])?.saturating_sub(own)))
                .collect()
        };
        let (pairs, []) = frame.as_chunks::<2>() else { return None };
        let mut pushes = Vec::new();
        for pair in pairs {
            pushes.extend(steps(pair)?);
        }
        let (&begin, blocks) = pushes.split_first()?;
        // What comes between the last stage and the end is the report's way out.
        let (stages, end) = tail.split_at(TAIL.len() + 1);
        let mut tail: [u64; TAIL.len()] = steps(stages)?.try_into().ok()?;
        tail[TAIL.len() - 1] += steps(&[*stages.last()?, *end.first()?])?[0];
        Some(Self { begin, blocks: blocks.to_vec(), tail })
    }

    /// All until the last row is done.
    pub fn centroid(&self) -> u64 {
        self.begin + self.blocks.iter().sum::<u64>()
    }

    /// All that is left then.
    pub fn tail(&self) -> u64 {
        self.tail.iter().sum()
    }

    /// The whole frame.
    pub fn total(&self) -> u64 {
        self.centroid() + self.tail()
    }
}

/// The frames of a profile and what the board's stack came to.
#[derive(Clone, Debug)]
pub struct Profile {
    /// Complete frames, in the order they were given.
    pub frames: Vec<(Content, FrameCost)>,
    /// Since the board's start, configuration included; `None` on the host.
    pub stack: Option<Stack>,
}

impl Profile {
    /// The dearest frame.
    pub fn worst(&self) -> &FrameCost {
        let costs = self.frames.iter().map(|(_, cost)| cost);
        costs.max_by_key(|cost| cost.total()).expect("measure leaves no profile without frames")
    }

    /// The cheapest frame's total and the dearest's.
    pub fn range(&self) -> (u64, u64) {
        let totals = self.frames.iter().map(|(_, cost)| cost.total());
        totals.fold((u64::MAX, 0), |(least, most), total| (least.min(total), most.max(total)))
    }

    /// The largest count of each stage, [`CENTROID`] first.
    pub fn stages(&self) -> Vec<(&'static str, u64)> {
        let most = |pick: &dyn Fn(&FrameCost) -> u64| {
            self.frames.iter().map(|(_, cost)| pick(cost)).max().unwrap_or(0)
        };
        let tail = TAIL.iter().enumerate().map(|(i, &name)| (name, most(&|cost| cost.tail[i])));
        std::iter::once((CENTROID, most(&FrameCost::centroid))).chain(tail).collect()
    }

    /// The largest tail.
    pub fn tail(&self) -> u64 {
        self.frames.iter().map(|(_, cost)| cost.tail()).max().unwrap_or(0)
    }
}

/// `spec` with flux limits that every frame of a profile keeps: a held frame would do without the
/// tail.
pub fn every_flux(spec: Spec<'_>) -> Spec<'_> {
    let mut spec = spec;
    spec.slopes.flux_min_adu = Map::Uniform(1.0);
    spec.slopes.flux_max_adu = Map::Uniform(f64::from(1u32 << 26));
    spec
}

/// Why there is no profile.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    /// The board failed.
    #[error("{0}")]
    Board(#[from] BoardError),
    /// A frame that must be complete was held.
    #[error("frame {frame} ({content}) was {outcome:?}")]
    Held {
        /// The frame.
        frame: u32,
        /// What it showed.
        content: Content,
        /// What became of it.
        outcome: Outcome,
    },
    /// The marks are not those of the frames.
    #[error("frame {frame}: {marks} marks are not those of a complete frame")]
    Marks {
        /// The frame.
        frame: u32,
        /// How many there were.
        marks: usize,
    },
}

/// Runs [`FRAMES`] frames of every [`Content`], which `board` must have been opened for with marks
/// and the specification of [`every_flux`]; `step` is called after each.
///
/// # Errors
/// [`ProfileError`].
pub fn measure(
    board: &mut dyn Board,
    spec: &Spec<'_>,
    seed: u64,
    step: &mut dyn FnMut(),
) -> Result<Profile, ProfileError> {
    let start = board.marks()?;
    let &[first, second] = start.as_slice() else {
        return Err(ProfileError::Marks { frame: 0, marks: start.len() });
    };
    let own = second - first;
    let rounds = Content::ALL.into_iter().cycle().take((FRAMES - WARM_UP) as usize);
    let contents = std::iter::repeat_n(Content::Bright, WARM_UP as usize).chain(rounds);
    let mut frames = Vec::new();
    for (frame, content) in (0..).zip(contents) {
        let report = board.frame(frame, Frame::Pixels(&content.frame(spec, seed, frame)))?;
        if report.outcome != Outcome::Updated {
            return Err(ProfileError::Held { frame, content, outcome: report.outcome });
        }
        let marks = board.marks()?;
        let cost = FrameCost::from_marks(&marks, own)
            .ok_or(ProfileError::Marks { frame, marks: marks.len() })?;
        if frame >= WARM_UP {
            frames.push((content, cost));
        }
        step();
    }
    Ok(Profile { frames, stack: board.stack()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_taken_apart() {
        // A mark takes 1. begin 10; two blocks 20 and 30; stages 1 to 5; the end 7 more.
        let steps = [0, 11, 100, 21, 100, 31, 100, 2, 3, 4, 5, 6, 8];
        let marks: Vec<u64> = steps
            .iter()
            .scan(1000, |at, step| {
                *at += step;
                Some(*at)
            })
            .collect();
        let cost = FrameCost::from_marks(&marks, 1).expect("complete");
        let expected = FrameCost { begin: 10, blocks: vec![20, 30], tail: [1, 2, 3, 4, 12] };
        assert_eq!(cost, expected);
        assert_eq!((cost.centroid(), cost.tail(), cost.total()), (60, 22, 82));
        for short in 0..9 {
            assert_eq!(FrameCost::from_marks(&marks[..short], 1), None);
        }
        assert_eq!(FrameCost::from_marks(&marks[1..], 1), None, "half a pair");
    }
}
