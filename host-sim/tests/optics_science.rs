//! The science path: plane removal, fitting error, Strehl ratio and long exposures.

use host_sim::atmosphere::{Atmosphere, Layer, Turbulence};
use host_sim::optics::long_exposure::LongExposure;
use host_sim::optics::phase::{Path, PhaseSampler};
use host_sim::optics::science::Science;
use host_sim::pupil::{Mirror, Pupil};
use host_sim::screen::Screen;
use std::f64::consts::TAU;

const WAVELENGTH_M: f64 = 532e-9;

fn still(height_m: f64) -> Layer {
    Layer { weight: 1.0, height_m, wind_speed_m_per_s: 0.0, wind_direction_deg: 0.0 }
}

fn aberration(pupil: &Pupil, phase_rad: impl FnMut(f64, f64) -> f64) -> Atmosphere {
    let extent_m = [1.1 * pupil.diameter_m(); 2];
    let screen = Screen::from_fn(extent_m, pupil.pitch_m() / 16.0, phase_rad).unwrap();
    Atmosphere::from_screens(vec![(still(3000.0), screen)], pupil.diameter_m(), 0.0).unwrap()
}

/// Least squares of a + b x + c y by Gauss elimination of the 3 x 3 normal equations.
fn fit_plane(points: &[([f64; 2], f64)]) -> [f64; 3] {
    let mut m = [[0.0; 4]; 3];
    for &([x, y], value) in points {
        let basis = [1.0, x, y];
        for (row, a) in m.iter_mut().zip(basis) {
            for (sum, b) in row.iter_mut().zip([1.0, x, y, value]) {
                *sum += a * b;
            }
        }
    }
    for pivot in 0..3 {
        for row in 0..3 {
            if row != pivot {
                let factor = m[row][pivot] / m[pivot][pivot];
                let above = m[pivot];
                m[row].iter_mut().zip(above).for_each(|(value, above)| *value -= factor * above);
            }
        }
    }
    [0, 1, 2].map(|k| m[k][3] / m[k][k])
}

/// Samples in use, as (place in m, index in the phase array).
fn samples(pupil: &Pupil) -> Vec<([f64; 2], usize)> {
    let side = pupil.side();
    let all = (0..side * side).map(|k| ([pupil.sample_m(k % side), pupil.sample_m(k / side)], k));
    all.filter(|&(_, k)| pupil.illuminates(k / side, k % side)).collect()
}

#[test]
fn the_plane_removed_is_the_least_squares_plane() {
    // A lopsided pupil: piston, tip and tilt are not orthogonal over it.
    let mut mask = Pupil::circular(8, 6, 0.4).unwrap().mask().to_vec();
    for hole in [3, 11, 12, 20, 30] {
        mask[hole] = false;
    }
    let pupil = Pupil::new(8, 6, 0.4, mask).unwrap();
    let layers = [still(0.0), still(5000.0)];
    let atmosphere = Atmosphere::new(0.3, &layers, pupil.diameter_m(), 0.4, 0.0, 8).unwrap();
    let mut mirror = Mirror::flat(pupil.subapertures().len());
    for (k, segment) in mirror.segments.iter_mut().enumerate() {
        *segment = [1, 2, 3].map(|part| (1.3 * (k * part) as f64).cos());
    }
    let ratio = 0.5;
    let mut science =
        Science::new(&pupil, &atmosphere, WAVELENGTH_M, WAVELENGTH_M / ratio).unwrap();
    let seen = science.observe(&atmosphere, 0.0, &mirror);

    let side = pupil.side();
    let (mut phase, mut shape) = (vec![0.0; side * side], vec![0.0; side * side]);
    PhaseSampler::default().sample(Path::Star, &pupil, &atmosphere, 0.0, &mut phase);
    mirror.phase(&pupil, &mut shape);
    let points: Vec<([f64; 2], f64, usize)> = (0..side * side)
        .filter(|k| pupil.illuminates(k / side, k % side))
        .map(|k| {
            let value = ratio * (f64::from(phase[k]) - f64::from(shape[k]));
            ([pupil.sample_m(k % side), pupil.sample_m(k / side)], value, k)
        })
        .collect();
    let plane = fit_plane(&points.iter().map(|p| (p.0, p.1)).collect::<Vec<_>>());
    let (mut variance, mut re, mut im) = (0.0, 0.0, 0.0);
    let count = points.len() as f64;
    for &([x, y], value, k) in &points {
        let residual = value - plane[0] - plane[1] * x - plane[2] * y;
        assert!((f64::from(science.residual()[k]) - residual).abs() < 1e-5);
        variance += residual * residual / count;
        re += residual.cos() / count;
        im += residual.sin() / count;
    }
    assert!((seen.variance_rad2 / variance - 1.0).abs() < 1e-5);
    assert!((seen.strehl - (re * re + im * im)).abs() < 1e-5);
    assert!((seen.piston_rad - plane[0]).abs() < 1e-5);
    assert!((seen.gradient_rad_per_m[0] - plane[1]).abs() < 1e-5);
    assert!((seen.gradient_rad_per_m[1] - plane[2]).abs() < 1e-5);
    let dark = (0..side * side).filter(|k| !pupil.illuminates(k / side, k % side));
    assert!(dark.map(|k| science.residual()[k]).all(|value| value == 0.0));
}

