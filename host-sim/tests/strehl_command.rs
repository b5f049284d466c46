//! `host-sim strehl` as a user meets it.

mod common;
#[path = "common/refusal.rs"]
mod refusal;

use host_sim::files::csv::Series;
use host_sim::files::fits::FitsReader;
use host_sim::monte_carlo::statistics::Mean;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::Duration;
use tempfile::TempDir;

const COMMAND: &str = "strehl";

fn json(place: &Path, threads: &str, arguments: &[&str]) -> Value {
    common::json(COMMAND, place, threads, arguments)
}

/// One that goes on, in silence.
fn started(place: &Path, arguments: &[&str]) -> Child {
    let mut program = common::program(COMMAND, place, "1", arguments);
    program.stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap()
}

fn refused(place: &Path, arguments: &[&str], words: &[&str]) {
    refusal::fails(COMMAND, place, arguments, 2, words);
}

/// The one file in which the screens of an N are kept.
fn kept(out: &Path, n: usize) -> PathBuf {
    let files = std::fs::read_dir(out.join("screens")).unwrap().map(|entry| entry.unwrap().path());
    let prefix = format!("n{n}-");
    let ours = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().starts_with(&prefix);
    let files: Vec<_> = files.filter(ours).collect();
    assert_eq!(files.len(), 1, "{files:?}");
    files[0].clone()
}

fn point<'a>(result: &'a Value, n: u64, sensor: &str) -> &'a Value {
    let points = result["points"].as_array().unwrap();
    points.iter().find(|p| p["n"] == n && p["sensor"] == sensor).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// By theory 0.29 rad^2 are left beyond the fitting error at N = 6 by one gate, and 0.14 by two.
#[test]
fn a_second_gate_helps_splash_and_leaves_guide_stars_as_they_are() {
    let place = TempDir::new().unwrap();
    std::fs::write(place.path().join("two.toml"), "[second_gate]\nheight_m = 6000.0").unwrap();
    let usual = ["--n", "6", "--screens", "6", "--sensors", "splash,lgs"];
    let one = json(place.path(), "2", &[&usual[..], &["--out", "one"]].concat());
    let with = [&usual[..], &["--config", "two.toml", "--out", "two"]].concat();
    let two = json(place.path(), "2", &with);
    assert_eq!(point(&one, 6, "lgs"), point(&two, 6, "lgs"));
    let variances = |out: &str| -> Vec<f64> {
        let lines = std::fs::read_to_string(kept(&place.path().join(out), 6)).unwrap();
        let splash = |line: &str| match line.split(',').collect::<Vec<_>>()[..] {
            [screen, "splash", _, rad2] => Some((screen.parse().unwrap(), rad2.parse().unwrap())),
            _ => None,
        };
        lines.lines().filter_map(splash).collect::<BTreeMap<u32, f64>>().into_values().collect()
    };
    let Mean { mean, standard_error } = Mean::of_differences(&variances("one"), &variances("two"));
    assert!(mean > 3.0 * standard_error && mean > 0.05, "{mean} +- {standard_error}");
    for arguments in [&["--budget"][..], &["--sensing", "geometric"]] {
        let arguments = [&with[..], arguments].concat();
        refused(place.path(), &arguments, &["second_gate.height_m = 6000: must be 0 here"]);
    }
}

#[test]
fn results_do_not_depend_on_threads_or_interruptions() {
    let place = TempDir::new().unwrap();
    let at = |name: &str| place.path().join(name);
    for more in [&["--n", "4,6", "--static"][..], &["--n", "4", "--wind", "0.1", "--frames", "9"]] {
        let run = |out: &str, threads: &str, screens: &str, sensors: &str| {
            let sensors = ["--screens", screens, "--sensors", sensors, "--out", out];
            json(place.path(), threads, &[more, &sensors].concat())
        };
        let all = "splash,lgs,ngs,fit";
        let whole = run("whole", "2", "4", all);
        // First a part, then the same cut in the middle of a line, then all, with another thread count.
        run("parts", "1", "2", "lgs,fit");
        run("parts", "2", "3", all);
        let file = kept(&at("parts"), 4);
        let text = std::fs::read_to_string(&file).unwrap();
        std::fs::write(&file, &text[..text.len() - 5]).unwrap();
        assert_eq!(run("parts", "1", "4", all), whole);
        // Now everything is there: nothing is run, and the file stays as it is.
        let before = std::fs::read_to_string(&file).unwrap();
        assert_eq!(before.lines().count(), 16);
        assert_eq!(run("parts", "2", "4", all), whole);
        assert_eq!(std::fs::read_to_string(&file).unwrap(), before);
        for name in ["whole", "parts"] {
            std::fs::remove_dir_all(at(name)).unwrap();
        }
    }
}

