//! Images of a second gate: against Fresnel propagation in one dimension, mean gradients, rays and what is known of a
//! flat wavefront.

#[path = "common/sinusoid.rs"]
mod sinusoid;
#[path = "common/still_air.rs"]
mod still_air;

use host_sim::atmosphere::Atmosphere;
use host_sim::instrument::Instrument;
use host_sim::optics::gate_image::{Gate, GateCamera};
use host_sim::optics::launch::Launch;
use host_sim::optics::slab::Slab;
use host_sim::pupil::{Mirror, Pupil};
use sinusoid::{sinc, sinusoid};
use std::f64::consts::{PI, TAU};
use still_air::still_air;

const BEACON_M: f64 = 12_000.0;
const GATE_M: f64 = 6_000.0;
const WAVELENGTH_M: f64 = 532e-9;
const PITCH_M: f64 = 0.5;
/// 32 pixels of 4 lambda/d: 128 of them, and the spots are 39 wide. The wings of so sharp an edge reach far.
const WINDOW: usize = 32;
const SCALE: f64 = 0.25;
/// Pixels that show the fringes.
const FINE: f64 = 0.5;

fn gate(slab: Slab) -> Gate {
    Gate { focus_m: BEACON_M, height_m: GATE_M, slab, wavelength_m: WAVELENGTH_M }
}

fn sheet() -> Gate {
    gate(Slab::sheet(GATE_M))
}

fn look(pupil: &Pupil, air: &Atmosphere, gate: &Gate, mirror: &Mirror) -> Vec<Vec<f64>> {
    images(GateCamera::new(pupil, air, gate, SCALE, WINDOW).unwrap(), air, mirror)
}

fn images(mut camera: GateCamera, air: &Atmosphere, mirror: &Mirror) -> Vec<Vec<f64>> {
    let mut images = vec![0.0; camera.spots() * WINDOW * WINDOW];
    camera.expose(air, 0.0, mirror, &mut images);
    let image = |pixels: &[f32]| pixels.iter().map(|&v| f64::from(v)).collect();
    images.chunks_exact(WINDOW * WINDOW).map(image).collect()
}

/// Light on each column.
fn columns(image: &[f64]) -> Vec<f64> {
    (0..WINDOW).map(|x| image.iter().skip(x).step_by(WINDOW).sum()).collect()
}

/// Mean and variance along x, pixels.
fn moments(image: &[f64]) -> (f64, f64) {
    let columns = columns(image);
    let place = |x: usize| x as f64 - (WINDOW as f64 - 1.0) / 2.0;
    let light: f64 = columns.iter().sum();
    let first: f64 = columns.iter().enumerate().map(|(x, c)| place(x) * c).sum();
    let second: f64 = columns.iter().enumerate().map(|(x, c)| place(x).powi(2) * c).sum();
    (first / light, second / light - (first / light).powi(2))
}

/// Light of a beam of one dimension that is focused at H, through a layer A cos(k x + psi) at h to z, in pixels that
/// are moved by `shift` rad: the Fresnel integral twice, in double precision.
fn propagated(height_m: f64, [a, k, psi]: [f64; 3], shift: f64) -> Vec<f64> {
    type Complex = nalgebra::Complex<f64>;
    let wave = TAU / WAVELENGTH_M;
    let line = |half_m: f64, count: usize| -> Vec<f64> {
        (0..count).map(|i| (2.0 * (i as f64 + 0.5) / count as f64 - 1.0) * half_m).collect()
    };
    let to = |from: &[(f64, Complex)], length_m: f64, places: &[f64]| -> Vec<(f64, Complex)> {
        let at = |&y: &f64| {
            let path = |(x, field): &(f64, Complex)| {
                field * Complex::cis(wave * (y - x).powi(2) / (2.0 * length_m))
            };
            (y, from.iter().map(path).sum::<Complex>())
        };
        places.iter().map(at).collect()
    };
    let beam: Vec<_> = line(PITCH_M / 2.0, 1200)
        .into_iter()
        .map(|x| (x, Complex::cis(-wave * x * x / (2.0 * BEACON_M))))
        .collect();
    // Half as wide again as the beam there.
    let half_m = 0.75 * PITCH_M * (1.0 - height_m / BEACON_M);
    let mut at_layer = to(&beam, height_m, &line(half_m, 1800));
    at_layer.iter_mut().for_each(|(y, field)| *field *= Complex::cis(a * (k * *y + psi).cos()));
    const FINER: usize = 12;
    let field_rad = WINDOW as f64 / FINE * WAVELENGTH_M / PITCH_M;
    let places: Vec<f64> = line(field_rad / 2.0, FINER * WINDOW)
        .into_iter()
        .map(|angle| (angle - shift) * GATE_M)
        .collect();
    let light = to(&at_layer, GATE_M - height_m, &places);
    let pixels: Vec<f64> = light
        .chunks_exact(FINER)
        .map(|pixel| pixel.iter().map(|(_, field)| field.norm_sqr()).sum())
        .collect();
    let sum: f64 = pixels.iter().sum();
    pixels.into_iter().map(|pixel| pixel / sum).collect()
}

