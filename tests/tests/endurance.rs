//! The long run, a hundredth of it: `host-sim endure` runs a million frames.

use host_sim::board::{Board, BoardError, Options, ibex, in_process};
use host_sim::endurance::Endurance;
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

/// What an integrator of gain g leaves of a wave that turns by theta a frame, over the wave:
/// |1 - e^(-i theta)| / |1 - (1 - g) e^(-i theta)|, rms over Kolmogorov's tilts from 1/16 to 1/2 waves a
/// pitch, each drifting by an eighth of a pitch: f^(-2/3) df, times both averages over the subaperture.
fn left_over(gain: f64) -> f64 {
    let sinc = |u: f64| if u == 0.0 { 1.0 } else { u.sin() / u };
    let (mut left, mut all) = (0.0, 0.0);
    for i in 0..1000 {
        let f = 1.0 / 16.0 + (f64::from(i) + 0.5) / 1000.0 * (0.5 - 1.0 / 16.0);
        let tilt: f64 = (0..64)
            .map(|a| std::f64::consts::PI * f64::from(a) / 32.0)
            .map(|a| {
                let k = std::f64::consts::TAU * f / 2.0;
                (sinc(k * a.cos()) * sinc(k * a.sin())).powi(2)
            })
            .sum();
        let power = f.powf(-2.0 / 3.0) * tilt;
        let cosine = (std::f64::consts::TAU * f / 8.0).cos();
        let square = |keep: f64| 1.0 - 2.0 * keep * cosine + keep * keep;
        left += power * square(1.0) / square(1.0 - gain);
        all += power;
    }
    f64::sqrt(left / all)
}

#[test]
fn ten_thousand_frames_of_changing_seeing() {
    let setup = setup();
    let mut board = in_process(&setup.1.spec()).expect("valid");
    let (_, _, closed_px) = run(&setup, board.as_mut(), 10_000, false);
    let mut open = setup.0.clone();
    open.control.gain = 1e-3;
    let mut board = in_process(&Reconstructor::new(&open).expect("valid").spec()).expect("valid");
    let (_, _, open_px) = run(&setup, board.as_mut(), 10_000, false);
    // Sixteen waves of one seed stand for the spectrum, and their mean over the pupil, which is not
    // corrected, is not in the offsets.
    let (found, expected) = (closed_px / open_px, left_over(0.5));
    assert!(
        (found / expected - 1.0).abs() < 0.15,
        "{closed_px} of {open_px} px, expected {expected}"
    );
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
