//! The rules of `[safety]` in a simulated loop.

mod common;

use common::json;
use host_sim::board::{Board, in_process};
use host_sim::closed_loop::{ClosedLoop, Run, Sensing};
use host_sim::instrument::Instrument;
use host_sim::optics::geometric::Sensor;
use host_sim::reconstructor::Reconstructor;
use splash_firmware::fault::NAMES;
use splash_firmware::mode::Mode;

/// The codes of each frame, the mode at the end and the faults that were booked.
type Ran = (Vec<Vec<[u16; 3]>>, Mode, Vec<(&'static str, u32)>);

/// A loop of exact gradients with this description.
fn codes(toml: &str, frames: u32, operated: bool) -> Ran {
    let instrument = Instrument::parse(toml, "test").unwrap();
    let reconstructor = Reconstructor::new(&instrument).unwrap();
    let mut board: Box<dyn Board + Send> = in_process(&reconstructor.spec()).unwrap();
    let (sensor, sensing) = (Sensor::Splash, Sensing::Geometric);
    let run = Run { sensor, sensing, frames, seed: 3, noise_free: true };
    let board = board.as_mut();
    let mut closed = ClosedLoop::new(&instrument, &reconstructor, board, run, &mut |_| ()).unwrap();
    let mut all = Vec::new();
    for _ in 0..frames {
        if operated {
            closed.operate().unwrap();
        }
        closed.step().unwrap();
        all.push(closed.board().codes().to_vec());
    }
    let standing = closed.standing().unwrap();
    let booked = NAMES.into_iter().zip(standing.faults).filter(|(_, count)| *count > 0);
    (all, standing.mode, booked.collect())
}

#[test]
fn without_a_fault_the_codes_are_those_of_the_frame_path() {
    for toml in ["[telescope]\nsubapertures = 6", "[control]\ndelay_frames = 2\nlever_arm = 1.1"] {
        let (expected, mode, _) = codes(toml, 30, false);
        assert_eq!(mode, Mode::Safe, "no controller was asked");
        let (found, mode, faults) = codes(toml, 30, true);
        assert_eq!((mode, faults), (Mode::ClosedLoop, vec![]));
        assert!(found == expected, "{toml}");
    }
}

/// The light of every frame is half of what is asked for: two frames are held, three leak, and the sixth ends
/// the loop. The mirror was flat all the while.
#[test]
fn frames_without_enough_light_climb_the_ladder() {
    let toml = "[safety]\nflux_min = 2\nflux_max = 5\nhold_frames = 2\nsafe_frames = 5";
    let (found, mode, faults) = codes(toml, 9, true);
    assert_eq!(mode, Mode::Safe);
    assert_eq!(faults, [("total_flux", 9), ("frames_lost", 1)]);
    assert!(found.iter().all(|codes| codes == &found[0]));
    // As many as are borne: one frame less.
    let (_, mode, faults) = codes(toml, 5, true);
    assert_eq!((mode, faults), (Mode::ClosedLoop, vec![("total_flux", 5)]));
}

/// A mirror that has too little stroke: the loop opens after so many frames with too many actuators at their
/// limits, and ramps to flat.
#[test]
fn saturation_that_lasts_opens_the_loop() {
    let toml = "[mirror]\nstroke_m = 0.4e-6\nslew_m_per_frame = 0.4e-6\n\
                [safety]\nsaturated_share = 0.02\nsaturated_frames = 10";
    let (found, mode, faults) = codes(toml, 40, true);
    assert_eq!((mode, faults), (Mode::OpenLoop, vec![("actuators_saturated", 1)]));
    let (first, last) = (&found[0], &found[39]);
    let flat = |codes: &Vec<[u16; 3]>| codes.iter().all(|codes| codes == &codes_of_flat(codes));
    assert!(!flat(first) && flat(last));
}

/// All actuators of the flat map are at the middle of the stroke.
fn codes_of_flat(codes: &[u16; 3]) -> [u16; 3] {
    [codes[0]; 3]
}

#[test]
fn spots_lit_in_turn_are_seen_once_before_the_loop_is_closed() {
    let toml = "[schedule]\nlattice = \"sqrt10\"";
    let (found, mode, faults) = codes(toml, 25, true);
    assert_eq!((mode, faults), (Mode::ClosedLoop, vec![]));
    assert!(found[..10].iter().all(|codes| codes == &found[0]), "standby");
    assert!(found[10] != found[9]);
}

#[test]
fn the_command_reports_what_the_controller_booked() {
    let place = tempfile::tempdir().unwrap();
    let toml = "[safety]\nflux_min = 2\nhold_frames = 1\nsafe_frames = 3";
    std::fs::write(place.path().join("dim.toml"), toml).unwrap();
    let run = ["--config", "dim.toml", "--n", "4", "--frames", "8", "--settle", "2"];
    let found = json("loop", place.path(), "1", &run);
    assert_eq!(found["faults"], serde_json::json!({ "total_flux": 8, "frames_lost": 1 }));
}
