//! Why a command ends without its result: two kinds, two exit codes.

use crate::board::BoardError;
use crate::detector::DetectorError;
use crate::figures::FigureError;
use crate::files::csv::CsvError;
use crate::files::fits::FitsError;
use crate::optics::OpticsError;
use crate::profile::ProfileError;
use splash_firmware::error::ConfigError;

/// A failed command. Displayed as one line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The arguments, the configuration or an input file cannot be used: exit code 2.
    #[error("{0}")]
    Config(String),
    /// A spot does not follow its segment, too faint or cut off: exit code 2.
    #[error("{0}")]
    Uncalibrated(String),
    /// The run itself failed: exit code 1.
    #[error("{0}")]
    Run(String),
}

impl Error {
    /// The process's exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Config(_) | Self::Uncalibrated(_) => 2,
            Self::Run(_) => 1,
        }
    }
}

/// `field = value: must be limit`.
pub fn refuse(field: &str, value: impl std::fmt::Display, limit: &str) -> Error {
    Error::Config(format!("{field} = {value}: must be {limit}"))
}

macro_rules! from {
    ($kind:ident: $($source:ty),*) => {
        $(impl From<$source> for Error {
            fn from(error: $source) -> Self {
                Self::$kind(error.to_string())
            }
        })*
    };
}
from!(Config: ConfigError, OpticsError, DetectorError);
from!(Run: CsvError, FigureError, FitsError, std::io::Error);

impl From<BoardError> for Error {
    fn from(error: BoardError) -> Self {
        let kind = match error {
            BoardError::Config(_) | BoardError::Unfit { .. } => Self::Config,
            _ => Self::Run,
        };
        kind(error.to_string())
    }
}

impl From<ProfileError> for Error {
    fn from(error: ProfileError) -> Self {
        match error {
            ProfileError::Board(error) => error.into(),
            other => Self::Run(other.to_string()),
        }
    }
}
