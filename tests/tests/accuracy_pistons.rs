//! Pistons against exact least squares, and the relaxation that finds them.

use std::f64::consts::{PI, TAU};

use splash_firmware::config::Config;
use splash_firmware::fixed::{PISTON_LIMIT, TILT_LIMIT};
use splash_firmware::geometry::{Grid, Mask};
use splash_firmware::pipeline::Pipeline;
use splash_firmware::redblack::{Place, RedBlack};
use splash_firmware::sor::Sor;
use splash_firmware::spec::SorSpec;
use splash_tests::frames::{self, Rng};
use splash_tests::instrument::{Instrument, ULP_PER_LSB, Values, WAVELENGTH_M, step};
use splash_tests::twin::pistons::Pupil;
use splash_tests::{largest, rms, with_big_stack};

/// Capacities of 40 x 40 subapertures with the smallest windows.
const CELLS: usize = 1600;
type Bank = Config<CELLS, { CELLS * 16 }, 0>;
type Path = Pipeline<CELLS, 0>;

/// What rounding leaves of pistons at most, limit cycles included, up to N = 40: the library says so.
const ROUNDING_LSB: f64 = 0.06;

/// The solver by itself, on the mask of a configuration.
struct Solver {
    config: Box<Bank>,
    grid: Grid,
    cells: Vec<(usize, usize)>,
    sor: Box<Sor<CELLS>>,
    field: Box<RedBlack<[i32; 2], CELLS>>,
}

impl Solver {
    fn new(mask: Mask) -> Self {
        Self {
            config: Instrument::ideal(mask, 4).config(),
            grid: Grid::new(mask.across()),
            cells: mask.cells().collect(),
            sor: Box::default(),
            field: Box::new(RedBlack::new([0; 2])),
        }
    }

    /// Loads tips and tilts, ulp, and relaxes.
    fn relax(&mut self, tilts: &[[i32; 2]], sweeps: u16) {
        for (&(x, y), &tilts) in self.cells.iter().zip(tilts) {
            let place = Place::new::<CELLS>(self.grid.node(x, y));
            *self.field.get_mut(place).expect("on the grid") = tilts;
        }
        self.sor.load(self.config.solver(), &self.field);
        self.sor.relax(self.config.solver(), sweeps);
    }

    fn remove_means(&mut self) {
        self.sor.remove_means(self.config.solver(), self.config.nodes());
    }

    fn pistons(&self) -> Vec<f64> {
        self.config.nodes().iter().map(|&node| f64::from(self.sor.piston(node))).collect()
    }
}

fn floats(tilts: &[[i32; 2]]) -> Vec<[f64; 2]> {
    tilts.iter().map(|tilt| tilt.map(f64::from)).collect()
}

fn random_tilts(mask: &Mask, size: i32, rng: &mut Rng) -> Vec<[i32; 2]> {
    (0..mask.count()).map(|_| [0; 2].map(|_: i32| rng.between(-size, size))).collect()
}

/// A circle with one cell in `rarity` missing, at random.
fn holed(across: usize, rarity: u32, seed: u64) -> Mask {
    let mut rng = Rng::new(seed);
    circle(across).without(|_, _| rng.below(rarity) == 0)
}

fn circle(across: usize) -> Mask {
    Mask::circle(across).expect("4 to 40")
}

fn annulus(across: usize) -> Mask {
    Mask::annulus(across, 0.3).expect("4 to 40")
}

/// Masks of many kinds: circles of every size, the others of a few.
fn masks() -> Vec<(String, Mask)> {
    let circles = (4..=40).map(|n| (format!("circle {n}"), circle(n)));
    let others = [4, 5, 7, 8, 11, 16, 21, 32, 40].into_iter().flat_map(|n| {
        [
            (format!("square {n}"), Mask::square(n).expect("4 to 40")),
            (format!("annulus {n}"), annulus(n)),
            (format!("spider {n}"), circle(n).with_spider()),
            (format!("annulus with spider {n}"), annulus(n).with_spider()),
            (format!("one in ten missing {n}"), holed(n, 10, n as u64)),
            (format!("one in three missing {n}"), holed(n, 3, n as u64)),
        ]
    });
    circles.chain(others).filter(|(_, mask)| mask.count() > 0).collect()
}

