//! Extreme inputs under the largest allowed gains, for every pupil from 4 to 40 subapertures
//! across. Nothing may overflow, panic or leave its limits; `cargo test --profile overflow
//! -p splash-trapped` runs this optimised and with every overflow trapped.

use splash_firmware::actuators::Law;
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::fixed::{PISTON_LIMIT, TILT_LIMIT};
use splash_firmware::geometry::Mask;
use splash_firmware::pipeline::{GlobalTilt, Hold, Outcome, Pipeline, Report};
use splash_firmware::pixels::Convention;
use splash_firmware::slopes::MeanSlope;
use splash_firmware::spec::{Estimator, SorSpec};
use splash_tests::frames::Rng;
use splash_tests::instrument::{Instrument, Values, run_frame};
use splash_tests::twin::mirror::exact_codes;
use splash_tests::twin::pixels::watched;
use splash_tests::with_big_stack;

/// Cells of 40 x 40 subapertures.
const CELLS: usize = 40 * 40;
/// Every detector here has at most 256 x 256 pixels.
const SIDE: usize = 256;
const PIXELS: usize = SIDE * SIDE;
/// Windows of up to 32 pixels, side by side.
const BUFFERED: usize = SIDE * 32;

type LargeConfig = Config<CELLS, PIXELS, BUFFERED>;
type LargePipeline = Pipeline<CELLS, BUFFERED>;

const WHITE: u16 = u16::MAX;

/// The largest window that fits N of them side by side, and the smallest.
fn windows(across: usize) -> [u8; 2] {
    [(SIDE / across).min(32) as u8, 4]
}

/// What is lit, as a rule on the subaperture (column, row) and the pixel in its window.
type Pattern = fn(subaperture: [usize; 2], pixel: [usize; 2], last: usize) -> u16;

const PATTERNS: [Pattern; 13] = [
    |_, _, _| WHITE,
    |_, _, _| 0,
    |_, [x, y], _| if (x + y) % 2 == 0 { WHITE } else { 0 },
    |[i, j], _, _| if (i + j) % 2 == 0 { WHITE } else { 0 },
    // The largest tilt of one sign everywhere: each corner.
    |_, [x, y], _| if (x, y) == (0, 0) { WHITE } else { 0 },
    |_, [x, y], last| if (x, y) == (last, last) { WHITE } else { 0 },
    |_, [x, y], last| if (x, y) == (last, 0) { WHITE } else { 0 },
    |_, [x, y], last| if (x, y) == (0, last) { WHITE } else { 0 },
    // Alternating from one subaperture to the next: along both axes, and along one.
    |[i, j], [x, y], last| {
        let corner = if (i + j) % 2 == 0 { 0 } else { last };
        if (x, y) == (corner, corner) { WHITE } else { 0 }
    },
    |[i, _], [x, y], last| {
        let corner = if i % 2 == 0 { 0 } else { last };
        if (x, y) == (corner, corner) { WHITE } else { 0 }
    },
    // Columns of light that point away from the middle: the steepest focus.
    |[i, j], [x, y], last| {
        let side = |k: usize| if k < 4 { 0 } else { last };
        if (x, y) == (side(i), side(j)) { WHITE } else { 0 }
    },
    // One bright pixel on the detector; one unit of signal in each window.
    |ij, xy, _| if (ij, xy) == ([1, 1], [2, 3]) { WHITE } else { 0 },
    |_, [x, y], last| if (x, y) == (last, 0) { 1 } else { 0 },
];

fn frame(instrument: &Instrument, pattern: Pattern) -> Vec<u16> {
    let window = usize::from(instrument.window);
    let side = usize::from(instrument.detector.width);
    (0..side * side)
        .map(|i| (i % side, i / side))
        .map(|(x, y)| pattern([x / window, y / window], [x % window, y % window], window - 1))
        .collect()
}

/// The largest slope gain: 32767 2^15 ulp a pixel, in every entry.
fn largest_gain(instrument: &Instrument) -> f64 {
    32767.0 * 32768.0 * instrument.ulp_m()
}

