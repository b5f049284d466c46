//! Beams that are not uniform: far fields against the transform of a cut-off Gaussian beam, centroids
//! against its weighted mean gradient.

#[path = "common/still_air.rs"]
mod still_air;

use host_sim::atmosphere::{Atmosphere, Layer};
use host_sim::optics::geometric::{GeometricSensor, Sensor};
use host_sim::optics::launch::Launch;
use host_sim::optics::splash_image::{PIXELS_PER_LAMBDA_D, SplashCamera};
use host_sim::pupil::{Mirror, Pupil};
use host_sim::screen::Screen;
use std::f64::consts::{PI, SQRT_2, TAU};
use still_air::still_air;

const BEACON_M: f64 = 12_000.0;

fn images(
    pupil: &Pupil,
    atmosphere: &Atmosphere,
    launch: Launch,
    scale: f64,
    window: usize,
) -> Vec<f32> {
    let mut camera =
        SplashCamera::new(pupil, atmosphere, BEACON_M, scale, window).unwrap().with_launch(launch);
    let mut images = vec![0.0; camera.spots() * window * window];
    camera.expose(atmosphere, 0.0, &Mirror::flat(pupil.subapertures().len()), &mut images);
    images
}

/// Transfer function at lag l, in sides of the subaperture, of a Gaussian beam cut off by it: of the integral
/// of exp(-(x^2 + (x + l)^2)/w^2) over the overlap.
fn cut_gaussian(lag: f64, waist: f64) -> f64 {
    let overlap = |l: f64| libm::erf((1.0 - l.abs()) / (SQRT_2 * waist));
    (-lag * lag / (2.0 * waist * waist)).exp() * overlap(lag) / overlap(0.0)
}

/// One subaperture launches and receives: its transfer function is the beam's times the triangle of the
/// uniform square, on either axis.
#[test]
fn far_fields_are_those_of_cut_gaussian_beams() {
    const SAMPLES: usize = 32;
    const WINDOW: usize = 24;
    let pupil = Pupil::square(1, SAMPLES, 0.5).unwrap();
    let pixel = 1.0 / PIXELS_PER_LAMBDA_D;
    for waist_pitches in [0.25, 0.5, 1.0] {
        let launch = Launch::Gaussian { waist_pitches };
        let image = images(&pupil, &still_air(&pupil), launch, PIXELS_PER_LAMBDA_D, WINDOW);
        // Light on pixel k: the sum over the sampled lags of OTF(l) times the pixel's mean of cos(2 pi l u).
        let line: Vec<f64> = (0..WINDOW)
            .map(|k| {
                let u = (k as f64 - (WINDOW as f64 - 1.0) / 2.0) * pixel;
                let lags = (1 - SAMPLES as i64..SAMPLES as i64).map(|l| l as f64 / SAMPLES as f64);
                let term = |l: f64| {
                    let half = PI * l * pixel;
                    let mean = if l == 0.0 { 1.0 } else { half.sin() / half };
                    cut_gaussian(l, waist_pitches) * (1.0 - l.abs()) * mean * (TAU * l * u).cos()
                };
                lags.map(term).sum::<f64>() * pixel / SAMPLES as f64
            })
            .collect();
        let peak = line.iter().copied().fold(0.0, f64::max).powi(2);
        let mut worst = 0.0_f64;
        for (k, &value) in image.iter().enumerate() {
            let expected = line[k % WINDOW] * line[k / WINDOW];
            worst = worst.max((f64::from(value) - expected).abs() / peak);
        }
        println!("waist {waist_pitches}: {worst:.1e} of the peak {peak:.3}");
        // The midpoint rule over 32 samples is off by 1e-3 of the curvature at the cut.
        assert!(worst < 1e-3, "waist {waist_pitches}: {worst}");
    }
}

/// All of the beam that passes is in one period of the image, whatever its shape.
#[test]
fn light_is_conserved() {
    let pupil = Pupil::square(2, 8, 0.5).unwrap();
    for waist_pitches in [0.2, 0.7, 10.0] {
        let image = images(&pupil, &still_air(&pupil), Launch::Gaussian { waist_pitches }, 2.0, 16);
        let sum: f64 = image[..256].iter().map(|&value| f64::from(value)).sum();
        assert!((sum - 1.0).abs() < 1e-5, "{sum}");
    }
}

