//! Spots that are lit in turn: which, with how much light, and what a loop makes of it.

mod common;

use common::json;
use host_sim::atmosphere::{Atmosphere, Turbulence};
use host_sim::board::in_process;
use host_sim::closed_loop::{ClosedLoop, Run, Sensing};
use host_sim::imager::Imager;
use host_sim::instrument::Instrument;
use host_sim::lighting::Lighting;
use host_sim::monte_carlo::gradient_loop::GradientLoop;
use host_sim::optics::geometric::Sensor;
use host_sim::pupil::Mirror;
use host_sim::reconstructor::Reconstructor;
use std::sync::Arc;

fn parse(toml: &str) -> Instrument {
    let instrument = Instrument::parse(toml, "test").unwrap();
    instrument.check().unwrap();
    instrument
}

fn schedule(lines: &str) -> String {
    format!("[telescope]\nsubapertures = 4\npupil = \"square\"\n[schedule]\n{lines}")
}

#[test]
fn a_colouring_by_name_by_numbers_in_a_list_and_drawn() {
    // ((x - 2 y) mod 5), by hand.
    let expected = [0, 1, 2, 3, 3, 4, 0, 1, 1, 2, 3, 4, 4, 0, 1, 2];
    for lines in [
        "lattice = \"sqrt5\"",
        "lattice = [5, 2, 1]",
        "colours = [0, 1, 2, 3, 3, 4, 0, 1, 1, 2, 3, 4, 4, 0, 1, 2]",
        "colours = [\"0123\", \"3401\", \"1234\", \"4012\"]",
    ] {
        let instrument = parse(&schedule(lines));
        let lighting = Lighting::new(&instrument).unwrap();
        assert_eq!(lighting.colours(), expected, "{lines}");
        assert_eq!(lighting.count(), 5);
        // The firmware knows the same ones.
        in_process(&Reconstructor::new(&instrument).unwrap().spec()).unwrap();
        let written = instrument.to_toml().unwrap();
        assert_eq!(Instrument::parse(&written, "written").unwrap(), instrument);
    }
    // The separations that the names promise are least ones.
    for (name, separation) in [
        ("sqrt2", 2f64.sqrt()),
        ("2", 2.0),
        ("sqrt8", 8f64.sqrt()),
        ("3", 3.0),
        ("sqrt10", 10f64.sqrt()),
    ] {
        let toml = format!("[schedule]\nlattice = {name:?}\nseparation = {separation:?}");
        in_process(&Reconstructor::new(&parse(&toml)).unwrap().spec()).unwrap();
    }
}

#[test]
fn what_is_no_schedule_is_refused() {
    for (lines, words) in [
        ("lattice = \"sqrt6\"", "\"sqrt10\""),
        ("lattice = [5, 2]", "schedule.lattice = [5, 2]: must be [a, b, c]"),
        ("lattice = [9, 1, 8]", "schedule.lattice: a c = 72: must be from 1 to 64"),
        ("lattice = [2, 0, 2]\ncolours = [\"01\"]", "schedule.colours = 1 entries: must be []"),
        ("colours = [0, 1]", "2 numbers: must be one a subaperture, of which there are 16"),
        ("colours = [\"0123\"]", "1 rows of lengths [4]"),
        ("colours = [\"0123\", \"34.1\", \"1234\", \"4012\"]", "\"34.1\": must be 0 to 9"),
        ("power = \"all\"", "per-spot"),
    ] {
        let toml = schedule(lines);
        let error = Instrument::parse(&toml, "test").and_then(|i| i.check()).unwrap_err();
        assert!(error.to_string().contains(words), "{lines}: {error}");
    }
    // Colours without a subaperture are the firmware's to refuse.
    let instrument = parse(&schedule("colours = [\"0202\", \"2020\", \"0202\", \"2020\"]"));
    assert!(in_process(&Reconstructor::new(&instrument).unwrap().spec()).is_err());
}

/// Electrons above the bias in each window of a noise-free frame of still air.
fn seen(instrument: &Instrument, frame: u32) -> Vec<f64> {
    let reconstructor = Reconstructor::new(instrument).unwrap();
    let pupil = instrument.pupil().unwrap();
    let still = Atmosphere::from_screens(Vec::new(), pupil.diameter_m(), 0.0).unwrap();
    let mut imager = Imager::new(&reconstructor, Sensor::Splash, &pupil, &still).unwrap();
    imager.light(frame);
    let mirror = Mirror::flat(pupil.subapertures().len());
    let pixels = imager.expose(&still, 0.0, &mirror, None).unwrap();
    let (side, size) = (instrument.detector_side(), instrument.windows.size);
    let detector = &instrument.detector;
    let electrons = |&[x0, y0]: &[u16; 2]| {
        let window = (0..size * size).map(|k| {
            let place = (usize::from(y0) + k / size) * side + usize::from(x0) + k % size;
            (f64::from(pixels[place]) - detector.bias_adu) * detector.gain_e_per_adu
        });
        window.sum()
    };
    reconstructor.origins().iter().map(electrons).collect()
}

