//! Properties of the frame path under random instruments and random row sequences.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use splash_firmware::actuators::Law;
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::error::Field;
use splash_firmware::geometry::Mask;
use splash_firmware::pipeline::{GlobalTilt, Outcome, Pipeline, Progress};
use splash_firmware::pixels::Convention;
use splash_firmware::slopes::MeanSlope;
use splash_firmware::spec::{Estimator, SorSpec};
use splash_tests::frames::Rng;
use splash_tests::instrument::{Instrument, Values, run_frame, step};
use splash_tests::twin::mirror::exact_codes;
use splash_tests::twin::pixels::watched;

const CELLS: usize = 10 * 10;
/// Windows of at most 9 x 9 pixels.
const PIXELS: usize = CELLS * 9 * 9;

type AnyConfig = Config<CELLS, PIXELS, PIXELS>;
type AnyPipeline = Pipeline<CELLS, PIXELS>;

/// One entry each, uniform between two values.
fn each(rng: &mut Rng, count: usize, low: f64, high: f64) -> Values<f64> {
    Values::Each((0..count).map(|_| rng.uniform(low, high)).collect())
}

/// An instrument that is valid whatever the seed: random mask, placement and calibration.
fn instrument(seed: u64) -> Instrument {
    let rng = &mut Rng::new(seed);
    let across = 4 + rng.below(7) as usize;
    let density = 1 + rng.below(8);
    // One subaperture at least.
    let corner = (rng.below(across as u32) as usize, rng.below(across as u32) as usize);
    let mask = Mask::from_fn(across, |x, y| (x, y) == corner || rng.below(8) < density);
    let window = 4 + rng.below(6) as u8;
    let mut any = Instrument::new(mask.expect("4 to 10 across"), window);
    let count = any.count();

    // Each window somewhere in a cell of its own, in any order of cells.
    let room = 1 + rng.below(4);
    let pitch = u32::from(window) + room - 1;
    let mut cells: Vec<u32> = (0..(across * across) as u32).collect();
    for i in (1..cells.len()).rev() {
        cells.swap(i, rng.below(i as u32 + 1) as usize);
    }
    let side = across as u32;
    let mut place =
        |cell: u32| [cell % side, cell / side].map(|i| (i * pitch + rng.below(room)) as u16);
    any.origins = cells[..count].iter().map(|&cell| place(cell)).collect();
    any.detector.width = (side * pitch) as u16;
    any.detector.height = (side * pitch + rng.below(3)) as u16;
    any.detector.bits = 8 + rng.below(9) as u8;

    let pixels = usize::from(any.detector.width) * usize::from(any.detector.height);
    let top = f64::from((1u32 << any.detector.bits) - 1);
    let dark = rng.uniform(0.0, 0.5 * top);
    any.dark_adu = each(rng, pixels, 0.0, dark);
    any.pixel_gain = each(rng, pixels, 0.25, 4.0);
    any.noise_adu = each(rng, pixels, 0.0, 3.0);
    any.threshold_sigma = rng.uniform(0.0, 5.0);
    any.convention = [Convention::Subtract, Convention::ZeroBelow][rng.below(2) as usize];
    let bad = (0..any.detector.height).flat_map(|y| (0..any.detector.width).map(move |x| [x, y]));
    any.bad = bad.filter(|_| rng.below(40) == 0).collect();
    let peak_fraction = rng.uniform(0.0, 0.9);
    any.estimator = match rng.below(4) {
        0 => Estimator::CentreOfGravity,
        1 => Estimator::ThresholdedCentreOfGravity { peak_fraction },
        2 => Estimator::WeightedCentreOfGravity {
            peak_fraction,
            fwhm_px: rng.uniform(0.5, 20.0),
            gain: rng.uniform(0.1, 7.0),
        },
        _ => Estimator::Brightest { count: 1 + rng.below(u32::from(window).pow(2) - 1) as u16 },
    };
    let gain_m = any.stroke_m * rng.uniform(0.001, 10.0);
    let one = |rng: &mut Rng| {
        let turn = rng.uniform(0.0, std::f64::consts::TAU);
        [[turn.cos(), -turn.sin()], [turn.sin(), turn.cos()]].map(|row| row.map(|g| g * gain_m))
    };
    any.slope_gain_m_per_px = Values::Each((0..count).map(|_| one(rng)).collect());
    let reference = |rng: &mut Rng| [rng.uniform(-3.0, 3.0), rng.uniform(-3.0, 3.0)];
    any.reference_px = Values::Each((0..count).map(|_| reference(rng)).collect());
    any.flux_min_adu = each(rng, count, 0.0, top);
    any.flux_max_adu = each(rng, count, 20.0 * top, 1e4 * top);
    any.mean = [MeanSlope::Remove, MeanSlope::Keep][rng.below(2) as usize];
    any.control_gain = each(rng, count, 0.01, 1.99);
    any.lever_arm = rng.uniform(0.5, 1.9);
    any.delay_frames = rng.below(4) as u8;
    any.global_tilt_max_age = rng.below(4);
    any.sor = SorSpec {
        omega: (rng.below(2) == 0).then(|| rng.uniform(1.0, 1.99)),
        sweeps: (rng.below(2) == 0).then(|| 1 + rng.below(20) as u16),
        cold_sweeps: None,
    };

    any.law = [Law::Linear, Law::Quadratic][rng.below(2) as usize];
    any.dac_bits = 8 + rng.below(9) as u8;
    let piston = rng.uniform(0.25, 3.99);
    let lever = rng.uniform(0.1, 3.99);
    let segment =
        [[piston, 0.0, lever], [piston, -lever, -lever / 2.0], [piston, lever, -lever / 2.0]];
    any.matrix = Values::Uniform(segment);
    let stroke_m = any.stroke_m;
    let limits = |rng: &mut Rng| {
        [(); 3].map(|()| [rng.uniform(0.0, 0.49) * stroke_m, rng.uniform(0.51, 1.0) * stroke_m])
    };
    any.limits_m = Values::Each((0..count).map(|_| limits(rng)).collect());
    any.slew_m_per_frame = (rng.below(2) == 0).then(|| rng.uniform(0.001, 1.0) * stroke_m);
    let response = [[0.0, stroke_m], [stroke_m, 0.0], [-0.1 * stroke_m, 1.2 * stroke_m]];
    any.response_m = Values::Uniform([response[rng.below(3) as usize]; 3]);
    any
}

