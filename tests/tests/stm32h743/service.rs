//! The link's service, with the board's interrupts behind it.

use crate::flash::Cells;
use crate::rig::{
    Bank, FRAME_CYCLES, M, Main, P, PULSES, Rig, bank, bank_of, detector_frames, instrument,
};
use splash_firmware::banks::DraftState;
use splash_firmware::config::Config;
use splash_firmware::controller::Command;
use splash_firmware::error::Field;
use splash_firmware::link::{
    Message, PIECE, Reason, Receiver, Request, Response, Stack, WIRE, encode,
};
use splash_firmware::mode::{Mode, Refusal};
use splash_firmware::pipeline::{GlobalTilt, Hold, Outcome, RowError};
use splash_firmware::telemetry::{Decimation, Record, STREAMS};
use splash_server::Link;
use stm32h743_logic::flash::Flash;
use stm32h743_logic::service::{Board, Service};

/// Cycles of a wait: it lets a frame's time pass.
const WAIT_CYCLES: u32 = FRAME_CYCLES;

/// A board whose main loop has a list of requests, and a detector that runs while it waits.
struct Desk {
    rig: Rig,
    requests: Vec<u8>,
    received: usize,
    answers: Vec<u8>,
    /// What the detector gives, and how often it has.
    pixels: Option<Vec<u16>>,
    frames: u32,
    flash: Cells,
    ulp_m: f64,
    waits: u32,
    /// Rounds without a request at the end.
    idle: u32,
}

struct End;

impl Link for Desk {
    type Error = End;

    fn receive(&mut self, bytes: &mut [u8]) -> Result<(), End> {
        let end = self.received + bytes.len();
        bytes.copy_from_slice(self.requests.get(self.received..end).ok_or(End)?);
        self.received = end;
        Ok(())
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), End> {
        self.answers.extend(bytes);
        Ok(())
    }
}

impl Board for Desk {
    type Flash<'a> = Flash<&'a mut Cells>;

    fn next(&mut self) -> Result<Option<u8>, End> {
        if self.received == self.requests.len() {
            self.idle += 1;
            return if self.idle < 50 { Ok(None) } else { Err(End) };
        }
        let mut byte = [0];
        self.receive(&mut byte)?;
        Ok(Some(byte[0]))
    }

    fn begin_wait(&mut self) {
        self.waits = 0;
    }

    fn wait(&mut self) -> bool {
        self.waits += 1;
        // While requests come byte by byte no time passes.
        if self.received < self.requests.len() && self.waits > 5 {
            self.rig.run();
            return false;
        }
        if let Some(pixels) = &self.pixels {
            self.rig.time.set(self.rig.time.get().wrapping_add(WAIT_CYCLES));
            self.rig.frame(PULSES * self.frames, pixels);
            self.frames += 1;
        } else {
            self.rig.pass(WAIT_CYCLES);
        }
        self.waits < 5
    }

    fn stack(&self) -> Stack {
        Stack { used: 1000, reserved: 4000 }
    }

    fn flash(&mut self) -> Flash<&mut Cells> {
        Flash::new(&mut self.flash)
    }

    fn configured(&mut self, ulp_m: f64) {
        self.ulp_m = ulp_m;
    }
}

fn bytes_of(config: &Bank) -> Vec<u8> {
    let mut bytes = Vec::new();
    config.save(&mut |piece| bytes.extend(piece));
    bytes
}

/// `Load` with its pieces.
fn load(config: &Bank) -> Vec<Request> {
    let bytes = bytes_of(config);
    let pieces = bytes.chunks(PIECE).enumerate().map(|(i, piece)| Request::Piece {
        offset: (i * PIECE) as u32,
        bytes: piece.try_into().expect("a piece"),
    });
    std::iter::once(Request::Load { bytes: bytes.len() as u32 }).chain(pieces).collect()
}

/// `Upload` with its chunks.
fn upload(config: &Bank) -> Vec<Request> {
    let bytes = bytes_of(config);
    let chunks = bytes.chunks(PIECE).enumerate().map(|(i, chunk)| Request::Chunk {
        offset: (i * PIECE) as u32,
        bytes: chunk.try_into().expect("a chunk"),
    });
    std::iter::once(Request::Upload { bytes: bytes.len() as u32 }).chain(chunks).collect()
}

