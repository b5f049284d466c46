//! Pixels, centroids and slopes against f64.
//!
//! The models calibrate with the stored numbers (whole ADU, 16-bit gains) where the arithmetic is
//! on trial, and with the physical ones where the format is.

use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::fixed::TILT_LIMIT;
use splash_firmware::pipeline::Pipeline;
use splash_firmware::pixels::Convention;
use splash_firmware::slopes::Slope;
use splash_firmware::spec::Estimator;
use splash_tests::frames::{self, Background, Rng, Spot};
use splash_tests::instrument::{Instrument, Values, run_frame};
use splash_tests::twin::pixels::{Detector, History, Numbers, Seen};
use splash_tests::twin::{round, stored};
use splash_tests::{largest, rms, with_big_stack};

/// 4 x 4 grid; 12 windows of 32 x 32 pixels, four of them on a row.
type Bank = Config<16, { 12 * 1024 }, { 4 * 1024 }>;
type Path = Pipeline<16, { 4 * 1024 }>;

/// Pixels: the specified rms error of a centroid on the same pixels.
const CENTROID_PX: f64 = 1e-4;
/// Largest error of a quotient, pixels: an ulp of Q16 that is rounded down, and 2^-20 of up to 16 pixels.
const ROUNDED_PX: f64 = 2.0 / 65536.0;

const WINDOWS: [u8; 6] = [4, 5, 8, 13, 16, 32];

/// A detector with a character: pixels differ in dark level, gain and noise, and one in fifty is
/// bad. Dark levels are whole ADU if `whole`.
fn rugged(window: u8, bits: u8, whole: bool, rng: &mut Rng) -> Instrument {
    let mut instrument = Instrument::circle(4, window);
    instrument.detector.bits = bits;
    let (side, scale) = (instrument.detector.width, f64::from(1 << bits) / 4096.0);
    let area = usize::from(side) * usize::from(side);
    let dark = |rng: &mut Rng| {
        let level = 100.0 * scale + rng.uniform(-8.0, 8.0) * f64::min(scale, 1.0);
        if whole { round(level) } else { level }
    };
    instrument.dark_adu = Values::Each((0..area).map(|_| dark(rng)).collect());
    instrument.pixel_gain = Values::Each((0..area).map(|_| rng.uniform(0.8, 1.25)).collect());
    let noise = (0..area).map(|_| scale * rng.uniform(0.5, 1.2)).collect();
    instrument.noise_adu = Values::Each(noise);
    let places = (0..side).flat_map(|y| (0..side).map(move |x| [x, y]));
    instrument.bad = places.filter(|_| rng.below(50) == 0).collect();
    instrument.flux_min_adu = Values::Uniform(0.0);
    instrument
}

/// A frame whose brightest spots just saturate, in 8 to 16 bits alike.
fn spots(instrument: &Instrument, rng: &mut Rng) -> Vec<u16> {
    let top = (1u32 << instrument.detector.bits) - 1;
    let peak = rng.between(top as i32 / 8, top as i32) as u32;
    let width = 256 + 24 * u32::from(instrument.window);
    let wander = 40 * i32::from(instrument.window);
    let background = Background {
        level_adu: (100 * (top + 1)) >> 12,
        noise_q8: ((192 * (top + 1)) >> 12).max(128),
        electrons_per_adu: 4,
    };
    let spots = frames::scattered(instrument, (peak, width, wander), rng);
    frames::frame(instrument, &spots, &background, rng)
}

/// What the firmware and a model see of the same frames, frame by frame and window by window. The
/// model's memory of a frame is what the firmware reported of it.
fn compare(
    instrument: &Instrument,
    numbers: Numbers,
    frames: &[Vec<u16>],
    mut each: impl FnMut(&Measurement, &Seen),
) {
    let config: Box<Bank> = instrument.config();
    let mut path = Box::new(Path::new());
    let model = Detector::new(instrument, numbers);
    assert!((config.adu_per_unit() - model.largest_gain()).abs() < 1e-12);
    let mut history = vec![History::default(); instrument.count()];
    for (number, frame) in frames.iter().enumerate() {
        run_frame(&mut path, &config, number as u32, frame);
        let windows = path.measurements().iter().zip(&mut history).enumerate();
        for (i, (measured, history)) in windows {
            let seen = model.measure(i, frame, history);
            each(measured, &seen);
            history.peak = match numbers {
                Numbers::Stored => f64::from(measured.peak),
                Numbers::Physical => seen.peak,
            };
            history.near = [0.0; 2];
            if measured.flux > 0 {
                history.centroid = pixels(measured);
                history.near = history.centroid;
            }
        }
    }
}

