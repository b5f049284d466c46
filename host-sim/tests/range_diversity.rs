//! Two gates: what the design expects and what loops under screens come to, what is gained, and that gain errors of the
//! sensor do no harm.

use host_sim::closed_loop::Sensing;
use host_sim::instrument::{Instrument, LaunchName};
use host_sim::monte_carlo::budget::Case;
use host_sim::monte_carlo::comparator::Comparator;
use host_sim::monte_carlo::gates::{Contender, Contest, View};
use host_sim::monte_carlo::point::{Conditions, Point};
use host_sim::monte_carlo::slope_control::SlopeControl;
use host_sim::monte_carlo::statistics::Mean;
use host_sim::pupil::Pupil;
use host_sim::range_diversity::design::{Design, Purpose};
use host_sim::range_diversity::law::Law;

/// The paper's profile, frozen, with the high layer at that height and of that share.
fn point(n: usize, height_m: f64, share: f64) -> Point {
    let mut instrument = Instrument::standard().unwrap();
    let layers = &mut instrument.atmosphere.layers;
    layers.iter_mut().for_each(|layer| layer.wind_speed_m_per_s = 0.0);
    (layers[0].weight, layers[1].weight, layers[1].height_m) = (1.0 - share, share, height_m);
    let sensing = Sensing::Geometric;
    let conditions = Conditions { sensing, noise_free: true, settle: 20, frames: 5, seed: 3 };
    Point::new(&instrument, n, conditions).unwrap()
}

/// For the paper's profile and a gate at half the beacon's height.
fn purpose(noise_rad: [f64; 2]) -> Purpose {
    Purpose::of(&Instrument::standard().unwrap(), 6_000.0, noise_rad)
}

fn splash(name: &str, law: Law) -> Contender {
    Contender { name: name.into(), view: View::Splash, law }
}

/// Variances `[contender][screen]` of f = 1, the best f, `modes` modes, and the fit; and the designs.
fn contest(
    point: &Point,
    noise_rad: [f64; 2],
    modes: usize,
    screens: u32,
) -> (Vec<Vec<f64>>, [Design; 2]) {
    let design = |modes| Design::new(point.pupil(), &purpose(noise_rad), modes, &|_| ()).unwrap();
    let (scalar, gates) = (design(0), design(modes));
    let contenders = [
        splash("splash", Law::scalar(1.0)),
        splash("splash_f", Law::from(&scalar)),
        splash("gates", Law::from(&gates)),
        Contender { name: "fit".into(), view: View::Fit, law: Law::scalar(1.0) },
    ];
    let contest = Contest::new(point, &contenders, 6_000.0, noise_rad).unwrap();
    let mut all = vec![Vec::new(); contenders.len()];
    for screen in 0..screens {
        for (values, outcome) in all.iter_mut().zip(contest.run(screen).unwrap()) {
            values.push(outcome.variance_rad2);
        }
    }
    (all, [scalar, gates])
}

/// Asserts that what is left beyond the fit is what theory expects. Segments of eight samples fit a little better than
/// continuous ones.
fn agree(point: &Point, noise_rad: [f64; 2], screens: u32) -> [f64; 2] {
    let (all, [scalar, gates]) = contest(point, noise_rad, 12, screens);
    let expected = [scalar.null_seeking_rad2, scalar.residual_rad2, gates.residual_rad2];
    for (law, expected) in expected.into_iter().enumerate() {
        let Mean { mean, standard_error } = Mean::of_differences(&all[law], &all[3]);
        let n = point.n();
        println!(
            "N = {n}, {noise_rad:?} rad, {law}: {mean:.4}({standard_error:.4}), {expected:.4}"
        );
        let allowed = 3.0 * standard_error + 0.05 * expected;
        assert!((mean - expected).abs() < allowed, "N = {n}, law {law}: {mean}, not {expected}");
    }
    [scalar.null_seeking_rad2, gates.residual_rad2]
}

/// An error of a sign, of b or of the way back, in theory or in the sensor, is far more than 5 %.
#[test]
fn theory_and_screens_agree() {
    agree(&point(8, 3_000.0, 0.4), [0.0; 2], 60);
    agree(&point(8, 3_000.0, 0.4), [1.0; 2], 30);
    agree(&point(8, 3_000.0, 0.4), [0.2, 2.0], 30);
}

#[test]
fn at_sixteen_subapertures_less_than_half_is_left() {
    let [null, gates] = agree(&point(16, 3_000.0, 0.4), [0.0; 2], 8);
    // Squares with d = r0 cannot fit 0.175 rad^2.
    assert!(gates + 0.175 < 0.5 * (null + 0.175), "{gates} of {null}");
}

/// The design is for the paper's profile throughout.
#[test]
fn two_gates_leave_less_than_one_whatever_the_profile() {
    for (height_m, share) in
        [(3_000.0, 0.4), (4_000.0, 0.4), (2_000.0, 0.4), (3_000.0, 0.3), (3_000.0, 0.5)]
    {
        let (all, _) = contest(&point(8, height_m, share), [0.1; 2], 12, 12);
        let Mean { mean, standard_error } = Mean::of_differences(&all[1], &all[2]);
        println!("{share} at {height_m} m: gain {mean:.4}({standard_error:.4}) rad^2");
        assert!(mean > 3.0 * standard_error, "{share} at {height_m}: {mean} +- {standard_error}");
    }
}