/// What a board with this detector and flash answers to these requests: by request.
fn serve(
    pixels: Option<&[u16]>,
    flash: Cells,
    requests: &[Request],
) -> (Desk, Vec<Vec<Response>>, Vec<Response>) {
    let (rig, main) = Rig::new();
    let mut wires = Vec::new();
    for (sequence, body) in (1..).zip(requests) {
        let message = Message { sequence, body: body.clone() };
        wires.extend(encode(&message, &mut [0; WIRE]).expect("short"));
    }
    let mut desk = Desk {
        rig,
        requests: wires,
        received: 0,
        answers: Vec::new(),
        pixels: pixels.map(<[u16]>::to_vec),
        frames: 0,
        flash,
        ulp_m: 0.0,
        waits: 0,
        idle: 0,
    };
    let other: &'static mut Bank = Box::leak(Box::new(Config::new()));
    let Main { asking, telemetry, running } = main;
    let mut service = Service::<M, P, 0>::new("stm32h743", asking, telemetry, running, other);
    let _ = service.restore(&mut desk);
    let End = service.run(&mut desk);
    let mut receiver = Receiver::new();
    let answers = desk.answers.iter().filter_map(|&byte| receiver.push(byte));
    let answers: Vec<Message<Response>> = answers.collect::<Result<_, _>>().expect("answers");
    let of = |sequence: u16| {
        let mine = answers.iter().filter(|answer| answer.sequence == sequence);
        mine.map(|answer| answer.body.clone()).collect::<Vec<_>>()
    };
    let by_request = (1..=requests.len() as u16).map(of).collect();
    let unasked = of(0);
    (desk, by_request, unasked)
}

#[test]
fn a_board_says_what_it_is() {
    let (_, answers, _) = serve(None, Cells::new(), &[Request::Identify, Request::Stack]);
    let [Response::Identity(identity)] = &answers[0][..] else { panic!("{answers:?}") };
    assert_eq!((identity.board.as_str(), identity.cells, identity.pixels), ("stm32h743", 64, 4096));
    assert_eq!(answers[1], [Response::Stack(Stack { used: 1000, reserved: 4000 })]);
}

#[test]
fn an_instrument_is_loaded_and_its_frames_told() {
    let mut requests = load(bank());
    requests.push(Request::Reset);
    requests.push(Request::GlobalTilt(GlobalTilt::default()));
    requests.push(Request::Frame { number: 0, pixels: 4096 });
    requests.push(Request::MeasuredFrame { number: 1, count: 0 });
    let (desk, answers, _) = serve(Some(&detector_frames(1)[0]), Cells::new(), &requests);
    assert!((desk.ulp_m - bank().ulp_m()).abs() < 1e-20);
    assert_eq!(answers[0], [Response::Ready], "the image");
    let [reset, tilt, frame, measured] = answers.last_chunk().expect("four");
    // 52 codes in pieces of 16, totals.
    assert!(reset.len() == 4 + 1 + 1 && reset.last() == Some(&Response::Ready));
    assert_eq!(tilt[..], [Response::Ready]);
    assert_eq!(frame.len(), 4 * 4 + 2);
    let Some(Response::Report(report)) = frame.last() else { panic!("{frame:?}") };
    assert_eq!(report.valid, 52);
    let codes = frame.iter().filter_map(|answer| match answer {
        Response::Codes { items, .. } => Some(items.to_vec()),
        _ => None,
    });
    let told: Vec<_> = codes.flatten().collect();
    assert!(desk.rig.dacs.sent.borrow().contains(&told), "what was told is what went out");
    assert_eq!(measured[..], [Response::Refused(Reason::Row(RowError::NotBegun))]);
}

