//! What the tests of long commands share.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// `host-sim COMMAND ARGUMENTS` in `place`, on so many threads.
pub(crate) fn program(command: &str, place: &Path, threads: &str, arguments: &[&str]) -> Command {
    let mut program = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    program.arg(command).args(arguments).current_dir(place).env("RAYON_NUM_THREADS", threads);
    program
}

/// Runs it to its end.
pub(crate) fn run(command: &str, place: &Path, threads: &str, arguments: &[&str]) -> Output {
    program(command, place, threads, arguments).output().unwrap()
}

/// Runs it with `--json`, expects success and returns its one line.
pub(crate) fn json(command: &str, place: &Path, threads: &str, arguments: &[&str]) -> Value {
    let output = run(command, place, threads, &[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.lines().count(), 1, "{text}");
    serde_json::from_str(&text).unwrap()
}
