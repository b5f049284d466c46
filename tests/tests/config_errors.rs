//! Every field of a specification, with values it must refuse: the error names the field, the
//! entry and the value, and one line of text says what the limit is.
//!
//! Limits are those that the documentation of `splash_firmware::spec` and `gate` states.

use std::collections::BTreeSet;

use splash_firmware::config::Config;
use splash_firmware::error::{ConfigError, Field, Limit};
use splash_firmware::geometry::Mask;
use splash_firmware::spec::{DetectorSpec, Estimator, SorSpec, triangle};
use splash_tests::instrument::{Instrument, Values};

/// 4 x 4 subapertures with windows of 4 x 4 pixels, edge to edge.
const SIDE: u16 = 16;
const SUBAPERTURES: usize = 16;
const PIXELS: usize = SIDE as usize * SIDE as usize;
/// Four windows share a row.
const BUFFERED: usize = 4 * 4 * 4;

fn valid() -> Instrument {
    Instrument::new(Mask::square(4).expect("4 is allowed"), 4)
}

fn build(instrument: &Instrument) -> Result<(), ConfigError> {
    Config::<SUBAPERTURES, PIXELS, BUFFERED>::new().build(&instrument.spec())
}

/// A valid instrument made wrong, and what must be said about it.
struct Case {
    field: Field,
    index: Option<u32>,
    value: f64,
    instrument: Instrument,
}

fn case(field: Field, value: f64, change: impl FnOnce(&mut Instrument)) -> Case {
    let mut instrument = valid();
    change(&mut instrument);
    Case { field, index: None, value, instrument }
}

impl Case {
    const fn at(mut self, index: u32) -> Self {
        self.index = Some(index);
        self
    }
}

/// One entry each: `usual`, but for `value` at `index`.
fn each<T: Copy>(len: usize, usual: T, index: usize, value: T) -> Values<T> {
    let mut values = vec![usual; len];
    values[index] = value;
    Values::Each(values)
}

/// What no range of numbers contains, and one value below and one above the range.
fn outside(below: f64, above: f64) -> [f64; 5] {
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, below, above]
}

fn geometry() -> Vec<Case> {
    let mut cases = vec![
        // 16 cells, and more pixels than the bank of this test has.
        case(Field::Across, 5.0, |s| s.mask = Mask::square(5).expect("5 is allowed")),
        case(Field::Subapertures, 0.0, |s| s.mask = s.mask.without(|_, _| true)),
        case(Field::WindowPixels, 400.0, |s| s.window = 5),
        // Windows 1 and 0: the next origin one pixel too near, in either direction.
        case(Field::WindowOrigin, 1.0, |s| s.origins[1] = [3, 0]).at(0),
        case(Field::WindowOrigin, 4.0, |s| s.origins[4] = [0, 3]).at(0),
        case(Field::WindowOrigin, 7.0, |s| s.origins[7] = [8, 4]).at(6),
        // With a schedule: 2 and 0 are lit together, 1 and 0 are not but may not coincide.
        case(Field::WindowOrigin, 2.0, |s| {
            s.lattice = Some([2, 0, 2]);
            s.origins[2] = [3, 0];
        })
        .at(0),
        case(Field::WindowOrigin, 1.0, |s| {
            s.lattice = Some([2, 0, 2]);
            s.origins[1] = [0, 0];
        })
        .at(0),
        // Off the detector to the right and below, by one pixel and by far.
        case(Field::WindowOrigin, 13.0, |s| s.origins[3] = [13, 0]).at(3),
        case(Field::WindowOrigin, 13.0, |s| s.origins[15] = [12, 13]).at(15),
        case(Field::WindowOrigin, 65535.0, |s| s.origins[2] = [65535, 0]).at(2),
        case(Field::WindowOrigin, 65535.0, |s| s.origins[2] = [8, 65535]).at(2),
        case(Field::WindowOrigin, 15.0, |s| s.origins.truncate(15)),
        case(Field::WindowOrigin, 0.0, |s| s.origins.clear()),
    ];
    for width in [0, 4097, u16::MAX] {
        cases.push(case(Field::DetectorWidth, width.into(), |s| s.detector.width = width));
        cases.push(case(Field::DetectorHeight, width.into(), |s| s.detector.height = width));
    }
    for bits in [0, 7, 17, 255] {
        cases.push(case(Field::DetectorBits, bits.into(), |s| s.detector.bits = bits));
    }
    for size in [0, 3, 33, 255] {
        cases.push(case(Field::WindowSize, size.into(), |s| s.window = size));
    }
    cases
}