/// Everything at the end of its range. `variant` goes through the choices that have no end.
fn extreme(mask: Mask, window: u8, variant: usize) -> Instrument {
    let mut instrument = Instrument::ideal(mask, window);
    let pick = |choices: usize, stride: usize| variant / stride % choices;
    let estimators = [
        Estimator::CentreOfGravity,
        Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.9 },
        Estimator::WeightedCentreOfGravity { peak_fraction: 0.0, fwhm_px: 0.5, gain: 7.0 },
        Estimator::WeightedCentreOfGravity { peak_fraction: 0.9, fwhm_px: 64.0, gain: 7.0 },
        Estimator::Brightest { count: u16::from(window) * u16::from(window) - 1 },
        Estimator::Brightest { count: 1 },
    ];
    instrument.estimator = estimators[pick(6, 1)];
    instrument.convention = [Convention::Subtract, Convention::ZeroBelow][pick(2, 1)];
    instrument.flux_min_adu = Values::Uniform(0.0);
    instrument.flux_max_adu = Values::Uniform(f64::from(u32::MAX));
    instrument.mean = [MeanSlope::Keep, MeanSlope::Remove][pick(2, 2)];
    let sign = [1.0, -1.0][pick(2, 3)];
    instrument.reference_px = Values::Uniform([32.0 * sign, -32.0]);
    let g = largest_gain(&instrument);
    instrument.slope_gain_m_per_px = Values::Uniform([[g, g], [-g, g]]);
    instrument.control_gain = Values::Uniform(1.99);
    instrument.lever_arm = 1.9;
    instrument.delay_frames = pick(4, 1) as u8;
    instrument.global_tilt_max_age = 1;
    instrument.sor = SorSpec { omega: Some(1.99), ..SorSpec::default() };
    let (piston, tilt) = [(1.0, 1.0), (0.25, 3.999), (3.999, 3.999), (3.999, 0.5)][pick(4, 3)];
    let segment = [[piston, 0.0, tilt], [piston, -tilt, -tilt], [piston, tilt, -tilt]];
    instrument.matrix = Values::Uniform(segment);
    let stroke_m = instrument.stroke_m;
    let lsb_m = stroke_m / 65536.0;
    let (flat, low, high) = [
        (0.5 * stroke_m, 0.0, stroke_m),
        (0.0, 0.0, stroke_m),
        (stroke_m - lsb_m, 0.0, stroke_m),
        (0.5 * stroke_m, 0.5 * stroke_m - lsb_m, 0.5 * stroke_m + lsb_m),
    ][pick(4, 2)];
    instrument.flat_m = Values::Uniform([flat; 3]);
    instrument.limits_m = Values::Uniform([[low, high]; 3]);
    instrument.slew_m_per_frame = [None, Some(lsb_m), Some(0.3 * stroke_m)][pick(3, 2)];
    instrument.law = [Law::Linear, Law::Quadratic][pick(2, 3)];
    instrument.dac_bits = [16, 8][pick(2, 6)];
    let response = if pick(2, 4) == 0 { [0.0, stroke_m] } else { [stroke_m, 0.0] };
    instrument.response_m = Values::Uniform([response; 3]);
    instrument
}

/// Heights in units of the stroke that a DAC code may stand for, given what codes are rounded by.
fn height_range(instrument: &Instrument, code: u16) -> [f64; 2] {
    let top = f64::from((1u32 << instrument.dac_bits) - 1);
    let [[zero, full], _, _] = instrument.response_m.at(0);
    let height = |code: f64| {
        let v = match instrument.law {
            Law::Linear => code / top,
            Law::Quadratic => (code / top).powi(2),
        };
        (zero + (full - zero) * v) / instrument.stroke_m
    };
    let exact = exact_codes(instrument.law, instrument.dac_bits, code);
    let ends = exact.map(|code| height(code.max(0.0)));
    [ends[0].min(ends[1]), ends[0].max(ends[1])]
}

