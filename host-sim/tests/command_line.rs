//! The program as a user meets it: what it prints, what it writes and what it refuses.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use host_sim::files::csv::Series;
use host_sim::files::fits::{FitsReader, FitsWriter, Header};
use host_sim::instrument::{DEFAULT_TOML, Instrument};
use serde_json::Value;
use sha2::{Digest, Sha256};
use tempfile::TempDir;

/// A run that is short and closes the loop all the same.
const SHORT: [&str; 6] = ["--n", "4", "--frames", "60", "--settle", "10"];
/// Subapertures of a circle of 4.
const SUBAPERTURES: usize = 12;

/// A directory in which the program runs.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).unwrap();
    }

    fn run_on(&self, threads: &str, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(arguments)
            .current_dir(self.0.path())
            .env("RUST_BACKTRACE", "1")
            .env("RAYON_NUM_THREADS", threads)
            .output()
            .unwrap()
    }

    /// Runs it, expects success and returns what it printed.
    fn run(&self, arguments: &[&str]) -> String {
        let output = self.run_on("2", arguments);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {error}");
        String::from_utf8(output.stdout).unwrap()
    }

    fn json(&self, arguments: &[&str]) -> Value {
        let printed = self.run(&[arguments, &["--json"]].concat());
        assert_eq!(printed.lines().count(), 1, "{printed}");
        serde_json::from_str(&printed).unwrap()
    }

    fn json_on(&self, threads: &str, arguments: &[&str]) -> Value {
        let output = self.run_on(threads, &[arguments, &["--json"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Runs it and expects exit code 2 and one line on stderr, in which `words` are found.
    fn refused(&self, arguments: &[&str], words: &[&str]) {
        let output = self.run_on("1", arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
        assert!(output.stdout.is_empty(), "{arguments:?}");
        assert!(error.starts_with("error: ") && error.ends_with('\n'), "{arguments:?}: {error}");
        assert_eq!(error.lines().count(), 1, "{arguments:?}: {error}");
        assert!(!error.contains("panicked") && !error.contains("backtrace"), "{error}");
        assert!(error.len() < 300, "{arguments:?}: {error}");
        for word in words {
            assert!(error.contains(word), "{arguments:?}: no {word:?} in {error}");
        }
    }

    /// Runs a loop of 4 subapertures and 2 frames with this description and expects a refusal.
    fn description_refused(&self, toml: &str, words: &[&str]) {
        self.write("refused.toml", toml);
        let run = ["loop", "--n", "4", "--frames", "2", "--settle", "0", "--out", "refused"];
        self.refused(&[&run[..], &["--config", "refused.toml"]].concat(), words);
    }
}

fn keys(object: &Value) -> Vec<&str> {
    object.as_object().unwrap().keys().map(String::as_str).collect()
}

/// SHA-256 of the codes in a commands file, as the documentation defines it.
fn digest_of(file: &Path) -> String {
    let (shape, codes) = FitsReader::open(file).unwrap().image::<u16>(0).unwrap();
    assert_eq!(shape[..2], [3, SUBAPERTURES]);
    let bytes: Vec<u8> = codes.into_iter().flat_map(u16::to_le_bytes).collect();
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn a_loop_prints_numbers_and_leaves_pictures_and_files() {
    let place = Place::new();
    let result = place.json(&[&["loop", "--out", "run/one"], &SHORT[..]].concat());
    let names = [
        "n",
        "sensor",
        "board",
        "frames",
        "strehl",
        "strehl_se",
        "variance_rad2",
        "frames_per_second",
        "digest",
        "faults",
    ];
    let (mut found, mut expected) = (keys(&result), names.to_vec());
    found.sort_unstable();
    expected.sort_unstable();
    assert_eq!(found, expected);
    assert_eq!(result["n"], 4);
    assert_eq!(result["sensor"], "splash");
    assert_eq!(result["board"], "host");
    assert_eq!(result["frames"], 60);
    let number = |name: &str| result[name].as_f64().unwrap();
    assert!((0.3..1.0).contains(&number("strehl")), "{result}");
    assert!((0.0..0.2).contains(&number("strehl_se")), "{result}");
    assert!((0.0..2.0).contains(&number("variance_rad2")), "{result}");
    assert!(number("frames_per_second") > 0.0, "{result}");
    assert_eq!(result["faults"], serde_json::json!({}));

    let at = |name: &str| place.path("run/one").join(name);
    for picture in ["detector.svg", "pistons.svg", "residual.svg", "psf.svg", "strehl.svg"] {
        let text = std::fs::read_to_string(at(picture)).unwrap();
        let document = roxmltree::Document::parse(&text).unwrap();
        assert_eq!(document.root_element().tag_name().name(), "svg", "{picture}");
        assert!(!text.contains("NaN"), "{picture}");
    }
    let series = Series::read(at("series.csv")).unwrap();
    let strehl = series.column("strehl").unwrap();
    assert_eq!(strehl.len(), 60);
    let mean = strehl[10..].iter().sum::<f64>() / 50.0;
    assert!((mean - number("strehl")).abs() < 1e-9);

    let shape = |name: &str| FitsReader::open(at(name)).unwrap().hdus()[0].shape.clone();
    assert_eq!(shape("commands.fits"), [3, SUBAPERTURES, 60]);
    assert_eq!(shape("frames.fits"), [64, 64, 60]);
    assert_eq!(shape("phases.fits"), [32, 32, 60]);
    assert_eq!(shape("psf.fits"), [128, 128]);
    assert_eq!(result["digest"], digest_of(&at("commands.fits")));
}

#[test]
fn astropy_opens_what_a_loop_leaves() {
    let named = std::env::var("SPLASH_PYTHON").ok();
    let interpreter = named.as_deref().unwrap_or("python3");
    let astropy = Command::new(interpreter).args(["-c", "import astropy.io.fits"]).output();
    if !astropy.is_ok_and(|output| output.status.success()) {
        assert!(named.is_none(), "SPLASH_PYTHON={interpreter} cannot import astropy");
        println!("skipped: {interpreter} has no astropy (set SPLASH_PYTHON)");
        return;
    }
    let place = Place::new();
    place.run(&[&["loop", "--out", ".", "--keep", "7", "--seed", "5"], &SHORT[..]].concat());
    place.run(&["frames", "recorded.fits", "--n", "4", "--frames", "3", "--seed", "5"]);
    place.run(&["replay", "recorded.fits", "--out", "replay"]);
    let script = r#"
import warnings
from astropy.io import fits
warnings.simplefilter("error")
expected = {
    "commands.fits": [("CODES", "uint16", (60, 12, 3), "DAC code")],
    "frames.fits": [("FRAMES", "uint16", (7, 64, 64), "ADU")],
    "phases.fits": [("RESIDUAL", ">f4", (7, 32, 32), "rad")],
    "psf.fits": [("PSF", ">f4", (128, 128), "fraction of diffraction limit")],
    "replay/commands.fits": [("CODES", "uint16", (3, 12, 3), "DAC code")],
    "recorded.fits": [
        ("FRAMES", "uint16", (3, 64, 64), "ADU"),
        ("TRUTH", ">f4", (3, 12, 2), "pixel"),
        ("STREHL", ">f8", (3,), ""),
        ("REFERENCE", ">f8", (12, 2), "pixel"),
        ("GAIN", ">f8", (12, 2, 2), "m/pixel"),
    ],
}
for name, arrays in expected.items():
    with fits.open(name, checksum=True) as hdus:
        hdus.verify("exception")
        for hdu, (array, dtype, shape, unit) in zip(hdus, arrays):
            found = (hdu.name, hdu.data.dtype, hdu.data.shape, hdu.header["BUNIT"])
            assert found == (array, dtype, shape, unit), (name, found)
            assert hdu.header["NSUB"] == 4 and hdu.header["SEED"] == "5", (name, array)
"#;
    let output =
        Command::new(interpreter).args(["-c", script]).current_dir(place.0.path()).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn without_a_command_the_loop_runs() {
    let place = Place::new();
    let bare = place.json(&SHORT);
    // Without --out, files are where the help says.
    assert!(place.path("target/splash/loop/strehl.svg").exists());
    let named = place.json(&[&["loop"], &SHORT[..]].concat());
    assert_eq!(bare["digest"], named["digest"]);
    let table = place.run(&SHORT);
    assert!(table.contains(named["digest"].as_str().unwrap()), "{table}");
    assert!(table.contains("Strehl ratio") && table.contains("frames/s"), "{table}");
}

#[test]
fn every_sensor_runs_without_images() {
    let place = Place::new();
    let mut digests = Vec::new();
    for sensor in ["splash", "lgs", "ngs"] {
        let arguments = ["--sensor", sensor, "--sensing", "geometric", "--out", sensor];
        let result = place.json(&[&arguments, &SHORT[..]].concat());
        assert_eq!(result["sensor"], sensor);
        assert!(result["strehl"].as_f64().unwrap() > 0.4, "{result}");
        assert_eq!(result["digest"], digest_of(&place.path(sensor).join("commands.fits")));
        assert!(!place.path(sensor).join("frames.fits").exists());
        digests.push(result["digest"].clone());
    }
    assert!(digests[0] != digests[1] && digests[1] != digests[2]);
}

#[test]
fn guide_stars_run_with_images() {
    let place = Place::new();
    for sensor in ["lgs", "ngs"] {
        let result = place.json(&[&["--sensor", sensor, "--out", sensor], &SHORT[..]].concat());
        assert_eq!(result["sensor"], sensor);
        assert!(result["strehl"].as_f64().unwrap() > 0.4, "{result}");
        assert!(result["faults"].as_object().unwrap().is_empty(), "{result}");
        assert_eq!(result["digest"], digest_of(&place.path(sensor).join("commands.fits")));
        let mut frames = FitsReader::open(place.path(sensor).join("frames.fits")).unwrap();
        assert_eq!(frames.image::<u16>(0).unwrap().0, [64, 64, 60]);
    }
}

#[test]
fn a_recorded_run_replays_to_the_same_codes() {
    let place = Place::new();
    let run = ["--n", "4", "--frames", "20"];
    let recorded = place.json(&[&["frames", "run.fits"], &run[..]].concat());
    assert_eq!(keys(&recorded), ["digest", "file", "frames", "shape"]);
    assert_eq!(recorded["shape"], serde_json::json!([20, 64, 64]));
    assert_eq!(recorded["frames"], 20);
    for threads in ["1", "2"] {
        let replayed = place.json_on(threads, &["replay", "run.fits", "--out", threads]);
        assert_eq!(keys(&replayed), ["digest", "faults", "frames"]);
        assert_eq!(replayed["frames"], 20);
        assert_eq!(replayed["digest"], recorded["digest"]);
        let at = place.path(threads);
        assert_eq!(replayed["digest"], digest_of(&at.join("commands.fits")));
        let codes = Series::read(at.join("commands.csv")).unwrap().column("code_2").unwrap();
        assert_eq!(codes.len(), 20 * SUBAPERTURES);
    }
    // The same run, not recorded, is the same; another seed is not.
    let closed = |threads: &str, seed: &str| {
        let seed = ["loop", "--settle", "0", "--out", "loop", "--seed", seed];
        place.json_on(threads, &[&seed, &run[..]].concat())["digest"].clone()
    };
    assert_eq!(closed("1", "1"), recorded["digest"]);
    assert_eq!(closed("2", "1"), recorded["digest"]);
    assert_ne!(closed("2", "2"), recorded["digest"]);
}

#[test]
fn the_default_description_is_printed_explained_and_read_back() {
    let place = Place::new();
    let printed = place.run(&["config"]);
    assert_eq!(printed, DEFAULT_TOML);
    printed.parse::<toml::Table>().unwrap();
    assert_eq!(Instrument::parse(&printed, "printed").unwrap(), Instrument::standard().unwrap());
    // Every field has a comment, or says all with its name and unit; the second layer needs none.
    let units = ["_m", "_m_per_s", "_deg", "_hz", "_s", "_e", "_adu", "_frame"];
    let mut explained = vec!["bits", "dac_bits"];
    for line in printed.lines() {
        let Some((name, _)) = line.split_once(" = ") else { continue };
        let name = name.trim();
        let has_unit = units.iter().any(|unit| name.ends_with(unit));
        if line.contains('#') || has_unit {
            explained.push(name);
        }
        assert!(explained.contains(&name), "unexplained: {line}");
    }
    place.write("default.toml", &printed);
    let default = place.json(&SHORT);
    let read = place.json(&[&SHORT[..], &["--config", "default.toml"]].concat());
    assert_eq!(default["digest"], read["digest"]);
}

#[test]
fn help_has_defaults_and_units() {
    let place = Place::new();
    for command in [&["--help"][..], &["loop", "--help"]] {
        let help = place.run(command);
        for word in ["4 to 40", "default: 500", "1 ms", "default: 1]", "default: 50,", "JSON"] {
            assert!(help.contains(word), "{command:?}: no {word:?} in {help}");
        }
    }
    for (command, words) in [
        ("frames", &["<FILE>", "FITS", "default: 500", "4 to 40", "JSON"][..]),
        ("replay", &["<FILE>", "target/splash", "TOML", "JSON"]),
        ("config", &["TOML", "default"]),
        ("strehl", &["4 to 40", "to 128", "default: 30", "per frame", "0.5", "JSON"]),
        ("reproduce", &["4 to 40", "30 screens", "150 screens", "TOML", "JSON"]),
        ("theory", &["4 to 40", "8,12", "0.75", "0.6:1,0.4:0.75", "7, 10 and 13", "JSON"]),
    ] {
        let help = place.run(&[command, "--help"]);
        for word in words {
            assert!(help.contains(word), "{command}: no {word:?} in {help}");
        }
    }
    assert!(place.run(&["--version"]).starts_with("host-sim "));
}

#[test]
fn wrong_arguments_are_refused() {
    let place = Place::new();
    place.refused(&["lop"], &["lop", "loop"]);
    place.refused(&["loop", "--frmes", "3"], &["--frmes", "--frames"]);
    place.refused(&["--sensor", "lidar"], &["--sensor", "lidar", "splash, lgs, ngs"]);
    for n in ["3", "41", "-1"] {
        place.refused(&["loop", "--n", n], &["--n", n, "4..=40"]);
    }
    place.refused(&["--n", "eight"], &["--n", "eight"]);
    place.refused(&["--n"], &["--n", "value is required"]);
    for command in [&["loop", "--settle", "0"][..], &["frames", "f.fits"]] {
        place.refused(&[command, &["--frames", "0"]].concat(), &["--frames", "'0'", "1..="]);
    }
    place.refused(&["--frames", "9", "--settle", "9"], &["--settle = 9", "--frames = 9"]);
    place.refused(&["replay"], &["<FILE>"]);
    let endless = ["--n", "4", "--frames", "4000000000", "--sensing", "geometric"];
    place.refused(&endless, &["duration_s", "phase screen"]);
}

#[test]
fn what_is_not_a_description_is_refused() {
    let place = Place::new();
    place.refused(&["--config", "none.toml"], &["none.toml", "No such file"]);
    place.refused(&["--config", "."], &[".:", "directory"]);
    place.write("binary", [0xff, 0xfe, 0]);
    place.refused(&["--config", "binary"], &["binary", "UTF-8"]);
    for (toml, words) in [
        ("\n[laser]\nwavelength_m = = 1\n", &["refused.toml: line 3", "="][..]),
        ("[laser\n", &["line 1", "]"]),
        ("[laser]\nwavelength = 1e-6", &["`wavelength`", "`wavelength_m`", "`laser`"]),
        ("[lasers]\nwavelength_m = 1e-6", &["`lasers`", "`laser`"]),
        ("[laser]\nwavelength_m = \"green\"", &["\"green\"", "a number", "`laser.wavelength_m`"]),
        ("laser = 3", &["`3`", "`laser`"]),
        ("[detector]\nbits = 12.5", &["12.5", "whole number", "`detector.bits`"]),
        ("[windows]\nsize = -16", &["-16", "whole number", "`windows.size`"]),
        ("[[atmosphere.layers]]\nweight = 1", &["`height_m`", "`atmosphere.layers`"]),
        ("[centroids]\nestimator = \"best\"", &["`best`", "`brightest`", "`centroids.estimator`"]),
        ("[telescope]\npupil = \"hexagon\"", &["\"annulus\"", "`telescope.pupil`"]),
        ("[telescope]\npupil = [\"####\"]", &["telescope.pupil = 1 rows", "4 rows"]),
        (
            "[telescope]\npupil = [\"....\", \".x..\", \"....\", \"....\"]",
            &["telescope.pupil", "\".x..\"", "'#' and '.'"],
        ),
        (
            "[telescope]\npupil = [\"....\", \"....\", \"....\", \"....\"]",
            &["telescope.pupil = 0", "at least one subaperture"],
        ),
        ("[detector]\nbad_pixels = [{ x = 1, y = 2, kind = \"warm\" }]", &["`warm`", "`hot`"]),
    ] {
        place.description_refused(toml, words);
    }
}

#[test]
fn values_out_of_their_limits_are_refused() {
    let place = Place::new();
    for section_and_field in [
        "telescope.pitch_m",
        "atmosphere.r0_m",
        "laser.wavelength_m",
        "laser.beacon_height_m",
        "laser.electrons_per_spot",
        "science.wavelength_m",
        "detector.gain_e_per_adu",
        "detector.read_noise_e",
        "windows.pixels_per_lambda_d",
        "centroids.flux_max",
        "control.gain",
        "mirror.stroke_m",
    ] {
        let (section, field) = section_and_field.split_once('.').unwrap();
        for (value, shown) in [("nan", "NaN"), ("inf", "inf"), ("-0.5", "-0.5")] {
            let toml = format!("[{section}]\n{field} = {value}\n");
            let said = format!("{section_and_field} = {shown}: must be ");
            place.description_refused(&toml, &[&said]);
        }
    }
    for (field, value) in [("weight", "nan"), ("height_m", "inf"), ("wind_speed_m_per_s", "-1")] {
        let mut toml = String::from("[[atmosphere.layers]]\n");
        for name in ["weight", "height_m", "wind_speed_m_per_s", "wind_direction_deg"] {
            toml += &format!("{name} = {}\n", if name == field { value } else { "1" });
        }
        place.description_refused(&toml, &[&format!("layers[0].{field} = "), "must be from 0"]);
    }
    for (toml, words) in [
        ("[control]\ngain = 0", &["control.gain = 0: must be above 0 and below 2"][..]),
        ("[control]\ngain = 2", &["control.gain = 2: must be above 0 and below 2"]),
        ("[laser]\nbeacon_height_m = 2000", &["layers[1].height_m = 3000", "2000 m"]),
        ("[windows]\nspacing_px = 15", &["windows.spacing_px = 15", "windows.size = 16"]),
        ("[windows]\nspacing_px = 1025", &["windows.spacing_px = 1025", "1024"]),
        ("[windows]\nsize = 3", &["windows.size = 3: must be from 4 to 32"]),
        ("[windows]\nsize = 33\nspacing_px = 33", &["windows.size = 33: must be from 4 to 32"]),
        ("[windows]\nsize = 20\nspacing_px = 20", &["windows.size = 20", "16 pixels", "samples"]),
        ("[laser]\npulse_rate_hz = 20000", &["laser.pulse_rate_hz = 20000", "12337", "gate"]),
        ("[laser]\nzenith_angle_deg = 70", &["laser.pulse_rate_hz = 10000", "gate"]),
        ("[detector]\nreadout_s = 0.0011", &["detector.readout_s = 0.0011", "to 0.001"]),
        ("[detector]\nbits = 7", &["detector.bits = 7: must be from 8 to 16"]),
        (
            "[detector]\nbad_pixels = [{ x = 3, y = 64, kind = \"hot\" }]",
            &["detector.bad_pixels[0].y = 64", "63"],
        ),
        ("[laser]\nelectrons_per_spot = 1", &["laser.electrons_per_spot", "calibration"]),
    ] {
        place.description_refused(toml, words);
    }
    for n in ["3", "41"] {
        place.write("n.toml", format!("[telescope]\nsubapertures = {n}\n"));
        let words = format!("telescope.subapertures = {n}: must be from 4 to 40");
        place.refused(&["--config", "n.toml"], &[&words]);
    }
}

#[test]
fn directories_that_cannot_be_are_refused() {
    let place = Place::new();
    place.write("file", "");
    place.run(&["frames", "run.fits", "--n", "4", "--frames", "2"]);
    let out = ["--out", "file/directory"];
    place.refused(&[&["loop"], &SHORT[..], &out].concat(), &["--out file/directory"]);
    place.refused(&[&["replay", "run.fits"], &out[..]].concat(), &["--out file/directory"]);
    let frames = ["frames", "none/run.fits", "--n", "4", "--frames", "2"];
    place.refused(&frames, &["none/run.fits", "No such file"]);
}

/// Writes a file like a recording of two frames: a primary array of this shape, an ideal slope
/// calibration for 12 subapertures and this configuration.
fn recording(file: &Path, shape: &[usize], config: Option<&str>) {
    let header = Header::new();
    let mut file = FitsWriter::create(file).unwrap();
    file.image("FRAMES", shape, &header, &vec![64_u16; shape.iter().product()]).unwrap();
    file.image("REFERENCE", &[2, SUBAPERTURES], &header, &[0.0; 2 * SUBAPERTURES]).unwrap();
    let gain = [1.33e-7, 0.0, 0.0, 1.33e-7].repeat(SUBAPERTURES);
    file.image("GAIN", &[2, 2, SUBAPERTURES], &header, &gain).unwrap();
    if let Some(config) = config {
        file.text("CONFIG", config).unwrap();
    }
    file.finish().unwrap();
}

#[test]
fn recordings_that_cannot_be_replayed_are_refused() {
    let place = Place::new();
    let refused = |file: &str, words: &[&str]| {
        place.refused(&["replay", file, "--out", "out"], &[&[file], words].concat());
    };
    refused("none.fits", &["No such file"]);
    place.write("text.fits", "frames".repeat(1000));
    refused("text.fits", &["not a FITS file"]);

    let four = "[telescope]\nsubapertures = 4\n";
    let write = |file: &str, shape: &[usize], config: Option<&str>| {
        recording(&place.path(file), shape, config);
    };
    write("good.fits", &[64, 64, 2], Some(four));
    let result = place.json(&["replay", "good.fits", "--out", "out"]);
    assert_eq!(result["frames"], 2);
    // Frames without light move nothing, and are counted.
    let faults = serde_json::json!({ "no_light": 2, "too_few_valid": 2 });
    assert_eq!(result["faults"], faults);

    let good = std::fs::read(place.path("good.fits")).unwrap();
    for (length, words) in [
        (0, "not a FITS file"),
        (2879, "not a FITS file"),
        (2880 + 100, "FRAMES"),
        (2880 + 2 * 64 * 64 * 2 - 1, "truncated"),
        (good.len() - 2880, "CONFIG"),
        (good.len() - 2881, "CONFIG"),
    ] {
        place.write("cut.fits", &good[..length]);
        refused("cut.fits", &[words]);
    }
    write("flat.fits", &[64, 64], Some(four));
    refused("flat.fits", &["NAXIS = 2", "3"]);
    write("narrow.fits", &[63, 64, 2], Some(four));
    refused("narrow.fits", &["63 x 64 pixels", "64 x 64 pixels"]);
    write("bare.fits", &[64, 64, 2], None);
    refused("bare.fits", &["no array \"CONFIG\"", "FRAMES"]);
    write("eight.fits", &[64, 64, 2], Some(""));
    refused("eight.fits", &["REFERENCE", "[2, 12]", "[2, 52]"]);
    write("broken.fits", &[64, 64, 2], Some("[telescope"));
    refused("broken.fits", &["broken.fits[CONFIG]: line 1"]);
}

/// Detectors as they are delivered: the loop closes as well as with a perfect one.
#[test]
fn the_loop_closes_on_imperfect_detectors() {
    let place = Place::new();
    let strehl = |toml: &str| {
        place.write("detector.toml", toml);
        let result = place.json(&[&SHORT[..], &["--config", "detector.toml"]].concat());
        assert_eq!(result["faults"], serde_json::json!({}), "{toml}");
        result["strehl"].as_f64().unwrap()
    };
    let perfect = strehl("");
    let open = strehl("[control]\ngain = 0.001\n");
    assert!(perfect > open + 0.1, "closed {perfect}, open {open}");
    for toml in [
        "[windows]\nspacing_px = 24\n",
        "[detector]\nresponse_rms = 0.05\n",
        "[detector]\nbad_pixels = [{ x = 23, y = 9, kind = \"dead\" }, \
         { x = 24, y = 25, kind = \"hot\" }, { x = 5, y = 40, kind = \"hot\" }]\n",
        "[windows]\nspacing_px = 24\n[detector]\nresponse_rms = 0.05\n\
         bad_pixels = [{ x = 0, y = 0, kind = \"hot\" }, { x = 95, y = 95, kind = \"dead\" }]\n",
    ] {
        let found = strehl(toml);
        assert!((found - perfect).abs() < 0.02, "{toml}: {found} beside {perfect}");
    }
}

/// A profile of the host: every stage, whole numbers, the files, and no sizes.
#[test]
fn a_profile_has_every_stage() {
    let place = Place::new();
    let shape = ["profile", "--n", "4", "--window", "8", "--bits", "14", "--sweeps", "3"];
    let result = place.json(&[&shape[..], &["--out", "out"]].concat());
    let named = |key: &str, value: Value| assert_eq!(result[key], value, "{key}");
    named("board", "host".into());
    named("unit", "ns".into());
    for (key, value) in [("n", 4), ("window", 8), ("bits", 14), ("sweeps", 3)] {
        named(key, value.into());
    }
    for size in ["flash_bytes", "ram_bytes", "stack_bytes"] {
        named(size, Value::Null);
    }
    let stages = result["stages"].as_array().unwrap();
    let names: Vec<_> = stages.iter().map(|stage| stage["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["centroid", "slopes", "control", "sor", "segments", "actuators"]);
    let number = |value: &Value| value.as_u64().unwrap();
    let [least, most] = ["frame_min", "frame_max"].map(|key| number(&result[key]));
    // Counts are the largest of each stage: no frame is dearer than their sum.
    let sum: u64 = stages.iter().map(|stage| number(&stage["count"])).sum();
    assert!(0 < least && least <= most && most <= sum, "{result}");
    assert!(number(&result["tail"]) <= most, "{result}");

    let table = std::fs::read_to_string(place.path("out/profile.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 15, "three frames of five contents");
    let figure = std::fs::read_to_string(place.path("out/timeline.svg")).unwrap();
    let figure = roxmltree::Document::parse(&figure).unwrap();
    let labels: Vec<_> =
        figure.descendants().filter_map(|node| node.text()).map(str::trim).collect();
    for label in ["detector", "core", "sor", "actuators"] {
        assert!(labels.contains(&label), "{label}: {labels:?}");
    }
    place.refused(&["profile", "--window", "3"], &["windows.size", "3"]);
    place.refused(&["profile", "--bits", "17"], &["bits", "17"]);
}

/// The theory's JSON, table and files agree with one another.
#[test]
fn the_theory_has_every_variant() {
    let place = Place::new();
    let result = place.json(&["theory", "--out", "out"]);
    let arrays = result["arrays"].as_array().unwrap();
    // The paper's arrays: N, orders fitted.
    let shapes: Vec<_> = arrays.iter().map(|array| (&array["n"], &array["beta"])).collect();
    assert_eq!(shapes, [(&Value::from(8), &Value::from(0.75)), (&12.into(), &0.75.into())]);
    let table = Series::read(place.path("out/residuals.csv")).unwrap();
    let mut file = FitsReader::open(place.path("out/residuals.fits")).unwrap();
    let mut line = 0;
    for (index, (array, highest)) in arrays.iter().zip([7, 10]).enumerate() {
        let names = ["beta", "lgs", "lgs_lever", "n", "ngs", "orders", "splash", "splash_lever"];
        assert_eq!(keys(array), names);
        let orders: Vec<usize> = (2..=highest).collect();
        assert_eq!(array["orders"], serde_json::json!(orders));
        let (shape, image) = file.image::<f64>(index).unwrap();
        assert_eq!(shape, [orders.len(), 9]);
        for (k, order) in orders.iter().enumerate() {
            let row = &table.rows[line];
            assert_eq!(row[..3], [array["n"].as_f64().unwrap(), 0.75, *order as f64]);
            let sensors = ["splash", "splash_lever", "lgs", "lgs_lever"];
            let pairs = sensors.iter().flat_map(|sensor| [(*sensor, "sensed"), (*sensor, "total")]);
            for (column, (sensor, kind)) in pairs.chain([("ngs", "total")]).enumerate() {
                let value = array[sensor][kind][k].as_f64().unwrap();
                assert!(value > 0.0 && value < 2.0, "{sensor} {kind} {order}: {value}");
                assert_eq!(row[3 + column], value, "{sensor} {kind} {order}");
                assert_eq!(table.columns[3 + column], format!("{sensor}_{kind}"));
                assert_eq!(image[column * orders.len() + k], value, "{sensor} {kind} {order}");
            }
            // What the paper shows: SPLASH loses little, and a laser guide star ever more.
            assert!(row[3] < 0.07 && row[7] > 0.16, "order {order}");
            line += 1;
        }
    }
    assert_eq!(table.rows.len(), line);
    for (name, curves) in [("sensed", 4), ("total", 5)] {
        let text = std::fs::read_to_string(place.path(&format!("out/{name}.svg"))).unwrap();
        let figure = roxmltree::Document::parse(&text).unwrap();
        assert!(!text.contains("NaN"), "{name}");
        let drawn = figure.descendants().filter(|node| node.tag_name().name() == "path").count();
        assert_eq!(drawn, 2 * curves, "{name}: both panels");
        for label in ["N = 8, 52 subapertures, beta = 0.75", "SPLASH", "LGS", "radial order"] {
            assert!(text.contains(label), "{name}: {label}");
        }
    }
    let printed = place.run(&["theory", "--n", "8", "--out", "out"]);
    let first = format!("{:.5}", arrays[0]["splash"]["sensed"][0].as_f64().unwrap());
    assert!(printed.contains(&first) && printed.contains("matched"), "{printed}");
}

#[test]
fn the_theory_takes_layers_and_pupils() {
    let place = Place::new();
    let of = |arguments: &[&str]| place.json(&[&["theory", "--n", "8"], arguments].concat());
    // The paper's two layers, by hand and from the default description's heights.
    let by_hand = of(&["--layers", "0.6:1,0.4:0.75"])["arrays"][0].clone();
    assert_eq!(by_hand["beta"], Value::Null);
    assert_eq!(by_hand["layers"][1], serde_json::json!({"weight": 0.4, "beta": 0.75}));
    place.write("default.toml", DEFAULT_TOML);
    assert_eq!(of(&["--config", "default.toml"])["arrays"][0], by_hand);
    // Several betas and orders make several arrays.
    let many = place.json(&["theory", "--n", "4,5", "--beta", "1,0.5", "--max-order", "3,4"]);
    let shapes = many["arrays"].as_array().unwrap().iter().map(|array| {
        let orders = array["orders"].as_array().unwrap().len();
        (array["n"].as_u64().unwrap(), array["beta"].as_f64().unwrap(), orders)
    });
    let expected = [(4, 1.0, 2), (4, 0.5, 2), (5, 1.0, 3), (5, 0.5, 3)];
    assert_eq!(shapes.collect::<Vec<_>>(), expected);
    // A pupil of its own, and a rule in its place; few subapertures take fewer orders.
    let rows = "[telescope]\nsubapertures = 4\npupil = [\".##.\", \"####\", \"####\", \".##.\"]\n";
    place.write("rows.toml", rows);
    let drawn = place.json(&["theory", "--config", "rows.toml", "--beta", "0.8"]);
    let circle = place.json(&["theory", "--n", "4", "--beta", "0.8"]);
    assert_eq!(drawn, circle);
    let inside = of(&["--pupil", "inside"])["arrays"][0]["orders"].clone();
    assert_eq!(inside, serde_json::json!([2, 3, 4, 5, 6]));
    let obstructed = ["--obstruction", "0.3", "--max-order", "5"];
    let annulus = of(&[&["--pupil", "annulus"], &obstructed[..]].concat());
    assert_ne!(annulus, of(&["--max-order", "5"]));
    place.write("annulus.toml", "[telescope]\npupil = \"annulus\"\n");
    let read = ["--config", "annulus.toml", "--beta", "0.75"];
    assert_eq!(of(&[&read, &obstructed[..]].concat()), annulus);
    // Reconstructors by name.
    let nominal = of(&["--reconstructor", "nominal"])["arrays"][0].clone();
    let mixed = of(&["--reconstructor", "mixed"])["arrays"][0].clone();
    assert_eq!(nominal["splash_lever"], mixed["splash_lever"]);
    assert_ne!(nominal["splash"], mixed["splash"]);
    // The same whatever the number of threads.
    let on = |threads: &str| place.json_on(threads, &["theory", "--out", threads]);
    assert_eq!(on("1"), on("2"));
}

#[test]
fn a_theory_that_cannot_be_is_refused() {
    let place = Place::new();
    let refused = |arguments: &[&str], words: &[&str]| {
        place.refused(&[&["theory"], arguments].concat(), words);
    };
    for n in ["3", "41", "-1"] {
        refused(&["--n", n], &["--n", n, "4..=40"]);
    }
    for beta in ["0", "0.09", "1.01", "-1", "NaN"] {
        refused(&["--beta", beta], &["--beta", beta, "from 0.1 to 1"]);
    }
    refused(&["--beta", "high"], &["--beta", "high", "a number"]);
    refused(&["--layers", "0.4"], &["--layers", "0.4", "WEIGHT:BETA"]);
    refused(&["--layers", "0.4:2"], &["--layers", "0.4:2", "from 0.1 to 1"]);
    refused(&["--layers=-1:1"], &["--layers", "-1:1", "weight must be from 0"]);
    refused(&["--layers", "0:1"], &["--layers", "= 0", "above 0"]);
    refused(&["--layers", "1:1", "--beta", "1"], &["--layers", "--beta"]);
    for order in ["1", "41"] {
        refused(&["--max-order", order], &["--max-order", order, "2..=40"]);
    }
    refused(&["--n", "8", "--max-order", "9"], &["--max-order = 9", "at most 8", "52", "N = 8"]);
    refused(&["--max-order", "3,4,5"], &["--max-order = 3,4,5", "each of 2"]);
    refused(&["--pupil", "oval"], &["--pupil", "oval", "circle, annulus"]);
    refused(&["--pupil", "annulus", "--obstruction", "1"], &["obstruction", "1", "0.99"]);
    refused(&["--reconstructor", "best"], &["--reconstructor", "best", "mixed, matched, nominal"]);
    place.write("high.toml", "[laser]\nbeacon_height_m = 3100.0\n");
    let words = ["atmosphere.layers[1].height_m = 3000", "below 2790", "0.9"];
    refused(&["--config", "high.toml"], &words);
    let rows = "[telescope]\nsubapertures = 4\npupil = [\"....\", \".#..\", \"....\", \"....\"]\n";
    place.write("one.toml", rows);
    refused(&["--config", "one.toml"], &["telescope.pupil = 1", "radial order 2"]);
    place.write("file", "");
    refused(&["--out", "file/directory"], &["--out file/directory"]);
}
