//! What is compared.

use crate::optics::geometric::Sensor;
use clap::ValueEnum;

/// A sensor with its loop, or the best that the mirror can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Comparator {
    /// Laser spots launched through the pupil.
    Splash,
    /// A conventional laser guide star.
    Lgs,
    /// A natural guide star.
    Ngs,
    /// Piston, tip and tilt of each segment fitted to the star's phase.
    Fit,
}

impl Comparator {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Splash, Self::Lgs, Self::Ngs, Self::Fit];

    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Splash => "splash",
            Self::Lgs => "lgs",
            Self::Ngs => "ngs",
            Self::Fit => "fit",
        }
    }

    /// The one of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|comparator| comparator.name() == name)
    }

    /// The sensor; a fit has none.
    pub fn sensor(self) -> Option<Sensor> {
        match self {
            Self::Splash => Some(Sensor::Splash),
            Self::Lgs => Some(Sensor::Lgs),
            Self::Ngs => Some(Sensor::Ngs),
            Self::Fit => None,
        }
    }
}