/// Codes within the height limits, positions within the scale, commands within theirs.
fn assert_within(instrument: &Instrument, pipeline: &LargePipeline, context: &str) {
    // The line of a response is exact to 2^-29 of the stroke.
    const ROUNDING: f64 = 4e-9;
    let [low, high] = instrument.limits_m.at(0)[0].map(|limit| limit / instrument.stroke_m);
    for &code in pipeline.codes().as_flattened() {
        assert!(u32::from(code) < 1 << instrument.dac_bits, "{context}: code {code}");
        let [least, most] = height_range(instrument, code);
        assert!(least <= high + ROUNDING && most >= low - ROUNDING, "{context}: code {code}");
    }
    for position in pipeline.positions() {
        let tilts = position.tilt_ulp.map(i32::unsigned_abs);
        assert!(tilts.iter().all(|&tilt| tilt <= TILT_LIMIT as u32), "{context}: {position:?}");
        // Heights of 2^25 ulp over a piston influence of 1/4, either way.
        assert!(position.piston_ulp.abs() <= 8 * PISTON_LIMIT, "{context}: {position:?}");
    }
    for command in pipeline.commands().as_flattened() {
        assert!(command.abs() <= TILT_LIMIT, "{context}: command {command}");
    }
}

/// A held frame holds for want of light and leaves the codes; all counts are within their number.
fn assert_sensible(
    instrument: &Instrument,
    report: &Report,
    [before, after]: [&[[u16; 3]]; 2],
    white: usize,
    context: &str,
) {
    let count = instrument.count();
    assert!(usize::from(report.valid) <= count, "{context}: {report:?}");
    assert_eq!(report.saturated_pixels, white as u32, "{context}");
    match report.outcome {
        Outcome::Updated => assert!(report.valid > 0, "{context}: {report:?}"),
        Outcome::Held(hold) => {
            assert_eq!((hold, report.valid), (Hold::NoLight, 0), "{context}");
            assert_eq!(before, after, "{context}: held");
        }
    }
    assert!(usize::from(report.saturated_actuators) <= 3 * count, "{context}: {report:?}");
    assert!(usize::from(report.slewed_actuators) <= 3 * count, "{context}: {report:?}");
}

/// The rows of window `i`.
fn rows<'a>(
    instrument: &Instrument,
    pixels: &'a [u16],
    i: usize,
) -> impl Iterator<Item = &'a [u16]> {
    let side = usize::from(instrument.detector.width);
    let window = usize::from(instrument.window);
    let [x0, y0] = instrument.origins[i].map(usize::from);
    (y0..y0 + window).map(move |y| &pixels[y * side + x0..y * side + x0 + window])
}

/// The number of windows with any light.
fn lit(instrument: &Instrument, pixels: &[u16]) -> usize {
    let any = |i: &usize| rows(instrument, pixels, *i).any(|row| row.iter().any(|&p| p > 0));
    (0..instrument.count()).filter(any).count()
}

/// The number of white pixels next to the last centroids.
fn white(instrument: &Instrument, pixels: &[u16], last_px: &[[f64; 2]]) -> usize {
    let white = |(i, &last): (usize, &[f64; 2])| {
        let [columns, watched] = watched(instrument.window.into(), last);
        let rows = rows(instrument, pixels, i).skip(watched.start).take(watched.len());
        rows.flat_map(|row| &row[columns.clone()]).filter(|&&p| p == WHITE).count()
    };
    last_px.iter().enumerate().map(white).sum()
}

const GLOBAL: [[i32; 2]; 5] =
    [[i32::MIN; 2], [i32::MAX; 2], [i32::MIN, i32::MAX], [0; 2], [TILT_LIMIT, -TILT_LIMIT]];