/// Random light in a random range, with some pixels white.
fn light(rng: &mut Rng, count: usize, bits: u8) -> Vec<u16> {
    let top = (1u32 << bits) - 1;
    let range = 1 + rng.below(top);
    let white = rng.below(20);
    (0..count).map(|_| if rng.below(100) < white { top } else { rng.below(range) } as u16).collect()
}

/// Where a code lies in the limits of its actuator, as heights of the stroke with what codes are rounded by and
/// 2^-28 of rounding.
fn assert_codes_within(instrument: &Instrument, codes: &[[u16; 3]]) -> Result<(), TestCaseError> {
    let top = f64::from((1u32 << instrument.dac_bits) - 1);
    for (i, codes) in codes.iter().enumerate() {
        let ends = instrument.response_m.at(i).into_iter().zip(instrument.limits_m.at(i));
        for (&code, ([zero, full], [low, high])) in codes.iter().zip(ends) {
            prop_assert!(f64::from(code) <= top, "code {code} of {} bits", instrument.dac_bits);
            let height = |code: f64| {
                let part = code.max(0.0) / top;
                let v = if instrument.law == Law::Linear { part } else { part * part };
                zero + (full - zero) * v
            };
            let [a, b] = exact_codes(instrument.law, instrument.dac_bits, code).map(height);
            let rounding = 4e-9 * instrument.stroke_m;
            let (least, most) = (a.min(b) - rounding, a.max(b) + rounding);
            prop_assert!(
                least <= high && most >= low,
                "code {code}: {least} to {most} m, limits {low} to {high}"
            );
        }
    }
    Ok(())
}

/// What may be done to a pipeline, in any order.
#[derive(Clone, Debug)]
enum Action {
    Begin,
    /// This many rows of the detector's width.
    Rows(u16),
    /// One row of this length.
    Row(u16),
    /// All rows that are missing.
    Rest,
    Finish,
    Tilt([i32; 2], u32),
    Measurements(bool),
    OtherBank,
    Reset,
}

