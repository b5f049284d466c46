//! Runs in parts, and `host-sim merge`, as a user meets them.

mod common;
#[path = "common/refusal.rs"]
mod refusal;

use host_sim::files::csv::Series;
use refusal::fails;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use tempfile::TempDir;

/// `host-sim strehl` of `arguments`, with its JSON.
fn strehl(place: &Path, threads: &str, arguments: &[&str]) -> Value {
    common::json("strehl", place, threads, arguments)
}

/// A part of it, in the directory of that name.
fn part(place: &Path, shard: &str, out: &str, arguments: &[&str]) -> Value {
    strehl(place, "1", &[arguments, &["--shard", shard, "--out", out]].concat())
}

/// All files of a run but its lock, and its screens as sets of lines: they come in any order.
fn contents(directory: &Path) -> BTreeMap<String, Vec<u8>> {
    let read = |path: &Path| -> Vec<_> {
        let entries = std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap());
        let files = entries.filter(|entry| entry.file_type().unwrap().is_file());
        files.map(|file| (file.file_name().into_string().unwrap(), file.path())).collect()
    };
    let mut contents = BTreeMap::new();
    for (name, path) in read(directory) {
        if name != ".lock" {
            contents.insert(name, std::fs::read(path).unwrap());
        }
    }
    for (name, path) in read(&directory.join("screens")) {
        let text = std::fs::read_to_string(path).unwrap();
        let mut lines: Vec<&str> = text.lines().collect();
        lines.sort_unstable();
        contents.insert(name, lines.join("\n").into());
    }
    contents
}

#[test]
fn any_split_gives_the_same_to_the_last_bit() {
    let place = TempDir::new().unwrap();
    let at = place.path();
    let gradients =
        ["--n", "6,4", "--screens", "5", "--sensing", "geometric", "--frames", "2", "--budget"];
    let noisy = ["--n", "4", "--screens", "3", "--wind", "0.2", "--noise", "--frames", "2"];
    for (run, splits) in [(&gradients[..], &[1, 2, 3, 7][..]), (&noisy[..], &[2])] {
        let whole = strehl(at, "2", &[run, &["--out", "whole"]].concat());
        let expected = contents(&at.join("whole"));
        assert!(expected.contains_key("strehl.fits") && expected.contains_key("settings.toml"));
        for &count in splits {
            let names: Vec<String> = (1..=count).map(|k| format!("part{k}")).collect();
            let mut ran = 0;
            for (k, name) in names.iter().enumerate() {
                let done = part(at, &format!("{}/{count}", k + 1), name, run);
                ran += done["run"].as_u64().unwrap();
            }
            // Every screen was run once.
            let screens = whole["points"].as_array().unwrap();
            let splash = screens.iter().filter(|point| point["sensor"] == "splash");
            assert_eq!(ran, splash.map(|point| point["screens"].as_u64().unwrap()).sum::<u64>());
            // In any order.
            let parts: Vec<&str> = names.iter().rev().map(String::as_str).collect();
            let merged = common::json("merge", at, "1", &[&parts[..], &["--out", "all"]].concat());
            assert_eq!(merged["missing"], 0);
            for key in ["points", "paired", "budget"] {
                assert_eq!(merged[key], whole[key], "{key}");
            }
            let found = contents(&at.join("all"));
            assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
            for (name, bytes) in &expected {
                assert!(found[name] == *bytes, "{name} in {count} parts");
            }
            names.iter().for_each(|name| std::fs::remove_dir_all(at.join(name)).unwrap());
            std::fs::remove_dir_all(at.join("all")).unwrap();
        }
        std::fs::remove_dir_all(at.join("whole")).unwrap();
    }
}