/// Every pattern, then twenty frames from one extreme to another.
fn storm(instrument: &Instrument, config: &LargeConfig, pipeline: &mut LargePipeline, name: &str) {
    let frames: Vec<_> = PATTERNS.iter().map(|&pattern| frame(instrument, pattern)).collect();
    let lit: Vec<_> = frames.iter().map(|pixels| lit(instrument, pixels)).collect();
    pipeline.reset(config);
    let mut rng = Rng::new(instrument.count() as u64);
    let mut last_px = vec![[0.0; 2]; instrument.count()];
    let pairs = (0..20).map(|k| if k % 2 == 0 { 4 } else { 5 + rng.below(8) as usize });
    let order: Vec<_> = (0..PATTERNS.len()).chain(pairs).collect();
    for (number, pattern) in order.into_iter().enumerate() {
        let context = format!("{name}, frame {number}, pattern {pattern}");
        if number % 3 == 0 {
            let tilt_ulp = GLOBAL[number / 3 % GLOBAL.len()];
            pipeline.set_global_tilt(GlobalTilt { tilt_ulp, frame: number as u32 });
        }
        let before = pipeline.codes().to_vec();
        let report = run_frame(pipeline, config, number as u32, &frames[pattern]);
        let windows = lit[pattern];
        let white = white(instrument, &frames[pattern], &last_px);
        for (last, measured) in last_px.iter_mut().zip(pipeline.measurements()) {
            let seen = f64::from(u8::from(measured.flux > 0));
            *last = measured.centroid_q16.map(|c| seen * f64::from(c) / 65536.0);
        }
        if instrument.estimator == Estimator::CentreOfGravity {
            assert_eq!(usize::from(report.valid), windows, "{context}");
        }
        assert!(usize::from(report.valid) <= windows, "{context}: light from nowhere");
        assert_sensible(instrument, &report, [&before, pipeline.codes()], white, &context);
        assert_within(instrument, pipeline, &context);
    }
}

fn masks(across: usize) -> [Mask; 4] {
    let square = Mask::square(across).expect("4 to 40");
    // As many components as there can be; and one subaperture.
    let board = square.without(|x, y| (x + y) % 2 == 1);
    let annulus = Mask::annulus(across, 0.3).expect("4 to 40").with_spider();
    let annulus = if annulus.count() > 0 { annulus } else { square };
    [square, annulus, board, square.without(|x, y| (x, y) != (1, 1))]
}

fn all_pupils(variants: fn(usize) -> Vec<(Mask, u8, usize)>) {
    with_big_stack(|| {
        let mut config = Box::new(LargeConfig::new());
        let mut pipeline = Box::new(LargePipeline::new());
        for across in 4..=40 {
            for (mask, window, variant) in variants(across) {
                let instrument = extreme(mask, window, variant);
                let name = format!("N = {across}, W = {window}, variant {variant}");
                config.build(&instrument.spec()).unwrap_or_else(|e| panic!("{name}: {e}"));
                storm(&instrument, &config, &mut pipeline, &name);
            }
        }
    });
}

/// Every combination of choices on the full square, in turn with N.
#[test]
fn extremes_on_every_square_pupil() {
    all_pupils(|across| {
        let square = Mask::square(across).expect("4 to 40");
        let windows = windows(across).into_iter();
        windows.flat_map(|w| (0..2).map(move |k| (square, w, 5 * across + k))).collect()
    });
}

/// The same on annuli with spiders, on isolated subapertures, and on one alone.
#[test]
fn extremes_on_every_broken_pupil() {
    all_pupils(|across| {
        let masks = masks(across).into_iter().skip(1).enumerate();
        masks.map(|(k, mask)| (mask, 4 + (across % 3) as u8, 3 * across + k)).collect()
    });
}

/// All 48 combinations on one pupil: estimators, conventions, means, limits, laws.
#[test]
fn every_choice_on_one_pupil() {
    all_pupils(|across| {
        let square = Mask::square(across).expect("4 to 40");
        if across == 8 { (0..48).map(|variant| (square, 8, variant)).collect() } else { vec![] }
    });
}

