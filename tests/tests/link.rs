//! The link: what is sent is what arrives, and what is not a message harms no other.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use splash_firmware::adjust::{AdjustError, Adjustment, Parameter};
use splash_firmware::banks::{BankError, DraftState};
use splash_firmware::calibration::{Calibration, Step, Uncalibrated};
use splash_firmware::centroid::Measurement;
use splash_firmware::controller::{Command, FrameResult};
use splash_firmware::error::{ConfigError, Field, Limit};
use splash_firmware::fault::{Fault, KINDS, Moment, Record};
use splash_firmware::gate::{GateStamp, Range};
use splash_firmware::image::ImageError;
use splash_firmware::interlock::Outputs;
use splash_firmware::ladder::Rung;
use splash_firmware::link::{
    Counters, Identity, LinkError, List, MESSAGE, Message, Reason, Receiver, Request, Response,
    Stack, Status, VERSION, WIRE, encode,
};
use splash_firmware::mirror::Serials;
use splash_firmware::modal::MAX_MODES;
use splash_firmware::mode::{self, Mode, Refusal, Transition};
use splash_firmware::pipeline::{GlobalTilt, Hold, Outcome, Report, RowError, Totals};
use splash_firmware::segments::Position;
use splash_firmware::slopes::Slope;
use splash_firmware::store::{StoreError, Stored};
use splash_firmware::telemetry::{self, Cycles, Decimation, FrameRecord, STREAMS};
use splash_tests::instrument::Instrument;

fn wire<T: serde::Serialize>(sequence: u16, body: &T) -> Vec<u8> {
    let mut buffer = [0; WIRE];
    encode(&Message { sequence, body }, &mut buffer).expect("not too long").to_vec()
}

/// All that a receiver finds in these bytes.
fn found<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Vec<Result<Message<T>, LinkError>> {
    let mut receiver = Receiver::new();
    bytes.iter().filter_map(|&byte| receiver.push(byte)).collect()
}

fn list<T: Clone>(item: T) -> List<T> {
    std::iter::repeat_n(item, 16).collect()
}

/// Every request, with the values that take the most bytes.
fn requests() -> Vec<Request> {
    let widest = Measurement {
        centroid_q16: [i32::MIN; 2],
        flux: u32::MAX,
        peak: u16::MAX,
        saturated: u16::MAX,
    };
    let all = u32::MAX;
    let mut requests = vec![
        Request::Identify,
        Request::Load { bytes: u32::MAX },
        Request::Piece { offset: u32::MAX, bytes: std::iter::repeat_n(0, 256).collect() },
        Request::Piece { offset: 7, bytes: (1..=255).collect() },
        Request::Reset,
        Request::Frame { number: u32::MAX, pixels: u32::MAX },
        Request::Measurements { first: u16::MAX, items: list(widest) },
        Request::MeasuredFrame { number: u32::MAX, count: u32::MAX },
        Request::GlobalTilt(GlobalTilt { tilt_ulp: [i32::MIN, i32::MAX], frame: u32::MAX }),
        Request::Stack,
        Request::Status,
        Request::Upload { bytes: all },
        Request::Chunk { offset: all, bytes: std::iter::repeat_n(0, 256).collect() },
        Request::Copy,
        Request::Check,
        Request::Switch,
        Request::Discard,
        Request::ReadBack { offset: all, bytes: all },
        Request::Store,
        Request::Stored,
        Request::Restore,
        Request::Calibration,
        Request::Subscribe(None),
        Request::Subscribe(Some(DECIMATION)),
        Request::Streams,
        Request::Counters,
        Request::Faults,
        Request::Transitions,
        Request::Command(Command::Enter(Mode::TestPattern)),
        Request::Command(Command::Arm),
        Request::Command(Command::Disarm),
        Request::Command(Command::Position { subaperture: u16::MAX, position: POSITION }),
        Request::Command(Command::Heights { subaperture: u16::MAX, heights_ulp: [i32::MIN; 3] }),
        Request::Command(Command::Flat),
        Request::Command(Command::Gate(GATE.range)),
        Request::Command(Command::ClearFaults),
        Request::Command(Command::Hardware(Serials { mirror: u32::MAX, detector: u32::MAX })),
    ];
    requests.extend(adjustments().into_iter().map(Request::Adjust));
    requests.extend(PARAMETERS.map(Request::Get));
    requests
}