/// Two parts of three, one of them cut in the middle of a line: counted, joined, and gone on from.
#[test]
fn what_is_missing_is_counted() {
    let place = TempDir::new().unwrap();
    let at = place.path();
    let run = ["--n", "4,6", "--screens", "6", "--sensing", "geometric", "--sensors", "ngs,fit"];
    let whole = strehl(at, "2", &[&run[..], &["--out", "whole"]].concat());
    part(at, "1/3", "one", &run);
    part(at, "2/3", "two", &run);
    let kept =
        std::fs::read_dir(at.join("two/screens")).unwrap().map(|entry| entry.unwrap().path());
    let small = kept.into_iter().find(|path| path.to_str().unwrap().contains("/n4-")).unwrap();
    let text = std::fs::read_to_string(&small).unwrap();
    std::fs::write(&small, &text[..text.len() - 3]).unwrap();

    let merged = common::json("merge", at, "1", &["one", "two", "--out", "all"]);
    // Screen s of N = 4 is in part s mod 3, of N = 6 in s + 1 mod 3: of each, two are not there; and what was cut.
    assert_eq!((&merged["parts"], &merged["missing"]), (&2.into(), &5.into()));
    let of = |n: u32, finished: u32| serde_json::json!({"n": n, "screens": 6, "finished": finished, "missing": 6 - finished});
    assert_eq!(merged["merged"], serde_json::json!([of(4, 3), of(6, 4)]));
    let found: Vec<_> = merged["points"].as_array().unwrap().iter().collect();
    assert_eq!(
        found.iter().map(|p| p["screens"].as_u64().unwrap()).collect::<Vec<_>>(),
        [3, 3, 4, 4]
    );
    // Means are over those that are there, each what it is in the whole run.
    let (all, some) = (at.join("whole/screens.csv"), at.join("all/screens.csv"));
    let (all, some) = (Series::read(all).unwrap(), Series::read(some).unwrap());
    let rows = |series: &Series| -> Vec<[f64; 3]> {
        let column = |name: &str| series.column(name).unwrap().to_vec();
        let (n, screen, ngs) = (column("n"), column("screen"), column("ngs"));
        (0..n.len()).map(|k| [n[k], screen[k], ngs[k]]).collect()
    };
    let (all, some) = (rows(&all), rows(&some));
    assert_eq!(some.len(), 7);
    assert!(some.iter().all(|row| all.contains(row)));
    let of_6: Vec<f64> = some.iter().filter(|row| row[0] == 6.0).map(|row| row[2]).collect();
    let mean = of_6.iter().sum::<f64>() / 4.0;
    assert!((found[2]["strehl"].as_f64().unwrap() - mean).abs() < 1e-15);

    fails(
        "merge",
        at,
        &["one", "two", "--complete", "--out", "all"],
        1,
        &["3 of N = 4", "2 of N = 6"],
    );
    // The joined directory is one to go on in.
    let resumed = strehl(at, "2", &[&run[..], &["--out", "all"]].concat());
    assert_eq!(resumed, whole);
    let merged = common::json("merge", at, "1", &["one", "two", "all", "--complete", "--out", "b"]);
    assert_eq!((&merged["missing"], &merged["points"]), (&0.into(), &whole["points"]));
}

#[test]
fn parts_of_other_runs_are_refused() {
    let place = TempDir::new().unwrap();
    let at = place.path();
    let run = ["--screens", "2", "--sensing", "geometric", "--sensors", "fit"];
    part(at, "1/2", "one", &[&run[..], &["--n", "4"]].concat());
    std::fs::write(at.join("strong.toml"), "[atmosphere]\nr0_m = 0.4\n").unwrap();
    let layer = "[[atmosphere.layers]]\nweight = 1.0\nheight_m = 10.0\nwind_speed_m_per_s = 1.0\n\
                 wind_direction_deg = 0.0\n";
    std::fs::write(at.join("layer.toml"), layer).unwrap();
    let others: [(&[&str], &[&str]); 6] = [
        (&["--n", "6"], &["n is [4] in one", "[6] in two"]),
        (&["--n", "4", "--seed", "2"], &["seed", "\"1\"", "\"2\""]),
        (&["--n", "4", "--gain", "0.4"], &["instrument.control.gain", "0.5", "0.4"]),
        (&["--n", "4", "--config", "strong.toml"], &["instrument.atmosphere.r0_m", "0.5", "0.4"]),
        (&["--n", "4", "--config", "layer.toml"], &["instrument.atmosphere.layers[0].height_m"]),
        (&["--n", "4", "--budget"], &["budget is false in one and true in two"]),
    ];
    for (other, words) in others {
        part(at, "2/2", "two", &[&run[..], other].concat());
        fails("merge", at, &["one", "two"], 2, words);
    }
    fails("merge", at, &["one", "three"], 2, &["three", "settings.toml"]);
    fails("merge", at, &[], 2, &["DIR"]);
    fails("strehl", at, &["--shard", "3/2"], 2, &["--shard", "i/n"]);
    // A screen that came to something else on another machine.
    part(at, "1/2", "two", &[&run[..], &["--n", "4"]].concat());
    let kept = std::fs::read_dir(at.join("two/screens")).unwrap();
    for path in kept.map(|entry| entry.unwrap().path()) {
        let text = std::fs::read_to_string(&path).unwrap();
        let changed: String = text.lines().map(|line| format!("{line}e-1\n")).collect();
        std::fs::write(&path, changed).unwrap();
    }
    fails("merge", at, &["one", "two"], 1, &["screen 0, fit", "two"]);
}
