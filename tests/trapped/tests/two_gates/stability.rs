//! The pole of the closed loop is 1 - g whatever B is, and stays inside the unit circle with a sensor
//! whose gain is off by a fifth.

use super::{Rig, coupling, instrument, tilts};
use splash_tests::frames::Rng;
use splash_tests::instrument::{Instrument, Values};
use splash_tests::twin::modal::Modes;

const G: f64 = 0.5;
const F: f64 = 1.13;
/// Lever arms of a high layer in both gates.
const BETA: [f64; 2] = [0.75, 0.5];

/// What a sensor with a gain of 1 + `error` sees through both gates of a static ground layer and a high
/// one, before what the mirror shows.
fn seen(layers: &[Vec<[f64; 2]>; 2], shown: &[[f64; 2]], error: f64) -> super::Seen {
    let [ground, high] = layers;
    BETA.map(|beta| {
        let all = ground.iter().zip(high).zip(shown);
        let slope = |axis: usize, g: [f64; 2], h: [f64; 2], m: [f64; 2]| {
            (1.0 + error) * (g[axis] + beta * h[axis] - m[axis])
        };
        all.map(|((&g, &h), &m)| Some([0, 1].map(|axis| slope(axis, g, h, m)))).collect()
    })
}

/// B that has modes of both layers right: x1 + (1 - b1) / (b1 - b2) (x1 - x2), with f x1 in it.
fn both_layers(modes: usize) -> Vec<f64> {
    let gamma = (1.0 - BETA[0]) / (BETA[0] - BETA[1]);
    let mut all = vec![0.0; 2 * modes * modes];
    for (k, row) in all.chunks_exact_mut(2 * modes).enumerate() {
        (row[k], row[modes + k]) = (1.0 + gamma - F, -gamma);
    }
    all
}

fn rig(coupling: Vec<f64>) -> (Instrument, Rig) {
    let mut instrument = instrument(8, 12, coupling);
    (instrument.lever_arm, instrument.control_gain) = (F, Values::Uniform(G));
    let rig = Rig::new(&instrument);
    (instrument, rig)
}

/// Parts of a vector along each mode, and what is left of it.
fn split(modes: &Modes, vector: &[[f64; 2]]) -> (Vec<f64>, Vec<[f64; 2]>) {
    let mut rest = vector.to_vec();
    let mut parts = Vec::new();
    for q in &modes.gradients {
        let pairs = q.as_flattened().iter().zip(vector.as_flattened());
        let part = pairs.map(|(q, v)| q * v).sum::<f64>();
        rest.as_flattened_mut().iter_mut().zip(q.as_flattened()).for_each(|(r, q)| *r -= part * q);
        parts.push(part);
    }
    (parts, rest)
}

/// Commands of frame after frame of a static sky.
fn run(
    rig: &mut Rig,
    layers: &[Vec<[f64; 2]>; 2],
    error: f64,
    frames: usize,
) -> Vec<Vec<[f64; 2]>> {
    let mut all = Vec::new();
    let mut shown = vec![[0.0; 2]; layers[0].len()];
    for _ in 0..frames {
        rig.slopes_of(&seen(layers, &shown, error));
        shown = rig.shown();
        all.push(rig.path.commands().iter().map(|c| c.map(f64::from)).collect());
    }
    all
}

fn layers(count: usize, seed: u64) -> [Vec<[f64; 2]>; 2] {
    let mut rng = Rng::new(seed);
    [tilts(count, 200_000.0, &mut rng), tilts(count, 150_000.0, &mut rng)]
}

/// With any B each command goes as 1 - (1 - g)^k from the flat mirror.
#[test]
fn the_pole_is_one_less_the_gain_whatever_b_is() {
    let mut rng = Rng::new(97);
    for size in [0.0, 0.3, 1.0] {
        let (instrument, mut rig) = rig(coupling(12, size, &mut rng));
        let commands = run(&mut rig, &layers(instrument.count(), 98), 0.0, 40);
        let last = commands.last().expect("frames").as_flattened();
        let scale = last.iter().fold(0.0f64, |m, c| m.max(c.abs()));
        for (k, command) in (1..).zip(&commands) {
            let part = 1.0 - f64::powi(1.0 - G, k);
            let off = command.as_flattened().iter().zip(last).map(|(c, last)| c - part * last);
            let off = splash_tests::largest(off);
            // Rounding of centroids (two ulp of slope) through f + |B|, of which rows have a norm of 24 B.
            assert!(off <= 8.0 * (F + 24.0 * size), "B = {size}, frame {k}: {off} ulp of {scale}");
        }
    }
}

/// Modes that are made of both layers: their pole is 1 - g (1 + e), that of the rest 1 - g (1 + f e), for a
/// gain that is off by e in both gates.
#[test]
fn a_gain_that_is_off_by_a_fifth_moves_the_pole_by_as_much() {
    for error in [-0.2, 0.0, 0.2] {
        let (instrument, mut rig) = rig(both_layers(12));
        let second = instrument.second.as_ref().expect("two gates");
        let modes = Modes::new(&second.modes, &second.coupling, instrument.count());
        let layers = layers(instrument.count(), 99);
        let commands = run(&mut rig, &layers, error, 60);
        let (last, rest) = split(&modes, commands.last().expect("frames"));
        // Both layers, whole; and what the sensor's gain and the lever arm leave of it.
        let sum = |h: f64| -> Vec<[f64; 2]> {
            let all = layers[0].iter().zip(&layers[1]);
            all.map(|(g, v)| [0, 1].map(|axis| g[axis] + h * v[axis])).collect()
        };
        let (whole, _) = split(&modes, &sum(1.0));
        let (_, seen) = split(&modes, &sum(BETA[0]));
        for (last, whole) in last.iter().zip(&whole) {
            assert!((last - whole).abs() <= 60.0, "{last} {whole}");
        }
        let held = F * (1.0 + error) / (1.0 + F * error);
        for (r, s) in rest.as_flattened().iter().zip(seen.as_flattened()) {
            assert!((r - held * s).abs() <= 60.0, "{r} {}", held * s);
        }
        for (k, command) in (1..).zip(&commands) {
            let (parts, rest_now) = split(&modes, command);
            let [of_modes, of_rest] =
                [1.0, F].map(|f| 1.0 - f64::powi(1.0 - G * (1.0 + f * error), k));
            for (part, last) in parts.iter().zip(&last) {
                assert!((part - of_modes * last).abs() <= 60.0, "frame {k}: {part} {last}");
            }
            for (now, last) in rest_now.as_flattened().iter().zip(rest.as_flattened()) {
                assert!((now - of_rest * last).abs() <= 60.0, "frame {k}: {now} {last}");
            }
        }
    }
}
