//! Boards elsewhere: the loop that serves them, processes that fail in every way, and the emulated
//! boards themselves, which give the codes of the library in this process.

mod commands;
mod emulated;
mod operator;
mod parameters;
mod processes;
mod server;
mod two_gates;

use host_sim::board::remote::Remote;
use host_sim::board::{Board, BoardError, Frame, in_process};
use splash_firmware::centroid::Measurement;
use splash_firmware::controller::Command;
use splash_firmware::mode::{Mode, Refusal};
use splash_firmware::spec::Estimator;
use splash_tests::frames::{Background, Rng, frame, scattered};
use splash_tests::instrument::Instrument;

/// 8 x 8 subapertures in a circle, windows of 8 x 8 pixels.
fn usual() -> Instrument {
    let mut instrument = Instrument::circle(8, 8);
    instrument.estimator = Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.1 };
    instrument.slew_m_per_frame = Some(instrument.stroke_m / 100.0);
    instrument
}

/// Frames of spots that wander by two pixels, with noise.
fn frames(instrument: &Instrument, count: usize) -> Vec<Vec<u16>> {
    let mut rng = Rng::new(12);
    let mut one = || {
        let spots = scattered(instrument, (900, 400, 512), &mut rng);
        frame(instrument, &spots, &Background::DEFAULT, &mut rng)
    };
    (0..count).map(|_| one()).collect()
}

/// Gives a board good frames and bad ones: it must do, and say, what the library here does.
fn same_as_here(instrument: &Instrument, there: &mut Remote) {
    let mut here = in_process(&instrument.spec()).expect("configuration");
    assert_eq!((here.ulp_m(), here.components()), (there.ulp_m(), there.components()));
    let pixels = frames(instrument, 5);
    let width = usize::from(instrument.detector.width);
    let count = instrument.count();
    let measurements = vec![Measurement { flux: 4000, ..Measurement::default() }; count];
    let same = |here: &dyn Board, there: &dyn Board, when: &str| {
        assert_eq!(here.codes(), there.codes(), "{when}");
        assert_eq!(here.measurements(), there.measurements(), "{when}");
        assert_eq!(here.slopes(), there.slopes(), "{when}");
        assert_eq!(here.positions(), there.positions(), "{when}");
        assert_eq!(here.totals(), there.totals(), "{when}");
    };
    same(here.as_ref(), there, "at the start");
    let given = [
        Frame::Pixels(&pixels[0]),
        // Cut short, without a row, with a row cut short.
        Frame::Pixels(&pixels[1][..9 * width]),
        Frame::Pixels(&[]),
        Frame::Pixels(&pixels[2][..9 * width + 1]),
        Frame::Pixels(&pixels[2]),
        Frame::Measurements(&measurements),
        Frame::Measurements(&measurements[1..]),
        Frame::Pixels(&pixels[3]),
    ];
    for (number, frame) in given.into_iter().enumerate() {
        let number = number as u32;
        match (here.frame(number, frame), there.frame(number, frame)) {
            (Ok(report), Ok(reported)) => {
                assert_eq!(report, reported);
                same(here.as_ref(), there, &format!("after frame {number}"));
            }
            (
                Err(BoardError::Refused { source: here, .. }),
                Err(BoardError::Refused { source: there, .. }),
            ) => assert_eq!(here, there),
            (here, there) => panic!("frame {number}: {here:?} here, {there:?} there"),
        }
    }
    let totals = here.totals();
    assert_eq!((totals.updated, totals.cut_short, totals.restarted), (4, 2, 2));
    here.reset().expect("here");
    there.reset().expect("there");
    same(here.as_ref(), there, "after a reset");
    let last = Frame::Pixels(&pixels[4]);
    assert_eq!(here.frame(0, last).expect("here"), there.frame(0, last).expect("there"));
    same(here.as_ref(), there, "after the frame behind it");
    let close = Command::Enter(Mode::ClosedLoop);
    for board in [here.as_mut() as &mut dyn Board, there] {
        let Err(BoardError::Refusal(refusal)) = board.command(close) else { panic!("refused") };
        assert_eq!(refusal, Refusal::NoWay { from: Mode::Safe, to: Mode::ClosedLoop });
    }
}
