//! A disc and vanes in the pupil: open area, images against direct sums, the star's Strehl ratio.

use host_sim::atmosphere::{Atmosphere, Layer};
use host_sim::optics::camera::Camera;
use host_sim::optics::geometric::Sensor;
use host_sim::optics::long_exposure::LongExposure;
use host_sim::optics::science::Science;
use host_sim::pupil::{Mirror, Obstruction, Pupil};
use std::f64::consts::{PI, TAU};

const NOTHING: Obstruction =
    Obstruction { disc_m: 0.0, vane_width_m: 0.0, vanes: 4, vane_angle_rad: 0.0 };

fn square(n: usize, obstruction: Obstruction) -> Pupil {
    Pupil::square(n, 8, 0.5).unwrap().with_obstruction(&obstruction).unwrap()
}

fn images(sensor: Sensor, pupil: &Pupil) -> Vec<f32> {
    let air = Atmosphere::from_screens(vec![], pupil.diameter_m(), 0.0).unwrap();
    let spots = pupil.subapertures().len();
    let mut images = vec![0.0; spots * 256];
    Camera::new(sensor, pupil, &air, 12_000.0, 2.0, 16).unwrap().expose(
        &air,
        0.0,
        &Mirror::flat(spots),
        &mut images,
    );
    images
}

#[test]
fn open_areas() {
    let open_m2 = |obstruction| {
        let pupil = square(8, obstruction);
        pupil.open_samples() * pupil.sample_pitch_m().powi(2)
    };
    assert_eq!(open_m2(NOTHING), 16.0);
    let disc = Obstruction { disc_m: 1.3, ..NOTHING };
    assert!((open_m2(disc) - (16.0 - PI / 4.0 * 1.69)).abs() < 2e-3, "{}", open_m2(disc));
    // A cross of vanes: two strips of 4 m, and the square in the middle counts once.
    let cross = Obstruction { vane_width_m: 0.05, ..NOTHING };
    let expected = 16.0 - (2.0 * 4.0 * 0.05 - 0.05 * 0.05);
    assert!((open_m2(cross) - expected).abs() < 1e-3, "{}", open_m2(cross));
    // Turned by 45 degrees they are longer by sqrt(2).
    let turned = Obstruction { vane_angle_rad: PI / 4.0, ..cross };
    let expected = 16.0 - 2.0 * 4.0 * 2f64.sqrt() * 0.05;
    assert!((open_m2(turned) - expected).abs() < 0.01, "{}", open_m2(turned));
    let all = Obstruction { disc_m: 6.0, ..NOTHING };
    let refused = Pupil::square(8, 8, 0.5).unwrap().with_obstruction(&all).unwrap_err();
    assert!(refused.to_string().starts_with("disc_m = 6: must be smaller"), "{refused}");
}

#[test]
fn nothing_in_the_light_changes_nothing() {
    let plain = Pupil::square(4, 8, 0.5).unwrap();
    for sensor in [Sensor::Splash, Sensor::Lgs] {
        assert_eq!(images(sensor, &square(4, NOTHING)), images(sensor, &plain));
    }
}