#[test]
fn a_run_that_is_killed_takes_up_where_it_was() {
    let place = TempDir::new().unwrap();
    let run = ["--n", "8", "--screens", "30", "--sensing", "geometric"];
    let mut child = started(place.path(), &[&run[..], &["--out", "killed"]].concat());
    let screens = place.path().join("killed/screens");
    let lines = || -> usize {
        let files = std::fs::read_dir(&screens).into_iter().flatten();
        let text = files.map(|file| std::fs::read_to_string(file.unwrap().path()).unwrap());
        text.map(|text| text.lines().count()).sum()
    };
    while lines() < 8 {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it was killed");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!((8..120).contains(&lines()), "{} of 120 outcomes at the kill", lines());
    let resumed = json(place.path(), "2", &[&run[..], &["--out", "killed"]].concat());
    assert_eq!(resumed, json(place.path(), "2", &[&run[..], &["--out", "whole"]].concat()));
    // Nothing was run twice.
    assert_eq!(lines(), 120);
}

#[test]
fn numbers_files_and_pictures_agree() {
    let place = TempDir::new().unwrap();
    let run = ["--n", "6,4", "--screens", "3", "--sensing", "geometric", "--seed", "5"];
    let result = json(place.path(), "2", &run);
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&result), ["paired", "points"]);
    assert_eq!(
        keys(&result["points"][0]),
        ["n", "screens", "sensor", "strehl", "strehl_se", "variance_rad2"]
    );
    assert_eq!(keys(&result["paired"][0]), ["a", "b", "difference", "n", "se"]);
    assert_eq!(result["points"].as_array().unwrap().len(), 8);
    assert_eq!(result["paired"].as_array().unwrap().len(), 12);

    let out = place.path().join("target/splash/strehl");
    let (shape, strehl) =
        FitsReader::open(out.join("strehl.fits")).unwrap().image::<f64>(0).unwrap();
    assert_eq!(shape, [3, 4, 2]);
    // Of N = 4, SPLASH and LGS, from the screens.
    let (splash, lgs) = (&strehl[..3], &strehl[3..6]);
    let mean = splash.iter().sum::<f64>() / 3.0;
    let square = splash.iter().map(|s| (s - mean).powi(2)).sum::<f64>();
    let found = point(&result, 4, "splash");
    assert!((number(&found["strehl"]) - mean).abs() < 1e-12);
    assert!((number(&found["strehl_se"]) - (square / 2.0 / 3.0).sqrt()).abs() < 1e-12);
    let pair = &result["paired"][0];
    assert_eq!((&pair["n"], &pair["a"], &pair["b"]), (&4.into(), &"splash".into(), &"lgs".into()));
    let difference = splash.iter().zip(lgs).map(|(a, b)| a - b).sum::<f64>() / 3.0;
    assert!((number(&pair["difference"]) - difference).abs() < 1e-12);

    let csv = Series::read(out.join("strehl.csv")).unwrap();
    assert_eq!(csv.column("n").unwrap(), [4.0, 6.0]);
    assert!((csv.column("splash").unwrap()[0] - mean).abs() < 1e-12);
    let screens = Series::read(out.join("screens.csv")).unwrap();
    assert_eq!(screens.column("splash").unwrap()[..3], *splash);
    let paired = Series::read(out.join("paired.csv")).unwrap();
    assert!((paired.column("splash_minus_lgs").unwrap()[0] - difference).abs() < 1e-12);
    let picture = std::fs::read_to_string(out.join("strehl.svg")).unwrap();
    let picture = roxmltree::Document::parse(&picture).unwrap();
    let texts: Vec<_> =
        picture.descendants().filter_map(|node| node.text().map(str::trim)).collect();
    for word in ["SPLASH", "LGS", "NGS", "fit", "D / r0"] {
        assert!(texts.contains(&word), "{word} in {texts:?}");
    }
}

