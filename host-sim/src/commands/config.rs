//! `host-sim config`: the default instrument description.

use crate::error::Error;
use crate::instrument::DEFAULT_TOML;
use std::io::Write;

/// Prints it.
///
/// # Errors
/// [`Error::Run`] if stdout is closed.
pub fn run() -> Result<(), Error> {
    Ok(std::io::stdout().write_all(DEFAULT_TOML.as_bytes())?)
}
