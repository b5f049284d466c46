//! Images of SPLASH spots against a slow double-precision model, and what tilts do to them.

use host_sim::atmosphere::{Atmosphere, Layer};
use host_sim::optics::OpticsError;
use host_sim::optics::geometric::{GeometricSensor, Sensor};
use host_sim::optics::splash_image::{PIXELS_PER_LAMBDA_D, SplashCamera};
use host_sim::pupil::{Mirror, Pupil};
use host_sim::screen::Screen;
use std::f64::consts::{PI, TAU};

const BEACON_M: f64 = 12_000.0;
const WINDOW: usize = 16;
const PIXELS: usize = WINDOW * WINDOW;

fn layer(weight: f64, height_m: f64, wind_direction_deg: f64) -> Layer {
    Layer { weight, height_m, wind_speed_m_per_s: 10.0, wind_direction_deg }
}

fn turbulence(pupil: &Pupil, layers: &[Layer], seed: u64) -> Atmosphere {
    Atmosphere::new(0.5, layers, pupil.diameter_m(), pupil.pitch_m(), 0.5, seed).unwrap()
}

fn still_air(pupil: &Pupil) -> Atmosphere {
    Atmosphere::from_screens(vec![], pupil.diameter_m(), 0.0).unwrap()
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

/// A complex number, kept apart from any library.
type Complex = [f64; 2];

/// Catmull-Rom interpolation between four values.
fn cubic(p: [f64; 4], f: f64) -> f64 {
    let slope = [(p[2] - p[0]) / 2.0, (p[3] - p[1]) / 2.0];
    let (f2, f3) = (f * f, f * f * f);
    (2.0 * f3 - 3.0 * f2 + 1.0) * p[1]
        + (f3 - 2.0 * f2 + f) * slope[0]
        + (3.0 * f2 - 2.0 * f3) * p[2]
        + (f3 - f2) * slope[1]
}

/// Phase of a layer at a place in the layer's plane, from its texels.
fn screen_phase(screen: &Screen, at: [f64; 2], above_axis: [f64; 2]) -> f64 {
    let place = [0, 1].map(|axis| (at[axis] - screen.first_m()[axis]) / screen.texel_m());
    let first = place.map(|place| place.floor() as i64);
    let rows = [-1, 0, 1, 2].map(|dy| {
        let row = [-1, 0, 1, 2].map(|dx| f64::from(screen.texel(first[0] + dx, first[1] + dy)));
        cubic(row, place[0] - place[0].floor())
    });
    let gradient = screen.gradient_rad_per_m();
    let plane: f64 = (0..2).map(|axis| gradient[axis] * (at[axis] - above_axis[axis])).sum();
    cubic(rows, place[1] - place[1].floor()) + plane
}

/// Phase less the mirror's at sample (row, col), on the way to or from spot (ix, iy).
fn path_phase(
    pupil: &Pupil,
    atmosphere: &Atmosphere,
    layers: &[Layer],
    time_s: f64,
    mirror: &Mirror,
    spot: [usize; 2],
    [row, col]: [usize; 2],
) -> f64 {
    let (n, d) = (pupil.samples(), pupil.pitch_m());
    let coordinate = |k: usize| (k as f64 + 0.5) * d / n as f64 - pupil.diameter_m() / 2.0;
    let centre = |k: usize| (k as f64 + 0.5) * d - pupil.diameter_m() / 2.0;
    let x = [coordinate(col), coordinate(row)];
    let mut phase = 0.0;
    for (layer, screen) in layers.iter().zip(atmosphere.screens()) {
        let b = 1.0 - layer.height_m / BEACON_M;
        let angle = layer.wind_direction_deg.to_radians();
        let flown = [angle.cos(), angle.sin()].map(|c| -layer.wind_speed_m_per_s * time_s * c);
        let at = [0, 1].map(|k| b * x[k] + (1.0 - b) * centre(spot[k]) + flown[k]);
        phase += screen_phase(screen, at, flown);
    }
    let segment = [col / n, row / n];
    if let Some(index) = pupil.subapertures().iter().position(|&s| s == segment) {
        let [piston, tip, tilt] = mirror.segments[index];
        let edge = [0, 1].map(|k| 2.0 * (x[k] - centre(segment[k])) / d);
        phase -= piston + tip * edge[0] + tilt * edge[1];
    }
    phase
}

/// |sum over samples of exp(i phase - 2 pi i u . sample)|^2 on a grid of `fine` angles per period,
/// normalised to a mean of one.
fn point_spread(amplitude: &[Vec<Option<f64>>], fine: usize) -> Vec<Vec<f64>> {
    let side = amplitude.len();
    let turn = |k: usize, s: usize| (TAU * ((k * s) % fine) as f64 / fine as f64).sin_cos();
    let mut along_x = vec![vec![[0.0; 2]; fine]; side];
    for (out, row) in along_x.iter_mut().zip(amplitude) {
        for (k, sum) in out.iter_mut().enumerate() {
            for (s, phase) in row.iter().enumerate().filter_map(|(s, p)| p.map(|p| (s, p))) {
                let (sin, cos) = (phase - TAU * ((k * s) % fine) as f64 / fine as f64).sin_cos();
                *sum = [sum[0] + cos, sum[1] + sin];
            }
        }
    }
    let light = amplitude.iter().flatten().flatten().count() as f64;
    let mut intensity = vec![vec![0.0; fine]; fine];
    for (ky, row) in intensity.iter_mut().enumerate() {
        for (kx, value) in row.iter_mut().enumerate() {
            let mut sum: Complex = [0.0; 2];
            for (s, x) in along_x.iter().enumerate() {
                let (sin, cos) = turn(ky, s);
                sum = [
                    sum[0] + x[kx][0] * cos + x[kx][1] * sin,
                    sum[1] + x[kx][1] * cos - x[kx][0] * sin,
                ];
            }
            *value = (sum[0] * sum[0] + sum[1] * sum[1]) / light;
        }
    }
    intensity
}

/// The image of one spot by brute force: upward point spread function correlated with the
/// downward one on a grid of 128 angles per period of the sampled pupil (8 per pixel), integrated
/// over the pixels by Boole's rule.
fn brute_force(up: &[Vec<Option<f64>>], down: &[Vec<Option<f64>>]) -> Vec<f64> {
    const FINE: usize = 128;
    let (up, down) = (point_spread(up, FINE), point_spread(down, FINE));
    let mut image = vec![vec![0.0; FINE + 1]; FINE + 1];
    let wrap = |k: usize| (k + FINE / 2) % FINE;
    for (ky, row) in image.iter_mut().enumerate() {
        for (kx, value) in row.iter_mut().enumerate() {
            let (oy, ox) = (wrap(ky), wrap(kx));
            // I(u) = sum over v of up(u + v) down(v): the downward function reversed.
            for (vy, down) in down.iter().enumerate() {
                let up = &up[(oy + vy) % FINE];
                let (head, tail) = up.split_at(ox);
                let turned = tail.iter().chain(head);
                *value += turned.zip(down).map(|(a, b)| a * b).sum::<f64>();
            }
            *value /= (FINE as f64).powi(4);
        }
    }
    let boole = [7.0, 32.0, 12.0, 32.0, 14.0, 32.0, 12.0, 32.0, 7.0].map(|w| w * 2.0 / 45.0);
    let mut pixels = vec![0.0; PIXELS];
    for (k, pixel) in pixels.iter_mut().enumerate() {
        let (y, x) = (k / WINDOW * 8, k % WINDOW * 8);
        for (dy, wy) in boole.iter().enumerate() {
            for (dx, wx) in boole.iter().enumerate() {
                *pixel += wy * wx * image[y + dy][x + dx];
            }
        }
    }
    pixels
}

#[test]
fn images_equal_brute_force() {
    let pupil = Pupil::circular(4, 8, 0.5).unwrap();
    let layers = [layer(0.5, 0.0, 20.0), layer(0.3, 3_000.0, 110.0), layer(0.2, 7_000.0, -60.0)];
    let atmosphere = turbulence(&pupil, &layers, 11);
    let time_s = 0.0371;
    let mut mirror = Mirror::flat(12);
    for (k, segment) in mirror.segments.iter_mut().enumerate() {
        *segment = [1, 2, 3].map(|part| (1.7 * part as f64 * (k as f64 + 1.0)).sin());
    }
    let images = expose(&pupil, &atmosphere, time_s, &mirror);
    for spot in [0, 3, 10] {
        let subaperture = pupil.subapertures()[spot];
        let amplitude = |inside: &dyn Fn(usize, usize) -> bool| -> Vec<Vec<Option<f64>>> {
            let sample = |row: usize, col: usize| {
                let at = [row, col];
                inside(col / 8, row / 8).then(|| {
                    path_phase(&pupil, &atmosphere, &layers, time_s, &mirror, subaperture, at)
                })
            };
            (0..32).map(|row| (0..32).map(|col| sample(row, col)).collect()).collect()
        };
        let up = amplitude(&|ix, iy| [ix, iy] == subaperture);
        let down = amplitude(&|ix, iy| pupil.contains(ix, iy));
        let expected = brute_force(&up, &down);
        let image: Vec<f64> = images[spot * PIXELS..][..PIXELS].iter().map(|&v| v.into()).collect();
        let peak = expected.iter().copied().fold(0.0, f64::max);
        let worst =
            image.iter().zip(&expected).map(|(a, b)| (a - b).abs() / peak).fold(0.0, f64::max);
        let ([sum, x, y], [sum_e, x_e, y_e]) = (moments(&image), moments(&expected));
        let shift = (x / sum - x_e / sum_e).hypot(y / sum - y_e / sum_e);
        let signal = (x_e / sum_e).hypot(y_e / sum_e);
        println!(
            "spot {spot}: pixels {worst:.1e} of the peak, centroid {shift:.1e} of {signal:.3} px"
        );
        assert!(worst < 1e-5, "spot {spot}: pixels differ by {worst} of the peak");
        assert!(shift < 1e-5 * signal, "spot {spot}: {shift} px of {signal} px");
    }
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
