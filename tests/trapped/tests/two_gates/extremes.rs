//! Everything at the end of its range: nothing wraps, and what saturates does so where it is said to.

use super::{circle, coupling};
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::fixed::TILT_LIMIT;
use splash_firmware::geometry::Mask;
use splash_firmware::pipeline::{GlobalTilt, Outcome, Pipeline};
use splash_firmware::spec::SorSpec;
use splash_tests::frames::Rng;
use splash_tests::instrument::{Instrument, Values};
use splash_tests::twin::control::Integrator;
use splash_tests::twin::modal::{Modes, polynomials};
use splash_tests::twin::pixels::Numbers;
use splash_tests::with_big_stack;

/// Two gates of 40 x 40 subapertures with windows of 4 x 4 pixels.
type Bank = Config<3200, { 3200 * 16 }, 0, 25>;
type Path = Pipeline<3200, 0, 25>;

/// The largest gains; C is `c` for a and `d` for b, in every entry.
fn extreme(mask: Mask, modes: usize, [c, d]: [f64; 2]) -> Instrument {
    let mut instrument = Instrument::ideal(mask, 4);
    instrument.sor = SorSpec { sweeps: Some(1), cold_sweeps: Some(1), ..SorSpec::default() };
    let g = 32767.0 * 32768.0 * instrument.ulp_m();
    instrument.slope_gain_m_per_px = Values::Uniform([[g, 0.0], [0.0, g]]);
    instrument.flux_min_adu = Values::Uniform(0.0);
    instrument.flux_max_adu = Values::Uniform(f64::from(u32::MAX));
    (instrument.control_gain, instrument.lever_arm) = (Values::Uniform(1.99), 1.9);
    let row = [vec![1.9 * (c - d); modes], vec![1.9 * d; modes]].concat();
    instrument.with_second_gate(polynomials(&mask, modes), row.repeat(modes))
}

/// The sign of mode k at each window, or any sign.
fn signs(instrument: &Instrument, pattern: usize, rng: &mut Rng) -> Vec<[i32; 2]> {
    let second = instrument.second.as_ref().expect("two gates");
    let count = instrument.count();
    let sign = |q: f64| if q < 0.0 { i32::MIN } else { i32::MAX };
    let mode = |k: usize| second.modes[k * count..][..count].iter().map(move |q| q.map(sign));
    let opposite = |centroid: [i32; 2]| centroid.map(|c| !c);
    match pattern {
        // Both gates together, and against each other.
        0 => mode(0).chain(mode(0)).collect(),
        1 => mode(1).chain(mode(1).map(opposite)).collect(),
        2 => mode(2).map(opposite).chain(mode(2)).collect(),
        _ => {
            (0..2 * count).map(|_| [0; 2].map(|_| [i32::MIN, 0, i32::MAX][rng.below(3) as usize]))
        }
        .collect(),
    }
}

fn frame(
    path: &mut Path,
    config: &Bank,
    number: u32,
    centroids: &[[i32; 2]],
    dark: impl Fn(usize) -> bool,
) {
    let lit = |i: usize| if dark(i) { 0 } else { u32::MAX };
    let all = centroids.iter().enumerate().map(|(i, &centroid_q16)| Measurement {
        centroid_q16,
        flux: lit(i),
        peak: u16::MAX,
        saturated: u16::MAX,
    });
    path.begin(config, number);
    path.push_measurements(config, &all.collect::<Vec<_>>()).expect("one a window");
    assert_eq!(path.finish(config).outcome, Outcome::Updated);
    let commands = path.commands().as_flattened().iter();
    assert!(
        commands
            .chain(path.positions().iter().flat_map(|p| &p.tilt_ulp))
            .all(|c| c.abs() <= TILT_LIMIT)
    );
}