/// A single screen has no scatter; other conditions never reuse its file.
#[test]
fn one_screen_and_other_conditions() {
    let place = TempDir::new().unwrap();
    let run = ["--n", "4", "--screens", "1", "--sensing", "geometric", "--sensors", "ngs"];
    let one = json(place.path(), "1", &run);
    assert!(one["points"][0]["strehl_se"].is_null());
    assert_eq!(one["paired"].as_array().unwrap().len(), 0);
    let mut seen = vec![number(&one["points"][0]["strehl"])];
    for more in [["--seed", "2"], ["--gain", "0.2"], ["--wind", "0.3"], ["--frames", "3"]] {
        let other = json(place.path(), "1", &[&run[..], &more].concat());
        seen.push(number(&other["points"][0]["strehl"]));
    }
    // A frozen, converged loop is the same after a few frames more or less.
    assert!((seen[0] - seen[4]).abs() < 1e-3 && (seen[0] - seen[2]).abs() < 0.02, "{seen:?}");
    assert!((seen[0] - seen[1]).abs() > 1e-4 && (seen[0] - seen[3]).abs() > 1e-4, "{seen:?}");
    let files = std::fs::read_dir(place.path().join("target/splash/strehl/screens")).unwrap();
    assert_eq!(files.count(), 5);
}

/// Gradients reach pupils that the firmware does not: the fitting error stays that of d = r0.
#[test]
fn gradients_go_beyond_the_firmware() {
    let place = TempDir::new().unwrap();
    let run = ["--n", "44", "--screens", "1", "--sensing", "geometric", "--sensors", "ngs,fit"];
    let result = json(place.path(), "2", &[&run[..], &["--frames", "1"]].concat());
    let fit = number(&point(&result, 44, "fit")["variance_rad2"]);
    let ngs = number(&point(&result, 44, "ngs")["variance_rad2"]);
    // 1500 segments: the error of one sky is that of the ensemble.
    assert!((fit - 0.1704).abs() < 0.01, "{fit}");
    assert!(ngs > fit && ngs < 3.0 * fit, "{ngs} {fit}");
}

#[test]
fn what_cannot_be_is_refused_before_it_starts() {
    let place = TempDir::new().unwrap();
    let at = place.path();
    refused(at, &["--n", "41"], &["--n = 41", "40", "128"]);
    refused(at, &["--n", "129", "--sensing", "geometric"], &["--n = 129"]);
    refused(at, &["--n", "3"], &["--n = 3"]);
    refused(at, &["--screens", "0"], &["--screens", "1..="]);
    refused(at, &["--wind", "-1"], &["--wind = -1", "10"]);
    refused(at, &["--static", "--wind", "1"], &["--static", "--wind"]);
    refused(at, &["--gain", "2"], &["control.gain = 2"]);
    refused(at, &["--sensors", "lidar"], &["lidar", "splash"]);
    refused(at, &["--n", "40", "--screens", "10000000"], &["days", "GB", "--long", "--screens"]);
    refused(
        at,
        &["--n", "16", "--screens", "1000000", "--budget", "--sensors", "splash"],
        &["days"],
    );
    let layer = "[[atmosphere.layers]]\nweight = 1\nheight_m = 1\nwind_speed_m_per_s = 0\n\
                 wind_direction_deg = 0\n";
    std::fs::write(at.join("deep.toml"), layer.repeat(1000)).unwrap();
    let deep = ["--n", "128", "--sensing", "geometric", "--screens", "2", "--config", "deep.toml"];
    refused(at, &deep, &["GB", "available", "--n"]);
}

