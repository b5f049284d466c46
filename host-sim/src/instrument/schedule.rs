//! The schedule of an instrument: which spots are lit together.

use super::Instrument;
use super::limits::check_drawing;
use crate::error::{Error, refuse};
use serde::{Deserialize, Serialize};
use splash_firmware::schedule::{MAX_COLOURS, colour};
use splash_firmware::spec::Colouring;

/// Which subapertures are lit together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct ScheduleSection {
    pub lattice: Lattice,
    pub colours: Colours,
    pub power: PowerName,
    pub separation: f64,
}

/// A lattice: its name, or its numbers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = r#"must be [], [a, b, c], "sqrt2", "2", "sqrt5", "sqrt8", "3" or "sqrt10""#
)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum Lattice {
    Numbers(Vec<u8>),
    Named(LatticeName),
}

/// The lattices of fewest colours by their least separation in pitches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum LatticeName {
    #[serde(rename = "sqrt2")]
    Sqrt2,
    #[serde(rename = "2")]
    Two,
    #[serde(rename = "sqrt5")]
    Sqrt5,
    #[serde(rename = "sqrt8")]
    Sqrt8,
    #[serde(rename = "3")]
    Three,
    #[serde(rename = "sqrt10")]
    Sqrt10,
}

impl LatticeName {
    /// The name in descriptions and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sqrt2 => "sqrt2",
            Self::Two => "2",
            Self::Sqrt5 => "sqrt5",
            Self::Sqrt8 => "sqrt8",
            Self::Three => "3",
            Self::Sqrt10 => "sqrt10",
        }
    }

    /// a, b and c: the table of [`splash_firmware::schedule`].
    pub const fn numbers(self) -> [u8; 3] {
        match self {
            Self::Sqrt2 => [2, 1, 1],
            Self::Two => [2, 0, 2],
            Self::Sqrt5 => [5, 2, 1],
            Self::Sqrt8 => [4, 2, 2],
            Self::Three => [3, 0, 3],
            Self::Sqrt10 => [10, 3, 1],
        }
    }
}

/// Colours one by one: in a list, or drawn.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = r#"must be a list of numbers, one a subaperture, or of rows such as "..0101..""#
)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum Colours {
    List(Vec<u8>),
    Rows(Vec<String>),
}

/// How bright a lit spot is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum PowerName {
    PerSpot,
    Shared,
}

impl ScheduleSection {
    /// All spots in every frame.
    pub const fn none() -> Self {
        Self {
            lattice: Lattice::Numbers(Vec::new()),
            colours: Colours::List(Vec::new()),
            power: PowerName::PerSpot,
            separation: 0.0,
        }
    }

    /// Whether there is neither a lattice nor a list of colours.
    pub(super) fn lights_all(&self) -> bool {
        self.lattice().is_none() && self.colours.is_empty()
    }

    /// a, b and c, if there is a lattice.
    pub(crate) fn lattice(&self) -> Option<[u8; 3]> {
        match &self.lattice {
            Lattice::Named(name) => Some(name.numbers()),
            Lattice::Numbers(numbers) => numbers.as_slice().try_into().ok(),
        }
    }

    /// Refuses numbers that are no lattice, and two colourings at once.
    pub(super) fn check(&self) -> Result<(), Error> {
        if let Lattice::Numbers(numbers) = &self.lattice
            && !matches!(numbers.len(), 0 | 3)
        {
            return Err(refuse("schedule.lattice", format!("{numbers:?}"), "[a, b, c]"));
        }
        let Some([a, _, c]) = self.lattice() else { return Ok(()) };
        let colours = usize::from(a) * usize::from(c);
        if !(1..=MAX_COLOURS).contains(&colours) {
            let limit = format!("from 1 to {MAX_COLOURS}");
            return Err(refuse("schedule.lattice: a c", colours, &limit));
        }
        if !self.colours.is_empty() {
            let found = format!("{} entries", self.colours.len());
            return Err(refuse("schedule.colours", found, "[] beside schedule.lattice"));
        }
        Ok(())
    }
}

impl Colours {
    fn len(&self) -> usize {
        match self {
            Self::List(colours) => colours.len(),
            Self::Rows(rows) => rows.len(),
        }
    }

    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl Instrument {
    /// The colour of each subaperture, in mask order: all 0 without a schedule.
    ///
    /// # Errors
    /// [`Error::Config`] if the schedule does not fit the mask.
    pub fn colours(&self) -> Result<Vec<u8>, Error> {
        let mask = self.mask()?;
        self.colours_of(mask.across(), &mask.cells().collect::<Vec<_>>())
    }

    /// [`Instrument::colours`] of subapertures in these cells of a grid.
    pub(crate) fn colours_of(
        &self,
        across: usize,
        cells: &[(usize, usize)],
    ) -> Result<Vec<u8>, Error> {
        let count = cells.len();
        if let Some(lattice) = self.schedule.lattice() {
            let lattice = Colouring::Lattice(lattice);
            return Ok(cells.iter().map(|&cell| colour(&lattice, 0, cell)).collect());
        }
        match &self.schedule.colours {
            colours if colours.is_empty() => Ok(vec![0; count]),
            Colours::List(colours) if colours.len() == count => Ok(colours.clone()),
            Colours::List(colours) => {
                let limit = format!("one a subaperture, of which there are {count}");
                Err(refuse("schedule.colours", format!("{} numbers", colours.len()), &limit))
            }
            Colours::Rows(rows) => {
                check_drawing("schedule.colours", rows, across)?;
                cells.iter().map(|&(x, y)| drawn(&rows[y], x)).collect()
            }
        }
    }
}

/// The colour that a row of characters has in column `x`.
fn drawn(row: &str, x: usize) -> Result<u8, Error> {
    let cell = char::from(row.as_bytes()[x]);
    match cell {
        '0'..='9' | 'a'..='z' => Ok(cell.to_digit(36).unwrap_or(0) as u8),
        _ => Err(refuse("schedule.colours", format!("{row:?}"), "0 to 9 or a to z in the pupil")),
    }
}
