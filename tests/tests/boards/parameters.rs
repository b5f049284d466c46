//! The server in memory, asked about configurations, telemetry and what it stores.

use super::server::{Script, image};
use super::{frames, usual};
use splash_firmware::adjust::{Adjustment, Parameter};
use splash_firmware::banks::DraftState;
use splash_firmware::calibration::Uncalibrated;
use splash_firmware::config::Config;
use splash_firmware::link::{PIECE, Reason, Request, Response};
use splash_firmware::pipeline::{Outcome, Pipeline};
use splash_firmware::telemetry::{Decimation, Record, STREAMS};
use splash_tests::instrument::{Instrument, Values};

fn hash(image: &[u8]) -> u32 {
    image.last_chunk().map_or(0, |&bytes| u32::from_le_bytes(bytes))
}

/// The usual instrument with g = 1/4, f = 1 in subaperture 7.
fn gentler() -> Instrument {
    let mut instrument = usual();
    let mut gains = vec![0.5; instrument.count()];
    gains[7] = 0.25;
    instrument.control_gain = Values::Each(gains);
    instrument
}

fn upload(script: &mut Script, image: &[u8]) {
    script.ask(Request::Upload { bytes: image.len() as u32 });
    for (i, piece) in image.chunks(PIECE).enumerate() {
        let offset = (i * PIECE) as u32;
        script.ask(Request::Chunk { offset, bytes: piece.iter().copied().collect() });
    }
}

/// The adjustment that makes the usual instrument the gentler one.
fn adjustment() -> Adjustment {
    let config = usual().config::<256, 16_384, 0>();
    match config.value(Parameter::Subaperture { index: 7 }) {
        Ok(Adjustment::Subaperture { index, mut entry }) => {
            (entry.gains.keep, entry.gains.take) = (6144, 2048);
            Adjustment::Subaperture { index, entry }
        }
        other => panic!("{other:?}"),
    }
}

/// The bytes that a read-back has brought.
fn read_back(responses: &[Response]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for response in responses {
        if let Response::Image { offset, bytes: piece } = response {
            assert_eq!(*offset as usize, bytes.len());
            bytes.extend_from_slice(piece);
        }
    }
    bytes
}

const WHOLE: Request = Request::ReadBack { offset: 0, bytes: u32::MAX };

#[test]
fn an_upload_runs_from_the_frame_behind_its_switch() {
    let (first, second) = (image(&usual()), image(&gentler()));
    let pixels = frames(&usual(), 4);
    let mut script = Script::default();
    script.load(&first).ask(Request::Reset).frame(0, &pixels[0]);
    upload(&mut script, &second);
    script.frame(1, &pixels[1]).ask(Request::Switch).ask(WHOLE).frame(2, &pixels[2]);
    script.ask(WHOLE).frame(3, &pixels[3]);
    let (responses, actuated, _) = script.run();

    // The same by the library: the first configuration for two frames, the second one for two.
    let configs = [usual(), gentler()].map(|instrument| instrument.config::<64, 4096, 0>());
    let mut pipeline = Box::new(Pipeline::<64, 0>::new());
    pipeline.reset(&configs[0]);
    for (number, pixels) in pixels.iter().enumerate() {
        let config = &configs[number / 2];
        pipeline.begin(config, number as u32);
        for row in pixels.chunks(usize::from(config.width())) {
            pipeline.push_row(config, row).expect("a row");
        }
        assert_eq!(pipeline.finish(config).outcome, Outcome::Updated);
        // The reset comes first.
        assert_eq!(actuated[number + 1], pipeline.codes(), "frame {number}");
    }
    let checked = Response::Draft(DraftState::Checked { hash: hash(&second) });
    assert!(responses.contains(&checked));
    let switch = Response::Draft(DraftState::Ordered { hash: hash(&second) });
    let at = responses.iter().position(|response| *response == switch).expect("ordered");
    let before = responses[at..].iter().position(|r| *r == Response::Ready).expect("its end") + at;
    assert!(read_back(&responses[at..before]) == first, "until the frame's boundary");
    assert!(read_back(&responses[before..]) == second);
}

#[test]
fn an_adjusted_copy_runs_and_is_read_back_in_any_piece() {
    let (first, second) = (image(&usual()), image(&gentler()));
    let pixels = frames(&usual(), 1);
    let mut script = Script::default();
    script.ask(Request::Copy).load(&first).ask(Request::Copy);
    script.ask(Request::Adjust(adjustment())).ask(Request::Switch).ask(Request::Check);
    script.ask(Request::Switch).frame(0, &pixels[0]).ask(Request::Status);
    script.ask(Request::Get(Parameter::Subaperture { index: 7 }));
    script.ask(Request::ReadBack { offset: 1000, bytes: 600 });
    let (responses, ..) = script.run();
    let begin = [
        Response::Refused(Reason::Empty),
        Response::Ready,
        Response::Draft(DraftState::Open),
        Response::Draft(DraftState::Open),
        Response::Refused(Reason::NotChecked),
        Response::Draft(DraftState::Checked { hash: hash(&second) }),
        Response::Draft(DraftState::Ordered { hash: hash(&second) }),
    ];
    assert_eq!(responses[..begin.len()], begin);
    let status = responses.iter().find_map(|response| match response {
        Response::Status(status) => Some(*status),
        _ => None,
    });
    let status = status.expect("it was asked for");
    assert_eq!((status.configuration, status.draft), (hash(&second), DraftState::Open));
    assert!(responses.contains(&Response::Value(adjustment())));
    let mut pieces = Vec::new();
    for response in &responses {
        if let Response::Image { offset, bytes } = response {
            assert_eq!(*offset as usize, 1000 + pieces.len());
            pieces.extend_from_slice(bytes);
        }
    }
    assert!(pieces == second[1000..1600]);
}

