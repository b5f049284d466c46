//! Centroids of images against exact gradients, with the mirror in the return path or not.

mod common;

use common::json;
use host_sim::atmosphere::Atmosphere;
use host_sim::centroid_study::{CentroidStudy, Estimate, STATES, Sums, jackknife};
use host_sim::instrument::{EstimatorName, Instrument};
use host_sim::optics::splash_image::SplashCamera;
use host_sim::pupil::{Mirror, Pupil};
use std::f64::consts::TAU;

/// A mirror that is one plane of T from centre to edge of a segment along x. Both ways see it alike, and the
/// image stays; without it on the way back the spot moves by the plane's gradient, 2 T a pitch, by the part that
/// is missing there.
#[test]
fn a_plane_moves_the_image_by_what_the_return_path_lacks() {
    let pupil = Pupil::circular(6, 8, 0.5).unwrap();
    let still = Atmosphere::from_screens(Vec::new(), pupil.diameter_m(), 0.0).unwrap();
    let window = 16;
    let mut camera = SplashCamera::new(&pupil, &still, 12e3, 2.0, window).unwrap();
    let tilt = 0.4;
    let segment = |&[x, _]: &[usize; 2]| [2.0 * tilt * x as f64, tilt, 0.0];
    let mirror = Mirror { segments: pupil.subapertures().iter().map(segment).collect() };
    let mut images = vec![0.0; pupil.subapertures().len() * window * window];
    for part in [1.0, 0.5, 0.0] {
        camera.return_through(part);
        camera.expose(&still, 0.0, &mirror, &mut images);
        let pixels_per_rad = 2.0 / TAU;
        let expected = -2.0 * tilt * pixels_per_rad * (1.0 - f64::from(part));
        for image in images.chunks_exact(window * window) {
            let middle = (window as f64 - 1.0) / 2.0;
            let (mut flux, mut moment) = (0.0, 0.0);
            for (k, &light) in image.iter().enumerate() {
                flux += f64::from(light);
                moment += f64::from(light) * ((k % window) as f64 - middle);
            }
            // The window is the image's whole period; what wraps around of the wings is small.
            assert!(
                (moment / flux - expected).abs() < 0.02,
                "{part}: {} {expected}",
                moment / flux
            );
        }
    }
}

/// Over the image's whole period, 16 samples or 32 pixels, the plain centre of gravity is the gradient,
/// whatever the way back looks like; a high threshold is not.
#[test]
fn the_whole_image_has_its_centre_where_the_gradient_says() {
    let description = Instrument::parse(
        "[telescope]\nsamples = 16\n[windows]\nsize = 32\nspacing_px = 32",
        "test",
    )
    .unwrap();
    let named = |name: &str, estimator, peak_fraction| Estimate {
        name: name.to_string(),
        estimator,
        peak_fraction,
    };
    let estimates =
        [named("plain", EstimatorName::Plain, 0.0), named("high", EstimatorName::Thresholded, 0.3)];
    let study = CentroidStudy::new(&description, 4, false, &estimates).unwrap();
    let screens: Vec<Vec<Sums>> = (0..2).map(|k| study.screen(5, k).unwrap()).collect();
    assert_eq!(study.screen(5, 1).unwrap(), screens[1], "a function of its number");
    for (index, state) in STATES.iter().enumerate() {
        let of = |estimate: usize| -> Vec<Sums> {
            screens.iter().map(|screen| screen[2 * index + estimate]).collect()
        };
        let ([plain, high], [exact, _]) = (
            [0, 1].map(|e| jackknife(&of(e), Sums::error_px).0),
            [0, 1].map(|e| jackknife(&of(e), Sums::exact_px).0),
        );
        println!("{}: plain {plain:.4}, high {high:.4}, exact {exact:.4} px", state.name);
        assert_eq!(exact > 1e-3, state.up < 1.0, "{}: {exact}", state.name);
        assert!(plain < 0.035, "{}: {plain}", state.name);
        assert!(high > 2.0 * plain, "{}: {high} {plain}", state.name);
        if state.up < 1.0 {
            let (gain, _) = jackknife(&of(0), Sums::gain);
            assert!((gain - 1.0).abs() < 0.03, "{}: {gain}", state.name);
        }
    }
}

/// What a converged loop leaves of the gradients of Gaussian beams is nothing, as the sensor weighs them alike.
#[test]
fn narrow_beams_are_corrected_as_well() {
    let toml = "[laser]\nlaunch = \"gaussian\"\nlaunch_waist_pitches = 0.3";
    let description = Instrument::parse(toml, "test").unwrap();
    let plain =
        Estimate { name: "plain".into(), estimator: EstimatorName::Plain, peak_fraction: 0.0 };
    let study = CentroidStudy::new(&description, 4, false, &[plain]).unwrap();
    for (state, sums) in STATES.iter().zip(study.screen(5, 0).unwrap()) {
        let exact = sums.exact_px();
        assert_eq!(exact > 1e-3, state.up < 1.0, "{}: {exact}", state.name);
    }
}

#[test]
fn the_command_writes_every_state_and_estimator() {
    let place = tempfile::tempdir().unwrap();
    let arguments = ["--n", "4", "--screens", "2", "--peak-fractions", "0.1", "--out", "out"];
    let result = json("centroids", place.path(), "2", &arguments);
    let points = result["points"].as_array().unwrap();
    // Plain, one threshold, weighted and brightest in five states.
    assert_eq!(points.len(), 4 * 5);
    for point in points {
        let number = |name: &str| point[name].as_f64().unwrap();
        assert!((0.005..0.6).contains(&number("error_px")), "{point}");
        assert!((number("error_rad") / number("error_px") - TAU / 2.0).abs() < 1e-9);
        assert!(number("error_px_se") < number("error_px"), "{point}");
        let open = ["open", "half"].contains(&point["state"].as_str().unwrap());
        assert_eq!(point["gain"].is_number(), open, "{point}");
        assert_eq!(number("invalid"), 0.0);
    }
    for file in ["centroids.csv", "centroids.fits", "centroids-open.svg", "centroids-corrected.svg"]
    {
        assert!(place.path().join("out").join(file).exists(), "{file}");
    }
    assert_eq!(json("centroids", place.path(), "1", &arguments), result, "on any threads");
}