fn pixels() -> Vec<Case> {
    let mut cases = Vec::new();
    let mut map = |field, values: [f64; 5], usual, set: fn(&mut Instrument, Values<f64>)| {
        for value in values {
            // One value for all is refused at the first pixel that is looked at.
            cases.push(case(field, value, |s| set(s, Values::Uniform(value))).at(0));
            let last = PIXELS - 1;
            cases.push(case(field, value, |s| set(s, each(PIXELS, usual, last, value))).at(255));
        }
        for len in [0, PIXELS - 1, PIXELS + 1] {
            let entries = vec![usual; len];
            cases.push(case(field, len as f64, |s| set(s, Values::Each(entries))));
        }
    };
    map(Field::Dark, outside(-0.5, 65534.5), 100.0, |s, m| s.dark_adu = m);
    map(Field::PixelGain, outside(0.249, 4.01), 1.0, |s, m| s.pixel_gain = m);
    map(Field::Noise, outside(-0.5, 65534.5), 2.0, |s, m| s.noise_adu = m);
    for value in outside(-0.1, 100.1) {
        let change = |s: &mut Instrument| s.threshold_sigma = value;
        cases.push(case(Field::ThresholdSigma, value, change));
    }
    for level in [0, 4096] {
        let change = |s: &mut Instrument| s.saturation_adu = Some(level);
        cases.push(case(Field::Saturation, level.into(), change));
    }
    cases.extend([
        case(Field::BadPixels, 16.0, |s| s.bad = vec![[0, 0], [16, 0]]).at(1),
        case(Field::BadPixels, 16.0, |s| s.bad = vec![[0, 16]]).at(0),
        // Not in order of row, then column; and twice the same.
        case(Field::BadPixels, 9.0, |s| s.bad = vec![[3, 2], [9, 1]]).at(1),
        case(Field::BadPixels, 2.0, |s| s.bad = vec![[3, 2], [2, 2]]).at(1),
        case(Field::BadPixels, 3.0, |s| s.bad = vec![[3, 2], [3, 2]]).at(1),
    ]);
    cases
}

fn estimators() -> Vec<Case> {
    let mut cases = Vec::new();
    for peak_fraction in outside(-0.01, 0.91) {
        let thresholded = Estimator::ThresholdedCentreOfGravity { peak_fraction };
        let weighted =
            Estimator::WeightedCentreOfGravity { peak_fraction, fwhm_px: 4.0, gain: 1.5 };
        for estimator in [thresholded, weighted] {
            cases.push(case(Field::PeakFraction, peak_fraction, |s| s.estimator = estimator));
        }
    }
    for fwhm_px in outside(0.49, 64.1) {
        let estimator =
            Estimator::WeightedCentreOfGravity { peak_fraction: 0.1, fwhm_px, gain: 1.5 };
        cases.push(case(Field::WeightFwhm, fwhm_px, |s| s.estimator = estimator));
    }
    for gain in outside(0.0, 7.1) {
        let estimator =
            Estimator::WeightedCentreOfGravity { peak_fraction: 0.1, fwhm_px: 4.0, gain };
        cases.push(case(Field::WeightGain, gain, |s| s.estimator = estimator));
    }
    for count in [0, 16, u16::MAX] {
        let estimator = Estimator::Brightest { count };
        cases.push(case(Field::BrightestCount, count.into(), |s| s.estimator = estimator));
    }
    // Five windows in the first rows: one more than the buffer takes.
    cases.push(case(Field::BrightestBuffer, 80.0, |s| {
        s.detector = DetectorSpec { width: 20, height: 16, bits: 12 };
        s.origins[4] = [16, 2];
        s.estimator = Estimator::Brightest { count: 5 };
    }));
    cases
}