/// One subaperture, whose way back is its own: its mean gradient moves the image back.
#[test]
fn images_are_those_of_fresnel_propagation() {
    let pupil = Pupil::square(1, 8, PITCH_M).unwrap();
    for (height_m, [a, cycles, psi]) in
        [(3_000.0, [0.0, 1.0, 0.0]), (3_000.0, [2.0, 1.0, 0.7]), (4_500.0, [4.0, 0.6, 2.0])]
    {
        let k = TAU * cycles / PITCH_M;
        let air = sinusoid(&pupil, 0, height_m, [a, k, psi]);
        let camera = GateCamera::new(&pupil, &air, &sheet(), FINE, WINDOW).unwrap();
        let seen = columns(&images(camera, &air, &Mirror::flat(1))[0]);
        let b_z = 1.0 - height_m / GATE_M;
        let back = -a * b_z * k * psi.sin() * sinc(k * b_z * PITCH_M / 2.0);
        let expected = propagated(height_m, [a, k, psi], -back * WAVELENGTH_M / TAU);
        let peak = expected.iter().copied().fold(0.0, f64::max);
        let light: f64 = seen.iter().sum();
        let differ = seen.iter().zip(&expected).map(|(s, e)| (s / light - e).abs() / peak);
        let worst = differ.fold(0.0, f64::max);
        println!("h {height_m}, A {a}: {worst:.4} of the peak");
        assert!(worst < 0.05, "h {height_m}, A {a}: {worst}");
    }
}

/// The formulas of `optics_gates`: mean gradient over the beam less that over the pupil. Light that leaves the window, of
/// one period, on one side comes in on the other: of a shift, the window's width times the light at its edge is missing.
#[test]
fn centres_of_gravity_are_mean_gradients() {
    let pupil = Pupil::square(6, 8, PITCH_M).unwrap();
    let diameter_m = pupil.diameter_m();
    let still = still_air(&pupil);
    let camera = GateCamera::new(&pupil, &still, &sheet(), FINE, WINDOW).unwrap();
    let edge = columns(&images(camera, &still, &Mirror::flat(36))[0])[0];
    let gain = 1.0 - edge * WINDOW as f64;
    for (height_m, cycles, psi) in [(3_000.0, 1.0, 0.3), (1_500.0, 2.5, 1.9), (0.0, 2.0, 0.8)] {
        let (a, k) = (2.0, TAU * cycles / diameter_m);
        let air = sinusoid(&pupil, 0, height_m, [a, k, psi]);
        let flat = Mirror::flat(36);
        let camera = GateCamera::new(&pupil, &air, &sheet(), FINE, WINDOW).unwrap();
        let seen = images(camera, &air, &flat);
        let (b, b_z) = (1.0 - height_m / BEACON_M, 1.0 - height_m / GATE_M);
        let scale = -gain * a * b_z * k * PITCH_M * FINE / TAU;
        let (mut error, mut signal) = (0.0, 0.0);
        for (&[ix, _], image) in pupil.subapertures().iter().zip(&seen) {
            let x = pupil.centre_m(ix);
            let up = (k * x + psi).sin() * sinc(k * b * PITCH_M / 2.0);
            let back = (k * (1.0 - b_z) * x + psi).sin() * sinc(k * b_z * diameter_m / 2.0);
            let expected = scale * (up - back);
            error += (moments(image).0 - expected).powi(2);
            signal += expected * expected;
        }
        let error = (error / signal).sqrt();
        println!("h {height_m}, {cycles} cycles: {error:.4}");
        assert!(error < 0.02, "h {height_m}, {cycles} cycles: {error}");
    }
}