/// Raw pixels, as a calibration over the link asks for them.
#[test]
fn a_row_of_the_next_frame_is_told_as_it_came() {
    let (row, first) = (37u16, 9u16);
    let width = usize::from(instrument().detector.width);
    let height = instrument().detector.height;
    let mut requests = load(bank());
    requests.push(Request::Pixels { row, first });
    requests.push(Request::Pixels { row: height, first });
    requests.push(Request::Pixels { row, first: width as u16 });
    let pixels = &detector_frames(1)[0];
    let (_, answers, _) = serve(Some(pixels), Cells::new(), &requests);
    let [told, beyond, beside] = answers.last_chunk().expect("three");
    let [Response::Pixels { bytes, .. }] = &told[..] else { panic!("{told:?}") };
    let start = usize::from(row) * width + usize::from(first);
    let expected = &pixels[start..start + (width - usize::from(first)).min(128)];
    assert!(bytes.iter().copied().eq(expected.iter().flat_map(|pixel| pixel.to_le_bytes())));
    let place = |found: u16, entries: u16| {
        Response::Refused(Reason::Place { found: found.into(), entries: entries.into() })
    };
    assert_eq!(beyond[..], [place(height, height)]);
    assert_eq!(beside[..], [place(width as u16, width as u16)]);
}

#[test]
fn without_frames_one_that_is_asked_for_is_told_as_missing() {
    let mut requests = load(bank());
    requests.push(Request::Frame { number: 0, pixels: 4096 });
    let (_, answers, _) = serve(None, Cells::new(), &requests);
    let last = answers.last().expect("answers").last();
    let Some(Response::Report(report)) = last else { panic!("{last:?}") };
    assert!(matches!(report.outcome, Outcome::Held(Hold::CutShort { rows: 0 })), "{report:?}");
}

/// Neither a damaged image nor one that this board cannot do changes anything.
#[test]
fn an_image_that_is_refused_leaves_the_running_one() {
    let mut sixteen_bits = instrument();
    sixteen_bits.detector.bits = 16;
    let mut odd = instrument();
    odd.detector.width += 1;
    let mut damaged = load(bank());
    let Some(Request::Piece { bytes, .. }) = damaged.last_mut() else { panic!("a piece") };
    bytes[0] ^= 1;
    let images = [
        (load(bank_of(&sixteen_bits)), Some(Field::DetectorBits)),
        (load(bank_of(&odd)), Some(Field::DetectorWidth)),
        (damaged, None),
    ];
    for (bad, expected) in images {
        let mut requests = load(bank());
        let good = requests.len();
        requests.extend(bad);
        requests.push(Request::Status);
        let (_, answers, _) = serve(None, Cells::new(), &requests);
        let [Response::Refused(reason)] = &answers[good][..] else { panic!("{:?}", answers[good]) };
        match expected {
            Some(field) => assert!(
                matches!(reason, Reason::Value { field: found, .. } if *found == field),
                "{reason:?}"
            ),
            None => assert_eq!(*reason, Reason::ImageDamaged),
        }
        let Some([Response::Status(status)]) = answers.last().map(Vec::as_slice) else {
            panic!("{answers:?}")
        };
        assert_eq!(status.configuration, bank().hash());
    }
}

#[test]
fn an_upload_runs_from_the_switch_on_and_is_what_is_read_back() {
    let requests = [
        upload(bank()),
        vec![
            Request::Check,
            Request::Switch,
            Request::Status,
            Request::ReadBack { offset: 0, bytes: u32::MAX },
            Request::Copy,
            Request::Discard,
            Request::Switch,
        ],
    ]
    .concat();
    let (_, answers, _) = serve(Some(&detector_frames(1)[0]), Cells::new(), &requests);
    let hash = bank().hash();
    let [check, switch, status, image, copy, discard, again] = answers.last_chunk().expect("7");
    assert_eq!(check[..], [Response::Draft(DraftState::Checked { hash })]);
    assert_eq!(switch[..], [Response::Draft(DraftState::Ordered { hash })]);
    let [Response::Status(status)] = &status[..] else { panic!("{status:?}") };
    assert_eq!((status.configuration, status.draft_refused), (hash, None));
    assert_eq!((status.mode, status.draft), (Mode::Safe, DraftState::Empty));
    assert_eq!(image.last(), Some(&Response::Ready));
    let pieces = image.iter().filter_map(|answer| match answer {
        Response::Image { bytes, .. } => Some(bytes.to_vec()),
        _ => None,
    });
    assert!(pieces.flatten().eq(bytes_of(bank())), "what runs");
    assert_eq!(copy[..], [Response::Draft(DraftState::Open)]);
    assert_eq!(discard[..], [Response::Draft(DraftState::Empty)]);
    assert_eq!(again[..], [Response::Refused(Reason::Empty)]);
}

