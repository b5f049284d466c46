//! The soft core: Ibex in a system of its own, simulated at register-transfer level.

use super::log::Format;
use super::process::Emulator;
use super::remote::Remote;
use super::{BoardError, Options, program};
use splash_firmware::spec::Spec;

/// Its name on the command line and in `firmware/boards`.
const NAME: &str = "ibex";
const TARGET: &str = "riscv32imc-unknown-none-elf";
/// The simulator, from the top of the source tree.
const SIMULATOR: &str = "target/ibex/sim";

/// Starts it with the configuration of `spec`.
///
/// # Errors
/// [`BoardError`].
pub fn open(spec: &Spec<'_>, options: Options) -> Result<Remote, BoardError> {
    Remote::open(&emulator()?, spec, options)
}

/// The simulator with the server program in it. It writes marks whether they are asked for or not.
fn emulator() -> Result<Emulator, BoardError> {
    let simulator = program::tree().join(SIMULATOR);
    if !simulator.exists() {
        let what = format!(
            "{} is not there: tests/toolchain.sh provides Verilator (package verilator) and the \
             core's sources, firmware/boards/ibex/sim/build builds it",
            simulator.display()
        );
        return Err(BoardError::Missing { board: NAME, what });
    }
    let elf = program::program(NAME, TARGET, "server")
        .map_err(|source| BoardError::Build { board: NAME, source })?;
    let command = vec![simulator.into_os_string(), elf.into_os_string()];
    Ok(Emulator { board: NAME, command, log: Format::Text })
}