fn action() -> impl Strategy<Value = Action> {
    prop_oneof![
        6 => Just(Action::Begin),
        4 => (0u16..200).prop_map(Action::Rows),
        1 => (0u16..200).prop_map(Action::Row),
        6 => Just(Action::Rest),
        6 => Just(Action::Finish),
        1 => (any::<[i32; 2]>(), any::<u32>()).prop_map(|(tilt, frame)| Action::Tilt(tilt, frame)),
        1 => any::<bool>().prop_map(Action::Measurements),
        1 => Just(Action::OtherBank),
        1 => Just(Action::Reset),
    ]
}

/// i128 sums of one window: I, Mx, My in half pixels.
fn moments(signal: impl Iterator<Item = (usize, usize, u16)>, window: usize) -> [i128; 3] {
    let half = |i: usize| 2 * i as i128 - (window as i128 - 1);
    signal.fold([0; 3], |[sum, mx, my], (x, y, s)| {
        let s = i128::from(s);
        [sum + s, mx + s * half(x), my + s * half(y)]
    })
}

/// The raw pixels of a window, with column and row.
fn window<'a>(
    instrument: &'a Instrument,
    pixels: &'a [u16],
    subaperture: usize,
) -> impl Iterator<Item = (usize, usize, u16)> + 'a {
    let size = usize::from(instrument.window);
    let [x0, y0] = instrument.origins[subaperture].map(usize::from);
    let width = usize::from(instrument.detector.width);
    (0..size * size)
        .map(move |i| (i % size, i / size))
        .map(move |(x, y)| (x, y, pixels[(y0 + y) * width + x0 + x]))
}

/// Sum and centroid are those of the moments: the sum exactly, the centroid rounded down, within 2^-20
/// of itself, which is at most an ulp.
fn assert_measured(found: &Measurement, [sum, mx, my]: [i128; 3]) -> Result<(), TestCaseError> {
    prop_assert_eq!(i128::from(found.flux), sum);
    if sum > 0 {
        for (&c, m) in found.centroid_q16.iter().zip([mx, my]) {
            // -1 - e < c - M 2^15 / I <= e, e = |M| 2^-5 / I, without dividing.
            let (error, off) = (i128::from(c) * sum - (m << 15), m.abs() >> 5);
            prop_assert!((-sum - off - 1..=off + 1).contains(&error), "{c} for {m} 2^15 / {sum}");
        }
    } else {
        prop_assert_eq!(found.centroid_q16, [0; 2]);
    }
    Ok(())
}