/// A segment's tip moves its spot, and the mean of all moves none: a pixel for 2 pi / p from edge to edge.
#[test]
fn the_mirror_moves_spots() {
    let pupil = Pupil::circular(4, 8, PITCH_M).unwrap();
    let air = still_air(&pupil);
    let mut mirror = Mirror::flat(pupil.subapertures().len());
    for (k, segment) in mirror.segments.iter_mut().enumerate() {
        *segment = [0.4 * k as f64, 0.3 * k as f64, -1.0];
    }
    let mean = 0.3 * (mirror.segments.len() as f64 - 1.0) / 2.0;
    for (image, segment) in look(&pupil, &air, &sheet(), &mirror).iter().zip(&mirror.segments) {
        let expected = -2.0 * (segment[1] - mean) * SCALE / TAU;
        let (x, _) = moments(image);
        assert!((x - expected).abs() < 0.01, "{x} px of {expected}");
    }
}

/// In still air a spot is the beam's shadow, e d wide, and all of its light falls on the window.
#[test]
fn a_flat_wavefront_is_a_shadow() {
    let pupil = Pupil::circular(4, 8, PITCH_M).unwrap();
    let air = still_air(&pupil);
    let width = (1.0 / GATE_M - 1.0 / BEACON_M) * PITCH_M * PITCH_M / WAVELENGTH_M;
    for image in look(&pupil, &air, &sheet(), &Mirror::flat(12)) {
        let light: f64 = image.iter().sum();
        assert!((light - 1.0).abs() < 1e-4, "{light}");
        // Full within 12 lambda/d of the middle, dark beyond 24: the edges are at 19.6, with fringes.
        let columns = columns(&image);
        let inside: f64 = columns[13..19].iter().sum();
        let expected = 24.0 / width;
        assert!((inside - expected).abs() < 0.01, "{inside} of {expected}");
        let outside: f64 = columns[..10].iter().chain(&columns[22..]).sum();
        assert!(outside < 0.02, "{outside}");
        let (x, _) = moments(&image);
        assert!(x.abs() < 1e-4, "{x}");
    }
}

/// A Gaussian beam's shadow is a Gaussian: sigma = w e / 2 for a waist that the square hardly cuts.
#[test]
fn a_gaussian_beam_has_a_gaussian_shadow() {
    let pupil = Pupil::square(2, 8, PITCH_M).unwrap();
    let air = still_air(&pupil);
    let launch = Launch::Gaussian { waist_pitches: 0.2 };
    let camera = GateCamera::new(&pupil, &air, &sheet(), SCALE, WINDOW).unwrap();
    for image in images(camera.with_launch(launch), &air, &Mirror::flat(4)) {
        let e_per_m = 1.0 / GATE_M - 1.0 / BEACON_M;
        let sigma = 0.2 * PITCH_M * e_per_m / 2.0 * PITCH_M / WAVELENGTH_M * SCALE;
        let (_, variance) = moments(&image);
        // A pixel's own variance, and 5 % for what the square cuts off and diffraction adds.
        let expected = sigma * sigma + 1.0 / 12.0;
        assert!((variance / expected - 1.0).abs() < 0.05, "{variance} of {expected}");
    }
}

/// Out of the camera's focus by e' a ray through the pupil's x lands e' (x - x_i) away: the variance of that over
/// slices and pupil is what a deep gate adds to a spot's.
#[test]
fn depth_blurs_and_stretches() {
    let pupil = Pupil::square(4, 8, PITCH_M).unwrap();
    let air = still_air(&pupil);
    let e_per_m = [-6e-6, 0.0, 6e-6];
    let slices = e_per_m.map(|e| (1.0 / (1.0 / GATE_M + e), 1.0));
    let deep = gate(Slab::new(GATE_M, WAVELENGTH_M, &slices).unwrap());
    let flat = Mirror::flat(16);
    let sharp = look(&pupil, &air, &sheet(), &flat);
    let blurred = look(&pupil, &air, &deep, &flat);
    // Pixels per rad.
    let scale = SCALE * PITCH_M / WAVELENGTH_M;
    let square = e_per_m.iter().map(|e| e * e).sum::<f64>() / 3.0;
    for ((sharp, blurred), &[ix, _]) in sharp.iter().zip(&blurred).zip(pupil.subapertures()) {
        let light: f64 = blurred.iter().sum();
        let ((_, before), (x, after)) = (moments(sharp), moments(blurred));
        let distance = pupil.diameter_m().powi(2) / 12.0 + pupil.centre_m(ix).powi(2);
        let expected = square * distance * scale * scale;
        println!("{:.3} added of {expected:.3}, light {light:.4}, at {x:.4}", after - before);
        assert!(x.abs() < 0.01, "{x}");
        assert!(((after - before) / expected - 1.0).abs() < 0.05, "{after} - {before}: {expected}");
    }
}

