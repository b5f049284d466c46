//! Images of SPLASH spots and of guide stars against a slow double-precision model that shares no code
//! with them.

use host_sim::atmosphere::{Atmosphere, Layer};
use host_sim::optics::camera::Camera;
use host_sim::optics::geometric::Sensor;
use host_sim::optics::slab::Slab;
use host_sim::optics::splash_image::{PIXELS_PER_LAMBDA_D, SplashCamera};
use host_sim::pupil::{Mirror, Pupil};
use host_sim::screen::Screen;
use std::f64::consts::TAU;

const BEACON_M: f64 = 12_000.0;
const WINDOW: usize = 16;
const PIXELS: usize = WINDOW * WINDOW;

fn layer(weight: f64, height_m: f64, wind_direction_deg: f64) -> Layer {
    Layer { weight, height_m, wind_speed_m_per_s: 10.0, wind_direction_deg }
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

/// Phase less the mirror's at sample (row, col), on the way from a beacon at `source`, m from the axis and m
/// high, or from a star.
fn path_phase(
    pupil: &Pupil,
    atmosphere: &Atmosphere,
    layers: &[Layer],
    time_s: f64,
    mirror: &Mirror,
    source: Option<[f64; 3]>,
    [row, col]: [usize; 2],
) -> f64 {
    let (n, d) = (pupil.samples(), pupil.pitch_m());
    let coordinate = |k: usize| (k as f64 + 0.5) * d / n as f64 - pupil.diameter_m() / 2.0;
    let centre = |k: usize| (k as f64 + 0.5) * d - pupil.diameter_m() / 2.0;
    let x = [coordinate(col), coordinate(row)];
    let mut phase = 0.0;
    for (layer, screen) in layers.iter().zip(atmosphere.screens()) {
        let b = source.map_or(1.0, |[.., height_m]| 1.0 - layer.height_m / height_m);
        let angle = layer.wind_direction_deg.to_radians();
        let flown = [angle.cos(), angle.sin()].map(|c| -layer.wind_speed_m_per_s * time_s * c);
        let at = [0, 1].map(|k| b * x[k] + (1.0 - b) * source.unwrap_or_default()[k] + flown[k]);
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
    integrate(&image)
}

/// The light on each pixel, of an intensity on a grid of eight angles a pixel, its ends included: Boole's
/// rule.
fn integrate(image: &[Vec<f64>]) -> Vec<f64> {
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

/// A circle of four, three layers that blow, and a mirror of any shape.
fn scene() -> (Pupil, [Layer; 3], Atmosphere, Mirror) {
    let pupil = Pupil::circular(4, 8, 0.5).unwrap();
    let layers = [layer(0.5, 0.0, 20.0), layer(0.3, 3_000.0, 110.0), layer(0.2, 7_000.0, -60.0)];
    let atmosphere = Atmosphere::new(0.5, &layers, 2.0, 0.5, 0.5, 11).unwrap();
    let mut mirror = Mirror::flat(12);
    for (k, segment) in mirror.segments.iter_mut().enumerate() {
        *segment = [1, 2, 3].map(|part| (1.7 * f64::from(part) * (k as f64 + 1.0)).sin());
    }
    (pupil, layers, atmosphere, mirror)
}

#[test]
fn images_of_guide_stars_equal_brute_force() {
    let (pupil, layers, atmosphere, mirror) = scene();
    let time_s = 0.0371;
    for (sensor, source) in [(Sensor::Lgs, Some([0.0, 0.0, BEACON_M])), (Sensor::Ngs, None)] {
        let mut images = vec![0.0; 12 * PIXELS];
        let camera =
            Camera::new(sensor, &pupil, &atmosphere, BEACON_M, PIXELS_PER_LAMBDA_D, WINDOW);
        camera.unwrap().expose(&atmosphere, time_s, &mirror, &mut images);
        for (image, &[ix, iy]) in images.chunks_exact(PIXELS).zip(pupil.subapertures()) {
            let sample = |row: usize, col: usize| {
                let at = [iy * 8 + row, ix * 8 + col];
                Some(path_phase(&pupil, &atmosphere, &layers, time_s, &mirror, source, at))
            };
            let amplitude: Vec<Vec<_>> =
                (0..8).map(|row| (0..8).map(|col| sample(row, col)).collect()).collect();
            let expected = through_one(&amplitude);
            let peak = expected.iter().copied().fold(0.0, f64::max);
            let differ = |(a, b): (&f32, &f64)| (f64::from(*a) - b).abs() / peak;
            let worst = image.iter().zip(&expected).map(differ).fold(0.0, f64::max);
            println!(
                "{sensor:?}, subaperture {ix}, {iy}: pixels {worst:.1e} of the peak {peak:.3}"
            );
            assert!(worst < 1e-5, "{sensor:?} {ix} {iy}: pixels differ by {worst} of the peak");
        }
    }
}

#[test]
fn images_of_spots_equal_brute_force() {
    let (pupil, layers, atmosphere, mirror) = scene();
    let time_s = 0.0371;
    let centre = |k: usize| (k as f64 + 0.5) * pupil.pitch_m() - pupil.diameter_m() / 2.0;
    let mut images = vec![0.0; 12 * PIXELS];
    SplashCamera::new(&pupil, &atmosphere, BEACON_M, PIXELS_PER_LAMBDA_D, WINDOW).unwrap().expose(
        &atmosphere,
        time_s,
        &mirror,
        &mut images,
    );
    for spot in [0, 3, 10] {
        let subaperture = pupil.subapertures()[spot];
        let amplitude = |inside: &dyn Fn(usize, usize) -> bool| -> Vec<Vec<Option<f64>>> {
            let sample = |row: usize, col: usize| {
                let at = [row, col];
                inside(col / 8, row / 8).then(|| {
                    let [x, y] = subaperture.map(centre);
                    let source = Some([x, y, BEACON_M]);
                    path_phase(&pupil, &atmosphere, &layers, time_s, &mirror, source, at)
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

/// Fresnel's integral for a slab of two slices out of focus: phases are k times the path lengths from the place
/// of the scatterers to the pupil, less those from the focus, and each way has its own cone.
#[test]
fn images_of_deep_beacons_equal_path_lengths() {
    const WAVELENGTH_M: f64 = 532e-9;
    let slices = [(11_880.0, 0.3), (12_150.0, 0.7)];
    let (pupil, layers, atmosphere, mirror) = scene();
    let time_s = 0.0371;
    let centre = |k: usize| (k as f64 + 0.5) * pupil.pitch_m() - pupil.diameter_m() / 2.0;
    let coordinate = |k: usize| (k as f64 + 0.5) * pupil.pitch_m() / 8.0 - pupil.diameter_m() / 2.0;
    // sqrt(z^2 + r^2) - z, without cancellation.
    let longer = |z: f64, square: f64| square / ((z * z + square).sqrt() + z);
    let defocus = |z: f64, [x, y]: [f64; 2], [row, col]: [usize; 2]| {
        let square = (coordinate(col) - x).powi(2) + (coordinate(row) - y).powi(2);
        TAU / WAVELENGTH_M * (longer(z, square) - longer(BEACON_M, square))
    };
    let slab = Slab::new(BEACON_M, WAVELENGTH_M, &slices).unwrap();
    for sensor in [Sensor::Splash, Sensor::Lgs] {
        let mut images = vec![0.0; 12 * PIXELS];
        Camera::new(sensor, &pupil, &atmosphere, BEACON_M, PIXELS_PER_LAMBDA_D, WINDOW)
            .unwrap()
            .with_slab(slab.clone(), &atmosphere)
            .unwrap()
            .expose(&atmosphere, time_s, &mirror, &mut images);
        for spot in [0, 7] {
            let subaperture = pupil.subapertures()[spot];
            let [x, y] = if sensor == Sensor::Splash { subaperture.map(centre) } else { [0.0; 2] };
            let phase = |cone_m: f64, z: f64, at: [usize; 2]| {
                path_phase(&pupil, &atmosphere, &layers, time_s, &mirror, Some([x, y, cone_m]), at)
                    + defocus(z, [x, y], at)
            };
            let mut expected = vec![0.0; PIXELS];
            for (z, share) in slices {
                let amplitude = |cone_m: f64, inside: &dyn Fn(usize, usize) -> bool| {
                    let sample = |row: usize, col: usize| {
                        inside(col / 8, row / 8).then(|| phase(cone_m, z, [row, col]))
                    };
                    let line = |row| (0..32).map(|col| sample(row, col)).collect::<Vec<_>>();
                    (0..32).map(line).collect::<Vec<_>>()
                };
                let own = |ix: usize, iy: usize| [ix, iy] == subaperture;
                let image = match sensor {
                    Sensor::Splash => brute_force(
                        &amplitude(BEACON_M, &own),
                        &amplitude(z, &|ix, iy| pupil.contains(ix, iy)),
                    ),
                    _ => through_one(&amplitude(z, &own)),
                };
                for (sum, value) in expected.iter_mut().zip(image) {
                    *sum += share * value;
                }
            }
            let peak = expected.iter().copied().fold(0.0, f64::max);
            let image = &images[spot * PIXELS..][..PIXELS];
            let differ = |(a, b): (&f32, &f64)| (f64::from(*a) - b).abs() / peak;
            let worst = image.iter().zip(&expected).map(differ).fold(0.0, f64::max);
            println!("{sensor:?}, spot {spot}: pixels {worst:.1e} of the peak {peak:.4}");
            assert!(worst < 3e-5, "{sensor:?}, spot {spot}: {worst} of the peak");
        }
    }
}

/// The image of a point through an amplitude.
fn through_one(amplitude: &[Vec<Option<f64>>]) -> Vec<f64> {
    const FINE: usize = 128;
    let spread = point_spread(amplitude, FINE);
    // From minus to plus half a period; a mean of one makes the light of a period one.
    let wrap = |k: usize| (k + FINE / 2) % FINE;
    let line = |ky: usize| -> Vec<f64> {
        (0..=FINE).map(|kx| spread[wrap(ky)][wrap(kx)] / (FINE * FINE) as f64).collect()
    };
    integrate(&(0..=FINE).map(line).collect::<Vec<_>>())
}