const POSITION: Position = Position { piston_ulp: i32::MIN, tilt_ulp: [i32::MIN; 2] };
const DECIMATION: Decimation = Decimation {
    frames: u32::MAX,
    slopes: u32::MAX,
    commands: u32::MAX,
    codes: u32::MAX,
    fluxes: u32::MAX,
};
const GATE: GateStamp = GateStamp {
    range: Range { altitude_mm: u32::MAX, depth_mm: u32::MAX, zenith_mdeg: u32::MAX },
    delay: u32::MAX,
    width: u32::MAX,
    asked: u32::MAX,
    seen: u32::MAX,
};
const FAULT: Fault = Fault::TotalFlux { flux: u64::MAX, limit: u64::MAX };
const NOW: Moment = Moment { frame: u32::MAX, ticks: u64::MAX };
const CALIBRATION: Calibration =
    Calibration { fingerprint: u32::MAX, steps: u8::MAX, quality_q16: u16::MAX };
const PARAMETERS: [Parameter; 10] = [
    Parameter::Head,
    Parameter::Subaperture { index: u16::MAX },
    Parameter::Template { phase: u8::MAX },
    Parameter::Floors { first: u32::MAX },
    Parameter::Losses { first: u32::MAX },
    Parameter::Thresholds { first: u32::MAX },
    Parameter::Calibration,
    Parameter::SecondGate { index: u16::MAX },
    Parameter::Gradients { index: u16::MAX },
    Parameter::Coupling { row: u8::MAX },
];

/// Those of a configuration, and lists as long as they get.
fn adjustments() -> Vec<Adjustment> {
    let config = Instrument::circle(8, 8).config::<64, 4096, 0>();
    let value = |parameter| config.value(parameter).expect("it has it");
    let mut adjustments = vec![
        value(Parameter::Head),
        value(Parameter::Subaperture { index: 51 }),
        Adjustment::Template { phase: 7, samples: [255; 66].into_iter().collect() },
        Adjustment::Floors { first: u32::MAX, values: [u16::MAX; 64].into_iter().collect() },
        Adjustment::Losses { first: u32::MAX, values: [u16::MAX; 64].into_iter().collect() },
        Adjustment::Thresholds { first: u32::MAX, values: [255; 64].into_iter().collect() },
        Adjustment::Calibration(None),
        Adjustment::Calibration(Some(CALIBRATION)),
        Adjustment::Gradients {
            index: u16::MAX,
            values: [[i16::MIN; 2]; MAX_MODES].into_iter().collect(),
        },
        // C is within +-64, Q12.
        Adjustment::Coupling {
            row: u8::MAX,
            values: [[-(64 << 12); 2]; MAX_MODES].into_iter().collect(),
        },
    ];
    if let Some(Adjustment::Subaperture { index, entry }) = adjustments.get_mut(1) {
        *index = u16::MAX;
        entry.segment.lowest = [i32::MIN; 3];
        entry.segment.highest = [i32::MIN; 3];
        entry.segment.ratios = [[i16::MIN; 2]; 3];
        entry.slope.reference_q16 = [i32::MIN; 2];
        entry.slope.gain = [[i16::MIN; 2]; 2];
        for response in &mut entry.responses {
            (response.offset, response.slope) = (i32::MIN, i32::MIN);
        }
    }
    adjustments
}

fn reasons() -> Vec<Reason> {
    let refused = |limit| ImageError::Refused(ConfigError::at(Field::Readout, 7, -1.5, limit));
    vec![
        ImageError::Cut.into(),
        ImageError::NotAnImage.into(),
        ImageError::Version { found: 9 }.into(),
        ImageError::Malformed.into(),
        ImageError::Checksum.into(),
        refused(Limit::Within(0.25, 4.0)).into(),
        refused(Limit::Rule("no")).into(),
        Reason::Row(RowError::Length { found: u32::MAX, expected: u16::MAX }),
        Reason::Row(RowError::Extra),
        Reason::Row(RowError::NotBegun),
        BankError::Empty.into(),
        BankError::Receiving { due: 1, length: u32::MAX }.into(),
        BankError::NotReceiving.into(),
        BankError::Offset { found: 2, due: u32::MAX }.into(),
        BankError::Length { found: u32::MAX, length: 3 }.into(),
        BankError::NotChecked.into(),
        BankError::Ordered.into(),
        AdjustError::NotConfigured.into(),
        AdjustError::Geometry.into(),
        AdjustError::Place { found: 4, entries: u32::MAX }.into(),
        StoreError::Flash(()).into(),
        StoreError::<()>::Long { found: 5, slot: u32::MAX }.into(),
        StoreError::<()>::Nothing.into(),
        Uncalibrated::NotConfigured.into(),
        Uncalibrated::Never.into(),
        Uncalibrated::Missing(Step::Pokes).into(),
        Uncalibrated::Changed { calibrated: 6, configured: u32::MAX }.into(),
        Refusal::NotFlat.into(),
        Refusal::HighVoltage.into(),
        Reason::Unsupported,
    ]
}