fn slopes() -> Vec<Case> {
    let mut cases = Vec::new();
    for value in outside(-32.01, 32.01) {
        for reference in [[value, 0.0], [0.0, value]] {
            let uniform = Values::Uniform(reference);
            let one = each(SUBAPERTURES, [0.0; 2], 9, reference);
            for (map, index) in [(uniform, 0), (one, 9)] {
                let change = |s: &mut Instrument| s.reference_px = map;
                cases.push(case(Field::ReferenceSlope, value, change).at(index));
            }
        }
    }
    // The value of a matrix that has no inverse is its determinant.
    let usual = [[1e-7, 0.0], [0.0, 1e-7]];
    let singular: [([[f64; 2]; 2], f64); 4] = [
        ([[f64::NAN, 0.0], [0.0, 1e-7]], f64::NAN),
        ([[1e-7, 0.0], [f64::INFINITY, 1e-7]], f64::NAN),
        ([[0.0; 2]; 2], 0.0),
        ([[2e-7, 2e-7], [2e-7, 2e-7]], 0.0),
    ];
    for (gain, determinant) in singular {
        for (map, index) in [(Values::Uniform(gain), 0), (each(SUBAPERTURES, usual, 3, gain), 3)] {
            let change = |s: &mut Instrument| s.slope_gain_m_per_px = map;
            cases.push(case(Field::SlopeGain, determinant, change).at(index));
        }
    }
    // Beyond any use: a pixel that stands for a metre.
    let huge = each(SUBAPERTURES, usual, 5, [[1.0, 0.0], [0.0, 1.0]]);
    cases.push(case(Field::SlopeGain, 1.0, |s| s.slope_gain_m_per_px = huge));
    for value in outside(-1.0, 1e11) {
        let change = |s: &mut Instrument| s.flux_min_adu = Values::Uniform(value);
        cases.push(case(Field::FluxMin, value, change).at(0));
    }
    // The least flux is 200.
    for value in outside(199.9, 1e11) {
        let map = each(SUBAPERTURES, 1e5, 15, value);
        cases.push(case(Field::FluxMax, value, |s| s.flux_max_adu = map).at(15));
    }
    cases
}

fn control() -> Vec<Case> {
    let mut cases = Vec::new();
    for value in [0.0, -0.0, 2.0, f64::MIN_POSITIVE].into_iter().chain(outside(-0.5, 2.5)) {
        let uniform = Values::Uniform(value);
        for (map, index) in [(uniform, 0), (each(SUBAPERTURES, 0.5, 7, value), 7)] {
            cases.push(case(Field::ControlGain, value, |s| s.control_gain = map).at(index));
        }
    }
    for value in outside(0.49, 1.91) {
        cases.push(case(Field::LeverArm, value, |s| s.lever_arm = value));
    }
    for frames in [4, 255] {
        cases.push(case(Field::DelayFrames, frames.into(), |s| s.delay_frames = frames));
    }
    for value in outside(0.99, 2.0) {
        cases.push(case(Field::Omega, value, |s| s.sor.omega = Some(value)));
    }
    for sweeps in [0, 1001, u16::MAX] {
        cases.push(case(Field::Sweeps, sweeps.into(), |s| s.sor.sweeps = Some(sweeps)));
    }
    for sweeps in [0, 10_001, u16::MAX] {
        let change = |s: &mut Instrument| s.sor.cold_sweeps = Some(sweeps);
        cases.push(case(Field::ColdSweeps, sweeps.into(), change));
    }
    cases
}