/// Terms add up to the run, in JSON, CSV and FITS; what is there already is not run again.
#[test]
fn the_error_budget_adds_up() {
    let place = TempDir::new().unwrap();
    let run = ["--n", "4,6", "--screens", "4", "--sensing", "geometric", "--out", "b"];
    let plain = json(place.path(), "2", &run);
    let lines = |n| std::fs::read_to_string(kept(&place.path().join("b"), n)).unwrap();
    let before = lines(4);
    let with_budget = [&run[..], &["--budget"]].concat();
    let result = json(place.path(), "2", &with_budget);
    assert_eq!((&result["points"], &result["paired"]), (&plain["points"], &plain["paired"]));
    let grown = lines(4);
    assert!(grown.starts_with(&before) && grown.len() > before.len());
    assert_eq!(json(place.path(), "1", &with_budget), result);
    assert_eq!(lines(4), grown);

    let budgets = result["budget"].as_array().unwrap();
    assert_eq!(budgets.len(), 6);
    let csv = Series::read(place.path().join("b/budget.csv")).unwrap();
    let (shape, terms) =
        FitsReader::open(place.path().join("b/budget.fits")).unwrap().image::<f64>(0).unwrap();
    assert_eq!(shape, [9, 3, 2]);
    let expected: [(&str, &[&str]); 3] = [
        ("splash", &["fitting", "aliasing", "cone", "lever_arm", "return_path", "temporal"]),
        ("lgs", &["fitting", "aliasing", "cone", "lever_arm", "temporal"]),
        ("ngs", &["fitting", "aliasing", "temporal"]),
    ];
    for (index, budget) in budgets.iter().enumerate() {
        let (sensor, names) = expected[index % 3];
        let n = [4, 6][index / 3];
        assert_eq!((&budget["n"], &budget["sensor"]), (&n.into(), &sensor.into()));
        let found = budget["terms"].as_array().unwrap();
        assert_eq!(found.iter().map(|term| &term["term"]).collect::<Vec<_>>(), names);
        let values: Vec<f64> = found.iter().map(|term| number(&term["variance_rad2"])).collect();
        let variance = number(&point(&result, n, sensor)["variance_rad2"]);
        let fit = number(&point(&result, n, "fit")["variance_rad2"]);
        assert!((values.iter().sum::<f64>() - variance).abs() < 1e-12);
        assert!((number(&budget["sum_rad2"]) - variance).abs() < 1e-12);
        assert!((number(&budget["run_rad2"]) - variance).abs() < 1e-12);
        assert!((values[0] - fit).abs() < 1e-12, "{budget}");
        // Nothing moves, and the loop had 40 frames.
        assert!(values.last().unwrap().abs() < 1e-9, "{budget}");
        let in_fits = &terms[9 * index..][..9];
        let finite: Vec<f64> = in_fits.iter().copied().filter(|term| term.is_finite()).collect();
        assert_eq!(finite, values);
        for (name, value) in names.iter().zip(&values) {
            let column = csv.column(&format!("{sensor}_{name}_rad2")).unwrap();
            assert_eq!(column[index / 3], *value);
        }
    }
    let picture = std::fs::read_to_string(place.path().join("b/budget.svg")).unwrap();
    let picture = roxmltree::Document::parse(&picture).unwrap();
    let texts: Vec<_> =
        picture.descendants().filter_map(|node| node.text().map(str::trim)).collect();
    for word in ["lever arm", "return path", "fitting", "total", "D / r0"] {
        assert!(texts.contains(&word), "{word} in {texts:?}");
    }
    assert!(!texts.contains(&"noise") && !texts.contains(&"images"), "{texts:?}");
}

/// Wind, images and noise have their terms.
#[test]
fn a_noisy_run_has_all_terms() {
    let place = TempDir::new().unwrap();
    let run = ["--n", "4", "--screens", "2", "--noise", "--wind", "0.2", "--frames", "10"];
    let result =
        json(place.path(), "2", &[&run[..], &["--budget", "--sensors", "splash"]].concat());
    let budget = &result["budget"][0];
    let terms = budget["terms"].as_array().unwrap();
    assert_eq!(terms.len(), 9);
    let variance = number(&result["points"][0]["variance_rad2"]);
    assert!((number(&budget["sum_rad2"]) - variance).abs() < 1e-12);
    let term = |name: &str| {
        number(&terms.iter().find(|term| term["term"] == name).unwrap()["variance_rad2"])
    };
    // A fifth of a subaperture a frame, and 10^4 electrons a spot.
    assert!(term("temporal") > 0.01 && term("noise").abs() > 1e-6, "{budget}");
    // A DAC step is 8 um / 2^16, 0.0014 rad; sweeps that end leave more.
    assert!(term("quantisation").abs() < 0.01, "{budget}");
}

/// A directory belongs to one process at a time, and the other is told which.
#[test]
fn two_processes_do_not_share_a_directory() {
    let place = TempDir::new().unwrap();
    let run = ["--n", "16", "--screens", "100", "--sensing", "geometric", "--out", "one"];
    let mut first = started(place.path(), &run);
    let holder = format!("host-sim strehl, process {}", first.id());
    let lock = place.path().join("one/.lock");
    while std::fs::read_to_string(&lock).unwrap_or_default() != holder {
        assert!(first.try_wait().unwrap().is_none(), "it ended too soon");
        std::thread::sleep(Duration::from_millis(5));
    }
    let small = ["--n", "4", "--screens", "1", "--sensing", "geometric"];
    refused(place.path(), &[&small[..], &["--out", "one"]].concat(), &["in use", &holder, "--out"]);
    json(place.path(), "1", &[&small[..], &["--out", "other"]].concat());
    first.kill().unwrap();
    first.wait().unwrap();
    json(place.path(), "1", &[&small[..], &["--out", "one"]].concat());
}