#[test]
fn only_the_colour_of_the_frame_is_lit_and_shares_the_power_if_told_so() {
    // Of 16 spots 6 have colour 0, 10 have colour 1.
    let drawn = "colours = [\"0110\", \"1111\", \"0110\", \"0110\"]\n";
    let lit = |i: usize| [0, 3].contains(&(i % 4)) && i / 4 != 1;
    for (power, shares) in [("per-spot", [1.0, 1.0]), ("shared", [16.0 / 6.0, 16.0 / 10.0])] {
        let toml =
            schedule(&format!("{drawn}power = {power:?}")) + "\n[laser]\nelectrons_per_spot = 2000";
        let instrument = parse(&toml).noise_free();
        let all = seen(&parse(&toml.replace(drawn, "")).noise_free(), 0);
        for frame in [0, 1, 2, 7] {
            for (i, (seen, alone)) in seen(&instrument, frame).iter().zip(&all).enumerate() {
                let on = lit(i) == [0, 2].contains(&frame);
                let share = if on { shares[frame as usize % 2] } else { 0.0 };
                // Each of 256 pixels is rounded to a quarter of an electron, in both frames.
                let rounding = 32.0 * (1.0 + share);
                assert!((seen - alone * share).abs() <= rounding, "{frame}, {i}: {seen}, {alone}");
                assert!(!on || *seen > 1500.0, "{seen}");
            }
        }
    }
}

const GENTLE: &str = "[telescope]\nsubapertures = 6\n[atmosphere]\nr0_m = 1.0\n";

/// Residual variance, rad^2, of loops of exact gradients through the firmware and in f64, after so many
/// frames under the same frozen sky.
fn variances(lines: &str, frames: u32) -> [f64; 2] {
    let mut instrument = parse(&format!("{GENTLE}{lines}"));
    instrument.atmosphere.layers.iter_mut().for_each(|layer| layer.wind_speed_m_per_s = 0.0);
    let pupil = instrument.pupil().unwrap();
    let (r0_m, layers) = (instrument.atmosphere.r0_m, instrument.layers());
    let turbulence =
        Turbulence::new(r0_m, &layers, pupil.diameter_m(), pupil.pitch_m(), 1.0).unwrap();
    let sky = Arc::new(turbulence.realise(11, &mut |_| ()));
    let reconstructor = Reconstructor::new(&instrument).unwrap();
    let mut board = in_process(&reconstructor.spec()).unwrap();
    let (sensor, sensing) = (Sensor::Splash, Sensing::Geometric);
    let run = Run { sensor, sensing, frames, seed: 1, noise_free: true };
    let (board, above) = (board.as_mut(), Arc::clone(&sky));
    let mut closed = ClosedLoop::under(&instrument, &reconstructor, board, run, above).unwrap();
    let mut exact = GradientLoop::new(&instrument, &pupil, &sky, sensor).unwrap();
    let mut last = [0.0; 2];
    for _ in 0..frames {
        let observed = exact.step(&sky, 0.0, true).unwrap();
        last = [closed.step().unwrap().observation.variance_rad2, observed.variance_rad2];
    }
    last
}

/// What a frozen sky is corrected to does not depend on the order in which it is measured, and after a
/// cycle of k frames the tips and tilts are where they are after one frame of all.
#[test]
fn a_loop_lit_in_turn_converges_to_where_the_whole_one_does() {
    let [firmware, exact] = variances("", 40);
    // Rounding to codes, and sweeps in place of a solution, leave this much between the two.
    assert!((firmware - exact).abs() < 2e-3, "{firmware} {exact}");
    for (lines, colours) in [
        ("[schedule]\nlattice = \"sqrt2\"", 2),
        ("[schedule]\nlattice = \"sqrt5\"", 5),
        ("[control]\nlever_arm = 1.1\n[schedule]\nlattice = \"2\"", 4),
    ] {
        let whole = variances(&lines.replace("[schedule]\nlattice", "#"), 40);
        let found = variances(lines, 40 * colours);
        println!("{lines:?}: {found:?}, all at once {whole:?}");
        for (found, whole) in found.iter().zip(whole) {
            assert!((found - whole).abs() < 2e-3, "{lines}: {found} {whole}");
        }
        // The first cycle leaves 1 - g of what there was, where everyone's first mean is that of a part of
        // the pupil.
        let [start, ..] = variances(lines, 1);
        let [cycle, exact] = variances(lines, colours + 1);
        assert!(cycle < 0.6 * start && exact < 0.6 * start, "{start} {cycle} {exact}");
    }
}

#[test]
fn guide_stars_are_not_lit_in_turn() {
    let instrument = parse("[schedule]\nlattice = \"sqrt5\"");
    let count = |sensor| Lighting::new(&instrument.clone().seen_by(sensor)).unwrap().count();
    assert_eq!([Sensor::Splash, Sensor::Lgs, Sensor::Ngs].map(count), [5, 1, 1]);
}

#[test]
fn recorded_frames_are_replayed_in_the_turn_they_were_lit_in() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("five.toml"), "[schedule]\nlattice = \"sqrt5\"").unwrap();
    let run = ["--config", "five.toml", "--n", "4", "--frames", "12"];
    let recorded = json("frames", place.path(), "2", &[&["run.fits"], &run[..]].concat());
    let replayed = json("replay", place.path(), "2", &["run.fits"]);
    assert_eq!(replayed["digest"], recorded["digest"]);
    let closed = json("loop", place.path(), "1", &run);
    assert_eq!(closed["digest"], recorded["digest"]);
    assert_eq!(closed["faults"], serde_json::json!({}));
}
