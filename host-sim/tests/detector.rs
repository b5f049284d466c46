//! The detector against its equations.

use host_sim::detector::{BadPixel, Detector, DetectorError, DetectorSpec, PixelFault, place};

fn spec() -> DetectorSpec {
    DetectorSpec { width: 96, height: 64, ..DetectorSpec::default() }
}

fn uniform(detector: &Detector, level: f32) -> Vec<f32> {
    vec![level; detector.spec().width * detector.spec().height]
}

fn read(detector: &Detector, expected: &[f32], frame: u64, seed: u64) -> Vec<u16> {
    let mut out = vec![0; expected.len()];
    detector.read(expected, frame, seed, &mut out).unwrap();
    out
}

/// Mean and variance of all codes of `frames` frames, and their number.
fn statistics(detector: &Detector, level: f32, frames: u64) -> (f64, f64, f64) {
    let expected = uniform(detector, level);
    let codes: Vec<f64> =
        (0..frames).flat_map(|frame| read(detector, &expected, frame, 5)).map(f64::from).collect();
    let count = codes.len() as f64;
    let mean = codes.iter().sum::<f64>() / count;
    let variance = codes.iter().map(|code| (code - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, variance, count)
}

#[test]
fn photon_transfer_curve() {
    let detector =
        Detector::new(DetectorSpec { bits: 16, dark_e_per_frame: 2.5, ..spec() }).unwrap();
    let DetectorSpec { gain_e_per_adu: gain, read_noise_e: noise, bias_adu: bias, .. } =
        *detector.spec();
    for level in [0.0, 0.06, 0.7, 5.0, 31.3, 120.0, 126.0, 900.0, 12_000.0] {
        let (mean, variance, count) = statistics(&detector, level, 40);
        let charge = f64::from(level) + 2.5;
        let expected_variance = (charge + noise * noise) / (gain * gain) + 1.0 / 12.0;
        let mean_error = (mean - charge / gain - bias) / (variance / count).sqrt();
        assert!(mean_error.abs() < 4.5, "{level} e-: mean {mean}, {mean_error} sigma off");
        // Fourth moment of Poisson + Gaussian: 3 variance^2 + mean.
        let spread = ((2.0 + 1.0 / charge) / count).sqrt() * expected_variance;
        let variance_error = (variance - expected_variance) / spread;
        assert!(variance_error.abs() < 4.5, "{level} e-: {variance} {expected_variance}");
    }
}

/// Ten million codes of a detector that counts electrons, against exp(-m) m^k / k! by Pearson's test, and
/// their mean and variance, at means on both sides of where the way of drawing changes.
#[test]
fn counts_follow_the_poisson_distribution() {
    let counting = DetectorSpec {
        width: 1000,
        height: 1000,
        bits: 16,
        gain_e_per_adu: 1.0,
        read_noise_e: 0.0,
        bias_adu: 0.0,
        full_well_e: 1e6,
        ..spec()
    };
    let detector = Detector::new(counting).unwrap();
    for mean in [0.003, 0.05, 0.9, 3.99, 27.77, 127.99, 300.0, 4095.0, 4097.0] {
        let (expected, draws) = (uniform(&detector, mean), 1e7);
        let mean = f64::from(mean);
        let mut seen = vec![0_u32; 5000];
        for frame in 0..10 {
            for code in read(&detector, &expected, frame, 8) {
                seen[usize::from(code)] += 1;
            }
        }
        let (mut chi2, mut bins, mut total, mut square) = (0.0, 0.0_f64, 0.0, 0.0);
        for (count, &seen) in seen.iter().enumerate() {
            let (seen, count) = (f64::from(seen), count as f64);
            total += seen * count;
            square += seen * (count - mean).powi(2);
            let ln_probability = count * mean.ln() - mean - libm::lgamma(count + 1.0);
            let expected = draws * ln_probability.exp();
            if expected > 20.0 {
                chi2 += (seen - expected).powi(2) / expected;
                bins += 1.0;
            }
        }
        assert!(chi2 < bins + 4.5 * (2.0 * bins).sqrt() + 5.0, "mean {mean}: {chi2} on {bins}");
        let error = total / draws - mean;
        assert!(error.abs() <= 4.5 * (mean / draws).sqrt(), "mean {mean}: {error:e} off");
        // Fourth moment about the mean: m + 3 m^2.
        let error = square / draws - mean;
        let sigma = ((mean + 2.0 * mean * mean) / draws).sqrt();
        assert!(error.abs() <= 4.5 * sigma, "mean {mean}: variance {error:e} off");
    }
}

#[test]
fn no_light_is_no_charge() {
    let dark = Detector::new(DetectorSpec { read_noise_e: 0.0, ..spec() }).unwrap();
    for level in [0.0, -3.0, f32::NAN, f32::NEG_INFINITY] {
        assert!(read(&dark, &uniform(&dark, level), 0, 0).iter().all(|&code| code == 64));
    }
    // Infinite light on a blind pixel.
    let blind = vec![BadPixel { x: 1, y: 0, kind: PixelFault::Dead }];
    let spec = DetectorSpec { bad_pixels: blind, ..dark.spec().clone() };
    let detector = Detector::new(spec).unwrap();
    assert_eq!(read(&detector, &uniform(&detector, f32::INFINITY), 0, 0)[1], 64);
}

#[test]
fn charge_saturates_at_the_full_well_and_codes_at_the_top() {
    let quiet = DetectorSpec { read_noise_e: 0.0, ..spec() };
    let well =
        Detector::new(DetectorSpec { full_well_e: 8000.0, bits: 14, ..quiet.clone() }).unwrap();
    let codes = read(&well, &uniform(&well, 1e5), 0, 0);
    assert!(codes.iter().all(|&code| code == 64 + 2000));

    for bits in 8..=16 {
        let detector =
            Detector::new(DetectorSpec { bits, full_well_e: 1e9, ..quiet.clone() }).unwrap();
        for level in [1e8, f32::INFINITY] {
            let codes = read(&detector, &uniform(&detector, level), 0, 0);
            assert!(codes.iter().all(|&code| u32::from(code) == (1 << bits) - 1));
        }
    }
    // Noise below zero clips at zero instead of wrapping.
    let dark = Detector::new(DetectorSpec { bias_adu: 0.0, ..spec() }).unwrap();
    assert!(read(&dark, &uniform(&dark, 0.0), 0, 0).iter().all(|&code| code < 100));
}

#[test]
fn bad_pixels_and_response() {
    let detector = Detector::new(DetectorSpec {
        bad_pixels: vec![
            BadPixel { x: 3, y: 2, kind: PixelFault::Hot },
            BadPixel { x: 95, y: 63, kind: PixelFault::Dead },
        ],
        response_rms: 0.05,
        response_seed: 9,
        ..spec()
    })
    .unwrap();
    let (hot, dead) = (2 * 96 + 3, 63 * 96 + 95);
    let bright = read(&detector, &uniform(&detector, 4000.0), 0, 0);
    let blind = read(&detector, &uniform(&detector, 0.0), 0, 0);
    assert!(bright[hot] == 4095 && blind[hot] == 4095);
    assert!((50..80).contains(&bright[dead]) && (50..80).contains(&blind[dead]));

    let calibration = detector.calibration();
    assert_eq!(calibration.bad_pixels, [[3, 2], [95, 63]]);
    assert_eq!((calibration.dark_adu[hot], calibration.dark_adu[dead]), (4095.0, 64.0));
    assert_eq!((calibration.flat[hot], calibration.flat[dead]), (0.0, 0.0));

    // The flat is what the codes show: compare over 200 noisy frames.
    let expected = uniform(&detector, 4000.0);
    let mut sum = vec![0.0_f64; expected.len()];
    for frame in 0..200 {
        for (sum, code) in sum.iter_mut().zip(read(&detector, &expected, frame, 1)) {
            *sum += f64::from(code);
        }
    }
    let sigma = (4000.0_f64 / 16.0 / 200.0).sqrt() / 1000.0;
    for (index, sum) in sum.iter().enumerate().filter(|(index, _)| ![hot, dead].contains(index)) {
        let flat = (sum / 200.0 - f64::from(calibration.dark_adu[index])) / 1000.0;
        let error = (flat - f64::from(calibration.flat[index])) / sigma;
        assert!(error.abs() < 5.5, "pixel {index}: {error} sigma");
    }
    let mean = calibration.flat.iter().map(|&r| f64::from(r)).sum::<f64>() / sum.len() as f64;
    assert!((mean - 1.0).abs() < 0.004);
}

#[test]
fn calibration_predicts_dark_frames() {
    let detector = Detector::new(DetectorSpec { dark_e_per_frame: 40.0, ..spec() }).unwrap();
    let calibration = detector.calibration();
    let (mean, variance, count) = statistics(&detector, 0.0, 40);
    let sigma = f64::from(calibration.sigma_adu[0]);
    assert!((mean - f64::from(calibration.dark_adu[0])).abs() < 4.5 * sigma / count.sqrt());
    assert!((variance.sqrt() / sigma - 1.0).abs() < 0.01);
}

#[test]
fn frames_depend_on_seed_and_number_only() {
    let detector = Detector::new(spec()).unwrap();
    let expected = uniform(&detector, 30.0);
    let reference = read(&detector, &expected, 7, 3);
    for threads in [1, 2, 3, 8] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| read(&detector, &expected, 7, 3)), reference);
    }
    assert_ne!(read(&detector, &expected, 8, 3), reference);
    assert_ne!(read(&detector, &expected, 7, 4), reference);
    // No row repeats another one: streams are told apart.
    let rows: std::collections::HashSet<&[u16]> = reference.chunks(96).collect();
    assert_eq!(rows.len(), 64);
}

