//! Exact gradients of a second gate at height z, of a sinusoidal layer A cos(k x + psi) at h in a square pupil.
//!
//! A ray that leaves the telescope at x_i + u, on its way to the focus (x_i, H), meets the layer at x_i + b u,
//! b = 1 - h/H. There it is turned by lambda/(2 pi) times the gradient -A k sin(k (x_i + b u) + psi), and arrives at z
//! displaced by that times z - h: an angle of b_z = 1 - h/z times it, seen from the telescope. Its mean over |u| < d/2
//! is -A b_z k sin(k x_i + psi) sinc(k b d/2), with sinc u = sin u / u.
//!
//! A ray from the spot (x_i, z) to the pupil's point x meets the layer at b_z x + (1 - b_z) x_i. The phase at x has the
//! gradient -A b_z k sin(k b_z x + k (1 - b_z) x_i + psi), whose mean over |x| < D/2 is
//! -A b_z k sin(k (1 - b_z) x_i + psi) sinc(k b_z D/2). It moves the image the other way.

#[path = "common/sinusoid.rs"]
mod sinusoid;

use host_sim::atmosphere::Atmosphere;
use host_sim::optics::geometric::{GeometricSensor, Sensor};
use host_sim::optics::splash_image::PIXELS_PER_LAMBDA_D;
use host_sim::pupil::{Mirror, Pupil};
use sinusoid::{sinc, sinusoid};
use std::f64::consts::{PI, TAU};

const BEACON_M: f64 = 12_000.0;

fn sensor(pupil: &Pupil, atmosphere: &Atmosphere) -> GeometricSensor {
    let (splash, scale) = (Sensor::Splash, PIXELS_PER_LAMBDA_D);
    GeometricSensor::new(splash, pupil, atmosphere, BEACON_M, scale).unwrap()
}

fn look(mut sensor: GeometricSensor, atmosphere: &Atmosphere, mirror: &Mirror) -> Vec<[f64; 2]> {
    let mut centroids = vec![[0.0; 2]; mirror.segments.len()];
    sensor.centroids(atmosphere, 0.0, mirror, &mut centroids);
    centroids
}

#[test]
fn sinusoidal_layer_at_a_second_gate() {
    let pupil = Pupil::square(8, 16, 0.5).unwrap();
    let (d, diameter_m) = (pupil.pitch_m(), pupil.diameter_m());
    let flat = Mirror::flat(64);
    for (height_m, gate_m) in [(3_000.0, 6_000.0), (3_000.0, 4_000.0), (1_500.0, 9_000.0)] {
        let (b, b_z) = (1.0 - height_m / BEACON_M, 1.0 - height_m / gate_m);
        for (axis, cycles, psi) in [(0, 0.5, 0.3), (1, 1.5, 1.9), (0, 3.0, 0.3), (1, 5.0, 1.9)] {
            let (a, k) = (0.02, TAU * cycles / diameter_m);
            let atmosphere = sinusoid(&pupil, axis, height_m, [a, k, psi]);
            let seen = sensor(&pupil, &atmosphere).with_gate(gate_m).unwrap();
            let seen = look(seen, &atmosphere, &flat);
            // px per (rad per m): lambda/(2 pi) in pixels of lambda/2d
            let scale = -a * b_z * k * d / PI;
            let (mut error, mut signal) = (0.0, 0.0);
            for (subaperture, seen) in pupil.subapertures().iter().zip(seen) {
                let x = pupil.centre_m(subaperture[axis]);
                let up = (k * x + psi).sin() * sinc(k * b * d / 2.0);
                let back = (k * (1.0 - b_z) * x + psi).sin() * sinc(k * b_z * diameter_m / 2.0);
                let expected = scale * (up - back);
                error += (seen[axis] - expected).powi(2) + seen[1 - axis].powi(2);
                signal += expected * expected;
            }
            let error = (error / signal).sqrt();
            println!("h {height_m}, z {gate_m}, {cycles} cycles: {error:.5}");
            assert!(error < 0.005, "h {height_m}, z {gate_m}, {cycles} cycles: {error}");
        }
    }
}

#[test]
fn a_gate_at_the_beacon_is_the_sensor_without_one() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let atmosphere = sinusoid(&pupil, 0, 3_000.0, [0.7, 2.0, 0.4]);
    let flat = Mirror::flat(pupil.subapertures().len());
    let one = look(sensor(&pupil, &atmosphere), &atmosphere, &flat);
    let gate = sensor(&pupil, &atmosphere).with_gate(BEACON_M).unwrap();
    assert_eq!(look(gate, &atmosphere, &flat), one);
    assert!(one.iter().any(|centroid| centroid[0].abs() > 1e-3));
}

/// Light imaged at z has been through the mirror, up and back, and through nothing above z: what is seen
/// is the segment's own tip and tilt less the mean, two pixels of lambda/2d for pi from centre to edge.
#[test]
fn a_layer_above_the_gate_is_not_seen_and_the_mirror_is() {
    let pupil = Pupil::circular(8, 8, 0.5).unwrap();
    let mut mirror = Mirror::flat(pupil.subapertures().len());
    let count = mirror.segments.len() as f64;
    for (k, segment) in mirror.segments.iter_mut().enumerate() {
        *segment = [0.1, 0.02 * k as f64, 0.3];
    }
    let mean = 0.02 * (count - 1.0) / 2.0;
    for height_m in [6_000.0, 8_000.0] {
        let atmosphere = sinusoid(&pupil, 0, height_m, [0.7, 2.0, 0.4]);
        let gate = sensor(&pupil, &atmosphere).with_gate(6_000.0).unwrap();
        for (centroid, segment) in look(gate, &atmosphere, &mirror).iter().zip(&mirror.segments) {
            let expected = -PIXELS_PER_LAMBDA_D * (segment[1] - mean) / PI;
            assert!((centroid[0] - expected).abs() < 1e-12 && centroid[1].abs() < 1e-12);
        }
    }
}

#[test]
fn gates_out_of_their_limits_are_named() {
    let pupil = Pupil::square(4, 8, 0.5).unwrap();
    let atmosphere = sinusoid(&pupil, 0, 0.0, [0.1, 1.0, 0.0]);
    let refused =
        |z: f64| sensor(&pupil, &atmosphere).with_gate(z).map(|_| ()).unwrap_err().to_string();
    assert_eq!(refused(0.0), "gate_height_m = 0: must be finite and > 0");
    assert_eq!(
        refused(12_001.0),
        "gate_height_m = 12001: must be <= the beacon's height of 12000 m"
    );
}
