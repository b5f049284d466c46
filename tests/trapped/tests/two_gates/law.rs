//! The law of two gates in integers against its equations in f64.

use super::{Rig, coupling, instrument, tilts};
use splash_firmware::pipeline::Outcome;
use splash_tests::frames::Rng;
use splash_tests::instrument::{Instrument, Values};
use splash_tests::twin::control::Integrator;
use splash_tests::twin::modal::Modes;
use splash_tests::twin::pixels::Numbers;
use splash_tests::twin::stored;

const F: f64 = 1.13;
const G: f64 = 0.4;

/// The modes of `instrument`, physical and as they are stored: gradients with 15 bits for the largest, B / f
/// as Q12 of its two halves' sum and of the second.
fn modes(instrument: &Instrument) -> [Modes; 2] {
    let second = instrument.second.as_ref().expect("two gates");
    let physical = Modes::new(&second.modes, &second.coupling, instrument.count());
    let mut kept = physical.clone();
    let bits = exponent(&physical);
    for q in kept.gradients.iter_mut().flatten().flatten() {
        *q = stored(*q, bits);
    }
    let modes = kept.gradients.len();
    for row in &mut kept.coupling {
        for j in 0..modes {
            let both = stored((row[j] + row[modes + j]) / F, 12) * F;
            row[modes + j] = stored(row[modes + j] / F, 12) * F;
            row[j] = both - row[modes + j];
        }
    }
    [physical, kept]
}

/// The binary exponent under which the largest gradient has 15 bits.
fn exponent(modes: &Modes) -> i32 {
    let largest = modes.gradients.iter().flatten().flatten().fold(0.0f64, |m, q| m.max(q.abs()));
    (14..=20).rev().find(|&bits| largest * f64::powi(2.0, bits) <= 32767.0).expect("below 1")
}

/// What rounding adds to a correction, ulp: 1/2 for a and b (and as much again for their means, of which
/// the reciprocal of a count is off), 1/2 for each mode, 1/2 at the end.
fn rounding_ulp(modes: &Modes) -> f64 {
    let count = modes.gradients.len();
    let weights: Vec<f64> = modes
        .coupling
        .iter()
        .map(|row| {
            let [of_a, of_b] = [0, 1].map(|half| {
                let of = |j: usize| match half {
                    0 => (row[j] + row[count + j]).abs(),
                    _ => row[count + j].abs(),
                };
                (0..count).map(of).sum::<f64>() / F
            });
            0.5 + of_a + of_b
        })
        .collect();
    let at = |i: usize, axis: usize| {
        modes.gradients.iter().zip(&weights).map(|(q, w)| q[i][axis].abs() * w).sum::<f64>()
    };
    let all = (0..modes.gradients[0].len()).flat_map(|i| [at(i, 0), at(i, 1)]);
    0.5 + all.fold(0.0, f64::max)
}

