//! Beacons with depth, in still air: geometric blur, elongation, light and centroids of out-of-focus slices.

#[path = "common/still_air.rs"]
mod still_air;

use host_sim::atmosphere::{Atmosphere, Layer};
use host_sim::optics::slab::Slab;
use host_sim::optics::splash_image::SplashCamera;
use host_sim::pupil::{Mirror, Pupil};
use host_sim::screen::Screen;
use still_air::still_air;

const BEACON_M: f64 = 12_000.0;
const WAVELENGTH_M: f64 = 532e-9;

/// The spots' images, `window` pixels of lambda/(d `scale`) wide: one period each.
fn images(pupil: &Pupil, beacon_m: f64, slab: Option<Slab>, scale: f64) -> Vec<Vec<f64>> {
    let air = still_air(pupil);
    let window = pupil.samples() * scale as usize;
    let mut camera = SplashCamera::new(pupil, &air, beacon_m, scale, window).unwrap();
    if let Some(slab) = slab {
        camera = camera.with_slab(slab, &air).unwrap();
    }
    let mut images = vec![0.0; camera.spots() * window * window];
    camera.expose(&air, 0.0, &Mirror::flat(camera.spots()), &mut images);
    let image = |pixels: &[f32]| pixels.iter().map(|&v| f64::from(v)).collect();
    images.chunks_exact(window * window).map(image).collect()
}

/// Light on each column, and the centre of gravity along x in pixels.
fn along_x(image: &[f64]) -> (Vec<f64>, f64) {
    let window = image.len().isqrt();
    let columns: Vec<f64> =
        (0..window).map(|x| image.iter().skip(x).step_by(window).sum()).collect();
    let middle = (window as f64 - 1.0) / 2.0;
    let first: f64 = columns.iter().enumerate().map(|(x, light)| (x as f64 - middle) * light).sum();
    let light: f64 = columns.iter().sum();
    (columns, first / light)
}

/// A single height at which 1/z - 1/H is `e_per_m`.
fn out_of_focus(e_per_m: f64) -> (f64, f64) {
    (1.0 / (1.0 / BEACON_M + e_per_m), 1.0)
}

/// Far out of focus light goes in straight lines: a box of e d on the way up, of e D on the way down, and the
/// spot above x_i is displaced by e x_i. Light within a of the middle of the two boxes' convolution, b = 2 and
/// c = 6 half widths: a/c up to c - b, then 1 - (b + c - a)^2/(4 b c).
#[test]
fn one_slice_is_blurred_as_rays_are() {
    let pupil = Pupil::square(3, 32, 0.5).unwrap();
    // e d = 4 lambda/d, e D = 12 lambda/d.
    let e_per_m = 4.0 * WAVELENGTH_M / 0.25;
    let slab = Slab::new(BEACON_M, WAVELENGTH_M, &[out_of_focus(e_per_m)]).unwrap();
    let images = images(&pupil, BEACON_M, Some(slab), 1.0);
    let (columns, _) = along_x(&images[4]);
    let (b, c) = (2.0_f64, 6.0_f64);
    for a in [2_usize, 4, 6, 8] {
        let within: f64 = columns[16 - a..16 + a].iter().sum();
        let half = a as f64;
        let rays =
            if half <= c - b { half / c } else { 1.0 - (b + c - half).powi(2) / (4.0 * b * c) };
        println!("within {a} lambda/d: {within:.3}, rays {rays:.3}");
        assert!((within - rays).abs() < 0.04, "within {a}: {within}, rays {rays}");
    }
    for (image, &[ix, _]) in images.iter().zip(pupil.subapertures()) {
        let (_, centroid) = along_x(image);
        let expected = 4.0 * (ix as f64 - 1.0);
        // The gradient between neighbouring samples: 32 have 31 steps.
        assert!((centroid - expected).abs() < 0.05 * 4.0, "{centroid} of {expected} px");
    }
}

#[test]
fn light_is_conserved() {
    let pupil = Pupil::circular(4, 8, 0.5).unwrap();
    let slab = Slab::gated(BEACON_M, 300.0, WAVELENGTH_M, 5, |_| 1.0).unwrap();
    for image in images(&pupil, BEACON_M, Some(slab), 2.0) {
        let sum: f64 = image.iter().sum();
        assert!((sum - 1.0).abs() < 1e-5, "{sum}");
    }
}