fn pixels(measured: &Measurement) -> [f64; 2] {
    measured.centroid_q16.map(|c| f64::from(c) / 65536.0)
}

/// Centroid errors, pixels, with peak, saturation count and (unless it is weighted) flux checked.
fn errors(instrument: &Instrument, frames: &[Vec<u16>]) -> Vec<f64> {
    let weighted = matches!(instrument.estimator, Estimator::WeightedCentreOfGravity { .. });
    let mut errors = Vec::new();
    compare(instrument, Numbers::Stored, frames, |measured, seen| {
        assert_eq!(f64::from(measured.peak), seen.peak);
        assert_eq!(measured.saturated, seen.saturated);
        if weighted {
            assert!((f64::from(measured.flux) - seen.flux).abs() <= 1e-4 * seen.flux + 1.0);
        } else {
            assert_eq!(f64::from(measured.flux), seen.flux);
        }
        if measured.flux > 0 && seen.flux >= 1.0 {
            let [x, y] = pixels(measured);
            errors.extend([x - seen.centroid[0], y - seen.centroid[1]]);
        }
    });
    assert!(errors.len() > frames.len() * instrument.count(), "most windows have light");
    errors
}

/// Runs an estimator over window sizes, bits, conventions and detectors; returns the rms and the
/// largest error of all, and prints the worst case.
fn survey(name: &str, estimator: impl Fn(u8) -> Estimator) -> (f64, f64) {
    let mut rng = Rng::new(0x5eed);
    let (mut all, mut worst) = (Vec::new(), (0.0, String::new()));
    for window in WINDOWS {
        for bits in 8..=16 {
            for convention in [Convention::Subtract, Convention::ZeroBelow] {
                let mut instrument = rugged(window, bits, false, &mut rng);
                instrument.convention = convention;
                instrument.estimator = estimator(window);
                let frames: Vec<_> = (0..4).map(|_| spots(&instrument, &mut rng)).collect();
                let errors = errors(&instrument, &frames);
                let error = rms(errors.iter().copied());
                if error > worst.0 {
                    worst = (error, format!("W = {window}, {bits} bit, {convention:?}"));
                }
                all.extend(errors);
            }
        }
    }
    let (total, most) = (rms(all.iter().copied()), largest(all.iter().copied()));
    let (worst, place) = worst;
    println!("{name}: rms {total:.2e} px, largest {most:.2e}, worst case {worst:.2e} ({place})");
    (worst, most)
}

#[test]
fn plain_centre_of_gravity() {
    let (rms, most) = with_big_stack(|| survey("plain", |_| Estimator::CentreOfGravity));
    assert!(rms <= CENTROID_PX);
    assert!(most <= ROUNDED_PX, "{most:e}");
}

#[test]
fn thresholded_centre_of_gravity() {
    for peak_fraction in [0.1, 0.37] {
        let estimator = |_| Estimator::ThresholdedCentreOfGravity { peak_fraction };
        let (rms, most) = with_big_stack(|| survey("thresholded", estimator));
        assert!(rms <= CENTROID_PX);
        assert!(most <= ROUNDED_PX, "{most:e}");
    }
}

#[test]
fn brightest_pixels() {
    for count in [3, 15, u16::MAX] {
        let count = |window: u8| count.min(u16::from(window).pow(2) - 1);
        let estimator = |window| Estimator::Brightest { count: count(window) };
        let (rms, most) = with_big_stack(|| survey("brightest", estimator));
        assert!(rms <= CENTROID_PX);
        assert!(most <= ROUNDED_PX, "{most:e}");
    }
}

/// Full width of the spots of [`spots`] and [`steady`], pixels: 2 sqrt(sqrt 2 - 1) w.
fn spot_fwhm_px(window: u8) -> f64 {
    1.2872 * (1.0 + 24.0 * f64::from(window) / 256.0)
}

