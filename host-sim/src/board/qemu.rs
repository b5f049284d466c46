//! The Cortex-M7 that QEMU emulates, as MPS2 board with the AN500 image.

use super::log::Format;
use super::process::{Emulator, Process};
use super::remote::{MARKS, Remote};
use super::{BoardError, BuildError, Options, program};
use splash_firmware::spec::Spec;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Its name on the command line.
const NAME: &str = "qemu";
/// Where its program and the plugin are, in `firmware/boards`.
const FOLDER: &str = "mps2-an500";
const TARGET: &str = "thumbv7em-none-eabihf";
const QEMU: &str = "qemu-system-arm";

/// Starts it without a configuration.
///
/// # Errors
/// [`BoardError`].
pub fn start(options: Options) -> Result<Process, BoardError> {
    emulator(options)?.start(options.patience)
}

/// Starts it with the configuration of `spec`.
///
/// # Errors
/// [`BoardError`].
pub fn open(spec: &Spec<'_>, options: Options) -> Result<Remote, BoardError> {
    Remote::open(&emulator(options)?, spec, options)
}

/// The command that runs a program of the board: nothing but the processor, no display, no serial
/// lines, no monitor. Standard output is the semihosting console.
pub fn command(elf: &Path, more: &[OsString]) -> Vec<OsString> {
    let machine = "-machine mps2-an500 -display none -monitor none -serial none \
                   -chardev stdio,id=log,signal=off \
                   -semihosting-config enable=on,target=native,chardev=log";
    let mut command: Vec<OsString> = vec![QEMU.into()];
    command.extend(machine.split_whitespace().map(OsString::from));
    command.extend_from_slice(more);
    command.extend(["-kernel".into(), elf.into()]);
    command
}

/// Builds a program of the board: `server`, or `suite`.
///
/// # Errors
/// [`BoardError::Missing`] without QEMU, [`BoardError::Build`].
pub fn program(name: &str) -> Result<PathBuf, BoardError> {
    let found = Command::new(QEMU).arg("--version").stdout(Stdio::null()).status();
    if !found.is_ok_and(|status| status.success()) {
        let what = format!("{QEMU} cannot be run: it comes with the package qemu-system-arm");
        return Err(BoardError::Missing { board: NAME, what });
    }
    program::program(FOLDER, TARGET, name).map_err(failed)
}

fn failed(source: BuildError) -> BoardError {
    BoardError::Build { board: NAME, source }
}

/// The emulator with the server program in it, and with the counter if marks are asked for.
fn emulator(options: Options) -> Result<Emulator, BoardError> {
    let elf = program("server")?;
    let image = std::fs::read(&elf).map_err(|error| BoardError::Missing {
        board: NAME,
        what: format!("{}: {error}", elf.display()),
    })?;
    let mut counter = Vec::new();
    if options.marks {
        let mut plugin = program::plugin(FOLDER).map_err(failed)?.into_os_string();
        plugin.push(format!(",marks={MARKS}"));
        counter = vec!["-plugin".into(), plugin];
    }
    let log = Format::of(&image);
    Ok(Emulator { board: NAME, command: command(&elf, &counter), log })
}
