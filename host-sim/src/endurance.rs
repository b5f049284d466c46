//! A long run: frames by the million through a board, on the quick sky of [`crate::quick`], with what must
//! hold for ever looked at after each.
//!
//! | what | holds if |
//! |---|---|
//! | frames | every one moved the mirror |
//! | mean piston | within 1 DAC LSB of zero: nothing that the sensor cannot see drifts |
//! | mean tip and tilt | within 1 LSB: as much |
//! | totals | equal to those counted here, in 64 bits |
//! | cost | the same for every frame, on a board whose time is exact |

use crate::board::{Board, Frame};
use crate::error::Error;
use crate::instrument::Instrument;
use crate::mirror::SegmentedMirror;
use crate::profile::{FrameCost, ProfileError};
use crate::pupil::Mirror;
use crate::quick::spots::Spots;
use crate::quick::waves::Waves;
use crate::reconstructor::Reconstructor;
use crate::summary::CodeDigest;
use splash_firmware::fixed::LENGTH_BITS;
use splash_firmware::pipeline::Outcome;
use splash_firmware::segments::Position;

/// Frames in which the loop closes, left out of every rms.
pub const SETTLE: u64 = 20;
/// ulp of a DAC LSB.
const LSB: f64 = (1u32 << LENGTH_BITS) as f64;

/// What a stretch of frames came to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stretch {
    /// Its last frame.
    pub frame: u64,
    /// r0 there, over the nominal one.
    pub seeing: f64,
    /// Distance of the spots from their reference, rms, px.
    pub offset_px: f64,
    /// Farthest that the mean piston was from zero, DAC LSB.
    pub piston_lsb: f64,
    /// Farthest that a mean tip or tilt was from zero, DAC LSB.
    pub tilt_lsb: f64,
}

/// The run.
pub struct Endurance<'a> {
    board: &'a mut dyn Board,
    waves: Waves,
    spots: Spots,
    device: SegmentedMirror,
    mirror: Mirror,
    centroids: Vec<[f64; 2]>,
    fluxes_e: Vec<f64>,
    digest: CodeDigest,
    frame: u64,
    counts: Counts,
    squares: f64,
    terms: u64,
    stretch: Stretch,
    /// What a mark takes, on a board that makes them.
    mark: Option<u64>,
    cost: Option<[u64; 2]>,
}

/// Counted here, without an end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    updated: u64,
    saturated_actuators: u64,
    slewed_actuators: u64,
}

impl<'a> Endurance<'a> {
    /// A run of a seed, from the flat mirror; `marks` as `board` was opened.
    ///
    /// # Errors
    /// [`Error`] of the board or the instrument.
    pub fn new(
        instrument: &Instrument,
        reconstructor: &Reconstructor,
        board: &'a mut dyn Board,
        seed: u64,
        marks: bool,
    ) -> Result<Self, Error> {
        let pupil = instrument.pupil()?;
        let count = pupil.subapertures().len();
        board.reset()?;
        let mark = match marks.then(|| board.marks()).transpose()?.as_deref() {
            None => None,
            Some(&[first, second]) => Some(second - first),
            Some(other) => return Err(ProfileError::Marks { frame: 0, marks: other.len() }.into()),
        };
        Ok(Self {
            board,
            waves: Waves::new(instrument, &pupil, seed),
            spots: Spots::new(instrument, reconstructor, seed),
            device: SegmentedMirror::new(instrument),
            mirror: Mirror::flat(count),
            centroids: vec![[0.0; 2]; count],
            fluxes_e: vec![instrument.electrons_per_spot()?; count],
            digest: CodeDigest::default(),
            frame: 0,
            counts: Counts::default(),
            squares: 0.0,
            terms: 0,
            stretch: Stretch::default(),
            mark,
            cost: None,
        })
    }

    /// One frame.
    ///
    /// # Errors
    /// [`Error::Run`] if the board refuses it or something does not hold: what, and in which frame.
    pub fn step(&mut self) -> Result<(), Error> {
        let number = self.frame as u32;
        self.stretch.seeing = self.waves.seeing();
        self.device.apply(self.board.codes(), &mut self.mirror);
        self.waves.centroids(&self.mirror, &mut self.centroids);
        if self.frame >= SETTLE {
            self.squares += self.centroids.as_flattened().iter().map(|c| c * c).sum::<f64>();
            self.terms += self.centroids.len() as u64;
        }
        let pixels = self.spots.expose(&self.centroids, &self.fluxes_e);
        let report = self.board.frame(number, Frame::Pixels(pixels))?;
        let fails = |what: String| Err(Error::Run(format!("frame {number}: {what}")));
        if report.outcome != Outcome::Updated {
            return fails(format!("{:?}", report.outcome));
        }
        self.counts.updated += 1;
        self.counts.saturated_actuators += u64::from(report.saturated_actuators);
        self.counts.slewed_actuators += u64::from(report.slewed_actuators);
        self.digest.add(self.board.codes());
        self.drift()?;
        self.take_time(number)?;
        self.frame += 1;
        self.stretch.frame = self.frame;
        Ok(())
    }

    /// What the sensor cannot see stays where it is.
    fn drift(&mut self) -> Result<(), Error> {
        let positions = self.board.positions();
        let mean = |pick: fn(&Position) -> i32| {
            let sum: i64 = positions.iter().map(|position| i64::from(pick(position))).sum();
            sum as f64 / positions.len() as f64 / LSB
        };
        let piston = mean(|position| position.piston_ulp).abs();
        let tilt = mean(|p| p.tilt_ulp[0]).abs().max(mean(|p| p.tilt_ulp[1]).abs());
        self.stretch.piston_lsb = self.stretch.piston_lsb.max(piston);
        self.stretch.tilt_lsb = self.stretch.tilt_lsb.max(tilt);
        if piston <= 1.0 && tilt <= 1.0 {
            return Ok(());
        }
        let frame = self.frame;
        Err(Error::Run(format!("frame {frame}: mean piston {piston} LSB, mean tilt {tilt} LSB")))
    }

    fn take_time(&mut self, number: u32) -> Result<(), Error> {
        let Some(mark) = self.mark else { return Ok(()) };
        let marks = self.board.marks()?;
        let cost = FrameCost::from_marks(&marks, mark)
            .ok_or(ProfileError::Marks { frame: number, marks: marks.len() })?;
        // The first relaxes longer, and thresholds follow the second.
        if self.frame >= 4 {
            let total = cost.total();
            let [least, most] = self.cost.unwrap_or([total; 2]);
            self.cost = Some([least.min(total), most.max(total)]);
        }
        Ok(())
    }

    /// What came since the last call.
    pub fn stretch(&mut self) -> Stretch {
        let (squares, terms) = (std::mem::take(&mut self.squares), std::mem::take(&mut self.terms));
        let offset_px = (squares / terms.max(1) as f64).sqrt();
        Stretch { offset_px, ..std::mem::take(&mut self.stretch) }
    }

    /// Least and most that a frame took; `None` without marks.
    pub fn cost(&self) -> Option<[u64; 2]> {
        self.cost
    }

    /// The digest of all codes.
    ///
    /// # Errors
    /// [`Error::Run`] if the board's totals are not those counted here.
    pub fn finish(self) -> Result<String, Error> {
        let totals = self.board.totals();
        let theirs = Counts {
            updated: totals.updated.into(),
            saturated_actuators: totals.saturated_actuators.into(),
            slewed_actuators: totals.slewed_actuators.into(),
        };
        if theirs == self.counts {
            return Ok(self.digest.hex());
        }
        Err(Error::Run(format!("the board counted {theirs:?}, here were {:?}", self.counts)))
    }
}
