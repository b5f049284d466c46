//! Pistons against exact least squares, and the relaxation that finds them.

use std::f64::consts::{PI, TAU};

use splash_firmware::config::Config;
use splash_firmware::fixed::{PISTON_LIMIT, TILT_LIMIT};
use splash_firmware::geometry::{Grid, Mask};
use splash_firmware::pipeline::Pipeline;
use splash_firmware::redblack::RedBlack;
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

/// The solver by itself, on the mask of a configuration.
struct Solver {
    config: Box<Bank>,
    grid: Grid,
    cells: Vec<(usize, usize)>,
    sor: Box<Sor<CELLS>>,
    field: Box<[RedBlack<i32, CELLS>; 2]>,
}

impl Solver {
    fn new(mask: Mask) -> Self {
        Self {
            config: Instrument::ideal(mask, 4).config(),
            grid: Grid::new(mask.across()),
            cells: mask.cells().collect(),
            sor: Box::default(),
            field: Box::new([const { RedBlack::new(0) }; 2]),
        }
    }

    /// Loads tips and tilts, ulp, and relaxes.
    fn relax(&mut self, tilts: &[[i32; 2]], sweeps: u16) {
        for (&(x, y), tilts) in self.cells.iter().zip(tilts) {
            let padded = self.grid.node(x, y) as u16;
            for (field, &tilt) in self.field.iter_mut().zip(tilts) {
                *field.get_mut(padded).expect("on the grid") = tilt;
            }
        }
        let [tip, tilt] = &*self.field;
        self.sor.load(self.config.solver(), tip, tilt);
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
                assert!(error <= ULP_PER_LSB, "{name}: {error} ulp");
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
            let dark = frames::steered(&instrument, vec![None; mask.count()], 60_000);
            let mut saturated = 0;
            // Two frames set the commands; the others see that these are right.
            for number in 0..200 {
                let seen = if number < 2 { &frame } else { &still(&instrument, &dark) };
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
            assert!(error <= ULP_PER_LSB, "{name}: {error} ulp");
            assert!(rms(exact) > 100.0 * ULP_PER_LSB || mask.count() < 12, "{name}");
        }
    });
    println!(
        "pipeline: largest error {:.0} ulp = {:.2} LSB ({})",
        worst.0,
        worst.0 / 512.0,
        worst.1
    );
}

/// A frame of centred spots.
fn still(instrument: &Instrument, _: &[u16]) -> Vec<u16> {
    frames::steered(instrument, vec![Some([0; 2]); instrument.count()], 60_000)
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
                        1 => [(x, y), (y, x)].map(|(a, _)| TILT_LIMIT * (1 - 2 * (a as i32 & 1))),
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

/// `residual_squared` against sum (r >> 3)^2 with r from the solver's own pistons.
fn check_residual(solver: &Solver, pupil: &Pupil, tilts: &[[i32; 2]]) {
    let rhs = pupil.divergence(&floats(tilts));
    let image = pupil.laplacian(&solver.pistons());
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

/// The report's residual, from the pipeline's commands and pistons.
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
                let r = rhs.iter().zip(&image).map(|(b, lp)| ((b - lp) / 8.0).floor());
                let exact: f64 = r.map(|r| r * r).sum();
                assert!(exact > 1e6, "there is a residual");
                assert_eq!(report.residual_squared as f64, exact);
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

#[test]
fn probe_square() {
    for n in [4, 6, 8, 12, 16] {
        let mu = Pupil::new(&Mask::square(n).expect("")).second_singular_value();
        let nf = n as f64;
        println!(
            "N {n}: mu {mu:.6} omega {:.5}; southwell {:.5}; cos(pi/N) {:.6} cos(pi/(N-1)) {:.6} (1+cos)/2 {:.6} {:.6}; circle {:.5}, annulus {:.5}",
            Pupil::new(&Mask::square(n).expect("")).relaxation_factor(),
            2.0 / (1.0 + f64::sin(PI / (nf + 1.0))),
            f64::cos(PI / nf),
            f64::cos(PI / (nf - 1.0)),
            (1.0 + f64::cos(PI / nf)) / 2.0,
            (1.0 + f64::cos(PI / (nf - 1.0))) / 2.0,
            Pupil::new(&circle(n)).relaxation_factor(),
            Pupil::new(&annulus(n)).relaxation_factor()
        );
    }
}

/// Piston variance per slope variance at unit pitch for white slope noise, as published for the
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
#[test]
fn noise_gain_is_the_published_one() {
    with_big_stack(|| {
        for (across, on_circle, on_square) in NOISE_GAINS {
            let masks =
                [(circle(across), on_circle), (Mask::square(across).expect("4"), on_square)];
            for (mask, published) in masks {
                let exact = Pupil::new(&mask).noise_gain();
                let mut solver = Solver::new(mask);
                let mut rng = Rng::new(36);
                let (mut slopes, mut pistons) = (0.0, 0.0);
                let runs = 600;
                let mut each = Vec::new();
                for _ in 0..runs {
                    let tilts = random_tilts(&mask, 1 << 16, &mut rng);
                    slopes +=
                        floats(&tilts).iter().flatten().map(|t| 4.0 * t * t).sum::<f64>() / 2.0;
                    solver.relax(&tilts, 8 * across as u16);
                    solver.remove_means();
                    let size = solver.pistons().iter().map(|p| p * p).sum::<f64>();
                    pistons += size;
                    each.push(size);
                }
                let gain = pistons / slopes;
                let mean = pistons / f64::from(runs);
                let spread = rms(each.iter().map(|v| v / mean - 1.0)) / f64::from(runs).sqrt();
                println!(
                    "N = {across}, {} nodes: {gain:.4} +- {:.2} %, exact {exact:.4}, published {published}",
                    mask.count(),
                    100.0 * spread
                );
            }
        }
    });
}
