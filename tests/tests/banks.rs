//! Two banks: whatever happens to the other one, what runs is a whole configuration that was asked for.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use splash_firmware::adjust::{AdjustError, Adjustment, PIXELS, Parameter};
use splash_firmware::banks::{BankError, Banks, DraftState};
use splash_firmware::centroid::EstimatorConfig;
use splash_firmware::config::Config;
use splash_firmware::error::Field;
use splash_firmware::gate::ShortFrame;
use splash_firmware::geometry::Mask;
use splash_firmware::image::ImageError;
use splash_firmware::mirror::Serials;
use splash_firmware::mode::Refusal;
use splash_firmware::spec::Estimator;
use splash_tests::instrument::{Instrument, Values};
use std::collections::{HashSet, VecDeque};

type Bank = Config<16, 256, 0>;

fn image<const M: usize, const P: usize, const B: usize>(config: &Config<M, P, B>) -> Vec<u8> {
    let mut bytes = Vec::new();
    config.save(&mut |piece| bytes.extend_from_slice(piece));
    bytes
}

/// A configuration that the model knows; `changed`: after its one adjustment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Known {
    mask: usize,
    changed: bool,
}

/// The images of the four configurations, as they are built from their specifications.
struct Library([[Vec<u8>; 2]; 2]);

impl Library {
    fn new() -> Self {
        let masks = [Mask::circle(4), Mask::square(4)].map(|mask| mask.expect("a mask"));
        Self(masks.map(|mask| {
            [false, true].map(|changed| {
                let mut instrument = Instrument::new(mask, 4);
                let mut gains = vec![0.5; mask.count()];
                if changed {
                    gains[0] = 0.25;
                }
                instrument.control_gain = Values::Each(gains);
                image::<16, 256, 0>(&instrument.config())
            })
        }))
    }

    fn image(&self, known: Option<Known>) -> &[u8] {
        known.map_or(&[], |known| &self.0[known.mask][usize::from(known.changed)])
    }

    /// The checksum at an image's end; 0 without one.
    fn hash(&self, known: Option<Known>) -> u32 {
        self.image(known).last_chunk().map_or(0, |&bytes| u32::from_le_bytes(bytes))
    }

