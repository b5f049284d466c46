//! `host-sim reproduce` as a user meets it.

mod common;
#[path = "common/refusal.rs"]
mod refusal;

use serde_json::Value;
use std::path::Path;
use tempfile::TempDir;

const COMMAND: &str = "reproduce";

fn json(place: &Path, threads: &str, arguments: &[&str]) -> Value {
    common::json(COMMAND, place, threads, arguments)
}

/// The words of the page, which is well-formed and needs nothing from elsewhere.
fn words(page: &Path) -> String {
    let text = std::fs::read_to_string(page).unwrap();
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let document = roxmltree::Document::parse_with_options(&text, options).unwrap();
    for node in document.descendants() {
        for attribute in node.attributes() {
            let (name, value) = (attribute.name(), attribute.value());
            assert!(name != "src" && !value.starts_with("http"), "{name} = {value}");
            if name == "href" && node.tag_name().name() == "a" {
                assert!(page.with_file_name(value).is_file(), "{value}");
            }
        }
    }
    let pictures = document.descendants().filter(|node| node.tag_name().name() == "svg").count();
    assert_eq!(pictures, 4);
    assert!(!text.contains("NaN"));
    let all = document.descendants().filter(|node| node.is_text());
    let words: String = all.filter_map(|node| node.text()).collect();
    words.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn figures_tables_and_a_page() {
    let place = TempDir::new().unwrap();
    let arguments = ["--n", "8,4", "--screens", "6"];
    let result = json(place.path(), "2", &arguments);
    let directory = place.path().join("target/splash/reproduce");
    let files = result["files"].as_array().unwrap();
    for name in ["index.html", "sensed.svg", "strehl.svg", "budget.svg", "budget.csv", "strehl.csv"]
    {
        assert!(files.contains(&name.into()), "{name} in {files:?}");
    }
    for file in files {
        assert!(directory.join(file.as_str().unwrap()).is_file(), "{file}");
    }
    assert_eq!(result["theory"]["arrays"].as_array().unwrap().len(), 2);
    assert_eq!(result["points"].as_array().unwrap().len(), 8);
    assert_eq!(result["budget"].as_array().unwrap().len(), 6);

    // What the page says of SPLASH and LGS is what the data says.
    let page = words(&directory.join("index.html"));
    let mut told = 0;
    for pair in result["paired"].as_array().unwrap() {
        if (&pair["a"], &pair["b"]) != (&"splash".into(), &"lgs".into()) {
            continue;
        }
        let [difference, se] = ["difference", "se"].map(|key| pair[key].as_f64().unwrap());
        let verdict = if difference > 3.0 * se {
            "In this run the Strehl ratio of SPLASH is above the LGS's at"
        } else if difference < -3.0 * se {
            "In this run the Strehl ratio of SPLASH is below the LGS's at"
        } else {
            "In this run the two cannot be told apart at"
        };
        let at = page.find(verdict).unwrap_or_else(|| panic!("no {verdict:?} in {page}"));
        let sentence = page[at..].split(". ").next().unwrap();
        assert!(sentence.contains(&format!("{} (", pair["n"])), "{sentence}");
        told += 1;
    }
    assert_eq!(told, 2);
    for word in ["seed", "6 screens", "4, 8", "beta = 0.75", "12000 m", "Lever arm"] {
        assert!(page.contains(word), "{word}");
    }

    // Everything is there: nothing is run, whatever the number of threads, and the page is the same.
    let screens = || -> Vec<(String, String)> {
        let files = std::fs::read_dir(directory.join("screens")).unwrap();
        let mut all: Vec<_> = files
            .map(|file| {
                let path = file.unwrap().path();
                (path.display().to_string(), std::fs::read_to_string(path).unwrap())
            })
            .collect();
        all.sort();
        all
    };
    let before = screens();
    assert_eq!(json(place.path(), "1", &arguments), result);
    assert_eq!(screens(), before);
    assert_eq!(words(&directory.join("index.html")), page);
}

/// Without layers above the ground there is no cone, and the page says nothing of one.
#[test]
fn a_sky_at_the_ground() {
    let place = TempDir::new().unwrap();
    let ground = "[[atmosphere.layers]]\nweight = 1\nheight_m = 0\nwind_speed_m_per_s = 50\n\
                  wind_direction_deg = 0\n";
    std::fs::write(place.path().join("ground.toml"), ground).unwrap();
    let arguments = ["--n", "4", "--screens", "2", "--config", "ground.toml", "--out", "g"];
    let result = json(place.path(), "2", &arguments);
    let terms = result["budget"][0]["terms"].as_array().unwrap();
    let names: Vec<_> = terms.iter().map(|term| term["term"].as_str().unwrap()).collect();
    assert_eq!(names, ["fitting", "aliasing", "temporal", "quantisation", "images"]);
    // The winds of the description are not those of the run.
    assert!(terms[2]["variance_rad2"].as_f64().unwrap().abs() < 1e-9, "{terms:?}");
    let page = words(&place.path().join("g/index.html"));
    assert!(page.contains("no layer above the ground"), "{page}");
    assert!(!page.contains("What a beacon adds"), "{page}");
}

#[test]
fn what_cannot_be_is_refused_before_it_starts() {
    let place = TempDir::new().unwrap();
    for (arguments, words) in [
        (&["--screens", "1"][..], &["--screens"][..]),
        (&["--n", "3"], &["--n"]),
        (&["--quick", "--full"], &["--quick", "--full"]),
        (&["--n", "40", "--screens", "100000"], &["days", "--long"]),
        (&["--config", "none.toml"], &["none.toml"]),
    ] {
        refusal::fails(COMMAND, place.path(), arguments, 2, words);
    }
    assert!(!place.path().join("target/splash/reproduce/index.html").exists());
}
