//! The error budget against equations: a quadratic layer exactly, turbulence within its scatter.

use host_sim::atmosphere::{Atmosphere, Layer, Turbulence};
use host_sim::closed_loop::Sensing;
use host_sim::instrument::Instrument;
use host_sim::monte_carlo::budget::{Step, chain, lever_arm_rad2};
use host_sim::monte_carlo::comparator::Comparator;
use host_sim::monte_carlo::converged::Converged;
use host_sim::monte_carlo::point::{Conditions, Point};
use host_sim::monte_carlo::statistics::Mean;
use host_sim::optics::geometric::{Effects, Sensor};
use host_sim::optics::science::Science;
use host_sim::optics::segment_fit::SegmentFit;
use host_sim::pupil::Mirror;
use host_sim::screen::Screen;

const UP: Effects = Effects { lever_arm: false, return_path: false };
const ARM: Effects = Effects { lever_arm: true, return_path: false };
/// Of the default instrument's high layer, and its share.
const BETA: f64 = 0.75;
const SHARE: f64 = 0.4;

fn still(toml: &str) -> Instrument {
    let mut instrument = Instrument::parse(toml, "test").unwrap();
    instrument.atmosphere.layers.iter_mut().for_each(|layer| layer.wind_speed_m_per_s = 0.0);
    instrument
}

fn point(toml: &str, n: usize, sensing: Sensing, noise_free: bool) -> Point {
    let conditions = Conditions { sensing, noise_free, settle: 40, frames: 2, seed: 3 };
    Point::new(&still(toml), n, conditions).unwrap()
}

/// Of a layer with phase a (x^2 + y^2) the mean gradient over any square is that at its centre. The beams of
/// SPLASH see it whole, times b with the lever arm, times b (1 - (1 - b)) = b^2 with the return path; a laser
/// guide star sees b of it without the lever arm and b^2 with. The pistons of linear gradients are exact. So with
/// s seen of what a natural star shows, the mirror lacks 1 - s of its shape m: with the fitting error F,
/// V = F + (1 - s)^2 <m^2>, as that is orthogonal to m.
#[test]
fn a_quadratic_layer() {
    let instrument = still("");
    let pupil = instrument.pupil().unwrap();
    let layer = Layer {
        weight: 1.0,
        height_m: (1.0 - BETA) * instrument.laser.beacon_height_m,
        wind_speed_m_per_s: 0.0,
        wind_direction_deg: 0.0,
    };
    let bowl = Screen::from_fn([6.0; 2], 0.03125, |x, y| 0.7 * (x * x + y * y)).unwrap();
    let sky = Atmosphere::from_screens(vec![(layer, bowl)], 4.0, 0.0).unwrap();
    let mut star = Science::new(&pupil, &sky, 1.0, 1.0).unwrap();
    let mut mirror = Mirror::flat(pupil.subapertures().len());
    let whole = star.observe(&sky, 0.0, &mirror).variance_rad2;
    SegmentFit::default().fit(&pupil, &sky, 0.0, &mut mirror);
    let fitting = star.observe(&sky, 0.0, &mirror).variance_rad2;
    let shape = whole - fitting;
    for (sensor, effects, lever_arm, seen) in [
        (Sensor::Ngs, Effects::ALL, 1.0, 1.0),
        (Sensor::Splash, UP, 1.0, 1.0),
        (Sensor::Splash, ARM, 1.0, BETA),
        (Sensor::Splash, Effects::ALL, 1.0, BETA * BETA),
        (Sensor::Splash, Effects::ALL, 1.2, 1.2 * BETA * BETA),
        (Sensor::Lgs, UP, 1.0, BETA),
        (Sensor::Lgs, ARM, 1.0, BETA * BETA),
        (Sensor::Lgs, Effects::ALL, 1.0, BETA * BETA),
    ] {
        let mut run =
            Converged::new(&instrument, &pupil, &sky, sensor, effects, lever_arm).unwrap();
        let variance = run.observe(&sky, 0.0).variance_rad2;
        let expected = fitting + (1.0 - seen).powi(2) * shape;
        // Single precision of phases of 7 rad.
        let differ = (variance - expected).abs();
        assert!(differ < 1e-5 * shape, "{sensor:?}, {effects:?}: {variance}, not {expected}");
    }
}

