//! What SPLASH spots do under tilts, pokes and turbulence at the ground.

#[path = "common/still_air.rs"]
mod still_air;

use host_sim::atmosphere::{Atmosphere, Layer};
use host_sim::optics::OpticsError;
use host_sim::optics::geometric::{GeometricSensor, Sensor};
use host_sim::optics::splash_image::{PIXELS_PER_LAMBDA_D, SplashCamera};
use host_sim::pupil::{Mirror, Pupil};
use std::f64::consts::PI;
use still_air::still_air;

const BEACON_M: f64 = 12_000.0;
const WINDOW: usize = 16;
const PIXELS: usize = WINDOW * WINDOW;

fn layer(weight: f64, height_m: f64, wind_direction_deg: f64) -> Layer {
    Layer { weight, height_m, wind_speed_m_per_s: 10.0, wind_direction_deg }
}

fn turbulence(pupil: &Pupil, layers: &[Layer], seed: u64) -> Atmosphere {
    Atmosphere::new(0.5, layers, pupil.diameter_m(), pupil.pitch_m(), 0.5, seed).unwrap()
}

fn expose(pupil: &Pupil, atmosphere: &Atmosphere, time_s: f64, mirror: &Mirror) -> Vec<f32> {
    let mut camera =
        SplashCamera::new(pupil, atmosphere, BEACON_M, PIXELS_PER_LAMBDA_D, WINDOW).unwrap();
    let mut images = vec![0.0; camera.spots() * PIXELS];
    camera.expose(atmosphere, time_s, mirror, &mut images);
    images
}

fn geometric(
    sensor: Sensor,
    pupil: &Pupil,
    atmosphere: &Atmosphere,
    time_s: f64,
    mirror: &Mirror,
) -> Vec<[f64; 2]> {
    let mut centroids = vec![[0.0; 2]; pupil.subapertures().len()];
    GeometricSensor::new(sensor, pupil, atmosphere, BEACON_M, PIXELS_PER_LAMBDA_D)
        .unwrap()
        .centroids(atmosphere, time_s, mirror, &mut centroids);
    centroids
}

fn moments(image: &[f64]) -> [f64; 3] {
    let mut moments = [0.0; 3];
    for (k, value) in image.iter().enumerate() {
        let centre = (WINDOW as f64 - 1.0) / 2.0;
        moments[0] += value;
        moments[1] += value * ((k % WINDOW) as f64 - centre);
        moments[2] += value * ((k / WINDOW) as f64 - centre);
    }
    moments
}

fn centroid(image: &[f32]) -> [f64; 2] {
    let image: Vec<f64> = image.iter().map(|&value| f64::from(value)).collect();
    let [sum, x, y] = moments(&image);
    [x / sum, y / sum]
}

#[test]
fn light_is_conserved() {
    let mirror = Mirror::flat(16);
    let sum = |samples: usize, window: usize, scale: f64| {
        let pupil = Pupil::square(4, samples, 0.5).unwrap();
        let atmosphere = still_air(&pupil);
        let mut camera = SplashCamera::new(&pupil, &atmosphere, BEACON_M, scale, window).unwrap();
        let mut images = vec![0.0; 16 * window * window];
        camera.expose(&atmosphere, 0.0, &mirror, &mut images);
        images[..window * window].iter().map(|&value| f64::from(value)).sum::<f64>()
    };
    // One period of the sampled pupil's image holds everything.
    for (samples, window, scale) in [(8, 16, 2.0), (16, 32, 2.0), (8, 8, 1.0), (5, 20, 4.0)] {
        let sum = sum(samples, window, scale);
        assert!((sum - 1.0).abs() < 1e-5, "{sum}");
    }
    // Half the window, up to the folded wings: a flat square aperture sends the integral of
    // sinc^2, 0.9499, within 2 lambda/d on each axis; the downward image of the telescope, a
    // quarter as wide, then takes the edge from the zero of the upward one.
    let sum = sum(16, 8, 2.0);
    assert!((sum - 0.9499_f64.powi(2)).abs() < 0.02, "{sum}");
}

/// A plane over all segments is the same on the way up and on the way down.
#[test]
fn global_tilt_is_invisible() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let atmosphere = still_air(&pupil);
    let mut mirror = Mirror::flat(52);
    let slope = [0.9, -0.6];
    for (segment, &[ix, iy]) in mirror.segments.iter_mut().zip(pupil.subapertures()) {
        let piston = 2.0 * (slope[0] * ix as f64 + slope[1] * iy as f64);
        *segment = [piston, slope[0], slope[1]];
    }
    let images = expose(&pupil, &atmosphere, 0.0, &mirror);
    let worst = images
        .chunks_exact(PIXELS)
        .flat_map(centroid)
        .fold(0.0, |worst: f64, value| worst.max(value.abs()));
    println!("global tilt: {worst:.1e} px");
    assert!(worst < 1e-4, "{worst} px");
    for centroid in geometric(Sensor::Splash, &pupil, &atmosphere, 0.0, &mirror) {
        assert!(centroid[0].hypot(centroid[1]) < 1e-12);
    }
}