fn segments() -> Vec<Case> {
    let mut cases = Vec::new();
    for value in outside(0.0, 1.1) {
        cases.push(case(Field::Stroke, value, |s| s.stroke_m = value));
    }
    let usual = triangle(1.0);
    for actuator in 0..3 {
        for column in 0..3 {
            let [below, above] = if column == 0 { [0.24, 4.01] } else { [-4.01, 4.01] };
            for value in outside(below, above) {
                let mut matrix = usual;
                matrix[actuator][column] = value;
                let map = each(SUBAPERTURES, usual, 11, matrix);
                cases.push(case(Field::SegmentMatrix, value, |s| s.matrix = map).at(11));
            }
        }
    }
    // Three actuators on a line: nothing tilts about it.
    let line = [[1.0, -1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]];
    cases.push(case(Field::SegmentMatrix, 0.0, |s| s.matrix = Values::Uniform(line)).at(0));

    let top = valid().stroke_m;
    let middle = top / 2.0;
    for value in outside(-1e-9, 1.01 * top) {
        for actuator in 0..3 {
            let mut flat = [middle; 3];
            flat[actuator] = value;
            let map = each(SUBAPERTURES, [middle; 3], 2, flat);
            cases.push(case(Field::Flat, value, |s| s.flat_m = map).at(2));
            for end in 0..2 {
                let mut limits = [[0.0, top]; 3];
                limits[actuator][end] = value;
                let map = each(SUBAPERTURES, [[0.0, top]; 3], 2, limits);
                cases.push(case(Field::HeightLimits, value, |s| s.limits_m = map).at(2));
            }
        }
    }
    let crossed = Values::Uniform([[0.0, top], [0.6 * top, 0.4 * top], [0.0, top]]);
    let change = |s: &mut Instrument| s.limits_m = crossed;
    cases.push(case(Field::HeightLimits, 0.4 * top, change).at(0));
    let low = Values::Uniform([[0.6 * top, top]; 3]);
    cases.push(case(Field::Flat, middle, |s| s.limits_m = low).at(0));
    for value in outside(0.0, 1.01 * top) {
        cases.push(case(Field::Slew, value, |s| s.slew_m_per_frame = Some(value)));
    }

    for bits in [0, 7, 17, 255] {
        cases.push(case(Field::DacBits, bits.into(), |s| s.dac_bits = bits));
    }
    // The value of a response that is not one is its span.
    for full in [f64::NAN, f64::INFINITY, 0.0, 0.24 * top] {
        let response = [[0.0, top], [0.0, full], [0.0, top]];
        let map = each(SUBAPERTURES, [[0.0, top]; 3], 6, response);
        cases.push(case(Field::Response, full, |s| s.response_m = map).at(6));
    }
    cases
}

fn gate() -> Vec<Case> {
    let mut cases = Vec::new();
    for value in outside(0.0, 1.1e6) {
        cases.push(case(Field::BeaconHeight, value, |s| s.gate.beacon_height_m = value));
    }
    // Deeper than twice the height would open before the pulse.
    for value in outside(0.0, 24.1e3) {
        cases.push(case(Field::GateDepth, value, |s| s.gate.depth_m = value));
    }
    for value in outside(-0.1, 80.1) {
        cases.push(case(Field::ZenithAngle, value, |s| s.gate.zenith_angle_deg = value));
    }
    for value in outside(0.0, 1.1e8) {
        cases.push(case(Field::PulseRate, value, |s| s.gate.pulse_rate_hz = value));
    }
    for pulses in [0, 1_000_001, u32::MAX] {
        let change = |s: &mut Instrument| s.gate.pulses_per_frame = pulses;
        cases.push(case(Field::PulsesPerFrame, pulses.into(), change));
    }
    // Ten pulses at 10 kHz: 1 ms.
    for value in outside(-1e-9, 1.001e-3) {
        cases.push(case(Field::Readout, value, |s| s.gate.readout_s = value));
    }
    cases
}