#[test]
fn noise_free_frames_are_exact() {
    let detector = Detector::new(DetectorSpec { dark_e_per_frame: 1.0, ..spec() }).unwrap();
    let mut expected = uniform(&detector, 0.0);
    // (e- + 1) / 4 + 64, nearest with ties up, clipped at 4095.
    let cases = [(0.0, 64), (0.9, 64), (1.0, 65), (4.75, 65), (99.0, 89), (-5.0, 64), (1e9, 4095)];
    for (expected, (level, _)) in expected.iter_mut().zip(cases) {
        *expected = level;
    }
    expected[7] = f32::NAN;
    let mut out = vec![0; expected.len()];
    detector.read_noise_free(&expected, &mut out).unwrap();
    for (code, (level, wanted)) in out.iter().zip(cases) {
        assert_eq!(*code, wanted, "{level} e-");
    }
    assert_eq!(out[7], 64);
}

#[test]
fn windows_add_up_where_they_belong() {
    let images: Vec<f32> = (0..8).map(|i| i as f32).collect();
    let mut expected = vec![1.0; 5 * 3];
    place(&images, 10.0, &[[0, 0], [1, 1]], 2, 5, &mut expected).unwrap();
    #[rustfmt::skip]
    let wanted = [
        1.0, 11.0, 1.0, 1.0, 1.0,
        21.0, 71.0, 51.0, 1.0, 1.0,
        1.0, 61.0, 71.0, 1.0, 1.0,
    ];
    assert_eq!(expected, wanted);

    let before = expected.clone();
    for origin in [[4, 0], [0, 2], [usize::MAX, 0]] {
        let error = place(&images, 1.0, &[[0, 0], origin], 2, 5, &mut expected).unwrap_err();
        assert!(matches!(error, DetectorError::Window { spot: 1, .. }), "{error}");
    }
    for (images, width) in [(&images[..7], 5), (&images[..], 4), (&images[..], 0)] {
        let error = place(images, 1.0, &[[0, 0], [1, 1]], 2, width, &mut expected).unwrap_err();
        assert!(matches!(error, DetectorError::Size { .. }), "{error}");
    }
    assert_eq!(expected, before);
}