/// Piston error beyond exact least squares, ulp, for random tilts of a tenth of a wave.
#[test]
fn solver_converges_to_least_squares() {
    let mut worst = (0.0, String::new());
    with_big_stack(|| {
        for (name, mask) in masks() {
            let (mut solver, pupil) = (Solver::new(mask), Pupil::new(&mask));
            let mut rng = Rng::new(31);
            for _ in 0..3 {
                let tilts = random_tilts(&mask, 223_000, &mut rng);
                solver.relax(&tilts, 1000);
                solver.remove_means();
                let exact = pupil.least_squares(&floats(&tilts));
                let errors = solver.pistons().into_iter().zip(&exact).map(|(p, e)| p - e);
                let error = largest(errors);
                if error > worst.0 {
                    worst = (error, name.clone());
                }
                assert!(error <= ROUNDING_LSB * ULP_PER_LSB, "{name}: {error} ulp");
            }
        }
    });
    println!("solver: largest error {:.0} ulp = {:.2} LSB ({})", worst.0, worst.0 / 512.0, worst.1);
}

/// The same through the whole path: commands and pistons as the pipeline reports them, with the
/// sweeps that are the default, after 200 frames of one scene.
#[test]
fn pipeline_converges_to_least_squares() {
    let mut worst = (0.0, String::new());
    with_big_stack(|| {
        for (name, mask) in masks() {
            let mut instrument = Instrument::ideal(mask, 4);
            // Ten nanometres per pixel: the largest pupils stay within their stroke.
            instrument.slope_gain_m_per_px = Values::Uniform([[1e-8, 0.0], [0.0, 1e-8]]);
            let config: Box<Bank> = instrument.config();
            let mut path = Box::new(Path::new());
            let mut rng = Rng::new(32);
            let half = 3 << 15;
            let centroid = |_| Some([0; 2].map(|_: i32| rng.between(-half, half)));
            let centroids: Vec<_> = (0..mask.count()).map(centroid).collect();
            let frame = frames::steered(&instrument, centroids, 60_000);
            let centred = vec![Some([0; 2]); mask.count()];
            let still = frames::steered(&instrument, centred, 60_000);
            let mut saturated = 0;
            // Two frames set the commands; the others see that these are right.
            for number in 0..200 {
                let seen = if number < 2 { &frame } else { &still };
                saturated += step(&mut path, &config, number, seen).saturated_actuators;
            }
            assert_eq!(saturated, 0, "{name}: the stroke is enough");
            let pupil = Pupil::new(&mask);
            let exact = pupil.least_squares(&floats(path.commands()));
            let found = path.positions().iter().map(|p| f64::from(p.piston_ulp));
            let error = largest(found.zip(&exact).map(|(p, e)| p - e));
            if error > worst.0 {
                worst = (error, name.clone());
            }
            assert!(error <= ROUNDING_LSB * ULP_PER_LSB, "{name}: {error} ulp");
            assert!(rms(exact) > 10.0 * ULP_PER_LSB || mask.count() < 12, "{name}");
        }
    });
    println!(
        "pipeline: largest error {:.0} ulp = {:.2} LSB ({})",
        worst.0,
        worst.0 / 512.0,
        worst.1
    );
}

