//! Which spots are lit in a frame, and with how much of the laser's light.
//!
//! A schedule ([`splash_firmware::schedule`]) colours the subapertures; frame k lights the spots of colour
//! k modulo the number of colours. A lit spot has the photo-electrons of [`Instrument::electrons_per_spot`]; or, with
//! `schedule.power = "shared"`, the laser's power, which is enough to light all N spots like that, goes to
//! the n of the colour, and each has N / n times as much.

use crate::error::Error;
use crate::instrument::{Instrument, PowerName};
use crate::pupil::Pupil;
use splash_firmware::schedule::lit_by;

/// The colours of an instrument's spots and their light.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// One a subaperture, in mask order.
    colours: Vec<u8>,
    /// Photo-electrons of a lit spot, for each colour.
    electrons: Vec<f64>,
}

impl Lighting {
    /// That of an instrument's schedule; one colour without a schedule.
    ///
    /// # Errors
    /// [`Error::Config`] for a schedule that cannot be.
    pub fn new(instrument: &Instrument) -> Result<Self, Error> {
        Ok(Self::of(instrument, instrument.electrons_per_spot()?, instrument.colours()?))
    }

    /// That of the schedule on a pupil, which may be larger than any that the firmware takes.
    ///
    /// # Errors
    /// As [`Lighting::new`].
    pub fn on(instrument: &Instrument, pupil: &Pupil) -> Result<Self, Error> {
        let cells: Vec<_> = pupil.subapertures().iter().map(|&[x, y]| (x, y)).collect();
        let colours = instrument.colours_of(pupil.across(), &cells)?;
        Ok(Self::of(instrument, instrument.electrons_per_spot_on(pupil), colours))
    }

    fn of(instrument: &Instrument, each: f64, colours: Vec<u8>) -> Self {
        let count = colours.iter().max().map_or(1, |&last| usize::from(last) + 1);
        let electrons = |colour: usize| match instrument.schedule.power {
            PowerName::PerSpot => each,
            PowerName::Shared => {
                let lit = colours.iter().filter(|&&c| usize::from(c) == colour).count();
                each * colours.len() as f64 / lit.max(1) as f64
            }
        };
        Self { electrons: (0..count).map(electrons).collect(), colours }
    }

    /// Frames of a cycle, each of which lights a colour: 1 without a schedule.
    pub fn count(&self) -> u32 {
        self.electrons.len() as u32
    }

    /// The colour of each subaperture, in mask order.
    pub fn colours(&self) -> &[u8] {
        &self.colours
    }

    /// The colour that a frame lights.
    pub fn lit_by(&self, frame: u32) -> u8 {
        // At most 64 colours.
        lit_by(frame, self.electrons.len() as u8)
    }

    /// Whether a subaperture's spot is lit in a frame.
    pub fn lights(&self, frame: u32, subaperture: usize) -> bool {
        self.colours.get(subaperture) == Some(&self.lit_by(frame))
    }

    /// Photo-electrons of each spot that a frame lights.
    pub fn electrons(&self, frame: u32) -> f64 {
        self.electrons[usize::from(self.lit_by(frame))]
    }

    /// The spots of each colour: how many, and the photo-electrons of each.
    pub fn groups(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let members =
            |colour: usize| self.colours.iter().filter(move |&&c| usize::from(c) == colour);
        (0..).zip(&self.electrons).map(move |(colour, &each)| (members(colour).count(), each))
    }

    /// Photo-electrons of each spot in the frames that light it, in mask order.
    pub fn electrons_per_spot(&self) -> impl Iterator<Item = f64> + '_ {
        self.colours.iter().map(|&colour| self.electrons[usize::from(colour)])
    }
}
