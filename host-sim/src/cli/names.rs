//! Sensors and boards by name.

use crate::board::{self, Board, BoardError, Options};
use crate::optics::geometric::Sensor;
use clap::ValueEnum;
use splash_firmware::spec::Spec;
use std::path::PathBuf;

/// A sensor's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SensorName {
    /// Laser spots launched through the pupil.
    Splash,
    /// A conventional laser guide star.
    Lgs,
    /// A natural guide star.
    Ngs,
}

impl SensorName {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Splash => "splash",
            Self::Lgs => "lgs",
            Self::Ngs => "ngs",
        }
    }

    /// The optics of that name.
    pub fn sensor(self) -> Sensor {
        match self {
            Self::Splash => Sensor::Splash,
            Self::Lgs => Sensor::Lgs,
            Self::Ngs => Sensor::Ngs,
        }
    }
}

/// A board's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BoardName {
    /// In this process.
    Host,
    /// On the Cortex-M7 that QEMU emulates.
    Qemu,
    /// On the Ibex soft core, simulated at register-transfer level.
    Ibex,
}

impl BoardName {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Host => "host",
            Self::Qemu => "qemu",
            Self::Ibex => "ibex",
        }
    }

    /// The program on that board, which is built where it is needed; `None` on the host.
    ///
    /// # Errors
    /// [`BoardError::Missing`], [`BoardError::Build`].
    pub fn program(self) -> Result<Option<PathBuf>, BoardError> {
        match self {
            Self::Host => Ok(None),
            Self::Qemu => board::qemu::program("server").map(Some),
            Self::Ibex => board::ibex::program("server").map(Some),
        }
    }

    /// The board of that name, with the configuration of `spec`.
    ///
    /// # Errors
    /// [`BoardError`].
    pub fn open(self, spec: &Spec<'_>, options: Options) -> Result<Box<dyn Board>, BoardError> {
        Ok(match self {
            Self::Host => board::open(spec, options)?,
            Self::Qemu => Box::new(board::qemu::open(spec, options)?),
            Self::Ibex => Box::new(board::ibex::open(spec, options)?),
        })
    }
}
