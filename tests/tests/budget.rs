//! Memory: what two calibration banks and the stack take.
//!
//! State and stack on the bare-metal targets are measured in the linked program (`tests/budget`);
//! a PC's state is larger by the lanes of its vector kernels. Here the banks have to fit with a
//! PC's alignment too, and the frame path to run in a thread that has little stack.

use std::mem::size_of;

use splash_firmware::config::Config;
use splash_firmware::controller::Controller;
use splash_firmware::pipeline::{Outcome, Pipeline};
use splash_firmware::spec::Estimator;
use splash_tests::frames::{Background, Rng, frame, scattered};
use splash_tests::instrument::{Instrument, run_frame};
use splash_tests::with_big_stack;

const KIB: usize = 1024;

/// One of two banks in 256 KiB, with 26 KiB beside them for a ring of rows: as many as 52 rows of 256
/// pixels.
const BANK: usize = 115 * KIB;
/// The stack below any call of the frame path, on a 64-bit host.
const STACK: usize = 8 * KIB;

/// Window pixels of 8 x 8 subapertures with windows of 16 x 16, and of 16 x 16 with 8 x 8.
const PIXELS: usize = 16_384;
/// Windows that share a row, for brightest-n: eight of 16 x 16, sixteen of 8 x 8.
const BUFFER_8: usize = 8 * 16 * 16;
const BUFFER_16: usize = 16 * 8 * 8;

fn check(what: &str, bytes: usize, limit: usize) {
    println!("{what:48} {bytes:7} of {limit} bytes");
    assert!(bytes <= limit, "{what}: {bytes} bytes, at most {limit}");
}

#[test]
fn a_bank_fits() {
    check("bank, N = 8, W = 16", size_of::<Config<64, PIXELS, 0>>(), BANK);
    check("bank, N = 16, W = 8", size_of::<Config<256, PIXELS, 0>>(), BANK);
    check("bank, N = 8, W = 16, brightest-n", size_of::<Config<64, PIXELS, BUFFER_8>>(), BANK);
    check("bank, N = 16, W = 8, brightest-n", size_of::<Config<256, PIXELS, BUFFER_16>>(), BANK);
}

/// What decides, beside the frame path: two rings of 16 records, and 12 bytes a segment of where patterns
/// want it.
#[test]
fn what_decides_is_small() {
    let beside = |cells: usize, controller: usize, pipeline: usize| {
        let what = format!("controller beside the pipeline, {cells} cells");
        check(&what, controller - pipeline, 12 * cells + 2 * KIB);
    };
    beside(64, size_of::<Controller<64, 0>>(), size_of::<Pipeline<64, 0>>());
    beside(256, size_of::<Controller<256, 0>>(), size_of::<Pipeline<256, 0>>());
}

/// What a Linux thread costs before `body` runs on it: guard, thread-local data, the runtime's own
/// frames.
const THREAD: usize = 16 * KIB;

/// Runs frames on a thread with `STACK` bytes for them; an overflow ends the process.
fn frames_on_a_small_stack<const M: usize, const B: usize>(across: usize, window: u8) {
    for estimator in [
        Estimator::CentreOfGravity,
        Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.1 },
        Estimator::WeightedCentreOfGravity { peak_fraction: 0.1, fwhm_px: 4.0, gain: 1.5 },
        Estimator::Brightest { count: 16 },
    ] {
        let mut instrument = Instrument::circle(across, window);
        instrument.estimator = estimator;
        let (config, mut pipeline) = with_big_stack(|| {
            let config = instrument.config::<M, PIXELS, B>();
            (config, Box::new(Pipeline::<M, B>::new()))
        });
        let mut rng = Rng::new(1);
        let spots = scattered(&instrument, (2000, 400, 256), &mut rng);
        let pixels = frame(&instrument, &spots, &Background::DEFAULT, &mut rng);
        std::thread::scope(|scope| {
            let small = std::thread::Builder::new().stack_size(STACK + THREAD);
            let thread = small.spawn_scoped(scope, || {
                for number in 0..3 {
                    let report = run_frame(&mut pipeline, &config, number, &pixels);
                    assert_eq!(report.outcome, Outcome::Updated);
                }
            });
            thread.expect("a thread").join().expect("the frame path");
        });
    }
}

#[test]
fn the_frame_path_runs_on_a_small_stack() {
    frames_on_a_small_stack::<64, BUFFER_8>(8, 16);
    frames_on_a_small_stack::<256, BUFFER_16>(16, 8);
}