/// Random tilts at their largest: every sum of the solver is at its bound, and what it reports is
/// the residual of what it holds. (The pistons of such tilts are far beyond any stroke.)
#[test]
fn largest_tilts_stay_within_bounds() {
    with_big_stack(|| {
        let mut rng = Rng::new(33);
        for across in [4, 9, 16, 40] {
            let mask = circle(across);
            let (mut solver, pupil) = (Solver::new(mask), Pupil::new(&mask));
            for round in 0..20 {
                let tilts: Vec<[i32; 2]> = mask
                    .cells()
                    .map(|(x, y)| match round % 4 {
                        0 => [TILT_LIMIT; 2],
                        1 => [x, y].map(|a| TILT_LIMIT * (1 - 2 * (a as i32 & 1))),
                        2 => [x, y].map(|a| if 2 * a < across { TILT_LIMIT } else { -TILT_LIMIT }),
                        _ => [0; 2].map(|_: i32| TILT_LIMIT * (2 * rng.between(0, 1) - 1)),
                    })
                    .collect();
                solver.relax(&tilts, 50);
                check_residual(&solver, &pupil, &tilts);
                solver.remove_means();
                assert!(largest(solver.pistons()) <= f64::from(PISTON_LIMIT));
            }
        }
    });
}

/// `residual_squared` against sum (r >> 3)^2 with r from the solver's own pistons, in halves of an ulp.
fn check_residual(solver: &Solver, pupil: &Pupil, tilts: &[[i32; 2]]) {
    let rhs = pupil.divergence(&floats(tilts));
    let nodes = solver.config.nodes().iter();
    let pistons: Vec<_> =
        nodes.map(|&node| f64::from(solver.sor.doubled_piston(node)) / 2.0).collect();
    let image = pupil.laplacian(&pistons);
    let eighths = rhs.iter().zip(&image).map(|(b, lp)| ((b - lp) / 8.0).floor() as i64);
    let exact: u64 = eighths.map(|r| (r * r) as u64).sum();
    assert_eq!(solver.sor.residual_squared(solver.config.solver()), exact);
}

/// After few sweeps, so that there is a residual; the mean of the pistons does not change it.
#[test]
fn residual_is_that_of_the_laplacian() {
    with_big_stack(|| {
        let mut rng = Rng::new(34);
        for (name, mask) in masks() {
            let (mut solver, pupil) = (Solver::new(mask), Pupil::new(&mask));
            for sweeps in [1, 3, 10] {
                let tilts = random_tilts(&mask, 1 << 19, &mut rng);
                solver.relax(&tilts, sweeps);
                check_residual(&solver, &pupil, &tilts);
                let before = solver.sor.residual_squared(solver.config.solver());
                solver.remove_means();
                let after = solver.sor.residual_squared(solver.config.solver());
                assert_eq!(before, after, "{name}");
            }
        }
    });
}

/// The report's residual, from the pipeline's commands and pistons, which it tells in whole ulps.
#[test]
fn reported_residual_is_that_of_commands_and_pistons() {
    with_big_stack(|| {
        for across in [4, 8, 13] {
            let mask = annulus(across);
            let pupil = Pupil::new(&mask);
            let mut instrument = Instrument::ideal(mask, 4);
            instrument.slope_gain_m_per_px = Values::Uniform([[1e-8, 0.0], [0.0, 1e-8]]);
            instrument.sor =
                SorSpec { sweeps: Some(1), cold_sweeps: Some(2), ..SorSpec::default() };
            let config: Box<Bank> = instrument.config();
            let mut path = Box::new(Path::new());
            let mut rng = Rng::new(35);
            for number in 0..20 {
                let centroid = |_| Some([0; 2].map(|_: i32| rng.between(-1 << 16, 1 << 16)));
                let centroids: Vec<_> = (0..mask.count()).map(centroid).collect();
                let frame = frames::steered(&instrument, centroids, 60_000);
                let report = step(&mut path, &config, number, &frame);
                assert_eq!(report.saturated_actuators, 0);
                let pistons: Vec<_> =
                    path.positions().iter().map(|p| f64::from(p.piston_ulp)).collect();
                let rhs = pupil.divergence(&floats(path.commands()));
                let image = pupil.laplacian(&pistons);
                // Half an ulp that a position does not tell changes r by 2, and what is left of r / 8 by 1.
                let r = rhs.iter().zip(&image).map(|(b, lp)| ((b - lp) / 8.0).floor().abs());
                let [least, most] = [-1.0, 1.0]
                    .map(|step| r.clone().map(|r| (r + step).max(0.0).powi(2)).sum::<f64>());
                assert!(least > 1e4, "there is a residual");
                let found = report.residual_squared as f64;
                assert!((least..=most).contains(&found), "{found} in {least} to {most}");
            }
        }
    });
}

