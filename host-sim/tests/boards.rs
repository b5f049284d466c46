//! Boards on the command line: what goes wrong with an emulator ends the command in bounded time,
//! in words and with exit code 1, and leaves nothing behind.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// More than any of these may take once the board's program is built.
const BOUND: Duration = Duration::from_secs(10);

/// A folder with an emulator that does this, and room for temporary directories.
fn fake(body: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(folder.path().join("tmp")).expect("a folder");
    let path = folder.path().join("qemu-system-arm");
    let script = format!("#!/bin/sh\n[ \"$1\" = --version ] && exit\n{body}\n");
    std::fs::write(&path, script).expect("a script");
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).expect("a script");
    folder
}

/// `host-sim loop` on the emulator in this folder. Where the tests run in the background it would have learnt from the
/// shell to overlook Ctrl-C.
fn run(folder: &Path, patience: u32) -> Command {
    let path = std::env::var("PATH").unwrap_or_default();
    let mut command = Command::new("/usr/bin/env");
    command.args(["--default-signal=INT", env!("CARGO_BIN_EXE_host-sim")]);
    command.args(["loop", "--board", "qemu", "--sensing", "geometric", "--frames", "3"]);
    command.args(["--patience", &patience.to_string(), "--out"]).arg(folder.join("out"));
    command.env("PATH", format!("{}:{path}", folder.display())).env("TMPDIR", folder.join("tmp"));
    command
}

/// Whether the program for the board can be built here; if it must be, fails.
fn buildable() -> bool {
    match host_sim::board::qemu::program("server") {
        Ok(_) => true,
        Err(error) => {
            assert!(std::env::var_os("SPLASH_BOARDS").is_none(), "{error}");
            println!("skipped: {error}");
            false
        }
    }
}

/// Exit code and last line of the standard error.
fn end(output: &Output) -> (Option<i32>, String) {
    let text = String::from_utf8_lossy(&output.stderr);
    (output.status.code(), text.lines().last().unwrap_or_default().to_string())
}

#[test]
fn a_missing_emulator_is_named_with_its_package() {
    let nothing = tempfile::tempdir().expect("a folder");
    let mut command = run(nothing.path(), 1);
    let output = command.env("PATH", nothing.path()).output().expect("host-sim");
    let (code, message) = end(&output);
    assert_eq!(code, Some(1), "{message}");
    assert!(message.contains("board qemu: qemu-system-arm cannot be run"), "{message}");
    assert!(message.contains("package qemu-system-arm"), "{message}");
}

#[test]
fn an_emulator_that_fails_ends_the_command() {
    if !buildable() {
        return;
    }
    for (body, expected) in [
        ("exec sleep 1000", "board qemu: no answer within 1 s, when it was asked what it is"),
        ("exit 3", "board qemu: its program ended (exit status: 3), when it was asked what it is"),
        (
            "cat link.in >/dev/null & exec printf '\\3zz\\0' >link.out",
            "board qemu: it sent a message that is cut short, when it was asked what it is",
        ),
    ] {
        let folder = fake(body);
        let start = Instant::now();
        let output = run(folder.path(), 1).output().expect("host-sim");
        let (code, message) = end(&output);
        assert_eq!(code, Some(1), "{body}: {message}");
        assert!(message.ends_with(expected), "{body}: {message}");
        assert!(start.elapsed() < BOUND, "{body}: {:?}", start.elapsed());
        assert!(is_empty(&folder.path().join("tmp")), "{body}");
    }
}

fn is_empty(folder: &Path) -> bool {
    std::fs::read_dir(folder).expect("a folder").next().is_none()
}

/// Whether a process with this word in its command line runs.
fn runs(word: &str) -> bool {
    let entries = std::fs::read_dir("/proc").expect("Linux");
    let line = |entry: std::io::Result<std::fs::DirEntry>| {
        std::fs::read_to_string(entry.ok()?.path().join("cmdline")).ok()
    };
    entries.filter_map(line).any(|line| line.contains(word))
}

/// Waits until this comes true.
fn soon(what: &str, holds: impl Fn() -> bool) {
    let until = Instant::now() + 3 * BOUND;
    while !holds() {
        assert!(Instant::now() < until, "not {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Ends a process with this signal, as another terminal or Ctrl-C would.
fn signal(child: &mut Child, signal: &str) {
    let id = child.id().to_string();
    assert!(Command::new("kill").args([signal, &id]).status().expect("kill").success());
    child.wait().expect("it ends");
}

#[test]
fn a_killed_command_leaves_no_emulator() {
    if !buildable() {
        return;
    }
    for name in ["-KILL", "-INT"] {
        // One that hangs, under a name of its own.
        let word = format!("{}{}", 100_000 + std::process::id(), name.len());
        let folder = fake(&format!("exec sleep {word}"));
        let mut child = run(folder.path(), 600).stderr(Stdio::null()).spawn().expect("host-sim");
        soon("running", || runs(&word));
        signal(&mut child, name);
        soon("gone", || !runs(&word));
        soon("tidy", || is_empty(&folder.path().join("tmp")));
    }
}
