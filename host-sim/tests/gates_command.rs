//! `host-sim gates` as a user meets it.

mod common;
#[path = "common/refusal.rs"]
mod refusal;

use host_sim::files::csv::Series;
use host_sim::files::fits::FitsReader;
use serde_json::Value;
use tempfile::TempDir;

const COMMAND: &str = "gates";

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn numbers_files_and_threads_agree() {
    let place = TempDir::new().unwrap();
    let run = |out: &str, threads: &str| {
        let arguments = ["--n", "6,5", "--modes", "12", "--screens", "3", "--out", out];
        common::json(
            COMMAND,
            place.path(),
            threads,
            &[&arguments[..], &["--slope-noise", "0.1"]].concat(),
        )
    };
    let result = run("two", "2");
    assert_eq!(run("one", "1"), result);
    let points = result["points"].as_array().unwrap();
    let laws: Vec<&str> = points.iter().map(|p| p["law"].as_str().unwrap()).collect();
    let each = ["splash", "splash_f", "gates_12", "lgs", "ngs", "fit"];
    assert_eq!(laws, [each, each].concat());
    assert_eq!(number(&result["gate_height_m"]), 6000.0);

    let out = place.path().join("two");
    let means = Series::read(out.join("gates.csv")).unwrap();
    let screens = Series::read(out.join("screens.csv")).unwrap();
    for (row, n) in [(0, 5.0), (1, 6.0)] {
        let of_n = |law: &str| points.iter().find(|p| number(&p["n"]) == n && p["law"] == law);
        let variances = |law: &str| -> Vec<f64> {
            let column = screens.column(&format!("{law}_variance_rad2")).unwrap();
            column[3 * row..3 * row + 3].to_vec()
        };
        for law in each {
            let point = of_n(law).unwrap();
            let mean = variances(law).iter().sum::<f64>() / 3.0;
            assert!((number(&point["variance_rad2"]) - mean).abs() < 1e-12);
            let null = variances("splash").iter().sum::<f64>() / 3.0;
            assert!((number(&point["ratio"]) - mean / null).abs() < 1e-12);
            assert_eq!(
                means.column(&format!("{law}_strehl")).unwrap()[row],
                number(&point["strehl"])
            );
        }
    }
    let (shape, cube) = FitsReader::open(out.join("gates.fits")).unwrap().image::<f64>(1).unwrap();
    assert_eq!(shape, [3, 6, 2]);
    assert_eq!(cube[..3], screens.column("splash_variance_rad2").unwrap()[..3]);
    for name in ["strehl.svg", "ratio.svg"] {
        assert!(std::fs::read_to_string(out.join(name)).unwrap().contains("two gates, 12 modes"));
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let place = TempDir::new().unwrap();
    for (arguments, words) in [
        (&["--modes", "13"][..], "second_gate.modes = 13: must be 0, 12 or 25"),
        (&["--n", "4", "--modes", "25"], "second_gate.modes = 25: must be fewer"),
        (&["--slope-noise", "-1"], "second_gate.slope_noise_rad[0] = -1: must be from 0 to 100"),
        (&["--wind", "11"], "--wind = 11: must be from 0 to 10 pitches per frame"),
    ] {
        refusal::fails(COMMAND, place.path(), arguments, 2, &[words]);
    }
}