/// 16 subapertures, 4 x 4.
fn schedule() -> Vec<Case> {
    let colours = |s: &mut Instrument, colours: &[u8]| s.colours = colours.to_vec();
    let mut gap = [0u8; SUBAPERTURES];
    gap[3] = 2;
    let mut many = [0u8; SUBAPERTURES];
    many[5] = 64;
    let mut cases = vec![
        case(Field::Colours, 15.0, |s| colours(s, &[0; SUBAPERTURES - 1])),
        case(Field::Colours, 1.0, |s| colours(s, &gap)),
        case(Field::Colours, 64.0, |s| colours(s, &many)).at(5),
        case(Field::Lattice, 0.0, |s| s.lattice = Some([0, 1, 2])).at(0),
        case(Field::Lattice, 0.0, |s| s.lattice = Some([2, 1, 0])).at(2),
        case(Field::Colours, 72.0, |s| s.lattice = Some([9, 1, 8])),
        case(Field::Separation, 1.0, |s| {
            colours(s, &[0; SUBAPERTURES]);
            s.separation = 1.5;
        })
        .at(0),
    ];
    for value in outside(-0.1, 64.1) {
        cases.push(case(Field::Separation, value, |s| {
            colours(s, &[0; SUBAPERTURES]);
            s.separation = value;
        }));
    }
    cases
}

fn safety() -> Vec<Case> {
    let mut cases = Vec::new();
    for value in outside(-0.01, 1.01) {
        cases.push(case(Field::ValidMin, value, |s| s.safety.valid_min = value));
        cases.push(case(Field::Leak, value, |s| s.safety.leak = value));
        cases.push(case(Field::SaturatedShare, value, |s| s.safety.saturated_share = value));
    }
    for value in [f64::NAN, f64::INFINITY, -1.0] {
        cases.push(case(Field::TotalFluxMin, value, |s| s.safety.flux_min_adu = value));
    }
    for value in [f64::NAN, 99.0, -1.0] {
        cases.push(case(Field::TotalFluxMax, value, |s| {
            s.safety.flux_min_adu = 100.0;
            s.safety.flux_max_adu = value;
        }));
    }
    cases.push(case(Field::HoldFrames, 8.0, |s| {
        s.safety.hold_frames = 8;
        s.safety.safe_frames = 7;
    }));
    cases
}

fn all() -> Vec<Case> {
    let light = [geometry(), pixels(), estimators(), slopes(), gate(), schedule()];
    light.into_iter().chain([control(), segments(), safety()]).flatten().collect()
}

#[test]
fn the_unchanged_specification_builds() {
    assert_eq!(build(&valid()), Ok(()));
}

#[test]
fn each_refusal_names_field_entry_and_value() {
    for Case { field, index, value, instrument } in all() {
        let error = build(&instrument).expect_err(field.name());
        assert_eq!(error.field, field, "{error}");
        assert_eq!(error.index, index, "{error}");
        let same = error.value == value || (error.value.is_nan() && value.is_nan());
        assert!(same, "{error}: refused {}, was {value}", error.value);
    }
}

#[test]
fn each_refusal_is_one_line_with_field_value_and_limit() {
    for Case { field, index, value, instrument } in all() {
        let error = build(&instrument).expect_err(field.name());
        let entry = index.map_or(String::new(), |i| format!("[{i}]"));
        let text = error.to_string();
        let start = format!("{}{entry} = {value}: ", field.name());
        let limit = text.strip_prefix(&start).unwrap_or_else(|| panic!("{text}: not {start}"));
        assert!(limit.contains("must "), "{text}: does not say what must be");
        assert!(!text.contains('\n') && !text.ends_with('.'), "{text}");
        let numbers = match error.limit {
            Limit::Within(low, high) | Limit::Between(low, high) => vec![low, high],
            Limit::Elevation { most, .. } => vec![most],
            Limit::Rule(_) => vec![],
        };
        for number in numbers {
            assert!(limit.contains(&number.to_string()), "{text}: where is {number}?");
        }
    }
}

