//! The parts of the Monte Carlo runs: pistons, the loop of gradients, the best fit, the checkpoint.

use host_sim::atmosphere::{Atmosphere, Layer, Turbulence};
use host_sim::board::in_process;
use host_sim::closed_loop::{ClosedLoop, Run, Sensing};
use host_sim::instrument::Instrument;
use host_sim::monte_carlo::budget::{Case, Step};
use host_sim::monte_carlo::checkpoint::Checkpoint;
use host_sim::monte_carlo::comparator::Comparator;
use host_sim::monte_carlo::gradient_loop::GradientLoop;
use host_sim::monte_carlo::pistons::Pistons;
use host_sim::monte_carlo::point::Outcome;
use host_sim::optics::geometric::Sensor;
use host_sim::optics::science::Science;
use host_sim::optics::segment_fit::SegmentFit;
use host_sim::pupil::{Mirror, Pupil};
use host_sim::reconstructor::Reconstructor;
use host_sim::screen::Screen;
use std::sync::Arc;

const STILL: Layer =
    Layer { weight: 1.0, height_m: 0.0, wind_speed_m_per_s: 0.0, wind_direction_deg: 0.0 };

/// The trapezoid rule is exact for gradients that are linear: the pistons of a quadratic surface are its
/// values at the centres, less their mean over each part of the pupil.
#[test]
fn pistons_of_a_quadratic_surface() {
    let square = Pupil::square(3, 8, 0.5).unwrap();
    let circle = Pupil::circular(20, 8, 0.5).unwrap();
    // Two parts: columns 0 and 1, columns 3 and 4.
    let parts = Pupil::new(5, 8, 0.5, (0..25).map(|k| k % 5 != 2).collect()).unwrap();
    for (pupil, part_of) in [
        (square, (|_| 0) as fn([usize; 2]) -> usize),
        (circle, |_| 0),
        (parts, |[ix, _]| usize::from(ix > 2)),
    ] {
        let surface = |x: f64, y: f64| 3.0 * x * x - 2.0 * x * y + 0.7 * y * y + 5.0 * x - y;
        let half = pupil.pitch_m() / 2.0;
        let at = |&[ix, iy]: &[usize; 2]| [pupil.centre_m(ix), pupil.centre_m(iy)];
        let places: Vec<_> = pupil.subapertures().iter().map(at).collect();
        let tilts: Vec<_> = places
            .iter()
            .map(|&[x, y]| [half * (6.0 * x - 2.0 * y + 5.0), half * (1.4 * y - 2.0 * x - 1.0)])
            .collect();
        let mut expected: Vec<f64> = places.iter().map(|&[x, y]| surface(x, y)).collect();
        let parts: Vec<usize> = pupil.subapertures().iter().map(|&cell| part_of(cell)).collect();
        for part in [0, 1] {
            let here = || parts.iter().enumerate().filter(|(_, p)| **p == part).map(|(i, _)| i);
            let mean = here().map(|i| expected[i]).sum::<f64>() / here().count().max(1) as f64;
            here().collect::<Vec<_>>().into_iter().for_each(|i| expected[i] -= mean);
        }
        let mut pistons = Pistons::new(&pupil);
        for round in 0..2 {
            let found = pistons.solve(&tilts);
            let differ = found.iter().zip(&expected).map(|(a, b)| (a - b).abs());
            let worst = differ.fold(0.0, f64::max);
            assert!(worst < 1e-7, "N = {}, round {round}: {worst}", pupil.across());
        }
    }
}

/// A plane is fitted exactly; random turbulence with d = r0 leaves 0.175 rad^2 less what 8 samples do not
/// see, 0.1704.
#[test]
fn the_best_fit() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let mut mirror = Mirror::flat(52);
    let mut fit = SegmentFit::default();
    let plane = Screen::from_fn([5.0; 2], 0.03125, |x, y| 2.0 * x - 3.0 * y + 0.5).unwrap();
    let sky = Atmosphere::from_screens(vec![(STILL, plane)], 4.0, 0.0).unwrap();
    fit.fit(&pupil, &sky, 0.0, &mut mirror);
    for (&[ix, iy], &[piston, tip, tilt]) in pupil.subapertures().iter().zip(&mirror.segments) {
        let expected = 2.0 * pupil.centre_m(ix) - 3.0 * pupil.centre_m(iy) + 0.5;
        assert!((piston - expected).abs() < 1e-5, "piston {piston}, expected {expected}");
        assert!((tip - 0.5).abs() < 1e-5 && (tilt + 0.75).abs() < 1e-5, "{tip} {tilt}");
    }
    let turbulence = Turbulence::new(0.5, &[STILL], 4.0, 0.5, 0.0).unwrap();
    let mut variance = 0.0;
    const SKIES: u64 = 20;
    for seed in 0..SKIES {
        let sky = turbulence.realise(seed, &mut |_| ());
        let mut science = Science::new(&pupil, &sky, 1.0, 1.0).unwrap();
        fit.fit(&pupil, &sky, 0.0, &mut mirror);
        variance += science.observe(&sky, 0.0, &mirror).variance_rad2 / SKIES as f64;
    }
    println!("fitting error {variance:.4} rad^2");
    // 52 segments in 20 skies scatter by 2 %.
    assert!((variance - 0.1704).abs() < 0.008, "{variance}");
}