/// A poked segment moves its own spot by its tilt (2t/pi pixels of lambda/2d) less the mean tilt.
#[test]
fn poke_moves_its_own_spot() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let atmosphere = still_air(&pupil);
    for (poked, axis) in [(0, 0), (20, 1), (51, 0)] {
        let tilt = 0.5;
        let mut mirror = Mirror::flat(52);
        mirror.segments[poked][axis + 1] = tilt;
        // The mirror's phase is taken out: a positive tilt moves the spot to the negative side.
        let expected = -2.0 * tilt / PI;
        let images = expose(&pupil, &atmosphere, 0.0, &mirror);
        for (spot, image) in images.chunks_exact(PIXELS).enumerate() {
            let response = centroid(image)[axis] / expected;
            let across = centroid(image)[1 - axis] / expected;
            if spot == poked {
                println!("poke {poked}: own {response:.4}");
                assert!((response - 0.98).abs() < 0.02, "own spot: {response}");
            } else {
                assert!(response.abs() < 0.02 + 1.0 / 52.0, "spot {spot}: {response}");
            }
            assert!(across.abs() < 0.02, "spot {spot}, other axis: {across}");
        }
        let centroids = geometric(Sensor::Splash, &pupil, &atmosphere, 0.0, &mirror);
        for (spot, centroid) in centroids.iter().enumerate() {
            let own = if spot == poked { 1.0 } else { 0.0 };
            assert!((centroid[axis] / expected - (own - 1.0 / 52.0)).abs() < 1e-12);
        }
    }
}

/// With all turbulence at the ground the sensors differ by the global tilt only.
#[test]
fn ground_layer_sensors_agree() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let layers = [layer(0.5, 0.0, 20.0), layer(0.5, 0.0, 110.0)];
    let atmosphere = turbulence(&pupil, &layers, 4);
    let mirror = Mirror::flat(52);
    let [splash, lgs, ngs] = [Sensor::Splash, Sensor::Lgs, Sensor::Ngs]
        .map(|sensor| geometric(sensor, &pupil, &atmosphere, 0.123, &mirror));
    assert_eq!(lgs, ngs);
    for axis in [0, 1] {
        let mean = ngs.iter().map(|c| c[axis]).sum::<f64>() / 52.0;
        for (splash, ngs) in splash.iter().zip(&ngs) {
            assert!((splash[axis] - (ngs[axis] - mean)).abs() < 1e-9);
        }
    }
    // The wave-optical images see the same wavefront, up to what a centroid adds in turbulence.
    let images = expose(&pupil, &atmosphere, 0.123, &mirror);
    let (mut product, mut square) = (0.0, 0.0);
    for (image, splash) in images.chunks_exact(PIXELS).zip(&splash) {
        let image = centroid(image);
        product += image[0] * splash[0] + image[1] * splash[1];
        square += splash[0] * splash[0] + splash[1] * splash[1];
    }
    println!("images on geometric: slope {:.3}", product / square);
    assert!((product / square - 1.0).abs() < 0.15, "{}", product / square);
}

#[test]
fn pistons_do_not_move_geometric_centroids() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let atmosphere = turbulence(&pupil, &[layer(1.0, 3_000.0, 20.0)], 9);
    let flat = Mirror::flat(52);
    let mut stepped = Mirror::flat(52);
    for (k, segment) in stepped.segments.iter_mut().enumerate() {
        segment[0] = (k as f64).sin();
    }
    for sensor in [Sensor::Splash, Sensor::Lgs, Sensor::Ngs] {
        let [a, b] =
            [&flat, &stepped].map(|mirror| geometric(sensor, &pupil, &atmosphere, 0.1, mirror));
        assert_eq!(a, b);
    }
}

#[test]
fn images_do_not_depend_on_the_number_of_threads() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let layers = [layer(0.6, 0.0, 0.0), layer(0.4, 3_000.0, 90.0)];
    for layers in [&layers[..], &layers[..1]] {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let atmosphere = turbulence(&pupil, layers, 2);
                expose(&pupil, &atmosphere, 0.2, &Mirror::flat(52))
            })
        };
        let bits = |images: Vec<f32>| images.into_iter().map(f32::to_bits).collect::<Vec<_>>();
        let one = bits(run(1));
        assert_eq!(one, bits(run(2)));
        assert_eq!(one, bits(run(5)));
    }
}

#[test]
fn impossible_geometry_is_refused_by_name() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let atmosphere = turbulence(&pupil, &[layer(1.0, 12_000.0, 20.0)], 9);
    let message =
        |result: Result<SplashCamera, OpticsError>| result.map(|_| ()).unwrap_err().to_string();
    let large = Pupil::circular(9, 8, 0.5).unwrap();
    let new = |pupil, height_m, scale, window| {
        message(SplashCamera::new(pupil, &atmosphere, height_m, scale, window))
    };
    assert_eq!(
        new(&pupil, 12_000.0, 2.0, 16),
        "layers[0].height_m = 12000: must be < the beacon's height of 12000 m"
    );
    assert_eq!(
        new(&large, 2e4, 2.0, 16),
        "diameter_m = 4.5: must be <= the atmosphere's footprint of 4 m"
    );
    assert_eq!(new(&pupil, 2e4, 2.0, 33), "window = 33: must be 4 to 32 pixels");
    assert_eq!(
        new(&pupil, 2e4, 2.0, 20),
        "window = 20: must be <= 16 pixels (samples times pixels_per_lambda_d)"
    );
    assert_eq!(new(&pupil, 2e4, 0.5, 16), "pixels_per_lambda_d = 0.5: must be 1 to 8");
    assert_eq!(new(&pupil, f64::NAN, 2.0, 16), "beacon_height_m = NaN: must be finite and > 0");
}