/// omega from the mask against a dense eigenvalue solver.
#[test]
fn omega_is_that_of_the_spectrum() {
    let mut worst: f64 = 0.0;
    with_big_stack(|| {
        for across in 4..=12 {
            let square = Mask::square(across).expect("4 to 40");
            let mut masks =
                vec![square, circle(across), annulus(across), circle(across).with_spider()];
            masks.extend((0..4).map(|seed| holed(across, 4, seed)));
            for (k, mask) in masks.into_iter().enumerate().filter(|(_, mask)| mask.count() > 0) {
                let exact = Pupil::new(&mask).relaxation_factor();
                let found = Solver::new(mask).config.omega();
                worst = worst.max((found - exact).abs());
                assert!((found - exact).abs() <= 1e-4, "N = {across}, mask {k}: {found} {exact}");
            }
        }
    });
    println!("omega: largest error {worst:.1e}");
}

/// On a full square the spectrum has a close bound in closed form, for sizes that a dense solver
/// does not reach. With a = cos(pi / (N - 1)), a row's second eigenvalue, the Rayleigh quotient of
/// cos(pi x / (N - 1)) over the square is
///
/// ```text
/// (a N + N + 1) / (2 N + 1) <= mu
/// ```
///
/// since that function is orthogonal to the first vector; it is exact but for the corners. (That
/// of both axes, cos(pi x / (N - 1)) cos(pi y / (N - 1)), is an exact eigenvector, of value a.)
#[test]
fn omega_of_a_square_follows_its_bound() {
    with_big_stack(|| {
        for across in 4..=40 {
            let n = across as f64;
            let a = f64::cos(PI / (n - 1.0));
            let mu = (a * n + n + 1.0) / (2.0 * n + 1.0);
            let bound = 2.0 / (1.0 + f64::sqrt(1.0 - mu * mu));
            let found = Solver::new(Mask::square(across).expect("4 to 40")).config.omega();
            let excess = found - bound;
            println!("N = {across}: omega {found:.5}, bound {bound:.5}");
            assert!((-1e-5..=0.2 / (n * n)).contains(&excess), "N = {across}: {found} {bound}");
        }
    });
}

/// Piston variance per slope variance at unit pitch for white slope noise, least squares in the
/// Southwell geometry: N, circle, square.
const NOISE_GAINS: [(usize, f64, f64); 6] = [
    (4, 0.331, 0.316),
    (8, 0.436, 0.455),
    (10, 0.479, 0.496),
    (16, 0.548, 0.580),
    (20, 0.584, 0.619),
    (32, 0.655, 0.699),
];