/// The best piston, tip and tilt of square segments of side r0 leave 0.1704 rad^2 on eight samples
/// (0.175 on a continuous wavefront). The plane over the whole pupil, which the science path
/// removes as well, is zero after that fit: each segment's own plane already is.
#[test]
fn fitting_error_of_square_segments() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let diameter_m = pupil.diameter_m();
    // Footprints a diameter apart, along the path of the wind.
    let layers = [Layer { wind_speed_m_per_s: diameter_m, ..still(0.0) }];
    let (realisations, footprints) = (12, 10);
    let turbulence = Turbulence::new(0.5, &layers, diameter_m, 0.5, f64::from(footprints)).unwrap();
    let side = pupil.side();
    let mut phase = vec![0.0; side * side];
    let mut sampler = PhaseSampler::default();
    let mut sum = 0.0;
    let mut science = None;
    for seed in 0..realisations {
        let atmosphere = turbulence.realise(100 + seed, &mut |_| ());
        let science = science.get_or_insert_with(|| {
            Science::new(&pupil, &atmosphere, WAVELENGTH_M, WAVELENGTH_M).unwrap()
        });
        for frame in 0..footprints {
            let time_s = f64::from(frame);
            sampler.sample(Path::Star, &pupil, &atmosphere, time_s, &mut phase);
            let fit = |&[ix, iy]: &[usize; 2]| {
                let at = |j: usize, k: usize| f64::from(phase[(iy * 8 + j) * side + ix * 8 + k]);
                let edge = |k: usize| (k as f64 - 3.5) / 4.0;
                let points = (0..64).map(|k| ([edge(k % 8), edge(k / 8)], at(k / 8, k % 8)));
                fit_plane(&points.collect::<Vec<_>>())
            };
            let mirror = Mirror { segments: pupil.subapertures().iter().map(fit).collect() };
            sum += science.observe(&atmosphere, time_s, &mirror).variance_rad2;
        }
    }
    let mean = sum / (realisations as f64 * f64::from(footprints));
    println!("fitting error {mean:.4} rad^2");
    assert!((mean / 0.1704 - 1.0).abs() < 0.03, "{mean} rad^2");
}

#[test]
fn strehl_of_a_sinusoid() {
    // |<exp(i A cos)>|^2 over whole periods is J0(A)^2.
    let pupil = Pupil::square(8, 8, 0.5).unwrap();
    let k = TAU * 4.0 / pupil.diameter_m();
    let atmosphere = aberration(&pupil, |x, _| 0.8 * (k * x).cos());
    let mut science = Science::new(&pupil, &atmosphere, WAVELENGTH_M, WAVELENGTH_M).unwrap();
    let seen = science.observe(&atmosphere, 0.0, &Mirror::flat(64));
    let j0: f64 = 0.846_287_352_750_480_3;
    println!("Strehl {:.5} for {:.5}", seen.strehl, j0 * j0);
    assert!((seen.strehl - j0 * j0).abs() < 1e-3);
    assert!((seen.variance_rad2 - 0.32).abs() < 1e-3);

    let mut exposure = LongExposure::new(&pupil);
    exposure.add(science.residual());
    assert!((exposure.strehl() - seen.strehl).abs() < 1e-5);
    exposure.add(&vec![0.0; pupil.side() * pupil.side()]);
    assert!((exposure.strehl() - (seen.strehl + 1.0) / 2.0).abs() < 1e-5);
    assert_eq!(exposure.frames(), 2);
}

/// A plane moves the image by gradient lambda / 2 pi, to the side where the phase grows.
#[test]
fn long_exposure_has_its_axis_at_the_centre() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let mut exposure = LongExposure::new(&pupil);
    let side = exposure.side();
    // Three pixels to +x, five to -y.
    let mut phase = vec![0.0; 64 * 64];
    for (place, index) in samples(&pupil) {
        let [x, y] = place.map(|m| m / pupil.sample_pitch_m() / side as f64);
        phase[index] = (TAU * (3.0 * x - 5.0 * y)) as f32;
    }
    exposure.add(&phase);
    let image = exposure.image();
    let brightest = (0..image.len()).max_by(|&a, &b| image[a].total_cmp(&image[b])).unwrap();
    assert_eq!((brightest % side, brightest / side), (side / 2 + 3, side / 2 - 5));
    assert!((image[brightest] - 1.0).abs() < 1e-5);
    // Parseval: the mean over all directions of |FT|^2 is the number of samples.
    let sum: f64 = image.iter().map(|&value| f64::from(value)).sum();
    let expected = (side * side) as f64 / pupil.illuminated_samples() as f64;
    assert!((sum / expected - 1.0).abs() < 1e-5);
    assert!((exposure.pixel_in_lambda_over_diameter() - 0.25).abs() < 1e-12);
}