#[test]
fn commands_counters_and_histories_are_the_controllers() {
    let enter = |mode| Request::Command(Command::Enter(mode));
    let requests = [
        load(bank()),
        vec![
            enter(Mode::ClosedLoop),
            Request::Command(Command::Arm),
            enter(Mode::Standby),
            Request::Transitions,
            Request::Faults,
            Request::Counters,
            Request::Calibration,
            Request::Store,
        ],
    ]
    .concat();
    let (desk, answers, _) = serve(None, Cells::new(), &requests);
    let [closed, arm, standby, transitions, _, counters, calibration, store] =
        answers.last_chunk().expect("8");
    let no_way = Refusal::NoWay { from: Mode::Safe, to: Mode::ClosedLoop };
    assert_eq!(closed[..], [Response::Refused(Reason::Mode(no_way))]);
    assert_eq!((&arm[..], &standby[..]), (&[Response::Ready][..], &[Response::Ready][..]));
    let [Response::Transitions { first: 0, items }, Response::Ready] = &transitions[..] else {
        panic!("{transitions:?}")
    };
    assert_eq!((items[0].from, items[0].to), (Mode::Safe, Mode::Standby));
    let [Response::Counters(counters)] = &counters[..] else { panic!("{counters:?}") };
    assert_eq!((counters.refused_transitions, counters.unreadable_messages), (1, 0));
    assert!(matches!(calibration[..], [Response::Refused(Reason::Uncalibrated(_))]));
    assert!(matches!(store[..], [Response::Stored(Some(_))]), "in standby");
    assert!(desk.rig.hardware.outputs.high_voltage);
}

/// And runs from the next start on.
#[test]
fn what_runs_is_stored_in_safe_and_standby_and_not_elsewhere() {
    let enter = |mode| Request::Command(Command::Enter(mode));
    let requests = [
        load(bank()),
        vec![
            Request::Stored,
            Request::Store,
            Request::Command(Command::Arm),
            enter(Mode::Standby),
            enter(Mode::TestPattern),
            Request::Store,
        ],
    ]
    .concat();
    let (desk, answers, _) = serve(None, Cells::new(), &requests);
    let [nothing, stored, .., refused] = answers.last_chunk::<6>().expect("6");
    assert_eq!(nothing[..], [Response::Stored(None)]);
    let [Response::Stored(Some(stored))] = &stored[..] else { panic!("{stored:?}") };
    assert_eq!(stored.hash, bank().hash());
    let wrong = Refusal::WrongMode { mode: Mode::TestPattern };
    assert_eq!(refused[..], [Response::Refused(Reason::Mode(wrong))]);
    let (_, answers, _) = serve(None, desk.flash, &[Request::Status, Request::Restore]);
    let [Response::Status(status)] = &answers[0][..] else { panic!("{answers:?}") };
    assert_eq!((status.configuration, status.mode), (bank().hash(), Mode::Safe));
    let hash = bank().hash();
    assert_eq!(answers[1], [Response::Draft(DraftState::Checked { hash })]);
}

#[test]
fn telemetry_that_was_subscribed_to_comes_unasked() {
    let decimation = Decimation { frames: 1, ..Decimation::OFF };
    let requests =
        [load(bank()), vec![Request::Subscribe(None), Request::Subscribe(Some(decimation))]]
            .concat();
    let (_, answers, telemetry) = serve(Some(&detector_frames(1)[0]), Cells::new(), &requests);
    let [usual, wanted] = answers.last_chunk().expect("two");
    // 921 600 baud are 92 160 bytes a second, of which the frames' records get a tenth; a record has
    // 240 bytes: 26.04 frames of a millisecond.
    let [Response::Streams { decimation: usual, .. }] = &usual[..] else { panic!("{usual:?}") };
    assert_eq!(usual.frames, 27);
    assert_eq!(wanted[..], [Response::Streams { decimation, dropped: [0; STREAMS] }]);
    assert!(telemetry.len() > 5, "{}", telemetry.len());
    assert!(telemetry.iter().all(|r| matches!(r, Response::Telemetry(Record::Frame(_)))));
}