/// A weight a little wider than the spot, and the gain that undoes it: (u + v) / v for variances
/// u of the spot and v of the weight. No stored weight is near a tie: 255/2 lies between samples.
fn weighted(window: u8) -> Estimator {
    let fwhm_px = 0.3 + 1.1 * spot_fwhm_px(window);
    let gain = 1.0 + (spot_fwhm_px(window) / fwhm_px).powi(2);
    Estimator::WeightedCentreOfGravity { peak_fraction: 0.1, fwhm_px, gain }
}

/// Weights as they are documented (8 bits, centred on an eighth of a pixel), but exact products.
#[test]
fn weighted_centre_of_gravity_with_its_own_weights() {
    let (rms, most) = with_big_stack(|| survey("weighted, stored weights", weighted));
    assert!(rms <= CENTROID_PX, "{rms:e}");
    // A quotient's times the gain, which is below 2, and the rounding of that product.
    assert!(most <= 2.0 * ROUNDED_PX + 0.5 / 65536.0, "{most:e}");
}

/// Spots that stay within a quarter of a pixel of where they were.
fn steady_spots(instrument: &Instrument, peak_adu: u32, rng: &mut Rng) -> Vec<Vec<Spot>> {
    let width = 256 + 24 * u32::from(instrument.window);
    let wander = 20 * i32::from(instrument.window);
    let homes = frames::scattered(instrument, (peak_adu, width, wander), rng);
    let frame = |_| {
        let spot = |home: &Spot| Spot {
            centre_q8: home.centre_q8.map(|c| c + rng.between(-64, 64)),
            ..*home
        };
        homes.iter().map(spot).collect()
    };
    (0..12).map(frame).collect()
}

/// The frames of [`steady_spots`].
fn steady(instrument: &Instrument, peak_adu: u32, rng: &mut Rng) -> Vec<Vec<u16>> {
    let spots = steady_spots(instrument, peak_adu, rng);
    let frame = |spots: &Vec<_>| frames::frame(instrument, spots, &Background::DEFAULT, rng);
    spots.iter().map(frame).collect()
}

/// Errors against the physical numbers, pixels; frames during which the weights and thresholds
/// find their places are left out.
fn physical_errors(instrument: &Instrument, frames: &[Vec<u16>]) -> Vec<f64> {
    let (mut errors, mut windows) = (Vec::new(), 0);
    compare(instrument, Numbers::Physical, frames, |measured, seen| {
        windows += 1;
        if windows > 3 * instrument.count() {
            let [x, y] = pixels(measured);
            errors.extend([x - seen.centroid[0], y - seen.centroid[1]]);
        }
    });
    errors
}

/// Real-valued Gaussian weights, centred exactly on the last centroid: the stored ones cost less
/// than a tenth of the 0.032 px of noise that 10^4 electrons leave.
#[test]
fn weighted_centre_of_gravity_with_ideal_weights() {
    with_big_stack(|| {
        for window in WINDOWS {
            let mut rng = Rng::new(11);
            let mut instrument = Instrument::circle(4, window);
            instrument.estimator = weighted(window);
            let frames = steady(&instrument, 2000, &mut rng);
            let error = rms(physical_errors(&instrument, &frames));
            println!("weighted, ideal weights, W = {window}: {error:.2e} px");
            assert!(error <= 3.2e-3, "W = {window}: {error:e}");
        }
    });
}

/// Calibrations that the format holds exactly (whole ADU, unit gain, no moving threshold) leave
/// nothing but the arithmetic between the firmware and the physical numbers.
#[test]
fn exact_calibration_is_the_physical_one() {
    with_big_stack(|| {
        for convention in [Convention::Subtract, Convention::ZeroBelow] {
            for window in WINDOWS {
                let mut rng = Rng::new(12);
                let mut instrument = rugged(window, 12, true, &mut rng);
                instrument.pixel_gain = Values::Uniform(1.0);
                instrument.noise_adu = Values::Uniform(2.0);
                instrument.convention = convention;
                instrument.estimator = Estimator::CentreOfGravity;
                let frames = steady(&instrument, 2000, &mut rng);
                let error = largest(physical_errors(&instrument, &frames));
                assert!(error <= ROUNDED_PX, "W = {window}, {convention:?}: {error:e}");
            }
        }
    });
}