/// The gate closes at 2 (H + dH/2) / (c cos z); the period is that of the laser.
#[test]
fn a_gate_that_outlasts_the_period_is_refused_with_its_end() {
    for (height_m, depth_m, zenith_deg, rate_hz) in
        [(12e3, 300.0, 0.0, 12.4e3), (12e3, 300.0, 60.0, 10e3), (1e5, 2e5, 0.0, 760.0)]
    {
        let mut instrument = valid();
        instrument.gate.beacon_height_m = height_m;
        instrument.gate.depth_m = depth_m;
        instrument.gate.zenith_angle_deg = zenith_deg;
        instrument.gate.pulse_rate_hz = rate_hz;
        let error = build(&instrument).expect_err("the gate is still open at the next pulse");
        let end_s =
            2.0 * (height_m + depth_m / 2.0) / (299_792_458.0 * zenith_deg.to_radians().cos());
        assert!(end_s > 1.0 / rate_hz, "the case is one");
        assert_eq!(error.field, Field::GateEnd);
        assert!((error.value / end_s - 1.0).abs() < 1e-12, "{error}: {end_s}");
        let Limit::Elevation { most, least_deg } = error.limit else { panic!("{error}") };
        assert_eq!(most, 1.0 / rate_hz);
        // sin e = 2 (H + dH/2) / (c T), where there is such an e.
        let sine = end_s * zenith_deg.to_radians().cos() * rate_hz;
        if sine > 1.0 {
            assert!(error.to_string().ends_with("it fits at no elevation"), "{error}");
        } else {
            assert!((least_deg - sine.asin().to_degrees()).abs() < 1e-9, "{error}");
        }
    }
}

#[test]
fn a_pupil_that_is_none_is_refused() {
    for across in [0, 1, 3, 41, 1000] {
        let error = Mask::square(across).expect_err("N is from 4 to 40");
        assert_eq!((error.field, error.value), (Field::Across, across as f64));
        assert_eq!(error.to_string(), format!("pupil.across = {across}: must be from 4 to 40"));
    }
    for obstruction in outside(-0.01, 1.0) {
        let error = Mask::annulus(8, obstruction).expect_err("no annulus");
        assert_eq!(error.field, Field::Obstruction);
        assert!(error.to_string().starts_with("pupil.obstruction = "), "{error}");
    }
}

/// A response must reach both height limits: what a code cannot reach must not be promised.
#[test]
fn a_response_that_does_not_reach_the_limits_is_refused() {
    let top = valid().stroke_m;
    for (ends, reached) in [
        ([0.0, 0.9 * top], 1.0 / 0.9),
        ([0.1 * top, top], -0.1 / 0.9),
        ([top, 0.2 * top], 1.0 / 0.8),
    ] {
        let mut instrument = valid();
        instrument.response_m = Values::Uniform([ends; 3]);
        let error = build(&instrument).expect_err("a limit is out of reach");
        assert_eq!((error.field, error.index), (Field::Response, Some(0)));
        // Limits are whole LSB of 2^-16 of the stroke, inwards.
        assert!((error.value - reached).abs() < 1e-4, "{error}: {reached}");
    }
}

/// The calibration of a bad pixel, and of one that no window contains, is not looked at.
#[test]
fn what_is_not_looked_at_may_be_anything() {
    let mut instrument = valid();
    let bad = [5, 3];
    let at = usize::from(SIDE) * 3 + 5;
    instrument.bad = vec![[5, 3]];
    instrument.dark_adu = each(PIXELS, 100.0, at, f64::NAN);
    instrument.pixel_gain = each(PIXELS, 1.0, at, -1.0);
    instrument.noise_adu = each(PIXELS, 2.0, at, f64::INFINITY);
    assert_eq!(build(&instrument), Ok(()), "bad pixel {bad:?}");
}