/// Every pupil, every sign of C, subapertures that come and go, global tilts of both signs.
#[test]
fn commands_keep_their_limits() {
    with_big_stack(|| {
        let mut rng = Rng::new(140);
        let mut path = Box::new(Path::new());
        for (across, modes) in [(4, 5), (8, 25), (40, 25)] {
            for [c, d] in [[64.0, 64.0], [-64.0, 63.9], [63.9, -64.0], [-64.0, -64.0]] {
                let instrument = extreme(Mask::square(across).expect("4 to 40"), modes, [c, d]);
                let config: Box<Bank> = instrument.bank();
                path.reset(&config);
                for number in 0..8 {
                    let centroids = signs(&instrument, number as usize % 5, &mut rng);
                    let tilt_ulp = [[i32::MIN, i32::MAX], [i32::MAX; 2]][number as usize % 2];
                    path.set_global_tilt(GlobalTilt { tilt_ulp, frame: number });
                    let some = rng.below(3) as usize;
                    frame(&mut path, &config, number, &centroids, |i| {
                        i > 0 && some > 0 && i % 7 < some
                    });
                }
            }
        }
    });
}

/// Each step against the equations, with the limits where the stage has them. All are valid; C is such that
/// nothing, or some, or everything saturates.
#[test]
fn what_saturates_does_so_at_its_limits() {
    with_big_stack(|| {
        let mut rng = Rng::new(141);
        let mut path = Box::new(Path::new());
        for (across, modes) in [(8, 12), (16, 25)] {
            for size in [1.0 / 256.0, 1.0 / 16.0, 1.0, 64.0] {
                for [c, d] in [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0]] {
                    let instrument = extreme(circle(across), modes, [c * size, d * size]);
                    step(&instrument, &mut path, size, &mut rng);
                }
            }
        }
    });
}

fn step(instrument: &Instrument, path: &mut Path, size: f64, rng: &mut Rng) {
    let second = instrument.second.as_ref().expect("two gates");
    let model = Modes::new(&second.modes, &second.coupling, instrument.count());
    let mut law = Integrator::new(instrument, Numbers::Stored);
    let config: Box<Bank> = instrument.bank();
    path.reset(&config);
    let f64s = |all: &[[i32; 2]]| all.iter().map(|c| c.map(f64::from)).collect::<Vec<_>>();
    for number in 0..6 {
        law.command = f64s(path.commands());
        let applied: Vec<_> = path.positions().iter().map(|p| p.tilt_ulp).collect();
        let centroids = signs(instrument, number as usize % 4, rng);
        frame(path, &config, number, &centroids, |_| false);
        let [s1, s2] = [path.slopes(), path.second_slopes()].map(|slopes| {
            slopes.iter().map(|s| Some(s.tilt_ulp.map(f64::from))).collect::<Vec<_>>()
        });
        let applied = f64s(&applied);
        law.update(&model.corrected([&s1, &s2], &applied, instrument.lever_arm), &applied);
        let limit = f64::from(TILT_LIMIT);
        let expected = law.command.as_flattened().iter().map(|c| c.clamp(-limit, limit));
        let found = path.commands().as_flattened().iter();
        let off = splash_tests::largest(found.zip(expected).map(|(&a, b)| f64::from(a) - b));
        // Gradients of 15 bits of the largest of 1/4, and means that are off by count / 2^32, of x up to
        // 2^24.6: 2^11 ulp of a and b of 2^28, as many times as the modes pass them on.
        let modes = model.gradients.len() as f64;
        let bound = 32.0 + f64::from(1 << 11) * 2.0 * modes * size * 3.8;
        assert!(off <= bound.min(limit / 8.0), "C = {size}, frame {number}: {off} of {bound}");
    }
}

/// Coefficients of C just inside their limit are taken, as is a mode that is one subaperture's against another's.
#[test]
fn the_steepest_mode_is_taken() {
    let mask = circle(8);
    let mut mode = vec![[0.0; 2]; mask.count()];
    (mode[3], mode[40]) = ([f64::sqrt(0.5), 0.0], [-f64::sqrt(0.5), 0.0]);
    let c = coupling(1, 63.0, &mut Rng::new(142));
    let instrument = Instrument::ideal(mask, 4).with_second_gate(mode, vec![c[0], 0.0]);
    let config: Box<Bank> = with_big_stack(|| instrument.bank());
    assert_eq!(config.modes(), 1);
}