#[test]
fn a_broken_upload_leaves_what_runs() {
    let (first, second) = (image(&usual()), image(&gentler()));
    let mut damaged = second.clone();
    damaged[second.len() / 2] ^= 4;
    let mut script = Script::default();
    script.load(&first);
    upload(&mut script, &damaged);
    script.ask(Request::Switch).ask(WHOLE);
    let pixels = frames(&usual(), 1);
    script.frame(0, &pixels[0]).ask(WHOLE);
    let (responses, ..) = script.run();
    assert!(responses.contains(&Response::Refused(Reason::ImageDamaged)));
    assert!(responses.contains(&Response::Refused(Reason::Empty)), "nothing to switch to");
    let found: Vec<_> = responses.split(|response| *response == Response::Ready).collect();
    // Behind loading, the first read-back, and the frame with the second.
    assert!(read_back(found[1]) == first);
    assert!(read_back(found[2]) == first);
}

#[test]
fn what_is_stored_comes_back_through_the_other_bank() {
    let (first, second) = (image(&usual()), image(&gentler()));
    let pixels = frames(&usual(), 1);
    let mut script = Script::default();
    script.ask(Request::Store).ask(Request::Restore).load(&first).ask(Request::Store);
    script.load(&second).ask(Request::Stored).ask(Request::Restore).ask(Request::Switch);
    script.frame(0, &pixels[0]).ask(WHOLE);
    let (responses, ..) = script.run();
    assert_eq!(responses[0], Response::Refused(Reason::NotConfigured));
    assert_eq!(responses[1], Response::Refused(Reason::NothingStored));
    for (i, response) in [(3, &responses[3]), (5, &responses[5])] {
        match response {
            Response::Stored(Some(stored)) => assert_eq!(stored.hash, hash(&first), "{i}"),
            other => panic!("{i}: {other:?}"),
        }
    }
    assert_eq!(responses[6], Response::Draft(DraftState::Checked { hash: hash(&first) }));
    assert!(read_back(&responses) == first);
}

#[test]
fn telemetry_comes_unasked_behind_the_answers() {
    let instrument = usual();
    let first = image(&instrument);
    let pixels = frames(&instrument, 4);
    let decimation = Decimation { frames: 1, slopes: 2, ..Decimation::OFF };
    let mut script = Script::default();
    script.load(&first).frame(0, &pixels[0]).ask(Request::Subscribe(Some(decimation)));
    for (number, pixels) in pixels.iter().enumerate().skip(1) {
        script.frame(number as u32, pixels);
    }
    script.ask(Request::Streams);
    let (responses, ..) = script.run();
    let mut config = Box::new(Config::<64, 4096, 0>::new());
    config.build(&instrument.spec()).expect("an instrument");
    let records: Vec<&Record> = responses
        .iter()
        .filter_map(|response| match response {
            Response::Telemetry(record) => Some(record),
            _ => None,
        })
        .collect();
    let told: Vec<(u32, u32)> = records
        .iter()
        .filter_map(|record| match record {
            Record::Frame(frame) => Some((frame.result.report.frame, frame.configuration)),
            _ => None,
        })
        .collect();
    assert_eq!(told, [1, 2, 3].map(|frame| (frame, hash(&first))));
    // 52 slopes in pieces of 16, of frame 2 only.
    assert_eq!(records.len(), 3 + 4);
    assert_eq!(responses.last(), Some(&Response::Streams { decimation, dropped: [0; STREAMS] }));
}

#[test]
fn what_a_board_lacks_is_named() {
    let mut script = Script::default();
    script.ask(Request::Calibration).ask(Request::Get(Parameter::Head));
    script.load(&image(&usual())).ask(Request::Calibration);
    script.ask(Request::Get(Parameter::Subaperture { index: 52 }));
    let (responses, ..) = script.run();
    let expected = [
        Response::Refused(Reason::Uncalibrated(Uncalibrated::NotConfigured)),
        Response::Refused(Reason::NotConfigured),
        Response::Ready,
        Response::Refused(Reason::Uncalibrated(Uncalibrated::Never)),
        Response::Refused(Reason::Place { found: 52, entries: 52 }),
    ];
    assert_eq!(responses, expected);
}
