//! `host-sim power` and `host-sim beam` as a user runs them.

mod common;
#[path = "common/refusal.rs"]
mod refusal;

use common::json;

#[test]
fn power_against_strehl() {
    let place = tempfile::tempdir().unwrap();
    let arguments = ["--n", "4", "--screens", "2", "--powers", "40,400", "--frames", "2"];
    let result = json("power", place.path(), "2", &arguments);
    assert_eq!(result["n"], 4);
    let beacons = result["beacons"].as_array().unwrap();
    assert_eq!((beacons.len(), &beacons[0]["beacon"]), (2, &"rayleigh".into()));
    for beacon in beacons {
        let of = |k: usize, field: &str| beacon["points"][k][field].as_f64().unwrap();
        assert!((of(1, "electrons_per_spot") / of(0, "electrons_per_spot") - 10.0).abs() < 1e-9);
        assert!((0.3..1.0).contains(&of(1, "strehl")), "{beacon}");
        assert!(of(1, "strehl") < beacon["strehl"].as_f64().unwrap() + 0.05);
    }
    // The sodium layer's middle above the telescope; a depth of focus, lambda H^2/(d D).
    assert_eq!(beacons[1]["height_m"], 89_600.0);
    let depth_m = beacons[1]["gate_depth_m"].as_f64().unwrap();
    assert!((depth_m - 589.159e-9 * 89_600.0_f64.powi(2) / (0.5 * 2.0)).abs() < 1e-6);
    let files = place.path().join("target/splash/power");
    let csv = std::fs::read_to_string(files.join("power.csv")).unwrap();
    assert!(csv.starts_with("power_w,rayleigh_electrons,rayleigh_strehl,"), "{csv}");
    assert_eq!(csv.lines().count(), 3);
    assert!(files.join("power.svg").exists() && files.join("power.fits").exists());
    // Again, on one thread and without what was kept.
    std::fs::remove_dir_all(&files).unwrap();
    assert_eq!(json("power", place.path(), "1", &arguments), result);
    // A beacon that is given twice is run once.
    let twice = [&arguments[..], &["--beacons", "sodium,rayleigh,sodium"]].concat();
    let twice = json("power", place.path(), "2", &twice);
    assert_eq!(twice["beacons"], serde_json::json!([beacons[1], beacons[0]]));
    for (wrong, words) in [
        (["--depth", "0"], "--depth = 0: must be from 0.01 to 10 depths of focus"),
        (["--powers", "-1"], "photons.laser_power_w = -1: must be from 0.000001 to 1000000"),
    ] {
        let words = words.replace("0.000001", "1e-6");
        refusal::fails("power", place.path(), &wrong, 2, &[&words]);
    }
}

/// A power at which no spot follows its segment is a result like others, without numbers.
#[test]
fn too_little_power_ends_no_run() {
    let place = tempfile::tempdir().unwrap();
    let arguments = ["--n", "4", "--screens", "2", "--powers", "0.05,400", "--frames", "2"];
    let arguments = [&arguments[..], &["--beacons", "rayleigh"]].concat();
    let result = json("power", place.path(), "2", &arguments);
    let points = &result["beacons"][0]["points"];
    assert!(points[0]["strehl"].is_null() && points[0]["margin"].is_null(), "{points}");
    assert!(points[0]["refused"].as_str().unwrap().starts_with("calibration of subaperture"));
    assert!(points[1]["strehl"].as_f64().unwrap() > 0.3 && points[1]["refused"].is_null());
    assert!(result["beacons"][0]["power_90_w"].is_null());
    let files = place.path().join("target/splash/power");
    let csv = std::fs::read_to_string(files.join("power.csv")).unwrap();
    let first: Vec<&str> = csv.lines().nth(1).unwrap().split(',').collect();
    assert_eq!((first[0], &first[2..]), ("0.05", &["NaN"; 4][..]), "{csv}");
    let figure = std::fs::read_to_string(files.join("power.svg")).unwrap();
    assert!(!figure.contains("NaN") && figure.contains("rayleigh"));
}

#[test]
fn waist_against_strehl() {
    let place = tempfile::tempdir().unwrap();
    let arguments = ["--n", "4", "--screens", "2", "--pitches", "1,2", "--waists", "0.5"];
    let result = json("beam", place.path(), "2", &arguments);
    let points = result["points"].as_array().unwrap();
    assert_eq!(points.len(), 4);
    let of = |k: usize, field: &str| points[k][field].as_f64().unwrap();
    // erf(sqrt(2))^2 = 0.9545^2 of a waist of half a pitch passes.
    assert!((of(1, "transmitted") - 0.954_5_f64.powi(2)).abs() < 1e-4);
    assert!(points[0]["waist_pitches"].is_null());
    assert_eq!((of(0, "transmitted"), of(0, "gain")), (1.0, 0.0));
    // 0.175 rad^2 of fitting error at d = r0, and 2^(5/3) times as much at 2 r0.
    assert!((of(0, "fit") - 0.84).abs() < 0.03, "{}", of(0, "fit"));
    assert!(
        (of(2, "fit") - (-0.175 * 2f64.powf(5.0 / 3.0)).exp()).abs() < 0.06,
        "{}",
        of(2, "fit")
    );
    let files = place.path().join("target/splash/beam");
    assert_eq!(std::fs::read_to_string(files.join("beam.csv")).unwrap().lines().count(), 5);
    assert!(files.join("beam.svg").exists() && files.join("beam.fits").exists());
}