/// One gate with f = 1 is the loop that strehl closes, with beams of any shape.
#[test]
fn one_gate_is_the_loop_of_a_strehl_run() {
    for launch in [LaunchName::Uniform, LaunchName::Gaussian] {
        let mut instrument = point(8, 3_000.0, 0.4).instrument().clone();
        (instrument.laser.launch, instrument.laser.launch_waist_pitches) = (launch, 0.3);
        let conditions = point(8, 3_000.0, 0.4).conditions();
        let point = Point::new(&instrument, 8, conditions).unwrap();
        let case = Case { comparator: Comparator::Splash, until: None };
        let prepared = point.prepare(&[case], &mut |_| ()).unwrap();
        let [(_, expected)] = prepared.run(4, &[case]).unwrap()[..] else { panic!("one case") };
        let contenders = [splash("splash", Law::scalar(1.0))];
        let contest = Contest::new(&point, &contenders, 6_000.0, [0.0; 2]).unwrap();
        let found = contest.run(4).unwrap()[0];
        let apart = found.variance_rad2 / expected.variance_rad2 - 1.0;
        assert!(apart.abs() < 1e-6, "{launch:?}: {found:?} {expected:?}");
    }
}

/// With all turbulence at the ground both gates see the same: nothing is combined but their noise, and the law takes
/// what it sees as it is, but for the part that aliasing and segments have in it.
#[test]
fn turbulence_at_the_ground_needs_no_second_gate() {
    let pupil = Pupil::circular(8, 2, 0.5).unwrap();
    let ground = Purpose { layers: vec![[1.0, 0.0]], ..purpose([0.1; 2]) };
    let design = |modes| Design::new(&pupil, &ground, modes, &|_| ()).unwrap();
    let (one, two) = (design(0), design(12));
    let sum = two.coupling.columns(0, 12) + two.coupling.columns(12, 12);
    let identity = (1.0 - two.lever_arm) * nalgebra::DMatrix::identity(12, 12);
    assert!((sum - identity).amax() < 0.01);
    assert!((two.residual_rad2 / one.residual_rad2 - 1.0).abs() < 0.1);
}

/// s = e (t - c) with e the gain of the gates: c' = (1 - g) c + g L(e t + (1 - e) c). With e = 1 the error shrinks by
/// 1 - g a frame whatever B is, exactly; with e off by 20 %, alike or against each other, it stays bounded and ends at
/// a fixed point.
#[test]
fn the_pole_is_one_less_the_gain_and_gain_errors_stay_bounded() {
    let pupil = Pupil::circular(8, 2, 0.5).unwrap();
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as f64 / (1u64 << 30) as f64 - 1.0
    };
    let mut sky = || -> Vec<[f64; 2]> {
        let mut slopes: Vec<_> = (0..52).map(|_| [random(), random()]).collect();
        for axis in 0..2 {
            let mean = slopes.iter().map(|slope| slope[axis]).sum::<f64>() / 52.0;
            slopes.iter_mut().for_each(|slope| slope[axis] -= mean);
        }
        slopes
    };
    let (first, second) = (sky(), sky());
    let norm =
        |slopes: &[[f64; 2]]| slopes.as_flattened().iter().map(|s| s * s).sum::<f64>().sqrt();
    for modes in [12, 25] {
        let design = Design::new(&pupil, &purpose([0.0; 2]), modes, &|_| ()).unwrap();
        let law = Law::from(&design);
        let mut wanted = vec![[0.0; 2]; 52];
        law.commands(&first, &second, &mut wanted);
        for (gains, delay, frames) in [
            ([1.0, 1.0], 0, 30),
            ([1.0, 1.0], 2, 30),
            ([0.8, 0.8], 0, 400),
            ([1.2, 1.2], 0, 400),
            ([0.8, 1.2], 0, 400),
            ([1.2, 0.8], 0, 400),
        ] {
            let mut control = SlopeControl::new(&pupil, law.clone(), 0.5, delay);
            let mut last = vec![[0.0; 2]; 52];
            for frame in 1..=frames {
                let seen = |sky: &[[f64; 2]], gain: f64| -> Vec<[f64; 2]> {
                    let pairs = sky.iter().zip(control.applied());
                    pairs.map(|(t, c)| [0, 1].map(|axis| gain * (t[axis] - c[axis]))).collect()
                };
                let (mut one, mut two) = (seen(&first, gains[0]), seen(&second, gains[1]));
                last = control.applied().to_vec();
                control.step(&mut one, &mut two);
                let size = norm(control.applied());
                assert!(size < 6.0 * norm(&wanted), "{gains:?}, frame {frame}: {size}");
                if gains == [1.0, 1.0] && frame > usize::from(delay) {
                    // 1 - (1 - g)^k of what the law wants.
                    let share = 1.0 - 0.5f64.powi((frame - usize::from(delay)) as i32);
                    for (found, wanted) in control.applied().iter().zip(&wanted) {
                        for axis in 0..2 {
                            assert!((found[axis] - share * wanted[axis]).abs() < 1e-12);
                        }
                    }
                }
            }
            let moved: Vec<[f64; 2]> = last
                .iter()
                .zip(control.applied())
                .map(|(a, b)| [a[0] - b[0], a[1] - b[1]])
                .collect();
            assert!(norm(&moved) < 1e-6 * norm(&wanted), "{modes} modes, {gains:?}: still moving");
        }
    }
}