/// Calibrations at the ends of their ranges, under random extremes of light.
#[test]
fn extreme_calibrations() {
    with_big_stack(|| {
        let mut rng = Rng::new(3);
        for variant in 0..24 {
            let mask = Mask::square(6).expect("4 to 40");
            let mut instrument = extreme(mask, 8, variant);
            let pixels = usize::from(instrument.detector.width).pow(2);
            let mut choose = |values: &[f64]| -> Values<f64> {
                let mut one = || values[rng.below(values.len() as u32) as usize];
                Values::Each((0..pixels).map(|_| one()).collect())
            };
            instrument.dark_adu = choose(&[0.0, 65534.0, 1.0]);
            instrument.pixel_gain = choose(&[0.25, 4.0, 1.0]);
            instrument.noise_adu = choose(&[0.0, 65534.0, 1.0]);
            instrument.threshold_sigma = [0.0, 1.0, 100.0][variant % 3];
            instrument.bad = vec![[0, 0], [7, 0], [3, 5]];
            instrument.saturation_adu = Some(1);
            let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
            let mut pipeline = Box::new(LargePipeline::new());
            for number in 0..20 {
                let light = (0..pixels).map(|_| [0, 1, WHITE - 1, WHITE][rng.below(4) as usize]);
                let light: Vec<u16> = light.collect();
                run_frame(&mut pipeline, &config, number, &light);
                assert_within(&instrument, &pipeline, &format!("variant {variant}"));
            }
        }
    });
}

/// The largest gains that are allowed, and the smallest that are refused, lie next to each other:
/// tilts saturate with the sign that the gain gives them.
#[test]
fn the_largest_slope_gain_keeps_its_sign() {
    with_big_stack(|| {
        let mask = Mask::square(4).expect("4 to 40");
        for factor in [0.5, 0.999, 1.0, 1.000_01, 1.000_02, 1.000_03, 1.0001] {
            let mut instrument = Instrument::ideal(mask, 4);
            let g = factor * largest_gain(&instrument);
            instrument.slope_gain_m_per_px = Values::Uniform([[g, 0.0], [0.0, -g]]);
            let Ok(config) = instrument.try_config::<CELLS, PIXELS, BUFFERED>() else {
                // 2^30 ulp a pixel, a stroke of 65536 LSB over 2^-16 pixel, is too much.
                assert!(factor > 1.0, "refused at {factor}");
                continue;
            };
            let mut pipeline = Box::new(LargePipeline::new());
            run_frame(&mut pipeline, &config, 0, &frame(&instrument, PATTERNS[5]));
            for slope in pipeline.slopes() {
                assert_eq!(slope.tilt_ulp, [TILT_LIMIT, -TILT_LIMIT], "at {factor}");
            }
        }
    });
}

/// A pixel passes the zero-below convention only above its own threshold, however large that is.
#[test]
fn the_largest_thresholds_still_hold() {
    with_big_stack(|| {
        let mask = Mask::square(4).expect("4 to 40");
        for noise_adu in [100.0, 255.0, 256.0, 60_000.0, 65_279.0, 65_281.0, 65_534.0] {
            let mut instrument = Instrument::ideal(mask, 4);
            instrument.convention = Convention::ZeroBelow;
            instrument.noise_adu = Values::Uniform(noise_adu);
            instrument.threshold_sigma = 1.0;
            let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
            let mut pipeline = Box::new(LargePipeline::new());
            // Thresholds are stored in eight bits: known to 1 in 256 of the largest.
            for (part, passes) in [(0.5, false), (0.99, false), (1.01, true)] {
                let level = noise_adu * part;
                if level > 65_535.0 {
                    continue;
                }
                let pixels = vec![level as u16; usize::from(instrument.detector.width).pow(2)];
                let report = run_frame(&mut pipeline, &config, 0, &pixels);
                let valid = if passes { 16 } else { 0 };
                assert_eq!(report.valid, valid, "{level} ADU, threshold {noise_adu}");
            }
        }
    });
}

