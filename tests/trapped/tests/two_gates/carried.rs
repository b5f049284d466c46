//! What carries a configuration carries its second gate: images, excerpts, adjustments, banks.

use super::{Bank, Path, circle, coupling, instrument};
use splash_firmware::adjust::{AdjustError, Adjustment, Parameter};
use splash_firmware::banks::{BankError, Banks, DraftState};
use splash_firmware::config::Config;
use splash_firmware::error::{ConfigError, Field};
use splash_firmware::image::{ImageError, VERSION, VERSION_TWO_GATES};
use splash_firmware::pipeline::Pipeline;
use splash_tests::frames::{self, Rng};
use splash_tests::instrument::{Instrument, step};
use splash_tests::twin::modal::polynomials;

/// Without room for a second gate.
type OneGate = Config<300, 6000, 100>;

fn usual() -> Instrument {
    instrument(8, 12, coupling(12, 0.5, &mut Rng::new(130)))
}

fn image<const M: usize, const P: usize, const B: usize, const K: usize>(
    config: &Config<M, P, B, K>,
) -> Vec<u8> {
    let mut bytes = Vec::new();
    config.save(&mut |piece| bytes.extend_from_slice(piece));
    bytes
}

fn load<const M: usize, const P: usize, const B: usize, const K: usize>(
    bytes: &[u8],
) -> Result<Box<Config<M, P, B, K>>, ImageError> {
    let mut config = Box::new(Config::new());
    let mut rest = bytes;
    config.load(&mut |buffer| {
        let Some((now, after)) = rest.split_at_checked(buffer.len()) else { return false };
        buffer.copy_from_slice(now);
        rest = after;
        true
    })?;
    Ok(config)
}

/// Bytes with the checksum that belongs to them.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let end = bytes.len() - 4;
    let checksum = crc.checksum(&bytes[..end]);
    bytes[end..].copy_from_slice(&checksum.to_le_bytes());
    bytes
}

#[test]
fn an_image_is_the_configuration() {
    let instrument = usual();
    let built: Box<Bank> = instrument.bank();
    let bytes = image(&*built);
    assert_eq!(bytes[4..6], VERSION_TWO_GATES.to_le_bytes());
    assert_eq!(bytes.len(), built.image_bytes());
    let loaded = load::<300, 6000, 100, 12>(&bytes).expect("a good image");
    assert_eq!(image(&*loaded), bytes);
    assert_eq!((loaded.windows(), loaded.modes()), (104, 12));
    let mut buffer = [0; 50];
    assert_eq!(built.excerpt(bytes.len() / 2, &mut buffer), &bytes[bytes.len() / 2..][..50]);

    let mut here = Box::new(Path::new());
    let mut there = Box::new(Pipeline::<300, 100, 12>::new());
    let mut rng = Rng::new(131);
    let mut all = instrument.clone();
    all.origins.extend(&instrument.second.as_ref().expect("two gates").origins);
    for number in 0..4 {
        let centroids: Vec<_> =
            (0..104).map(|_| Some([0; 2].map(|_: i32| rng.between(-30_000, 30_000)))).collect();
        let pixels = frames::steered(&all, centroids, 50_000);
        step(&mut here, &built, number, &pixels);
        step(&mut there, &loaded, number, &pixels);
        assert_eq!(here.codes(), there.codes());
    }
}

#[test]
fn one_gate_has_the_image_it_had() {
    let config: Box<Bank> = Instrument::circle(8, 4).bank();
    let bytes = image(&*config);
    assert_eq!(bytes[4..6], VERSION.to_le_bytes());
    let without = Instrument::circle(8, 4).config::<64, 1024, 0>();
    assert_eq!(image(&*without), bytes);
    load::<300, 6000, 100, 0>(&bytes).expect("one gate");
}

#[test]
fn bad_images_are_refused() {
    let built: Box<Bank> = usual().bank();
    let bytes = image(&*built);
    let field = |error| match error {
        ImageError::Refused(ConfigError { field, .. }) => Some(field),
        _ => None,
    };
    let none = load::<300, 6000, 100, 0>(&bytes).expect_err("one gate only");
    assert_eq!(field(none), Some(Field::Modes));
    let few = load::<300, 6000, 100, 11>(&bytes).expect_err("12 modes");
    assert_eq!(field(few), Some(Field::Modes));
    // The gradients end before C of 12 x 24 entries, the template, the bank and the checksum.
    let bank = 104 * 16 * 5;
    let template = 8 * splash_firmware::centroid::TEMPLATE;
    let coupling = bytes.len() - 4 - bank - template - 12 * 24 * 4;
    let mut long = bytes.clone();
    long[coupling - 8..coupling].fill(0x7f);
    assert_eq!(
        field(load::<300, 6000, 100, 12>(&sealed(long)).expect_err("modes")),
        Some(Field::Modes)
    );
    let mut large = bytes.clone();
    large[coupling..coupling + 4].copy_from_slice(&(65i32 << 12).to_le_bytes());
    let refused = load::<300, 6000, 100, 12>(&sealed(large)).expect_err("B / f = 65");
    assert_eq!(field(refused), Some(Field::Coupling));
    // Behind magic and version the head and the calibration, each after its length; then modes and exponent.
    let behind = |at: usize| at + 1 + usize::from(bytes[at]);
    let exponent = behind(behind(6)) + 2;
    for bad in [13, 21] {
        let mut shifted = bytes.clone();
        shifted[exponent] = bad;
        let Err(ImageError::Refused(error)) = load::<300, 6000, 100, 12>(&sealed(shifted)) else {
            panic!("refused")
        };
        assert_eq!((error.field, error.value), (Field::Modes, f64::from(bad)));
        assert!(error.to_string().contains("exponent"), "{error}");
    }
    for cut in [coupling - 20, coupling + 20] {
        assert_eq!(load::<300, 6000, 100, 12>(&bytes[..cut]).err(), Some(ImageError::Cut));
    }
}

