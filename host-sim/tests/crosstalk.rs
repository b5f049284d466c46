//! Spots on one detector at their places on the sky: where they are, whose light falls where, and the study of it.

mod common;

use common::{json, run};
use host_sim::atmosphere::{Atmosphere, Turbulence};
use host_sim::board::in_process;
use host_sim::imager::Imager;
use host_sim::instrument::Instrument;
use host_sim::optics::geometric::Sensor;
use host_sim::pupil::Mirror;
use host_sim::reconstructor::Reconstructor;

/// Four across with spots `spacing_px` pixels of half a lambda/d apart, under a sodium beacon.
fn sky(spacing_px: f64, rest: &str) -> Instrument {
    // p d^2 / (lambda H) with p = 2.
    let pitch_m = (spacing_px / 2.0 * 589e-9 * 90e3).sqrt();
    let toml = format!(
        "[telescope]\nsubapertures = 4\npitch_m = {pitch_m:?}\npupil = \"square\"\n\
         [atmosphere]\nr0_m = {pitch_m:?}\n[laser]\nwavelength_m = 589e-9\nbeacon_height_m = 90e3\n\
         pulse_rate_hz = 1000\npulses_per_frame = 1\n{rest}"
    );
    Instrument::parse(&toml, "test").unwrap()
}

#[test]
fn windows_are_where_the_spots_are() {
    let instrument = sky(5.4, "[windows]\nlayout = \"sky\"\nsize = 5");
    assert!((instrument.spacing_on_sky_px() - 5.4).abs() < 1e-9);
    // As odd as the window, below 8 samples x 2 pixels.
    assert_eq!(instrument.field_px(), 15);
    // 0, 5.4, 10.8, 16.2 in whole pixels, and half of what the field has more than the window.
    let places = [0u16, 5, 11, 16].map(|place| place + 5);
    let origins = instrument.origins().unwrap();
    assert_eq!(origins[..4], places.map(|x| [x, 5]));
    assert_eq!(origins[15], [21, 21]);
    assert_eq!(instrument.detector_side(), 16 + 15);
    instrument.check().unwrap();
    // 5 pixels is the least distance: 0 to 5 and 11 to 16.
    assert_eq!(instrument.room_on_sky_px().unwrap(), Some(5));
    let relayed = instrument.clone().seen_by(Sensor::Lgs);
    assert_eq!((relayed.detector_side(), relayed.origins().unwrap()[1]), (20, [5, 0]));
}

#[test]
fn windows_of_what_is_lit_together_must_fit() {
    let layout = "[windows]\nlayout = \"sky\"\nsize = 8\n";
    let error = sky(4.0, layout).check().unwrap_err().to_string();
    assert!(error.starts_with("windows.size = 8: must be at most 4, the pixels"), "{error}");
    // Every other column and row: 8 pixels; the firmware takes what the check passes.
    let lit = sky(4.0, &format!("{layout}[schedule]\nlattice = \"2\""));
    lit.check().unwrap();
    in_process(&Reconstructor::new(&lit).unwrap().spec()).unwrap();
    let close = sky(0.5, layout).check().unwrap_err().to_string();
    assert!(close.contains("pixels from spot to spot = 0.5"), "{close}");
    let far = sky(2000.0, layout).check().unwrap_err().to_string();
    assert!(far.contains("detector = 6016: must be at most 4096"), "{far}");
}

/// A noise-free frame of the same sky, electrons, by a detector of `side` pixels.
fn frame(instrument: &Instrument, number: u32) -> (usize, Vec<f64>) {
    let reconstructor = Reconstructor::new(instrument).unwrap();
    let pupil = instrument.pupil().unwrap();
    let (r0_m, layers) = (instrument.atmosphere.r0_m, instrument.layers());
    let sky = Turbulence::new(r0_m, &layers, pupil.diameter_m(), pupil.pitch_m(), 0.01)
        .unwrap()
        .realise(4, &mut |_| ());
    let sensor = Sensor::Splash;
    let mut imager = Imager::new(&reconstructor, sensor, &pupil, &sky).unwrap();
    imager.light(number);
    let mirror = Mirror::flat(pupil.subapertures().len());
    let pixels = imager.expose(&sky, 0.0, &mirror, None).unwrap();
    let detector = &instrument.detector;
    let electrons = |&code: &u16| (f64::from(code) - detector.bias_adu) * detector.gain_e_per_adu;
    (instrument.detector_side(), pixels.iter().map(electrons).collect())
}