/// 300 frames of two changing wavefronts with subapertures that come and go in either gate, also a whole
/// half, and all of the second. The model has its own state.
#[test]
fn commands_follow_the_law() {
    for (across, count) in [(8, 12), (8, 25), (6, 7)] {
        let mut rng = Rng::new(90 + count as u64);
        let mut instrument = instrument(across, count, coupling(count, 0.5, &mut rng));
        (instrument.lever_arm, instrument.control_gain) = (F, Values::Uniform(G));
        let [physical, kept] = modes(&instrument);
        let mut model = Integrator::new(&instrument, Numbers::Stored);
        let mut real = Integrator::new(&instrument, Numbers::Stored);
        let mut rig = Rig::new(&instrument);
        let subapertures = instrument.count();
        let (mut worst, mut largest) = ([0.0f64; 2], 0.0f64);
        let mut shown = vec![[0.0; 2]; subapertures];
        for frame in 0..300 {
            let mut seen = [(); 2].map(|()| {
                tilts(subapertures, 200_000.0, &mut rng).into_iter().map(Some).collect::<Vec<_>>()
            });
            if frame >= 50 {
                seen.iter_mut().flatten().filter(|_| rng.below(8) == 0).for_each(|s| *s = None);
            }
            let half = subapertures / 2;
            match frame {
                100..120 => seen[1].iter_mut().take(half).for_each(|s| *s = None),
                120..140 => seen[0].iter_mut().take(half).for_each(|s| *s = None),
                140..160 => seen[1].fill(None),
                _ => (),
            }
            assert_eq!(rig.frame(&seen).outcome, Outcome::Updated, "frame {frame}");
            let [first, second] = rig.slopes();
            for (slopes, seen) in [&first, &second].into_iter().zip(&seen) {
                assert!(slopes.iter().zip(seen).all(|(a, b)| a.is_some() == b.is_some()));
            }
            let slopes = [first.as_slice(), second.as_slice()];
            model.update(&kept.corrected(slopes, &shown, F), &shown);
            real.update(&physical.corrected(slopes, &shown, F), &shown);
            worst[0] = worst[0].max(rig.distance(&model.command));
            worst[1] = worst[1].max(rig.distance(&real.command));
            let correction = kept.correction(slopes, &shown, F);
            largest = correction.as_flattened().iter().fold(largest, |m, u| m.max(u.abs()));
            shown = rig.shown();
        }
        let bound = F * rounding_ulp(&kept) + 2.0 / G;
        println!(
            "N = {across}, {count} modes: {:.1} of {bound:.1} ulp; from unquantised modes {:.1}; \
             corrections up to {largest:.0}",
            worst[0], worst[1]
        );
        assert!(largest > 100_000.0, "the modes do something");
        assert!(worst[0] <= bound, "{worst:?}");
        // 12 bits of the largest correction.
        assert!(worst[1] <= bound + largest / 4096.0, "{worst:?}");
    }
}

/// Without light in the second gate the commands are those of a second gate that sees what the first
/// sees, and no frame is held for it.
#[test]
fn a_dark_second_gate_counts_as_the_first() {
    let mut rng = Rng::new(95);
    let instrument = instrument(8, 12, coupling(12, 0.5, &mut rng));
    let (mut dark, mut same) = (Rig::new(&instrument), Rig::new(&instrument));
    for _ in 0..20 {
        let first: Vec<_> =
            tilts(instrument.count(), 200_000.0, &mut rng).into_iter().map(Some).collect();
        let reports = [
            dark.frame(&[first.clone(), vec![None; first.len()]]),
            same.frame(&[first.clone(), first]),
        ];
        for report in reports {
            assert_eq!((report.outcome, report.valid), (Outcome::Updated, 52));
        }
        assert_eq!(dark.path.commands(), same.path.commands());
    }
    assert!(dark.path.second_slopes().iter().all(|slope| !slope.valid));
}

/// A uniform tilt of the second gate alone changes nothing, whoever is invalid: no mode has one, and the
/// mean that is taken off is that over the valid.
#[test]
fn a_uniform_tilt_is_in_no_mode() {
    let mut rng = Rng::new(96);
    let instrument = instrument(8, 25, coupling(25, 0.5, &mut rng));
    let (mut without, mut with) = (Rig::new(&instrument), Rig::new(&instrument));
    let mut worst = 0.0f64;
    for _ in 0..20 {
        let mut seen = [(); 2].map(|()| {
            tilts(instrument.count(), 200_000.0, &mut rng).into_iter().map(Some).collect::<Vec<_>>()
        });
        seen.iter_mut().flatten().filter(|_| rng.below(4) == 0).for_each(|s| *s = None);
        without.frame(&seen);
        for s in seen[1].iter_mut().flatten() {
            *s = [s[0] + 400_000.0, s[1] - 300_000.0];
        }
        with.frame(&seen);
        let commands = without.path.commands().iter().map(|c| c.map(f64::from));
        worst = worst.max(with.distance(&commands.collect::<Vec<_>>()));
    }
    let [_, kept] = modes(&instrument);
    let bound = 2.0 * (F * rounding_ulp(&kept) + 2.0 / G);
    println!("{worst:.1} of {bound:.1} ulp");
    assert!(worst <= bound, "{worst}");
}