/// A slope is a path difference per pitch, twice that from centre to edge.
///
/// The exact gain is the trace of the dense covariance; the solver's is that of uniform random
/// tilts, with a statistical error below 0.7 %, and once more relative to the exact pistons of
/// the same tilts, without one.
#[test]
fn noise_gain_is_that_of_least_squares() {
    let check = |across: usize, mask: Mask, known: f64| {
        let pupil = Pupil::new(&mask);
        let exact = pupil.noise_gain();
        let mut solver = Solver::new(mask);
        let mut rng = Rng::new(36);
        let runs = if across <= 10 { 8500 } else { 6000 - 100 * across as u32 };
        let (mut slopes, mut sizes, mut pairs) = (0.0, Vec::new(), [0.0; 2]);
        for run in 0..runs {
            let tilts = random_tilts(&mask, 1 << 16, &mut rng);
            slopes += floats(&tilts).iter().flatten().map(|t| 4.0 * t * t).sum::<f64>() / 2.0;
            solver.relax(&tilts, 4 * across as u16);
            solver.remove_means();
            let square = |pistons: &[f64]| pistons.iter().map(|p| p * p).sum::<f64>();
            let size = square(&solver.pistons());
            sizes.push(size);
            if run < 20 {
                pairs[0] += size;
                pairs[1] += square(&pupil.least_squares(&floats(&tilts)));
            }
        }
        let total: f64 = sizes.iter().sum();
        let mean = total / f64::from(runs);
        let error = rms(sizes.iter().map(|s| s / mean - 1.0)) / f64::from(runs).sqrt();
        let gain = total / slopes;
        println!(
            "N = {across}, {} nodes: {gain:.4} +- {:.2} %, exact {exact:.4}, known {known}",
            mask.count(),
            100.0 * error
        );
        assert!(error <= 7e-3, "statistical error {error}");
        assert!((exact / known - 1.0).abs() <= 0.02);
        assert!((gain / known - 1.0).abs() <= 0.02);
        assert!((pairs[0] / pairs[1] - 1.0).abs() <= 1e-3, "{pairs:?}");
    };
    std::thread::scope(|scope| {
        for (across, on_circle, on_square) in NOISE_GAINS {
            let square = Mask::square(across).expect("4 to 40");
            for (mask, known) in [(circle(across), on_circle), (square, on_square)] {
                scope.spawn(move || with_big_stack(|| check(across, mask, known)));
            }
        }
    });
}

/// Radians of path per ulp.
fn rad_per_ulp() -> f64 {
    TAU / WAVELENGTH_M * Instrument::circle(4, 4).ulp_m()
}

/// Wavefront error that square segments leave when their pitch is r0: sqrt(0.175) rad.
const RESIDUAL_RAD: f64 = 0.4183;

/// Kolmogorov turbulence with r0 of one pitch, as plane waves; a pupil sees two layers cross it at
/// right angles, 60 and 40 % of it.
struct Flow {
    /// Amplitude (rad), angular frequency along x and y (rad per pitch), phase, and layer.
    waves: Vec<(f64, [f64; 2], f64, usize)>,
}

impl Flow {
    /// Phase variance 0.0229 f^(-11/3) per unit of f^2 (cycles per pitch), in rings from 1e-6 to
    /// 1 cycle per pitch, twelve directions each.
    fn new(rng: &mut Rng) -> Self {
        let mut waves = Vec::new();
        let (rings, directions) = (72, 12);
        for (layer, part) in [0.6, 0.4].into_iter().enumerate() {
            for ring in 0..rings {
                let edge = |i: i32| f64::powf(10.0, -6.0 + 6.0 * f64::from(i) / f64::from(rings));
                let (low, high) = (edge(ring), edge(ring + 1));
                let f = (low * high).sqrt();
                let variance = part * 0.0229 * f.powf(-11.0 / 3.0) * PI * (high * high - low * low);
                for direction in 0..directions {
                    let turn = (f64::from(direction) + rng.unit()) / f64::from(directions);
                    let (sin, cos) = (TAU * turn).sin_cos();
                    let amplitude = (2.0 * variance / f64::from(directions)).sqrt();
                    let k = [TAU * f * cos, TAU * f * sin];
                    waves.push((amplitude, k, TAU * rng.unit(), layer));
                }
            }
        }
        Self { waves }
    }

    /// Tip and tilt, ulp from centre to edge, of a mask's subapertures in frame `t`: the mean
    /// gradient over each, as the layers move an eighth of a pitch a frame.
    fn tilts(&self, mask: &Mask, t: i32) -> Vec<[f64; 2]> {
        let mut tilts = vec![[0.0; 2]; mask.count()];
        let sinc = |u: f64| if u.abs() < 1e-9 { 1.0 } else { u.sin() / u };
        for &(amplitude, k, phase, layer) in &self.waves {
            let moved = phase - k[layer] * f64::from(t) / 8.0;
            // Mean over the square, half a pitch of it, and radians to ulp.
            let size = amplitude * sinc(k[0] / 2.0) * sinc(k[1] / 2.0) / 2.0 / rad_per_ulp();
            for (tilts, (x, y)) in tilts.iter_mut().zip(mask.cells()) {
                let slope = -size * (k[0] * x as f64 + k[1] * y as f64 + moved).sin();
                tilts.iter_mut().zip(k).for_each(|(tilt, k)| *tilt += slope * k);
            }
        }
        tilts
    }
}

