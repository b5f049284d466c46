//! The lever arm's best factor, against Monte Carlo.

use host_sim::atmosphere::Atmosphere;
use host_sim::instrument::Instrument;
use host_sim::monte_carlo::pistons::Pistons;
use host_sim::optics::geometric::{GeometricSensor, Sensor};
use host_sim::pupil::{Mirror, Pupil};
use host_sim::theory::Layer;
use host_sim::theory::lever_arm::{Beacon, least_variance};

const ACROSS: usize = 8;
const SAMPLES: usize = 2;
const SCREENS: u64 = 150;

/// The wavefront that the mirror makes of a sensor's gradients, at the segments' samples, without piston and plane.
fn made(
    sensor: Sensor,
    pupil: &Pupil,
    sky: &Atmosphere,
    beacon_m: f64,
    pistons: &mut Pistons,
) -> Vec<f64> {
    let flat = Mirror::flat(pupil.subapertures().len());
    let mut tilts = vec![[0.0; 2]; flat.segments.len()];
    let mut geometric = GeometricSensor::new(sensor, pupil, sky, beacon_m, 2.0).unwrap();
    geometric.centroids(sky, 0.0, &flat, &mut tilts);
    let solved = pistons.solve(&tilts);
    // Gauss points of each segment: the mean square of a tilt t from centre to edge is t^2 / 3.
    let edge = (1.0f64 / 3.0).sqrt();
    let mut values = Vec::new();
    let mut places = Vec::new();
    for ((&[ix, iy], &[tip, tilt]), piston) in pupil.subapertures().iter().zip(&tilts).zip(solved) {
        for (x, y) in [(-edge, -edge), (edge, -edge), (-edge, edge), (edge, edge)] {
            values.push(piston + tip * x + tilt * y);
            let half = pupil.pitch_m() / 2.0;
            places.push([pupil.centre_m(ix) + x * half, pupil.centre_m(iy) + y * half]);
        }
    }
    // A circle's x, y and 1 are orthogonal.
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let slopes = [0, 1].map(|axis| {
        let cross: f64 = values.iter().zip(&places).map(|(value, place)| value * place[axis]).sum();
        cross / places.iter().map(|place| place[axis].powi(2)).sum::<f64>()
    });
    let rest = |(value, [x, y]): (&f64, &[f64; 2])| value - mean - slopes[0] * x - slopes[1] * y;
    values.iter().zip(&places).map(rest).collect()
}

/// Within three and a half standard errors of f's estimate from screens, in the paper's setting.
#[test]
fn the_best_factor_is_that_of_random_screens() {
    let instrument = Instrument::standard().unwrap();
    let beacon_m = instrument.laser.beacon_height_m;
    let pupil = Pupil::circular(ACROSS, SAMPLES, 0.5).unwrap();
    let mut pistons = Pistons::new(&pupil);
    let skies: Vec<Atmosphere> = (0..SCREENS)
        .map(|seed| Atmosphere::new(0.5, &instrument.layers(), 4.0, 0.5, 0.0, seed).unwrap())
        .collect();
    let layers = [Layer { weight: 0.6, beta: 1.0 }, Layer { weight: 0.4, beta: 0.75 }];
    for (sensor, beacon) in [(Sensor::Splash, Beacon::Splash), (Sensor::Lgs, Beacon::Lgs)] {
        let products: Vec<[f64; 2]> = skies
            .iter()
            .map(|sky| {
                let star = made(Sensor::Ngs, &pupil, sky, beacon_m, &mut pistons);
                let seen = made(sensor, &pupil, sky, beacon_m, &mut pistons);
                let dot = |a: &[f64]| a.iter().zip(&seen).map(|(a, s)| a * s).sum::<f64>();
                [dot(&star), dot(&seen)]
            })
            .collect();
        let sums = products.iter().fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]);
        let found = sums[0] / sums[1];
        let scatter: f64 = products.iter().map(|p| (p[0] - found * p[1]).powi(2)).sum();
        let error = scatter.sqrt() / sums[1];
        let expected = least_variance(&layers, beacon);
        assert!(error < 0.01, "{error}");
        assert!((found - expected).abs() < 3.5 * error, "{found} +- {error}, {expected}");
    }
}
