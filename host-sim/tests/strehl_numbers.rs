//! Strehl ratios of the paper's setting under a few screens, through the library: what is known of them
//! from an independent simulation of 30 skies, noise-free, N = 8, and of the limit in which images are
//! gradients.

use host_sim::closed_loop::Sensing;
use host_sim::instrument::Instrument;
use host_sim::monte_carlo::comparator::Comparator;
use host_sim::monte_carlo::point::{Conditions, Outcome, Point};
use host_sim::monte_carlo::statistics::Mean;

/// Strehl ratios `[comparator][screen]` of frozen screens at N = 8.
fn strehl(toml: &str, sensing: Sensing, comparators: &[Comparator], screens: u32) -> Vec<Vec<f64>> {
    let mut instrument = Instrument::parse(toml, "test").unwrap();
    instrument.atmosphere.layers.iter_mut().for_each(|layer| layer.wind_speed_m_per_s = 0.0);
    let conditions = Conditions { sensing, noise_free: true, settle: 40, frames: 5, seed: 7 };
    let point = Point::new(&instrument, 8, conditions).unwrap();
    let cases: Vec<_> = comparators.iter().map(|&comparator| comparator.into()).collect();
    let prepared = point.prepare(&cases, &mut |_| ()).unwrap();
    let mut all = vec![Vec::new(); comparators.len()];
    for screen in 0..screens {
        for (values, (_, outcome)) in all.iter_mut().zip(prepared.run(screen, &cases).unwrap()) {
            let Outcome { strehl, .. } = outcome;
            values.push(strehl);
        }
    }
    all
}

/// Independent simulation: SPLASH 0.592, LGS 0.490, NGS 0.739, standard errors 0.014, 0.014, 0.004; the
/// fit's exp(-0.1704) = 0.843.
#[test]
fn gradients_agree_with_an_independent_simulation() {
    let all = strehl("", Sensing::Geometric, &Comparator::ALL, 60);
    let known = [(0.592, 0.014), (0.490, 0.014), (0.739, 0.004), (0.843, 0.002)];
    for ((values, comparator), (expected, error)) in all.iter().zip(Comparator::ALL).zip(known) {
        let Mean { mean, standard_error } = Mean::of(values);
        println!("{comparator:?}: {mean:.4} +- {standard_error:.4}, known {expected}");
        let both = standard_error.hypot(error);
        assert!((mean - expected).abs() < 3.0 * both, "{comparator:?}: {mean}, not {expected}");
    }
    // What the screens have in common drops out.
    let Mean { mean, standard_error } = Mean::of_differences(&all[0], &all[1]);
    println!("SPLASH - LGS: {mean:.4} +- {standard_error:.4}");
    assert!(mean > 5.0 * standard_error, "SPLASH - LGS: {mean} +- {standard_error}");
    assert!(standard_error < 0.8 * Mean::of(&all[0]).standard_error, "{standard_error}");
}

/// The plain centre of gravity over a window of the image's whole period is the mean gradient, speckle and
/// all. What is left is that of the steps between segments, and the sampling.
#[test]
fn images_become_gradients_without_threshold_and_window() {
    let period = "[telescope]\nsamples = 16\n[windows]\nsize = 32\nspacing_px = 32\n\
                  [centroids]\nestimator = \"plain\"\nthreshold_sigma = 0";
    let sensors = [Comparator::Splash, Comparator::Lgs, Comparator::Ngs];
    let images = strehl(period, Sensing::Images, &sensors, 8);
    let gradients = strehl(period, Sensing::Geometric, &sensors, 8);
    for ((sensor, images), gradients) in sensors.iter().zip(&images).zip(&gradients) {
        let Mean { mean, standard_error } = Mean::of_differences(images, gradients);
        println!("{sensor:?}, images - gradients: {mean:.4} +- {standard_error:.4}");
        assert!(mean.abs() < 0.005, "{sensor:?}: images - gradients = {mean} +- {standard_error}");
    }
}