/// Ends of the ranges are inside them.
#[test]
fn the_documented_ends_are_allowed() {
    let mut ends = Vec::<(&str, Instrument)>::new();
    let mut allow = |what, change: &dyn Fn(&mut Instrument)| {
        let mut instrument = valid();
        change(&mut instrument);
        ends.push((what, instrument));
    };
    for value in [0.0, 65534.0] {
        allow("dark", &|s| s.dark_adu = Values::Uniform(value));
        allow("noise", &|s| s.noise_adu = Values::Uniform(value));
    }
    for value in [0.25, 4.0] {
        allow("pixel gain", &|s| s.pixel_gain = Values::Uniform(value));
    }
    for value in [0.0, 100.0] {
        allow("threshold", &|s| s.threshold_sigma = value);
    }
    for peak_fraction in [0.0, 0.9] {
        let estimator = Estimator::ThresholdedCentreOfGravity { peak_fraction };
        allow("peak fraction", &|s| s.estimator = estimator);
    }
    for (fwhm_px, gain) in [(0.5, 7.0), (64.0, 0.001)] {
        let estimator = Estimator::WeightedCentreOfGravity { peak_fraction: 0.0, fwhm_px, gain };
        allow("weight", &|s| s.estimator = estimator);
    }
    for count in [1, 15] {
        allow("brightest", &|s| s.estimator = Estimator::Brightest { count });
    }
    for value in [-32.0, 32.0] {
        allow("reference", &|s| s.reference_px = Values::Uniform([value; 2]));
    }
    for value in [0.001, 1.999] {
        allow("gain", &|s| s.control_gain = Values::Uniform(value));
    }
    for value in [0.5, 1.9] {
        allow("lever arm", &|s| s.lever_arm = value);
    }
    for value in [1.0, 1.99] {
        allow("omega", &|s| s.sor.omega = Some(value));
    }
    for (warm, cold) in [(1, 1), (1000, 10_000)] {
        allow("sweeps", &|s| {
            s.sor = SorSpec { omega: None, sweeps: Some(warm), cold_sweeps: Some(cold) };
        });
    }
    // A Q13 number in 16 bits ends just below 4.
    for piston in [0.25, 3.999] {
        let matrix = triangle(1.0).map(|[_, tip, tilt]| [piston, tip, tilt]);
        allow("piston influence", &|s| s.matrix = Values::Uniform(matrix));
    }
    for radius in [-3.999, 3.999] {
        allow("tilt influence", &|s| s.matrix = Values::Uniform(triangle(radius)));
    }
    for value in [0.0, valid().stroke_m] {
        // The highest height is one LSB below the stroke.
        let value = value * (1.0 - 1.0 / 65536.0);
        allow("flat", &|s| s.flat_m = Values::Uniform([value; 3]));
    }
    allow("slew", &|s| s.slew_m_per_frame = Some(s.stroke_m));
    for bits in [8, 16] {
        allow("DAC", &|s| s.dac_bits = bits);
        allow("detector", &|s| s.detector.bits = bits);
    }
    allow("response downwards", &|s| {
        s.response_m = Values::Uniform([[s.stroke_m, 0.0]; 3]);
    });
    for frames in [0, 3] {
        allow("delay", &|s| s.delay_frames = frames);
    }
    for value in [0.0, 1e-3] {
        allow("readout", &|s| s.gate.readout_s = value);
    }
    for (what, instrument) in ends {
        assert_eq!(build(&instrument).map_err(|error| error.to_string()), Ok(()), "{what}");
    }
}

/// The variants of `Field` as its source lists them, since it is not exhaustive to other crates.
fn fields() -> BTreeSet<String> {
    let source = include_str!("../../firmware/src/error.rs");
    let (_, list) = source.split_once("pub enum Field {").expect("the enumeration");
    let (list, _) = list.split_once('}').expect("its end");
    list.split(',').map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
}

#[test]
fn every_field_is_refused_by_some_case() {
    let elsewhere = [
        Field::Obstruction,
        Field::GateEnd,
        // Of a second gate: in two_gates/refused.rs.
        Field::Coupling,
        Field::Modes,
        Field::SecondFluxMax,
        Field::SecondFluxMin,
        Field::SecondGain,
        Field::SecondOrigin,
        Field::SecondReference,
        Field::Windows,
    ];
    let cases = all();
    let seen = cases.iter().map(|case| case.field).chain(elsewhere);
    let seen: BTreeSet<_> = seen.map(|field| format!("{field:?}")).collect();
    assert_eq!(seen, fields());
}
