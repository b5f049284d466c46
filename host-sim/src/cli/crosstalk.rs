//! The arguments of `host-sim crosstalk`.

use super::{DescriptionArgs, OutputArgs, between, subapertures};
use crate::instrument::LatticeName;
use clap::builder::PossibleValue;
use clap::{Args, ValueEnum, value_parser};

/// `host-sim crosstalk`.
///
/// Spots of a beacon are a pitch apart and about lambda H / d wide: a sodium beacon and small subapertures bring
/// them together. On one detector, at their places on the sky, a window then has light of its neighbours in it,
/// unless spots are lit in turn. Each distance is that of a pitch d = r0 = (distance lambda H)^(1/2); windows are
/// as large as fits between the spots that are lit together, up to the description's size. Beside it, under the
/// same screens, the same windows without light of others.
#[derive(Clone, Debug, Args)]
pub struct CrosstalkArgs {
    #[command(flatten)]
    pub(crate) description: DescriptionArgs,
    /// Subapertures across the pupil, 4 to 40: D/r0
    #[arg(
        long,
        value_name = "N",
        default_value_t = 8,
        value_parser = subapertures(),
        allow_negative_numbers = true
    )]
    pub(crate) n: usize,
    /// Distances of the spots, lambda/d
    #[arg(
        long,
        value_name = "DISTANCE",
        default_value = "1,1.5,2,3,4,6",
        value_parser = distance,
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(crate) spacing: Vec<f64>,
    /// Which spots are lit together: all, or a lattice by its least distance in pitches
    #[arg(
        long,
        value_name = "LATTICE",
        default_value = "all,sqrt2,2,sqrt5,3",
        value_delimiter = ','
    )]
    pub(crate) lattices: Vec<Turns>,
    /// Height of the beacon, m
    #[arg(
        long,
        value_name = "METRES",
        default_value_t = 90e3,
        value_parser = height,
        allow_negative_numbers = true
    )]
    pub(crate) beacon: f64,
    /// Wavelength of the laser and of the star, m
    #[arg(
        long,
        value_name = "METRES",
        default_value_t = 589e-9,
        value_parser = wavelength,
        allow_negative_numbers = true
    )]
    pub(crate) wavelength: f64,
    /// Independent screens for each distance
    #[arg(
        long,
        value_name = "SCREENS",
        default_value_t = 12,
        value_parser = value_parser!(u32).range(2..=1_000_000),
        allow_negative_numbers = true
    )]
    pub(crate) screens: u32,
    /// Wind of every layer in its direction, pitches per frame: what is lit in turn is followed more slowly
    #[arg(
        long,
        value_name = "PITCHES",
        default_value_t = 0.0,
        value_parser = wind,
        allow_negative_numbers = true
    )]
    pub(crate) wind: f64,
    /// Photon, dark and read noise of the description's detector, and its bits
    #[arg(long)]
    pub(crate) noise: bool,
    /// Seed of turbulence and noise
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// Which spots are lit together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turns {
    /// All of them.
    All,
    /// A colour of a lattice.
    Lattice(LatticeName),
}

impl Turns {
    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Lattice(name) => name.name(),
        }
    }
}

impl ValueEnum for Turns {
    fn value_variants<'a>() -> &'a [Self] {
        use LatticeName::{Sqrt2, Sqrt5, Sqrt8, Sqrt10, Three, Two};
        const ALL: [Turns; 7] = [
            Turns::All,
            Turns::Lattice(Sqrt2),
            Turns::Lattice(Two),
            Turns::Lattice(Sqrt5),
            Turns::Lattice(Sqrt8),
            Turns::Lattice(Three),
            Turns::Lattice(Sqrt10),
        ];
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.name()))
    }
}

fn distance(text: &str) -> Result<f64, String> {
    between(text, 0.125, 64.0)
}

fn height(text: &str) -> Result<f64, String> {
    between(text, 1e3, 1e6)
}

fn wavelength(text: &str) -> Result<f64, String> {
    between(text, 1e-7, 1e-4)
}

fn wind(text: &str) -> Result<f64, String> {
    between(text, 0.0, 10.0)
}