/// At the default sweeps, ceil(N/2) a frame and four times that for the first, the piston error
/// stays within a tenth of the residual wavefront error while turbulence crosses the pupil: with
/// the absolute tilts of each frame as commands, which change more than a loop's. An obstruction
/// of 0.3 takes half as many sweeps again.
#[test]
fn warm_sweeps_track_frozen_flow() {
    let check = |name: &str, mask: Mask, sweeps: u16| {
        let across = mask.across();
        let pupil = Pupil::new(&mask);
        let mut solver = Solver::new(mask);
        let flow = Flow::new(&mut Rng::new(37));
        let (mut errors, mut sizes) = (Vec::new(), Vec::new());
        for frame in 0..60 {
            // The mean tilt is a natural guide star's business.
            let mut tilts = flow.tilts(&mask, frame);
            for axis in 0..2 {
                let mean = tilts.iter().map(|t| t[axis]).sum::<f64>() / mask.count() as f64;
                tilts.iter_mut().for_each(|t| t[axis] -= mean);
            }
            let tilts: Vec<_> = tilts.iter().map(|t| t.map(|t| t.round() as i32)).collect();
            solver.relax(&tilts, if frame == 0 { 4 * sweeps } else { sweeps });
            solver.remove_means();
            let exact = pupil.least_squares(&floats(&tilts));
            let error = solver.pistons().into_iter().zip(&exact).map(|(p, e)| p - e);
            errors.push(rms(error) * rad_per_ulp());
            sizes.push(rms(exact) * rad_per_ulp());
        }
        let (cold, warm) = (errors[0], rms(errors[1..].iter().copied()));
        println!(
            "{name} {across}: pistons {:.2} rad; of {RESIDUAL_RAD} rad: cold {:.2} %, warm {:.2} % \
             rms, {:.2} % at worst",
            rms(sizes),
            100.0 * cold / RESIDUAL_RAD,
            100.0 * warm / RESIDUAL_RAD,
            100.0 * largest(errors[1..].iter().copied()) / RESIDUAL_RAD
        );
        assert!(cold <= 0.1 * RESIDUAL_RAD, "{name} {across}: {cold} rad after the first frame");
        assert!(warm <= 0.1 * RESIDUAL_RAD, "{name} {across}: {warm} rad");
    };
    std::thread::scope(|scope| {
        for across in [4usize, 8, 16, 32, 40] {
            let sweeps = across.div_ceil(2) as u16;
            assert_eq!(with_big_stack(|| Solver::new(circle(across)).config.sweeps()), sweeps);
            let more = across.div_ceil(4) as u16;
            let cases =
                [("circle", circle(across), sweeps), ("annulus", annulus(across), sweeps + more)];
            for (name, mask, sweeps) in cases {
                scope.spawn(move || with_big_stack(|| check(name, mask, sweeps)));
            }
        }
    });
}

/// The waves make the turbulence that they should: 6.88 r^(5/3) rad^2 between points r pitches
/// apart.
#[test]
fn flow_is_kolmogorov() {
    let flows = (0..200).map(|seed| Flow::new(&mut Rng::new(seed)));
    let structure = |flow: &Flow, r: f64| -> f64 {
        let square = |(a, k, ..): &(f64, [f64; 2], f64, usize)| a * a * (1.0 - (k[0] * r).cos());
        flow.waves.iter().map(square).sum()
    };
    let flows: Vec<_> = flows.collect();
    for r in [2.0f64, 8.0, 40.0] {
        let mean = flows.iter().map(|flow| structure(flow, r)).sum::<f64>() / 200.0;
        let ratio = mean / (6.88 * r.powf(5.0 / 3.0));
        println!("r = {r}: {ratio:.3}");
        assert!((ratio - 1.0).abs() < 0.1);
    }
}