/// Two slices as far from the focus on either side pull a spot apart, but not away.
#[test]
fn symmetric_slabs_leave_the_mean_centroid() {
    let pupil = Pupil::square(4, 8, 0.5).unwrap();
    let e_per_m = 1e-6;
    let slab = |e: &[f64]| {
        let slices: Vec<_> = e.iter().map(|&e| out_of_focus(e)).collect();
        Some(Slab::new(BEACON_M, WAVELENGTH_M, &slices).unwrap())
    };
    let both = images(&pupil, BEACON_M, slab(&[e_per_m, -e_per_m]), 2.0);
    let one = images(&pupil, BEACON_M, slab(&[e_per_m]), 2.0);
    let moved = along_x(&one[0]).1;
    let expected = 2.0 * e_per_m * pupil.centre_m(0) * 0.5 / WAVELENGTH_M;
    assert!((moved / expected - 1.0).abs() < 0.15, "one alone: {moved} of {expected} px");
    for image in both {
        let (_, centroid) = along_x(&image);
        assert!(centroid.abs() < 1e-3, "{centroid} px");
    }
}

/// Air is denser below: the light's mean of 1/z - 1/H moves the spots.
#[test]
fn density_moves_spots_by_the_mean_defocus() {
    let (beacon_m, depth_m) = (3_000.0, 100.0);
    let pupil = Pupil::square(2, 16, 0.5).unwrap();
    let density = |z: f64| (-z / 6_340.0).exp();
    let slab = Slab::gated(beacon_m, depth_m, WAVELENGTH_M, 24, density).unwrap();
    let (mut mean, mut light) = (0.0, 0.0);
    for k in 0..10_000 {
        let z = beacon_m + depth_m * ((f64::from(k) + 0.5) / 10_000.0 - 0.5);
        let share = density(z) / (z * z);
        mean += share * (1.0 / z - 1.0 / beacon_m);
        light += share;
    }
    let (_, centroid) = along_x(&images(&pupil, beacon_m, Some(slab), 2.0)[1]);
    let expected = 2.0 * mean / light * pupil.centre_m(1) * 0.5 / WAVELENGTH_M;
    println!("moved {centroid:.4} px of {expected:.4}");
    assert!(expected > 0.04 && (centroid / expected - 1.0).abs() < 0.1, "{centroid} of {expected}");
}

/// As many slices as the blur asks for are enough: four times as many give the same images.
#[test]
fn the_slices_needed_are_enough() {
    let pupil = Pupil::circular(4, 8, 0.5).unwrap();
    for depth_m in [50.0, 300.0, 590.0] {
        let count = Slab::slices_needed(BEACON_M, depth_m, WAVELENGTH_M, 0.5, 2.0);
        let of = |count| {
            let slab = Slab::gated(BEACON_M, depth_m, WAVELENGTH_M, count, |_| 1.0).unwrap();
            images(&pupil, BEACON_M, Some(slab), 2.0)
        };
        let mut worst = 0.0_f64;
        for (few, many) in of(count).iter().zip(of(4 * count)) {
            let peak = many.iter().copied().fold(0.0, f64::max);
            let differ = few.iter().zip(&many).map(|(a, b)| (a - b).abs() / peak);
            worst = differ.fold(worst, f64::max);
        }
        println!("{depth_m} m: {count} slices, {worst:.1e} of the peak");
        assert!(worst < 0.01, "{depth_m} m: {worst}");
    }
}

#[test]
fn a_sheet_is_no_slab() {
    let pupil = Pupil::circular(4, 8, 0.5).unwrap();
    let slab = Slab::gated(BEACON_M, 300.0, WAVELENGTH_M, 1, |_| 1.0).unwrap();
    assert_eq!(slab, Slab::sheet(BEACON_M));
    assert_eq!(images(&pupil, BEACON_M, Some(slab), 2.0), images(&pupil, BEACON_M, None, 2.0));
}

#[test]
fn slabs_that_cannot_be_are_refused() {
    let pupil = Pupil::square(4, 8, 0.5).unwrap();
    let high =
        Layer { weight: 1.0, height_m: 11_000.0, wind_speed_m_per_s: 0.0, wind_direction_deg: 0.0 };
    let screen = Screen::from_fn([2.2; 2], 0.03, |_, _| 0.0).unwrap();
    let air = Atmosphere::from_screens(vec![(high, screen)], pupil.diameter_m(), 0.0).unwrap();
    let with = |slices: &[(f64, f64)]| {
        let camera = SplashCamera::new(&pupil, &air, BEACON_M, 2.0, 16).unwrap();
        let slab = Slab::new(BEACON_M, WAVELENGTH_M, slices);
        slab.and_then(|slab| camera.with_slab(slab, &air)).map(|_| ()).unwrap_err().to_string()
    };
    assert!(with(&[(12_000.0, 1.0), (10_900.0, 1.0)]).starts_with("layers[0].height_m = 11000"));
    // Half of the period is 4 lambda/d = 4.26 urad; e D = 2 (400 / 12000^2) = 5.7 urad.
    assert!(with(&[(11_613.0, 1.0)]).starts_with("slice height_m = 11613: must be nearer"));
    assert!(with(&[]).starts_with("slices = 0"));
    assert!(with(&[(0.0, 1.0)]).starts_with("slice height_m = 0"));
    assert!(with(&[(1.0, f64::NAN)]).starts_with("slice share = NaN"));
}