/// A description's slab has slices enough: four times as many give the same images, at the depth that blurs spots as
/// far as there is room.
#[test]
fn slabs_have_slices_enough() {
    for n in [8, 24] {
        let depth_m = 0.99 * 375.0 * 8.0 / f64::from(n);
        let toml = format!(
            "[telescope]\nsubapertures = {n}\n[laser]\nslices = 0\ngate_depth_m = 10.0\n\
             [second_gate]\nheight_m = 6000.0\ndepth_m = {depth_m}"
        );
        let instrument = Instrument::parse(&toml, "test").unwrap();
        instrument.check().unwrap();
        let count = instrument.gate().unwrap().unwrap().slab.count();
        // Two subapertures at the ends of a diameter of the large pupil: all of the blur and the stretch.
        let across = n as usize;
        let at_end = |k: usize| k / across == across / 2 && [0, across - 1].contains(&(k % across));
        let mask = (0..across * across).map(at_end).collect();
        let pupil = Pupil::new(across, 2, PITCH_M, mask).unwrap();
        let air = still_air(&pupil);
        let [few, many] = [count, (4 * count).min(64)].map(|count| {
            let slab = Slab::gated(GATE_M, depth_m, WAVELENGTH_M, count, |_| 1.0).unwrap();
            look(&pupil, &air, &gate(slab), &Mirror::flat(2))
        });
        let mut worst = 0.0_f64;
        for (few, many) in few.iter().zip(&many) {
            let peak = many.iter().copied().fold(0.0, f64::max);
            worst = few.iter().zip(many).fold(worst, |w, (a, b)| w.max((a - b).abs() / peak));
        }
        println!("N = {n}, {depth_m:.0} m: {count} slices, {worst:.1e} of the peak");
        assert!(worst < 0.01, "N = {n}: {worst}");
    }
}

#[test]
fn gates_that_cannot_be_are_refused() {
    let pupil = Pupil::square(4, 8, PITCH_M).unwrap();
    let air = still_air(&pupil);
    let refused = |gate: Gate, scale: f64, window: usize| {
        let camera = GateCamera::new(&pupil, &air, &gate, scale, window);
        camera.map(|_| ()).unwrap_err().to_string()
    };
    let above = Gate { height_m: 12_001.0, ..sheet() };
    assert_eq!(
        refused(above, SCALE, WINDOW),
        "gate_height_m = 12001: must be <= the beacon's height of 12000 m"
    );
    let low = Gate { height_m: 500.0, ..sheet() };
    assert_eq!(
        refused(low, SCALE, WINDOW),
        "gate_height_m = 500: must be one whose spots, their blur and their window are at most 512 lambda/d \
         wide"
    );
    assert_eq!(refused(sheet(), SCALE, 33), "window = 33: must be 4 to 32 pixels");
    assert_eq!(refused(sheet(), 0.0, WINDOW), "pixels_per_lambda_d = 0: must be finite and > 0");
}

/// The gradient along x of the mirror's own phase has nothing to do with y.
#[test]
fn axes_do_not_mix() {
    let pupil = Pupil::square(3, 8, PITCH_M).unwrap();
    let air = sinusoid(&pupil, 0, 2_000.0, [1.5, PI, 0.4]);
    for image in look(&pupil, &air, &sheet(), &Mirror::flat(9)) {
        let transposed: Vec<f64> =
            (0..WINDOW * WINDOW).map(|k| image[k % WINDOW * WINDOW + k / WINDOW]).collect();
        let (y, _) = moments(&transposed);
        assert!(y.abs() < 1e-3, "{y}");
    }
}