/// Every response, with the values that take the most bytes.
fn responses() -> Vec<Response> {
    let first = u16::MAX;
    let all = u32::MAX;
    let report = |outcome| Report {
        frame: all,
        outcome,
        valid: u16::MAX,
        saturated_pixels: all,
        residual_squared: u64::MAX,
        saturated_actuators: u16::MAX,
        slewed_actuators: u16::MAX,
        extra_rows: u16::MAX,
        restarted: true,
        global_tilt_age: Some(all),
        global_tilt_stale: true,
    };
    let mut responses = vec![
        Response::Identity(Identity {
            board: "sixteen-letters-".try_into().expect("16 bytes"),
            version: "100.100.100-beta".try_into().expect("16 bytes"),
            cells: all,
            pixels: all,
            buffered: all,
        }),
        Response::Ready,
        Response::Stack(Stack { used: all, reserved: all }),
        Response::Codes { first, items: list([u16::MAX; 3]) },
        Response::Codes { first: 0, items: List::new() },
        Response::Measurements { first, items: list(Measurement::default()) },
        Response::Slopes { first, items: list(Slope { tilt_ulp: [i32::MIN; 2], valid: true }) },
        Response::Positions {
            first,
            items: list(Position { piston_ulp: i32::MIN, tilt_ulp: [i32::MIN; 2] }),
        },
        Response::Totals(Totals {
            updated: all,
            cut_short: all,
            wrong_row: all,
            no_light: all,
            not_ready: all,
            restarted: all,
            extra_rows: all,
            stale_tilt: all,
            saturated_actuators: all,
            slewed_actuators: all,
        }),
        Response::Report(report(Outcome::Updated)),
    ];
    let draft = DraftState::Receiving { due: all, length: all };
    let serials = Serials { mirror: all, detector: all };
    responses.extend([
        Response::Status(Status {
            build: all,
            configuration: all,
            serials,
            draft,
            draft_refused: Some(Refusal::NoSubaperture {
                subaperture: u16::MAX,
                subapertures: u16::MAX,
            }),
            mode: Mode::TestPattern,
            outputs: Outputs { high_voltage: true, laser: true },
            at: NOW,
            ticks_per_second: all,
            gate: GATE,
            tilt_rms_nm: f32::MAX,
        }),
        Response::Draft(draft),
        Response::Image { offset: all, bytes: std::iter::repeat_n(0, 256).collect() },
        Response::Stored(None),
        Response::Stored(Some(Stored { sequence: all, hash: all, length: all, serials })),
        Response::Calibration(CALIBRATION),
        Response::Streams { decimation: DECIMATION, dropped: [all; STREAMS] },
        Response::Counters(Counters {
            faults: [all; KINDS],
            refused_transitions: all,
            unreadable_messages: all,
            ..Counters::default()
        }),
        Response::Faults {
            first,
            items: std::iter::repeat_n(Record { fault: FAULT, at: NOW }, 8).collect(),
        },
        Response::Transitions {
            first,
            items: std::iter::repeat_n(
                Transition {
                    from: Mode::Safe,
                    to: Mode::TestPattern,
                    reason: mode::Reason::Fault(FAULT),
                    at: NOW,
                },
                8,
            )
            .collect(),
        },
    ]);
    responses.extend(adjustments().into_iter().map(Response::Value));
    responses.extend(records(report(Outcome::Updated)).map(Response::Telemetry));
    let holds = [
        Hold::NotBegun,
        Hold::CutShort { rows: 9 },
        Hold::WrongRow,
        Hold::NoLight,
        Hold::NotConfigured,
    ];
    responses.extend(holds.map(|hold| Response::Report(report(Outcome::Held(hold)))));
    responses.extend(reasons().into_iter().map(Response::Refused));
    responses
}