/// In still air a spot's transfer function is the product of two autocorrelations of amplitudes, summed directly.
#[test]
fn images_equal_direct_sums() {
    let pupil =
        square(3, Obstruction { disc_m: 0.4, vane_width_m: 0.09, vanes: 3, vane_angle_rad: 0.3 });
    let amplitude = |x: i64, y: i64| -> f64 {
        let inside = (0..24).contains(&x) && (0..24).contains(&y);
        if inside { pupil.amplitude(y as usize, x as usize).into() } else { 0.0 }
    };
    let correlate = |[x0, x1]: [i64; 2], [y0, y1]: [i64; 2], [lx, ly]: [i64; 2]| -> f64 {
        let within = |x: i64, y: i64| (x0..x1).contains(&x) && (y0..y1).contains(&y);
        let mut sum = 0.0;
        for y in y0..y1 {
            for x in x0..x1 {
                if within(x + lx, y + ly) {
                    sum += amplitude(x, y) * amplitude(x + lx, y + ly);
                }
            }
        }
        sum
    };
    let kernel = |l: i64, k: usize| {
        let pixel = 1.0 / 16.0;
        let half = PI * l as f64 * pixel;
        let mean = if l == 0 { 1.0 } else { half.sin() / half };
        pixel * mean * (TAU * l as f64 * (k as f64 - 7.5) * pixel).cos()
    };
    let odd = |l: i64, k: usize| {
        let half = PI * l as f64 / 16.0;
        let mean = if l == 0 { 1.0 } else { half.sin() / half };
        mean / 16.0 * (TAU * l as f64 * (k as f64 - 7.5) / 16.0).sin()
    };
    for (sensor, spot) in [(Sensor::Splash, 4), (Sensor::Splash, 5), (Sensor::Lgs, 5)] {
        let image = &images(sensor, &pupil)[spot * 256..][..256];
        let [ix, iy] = pupil.subapertures()[spot].map(|i| 8 * i as i64);
        let mut expected = vec![0.0; 256];
        let all = correlate([0, 24], [0, 24], [0, 0]);
        for ly in -7..8_i64 {
            for lx in -7..8_i64 {
                let up = correlate([ix, ix + 8], [iy, iy + 8], [lx, ly]) / 64.0;
                let down = match sensor {
                    Sensor::Splash => correlate([0, 24], [0, 24], [lx, ly]) / all,
                    _ => 1.0,
                };
                for (k, value) in expected.iter_mut().enumerate() {
                    let (x, y) = (k % 16, k / 16);
                    // The real part of exp(-i a) exp(-i b), a along x and b along y.
                    *value += up * down * (kernel(lx, x) * kernel(ly, y) - odd(lx, x) * odd(ly, y));
                }
            }
        }
        let peak = expected.iter().copied().fold(0.0, f64::max);
        let differ = |(a, b): (&f32, &f64)| (f64::from(*a) - b).abs() / peak;
        let worst = image.iter().zip(&expected).map(differ).fold(0.0, f64::max);
        let light: f64 = image.iter().map(|&v| f64::from(v)).sum();
        println!("{sensor:?} {spot}: {worst:.1e} of the peak, light {light:.3}");
        assert!(worst < 1e-5, "{sensor:?} {spot}: {worst}");
        // What stands in the beam takes its light away.
        let lit = correlate([ix, ix + 8], [iy, iy + 8], [0, 0]) / 64.0;
        assert!((light - lit).abs() < 1e-5 && lit < 0.95, "{light} of {lit}");
    }
}

/// The star's Strehl ratio and variance are means over the open area; so is the exposure's peak.
#[test]
fn the_star_is_seen_through_what_is_open() {
    let pupil =
        square(4, Obstruction { disc_m: 0.7, vane_width_m: 0.04, vanes: 4, vane_angle_rad: 0.5 });
    let still =
        Layer { weight: 1.0, height_m: 0.0, wind_speed_m_per_s: 0.0, wind_direction_deg: 0.0 };
    let air = Atmosphere::new(0.7, &[still], 2.0, 0.5, 0.1, 5).unwrap();
    let mut science = Science::new(&pupil, &air, 1.0, 1.0).unwrap();
    let seen = science.observe(&air, 0.0, &Mirror::flat(16));
    let [mut area, mut square, mut re, mut im, mut tilt, mut piston] = [0.0; 6];
    for (k, &phase) in science.residual().iter().enumerate() {
        let (phase, amplitude) = (f64::from(phase), f64::from(pupil.amplitude(k / 32, k % 32)));
        area += amplitude;
        square += amplitude * phase * phase;
        re += amplitude * phase.cos();
        im += amplitude * phase.sin();
        piston += amplitude * phase;
        tilt += amplitude * phase * pupil.sample_m(k % 32);
    }
    assert!((seen.strehl / ((re * re + im * im) / (area * area)) - 1.0).abs() < 1e-5);
    assert!((seen.variance_rad2 / (square / area) - 1.0).abs() < 1e-5);
    assert!(piston.abs() < 1e-3 && tilt.abs() < 1e-3, "{piston} {tilt}");
    let mut exposure = LongExposure::new(&pupil);
    exposure.add(science.residual());
    assert!((exposure.strehl() / seen.strehl - 1.0).abs() < 1e-4);
}
