//! Time of the firmware on one core of a PC: pixels by estimator, relaxation by sweep, frames.
//!
//! `cargo bench -p splash-tests --bench firmware`; a throughput of 2 Gelem/s is 0.5 ns a pixel.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use splash_firmware::config::Config;
use splash_firmware::geometry::{Grid, Mask};
use splash_firmware::pipeline::Pipeline;
use splash_firmware::pixels::Convention;
use splash_firmware::redblack::{Place, RedBlack};
use splash_firmware::sor::Sor;
use splash_firmware::spec::Estimator;
use splash_tests::frames::{Background, Rng, frame, scattered};
use splash_tests::instrument::{Instrument, Values, run_frame};

/// The estimators, plain centre of gravity first: the others are measured against it.
const ESTIMATORS: [(&str, Estimator); 4] = [
    ("centre of gravity", Estimator::CentreOfGravity),
    ("thresholded", Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.1 }),
    (
        "weighted",
        Estimator::WeightedCentreOfGravity { peak_fraction: 0.1, fwhm_px: 4.0, gain: 1.5 },
    ),
    ("brightest-16", Estimator::Brightest { count: 16 }),
];

/// A pupil and a window.
#[derive(Clone, Copy)]
struct Size {
    across: usize,
    window: u8,
}

/// A full square, so that every pixel is in a window, with a dark level and a gain of its own.
fn instrument(size: Size, estimator: Estimator, convention: Convention) -> Instrument {
    let mask = Mask::square(size.across).expect("4 to 40 across");
    let mut instrument = Instrument::new(mask, size.window);
    let pixels = usize::from(instrument.detector.width).pow(2);
    let mut rng = Rng::new(1);
    instrument.dark_adu =
        Values::Each((0..pixels).map(|_| rng.uniform(90.0, 110.0).round()).collect());
    instrument.pixel_gain = Values::Each((0..pixels).map(|_| rng.uniform(0.9, 1.1)).collect());
    instrument.estimator = estimator;
    instrument.convention = convention;
    instrument
}

fn light(instrument: &Instrument) -> Vec<u16> {
    let mut rng = Rng::new(2);
    let spots = scattered(instrument, (2000, 400, 256), &mut rng);
    frame(instrument, &spots, &Background::DEFAULT, &mut rng)
}

/// Calibrated, thresholded pixels to centroids: all rows of a frame, without what follows.
fn pixels(criterion: &mut Criterion) {
    fn rows<const M: usize, const P: usize, const B: usize>(criterion: &mut Criterion, size: Size) {
        let Size { across, window } = size;
        let group = format!("pixels, {across} x {across} windows of {window} x {window}");
        let mut group = criterion.benchmark_group(group);
        for (rule, convention) in
            [("", Convention::Subtract), (", zero below", Convention::ZeroBelow)]
        {
            for (name, estimator) in ESTIMATORS {
                let instrument = instrument(size, estimator, convention);
                let config = instrument.config::<M, P, B>();
                let light = light(&instrument);
                let mut pipeline = Box::new(Pipeline::<M, B>::new());
                run_frame(&mut pipeline, &config, 0, &light);
                group.throughput(Throughput::Elements(light.len() as u64));
                group.bench_function(format!("{name}{rule}"), |bencher| {
                    bencher.iter(|| {
                        pipeline.begin(&config, 1);
                        for row in light.chunks_exact(usize::from(config.width())) {
                            let _ = black_box(pipeline.push_row(&config, black_box(row)));
                        }
                    });
                });
            }
        }
        group.finish();
    }
    rows::<256, 16384, 1024>(criterion, Size { across: 16, window: 8 });
    rows::<64, 16384, 2048>(criterion, Size { across: 8, window: 16 });
}

/// One sweep of the relaxation over a circular pupil.
fn sweeps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sor, one sweep");
    for across in [8, 10, 12, 16, 20, 32, 40] {
        let instrument = Instrument::circle(across, 4);
        let config = instrument.config::<1600, 25600, 0>();
        let grid = Grid::new(across);
        let mut rng = Rng::new(3);
        let mut tilts = RedBlack::<[i32; 2], 1600>::new([0; 2]);
        for (x, y) in instrument.mask.cells() {
            let place = Place::new::<1600>(grid.node(x, y));
            let tilt = tilts.get_mut(place).expect("on the grid");
            *tilt = [0; 2].map(|_: i32| rng.between(-1_000_000, 1_000_000));
        }
        let mut sor = Box::new(Sor::new());
        sor.load(config.solver(), &tilts);
        group.throughput(Throughput::Elements(instrument.count() as u64));
        group.bench_function(BenchmarkId::from_parameter(across), |bencher| {
            bencher.iter(|| black_box(&mut sor).relax(config.solver(), black_box(1)));
        });
    }
    group.finish();
}

/// A whole frame, and what is left of it after the last row.
fn frames(criterion: &mut Criterion) {
    fn one<const M: usize, const P: usize>(criterion: &mut Criterion, size: Size) {
        let Size { across, window } = size;
        let group = format!("frame, {across} x {across} windows of {window} x {window}");
        let mut group = criterion.benchmark_group(group);
        let (_, estimator) = ESTIMATORS[1];
        let instrument = instrument(size, estimator, Convention::Subtract);
        let config: Box<Config<M, P, 0>> = instrument.config();
        let light = light(&instrument);
        let mut pipeline = Box::new(Pipeline::<M, 0>::new());
        group.bench_function("all", |bencher| {
            bencher.iter(|| run_frame(&mut pipeline, &config, 0, black_box(&light)));
        });
        let measurements = pipeline.measurements().to_vec();
        group.bench_function("after the last row", |bencher| {
            bencher.iter(|| {
                pipeline.begin(&config, 0);
                let _ = pipeline.push_measurements(&config, black_box(&measurements));
                pipeline.finish(&config)
            });
        });
        group.finish();
    }
    one::<64, 16384>(criterion, Size { across: 8, window: 16 });
    one::<256, 16384>(criterion, Size { across: 16, window: 8 });
    one::<1024, 65536>(criterion, Size { across: 32, window: 8 });
}

criterion_group!(benches, pixels, sweeps, frames);
criterion_main!(benches);
