//! `host-sim scale` as a user meets it.

mod common;
#[path = "common/refusal.rs"]
mod refusal;

use host_sim::files::csv::Series;
use host_sim::files::fits::FitsReader;
use serde_json::Value;
use tempfile::TempDir;

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// One of a list, by some of its fields.
fn find<'a>(list: &'a Value, n: u64, fields: &[(&str, &str)]) -> &'a Value {
    let fits =
        |item: &&Value| item["n"] == n && fields.iter().all(|(key, value)| item[key] == *value);
    list.as_array().unwrap().iter().find(fits).unwrap_or_else(|| panic!("{n} {fields:?}"))
}

/// Gradients are those of host-sim strehl, converged; laws and images are under the same screens; files agree.
#[test]
fn numbers_files_and_pictures_agree() {
    let place = TempDir::new().unwrap();
    let at = place.path();
    let run = ["--n", "4,6", "--images", "4", "--screens", "3", "--image-screens", "2"];
    let run = [&run[..], &["--lever-arm", "profile,1.2"]].concat();
    let result = common::json("scale", at, "2", &run);
    let point = |n, curve| find(&result["points"], n, &[("curve", curve)]);
    let pair = |n, a, b| find(&result["paired"], n, &[("a", a), ("b", b)]);

    let strehl = ["--n", "4,6", "--screens", "3", "--sensing", "geometric", "--frames", "1"];
    let loops = common::json("strehl", at, "2", &strehl);
    for n in [4, 6] {
        for sensor in ["splash", "lgs", "ngs", "fit"] {
            let of_loop = find(&loops["points"], n, &[("sensor", sensor)]);
            for value in ["strehl", "variance_rad2", "strehl_se"] {
                // 40 frames at a gain of 0.5 leave 1e-12 of the first.
                let difference = number(&point(n, sensor)[value]) - number(&of_loop[value]);
                assert!(difference.abs() < 1e-7, "{n} {sensor} {value}: {difference}");
            }
        }
    }
    assert_eq!(number(&point(4, "splash_1.2")["lever_arm"]), 1.2);
    assert!((number(&point(4, "lgs_profile")["lever_arm"]) - 0.9 / 0.825).abs() < 1e-15);
    assert!(point(4, "ngs")["lever_arm"].is_null());
    // The variance is a parabola in f, whatever the screens: through f = 1, 1.0909 and 1.2 in one way only.
    let strong =
        ["--n", "4", "--images", "--screens", "3", "--lever-arm", "1.1", "--out", "strong"];
    let strong = common::json("scale", at, "1", &strong);
    let variance = |value: &Value| number(&value["variance_rad2"]);
    let known = [
        (1.0, variance(point(4, "splash"))),
        (0.9 / 0.825, variance(point(4, "splash_profile"))),
        (1.2, variance(point(4, "splash_1.2"))),
    ];
    let parabola: f64 = (0..3)
        .map(|k| {
            let others = (0..3).filter(|&other| other != k);
            let factor = |other: usize| (1.1 - known[other].0) / (known[k].0 - known[other].0);
            known[k].1 * others.map(factor).product::<f64>()
        })
        .sum();
    let found = variance(find(&strong["points"], 4, &[("curve", "splash_1.1")]));
    assert!((found - parabola).abs() < 1e-5 * found, "{found} {parabola}");

    let of_laws = pair(6, "splash_1.2", "splash");
    let difference =
        number(&point(6, "splash_1.2")["strehl"]) - number(&point(6, "splash")["strehl"]);
    assert!((number(&of_laws["strehl"]) - difference).abs() < 1e-12);
    assert_eq!(pair(4, "images_splash", "splash")["screens"], 2);
    // Steps from gradients to the threshold add up to images less gradients, finely sampled.
    let steps = [
        ("fine_speckle", "fine_gradients"),
        ("fine_window", "fine_speckle"),
        ("fine_threshold", "fine_window"),
    ];
    let sum: f64 = steps.iter().map(|(a, b)| number(&pair(4, a, b)["variance_rad2"])).sum();
    let whole = variance(point(4, "fine_threshold")) - variance(point(4, "fine_gradients"));
    assert!((sum - whole).abs() < 1e-12, "{sum} {whole}");

    let out = at.join("target/splash/scale");
    let csv = Series::read(out.join("scale.csv")).unwrap();
    assert_eq!(csv.column("n").unwrap(), [4.0, 6.0]);
    assert_eq!(csv.column("splash_strehl").unwrap()[1], number(&point(6, "splash")["strehl"]));
    assert!(csv.column("images_ngs_strehl").unwrap()[1].is_nan());
    let differences = Series::read(out.join("differences.csv")).unwrap();
    let column = differences.column("splash_1.2_minus_splash_strehl").unwrap();
    assert_eq!(column[1], number(&of_laws["strehl"]));
    let (shape, cube) = FitsReader::open(out.join("scale.fits")).unwrap().image::<f64>(0).unwrap();
    // Three laws of two beacons, star and fit; images of three laws, LGS and NGS; four of the centroids.
    assert_eq!(shape, [3, 17, 2]);
    let mean = cube[..3].iter().sum::<f64>() / 3.0;
    assert!((mean - number(&point(4, "splash")["strehl"])).abs() < 1e-12);
    for name in ["strehl.svg", "variance.svg"] {
        let picture = std::fs::read_to_string(out.join(name)).unwrap();
        let picture = roxmltree::Document::parse(&picture).unwrap();
        let texts: Vec<_> = picture.descendants().filter_map(|n| n.text().map(str::trim)).collect();
        for word in ["SPLASH, f = 1", "LGS, f = 1", "NGS", "fit", "D / r0"] {
            assert!(texts.contains(&word), "{name}: {word} in {texts:?}");
        }
    }
    // What is there is not run again.
    assert_eq!(common::json("scale", at, "1", &run), result);
}

/// Without `--images`, images are beside those of 8, 16 and 32 that are run.
#[test]
fn images_are_where_there_are_gradients() {
    let place = TempDir::new().unwrap();
    let run = ["--screens", "2", "--image-screens", "2", "--lever-arm", "1"];
    for (n, with_images) in [("4,8", &[8][..]), ("4", &[])] {
        let result = common::json("scale", place.path(), "2", &[&run[..], &["--n", n]].concat());
        let points = result["points"].as_array().unwrap();
        let images = points.iter().filter(|point| point["curve"] == "images_splash");
        assert_eq!(images.map(|p| p["n"].as_u64().unwrap()).collect::<Vec<_>>(), with_images);
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let place = TempDir::new().unwrap();
    for (arguments, words) in [
        (&["--n", "129", "--images"][..], ["--n = 129", "128"]),
        (&["--n", "8", "--images", "16"], ["--images = 16", "one of --n"]),
        (&["--n", "8,16", "--images", "8,16,32"], ["--images = 32", "one of --n"]),
        (&["--n", "48", "--images", "48"], ["--n = 48", "40"]),
        (&["--lever-arm", "most"], ["most", "profile or best"]),
        (&["--lever-arm", "3"], ["control.lever_arm = 3", "1.9"]),
    ] {
        refusal::fails("scale", place.path(), arguments, 2, &words);
    }
}