/// Noll's 0.134 (D/r0)^(5/3) of the high layer, times its share and (1 - b)^2: 0.00335 (D/r0)^(5/3).
#[test]
fn the_lever_arm_by_theory() {
    let found = lever_arm_rad2(&still(""), 8.0);
    assert!((found - 0.003_35 * 8f64.powf(5.0 / 3.0)).abs() < 1e-9, "{found}");
    // Twice the wavelength, half the phase.
    let red = lever_arm_rad2(&still("[science]\nwavelength_m = 1064e-9"), 8.0);
    assert!((red - found / 4.0).abs() < 1e-9, "{red}");
}

/// N = 16, d = r0: fitting 0.1704 rad^2 on 8 samples per segment; the lever arm 0.00335 (D/r0)^(5/3), and the laser
/// guide star's cone with it 0.0202 (D/r0)^(5/3), less what segments do not follow of the layer.
#[test]
fn turbulence_by_theory() {
    const SCREENS: u64 = 60;
    let mut instrument = still("");
    instrument.telescope.subapertures = 16;
    let pupil = instrument.pupil().unwrap();
    let power = 16f64.powf(5.0 / 3.0);
    let turbulence = Turbulence::new(0.5, &instrument.layers(), 8.0, 0.5, 0.0).unwrap();
    let mut values: [Vec<f64>; 5] = Default::default();
    for seed in 0..SCREENS {
        let sky = turbulence.realise(seed, &mut |_| ());
        let observe = |sensor, effects| {
            let run = Converged::new(&instrument, &pupil, &sky, sensor, effects, 1.0);
            run.unwrap().observe(&sky, 0.0).variance_rad2
        };
        let high = sky.screens().nth(1).unwrap().clone();
        let high = Atmosphere::from_screens(vec![(instrument.layers()[1], high)], 8.0, 0.0);
        let high = high.unwrap();
        let mut mirror = Mirror::flat(pupil.subapertures().len());
        let layer = Science::new(&pupil, &high, 1.0, 1.0).unwrap().observe(&high, 0.0, &mirror);
        SegmentFit::default().fit(&pupil, &sky, 0.0, &mut mirror);
        let fit = Science::new(&pupil, &sky, 1.0, 1.0).unwrap().observe(&sky, 0.0, &mirror);
        let aliasing = observe(Sensor::Ngs, Effects::ALL);
        let cone = observe(Sensor::Splash, UP);
        let new = [
            fit.variance_rad2,
            cone - fit.variance_rad2,
            observe(Sensor::Splash, ARM) - cone,
            (1.0 - BETA).powi(2) * layer.variance_rad2,
            observe(Sensor::Lgs, ARM) - aliasing,
        ];
        values.iter_mut().zip(new).for_each(|(values, new)| values.push(new));
    }
    let [fitting, sensing, arm, layer, lgs] = [0, 1, 2, 3, 4].map(|k| Mean::of(&values[k]));
    let difference = Mean::of_differences(&values[2], &values[3]);
    println!("fitting {fitting:?}\naliasing and cone {sensing:?}\nlever arm {arm:?}");
    println!("(1 - b)^2 of the layer {layer:?}\nlever arm less this {difference:?}\nLGS {lgs:?}");
    println!("0.00335 (D/r0)^(5/3) = {}, 0.0202: {}", 0.003_35 * power, 0.0202 * power);
    let within = |found: Mean, expected: f64, low: f64, high: f64| {
        let error = 3.0 * found.standard_error;
        (expected - low - error..=expected + high + error).contains(&found.mean)
    };
    assert!(within(fitting, 0.1704, 0.0, 0.0), "{fitting:?}");
    // Noll's circle has the area of 201 of the 208 squares: up to 3 % less.
    assert!(within(layer, 0.003_35 * power, 0.0, 0.03 * 0.003_35 * power), "{layer:?}");
    // What is sensed is not all that is there: its error e, and the gradients' of the part that is missed, come
    // in with 2 (1 - b) <e^2> at most.
    let cross = 2.0 * (1.0 - BETA) * SHARE * (fitting.mean + sensing.mean);
    assert!(within(difference, 0.0, cross, cross), "{difference:?}, {cross}");
    // Of the layer and of its image magnified by 1/b, segments follow neither what is too fine nor what they alias.
    let fine = SHARE * (1.0 + BETA.powf(5.0 / 3.0)) * (fitting.mean + sensing.mean);
    assert!(within(lgs, 0.0202 * power, fine, 0.0), "{lgs:?}, {fine}");
}