/// Dark levels between whole ADU, gains and thresholds of each pixel, at 10^4 electrons: their
/// storage costs less than a third of what the noise of the same frames does, 5 % in quadrature.
/// Where a pixel passes whole or not at all, half an ADU of threshold decides about more: less
/// than the noise.
#[test]
fn storage_of_the_calibration_costs_little() {
    with_big_stack(|| {
        for (convention, part) in [(Convention::Subtract, 1.0 / 3.0), (Convention::ZeroBelow, 1.0)]
        {
            let mut rng = Rng::new(13);
            let mut instrument = rugged(16, 12, false, &mut rng);
            instrument.convention = convention;
            let spots = steady_spots(&instrument, 125, &mut rng);
            let draw = |background: Background, rng: &mut Rng| -> Vec<_> {
                let frame = |spots| frames::frame(&instrument, spots, &background, rng);
                spots.iter().map(Vec::as_slice).map(frame).collect()
            };
            let noisy = draw(Background::DEFAULT, &mut rng);
            let quiet = draw(
                Background { noise_q8: 0, electrons_per_adu: 0, ..Background::DEFAULT },
                &mut rng,
            );
            let error = rms(physical_errors(&instrument, &noisy));
            let seen = |frames: &[Vec<u16>]| {
                let mut centroids = Vec::new();
                compare(&instrument, Numbers::Physical, frames, |_, seen| {
                    centroids.extend(seen.centroid);
                });
                centroids
            };
            let noise =
                rms(seen(&noisy).iter().zip(seen(&quiet)).map(|(noisy, quiet)| noisy - quiet));
            println!("calibration as stored, {convention:?}: {error:.2e} px, noise {noise:.2e} px");
            assert!(error <= part * noise, "{convention:?}: {error:e}");
        }
    });
}

/// A window without light: no flux, centred, invalid; its neighbours are measured.
#[test]
fn dark_windows_are_zero() {
    let mut instrument = Instrument::circle(4, 8);
    instrument.flux_min_adu = Values::Uniform(0.0);
    let config: Box<Bank> = instrument.config();
    let mut path = Box::new(Path::new());
    let mut rng = Rng::new(14);
    let mut spots = frames::scattered(&instrument, (2000, 500, 300), &mut rng);
    spots.iter_mut().step_by(3).for_each(|spot| spot.peak_adu = 0);
    let quiet = Background { noise_q8: 0, ..Background::DEFAULT };
    let frame = frames::frame(&instrument, &spots, &quiet, &mut rng);
    let report = run_frame(&mut path, &config, 0, &frame);
    assert_eq!(report.valid, 8);
    for (i, (measured, slope)) in path.measurements().iter().zip(path.slopes()).enumerate() {
        assert_eq!(slope.valid, i % 3 != 0);
        assert_eq!(measured.flux == 0, i % 3 == 0);
        if i % 3 == 0 {
            assert_eq!(*measured, Measurement::default());
        }
    }
}

/// s = G (c - reference) from the firmware's own centroids: largest error beyond what the formats
/// allow (two products rounded down, the Q16 of the reference, 16-bit mantissas), ulp.
fn slope_excess(instrument: &Instrument, measured: &[Measurement], slopes: &[Slope]) -> f64 {
    let ulp_m = instrument.ulp_m();
    let gains = (0..instrument.count()).map(|i| instrument.slope_gain_m_per_px.at(i));
    let largest_gain = largest(gains.flat_map(|g| g.concat())) / ulp_m;
    let limit = f64::from(TILT_LIMIT);
    let mut excess = f64::NEG_INFINITY;
    for (i, (measured, slope)) in measured.iter().zip(slopes).enumerate() {
        let reference = instrument.reference_px.at(i);
        let [x, y] = [0, 1].map(|axis| pixels(measured)[axis] - reference[axis]);
        let gain = instrument.slope_gain_m_per_px.at(i);
        for ([gx, gy], tilt) in gain.into_iter().zip(slope.tilt_ulp) {
            let exact = ((gx * x + gy * y) / ulp_m).clamp(-limit, limit);
            // A mantissa counts whole ulp per pixel, or more of them.
            let mantissa = f64::max(3.06e-5 * largest_gain, 0.5) * (x.abs() + y.abs());
            let reference = (gx.abs() + gy.abs()) / ulp_m / 131_072.0;
            let allowed = 2.0 + mantissa + reference;
            excess = excess.max((f64::from(tilt) - exact).abs() - allowed);
        }
    }
    excess
}