#[test]
fn wrong_specifications_are_named() {
    let good = DetectorSpec::default();
    let cases = [
        (DetectorSpec { width: 0, ..good.clone() }, "width = 0, must be from 1 to 8192"),
        (DetectorSpec { height: 9000, ..good.clone() }, "height = 9000, must be from 1 to 8192"),
        (DetectorSpec { bits: 17, ..good.clone() }, "bits = 17, must be from 8 to 16"),
        (
            DetectorSpec { gain_e_per_adu: 0.0, ..good.clone() },
            "gain_e_per_adu = 0, must be finite and above 0",
        ),
        (
            DetectorSpec { read_noise_e: f64::NAN, ..good.clone() },
            "read_noise_e = NaN, must be finite and at least 0",
        ),
        (
            DetectorSpec { dark_e_per_frame: -1.0, ..good.clone() },
            "dark_e_per_frame = -1, must be finite and at least 0",
        ),
        (
            DetectorSpec { bias_adu: 4096.0, ..good.clone() },
            "bias_adu = 4096, must be from 0 to 4095",
        ),
        (
            DetectorSpec { full_well_e: f64::INFINITY, ..good.clone() },
            "full_well_e = inf, must be finite and above 0",
        ),
        (
            DetectorSpec { response_rms: 0.3, ..good.clone() },
            "response_rms = 0.3, must be from 0 to 0.25",
        ),
        (
            DetectorSpec {
                bad_pixels: vec![BadPixel { x: 128, y: 0, kind: PixelFault::Dead }],
                ..good.clone()
            },
            "bad pixel (128, 0) is outside the 128 x 128 frame",
        ),
    ];
    for (spec, message) in cases {
        assert_eq!(Detector::new(spec).unwrap_err().to_string(), format!("detector: {message}"));
    }
    let detector = Detector::new(good).unwrap();
    let error = detector.read(&[0.0; 5], 0, 0, &mut [0; 5]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "detector: expected photo-electrons has 5 elements, expected 16384"
    );
}