/// The frame is the sum of the images that each spot has alone, relayed with a window as large as the field.
#[test]
fn light_of_all_that_is_lit_adds_up() {
    for (schedule, number) in [("", 0), ("[schedule]\nlattice = \"2\"", 3)] {
        let windows = "[windows]\nlayout = \"sky\"\nsize = 4\n";
        let together = sky(4.3, &format!("{windows}{schedule}")).noise_free();
        let alone = sky(4.3, &format!("[windows]\nsize = 16\n{schedule}")).noise_free();
        let (side, found) = frame(&together, number);
        let (wide, images) = frame(&alone, number);
        let mut expected = vec![0.0; side * side];
        for (i, [x, y]) in (0..16).map(|i| (i, [i % 4, i / 4])) {
            let place = |k: usize| (4.3 * k as f64).round() as usize;
            for (column, row) in (0..256).map(|k| (k % 16, k / 16)) {
                let light = images[(16 * y + row) * wide + 16 * x + column];
                expected[(place(y) + row) * side + place(x) + column] += light;
            }
            // Columns and rows of colour 3 of (x mod 2) + 2 (y mod 2) are odd.
            let lit = schedule.is_empty() || (x % 2 == 1 && y % 2 == 1);
            let middle = images[(16 * y + 8) * wide + 16 * x + 8];
            assert_eq!(middle > 50.0, lit, "{i}: {middle}");
        }
        let worst = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // An eighth of an electron of rounding in each of up to 17 numbers.
        assert!(worst < 2.2, "{worst}");
        // Windows hold light of their neighbours: more than any of them has alone.
        let total: f64 = found.iter().sum();
        assert!(total > 9000.0 * if schedule.is_empty() { 16.0 } else { 4.0 }, "{total}");
    }
}

/// Beyond the field of a spot nothing of it is left: at 8 lambda/d both layouts are the same to the bit. Where no
/// window fits, or no calibration is possible, that is said.
#[test]
fn the_study_pairs_with_isolated_spots() {
    let place = tempfile::tempdir().unwrap();
    let arguments =
        ["--n", "4", "--spacing", "8,1.5", "--lattices", "all,2", "--screens", "2", "--out", "out"];
    let result = json("crosstalk", place.path(), "2", &arguments);
    let points = result["points"].as_array().unwrap();
    let field = |i: usize, name: &str| &points[i][name];
    let number = |i: usize, name: &str| field(i, name).as_f64().unwrap();
    assert_eq!(points.len(), 4);
    // 3 pixels are no window; 6 are.
    assert!(field(0, "refused").as_str().unwrap().contains("3 pixels between spots"));
    assert!(field(0, "strehl").is_null());
    assert_eq!((number(1, "window_px"), number(1, "groups")), (6.0, 4.0));
    for i in [2, 3] {
        assert_eq!((number(i, "window_px"), number(i, "spacing_px").round()), (16.0, 16.0));
        assert_eq!((number(i, "difference"), number(i, "difference_se")), (0.0, 0.0));
        assert_eq!(number(i, "open_px"), number(i, "isolated_open_px"));
    }
    for i in 1..4 {
        assert!((0.4..1.0).contains(&number(i, "strehl")), "{result}");
        assert!(number(i, "strehl_se") < 0.2 && number(i, "corrected_px") < 0.5, "{result}");
    }
    // Neighbours' light makes slopes worse.
    assert!(number(1, "open_px") > number(1, "isolated_open_px"), "{result}");
    for file in ["crosstalk.csv", "crosstalk.fits", "crosstalk.svg"] {
        assert!(place.path().join("out").join(file).exists(), "{file}");
    }
    let again = json("crosstalk", place.path(), "1", &arguments);
    assert_eq!(again, result, "on any number of threads");
    let refused = run("crosstalk", place.path(), "1", &["--spacing", "0"]);
    assert_eq!(refused.status.code(), Some(2));
}

/// Still air: without turbulence every spot is the diffraction pattern of its subaperture's square, whose light
/// within the field is that of a square of F / p lambda/d.
#[test]
fn still_air_has_the_pattern_of_a_square() {
    let instrument = sky(16.0, "[windows]\nlayout = \"sky\"").noise_free();
    let reconstructor = Reconstructor::new(&instrument).unwrap();
    let pupil = instrument.pupil().unwrap();
    let still = Atmosphere::from_screens(Vec::new(), pupil.diameter_m(), 0.0).unwrap();
    let mut imager = Imager::new(&reconstructor, Sensor::Splash, &pupil, &still).unwrap();
    let mirror = Mirror::flat(16);
    let pixels = imager.expose(&still, 0.0, &mirror, None).unwrap();
    let detector = &instrument.detector;
    let total: f64 = pixels
        .iter()
        .map(|&code| (f64::from(code) - detector.bias_adu) * detector.gain_e_per_adu)
        .sum();
    // The period of the sampled pupil's image is the field: all light is in it, but for rounding.
    let expected = 16.0 * instrument.laser.electrons_per_spot;
    assert!((total / expected - 1.0).abs() < 0.01, "{total} {expected}");
}
