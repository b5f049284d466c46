//! A board's process that hangs, dies or answers badly ends the wait in bounded time, with a message
//! that says what happened; nothing of it stays behind.

use super::{frames, same_as_here, usual};
use host_sim::board::process::Emulator;
use host_sim::board::remote::Remote;
use host_sim::board::{Board, BoardError, Format, Frame, Options};
use host_sim::error::Error;
use splash_tests::instrument::Instrument;
use std::time::{Duration, Instant};

/// Messages before the first frame: identity; ready; codes (52 in pieces of 16), totals, ready.
const BEFORE: usize = 1 + 1 + 6;
/// Messages of a frame: four lists, totals, report.
const FRAME: usize = 4 * 4 + 2;
/// More than any wait that is to end: patience, and what the process gets to leave.
const BOUND: Duration = Duration::from_secs(5);

fn options() -> Options {
    Options { patience: Duration::from_millis(700), ..Options::default() }
}

fn emulator(manner: &str) -> Emulator {
    let arguments = manner.split(' ').map(Into::into);
    let program = env!("CARGO_BIN_EXE_pipe-board").into();
    let command = std::iter::once(program).chain(arguments).collect();
    Emulator { board: "pipes", command, log: Format::Text }
}

fn open(manner: &str) -> Result<Remote, BoardError> {
    Remote::open(&emulator(manner), &usual().spec(), options())
}

/// Runs three frames: what went wrong, if anything did.
fn run(manner: &str) -> Result<(), BoardError> {
    let pixels = frames(&usual(), 3);
    let mut board = open(manner)?;
    for (number, pixels) in pixels.iter().enumerate() {
        board.frame(number as u32, Frame::Pixels(pixels))?;
    }
    Ok(())
}

#[test]
fn a_board_in_a_process_is_the_board_here() {
    let mut there = open("good").expect("a board");
    assert_eq!(there.identity().board, "pipe-board");
    same_as_here(&usual(), &mut there);
}

#[test]
fn a_geometry_that_does_not_fit_is_refused_by_the_board() {
    let large = Instrument::circle(16, 16);
    let error = Remote::open(&emulator("good"), &large.spec(), options()).err().expect("too large");
    let expected = "board pipes: windows.pixels = 53248: must be from 1 to 16384";
    assert_eq!(error.to_string(), expected);
    assert_eq!(Error::from(error).exit_code(), 2);
}

#[test]
fn every_failure_is_named_in_bounded_time() {
    let cases = [
        ("deaf", "no answer within 0.7 s, when it was asked what it is"),
        ("hang 1", "no answer within 0.7 s, when it was asked what it is"),
        ("hang 2", "no answer within 0.7 s, when it was configured"),
        ("hang 4", "no answer within 0.7 s, when the loop was opened"),
        (&format!("hang {}", BEFORE + 3), "no answer within 0.7 s, frame 0"),
        ("die 1", "its program ended (exit status: 7), when it was asked what it is"),
        (&format!("die {}", BEFORE + FRAME), "its program ended (exit status: 7), frame 0"),
        (
            &format!("skip {}", BEFORE + FRAME + 2),
            "it answered with codes from 32 on: must be from 16, frame 1",
        ),
        (&format!("skip {}", BEFORE + 4), "it answered with 48 codes: must be 52, frame 0"),
        (&format!("skip {}", BEFORE + FRAME), "no answer within 0.7 s, frame 0"),
        (&format!("damage {}", BEFORE + 1), "it sent a message with a wrong checksum, frame 0"),
    ];
    for (manner, expected) in cases {
        let start = Instant::now();
        let error = run(manner).expect_err(manner).to_string();
        assert_eq!(error, format!("board pipes: {expected}"), "{manner}");
        assert!(start.elapsed() < BOUND, "{manner}: {:?}", start.elapsed());
    }
    run("good").expect("the same frames");
}

/// Processes whose command line has this word.
fn processes(word: &str) -> Vec<String> {
    let entries = std::fs::read_dir("/proc").expect("Linux");
    let line = |entry: std::io::Result<std::fs::DirEntry>| {
        std::fs::read_to_string(entry.ok()?.path().join("cmdline")).ok()
    };
    entries.filter_map(line).filter(|line| line.contains(word)).collect()
}

/// Whether this comes true before long.
fn soon(mut holds: impl FnMut() -> bool) -> bool {
    let until = Instant::now() + BOUND;
    while !holds() {
        if Instant::now() > until {
            return false;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    true
}

#[test]
fn nothing_stays_behind() {
    for manner in ["good", "hang 9", "deaf", "die 9"] {
        let word = format!("word-{}-{}", std::process::id(), manner.replace(' ', "-"));
        let before = processes(&word).len();
        assert_eq!(before, 0);
        let board =
            open(&format!("{manner} {}{word}", if manner.contains(' ') { "" } else { "0 " }));
        assert_eq!(manner == "deaf", board.is_err(), "{manner}");
        if let Ok(mut board) = board {
            assert!(!processes(&word).is_empty(), "{manner}: it runs");
            let pixels = frames(&usual(), 1);
            let done = board.frame(0, Frame::Pixels(&pixels[0]));
            assert_eq!(done.is_ok(), manner == "good", "{manner}");
        }
        assert!(soon(|| processes(&word).is_empty()), "{manner}: {:?}", processes(&word));
    }
}