/// Every value that can be read can be written, and is what then is read.
#[test]
fn values_of_one_bank_make_the_other() {
    let (instrument, mut other) = (usual(), usual());
    let second = other.second.as_mut().expect("two gates");
    second.modes[..52].iter_mut().for_each(|q| *q = q.map(|q| -q));
    second.coupling.iter_mut().for_each(|b| *b *= 0.5);
    second.reference_px = splash_tests::instrument::Values::Uniform([0.5, -0.25]);
    let (mut running, mut draft): (Box<Bank>, Box<Bank>) = (instrument.bank(), other.bank());
    let (wanted, hash) = (image(&*draft), draft.hash());
    let seconds = (0..52).map(|index| Parameter::SecondGate { index });
    let gradients = (0..52).map(|index| Parameter::Gradients { index });
    let rows = (0..12).map(|row| Parameter::Coupling { row });
    let parameters: Vec<_> = seconds.chain(gradients).chain(rows).collect();
    let values: Vec<_> =
        parameters.iter().map(|&parameter| draft.value(parameter).expect("there")).collect();
    let mut banks = Banks::new(&mut running, &mut draft);
    banks.copy().expect("what runs");
    for value in &values {
        banks.draft.adjust(value).expect("a good value");
    }
    assert_eq!(banks.draft.check(), Ok(hash));
    assert_eq!(image(banks.draft.whole().expect("checked")), wanted);
    for (parameter, value) in parameters.iter().zip(&values) {
        assert_eq!(banks.draft.whole().expect("checked").value(*parameter).as_ref(), Ok(value));
    }
    banks.draft.switch().expect("checked");
    let exchanged = banks.frame_boundary(|before, next| {
        assert!(next.continues(before));
        Ok(())
    });
    assert_eq!(exchanged, Some(Ok(hash)));
}

#[test]
fn bad_adjustments_change_nothing() {
    let (mut running, mut draft): (Box<Bank>, Box<Bank>) = (usual().bank(), usual().bank());
    let before = draft.hash();
    let mut banks = Banks::new(&mut running, &mut draft);
    let few = |count| (0..count).map(|_| [1, 2]).collect();
    for (adjustment, error) in [
        (
            Adjustment::Gradients { index: 52, values: [[0; 2]; 12].into_iter().collect() },
            AdjustError::Place { found: 52, entries: 52 },
        ),
        (
            Adjustment::Gradients { index: 0, values: [[0; 2]; 11].into_iter().collect() },
            AdjustError::Place { found: 11, entries: 12 },
        ),
        (
            Adjustment::Coupling { row: 12, values: few(12) },
            AdjustError::Place { found: 12, entries: 12 },
        ),
        (
            Adjustment::Coupling { row: 0, values: few(13) },
            AdjustError::Place { found: 13, entries: 12 },
        ),
    ] {
        assert_eq!(banks.draft.adjust(&adjustment), Err(BankError::Adjust(error)));
    }
    let large = Adjustment::Coupling { row: 1, values: [[65 << 12; 2]; 12].into_iter().collect() };
    let Err(BankError::Adjust(AdjustError::Value(error))) = banks.draft.adjust(&large) else {
        panic!("refused")
    };
    assert_eq!((error.field, error.index), (Field::Coupling, Some(24)));
    assert_eq!(banks.draft.check(), Ok(before));
    // Modes that do not go together are found when all is checked.
    let zero = Adjustment::Gradients { index: 0, values: [[20_000; 2]; 12].into_iter().collect() };
    banks.draft.adjust(&zero).expect("good by itself");
    let Err(BankError::Adjust(AdjustError::Value(error))) = banks.draft.check() else {
        panic!("refused")
    };
    assert_eq!(error.field, Field::Modes);
    assert_eq!(banks.draft.state(), DraftState::Open);
}

/// Frames cannot go on from one gate to two: thresholds are kept window by window.
#[test]
fn gates_change_with_a_reset_only() {
    let one: Box<Bank> = Instrument::ideal(circle(8), 4).bank();
    let two: Box<Bank> = usual().bank();
    assert!(!two.continues(&one) && !one.continues(&two) && two.continues(&two));
    let alone = Box::<OneGate>::default();
    assert_eq!((alone.windows(), alone.modes()), (0, 0));
}

/// N = 16 with two gates and 25 modes has the capacities that the emulated boards have.
#[test]
fn the_largest_fits_the_emulated_boards() {
    let mask = circle(16);
    let instrument = Instrument::new(mask, 8)
        .with_second_gate(polynomials(&mask, 25), coupling(25, 0.1, &mut Rng::new(132)));
    let config = instrument.bank::<416, 26_624, 2048, 25>();
    assert_eq!((config.windows(), config.modes()), (416, 25));
    let mut pipeline = Box::new(Pipeline::<416, 2048, 25>::new());
    let mut rng = Rng::new(133);
    let mut all = instrument.clone();
    all.origins.extend(&instrument.second.as_ref().expect("two gates").origins);
    let centroids = (0..416).map(|_| Some([0; 2].map(|_: i32| rng.between(-60_000, 60_000))));
    let pixels = frames::steered(&all, centroids, 4000);
    step(&mut pipeline, &config, 0, &pixels);
    assert!(pipeline.second_slopes().iter().all(|slope| slope.valid));
}
