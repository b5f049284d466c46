//! Laser and star at wavelengths of their own, and r0 at a third.

use host_sim::closed_loop::Sensing;
use host_sim::instrument::Instrument;
use host_sim::monte_carlo::comparator::Comparator;
use host_sim::monte_carlo::point::{Conditions, Outcome, Point};

fn outcome(toml: &str) -> Outcome {
    let mut instrument = Instrument::parse(toml, "test").unwrap();
    instrument.atmosphere.layers.iter_mut().for_each(|layer| layer.wind_speed_m_per_s = 0.0);
    let conditions = Conditions {
        sensing: Sensing::Geometric,
        noise_free: true,
        settle: 30,
        frames: 1,
        seed: 3,
    };
    let point = Point::new(&instrument, 4, conditions).unwrap();
    let cases = [Comparator::Splash.into()];
    let prepared = point.prepare(&cases, &mut |_| ()).unwrap();
    prepared.run(0, &cases).unwrap()[0].1
}

/// What is left of a path is so many metres: its phase goes as 1/wavelength, and far in the red the Strehl ratio is
/// exp(-variance).
#[test]
fn variances_go_as_the_square_of_the_wavelengths() {
    let green = outcome("[science]\nwavelength_m = 532e-9");
    for science_m in [266e-9, 1.064e-6, 2.2e-6] {
        let seen = outcome(&format!("[science]\nwavelength_m = {science_m}"));
        let expected = green.variance_rad2 * (532e-9_f64 / science_m).powi(2);
        let ratio = seen.variance_rad2 / expected;
        assert!((ratio - 1.0).abs() < 1e-5, "{science_m}: {ratio}");
        if science_m > 2e-6 {
            let marechal = (-seen.variance_rad2).exp();
            assert!(seen.variance_rad2 < 0.1, "{}", seen.variance_rad2);
            assert!((seen.strehl - marechal).abs() < 2e-3, "{} {marechal}", seen.strehl);
        }
    }
}

/// r0 goes as wavelength^(6/5): the same air, described at another wavelength.
#[test]
fn r0_at_another_wavelength_is_the_same_air() {
    let green = outcome("");
    let r0_m = 0.5 * 2f64.powf(1.2);
    let red = outcome(&format!("[atmosphere]\nr0_m = {r0_m}\nr0_wavelength_m = 1.064e-6"));
    assert!((red.variance_rad2 / green.variance_rad2 - 1.0).abs() < 1e-5);
    let at = |toml: &str| Instrument::parse(toml, "test").unwrap().r0_m();
    assert_eq!(at(""), 0.5);
    assert_eq!(at("[atmosphere]\nr0_wavelength_m = 532e-9"), 0.5);
    // 0.15 x 4.4^1.2.
    let k =
        at("[atmosphere]\nr0_m = 0.15\nr0_wavelength_m = 500e-9\n[laser]\nwavelength_m = 2.2e-6");
    assert!((k - 0.887_635).abs() < 1e-6, "{k}");
}
