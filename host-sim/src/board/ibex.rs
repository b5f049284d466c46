//! The soft core: Ibex in a system of its own, simulated at register-transfer level.

use super::log::Format;
use super::process::{Emulator, Process};
use super::remote::Remote;
use super::{BoardError, Options, program};
use splash_firmware::spec::Spec;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;

/// Its name on the command line and in `firmware/boards`.
const NAME: &str = "ibex";
const TARGET: &str = "riscv32imc-unknown-none-elf";
/// The simulator, and what builds it unless it is up to date, from the top of the source tree.
const SIMULATOR: &str = "target/ibex/sim";
const BUILD: &str = "firmware/boards/ibex/sim/build";

/// Starts it without a configuration.
///
/// # Errors
/// [`BoardError`].
pub fn start(options: Options) -> Result<Process, BoardError> {
    emulator()?.start(options.patience)
}

/// Starts it with the configuration of `spec`.
///
/// # Errors
/// [`BoardError`].
pub fn open(spec: &Spec<'_>, options: Options) -> Result<Remote, BoardError> {
    Remote::open(&emulator()?, spec, options)
}

/// The command that runs a program of the board, `server` or `suite`, which it builds. Standard
/// output is the console.
///
/// # Errors
/// [`BoardError::Missing`] without what the simulator is built with, [`BoardError::Build`].
pub fn command(name: &str) -> Result<Vec<OsString>, BoardError> {
    let build = program::tree().join(BUILD);
    if !Command::new(&build).status().is_ok_and(|status| status.success()) {
        let what = format!(
            "{} cannot build the simulator: tests/toolchain.sh provides Verilator (package \
             verilator) and the core's sources",
            build.display()
        );
        return Err(BoardError::Missing { board: NAME, what });
    }
    let simulator = program::tree().join(SIMULATOR);
    Ok(vec![simulator.into_os_string(), program(name)?.into_os_string()])
}

/// Builds a program of the board: `server`, or `suite`.
///
/// # Errors
/// [`BoardError::Build`].
pub fn program(name: &str) -> Result<PathBuf, BoardError> {
    program::program(NAME, TARGET, name).map_err(|source| BoardError::Build { board: NAME, source })
}

/// The simulator with the server program in it. It writes marks whether they are asked for or not.
fn emulator() -> Result<Emulator, BoardError> {
    Ok(Emulator { board: NAME, command: command("server")?, log: Format::Text })
}