/// Only effects that a run has are steps, the last is the run itself, and each run is where it should be.
#[test]
fn chains_end_at_the_run() {
    use Step::*;
    let steps = |point: &Point, comparator| -> Vec<Step> {
        let chain = chain(point, comparator);
        if let Some(&(_, last)) = chain.last() {
            assert_eq!(last, comparator.into());
        }
        chain.into_iter().map(|(step, _)| step).collect()
    };
    let images = point("", 4, Sensing::Images, true);
    let firmware = [Temporal, Quantisation, Images];
    let begin = [Fitting, Aliasing];
    let all = |middle: &[Step]| [&begin, middle, &firmware].concat();
    assert_eq!(steps(&images, Comparator::Splash), all(&[Cone, LeverArm, ReturnPath]));
    assert_eq!(steps(&images, Comparator::Lgs), all(&[Cone, LeverArm]));
    assert_eq!(steps(&images, Comparator::Ngs), all(&[]));
    assert!(steps(&images, Comparator::Fit).is_empty());
    let noisy = point("", 4, Sensing::Images, false);
    assert_eq!(steps(&noisy, Comparator::Lgs).last(), Some(&Noise));
    let ground = "[[atmosphere.layers]]\nweight = 1\nheight_m = 0\nwind_speed_m_per_s = 1\n\
                  wind_direction_deg = 0";
    let ground = point(ground, 4, Sensing::Geometric, true);
    assert_eq!(steps(&ground, Comparator::Splash), [Fitting, Aliasing, Temporal]);
    let stronger = point("[control]\nlever_arm = 1.1", 4, Sensing::Geometric, true);
    assert_eq!(steps(&stronger, Comparator::Ngs), [Fitting, Aliasing, LeverArm, Temporal]);
}

/// A loop that had its time under a sky that stands still is where it converges to; one whose sky moves lags.
#[test]
fn time_matters_only_if_something_moves() {
    let run = |wind: f64| {
        let mut instrument = still("[control]\nlever_arm = 1.1");
        for layer in &mut instrument.atmosphere.layers {
            layer.wind_speed_m_per_s = wind;
        }
        let conditions = Conditions {
            sensing: Sensing::Geometric,
            noise_free: true,
            settle: 40,
            frames: 20,
            seed: 3,
        };
        let point = Point::new(&instrument, 6, conditions).unwrap();
        let chain = chain(&point, Comparator::Splash);
        let cases: Vec<_> = chain.iter().map(|&(_, case)| case).collect();
        let prepared = point.prepare(&cases, &mut |_| ()).unwrap();
        let outcomes = prepared.run(0, &cases).unwrap();
        let [.., (_, converged), (_, run)] = outcomes[..] else { panic!("{outcomes:?}") };
        run.variance_rad2 - converged.variance_rad2
    };
    // 0.5^40 of a few rad^2.
    assert!(run(0.0).abs() < 1e-9, "{}", run(0.0));
    let (slow, fast) = (run(62.5), run(125.0));
    // An eighth of a subaperture a frame: a lag of two frames moves 0.25 d, and 6.88 (0.25)^(5/3) is 0.68 rad^2
    // of a wavefront that is not corrected; at twice the speed it lags more.
    assert!(slow > 0.02 && slow < 0.68 && fast > 1.5 * slow, "{slow} {fast}");
}