/// Measurements from elsewhere may be anything: the tilt saturates on the side they are on.
#[test]
fn extreme_measurements_from_elsewhere() {
    with_big_stack(|| {
        for across in [4, 17, 40] {
            for variant in 0..12 {
                let instrument = extreme(Mask::square(across).expect("4 to 40"), 4, variant);
                let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
                let mut pipeline = Box::new(LargePipeline::new());
                for number in 0..20 {
                    let mut rng = Rng::new(u64::from(number));
                    let mut any = || [i32::MIN, -1, 0, 1, i32::MAX][rng.below(5) as usize];
                    let measurements: Vec<_> = (0..instrument.count())
                        .map(|_| Measurement {
                            centroid_q16: [any(), any()],
                            flux: u32::MAX,
                            peak: u16::MAX,
                            saturated: u16::MAX,
                        })
                        .collect();
                    pipeline.begin(&config, number);
                    pipeline.push_measurements(&config, &measurements).expect("one each");
                    let report = pipeline.finish(&config);
                    assert_eq!(report.outcome, Outcome::Updated);
                    assert_within(&instrument, &pipeline, &format!("variant {variant}"));
                }
            }
        }
    });
}

#[test]
fn extreme_centroids_from_elsewhere_keep_their_sign() {
    with_big_stack(|| {
        let mut instrument = Instrument::ideal(Mask::square(4).expect("4 to 40"), 4);
        for reference in [-32.0, 0.0, 32.0] {
            instrument.reference_px = Values::Uniform([reference; 2]);
            let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
            let mut pipeline = Box::new(LargePipeline::new());
            let one = Measurement {
                centroid_q16: [i32::MAX, i32::MIN],
                flux: 1000,
                peak: 1000,
                saturated: 0,
            };
            pipeline.begin(&config, 0);
            pipeline.push_measurements(&config, &[one; 16]).expect("one each");
            pipeline.finish(&config);
            for slope in pipeline.slopes() {
                assert_eq!(slope.tilt_ulp, [TILT_LIMIT, -TILT_LIMIT], "reference {reference}");
            }
        }
    });
}

/// A response that spans little more than a quarter of the stroke, wherever it lies in it and in
/// either direction.
#[test]
fn the_shortest_response_reaches_every_height_it_spans() {
    with_big_stack(|| {
        let mask = Mask::square(4).expect("4 to 40");
        let drives =
            [Law::Linear, Law::Quadratic].map(|law| [8, 11, 12, 16].map(|bits| (law, bits)));
        for &(law, bits) in drives.as_flattened() {
            for (low, high) in [(0.0, 0.26), (0.37, 0.63), (0.74, 1.0)] {
                for downwards in [false, true] {
                    let mut instrument = Instrument::ideal(mask, 4);
                    let stroke_m = instrument.stroke_m;
                    let [low_m, high_m] = [low, high].map(|part: f64| part * stroke_m);
                    let ends = if downwards { [high_m, low_m] } else { [low_m, high_m] };
                    (instrument.law, instrument.dac_bits) = (law, bits);
                    instrument.response_m = Values::Uniform([ends; 3]);
                    instrument.limits_m = Values::Uniform([[low_m, high_m]; 3]);
                    for part in [0.01, 0.25, 0.5, 0.75, 0.99] {
                        let flat = low + part * (high - low);
                        instrument.flat_m = Values::Uniform([flat * stroke_m; 3]);
                        let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
                        let mut pipeline = Box::new(LargePipeline::new());
                        pipeline.reset(&config);
                        for &code in pipeline.codes().as_flattened() {
                            let [least, most] = height_range(&instrument, code);
                            // The flat height is a whole LSB.
                            let lsb = 0.5 / 65536.0 + 4e-9;
                            assert!(
                                least - lsb <= flat && flat <= most + lsb,
                                "{law:?} {bits} {ends:?}: flat at {flat}, code {code} is {least} to {most}"
                            );
                        }
                    }
                }
            }
        }
    });
}