/// A waist of many pitches is a uniform beam.
#[test]
fn wide_beams_are_uniform() {
    let pupil = Pupil::square(2, 8, 0.5).unwrap();
    let of = |launch| images(&pupil, &still_air(&pupil), launch, 2.0, 16);
    let (uniform, wide) = (of(Launch::Uniform), of(Launch::Gaussian { waist_pitches: 10.0 }));
    let peak = uniform.iter().copied().fold(0.0, f32::max);
    for (a, b) in uniform.iter().zip(&wide) {
        // The intensity at a corner is exp(-2 (0.5^2 + 0.5^2) / 10^2) = 0.990 of the peak.
        assert!((a - b).abs() < 0.005 * peak, "{a} {b}");
    }
}

/// A sinusoidal layer moves a spot by the mean gradient that the beam's intensity weights, on images (a period
/// wide, plain centre of gravity) and as gradients.
#[test]
fn centroids_are_weighted_mean_gradients() {
    const WINDOW: usize = 32;
    let pupil = Pupil::square(4, 16, 0.5).unwrap();
    let (d, b) = (pupil.pitch_m(), 0.75);
    let (amplitude, k, psi) = (0.02, TAU / 0.8, 0.4);
    let screen = Screen::from_fn([pupil.diameter_m() * 1.1; 2], d / 16.0, |x, _| {
        amplitude * (k * x + psi).cos()
    });
    let layer =
        Layer { weight: 1.0, height_m: 3000.0, wind_speed_m_per_s: 0.0, wind_direction_deg: 0.0 };
    let layers = vec![(layer, screen.unwrap())];
    let atmosphere = Atmosphere::from_screens(layers, pupil.diameter_m(), 0.0).unwrap();
    let mut means = vec![];
    for launch in [Launch::Uniform, Launch::Gaussian { waist_pitches: 0.3 }] {
        let weight = |u: f64| match launch {
            Launch::Uniform => 1.0,
            Launch::Gaussian { waist_pitches } => (-2.0 * (u / (waist_pitches * d)).powi(2)).exp(),
        };
        let places = (0..1000).map(|j| ((f64::from(j) + 0.5) / 1000.0 - 0.5) * d);
        let (mut sum, mut light) = (0.0, 0.0);
        for u in places {
            sum += weight(u) * (k * b * u).cos();
            light += weight(u);
        }
        let beam = sum / light;
        means.push(beam);
        let px = amplitude * b * k * d / PI;
        let half = k * b * pupil.diameter_m() / 2.0;
        let expected: Vec<f64> = pupil
            .subapertures()
            .iter()
            .map(|s| pupil.centre_m(s[0]))
            .map(|x| {
                let whole = (k * (1.0 - b) * x + psi).sin() * half.sin() / half;
                -px * ((k * x + psi).sin() * beam - whole)
            })
            .collect();
        let mut centroids = vec![[0.0; 2]; 16];
        GeometricSensor::new(Sensor::Splash, &pupil, &atmosphere, BEACON_M, PIXELS_PER_LAMBDA_D)
            .unwrap()
            .with_launch(launch)
            .centroids(&atmosphere, 0.0, &Mirror::flat(16), &mut centroids);
        let images = images(&pupil, &atmosphere, launch, PIXELS_PER_LAMBDA_D, WINDOW);
        let seen = images.chunks_exact(WINDOW * WINDOW).map(|image| {
            let total: f64 = image.iter().map(|&v| f64::from(v)).sum();
            let x = |k: usize| (k % WINDOW) as f64 - (WINDOW as f64 - 1.0) / 2.0;
            image.iter().enumerate().map(|(k, &v)| f64::from(v) * x(k)).sum::<f64>() / total
        });
        let rms = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
        let signal = rms(&mut expected.iter().copied());
        let error = rms(&mut centroids.iter().zip(&expected).map(|(c, e)| c[0] - e)) / signal;
        let error_seen = rms(&mut seen.zip(&expected).map(|(c, e)| c - e)) / signal;
        println!("{launch:?}: mean {beam:.3}; gradients {error:.4}, images {error_seen:.4}");
        assert!(error < 0.005, "{launch:?}: {error}");
        // Images see differences of samples, not of the edges of their cells: sixteen have fifteen steps.
        assert!(error_seen < 0.03, "{launch:?}: {error_seen}");
    }
    // The narrow beam averages less of the wave: were the weight left out, the last would fail.
    assert!(means[1] - means[0] > 0.2, "{means:?}");
}