/// An instrument whose signal is raw less dark level and threshold, in whole ADU.
fn without_maps(seed: u64, dark: u16, threshold: u16, convention: Convention) -> Instrument {
    let mut plain = instrument(seed);
    plain.detector.bits = 16;
    plain.dark_adu = Values::Uniform(f64::from(dark));
    plain.noise_adu = Values::Uniform(f64::from(threshold));
    plain.threshold_sigma = 1.0;
    plain.pixel_gain = Values::Uniform(1.0);
    plain.convention = convention;
    plain.flux_min_adu = Values::Uniform(0.0);
    plain.flux_max_adu = Values::Uniform(f64::from(u32::MAX));
    plain
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 1000,
        // The same cases on every machine and in every run.
        rng_seed: RngSeed::Fixed(2006),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// Rows that come in blocks leave what they leave one by one, also where a block goes beyond the
    /// detector's last row.
    #[test]
    fn blocks_of_rows_are_rows(
        seed in any::<u64>(),
        blocks in prop::collection::vec(1u16..40, 1..60),
    ) {
        let instrument = instrument(seed);
        let config = instrument.config::<CELLS, PIXELS, PIXELS>();
        let (width, height) = (config.width(), config.height());
        let rng = &mut Rng::new(seed ^ 2);
        let [mut one_by_one, mut at_once] = [(); 2].map(|()| Box::new(AnyPipeline::new()));
        let mut blocks = blocks.into_iter().cycle();
        for number in 0..3 {
            one_by_one.begin(&config, number);
            at_once.begin(&config, number);
            let mut taken = 0;
            while taken < height {
                let rows = blocks.next().expect("a cycle");
                let pixels = light(rng, usize::from(width) * usize::from(rows), instrument.detector.bits);
                let pushed = at_once.push_rows(&config, &pixels, rows);
                let mut last = Ok(Progress::More);
                for row in pixels.chunks_exact(width.into()) {
                    last = one_by_one.push_row(&config, row);
                }
                prop_assert_eq!(pushed, last);
                taken += rows;
            }
            prop_assert_eq!(at_once.finish(&config), one_by_one.finish(&config));
            prop_assert_eq!(at_once.measurements(), one_by_one.measurements());
            prop_assert_eq!(at_once.codes(), one_by_one.codes());
            prop_assert_eq!(at_once.totals(), one_by_one.totals());
        }
    }

    /// Whatever comes: no panic, codes within their limits, held frames hold, counts add up.
    #[test]
    fn any_sequence_is_survived(
        seed in any::<u64>(),
        actions in prop::collection::vec(action(), 1..40),
    ) {
        let instrument = instrument(seed);
        let banks = [(); 2].map(|()| instrument.config::<CELLS, PIXELS, PIXELS>());
        let mut bank = 0;
        let mut pipeline = Box::new(AnyPipeline::new());
        let rng = &mut Rng::new(seed ^ 1);
        let width = usize::from(instrument.detector.width);
        let bits = instrument.detector.bits;
        let (mut begun, mut rows, mut finished, mut dropped, mut number) = (false, 0, 0, 0, 0);
        pipeline.reset(&banks[0]);
        for action in actions {
            let config: &AnyConfig = &banks[bank];
            match action {
                Action::Begin => {
                    number += 1;
                    pipeline.begin(config, number);
                    dropped += u32::from(begun);
                    (begun, rows) = (true, 0);
                }
                Action::Rows(_) | Action::Rest => {
                    let missing = instrument.detector.height - rows;
                    let count = if let Action::Rows(count) = action { count } else { missing };
                    for _ in 0..count {
                        let taken = pipeline.push_row(config, &light(rng, width, bits)).is_ok();
                        prop_assert_eq!(taken, begun && rows < instrument.detector.height);
                        rows += u16::from(taken);
                    }
                }
                Action::Row(length) => {
                    let taken = pipeline.push_row(config, &light(rng, length.into(), 16)).is_ok();
                    rows += u16::from(taken);
                    prop_assert!(!taken || usize::from(length) == width);
                }
                Action::Finish => {
                    let before = pipeline.codes().to_vec();
                    let report = pipeline.finish(config);
                    finished += 1;
                    if report.outcome == Outcome::Updated {
                        prop_assert!(begun && rows == instrument.detector.height);
                        prop_assert!(report.valid > 0);
                    } else {
                        prop_assert_eq!(pipeline.codes(), before);
                    }
                    (begun, rows) = (false, 0);
                }
                Action::Tilt(tilt_ulp, frame) => {
                    pipeline.set_global_tilt(GlobalTilt { tilt_ulp, frame });
                }
                Action::Measurements(right) => {
                    let count = instrument.count() + usize::from(!right);
                    let extreme = Measurement {
                        centroid_q16: [rng.bits() as i32, rng.bits() as i32],
                        flux: rng.bits() as u32,
                        peak: rng.bits() as u16,
                        saturated: rng.bits() as u16,
                    };
                    let taken = pipeline.push_measurements(config, &vec![extreme; count]).is_ok();
                    prop_assert_eq!(taken, begun && rows == 0 && right);
                    rows = if taken { instrument.detector.height } else { rows };
                }
                // Between frames only.
                Action::OtherBank => bank = if begun { bank } else { 1 - bank },
                Action::Reset => {
                    pipeline.reset(config);
                    (begun, rows, finished, dropped) = (false, 0, 0, 0);
                }
            }
            prop_assert_eq!(pipeline.codes().len(), instrument.count());
            assert_codes_within(&instrument, pipeline.codes())?;
            let totals = pipeline.totals();
            let held = totals.cut_short + totals.wrong_row + totals.no_light + totals.not_ready;
            prop_assert_eq!(totals.updated + held, finished);
            prop_assert_eq!(totals.restarted, dropped);
        }
    }

    /// A window's flux is the sum of its signal and its centroid that of its moments, in i128;
    /// the centroid of what is not negative lies inside the window.
    #[test]
    fn sums_are_those_of_an_exact_model(
        seed in any::<u64>(),
        dark in 0u16..3000,
        // Stored in eight bits where it is not subtracted.
        threshold in 0u16..256,
        subtract in any::<bool>(),
        n in any::<prop::sample::Index>(),
    ) {
        let convention = if subtract { Convention::Subtract } else { Convention::ZeroBelow };
        let mut plain = without_maps(seed, dark, threshold, convention);
        let size = usize::from(plain.window);
        let n = 1 + n.index(size * size - 1);
        let is_bad = |x: usize, y: usize, i: usize| {
            let [x0, y0] = plain.origins[i];
            plain.bad.contains(&[x0 + x as u16, y0 + y as u16])
        };
        let signal = |pixels: &[u16], i: usize| -> Vec<(usize, usize, u16)> {
            window(&plain, pixels, i)
                .map(|(x, y, raw)| {
                    let above = if is_bad(x, y, i) { 0 } else { raw.saturating_sub(dark) };
                    let passes = subtract || above > threshold;
                    let taken = if subtract { threshold } else { 0 };
                    (x, y, if passes { above.saturating_sub(taken) } else { 0 })
                })
                .collect()
        };
        let mut rng = Rng::new(seed ^ 2);
        let count = usize::from(plain.detector.width) * usize::from(plain.detector.height);
        let bits = 1 + rng.below(16) as u8;
        let pixels = light(&mut rng, count, bits);
        let signals: Vec<_> = (0..plain.count()).map(|i| signal(&pixels, i)).collect();

        for brightest in [false, true] {
            plain.estimator = if brightest {
                Estimator::Brightest { count: n as u16 }
            } else {
                Estimator::CentreOfGravity
            };
            let config = plain.config::<CELLS, PIXELS, PIXELS>();
            let mut pipeline = Box::new(AnyPipeline::new());
            let report = run_frame(&mut pipeline, &config, 0, &pixels);
            let mut white = 0;
            for (i, (found, signal)) in pipeline.measurements().iter().zip(&signals).enumerate() {
                // The (n+1)-th brightest pixel of the window, by sorting.
                let mut sorted: Vec<u16> = signal.iter().map(|&(_, _, s)| s).collect();
                sorted.sort_unstable_by(|a, b| b.cmp(a));
                let floor = if brightest { sorted[n] } else { 0 };
                let above = signal.iter().map(|&(x, y, s)| (x, y, s.saturating_sub(floor)));
                assert_measured(found, moments(above, size))?;
                // Of the first frame, the pixels next to the window's centre.
                let [columns, rows] = watched(size, [0.0; 2]);
                let is_near = |x: &usize, y: &usize| columns.contains(x) && rows.contains(y);
                let near = signal.iter().filter(|(x, y, _)| is_near(x, y));
                let brightest = near.clone().map(|&(_, _, s)| s).max();
                prop_assert_eq!(Some(found.peak), brightest);
                let inside = (size as i32 - 1) << 15;
                // Rounded down, and off by less than an ulp.
                let inside = -inside - 2..=inside + 1;
                prop_assert!(found.centroid_q16.iter().all(|c| inside.contains(c)));
                let raw = window(&plain, &pixels, i).filter(|(x, y, _)| is_near(x, y));
                white += raw.zip(near).filter(|((_, _, p), (_, _, s))| *p == u16::MAX && *s > 0).count();
            }
            prop_assert_eq!(report.saturated_pixels, white as u32);
            let lit = pipeline.measurements().iter().filter(|m| m.flux > 0).count();
            prop_assert_eq!(usize::from(report.valid), lit);
        }
    }

    /// Flat field: the signal is the product with the gain within half a unit, and rounding never
    /// makes light.
    #[test]
    fn flux_follows_the_gain(seed in any::<u64>(), gain in 0.25f64..4.0, level in 1u16..4000) {
        let mut plain = without_maps(seed, 0, 0, Convention::Subtract);
        plain.estimator = Estimator::CentreOfGravity;
        plain.bad.clear();
        let pixels = usize::from(plain.detector.width) * usize::from(plain.detector.height);
        // One pixel that no window misses sets the scale: the largest gain.
        let mut gains = vec![gain; pixels];
        let [x0, y0] = plain.origins[0].map(usize::from);
        gains[y0 * usize::from(plain.detector.width) + x0] = 4.0;
        plain.pixel_gain = Values::Each(gains);
        let config = plain.config::<CELLS, PIXELS, PIXELS>();
        prop_assert_eq!(config.adu_per_unit(), 4.0);
        let mut pipeline = Box::new(AnyPipeline::new());
        run_frame(&mut pipeline, &config, 0, &vec![level; pixels]);
        let area = f64::from(plain.window).powi(2);
        for measurement in pipeline.measurements().iter().skip(1) {
            let signal = f64::from(measurement.flux) / area;
            // Half a unit of rounding, and that of 1 - g/4 to 2^-16.
            let error = (signal - f64::from(level) * gain / 4.0).abs();
            prop_assert!(error <= 0.5 + f64::from(level) / 131_072.0, "{signal}: {error}");
            prop_assert!(measurement.peak <= level);
        }
    }

    /// A valid specification builds; one value out of range is refused by its name, and the bank
    /// goes on as before.
    #[test]
    fn one_wrong_value_is_named(seed in any::<u64>(), which in 0usize..12, wild in any::<f64>()) {
        let valid = instrument(seed);
        let mut config = valid.config::<CELLS, PIXELS, PIXELS>();
        let mut wrong = valid.clone();
        let rng = &mut Rng::new(seed ^ 3);
        let subaperture = rng.below(wrong.count() as u32) as usize;
        let put = |values: &mut Values<f64>, bad: f64| {
            let mut all: Vec<f64> = (0..wrong.mask.count()).map(|i| values.at(i)).collect();
            all[subaperture] = bad;
            *values = Values::Each(all);
        };
        // Beyond every range, on either side, or no number.
        let wild = if wild.abs() < 1e12 { f64::NAN } else { wild };
        let field = match which {
            0 => { put(&mut wrong.control_gain, wild); Field::ControlGain }
            1 => { put(&mut wrong.flux_min_adu, wild); Field::FluxMin }
            2 => { put(&mut wrong.flux_max_adu, wild); Field::FluxMax }
            3 => { wrong.lever_arm = wild; Field::LeverArm }
            4 => { wrong.sor.omega = Some(wild); Field::Omega }
            5 => { wrong.stroke_m = wild; Field::Stroke }
            6 => { wrong.gate.beacon_height_m = wild; Field::BeaconHeight }
            7 => { wrong.gate.zenith_angle_deg = wild; Field::ZenithAngle }
            8 => { wrong.threshold_sigma = wild; Field::ThresholdSigma }
            9 => { wrong.slew_m_per_frame = Some(wild); Field::Slew }
            10 => { wrong.origins[subaperture] = [u16::MAX; 2]; Field::WindowOrigin }
            _ => { wrong.origins.truncate(wrong.mask.count() - 1); Field::WindowOrigin }
        };
        let error = config.build(&wrong.spec()).expect_err("out of range");
        prop_assert_eq!(error.field, field, "{}", error);
        if which < 3 || which == 10 {
            prop_assert_eq!(error.index, Some(subaperture as u32));
        }
        prop_assert!(error.to_string().starts_with(field.name()));

        let again = valid.config::<CELLS, PIXELS, PIXELS>();
        let (mut a, mut b) = (Box::new(AnyPipeline::new()), Box::new(AnyPipeline::new()));
        let count = usize::from(valid.detector.width) * usize::from(valid.detector.height);
        let pixels = light(rng, count, valid.detector.bits);
        let reports = [
            run_frame(&mut a, &config, 0, &pixels),
            run_frame(&mut b, &again, 0, &pixels),
        ];
        prop_assert_eq!(reports[0], reports[1]);
        prop_assert_eq!(a.codes(), b.codes());
    }

    /// Light times two, gains and thresholds aside: the same centroid, twice the flux.
    #[test]
    fn a_centroid_does_not_know_the_brightness(seed in any::<u64>()) {
        let mut plain = without_maps(seed, 0, 0, Convention::Subtract);
        plain.estimator = Estimator::CentreOfGravity;
        let config = plain.config::<CELLS, PIXELS, PIXELS>();
        let mut rng = Rng::new(seed ^ 4);
        let count = usize::from(plain.detector.width) * usize::from(plain.detector.height);
        let dim: Vec<u16> = light(&mut rng, count, 15).iter().map(|p| p | 1).collect();
        let bright: Vec<u16> = dim.iter().map(|p| 2 * p).collect();
        let (mut a, mut b) = (Box::new(AnyPipeline::new()), Box::new(AnyPipeline::new()));
        step(&mut a, &config, 0, &dim);
        step(&mut b, &config, 0, &bright);
        for (a, b) in a.measurements().iter().zip(b.measurements()) {
            prop_assert_eq!(2 * a.flux, b.flux);
            for (a, b) in a.centroid_q16.iter().zip(b.centroid_q16) {
                // One ulp of rounding each.
                prop_assert!((a - b).abs() <= 1);
            }
        }
    }
}
