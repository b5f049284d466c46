//! A calibration holds for what it was made on, and for nothing else.

use splash_firmware::calibration::{Step, Uncalibrated};
use splash_firmware::config::Config;
use splash_firmware::geometry::Mask;
use splash_tests::instrument::{Instrument, Values};

type Bank = Config<64, 8192, 0>;

fn bank(instrument: &Instrument) -> Box<Bank> {
    instrument.config()
}

/// The configuration of `instrument` with the calibration of another.
fn with_calibration_of(instrument: &Instrument, calibrated: &Instrument) -> Box<Bank> {
    let mut from = bank(calibrated);
    from.set_calibrated(&Step::ALL, 60_000);
    let mut bytes = Vec::new();
    from.save(&mut |piece| bytes.extend_from_slice(piece));
    let (mut running, mut other) = (bank(instrument), Box::new(Bank::new()));
    let mut banks = splash_firmware::banks::Banks::new(&mut running, &mut other);
    banks.copy().expect("something runs");
    let record = splash_firmware::adjust::Parameter::Calibration;
    banks.draft.adjust(&from.value(record).expect("it has one")).expect("a record");
    banks.draft.check().expect("valid");
    banks.draft.switch().expect("checked");
    banks.frame_boundary(|_, _| Ok(())).expect("ordered").expect("admitted");
    // They were exchanged.
    other
}

#[test]
fn what_is_missing_is_named() {
    let mut config = Box::new(Bank::new());
    assert_eq!(config.calibration(), Err(Uncalibrated::NotConfigured));
    config = bank(&Instrument::circle(8, 8));
    assert_eq!(config.calibration(), Err(Uncalibrated::Never));
    for (k, &missing) in Step::ALL.iter().enumerate() {
        let mut steps = Step::ALL.to_vec();
        steps.remove(k);
        config.set_calibrated(&steps, 65_535);
        assert_eq!(config.calibration(), Err(Uncalibrated::Missing(missing)));
    }
    config.set_calibrated(&Step::ALL, 61_000);
    assert_eq!(config.calibration().map(|calibration| calibration.quality_q16), Ok(61_000));
}

#[test]
fn a_calibration_survives_what_it_does_not_depend_on() {
    let instrument = Instrument::circle(8, 8);
    let mut other = instrument.clone();
    other.control_gain = Values::Uniform(0.3);
    other.reference_px = Values::Uniform([0.2, -0.1]);
    other.dark_adu = Values::Uniform(90.0);
    other.limits_m = Values::Uniform([[0.2 * other.stroke_m, 0.8 * other.stroke_m]; 3]);
    other.gate.zenith_angle_deg = 20.0;
    assert!(with_calibration_of(&other, &instrument).calibration().is_ok());
}

#[test]
fn a_calibration_of_something_else_is_refused() {
    let instrument = Instrument::circle(8, 8);
    let mut others = vec![Instrument::new(Mask::annulus(8, 0.3).expect("a mask"), 8); 4];
    for other in others.iter_mut().skip(1) {
        *other = instrument.clone();
    }
    // Two windows exchanged; another segment matrix; another stroke.
    others[1].origins.swap(3, 4);
    others[2].matrix = Values::Uniform([[1.0, 0.1, 1.0], [1.0, -0.8, -0.5], [1.0, 0.8, -0.5]]);
    others[3].stroke_m *= 1.01;
    others[3].response_m = Values::Uniform([[0.0, others[3].stroke_m]; 3]);
    others[3].flat_m = Values::Uniform([0.5 * others[3].stroke_m; 3]);
    others[3].limits_m = Values::Uniform([[0.0, others[3].stroke_m]; 3]);
    for (i, other) in others.iter().enumerate() {
        let found = with_calibration_of(other, &instrument).calibration();
        let calibrated = bank(&instrument).fingerprint();
        let configured = bank(other).fingerprint();
        assert_ne!(calibrated, configured, "{i}");
        assert_eq!(found, Err(Uncalibrated::Changed { calibrated, configured }), "{i}");
    }
}
