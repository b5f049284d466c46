//! The long run, a hundredth of it: `host-sim endure` runs a million frames.

use host_sim::board::{Board, BoardError, Options, ibex, in_process};
use host_sim::endurance::{Endurance, SETTLE};
use host_sim::instrument::Instrument;
use host_sim::reconstructor::Reconstructor;

fn setup() -> (Instrument, Reconstructor) {
    let instrument = Instrument::standard().expect("valid");
    let reconstructor = Reconstructor::new(&instrument).expect("valid");
    (instrument, reconstructor)
}

fn run(
    (instrument, reconstructor): &(Instrument, Reconstructor),
    board: &mut dyn Board,
    frames: u64,
    marks: bool,
) -> (String, Option<[u64; 2]>, f64) {
    let mut run = Endurance::new(instrument, reconstructor, board, 1, marks).expect("a board");
    for _ in 0..frames {
        run.step().expect("what must hold");
    }
    let (cost, offset_px) = (run.cost(), run.stretch().offset_px);
    (run.finish().expect("equal totals"), cost, offset_px)
}

#[test]
fn ten_thousand_frames_of_changing_seeing() {
    let setup = setup();
    let mut board = in_process(&setup.1.spec()).expect("valid");
    let (_, _, closed_px) = run(&setup, board.as_mut(), 10_000, false);
    // Without correction the spots wander by more than a pixel, rms.
    let mut open = setup.0.clone();
    open.control.gain = 1e-3;
    let mut board = in_process(&Reconstructor::new(&open).expect("valid").spec()).expect("valid");
    let (_, _, open_px) = run(&setup, board.as_mut(), 3 * SETTLE, false);
    assert!(closed_px < 0.4 * open_px, "closed {closed_px} px, open {open_px} px");
}

#[test]
fn the_same_on_the_soft_core_in_the_same_time_for_every_frame() {
    let setup = setup();
    let options = Options { marks: true, ..Options::default() };
    let mut board = match ibex::open(&setup.1.spec(), options) {
        Ok(board) => board,
        Err(error @ (BoardError::Missing { .. } | BoardError::Build { .. }))
            if std::env::var_os("SPLASH_BOARDS").is_none() =>
        {
            return println!("skipped: {error}");
        }
        Err(error) => panic!("{error}"),
    };
    let (digest, cost, _) = run(&setup, &mut board, 16, true);
    let [least, most] = cost.expect("marks");
    assert_eq!(least, most, "cycles");
    let mut here = in_process(&setup.1.spec()).expect("valid");
    assert_eq!(run(&setup, here.as_mut(), 16, false).0, digest);
}