/// Plain instrument whose spots cover the window.
fn slope_instrument(rng: &mut Rng) -> Instrument {
    let mut instrument = Instrument::ideal(Instrument::circle(4, 8).mask, 8);
    let turned = |rng: &mut Rng, scale: f64| {
        let (sin, cos) = rng.uniform(0.0, std::f64::consts::TAU).sin_cos();
        let flip = if rng.below(2) == 0 { 1.0 } else { -1.0 };
        let (x, y) = (scale * rng.uniform(0.5, 1.0), scale * rng.uniform(0.5, 1.0));
        [[x * cos, -flip * y * sin], [x * sin, flip * y * cos]]
    };
    let count = instrument.count();
    let reference = |rng: &mut Rng| [0; 2].map(|_| rng.uniform(-3.0, 3.0));
    instrument.reference_px = Values::Each((0..count).map(|_| reference(rng)).collect());
    let scale = f64::powi(10.0, rng.between(-9, -7));
    let gains = (0..count).map(|_| turned(rng, scale)).collect();
    instrument.slope_gain_m_per_px = Values::Each(gains);
    instrument
}

fn random_centroids(instrument: &Instrument, rng: &mut Rng) -> Vec<Option<[i32; 2]>> {
    let half = (i32::from(instrument.window) - 1) << 15;
    let centroid = |_| Some([0; 2].map(|_: i32| rng.between(-half, half)));
    (0..instrument.count()).map(centroid).collect()
}

/// Reference, rotation, flip and scale, in 60 instruments.
#[test]
fn slopes_are_the_gain_times_the_centroid() {
    let mut rng = Rng::new(21);
    for _ in 0..60 {
        let instrument = slope_instrument(&mut rng);
        let config: Box<Bank> = instrument.config();
        let mut path = Box::new(Path::new());
        for number in 0..20 {
            let centroids = random_centroids(&instrument, &mut rng);
            let frame = frames::steered(&instrument, centroids, 60_000);
            run_frame(&mut path, &config, number, &frame);
            let excess = slope_excess(&instrument, path.measurements(), path.slopes());
            assert!(excess <= 0.0, "{excess} ulp too much");
        }
    }
}

/// With a gain that is a power of two of ulp per pixel nothing but the last rounding, down, is left.
#[test]
fn exact_gains_round_once() {
    let mut rng = Rng::new(22);
    let mut instrument = Instrument::ideal(Instrument::circle(4, 8).mask, 8);
    let gain = f64::from(1 << 14) * instrument.ulp_m();
    instrument.slope_gain_m_per_px = Values::Uniform([[0.0, -gain], [gain, 0.0]]);
    let reference = [stored(0.3, 16), stored(-1.7, 16)];
    instrument.reference_px = Values::Uniform(reference);
    let config: Box<Bank> = instrument.config();
    let mut path = Box::new(Path::new());
    for number in 0..50 {
        let centroids = random_centroids(&instrument, &mut rng);
        let frame = frames::steered(&instrument, centroids, 60_000);
        run_frame(&mut path, &config, number, &frame);
        for (measured, slope) in path.measurements().iter().zip(path.slopes()) {
            let [x, y] = [0, 1].map(|axis| pixels(measured)[axis] - reference[axis]);
            let exact = [-y, x].map(|c| (16384.0 * c).floor());
            assert_eq!(slope.tilt_ulp.map(f64::from), exact);
        }
    }
}

/// A gain of 0.9 um per pixel takes a window's edge beyond half the stroke.
#[test]
fn slopes_saturate_at_half_the_stroke_over_a_segment() {
    let mut rng = Rng::new(23);
    let mut instrument = Instrument::ideal(Instrument::circle(4, 8).mask, 8);
    instrument.slope_gain_m_per_px = Values::Uniform([[0.9e-6, 0.0], [0.0, -0.9e-6]]);
    let config: Box<Bank> = instrument.config();
    let mut path = Box::new(Path::new());
    let mut saturated = [0; 2];
    for number in 0..50 {
        let centroids = random_centroids(&instrument, &mut rng);
        let frame = frames::steered(&instrument, centroids, 60_000);
        run_frame(&mut path, &config, number, &frame);
        let excess = slope_excess(&instrument, path.measurements(), path.slopes());
        assert!(excess <= 0.0, "{excess} ulp too much");
        let tilts = path.slopes().iter().flat_map(|slope| slope.tilt_ulp);
        for tilt in tilts {
            saturated[0] += u32::from(tilt == TILT_LIMIT);
            saturated[1] += u32::from(tilt == -TILT_LIMIT);
        }
    }
    assert!(saturated.iter().all(|&n| n > 100), "{saturated:?}");
}

