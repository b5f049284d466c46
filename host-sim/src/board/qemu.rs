//! The Cortex-M7 that QEMU emulates, as MPS2 board with the AN500 image.

use super::log::Format;
use super::process::Emulator;
use super::remote::{MARKS, Remote};
use super::{BoardError, Options, program};
use splash_firmware::spec::Spec;
use std::ffi::OsString;
use std::process::{Command, Stdio};

/// Its name on the command line.
const NAME: &str = "qemu";
/// Where its program and the plugin are, in `firmware/boards`.
const FOLDER: &str = "mps2-an500";
const TARGET: &str = "thumbv7em-none-eabihf";
const QEMU: &str = "qemu-system-arm";

/// Starts it with the configuration of `spec`.
///
/// # Errors
/// [`BoardError`].
pub fn open(spec: &Spec<'_>, options: Options) -> Result<Remote, BoardError> {
    Remote::open(&emulator(options)?, spec, options)
}

/// The emulator with the server program in it, which is built if it is not up to date.
///
/// # Errors
/// [`BoardError::Missing`] without QEMU, [`BoardError::Build`].
pub fn emulator(options: Options) -> Result<Emulator, BoardError> {
    let found = Command::new(QEMU).arg("--version").stdout(Stdio::null()).status();
    if !found.is_ok_and(|status| status.success()) {
        let what = format!("{QEMU} cannot be run: it comes with the package qemu-system-arm");
        return Err(BoardError::Missing { board: NAME, what });
    }
    let failed = |source| BoardError::Build { board: NAME, source };
    let elf = program(FOLDER, TARGET, "server").map_err(failed)?;
    let image = std::fs::read(&elf).map_err(|error| BoardError::Missing {
        board: NAME,
        what: format!("{}: {error}", elf.display()),
    })?;
    let mut command: Vec<OsString> = vec![QEMU.into()];
    // Nothing but the processor: no display, no serial lines, no monitor. Standard output is the
    // semihosting console.
    let machine = "-machine mps2-an500 -display none -monitor none -serial none \
                   -chardev stdio,id=log,signal=off \
                   -semihosting-config enable=on,target=native,chardev=log";
    command.extend(machine.split_whitespace().map(OsString::from));
    if options.marks {
        let mut plugin = program::plugin(FOLDER).map_err(failed)?.into_os_string();
        plugin.push(format!(",marks={MARKS}"));
        command.extend(["-plugin".into(), plugin]);
    }
    command.extend(["-kernel".into(), elf.into_os_string()]);
    Ok(Emulator { board: NAME, command, log: Format::of(&image) })
}
