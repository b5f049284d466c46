//! A layer whose every gradient is known.

use host_sim::atmosphere::{Atmosphere, Layer};
use host_sim::pupil::Pupil;
use host_sim::screen::Screen;

/// sin u / u.
pub(crate) fn sinc(u: f64) -> f64 {
    if u == 0.0 { 1.0 } else { u.sin() / u }
}

/// A layer A cos(k x + psi) along `axis`, rad, that stands still.
pub(crate) fn sinusoid(
    pupil: &Pupil,
    axis: usize,
    height_m: f64,
    [a, k, psi]: [f64; 3],
) -> Atmosphere {
    // One subaperture alone needs some texels beyond its edge.
    let extent_m = [pupil.diameter_m() * 1.1 + 0.2; 2];
    let phase = |x: f64, y: f64| a * (k * [x, y][axis] + psi).cos();
    let screen = Screen::from_fn(extent_m, pupil.pitch_m() / 32.0, phase).unwrap();
    let still = Layer { weight: 1.0, height_m, wind_speed_m_per_s: 0.0, wind_direction_deg: 0.0 };
    Atmosphere::from_screens(vec![(still, screen)], pupil.diameter_m(), 0.0).unwrap()
}
