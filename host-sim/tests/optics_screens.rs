//! Phase screens against the Kolmogorov structure function 6.88 (r/r0)^(5/3).

use host_sim::atmosphere::{Atmosphere, Layer, Turbulence};
use host_sim::optics::phase::{Path, PhaseSampler};
use host_sim::pupil::Pupil;
use host_sim::screen::Screen;
use rayon::prelude::*;

fn kolmogorov(r_m: f64, r0_m: f64) -> f64 {
    6.88388 * (r_m / r0_m).powf(5.0 / 3.0)
}

fn layer(weight: f64, height_m: f64, speed: f64, direction: f64) -> Layer {
    Layer { weight, height_m, wind_speed_m_per_s: speed, wind_direction_deg: direction }
}

/// Mean square phase difference between texels (dx, dy) apart, the planes included.
fn structure(screens: &[&Screen], dx: i64, dy: i64, step: usize) -> f64 {
    let [width, height] = screens[0].texels();
    let texel_m = screens[0].texel_m();
    let plane: f64 = screens
        .iter()
        .map(|s| s.gradient_rad_per_m())
        .map(|g| (g[0] * dx as f64 + g[1] * dy as f64) * texel_m)
        .sum();
    let (mut sum, mut count) = (0.0, 0.0);
    for y in (0..height as i64).step_by(step) {
        for x in (0..width as i64).step_by(step) {
            let rise: f64 = screens
                .iter()
                .map(|s| f64::from(s.texel(x + dx, y + dy)) - f64::from(s.texel(x, y)))
                .sum();
            sum += (rise + plane).powi(2);
            count += 1.0;
        }
    }
    sum / count
}

/// Two layers, a texel for each of the eight subapertures across, 40 000 realisations: the random
/// planes, which carry two thirds of the structure function at D, leave 0.5 % of statistics.
#[test]
fn structure_function_of_independent_screens() {
    const SEEDS: u64 = 40_000;
    let (r0_m, diameter_m) = (1.0, 8.0);
    let layers = [layer(3.0, 0.0, 0.0, 0.0), layer(2.0, 3000.0, 0.0, 0.0)];
    // The texel is a sixteenth of the pitch.
    let turbulence = Turbulence::new(r0_m, &layers, diameter_m, 16.0, 0.0).unwrap();
    let lags: Vec<(i64, i64)> = vec![
        (1, 0),
        (2, 0),
        (4, 0),
        (8, 0),
        (0, 1),
        (0, 3),
        (0, 8),
        (1, 1),
        (3, 3),
        (5, 5),
        (5, -5),
    ];
    let sums = (0..SEEDS)
        .into_par_iter()
        .map(|seed| {
            let atmosphere = turbulence.realise(seed, &mut |_| ());
            let screens: Vec<&Screen> = atmosphere.screens().collect();
            lags.iter().map(|&(dx, dy)| structure(&screens, dx, dy, 3)).collect::<Vec<_>>()
        })
        .collect::<Vec<_>>();
    for (k, &(dx, dy)) in lags.iter().enumerate() {
        let mean = sums.iter().map(|sum| sum[k]).sum::<f64>() / SEEDS as f64;
        let expected = kolmogorov((dx as f64).hypot(dy as f64), r0_m);
        let error = mean / expected - 1.0;
        println!("lag {dx:2} {dy:2}: {:+.2} %", 100.0 * error);
        assert!(error.abs() < 0.02, "lag ({dx}, {dy}): {mean} for {expected}");
    }
}

/// Interpolation at sub-texel places keeps the structure function of the texels themselves, from
/// one subaperture to nearly D: the same realisation, so that hardly any statistics remain.
#[test]
fn interpolation_keeps_the_structure_function() {
    let pupil = Pupil::square(8, 8, 0.5).unwrap();
    let diameter_m = pupil.diameter_m();
    // Per second 3.3 texels: the frames sample all sub-texel places along x and y.
    let layers = [layer(0.6, 0.0, 0.1037, 33.0), layer(0.4, 3000.0, 0.1037, 33.0)];
    let frames = 60;
    let atmosphere = Atmosphere::new(0.5, &layers, diameter_m, 0.5, f64::from(frames), 5).unwrap();
    let mut sampler = PhaseSampler::default();
    let side = pupil.side();
    let mut phase = vec![0.0; side * side];
    let velocity = layers[0].velocity_m_per_s();
    let lags = [(8, 0), (0, 8), (8, 8), (24, 0), (0, 24), (40, 40), (56, 0), (0, 56)];
    let mut sampled = [0.0; 8];
    let mut direct = [0.0; 8];
    for frame in 0..frames {
        let time_s = f64::from(frame);
        sampler.sample(Path::Star, &pupil, &atmosphere, time_s, &mut phase);
        for (k, &(dx, dy)) in lags.iter().enumerate() {
            for row in 0..side - dy {
                for col in 0..side - dx {
                    let rise = phase[(row + dy) * side + col + dx] - phase[row * side + col];
                    sampled[k] += f64::from(rise).powi(2);
                    // The same pair of places, to the nearest texel.
                    let mut rise = 0.0;
                    for screen in atmosphere.screens() {
                        let texel_m = screen.texel_m();
                        let near = |axis: usize, k: usize| {
                            let place = pupil.sample_m(k) - velocity[axis] * time_s;
                            (place / texel_m).round() as i64
                        };
                        let (x, y) = (near(0, col), near(1, row));
                        let (far_x, far_y) = (x + 2 * dx as i64, y + 2 * dy as i64);
                        rise += f64::from(screen.texel(far_x, far_y) - screen.texel(x, y));
                        let gradient = screen.gradient_rad_per_m();
                        rise += 2.0 * texel_m * (gradient[0] * dx as f64 + gradient[1] * dy as f64);
                    }
                    direct[k] += rise * rise;
                }
            }
        }
    }
    for (k, lag) in lags.iter().enumerate() {
        let error = sampled[k] / direct[k] - 1.0;
        println!("lag {lag:?}: {:+.3} %", 100.0 * error);
        assert!(error.abs() < 5e-3, "lag {lag:?}: {error}");
    }
}

/// Layers take their share: the structure functions of w and 1 - w of the same surface.
#[test]
fn weights_are_normalised() {
    let with = |weights: [f64; 2]| {
        let layers = weights.map(|weight| layer(weight, 0.0, 0.0, 0.0));
        Atmosphere::new(0.7, &layers, 2.0, 0.5, 0.0, 3).unwrap()
    };
    let (a, b) = (with([0.2, 0.2]), with([30.0, 10.0]));
    for (k, share) in [0.75, 0.25].into_iter().enumerate() {
        let of =
            |atmosphere: &Atmosphere| structure(&[atmosphere.screens().nth(k).unwrap()], 3, 1, 7);
        assert!((of(&b) / of(&a) - share / 0.5).abs() < 1e-5);
    }
}