/// Telemetry with the values that take the most bytes.
fn records(report: Report) -> [telemetry::Record; STREAMS] {
    let (frame, first) = (u32::MAX, u16::MAX);
    let widest = Measurement {
        centroid_q16: [i32::MIN; 2],
        flux: u32::MAX,
        peak: u16::MAX,
        saturated: u16::MAX,
    };
    [
        telemetry::Record::Frame(FrameRecord {
            result: FrameResult {
                report,
                mode: Mode::TestPattern,
                rung: Some(Rung::GiveUp(FAULT)),
                fault: Some(FAULT),
                gate: GATE,
                at: NOW,
            },
            configuration: u32::MAX,
            tilt_squared_ulp2: u64::MAX,
            cycles: Cycles { rows: u32::MAX, stages: [u32::MAX; 5], latency: u32::MAX },
        }),
        telemetry::Record::Slopes {
            frame,
            first,
            items: list(Slope { tilt_ulp: [i32::MIN; 2], valid: true }),
        },
        telemetry::Record::Commands { frame, first, items: list(POSITION) },
        telemetry::Record::Codes { frame, first, items: list([u16::MAX; 3]) },
        telemetry::Record::Fluxes { frame, first, items: list(widest) },
        telemetry::Record::Fault(Record { fault: FAULT, at: NOW }),
    ]
}

#[test]
fn every_message_arrives_as_it_was_sent() {
    for (i, body) in requests().into_iter().enumerate() {
        let sequence = i as u16 * 257;
        assert_eq!(found(&wire(sequence, &body)), [Ok(Message { sequence, body })]);
    }
    for (i, body) in responses().into_iter().enumerate() {
        let sequence = u16::MAX - i as u16;
        assert_eq!(found(&wire(sequence, &body)), [Ok(Message { sequence, body })]);
    }
}

#[test]
fn a_frame_is_what_the_format_says() {
    // COBS(version, sequence, Reset = variant 3, CRC) 0: no stuffing but for the high byte.
    let bytes = wire(0x00aa, &Request::Reset);
    let plain = [VERSION, 0xaa, 0x00, 3];
    // CRC-32 (ISO-HDLC) bit by bit: reflected polynomial, all ones before and after.
    let step = |crc: u32, _| (crc >> 1) ^ (0xedb8_8320 & 0u32.wrapping_sub(crc & 1));
    let add = |crc: u32, &byte: &u8| (0..8).fold(crc ^ u32::from(byte), step);
    let crc = (!plain.iter().fold(u32::MAX, add)).to_le_bytes();
    assert!(!crc.contains(&0), "choose another sequence for this test");
    let mut expected = vec![3, VERSION, 0xaa, 6, 3];
    expected.extend(crc);
    expected.push(0);
    assert_eq!(bytes, expected);
}

#[test]
fn no_message_is_too_long() {
    for bytes in requests().iter().map(|body| wire(1, body)) {
        assert!(bytes.len() <= WIRE);
    }
    for bytes in responses().iter().map(|body| wire(1, body)) {
        assert!(bytes.len() <= WIRE);
    }
    let longest = [0xffu8; MESSAGE - 2].as_slice();
    assert!(wire(1, &longest).len() <= WIRE);
    let longer = [0xffu8; MESSAGE - 1].as_slice();
    let mut buffer = [0; WIRE];
    let refused = encode(&Message { sequence: 1, body: longer }, &mut buffer);
    assert_eq!(refused, Err(LinkError::Long));
}

#[test]
fn what_is_no_message_is_named() {
    let named = |bytes: &[u8]| {
        let mut bytes = bytes.to_vec();
        bytes.extend(wire(5, &Request::Reset));
        let mut all = found::<Request>(&bytes);
        let last = all.pop();
        assert_eq!(last, Some(Ok(Message { sequence: 5, body: Request::Reset })));
        all.into_iter().map(|one| one.expect_err("no message")).collect::<Vec<_>>()
    };
    assert_eq!(named(&[]), []);
    assert_eq!(named(&[0, 0, 0]), [], "empty frames say nothing");
    assert_eq!(named(&[9, 1, 2, 0]), [LinkError::Broken], "cut short");
    assert_eq!(named(&[3, 1, 2, 0]), [LinkError::Broken], "shorter than a header");
    assert_eq!(named(&[[0x02; 2 * WIRE].as_slice(), &[0]].concat()), [LinkError::Long]);
    let mut damaged = wire(4, &Request::Load { bytes: 0x0101_0101 });
    damaged[5] ^= 2;
    assert_eq!(named(&damaged), [LinkError::Checksum]);
    assert_eq!(
        named(&reframed(&[VERSION + 1, 1, 1, 3])),
        [LinkError::Version { found: VERSION + 1 }]
    );
    assert_eq!(named(&reframed(&[VERSION, 1, 1, 200])), [LinkError::Unreadable], "no such request");
    assert_eq!(
        named(&reframed(&[VERSION, 1, 1, 3, 3])),
        [LinkError::Unreadable],
        "bytes behind it"
    );
}