/// Both limits belong to the valid range.
#[test]
fn flux_limits_are_inclusive() {
    let mut instrument = Instrument::ideal(Instrument::circle(4, 4).mask, 4);
    let each = |offset: f64| (0..12).map(|i| 1000.0 + 100.0 * f64::from(i) + offset).collect();
    instrument.flux_min_adu = Values::Each(each(0.0));
    instrument.flux_max_adu = Values::Each(each(50.0));
    let config: Box<Bank> = instrument.config();
    let mut path = Box::new(Path::new());
    for (number, (offset, valid)) in
        [(-1, false), (0, true), (1, true), (49, true), (50, true), (51, false)].iter().enumerate()
    {
        // One flux a frame is right for one subaperture only.
        for i in 0..12 {
            let flux = (1000 + 100 * i + offset) as u16;
            let frame = frames::steered(&instrument, [Some([1000, -2000]); 12], flux);
            let report = run_frame(&mut path, &config, number as u32, &frame);
            let slopes = path.slopes();
            assert_eq!(slopes[i as usize].valid, *valid, "flux {flux} of subaperture {i}");
            assert_eq!(report.valid, u16::from(*valid));
        }
    }
}

/// The peak is that of the rows next to where the spot was: a spot that jumps is found a frame later,
/// and a hit far from it neither shows nor raises the threshold.
#[test]
fn the_peak_is_looked_for_where_the_spot_was() {
    let mut instrument = Instrument::circle(4, 16);
    instrument.estimator = Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.5 };
    let config: Box<Bank> = instrument.config();
    let mut path = Box::new(Path::new());
    let mut rng = Rng::new(9);
    // Rows 2 to 13 of 16, pixel centres: the rows on either side hold the brightest pixel.
    let spots = |y: i32| -> Vec<Spot> {
        let spot = Spot { centre_q8: [0, y * 256 - 128 * 15], peak_adu: 2000, width_q8: 400 };
        vec![spot; instrument.count()]
    };
    let quiet = Background { level_adu: 100, noise_q8: 0, electrons_per_adu: 0 };
    let mut peaks = Vec::new();
    let mut fluxes = Vec::new();
    for (number, (y, hit)) in
        [(3, false), (3, false), (12, false), (12, false), (12, true)].into_iter().enumerate()
    {
        let mut pixels = frames::frame(&instrument, &spots(y), &quiet, &mut rng);
        if hit {
            // Row 1, column 1 of each window.
            for &[x0, y0] in &instrument.origins {
                pixels[usize::from(y0 + 1) * 64 + usize::from(x0 + 1)] = 4095;
            }
        }
        run_frame(&mut path, &config, number as u32, &pixels);
        let first = path.measurements()[0];
        assert!(path.measurements().iter().all(|m| *m == first));
        peaks.push(first.peak);
        fluxes.push(first.flux);
    }
    // Half a pixel aside in x, 400/256 px wide: 2000 w^4 / (w^2 + 1/4)^2 ADU, less 3 sigma of 0.75.
    let w2 = (400.0f64 / 256.0).powi(2);
    let brightest = 2000.0 * (w2 / (w2 + 0.25)).powi(2) - 2.25;
    let is_brightest = |peak: u16| (f64::from(peak) - brightest).abs() <= 1.5;
    assert!(!is_brightest(peaks[0]) && is_brightest(peaks[1]), "{peaks:?} {brightest}");
    assert!(!is_brightest(peaks[2]) && is_brightest(peaks[3]), "{peaks:?}");
    // The threshold of frame 4 was made by frame 3, that of a next one by frame 4.
    assert!(is_brightest(peaks[4]), "{peaks:?}");
    let pixels = frames::frame(&instrument, &spots(12), &quiet, &mut rng);
    run_frame(&mut path, &config, 5, &pixels);
    assert_eq!(path.measurements()[0].flux, fluxes[4] - (4095 - 102 - excess(peaks[4])));
}

/// Half of the peak above dark, less the threshold of 2 ADU that is taken off anyway.
fn excess(peak: u16) -> u32 {
    u32::from(peak + 2).div_ceil(2) - 2
}
