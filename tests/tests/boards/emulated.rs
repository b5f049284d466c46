//! The emulated boards: the same codes as the library in this process.
//!
//! Without the emulator or the target's compiler these say why they are skipped; with SPLASH_BOARDS
//! in the environment they fail in place of that.

use super::{frames, same_as_here, usual};
use host_sim::board::remote::Remote;
use host_sim::board::{Board, BoardError, Frame, Options, ibex, in_process, qemu};
use host_sim::calibration::calibrated;
use host_sim::closed_loop::{ClosedLoop, Run, Sensing};
use host_sim::instrument::Instrument as Description;
use host_sim::optics::geometric::Sensor;
use host_sim::reconstructor::Reconstructor;
use host_sim::summary::CodeDigest;
use splash_firmware::pipeline::Totals;
use splash_firmware::spec::{Estimator, Spec};
use splash_suite::{BUFFER, MODES, PIXELS, WINDOWS, Workspace};
use splash_tests::instrument::Instrument;
use splash_tests::with_big_stack;
use std::ffi::OsString;
use std::io::{Read, Seek};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

type Open = fn(&Spec<'_>, Options) -> Result<Remote, BoardError>;

/// A board, if there is what it takes.
fn board(open: Open, spec: &Spec<'_>, options: Options) -> Option<Remote> {
    or_skip(open(spec, options))
}

pub(super) fn or_skip<T>(made: Result<T, BoardError>) -> Option<T> {
    match made {
        Ok(made) => Some(made),
        Err(error @ (BoardError::Missing { .. } | BoardError::Build { .. }))
            if std::env::var_os("SPLASH_BOARDS").is_none() =>
        {
            println!("skipped: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Digest and totals of a loop closed by this board with the default instrument.
fn closed(
    description: &Description,
    reconstructor: &Reconstructor,
    board: &mut dyn Board,
    (sensing, frames): (Sensing, u32),
) -> (String, Totals) {
    let run = Run { sensor: Sensor::Splash, sensing, frames, seed: 1, noise_free: false };
    let mut closed =
        ClosedLoop::new(description, reconstructor, board, run, &mut |_| ()).expect("closed loop");
    let mut digest = CodeDigest::default();
    for _ in 0..frames {
        closed.operate().expect("a mode");
        closed.step().expect("a frame");
        digest.add(closed.board().codes());
    }
    (digest.hex(), closed.board().totals())
}

fn closes_the_loop(open: Open, toml: &str, frames: u32) {
    close_the_loop(&[open], toml, frames);
}

fn close_the_loop(boards: &[Open], toml: &str, frames: u32) {
    let description = Description::parse(toml, "test").expect("a description");
    let reconstructor = Reconstructor::new(&description).expect("default");
    let reconstructor = reconstructor.with_second_gate(&|_| ()).expect("its gates");
    let reconstructor =
        calibrated(Sensor::Splash, reconstructor, &mut |_| ()).expect("calibration");
    let spec = reconstructor.spec();
    let sensings = [Sensing::Images, Sensing::Geometric];
    let expected = sensings.map(|sensing| {
        let mut here = in_process(&spec).expect("configuration");
        closed(&description, &reconstructor, here.as_mut(), (sensing, frames))
    });
    for open in boards {
        let Some(mut there) = board(*open, &spec, Options::default()) else { continue };
        for (sensing, expected) in sensings.into_iter().zip(&expected) {
            there.reset().expect("there");
            let found = closed(&description, &reconstructor, &mut there, (sensing, frames));
            println!("{sensing:?}, {frames} frames: {}", found.0);
            assert_eq!(found, *expected, "{sensing:?}");
        }
    }
}

/// What a program prints that ends by itself with exit code 0.
fn printed(command: &[OsString]) -> String {
    let mut output = tempfile::tempfile().expect("a file");
    let (program, arguments) = command.split_first().expect("a program");
    let stdout = output.try_clone().expect("a file");
    let mut command = Command::new(program);
    let mut child =
        command.args(arguments).stdout(stdout).stdin(Stdio::null()).spawn().expect("it");
    let until = Instant::now() + Duration::from_secs(300);
    let status = loop {
        match child.try_wait().expect("a child") {
            Some(status) => break status,
            None if Instant::now() > until => {
                child.kill().expect("a child");
                panic!("{program:?} does not end");
            }
            None => std::thread::sleep(Duration::from_millis(10)),
        }
    };
    let mut text = String::new();
    output.rewind().expect("a file");
    output.read_to_string(&mut text).expect("text");
    assert!(status.success(), "{status}: {text}");
    text
}

/// Compares what the suite prints there with what it prints here.
fn gives_the_same_bits(command: &[OsString]) {
    let found = printed(command);
    let mut expected = String::new();
    with_big_stack(|| {
        let mut workspace = Box::new(Workspace::<WINDOWS, PIXELS, BUFFER, MODES>::new());
        workspace.run(&mut |line| expected += &format!("{line}\n")).expect("the suite");
    });
    let pairs = found.lines().zip(expected.lines());
    let different = pairs.filter(|(found, expected)| found != expected).collect::<Vec<_>>();
    assert!(different.is_empty(), "there and here: {different:#?}");
    assert_eq!(found.lines().count(), expected.lines().count());
}

#[test]
fn every_stage_gives_the_same_bits_on_qemu() {
    let Some(elf) = or_skip(qemu::program("suite")) else { return };
    gives_the_same_bits(&qemu::command(&elf, &[]));
}

#[test]
fn every_stage_gives_the_same_bits_on_ibex() {
    let Some(command) = or_skip(ibex::command("suite")) else { return };
    gives_the_same_bits(&command);
}

#[test]
fn qemu_closes_the_loop_as_the_host_does() {
    closes_the_loop(qemu::open, "", 200);
}

#[test]
fn ibex_closes_the_loop_as_the_host_does() {
    closes_the_loop(ibex::open, "", 20);
}

/// Five groups of spots, a group a frame.
const INTERLEAVED: &str = "[schedule]\nlattice = \"sqrt5\"";

#[test]
fn qemu_lights_spots_in_turn_as_the_host_does() {
    closes_the_loop(qemu::open, INTERLEAVED, 10);
}

#[test]
fn ibex_lights_spots_in_turn_as_the_host_does() {
    closes_the_loop(ibex::open, INTERLEAVED, 10);
}

#[test]
fn emulated_boards_combine_two_gates_as_the_host_does() {
    close_the_loop(&[qemu::open, ibex::open], "[second_gate]\nheight_m = 6000.0", 12);
}

#[test]
fn emulated_boards_combine_two_gates_of_sixteen_subapertures_as_the_host_does() {
    let sixteen = "[telescope]\nsubapertures = 16\n[windows]\nsize = 8\nspacing_px = 8\n\
                   [second_gate]\nheight_m = 6000.0";
    close_the_loop(&[qemu::open, ibex::open], sixteen, 4);
}

fn does_with_bad_frames_what_the_host_does(open: Open, name: &str) {
    let mut sixteen = Instrument::circle(16, 8);
    sixteen.estimator = Estimator::Brightest { count: 12 };
    for instrument in [usual(), sixteen] {
        let Some(mut there) = board(open, &instrument.spec(), Options::default()) else {
            return;
        };
        assert_eq!(there.identity().board, name);
        same_as_here(&instrument, &mut there);
    }
}

#[test]
fn qemu_does_with_bad_frames_what_the_host_does() {
    does_with_bad_frames_what_the_host_does(qemu::open, "mps2-an500");
}

#[test]
fn ibex_does_with_bad_frames_what_the_host_does() {
    does_with_bad_frames_what_the_host_does(ibex::open, "ibex");
}

#[test]
fn a_geometry_that_does_not_fit_qemu_is_refused() {
    let large = Instrument::circle(16, 16);
    match board(qemu::open, &usual().spec(), Options::default()) {
        None => {}
        Some(_) => {
            let error = qemu::open(&large.spec(), Options::default()).err().expect("too large");
            let expected = "board qemu: windows.pixels = 53248: must be from 1 to 26624";
            assert_eq!(error.to_string(), expected);
        }
    }
}

/// Totals at the marks of three frames.
fn marks(instrument: &Instrument) -> Option<Vec<Vec<u64>>> {
    let options = Options { marks: true, ..Options::default() };
    let mut board = board(qemu::open, &instrument.spec(), options)?;
    let pixels = frames(instrument, 3);
    let start = board.marks().expect("marks");
    assert_eq!(start.len(), 2, "those at the start: {start:?}");
    assert_eq!(start[1] - start[0], 1, "a mark is one instruction");
    let one = |(number, pixels): (usize, &Vec<u16>)| {
        board.frame(number as u32, Frame::Pixels(pixels)).expect("a frame");
        let marks = board.marks().expect("marks");
        marks.iter().map(|mark| mark - marks[0]).collect()
    };
    Some(pixels.iter().enumerate().map(one).collect())
}

#[test]
fn instructions_on_qemu_are_counted_exactly() {
    let instrument = usual();
    let Some(counted) = marks(&instrument) else { return };
    let rows = usize::from(instrument.detector.height);
    for marks in &counted {
        // begin; push_rows each 16 rows; finish, in which five stages.
        assert_eq!(marks.len(), 2 + 2 * rows.div_ceil(16) + 2 + 5);
        assert!(marks.is_sorted());
    }
    // Nothing of a frame's path takes less than an instruction or two a pixel row.
    let total = counted[2].last().copied().unwrap_or_default();
    println!("{total} instructions in the last frame");
    assert!(total > rows as u64);
    assert_eq!(marks(&instrument), Some(counted), "the same in every run");
}
