//! What a second gate is refused for: field, value and limit.

use super::{Bank, coupling, instrument};
use splash_firmware::config::Config;
use splash_firmware::error::{ConfigError, Field, Limit};
use splash_tests::frames::Rng;
use splash_tests::instrument::{Instrument, SecondGate, Values};

fn usual() -> Instrument {
    instrument(8, 12, coupling(12, 0.5, &mut Rng::new(110)))
}

fn refusal(change: impl FnOnce(&mut Instrument, &mut SecondGate)) -> ConfigError {
    let mut instrument = usual();
    let mut second = instrument.second.take().expect("two gates");
    change(&mut instrument, &mut second);
    instrument.second = Some(second);
    instrument.try_bank::<128, { 128 * 16 }, 0, 25>().expect_err("refused")
}

fn rule(limit: Limit) -> &'static str {
    match limit {
        Limit::Rule(rule) => rule,
        _ => "",
    }
}

#[test]
fn what_fits_is_taken() {
    let config: Box<Bank> = usual().bank();
    assert_eq!((config.subapertures(), config.windows(), config.modes()), (52, 104, 12));
}

#[test]
fn there_must_be_room() {
    let room = |error: ConfigError| (error.field, error.value, error.limit);
    let small = |instrument: Instrument| instrument.try_bank::<128, 2048, 0, 11>().err();
    let within = Limit::Within(1.0, 11.0);
    assert_eq!(small(usual()).map(room), Some((Field::Modes, 12.0, within)));
    let none = usual().try_bank::<128, 2048, 0, 0>().expect_err("one gate only");
    assert_eq!((none.field, none.value), (Field::Modes, 12.0));
    assert!(rule(none.limit).contains("no room"), "{none}");
    let few = usual().try_bank::<103, 2048, 0, 25>().expect_err("104 windows");
    assert_eq!(room(few), (Field::Windows, 104.0, Limit::Within(1.0, 103.0)));
    let pixels = usual().try_bank::<128, 1663, 0, 25>().expect_err("104 x 16 pixels");
    assert_eq!(room(pixels), (Field::WindowPixels, 1664.0, Limit::Within(1.0, 1663.0)));
}

#[test]
fn windows_have_their_places() {
    let beyond = refusal(|instrument, second| second.origins[3][1] = instrument.detector.height);
    assert_eq!((beyond.field, beyond.index), (Field::SecondOrigin, Some(3)));
    let first = refusal(|instrument, second| {
        instrument.origins.swap_with_slice(&mut second.origins);
    });
    assert_eq!((first.field, first.index), (Field::SecondOrigin, Some(0)));
    assert!(rule(first.limit).contains("after"), "{first}");
    let other_gate = refusal(|instrument, second| second.origins[7] = instrument.origins[9]);
    assert_eq!(
        (other_gate.field, other_gate.index, other_gate.value),
        (Field::SecondOrigin, Some(7), 9.0)
    );
    let same_gate = refusal(|_, second| second.origins[7] = second.origins[9]);
    assert_eq!(
        (same_gate.field, same_gate.index, same_gate.value),
        (Field::SecondOrigin, Some(7), 9.0)
    );
}

#[test]
fn lists_have_their_lengths() {
    for (field, error) in [
        (Field::SecondOrigin, refusal(|_, second| _ = second.origins.pop())),
        (Field::Modes, refusal(|_, second| _ = second.modes.pop())),
        (Field::Coupling, refusal(|_, second| _ = second.coupling.pop())),
        (
            Field::SecondReference,
            refusal(|_, second| second.reference_px = Values::Each(vec![[0.0; 2]; 51])),
        ),
    ] {
        assert_eq!(error.field, field);
        assert!(rule(error.limit).contains("entries"), "{error}");
    }
}

#[test]
fn modes_are_orthonormal_and_without_tilt() {
    let longer =
        refusal(|_, second| second.modes[..52].iter_mut().for_each(|q| *q = q.map(|q| 1.01 * q)));
    assert_eq!((longer.field, longer.index), (Field::Modes, Some(0)));
    assert!((longer.value - 1.0201).abs() < 1e-3, "{longer}");
    let twice = refusal(|_, second| second.modes.copy_within(0..52, 104));
    assert_eq!((twice.field, twice.index), (Field::Modes, Some(0)));
    assert!((twice.value - 1.0).abs() < 1e-3, "{twice}");
    let tilt = refusal(|_, second| second.modes[52..104].fill([f64::sqrt(1.0 / 104.0); 2]));
    assert_eq!(tilt.field, Field::Modes);
    let tilted = refusal(|_, second| second.modes[..52].fill([f64::sqrt(1.0 / 52.0), 0.0]));
    assert_eq!(tilted.field, Field::Modes);
    for value in [f64::NAN, 1.5] {
        let error = refusal(|_, second| second.modes[60][1] = value);
        assert_eq!(
            (error.field, error.index, error.limit),
            (Field::Modes, Some(60), Limit::Within(-1.0, 1.0))
        );
    }
}

#[test]
fn numbers_have_their_ranges() {
    let limit = Limit::Within(-64.0, 64.0);
    // B over f, which is 1 here: the second half, and the sum of both.
    let large = refusal(|_, second| second.coupling[24 * 2 + 12 + 5] = 64.1);
    assert_eq!((large.field, large.limit), (Field::Coupling, limit));
    let sum = refusal(|_, second| (second.coupling[0], second.coupling[12]) = (40.0, 40.0));
    assert_eq!((sum.field, sum.index, sum.value), (Field::Coupling, Some(0), 80.0));
    let nan = refusal(|_, second| second.coupling[1] = f64::NAN);
    assert_eq!((nan.field, nan.index), (Field::Coupling, Some(1)));
    let reference = refusal(|_, second| second.reference_px = Values::Uniform([0.0, 33.0]));
    assert_eq!(reference.field, Field::SecondReference);
    let singular = refusal(|_, second| second.slope_gain_m_per_px = Values::Uniform([[0.0; 2]; 2]));
    assert_eq!(singular.field, Field::SecondGain);
    let flux = refusal(|_, second| second.flux_max_adu = Values::Uniform(1.0));
    assert_eq!(flux.field, Field::SecondFluxMax);
    let least = refusal(|_, second| second.flux_min_adu = Values::Uniform(-1.0));
    assert_eq!((least.field, least.value), (Field::SecondFluxMin, -1.0));
}

#[test]
fn a_schedule_is_for_one_gate() {
    let error = refusal(|instrument, _| instrument.lattice = Some([2, 1, 1]));
    assert_eq!((error.field, error.value), (Field::Modes, 12.0));
    assert!(rule(error.limit).contains("schedule"), "{error}");
}

/// A refused build leaves what was there.
#[test]
fn a_refusal_changes_nothing() {
    let mut config: Box<Bank> = usual().bank();
    let before = config.hash();
    let mut bad = usual();
    bad.second.as_mut().expect("two gates").coupling[3] = 100.0;
    config.build(&bad.spec()).expect_err("refused");
    assert_eq!(config.hash(), before);
    let mut alone: Box<Config<128, 2048, 0, 25>> = Instrument::circle(8, 4).bank();
    assert_eq!((alone.windows(), alone.modes()), (52, 0));
    alone.build(&usual().spec()).expect("two gates");
    assert_eq!(alone.hash(), before);
}