/// The firmware fed with gradients and the loop in double precision: same law, same sky. They differ by the
/// firmware's sweeps, which are not run to the end, and by its rounding.
#[test]
fn the_loop_of_gradients_equals_the_firmware() {
    const FRAMES: u32 = 40;
    for (control, moving) in [("delay_frames = 0", 0.0), ("delay_frames = 1\nlever_arm = 1.1", 1.0)]
    {
        for sensor in [Sensor::Splash, Sensor::Lgs, Sensor::Ngs] {
            let toml = format!("[control]\ngain = 0.4\n{control}");
            let mut instrument = Instrument::parse(&toml, "test").unwrap().noise_free();
            for layer in &mut instrument.atmosphere.layers {
                layer.wind_speed_m_per_s *= moving;
            }
            let reconstructor = Reconstructor::new(&instrument).unwrap();
            let mut board = in_process(&reconstructor.spec()).unwrap();
            let pupil = instrument.pupil().unwrap();
            let duration_s = f64::from(FRAMES) * instrument.frame_s();
            let layers = instrument.layers();
            let sky = Atmosphere::new(0.5, &layers, 4.0, 0.5, duration_s, 3).unwrap();
            let sky = Arc::new(sky);
            let sensing = Sensing::Geometric;
            let run = Run { sensor, sensing, frames: FRAMES, seed: 3, noise_free: true };
            let board = board.as_mut();
            let mut firmware =
                ClosedLoop::under(&instrument, &reconstructor, board, run, Arc::clone(&sky))
                    .unwrap();
            let mut exact = GradientLoop::new(&instrument, &pupil, &sky, sensor).unwrap();
            let mut worst = [0.0_f64; 2];
            for frame in 0..FRAMES {
                let time_s = f64::from(frame) * instrument.frame_s();
                let a = firmware.step().unwrap().observation.strehl;
                let b = exact.step(&sky, time_s, true).unwrap().strehl;
                let settled = usize::from(frame >= 20);
                worst[settled] = worst[settled].max((a - b).abs());
            }
            println!("{sensor:?}, {control:?}: Strehl ratios differ by {worst:.5?}");
            assert!(worst[1] < 0.003, "{sensor:?}, {control}: {worst:?}");
        }
    }
}

#[test]
fn finished_screens_are_kept_to_the_bit() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("screens.csv");
    let outcome = |k: u32| Outcome { strehl: 0.1 / f64::from(k + 3), variance_rad2: 1e-7 / 3.0 };
    let mut checkpoint = Checkpoint::open(&path).unwrap();
    assert!(checkpoint.finished().is_empty());
    for screen in [4, 1] {
        let cone = Case { comparator: Comparator::Splash, until: Some(Step::Cone) };
        let both = [(Comparator::Splash.into(), outcome(screen)), (cone, outcome(screen + 1))];
        checkpoint.add(screen, &both).unwrap();
    }
    let known = checkpoint.finished().clone();
    drop(checkpoint);
    // Interrupted in the middle of a line.
    let mut text = std::fs::read_to_string(&path).unwrap();
    text.push_str("7,splash,0.5");
    std::fs::write(&path, text).unwrap();
    let mut checkpoint = Checkpoint::open(&path).unwrap();
    assert_eq!(checkpoint.finished(), &known);
    assert_eq!(known[&(4, Comparator::Splash.into())], outcome(4));
    checkpoint.add(7, &[(Comparator::Lgs.into(), outcome(7))]).unwrap();
    drop(checkpoint);
    let checkpoint = Checkpoint::open(&path).unwrap();
    assert_eq!(checkpoint.finished().len(), 5);
    assert_eq!(checkpoint.finished()[&(7, Comparator::Lgs.into())], outcome(7));
    std::fs::write(&path, "1,splash,0.5,0.1\n2,lidar,0.5,0.1\n").unwrap();
    let error = Checkpoint::open(&path).unwrap_err();
    assert_eq!(error.exit_code(), 1);
    let error = error.to_string();
    assert!(error.contains("line 2") && error.contains("lidar"), "{error}");
}
