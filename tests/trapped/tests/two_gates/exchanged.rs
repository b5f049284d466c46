//! From one gate to two and back, and to windows of another size, under the controller: frames leave thresholds
//! and centres window by window, and none of them goes over.

use super::{circle, coupling};
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::controller::{Controller, Start};
use splash_firmware::interlock::Times;
use splash_firmware::mirror::Serials;
use splash_firmware::pipeline::Pipeline;
use splash_firmware::spec::Estimator;
use splash_tests::frames::{self, Background, Rng, Spot};
use splash_tests::instrument::{Instrument, run_frame};
use splash_tests::twin::modal::polynomials;

/// Windows of up to 8 x 8 pixels.
type Wide = Config<128, { 128 * 64 }, 0, 12>;

/// Thresholds follow the peak of the frame before.
fn one_gate(window: u8) -> Instrument {
    let mut instrument = Instrument::circle(8, window);
    instrument.estimator = Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.5 };
    instrument
}

fn two_gates(window: u8) -> Instrument {
    let coupling = coupling(12, 0.5, &mut Rng::new(140));
    one_gate(window).with_second_gate(polynomials(&circle(8), 12), coupling)
}

/// Spots of such a peak in all windows.
fn spots(instrument: &Instrument, peak_adu: u32, rng: &mut Rng) -> Vec<u16> {
    let mut all = instrument.clone();
    all.origins.extend(instrument.second.iter().flat_map(|second| &second.origins));
    let mut spot = |_| Spot {
        centre_q8: [0; 2].map(|_: i32| rng.between(-128, 128)),
        peak_adu,
        width_q8: 384,
    };
    let spots: Vec<_> = (0..all.origins.len()).map(&mut spot).collect();
    frames::frame(&all, &spots, &Background::DEFAULT, rng)
}

fn measured(path: &Pipeline<128, 0, 12>) -> [Vec<Measurement>; 2] {
    [path.measurements().to_vec(), path.second_measurements().to_vec()]
}

#[test]
fn what_frames_leave_of_a_window_goes_with_it() {
    for (before, after) in [
        (one_gate(8), two_gates(8)),
        (two_gates(8), one_gate(8)),
        (one_gate(8), one_gate(6)),
        (two_gates(6), two_gates(8)),
    ] {
        let mut rng = Rng::new(141);
        let times = Times { settle_ticks: 0, fall_ticks: 0 };
        let mut controller: Box<Controller<128, 0, 12>> =
            Box::new(Controller::new(Serials::default(), times, 240_000_000));
        let [first, next]: [Box<Wide>; 2] = [before.bank(), after.bank()];
        controller.exchange(&Box::default(), &first, true).expect("the first configuration");
        let frame =
            |controller: &mut Controller<128, 0, 12>, config: &Wide, number, pixels: &[u16]| {
                controller.begin(config, Start { number, pulses: 10, ticks: u64::from(number) });
                controller.push_rows(config, pixels, config.height()).expect("all rows");
                controller.finish(config, &mut ());
                measured(controller.pipeline())
            };
        frame(&mut controller, &first, 0, &spots(&before, 3000, &mut rng));
        let codes = controller.codes().to_vec();

        controller.exchange(&first, &next, true).expect("the same mask");
        let path = controller.pipeline();
        assert!(path.second_slopes().is_empty() && path.second_measurements().is_empty());
        assert_eq!(controller.codes(), codes, "the mirror stays");
        let faint = spots(&after, 400, &mut rng);
        let mut fresh = Box::new(Pipeline::<128, 0, 12>::new());
        run_frame(&mut fresh, &next, 0, &faint);
        let found = frame(&mut controller, &next, 1, &faint);
        assert!(found == measured(&fresh), "a threshold of another window");
        assert!(found.iter().flatten().all(|window| window.flux > 0), "a frame with light");
    }
}

/// A reset leaves nothing of a second gate.
#[test]
fn a_reset_forgets_the_second_gate() {
    let [one, two]: [Box<Wide>; 2] = [one_gate(8).bank(), two_gates(8).bank()];
    for next in [&one, &two] {
        let mut path = Box::new(Pipeline::<128, 0, 12>::new());
        run_frame(&mut path, &two, 0, &spots(&two_gates(8), 400, &mut Rng::new(142)));
        assert_eq!((path.second_slopes().len(), path.second_measurements().len()), (52, 52));
        path.reset(next);
        assert!(path.second_slopes().is_empty() && path.second_measurements().is_empty());
    }
}
