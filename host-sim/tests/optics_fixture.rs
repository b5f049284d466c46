//! SPLASH and laser guide star centroids, from images and as gradients, of a sinusoidal layer, against the analytic mean
//! gradients (Butterley et al. 2006, section 2): with sinc u = sin u / u and b = 1 - h/H, in
//! radians per unit length,
//! SPLASH: c_i = -A b k [sin(k x_i + psi) sinc(k b d/2) - sin(k (1-b) x_i + psi) sinc(k b D/2)]
//! LGS: c_i = -A b k sin(k b x_i + psi) sinc(k b d/2).

#[path = "common/sinusoid.rs"]
mod sinusoid;

use host_sim::optics::camera::Camera;
use host_sim::optics::geometric::{GeometricSensor, Sensor};
use host_sim::optics::splash_image::PIXELS_PER_LAMBDA_D;
use host_sim::pupil::{Mirror, Pupil};
use sinusoid::{sinc, sinusoid};
use std::f64::consts::{PI, TAU};

const BEACON_M: f64 = 12_000.0;
const LAYER_M: f64 = 3_000.0;
const B: f64 = 0.75;

fn centre_of_gravity(image: &[f32], window: usize) -> [f64; 2] {
    let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
    for (k, &value) in image.iter().enumerate() {
        let centre = (window as f64 - 1.0) / 2.0;
        sum += f64::from(value);
        x += f64::from(value) * ((k % window) as f64 - centre);
        y += f64::from(value) * ((k / window) as f64 - centre);
    }
    [x / sum, y / sum]
}

/// rms of a - b over rms of b, along `axis`; the other axis must be quiet.
fn relative_rms(a: &[[f64; 2]], b: &[f64], axis: usize) -> f64 {
    let signal = b.iter().map(|b| b * b).sum::<f64>().sqrt();
    let error = a.iter().zip(b).map(|(a, b)| (a[axis] - b).powi(2)).sum::<f64>().sqrt();
    let across = a.iter().map(|a| a[1 - axis].powi(2)).sum::<f64>().sqrt();
    assert!(across < 0.02 * signal, "cross talk {across} of {signal}");
    error / signal
}

#[test]
fn sinusoidal_layer() {
    const WINDOW: usize = 32;
    let pupil = Pupil::square(8, 16, 0.5).unwrap();
    let (d, diameter_m) = (pupil.pitch_m(), pupil.diameter_m());
    let mirror = Mirror::flat(64);
    let mut worst = [0.0_f64; 4];
    for axis in [0, 1] {
        for cycles in [0.5, 1.0, 1.5, 2.0, 3.0] {
            for psi in [0.3, 1.9] {
                let (amplitude, k) = (0.02, TAU * cycles / diameter_m);
                let atmosphere = sinusoid(&pupil, axis, LAYER_M, [amplitude, k, psi]);
                // px per (rad per m): lambda/(2 pi) in pixels of lambda/2d
                let scale = amplitude * B * k * d / PI;
                let centres = pupil.subapertures().iter().map(|s| pupil.centre_m(s[axis]));
                let splash: Vec<f64> = centres
                    .clone()
                    .map(|x| {
                        let local = (k * x + psi).sin() * sinc(k * B * d / 2.0);
                        let global =
                            (k * (1.0 - B) * x + psi).sin() * sinc(k * B * diameter_m / 2.0);
                        -scale * (local - global)
                    })
                    .collect();
                let lgs: Vec<f64> = centres
                    .map(|x| -scale * (k * B * x + psi).sin() * sinc(k * B * d / 2.0))
                    .collect();

                let images = |sensor| -> Vec<[f64; 2]> {
                    let mut images = vec![0.0; 64 * WINDOW * WINDOW];
                    let scale = PIXELS_PER_LAMBDA_D;
                    let camera = Camera::new(sensor, &pupil, &atmosphere, BEACON_M, scale, WINDOW);
                    camera.unwrap().expose(&atmosphere, 0.0, &mirror, &mut images);
                    let windows = images.chunks_exact(WINDOW * WINDOW);
                    windows.map(|image| centre_of_gravity(image, WINDOW)).collect()
                };
                let geometric = |sensor| {
                    let mut centroids = vec![[0.0; 2]; 64];
                    GeometricSensor::new(
                        sensor,
                        &pupil,
                        &atmosphere,
                        BEACON_M,
                        PIXELS_PER_LAMBDA_D,
                    )
                    .unwrap()
                    .centroids(&atmosphere, 0.0, &mirror, &mut centroids);
                    centroids
                };
                let errors = [
                    relative_rms(&images(Sensor::Splash), &splash, axis),
                    relative_rms(&geometric(Sensor::Splash), &splash, axis),
                    relative_rms(&geometric(Sensor::Lgs), &lgs, axis),
                    relative_rms(&images(Sensor::Lgs), &lgs, axis),
                ];
                println!("axis {axis}, {cycles} cycles, psi {psi}: {errors:.5?}");
                for (worst, error) in worst.iter_mut().zip(errors) {
                    *worst = worst.max(error);
                }
            }
        }
    }
    // Sixteen samples have fifteen steps: their mean gradient is that of a smaller square.
    assert!(worst[0] < 0.03 && worst[3] < 0.012, "images {worst:?}");
    assert!(worst[1] < 0.005 && worst[2] < 0.005, "geometric {worst:?}");
}