/// A frame with a right checksum around these bytes, none of which is zero.
fn reframed(plain: &[u8]) -> Vec<u8> {
    let step = |crc: u32, _| (crc >> 1) ^ (0xedb8_8320 & 0u32.wrapping_sub(crc & 1));
    let add = |crc: u32, &byte: &u8| (0..8).fold(crc ^ u32::from(byte), step);
    let crc = (!plain.iter().fold(u32::MAX, add)).to_le_bytes();
    let frame = [plain, &crc].concat();
    // Runs between zeros, each behind its length.
    let stuffed = |run: &[u8]| [&[run.len() as u8 + 1], run].concat();
    let mut bytes: Vec<u8> = frame.split(|&byte| byte == 0).flat_map(stuffed).collect();
    bytes.push(0);
    bytes
}

#[test]
fn reasons_read_as_they_would_here() {
    let error = ConfigError::at(Field::WindowOrigin, 3, 120.0, Limit::Within(0.0, 112.0));
    let reason = Reason::from(ImageError::Refused(error));
    assert_eq!(reason.to_string(), error.to_string());
    let texts = reasons().iter().map(Reason::to_string).collect::<std::collections::BTreeSet<_>>();
    // An image of another version, and what is no image; two that are damaged.
    assert_eq!(texts.len(), reasons().len() - 2, "{texts:?}");
}

fn any_request() -> impl Strategy<Value = Request> {
    let measurement = (any::<[i32; 2]>(), any::<u32>(), any::<u16>(), any::<u16>()).prop_map(
        |(centroid_q16, flux, peak, saturated)| Measurement { centroid_q16, flux, peak, saturated },
    );
    prop_oneof![
        Just(Request::Identify),
        Just(Request::Reset),
        (any::<u32>(), any::<u32>()).prop_map(|(number, pixels)| Request::Frame { number, pixels }),
        (any::<u32>(), prop::collection::vec(any::<u8>(), 0..=256)).prop_map(|(offset, bytes)| {
            Request::Piece { offset, bytes: bytes.into_iter().collect() }
        }),
        (any::<u16>(), prop::collection::vec(measurement, 0..=16)).prop_map(|(first, items)| {
            Request::Measurements { first, items: items.into_iter().collect() }
        }),
    ]
}

/// Something that does to the bytes between two messages what a bad line does.
#[derive(Clone, Debug)]
enum Harm {
    Garbage(Vec<u8>),
    Cut(usize),
    Flip(usize, u8),
    Drop(usize),
}

fn any_harm() -> impl Strategy<Value = Harm> {
    prop_oneof![
        prop::collection::vec(any::<u8>(), 0..1500).prop_map(Harm::Garbage),
        any::<usize>().prop_map(Harm::Cut),
        (any::<usize>(), 1u8..).prop_map(|(at, bits)| Harm::Flip(at, bits)),
        any::<usize>().prop_map(Harm::Drop),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, rng_seed: RngSeed::Fixed(71), ..ProptestConfig::default() })]

    #[test]
    fn the_message_after_the_next_zero_arrives(
        harmed in any_request(),
        harm in any_harm(),
        good in any_request(),
        sequence in any::<u16>(),
    ) {
        let mut bytes = wire(sequence, &harmed);
        match harm {
            Harm::Garbage(garbage) => bytes = garbage,
            Harm::Cut(at) => bytes.truncate(at % bytes.len()),
            Harm::Flip(at, bits) => { let at = at % bytes.len(); bytes[at] ^= bits; }
            Harm::Drop(at) => { bytes.remove(at % bytes.len()); }
        }
        bytes.push(0);
        bytes.extend(wire(sequence, &good));
        let all = found::<Request>(&bytes);
        prop_assert_eq!(all.last(), Some(&Ok(Message { sequence, body: good })));
        // CRC-32 finds any error of up to 32 bits in a row; what is believed is what was sent.
        for believed in all.iter().rev().skip(1).flatten() {
            prop_assert_eq!(&believed.body, &harmed);
        }
    }
}