    /// Third `k` of an image.
    fn third(&self, known: Known, k: usize) -> (u32, &[u8]) {
        let bytes = self.image(Some(known));
        let ends = [0, bytes.len() / 3, 2 * bytes.len() / 3, bytes.len()];
        (ends[k] as u32, &bytes[ends[k]..ends[k + 1]])
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Action {
    Begin(usize),
    Next,
    Damaged,
    Elsewhere,
    Copy,
    Adjust,
    AdjustBadly,
    Check,
    Switch,
    Discard,
    Boundary,
    /// A boundary at which the loop does not take what was ordered.
    Refused,
}

const ACTIONS: [Action; 13] = [
    Action::Begin(0),
    Action::Begin(1),
    Action::Next,
    Action::Damaged,
    Action::Elsewhere,
    Action::Copy,
    Action::Adjust,
    Action::AdjustBadly,
    Action::Check,
    Action::Switch,
    Action::Discard,
    Action::Boundary,
    Action::Refused,
];

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Other {
    Empty,
    /// So many thirds of an image have come.
    Receiving(Known, usize),
    Open(Known),
    Checked(Known),
    Ordered(Known),
}

/// The rules, as the module's documentation gives them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Model {
    running: Option<Known>,
    other: Other,
}

impl Model {
    /// What an action leads to, and whether it is refused.
    fn step(self, action: Action) -> (Self, bool) {
        use Other::{Checked, Empty, Open, Ordered, Receiving};
        let to = |other| (Self { other, ..self }, false);
        let (kept, refused) = ((self, false), (self, true));
        match (action, self.other) {
            (Action::Discard, _) => to(Empty),
            (Action::Boundary, Ordered(next)) => {
                let other = self.running.map_or(Empty, Open);
                (Self { running: Some(next), other }, false)
            }
            (Action::Refused, Ordered(next)) => to(Checked(next)),
            (Action::Boundary | Action::Refused, _) => kept,
            (
                Action::Begin(_) | Action::Copy | Action::Adjust | Action::AdjustBadly,
                Ordered(_),
            ) => refused,
            (Action::Begin(mask), _) => to(Receiving(Known { mask, changed: false }, 0)),
            (Action::Next, Receiving(known, 2)) => to(Checked(known)),
            (Action::Next, Receiving(known, k)) => to(Receiving(known, k + 1)),
            (Action::Damaged, Receiving(..)) => (Self { other: Empty, ..self }, true),
            (Action::Next | Action::Damaged | Action::Elsewhere, _) => refused,
            (Action::Copy, _) => match self.running {
                Some(running) => to(Open(running)),
                None => (Self { other: Empty, ..self }, true),
            },
            (Action::Adjust, Open(known) | Checked(known)) => {
                to(Open(Known { changed: true, ..known }))
            }
            (Action::Adjust | Action::AdjustBadly, _) => refused,
            (Action::Check, Open(known)) => to(Checked(known)),
            (Action::Check, Checked(_) | Ordered(_)) => kept,
            (Action::Switch, Checked(known) | Ordered(known)) => to(Ordered(known)),
            (Action::Check | Action::Switch, _) => refused,
        }
    }
}

/// Does it to the banks, and returns whether it was refused.
fn apply(
    banks: &mut Banks<'_, 16, 256, 0>,
    library: &Library,
    model: Model,
    action: Action,
) -> Result<(), BankError> {
    // Where no image is coming, any chunk will do.
    let (known, k) = match model.other {
        Other::Receiving(known, k) => (known, k),
        _ => (Known { mask: 0, changed: false }, 0),
    };
    let (offset, bytes) = library.third(known, k);
    match action {
        Action::Begin(mask) => {
            let length = library.image(Some(Known { mask, changed: false })).len();
            banks.draft.begin(length as u32)
        }
        Action::Next => banks.draft.chunk(offset, bytes).map(|_| ()),
        Action::Damaged => {
            // All that is left of it, with a wrong bit in its checksum.
            let mut rest = library.image(Some(known))[offset as usize..].to_vec();
            if let Some(last) = rest.last_mut() {
                *last ^= 0x10;
            }
            banks.draft.chunk(offset, &rest).map(|_| ())
        }
        Action::Elsewhere => banks.draft.chunk(offset + 1, bytes).map(|_| ()),
        Action::Copy => banks.copy(),
        Action::Adjust => banks.draft.adjust(&gain(banks, 6144, 2048)),
        Action::AdjustBadly => banks.draft.adjust(&gain(banks, 6144, 0)),
        Action::Check => banks.draft.check().map(|_| ()),
        Action::Switch => banks.draft.switch().map(|_| ()),
        Action::Discard => {
            banks.draft.discard();
            Ok(())
        }
        Action::Refused => {
            let refused = banks.frame_boundary(|_, _| Err(Refusal::NotFlat));
            let due = matches!(model.other, Other::Ordered(_));
            assert_eq!(refused, due.then_some(Err(Refusal::NotFlat)));
            Ok(())
        }
        Action::Boundary => {
            let before = image(banks.running());
            let mut continues = None;
            let switched = banks.frame_boundary(|before, next| {
                continues = Some(next.continues(before));
                Ok(())
            });
            assert_eq!(switched.is_some(), matches!(model.other, Other::Ordered(_)));
            if let (Some(switched), Other::Ordered(next)) = (switched, model.other) {
                assert_eq!(switched, Ok(library.hash(Some(next))));
                let same_mask = model.running.is_some_and(|running| running.mask == next.mask);
                assert_eq!(continues, Some(same_mask), "another mask starts from flat");
            } else {
                assert!(image(banks.running()) == before);
            }
            Ok(())
        }
    }
}

/// Subaperture 0 of the other bank with g = 1/4 and f = 1: 1 - g and g f in Q13.
fn gain(banks: &Banks<'_, 16, 256, 0>, keep: i16, take: i16) -> Adjustment {
    let subaperture = Parameter::Subaperture { index: 0 };
    let value = banks.draft.whole().map(|config| config.value(subaperture));
    match value {
        Some(Ok(Adjustment::Subaperture { index, mut entry })) => {
            (entry.gains.keep, entry.gains.take) = (keep, take);
            Adjustment::Subaperture { index, entry }
        }
        // Nothing that could be adjusted.
        _ => Adjustment::Calibration(None),
    }
}

fn check(banks: &Banks<'_, 16, 256, 0>, library: &Library, model: Model, path: &[Action]) {
    assert!(image(banks.running()) == library.image(model.running), "{path:?}: what runs");
    assert_eq!(banks.hash(), library.hash(model.running), "{path:?}");
    let hash = |known| library.hash(Some(known));
    let expected = match model.other {
        Other::Empty => DraftState::Empty,
        Other::Receiving(known, k) => DraftState::Receiving {
            due: library.third(known, k).0,
            length: library.image(Some(known)).len() as u32,
        },
        Other::Open(_) => DraftState::Open,
        Other::Checked(known) => DraftState::Checked { hash: hash(known) },
        Other::Ordered(known) => DraftState::Ordered { hash: hash(known) },
    };
    assert_eq!(banks.draft.state(), expected, "{path:?}");
    let whole = match model.other {
        Other::Open(known) | Other::Checked(known) | Other::Ordered(known) => Some(known),
        Other::Empty | Other::Receiving(..) => None,
    };
    let found = banks.draft.whole().map(image).unwrap_or_default();
    assert!(found == library.image(whole), "{path:?}: what is in the other bank");
}

/// Every action in every state that can be reached: what runs, what is in the other bank and what is
/// refused are those of the rules.
#[test]
fn every_action_in_every_state_does_what_the_rules_say() {
    let library = Library::new();
    let start = Model { running: None, other: Other::Empty };
    let mut seen = HashSet::from([start]);
    let mut due = VecDeque::from([(start, Vec::new())]);
    let mut transitions = 0;
    while let Some((model, path)) = due.pop_front() {
        for action in ACTIONS {
            let (mut a, mut b) = (Box::new(Bank::new()), Box::new(Bank::new()));
            let mut banks = Banks::new(&mut a, &mut b);
            let mut now = start;
            for &before in &path {
                let _ = apply(&mut banks, &library, now, before);
                (now, _) = now.step(before);
            }
            assert_eq!(now, model);
            let mut path = path.clone();
            path.push(action);
            let (next, refused) = model.step(action);
            let done = apply(&mut banks, &library, model, action);
            assert_eq!(done.is_err(), refused, "{path:?}: {done:?}");
            check(&banks, &library, next, &path);
            transitions += 1;
            if seen.insert(next) {
                due.push_back((next, path));
            }
        }
    }
    // Running: none or one of four. Other: empty, two images in three stages, and what is whole in
    // three states; where nothing runs there is nothing to copy or to go back to.
    println!("{} states, {transitions} transitions", seen.len());
    assert!(seen.iter().any(|m| m.running.is_some_and(|running| running.changed)));
    assert_eq!(transitions, seen.len() * ACTIONS.len());
}

fn big(instrument: &Instrument) -> Box<Config<64, 8192, 2048>> {
    instrument.config()
}

/// Every parameter of a configuration with that many subapertures and pixels.
fn parameters(subapertures: usize, pixels: usize) -> Vec<Parameter> {
    let firsts = || (0..pixels as u32).step_by(PIXELS);
    let mut all = vec![Parameter::Head, Parameter::Calibration];
    all.extend((0..subapertures as u16).map(|index| Parameter::Subaperture { index }));
    all.extend((0..8).map(|phase| Parameter::Template { phase }));
    all.extend(firsts().map(|first| Parameter::Floors { first }));
    all.extend(firsts().map(|first| Parameter::Losses { first }));
    all.extend(firsts().map(|first| Parameter::Thresholds { first }));
    all
}

/// Whatever a specification can say of an instrument with the same mask, windows and detector, can be
/// reached by adjustments: the image is then the one that was built from it.
#[test]
fn adjustments_reach_every_configuration_of_the_same_geometry() {
    let base = Instrument::circle(8, 8);
    let count = base.count();
    let mut other = base.clone();
    let stroke = base.stroke_m;
    let each = |low: f64, high: f64, n: usize| -> Vec<f64> {
        (0..n).map(|i| low + (high - low) * ((i * 37) % 101) as f64 / 100.0).collect()
    };
    let pixels = 64 * 64;
    other.estimator =
        Estimator::WeightedCentreOfGravity { peak_fraction: 0.2, fwhm_px: 3.0, gain: 1.7 };
    other.dark_adu = Values::Each(each(80.0, 120.0, pixels));
    other.pixel_gain = Values::Each(each(0.5, 2.0, pixels));
    other.noise_adu = Values::Each(each(0.5, 3.0, pixels));
    other.control_gain = Values::Each(each(0.1, 1.9, count));
    other.lever_arm = 1.1;
    other.reference_px = Values::Each(each(-2.0, 2.0, count).iter().map(|&r| [r, -r]).collect());
    other.flux_min_adu = Values::Each(each(100.0, 300.0, count));
    other.flux_max_adu = Values::Each(each(1e5, 1e6, count));
    other.flat_m = Values::Each(each(0.4, 0.6, count).iter().map(|f| [f * stroke; 3]).collect());
    other.limits_m = Values::Uniform([[0.1 * stroke, 0.9 * stroke]; 3]);
    other.slew_m_per_frame = Some(stroke / 50.0);
    other.delay_frames = 2;
    other.sor.sweeps = Some(7);
    other.gate.zenith_angle_deg = 30.0;
    other.saturation_adu = Some(4000);
    other.lattice = Some([2, 0, 2]);
    other.gate.short_frame = ShortFrame::Drop;
    other.safety.valid_min = 0.7;
    other.safety.flux_min_adu = 1e4;
    other.safety.saturated_pixels_max = 17;
    other.safety.saturated_share = 0.3;
    other.serials = Serials { mirror: 7, detector: 9 };
    let (mut running, mut draft, target) = (big(&base), big(&base), big(&other));
    assert!(image(&running) != image(&target));

    let mut banks = Banks::new(&mut running, &mut draft);
    banks.copy().expect("something runs");
    for parameter in parameters(count, count * 64) {
        let value = target.value(parameter).expect("it has it");
        banks.draft.adjust(&value).expect("within the limits");
    }
    let hash = banks.draft.check().expect("valid as a whole");
    assert_eq!(hash, target.hash());
    banks.draft.switch().expect("checked");
    assert!(image(banks.running()) == image(&big(&base)), "until the frame's boundary");
    let mut continues = true;
    let switched = banks.frame_boundary(|before, next| {
        continues = next.continues(before);
        Ok(())
    });
    assert_eq!(switched, Some(Ok(hash)));
    assert!(!continues, "another flat map");
    assert!(image(banks.running()) == image(&target));
}

#[test]
fn adjustments_out_of_their_limits_change_nothing() {
    let instrument = Instrument::circle(8, 8);
    let (mut running, mut draft) = (big(&instrument), big(&instrument));
    let mut banks = Banks::new(&mut running, &mut draft);
    let before = image(banks.running());
    let config = big(&instrument);
    let (Ok(Adjustment::Head(head)), Ok(Adjustment::Subaperture { index, entry })) =
        (config.value(Parameter::Head), config.value(Parameter::Subaperture { index: 3 }))
    else {
        panic!("not what was asked for");
    };
    let with_head = |change: &dyn Fn(&mut splash_firmware::image::Head)| {
        let mut head = head;
        change(&mut head);
        Adjustment::Head(head)
    };
    let with_entry = |change: &dyn Fn(&mut splash_firmware::image::Subaperture)| {
        let mut entry = entry;
        change(&mut entry);
        Adjustment::Subaperture { index, entry }
    };
    let values = [
        (with_head(&|h| h.sweeps = 0), Field::Sweeps),
        (with_head(&|h| h.omega = 2.0), Field::Omega),
        (with_head(&|h| h.omega = f64::NAN), Field::Omega),
        (with_head(&|h| h.control.delay = 4), Field::DelayFrames),
        (with_head(&|h| h.saturation = 4096), Field::Saturation),
        (with_head(&|h| h.timing.width_ns = h.timing.period_ns), Field::GateEnd),
        (with_entry(&|e| e.gains.keep = -8192), Field::ControlGain),
        (with_entry(&|e| e.gains.take = 0), Field::LeverArm),
        (with_entry(&|e| e.slope.reference_q16[1] = (1 << 21) + 1), Field::ReferenceSlope),
        (with_entry(&|e| e.slope.flux_min = e.slope.flux_max + 1), Field::FluxMin),
        (with_entry(&|e| e.segment.lowest[2] = 1), Field::HeightLimits),
        // The whole range above the flat map, and as much again: codes beyond the DAC's.
        (with_entry(&|e| e.segment.highest[0] = 1 << 26), Field::Response),
        // A value that 31 bits hold, and the highest code does not.
        (
            with_entry(&|e| (e.responses[0].offset, e.responses[0].slope) = (i32::MAX, 0)),
            Field::Response,
        ),
        (Adjustment::Floors { first: 60, values: [4095, 4096].into_iter().collect() }, Field::Dark),
    ];
    for (adjustment, expected) in values {
        match banks.draft.adjust(&adjustment) {
            Err(BankError::Adjust(AdjustError::Value(error))) => {
                assert_eq!(error.field, expected, "{adjustment:?}");
            }
            other => panic!("{adjustment:?}: {other:?}"),
        }
        assert!(banks.draft.whole().map(image).is_some_and(|now| now == before));
    }
    let pixels = (instrument.count() * 64) as u32;
    let one = |first| Adjustment::Thresholds { first, values: [1, 2].into_iter().collect() };
    let refused = [
        (with_head(&|h| h.width += 1), AdjustError::Geometry),
        (with_head(&|h| h.bits -= 1), AdjustError::Geometry),
        (
            Adjustment::Subaperture { index: 52, entry },
            AdjustError::Place { found: 52, entries: 52 },
        ),
        (one(pixels - 1), AdjustError::Place { found: pixels, entries: pixels }),
        (one(u32::MAX), AdjustError::Place { found: u32::MAX, entries: pixels }),
    ];
    for (adjustment, expected) in refused {
        match banks.draft.adjust(&adjustment) {
            Err(BankError::Adjust(error)) if expected == error => {}
            other => panic!("{adjustment:?}: {other:?}"),
        }
        assert!(banks.draft.whole().map(image).is_some_and(|now| now == before));
    }
}

/// What only shows in the whole is refused by the check, and can be mended.
#[test]
fn a_draft_is_checked_as_a_whole() {
    let instrument = Instrument::circle(4, 4);
    let (mut running, mut other): (Box<Bank>, Box<Bank>) =
        (instrument.config(), instrument.config());
    let mut banks = Banks::new(&mut running, &mut other);
    let Ok(Adjustment::Head(head)) = banks.running().value(Parameter::Head) else {
        panic!("not what was asked for");
    };
    let mut brightest = head;
    brightest.estimator = EstimatorConfig::Brightest { n: 5, bits: 12 };
    banks.draft.adjust(&Adjustment::Head(brightest)).expect("good by itself");
    match banks.draft.check() {
        Err(BankError::Adjust(AdjustError::Value(error))) => {
            assert_eq!(error.field, Field::BrightestBuffer, "this board has no buffer");
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(banks.draft.switch(), Err(BankError::NotChecked));
    banks.draft.adjust(&Adjustment::Head(head)).expect("as it was");
    assert_eq!(banks.draft.check(), Ok(banks.hash()));
}

#[test]
fn a_read_back_in_pieces_is_the_image() {
    let config = big(&Instrument::circle(8, 8));
    let bytes = image(&config);
    assert_eq!(config.image_bytes(), bytes.len());
    assert_eq!(config.hash().to_le_bytes(), bytes[bytes.len() - 4..]);
    for size in [1, 7, 256, 4096] {
        for offset in (0..bytes.len() + 2 * size).step_by(bytes.len() / 13) {
            let mut buffer = vec![0; size];
            let expected = bytes.iter().skip(offset).take(size).copied().collect::<Vec<_>>();
            assert_eq!(config.excerpt(offset, &mut buffer), expected, "{size} from {offset}");
        }
    }
    assert_eq!((Bank::new().hash(), Bank::new().image_bytes()), (0, 0));
}

/// What a line does to the chunks of an upload.
#[derive(Clone, Debug)]
enum Harm {
    Flip(usize, u8),
    Drop(usize),
    Repeat(usize),
    Cut(usize),
    None,
}

fn any_harm() -> impl Strategy<Value = Harm> {
    prop_oneof![
        (any::<usize>(), 1u8..).prop_map(|(at, bits)| Harm::Flip(at, bits)),
        any::<usize>().prop_map(Harm::Drop),
        any::<usize>().prop_map(Harm::Repeat),
        any::<usize>().prop_map(Harm::Cut),
        Just(Harm::None),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, rng_seed: RngSeed::Fixed(72), ..ProptestConfig::default() })]

    /// An upload in chunks of any size, harmed in any way, either is the image or is refused; what
    /// runs is not touched, and a whole upload still succeeds behind it.
    #[test]
    fn an_upload_is_whole_or_nothing(size in 1usize..700, harm in any_harm()) {
        let library = Library::new();
        let (first, second) = (Known { mask: 0, changed: true }, Known { mask: 1, changed: false });
        let (mut a, mut b) = (Box::new(Bank::new()), Box::new(Bank::new()));
        let mut banks = Banks::new(&mut a, &mut b);
        let upload = |banks: &mut Banks<'_, 16, 256, 0>, known: Known, harm: &Harm| {
            let bytes = library.image(Some(known));
            let mut chunks: Vec<(u32, Vec<u8>)> = bytes
                .chunks(size)
                .enumerate()
                .map(|(i, chunk)| ((i * size) as u32, chunk.to_vec()))
                .collect();
            let count = chunks.len();
            match *harm {
                Harm::Flip(at, bits) => {
                    let chunk = &mut chunks[at % count].1;
                    let place = at / count % chunk.len();
                    chunk[place] ^= bits;
                }
                Harm::Drop(at) => { chunks.remove(at % count); }
                Harm::Repeat(at) => {
                    let again = chunks[at % count].clone();
                    chunks.insert(at % count, again);
                }
                Harm::Cut(at) => { chunks[at % count].1.pop(); }
                Harm::None => {}
            }
            banks.draft.begin(bytes.len() as u32)?;
            // A sender that hears of nothing goes on to the end.
            let mut first = Ok(());
            for (offset, bytes) in &chunks {
                first = first.and(banks.draft.chunk(*offset, bytes).map(|_| ()));
            }
            first
        };
        let sent: Result<(), BankError> = upload(&mut banks, first, &Harm::None);
        sent.expect("unharmed");
        banks.draft.switch().expect("checked");
        banks.frame_boundary(|_, _| Ok(())).expect("ordered").expect("admitted");

        let harmed = upload(&mut banks, second, &harm);
        prop_assert!(image(banks.running()) == library.image(Some(first)));
        // A chunk that comes twice is refused the second time, and harms nothing.
        let whole = matches!(harm, Harm::None | Harm::Repeat(_));
        prop_assert_eq!(
            matches!(banks.draft.state(), DraftState::Checked { .. }), whole, "{:?}", harmed
        );
        prop_assert!(whole || banks.draft.switch().is_err());
        if let Harm::Flip(..) = harm {
            let found = matches!(harmed, Err(BankError::Image(_) | BankError::Length { .. }));
            prop_assert!(found, "{:?}", harmed);
        }

        upload(&mut banks, second, &Harm::None).expect("unharmed");
        banks.draft.switch().expect("checked");
        banks.frame_boundary(|_, _| Ok(())).expect("ordered").expect("admitted");
        prop_assert!(image(banks.running()) == library.image(Some(second)));
    }
}

#[test]
fn an_announced_length_is_kept_to() {
    let library = Library::new();
    let known = Known { mask: 0, changed: false };
    let bytes = library.image(Some(known));
    let length = bytes.len() as u32;
    let upload = |said: u32| {
        let (mut a, mut b) = (Box::new(Bank::new()), Box::new(Bank::new()));
        let mut banks = Banks::new(&mut a, &mut b);
        banks.draft.begin(said).and_then(|()| banks.draft.chunk(0, bytes))
    };
    assert_eq!(upload(length), Ok(length));
    assert_eq!(upload(length - 1), Err(BankError::Length { found: length, length: length - 1 }));
    assert_eq!(upload(length + 1), Err(BankError::Length { found: length, length: length + 1 }));
    let (mut a, mut b) = (Box::new(Bank::new()), Box::new(Bank::new()));
    let mut banks = Banks::new(&mut a, &mut b);
    banks.draft.begin(100).expect("empty");
    let cut = banks.draft.chunk(0, &bytes[..100]);
    assert_eq!(cut, Err(BankError::Image(ImageError::Cut)));
}
