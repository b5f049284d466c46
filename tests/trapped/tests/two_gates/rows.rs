//! Rows of both gates on one detector: what their windows leave is what their measurements leave.

use super::{Bank, Path, Seen, circle, coupling, instrument, tilts};
use splash_firmware::pipeline::Outcome;
use splash_firmware::spec::Estimator;
use splash_tests::frames::{self, Rng};
use splash_tests::instrument::{Instrument, run_frame};
use splash_tests::twin::modal::polynomials;

/// Steered light in the windows of both gates, for slopes in ulp.
fn frame(instrument: &Instrument, seen: &Seen) -> Vec<u16> {
    let ulp_per_px = instrument.slope_gain_m_per_px.at(0)[0][0] / instrument.ulp_m();
    let centroid = |s: f64| (s / ulp_per_px * 65536.0).round() as i32;
    let mut all = instrument.clone();
    all.origins.extend(&instrument.second.as_ref().expect("two gates").origins);
    let centroids = seen.iter().flatten().map(|s| s.map(|s| s.map(centroid)));
    frames::steered(&all, centroids, 60_000)
}

/// The second gate's windows to the right of the first's.
fn beside(mut instrument: Instrument) -> Instrument {
    let height = instrument.detector.height / 2;
    let second = instrument.second.as_mut().expect("two gates");
    second.origins = instrument.origins.iter().map(|&[x, y]| [x + height, y]).collect();
    (instrument.detector.width, instrument.detector.height) = (2 * height, height);
    instrument
}

/// Whatever the estimator, the place of the windows and the rows that come at once.
#[test]
fn windows_stream_into_the_modes() {
    let mut rng = Rng::new(120);
    let estimators = [
        Estimator::CentreOfGravity,
        Estimator::WeightedCentreOfGravity { peak_fraction: 0.1, fwhm_px: 4.0, gain: 1.5 },
    ];
    for (estimator, to_the_right, block) in
        [(0, false, 1), (0, true, 8), (1, true, 1), (0, false, 5)]
    {
        let mut instrument = instrument(8, 12, coupling(12, 0.5, &mut rng));
        instrument.estimator = estimators[estimator];
        if to_the_right {
            instrument = beside(instrument);
        }
        let config: Box<Bank> = instrument.bank();
        let mut rows = Box::new(Path::new());
        let mut measured = Box::new(Path::new());
        for number in 0..6 {
            let mut seen = [(); 2].map(|()| {
                tilts(instrument.count(), 200_000.0, &mut rng)
                    .into_iter()
                    .map(Some)
                    .collect::<Vec<_>>()
            });
            seen.iter_mut().flatten().filter(|_| rng.below(6) == 0).for_each(|s| *s = None);
            let pixels = frame(&instrument, &seen);
            let width = usize::from(instrument.detector.width);
            rows.begin(&config, number);
            for block in pixels.chunks(block * width) {
                let count = (block.len() / width) as u16;
                rows.push_rows(&config, block, count).expect("rows of the detector");
            }
            assert_eq!(rows.finish(&config).outcome, Outcome::Updated);
            let all = [rows.measurements(), rows.second_measurements()].concat();
            assert_eq!(all.len(), 2 * instrument.count());
            let lit = all.iter().map(|m| m.flux > 0);
            assert!(lit.eq(seen.iter().flatten().map(Option::is_some)));
            measured.begin(&config, number);
            measured.push_measurements(&config, &all).expect("one a window");
            measured.finish(&config);
            assert_eq!(rows.slopes(), measured.slopes());
            assert_eq!(rows.second_slopes(), measured.second_slopes());
            assert_eq!(rows.commands(), measured.commands(), "{estimator} {to_the_right} {block}");
        }
    }
}

/// A coupling of zeros is one gate alone, bit for bit.
#[test]
fn modes_that_take_nothing_are_one_gate() {
    let mut rng = Rng::new(121);
    let mask = circle(8);
    let alone = Instrument::circle(8, 4);
    let both = alone.clone().with_second_gate(polynomials(&mask, 12), vec![0.0; 288]);
    let (one, two): (Box<Bank>, Box<Bank>) = (alone.bank(), both.bank());
    let mut paths = [Box::new(Path::new()), Box::new(Path::new())];
    for number in 0..5 {
        let spots = frames::scattered(&alone, (2000, 400, 64), &mut rng);
        let upper = frames::frame(&alone, &spots, &frames::Background::DEFAULT, &mut rng);
        let below = frames::frame(&alone, &spots, &frames::Background::DEFAULT, &mut rng);
        let [first, second] = &mut paths;
        let report = run_frame(first, &one, number, &upper);
        let other = run_frame(second, &two, number, &[upper, below].concat());
        assert_eq!(report, other);
        assert_eq!(first.codes(), second.codes());
        assert!(first.second_slopes().is_empty());
    }
}
