//! The link's service, with the board's interrupts behind it.

use crate::rig::{Bank, M, P, PULSES, Rig, bank, detector_frames, instrument};
use splash_firmware::config::Config;
use splash_firmware::error::Field;
use splash_firmware::link::{
    Message, PIECE, Reason, Receiver, Request, Response, Stack, WIRE, encode,
};
use splash_firmware::pipeline::{GlobalTilt, RowError};
use splash_server::Link;
use splash_tests::instrument::Instrument;
use stm32h743_logic::gate::GateTicks;
use stm32h743_logic::service::{Board, Service};

/// A board whose main loop has a list of requests, and a detector that runs while it waits.
struct Desk {
    rig: Rig,
    requests: Vec<u8>,
    received: usize,
    answers: Vec<u8>,
    /// What the detector gives, and how often it has.
    pixels: Option<Vec<u16>>,
    frames: u32,
    gate: Option<GateTicks>,
    ulp_m: f64,
    armed: bool,
    log: Vec<&'static str>,
    waits: u32,
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
    fn begin_wait(&mut self) {
        self.waits = 0;
    }

    fn wait(&mut self) -> bool {
        self.waits += 1;
        self.rig.run();
        if let Some(pixels) = &self.pixels {
            self.rig.frame(PULSES * self.frames, pixels);
            self.frames += 1;
        }
        self.waits < 5
    }

    fn configured(&mut self, gate: GateTicks, ulp_m: f64) {
        (self.gate, self.ulp_m) = (Some(gate), ulp_m);
        self.log.push("configured");
    }

    fn arm(&mut self) {
        self.armed = true;
        self.log.push("arm");
    }

    fn disarm(&mut self) {
        self.armed = false;
        self.log.push("disarm");
    }

    fn stack(&self) -> Stack {
        Stack { used: 1000, reserved: 4000 }
    }
}

fn image(config: &Bank) -> Vec<Request> {
    let mut bytes = Vec::new();
    config.save(&mut |piece| bytes.extend(piece));
    let load = Request::Load { bytes: bytes.len() as u32 };
    let pieces = bytes.chunks(PIECE).enumerate().map(|(i, piece)| Request::Piece {
        offset: (i * PIECE) as u32,
        bytes: piece.try_into().expect("a piece"),
    });
    std::iter::once(load).chain(pieces).collect()
}

/// What a board with this detector answers to these requests.
fn serve(pixels: Option<&[u16]>, requests: &[Request]) -> (Desk, Vec<Message<Response>>) {
    let (rig, asking) = Rig::new();
    let mut wires = Vec::new();
    for (sequence, body) in requests.iter().enumerate() {
        let message = Message { sequence: sequence as u16, body: body.clone() };
        wires.extend(encode(&message, &mut [0; WIRE]).expect("short"));
    }
    let mut desk = Desk {
        rig,
        requests: wires,
        received: 0,
        answers: Vec::new(),
        pixels: pixels.map(<[u16]>::to_vec),
        frames: 0,
        gate: None,
        ulp_m: 0.0,
        armed: false,
        log: Vec::new(),
        waits: 0,
    };
    let spare: &'static mut Bank = Box::leak(Box::new(Config::new()));
    let End = Service::<M, P, 0>::new("stm32h743", asking, spare).run(&mut desk);
    let mut receiver = Receiver::new();
    let answers = desk.answers.iter().filter_map(|&byte| receiver.push(byte));
    let answers = answers.collect::<Result<_, _>>().expect("answers");
    (desk, answers)
}

fn bodies(answers: &[Message<Response>]) -> Vec<&Response> {
    answers.iter().map(|answer| &answer.body).collect()
}

#[test]
fn a_board_says_what_it_is() {
    let (_, answers) = serve(None, &[Request::Identify, Request::Stack]);
    let [Response::Identity(identity), Response::Stack(stack)] = bodies(&answers)[..] else {
        panic!("{answers:?}");
    };
    assert_eq!((identity.board.as_str(), identity.cells, identity.pixels), ("stm32h743", 64, 4096));
    assert_eq!(stack.used, 1000);
}

#[test]
fn an_instrument_is_loaded_and_its_frames_told() {
    let mut requests = image(bank());
    let load = requests.len();
    requests.push(Request::Reset);
    requests.push(Request::GlobalTilt(GlobalTilt::default()));
    requests.push(Request::Frame { number: 0, pixels: 4096 });
    let pixels = &detector_frames(1)[0];
    let (desk, answers) = serve(Some(pixels), &requests);
    assert_eq!(desk.log, ["disarm", "configured", "arm"]);
    // 12 km, 300 m: see the gate's own tests.
    let gate = desk.gate.expect("a gate");
    assert_eq!((gate.delay, gate.width), (18_973, 480));
    assert!((desk.ulp_m - bank().ulp_m()).abs() < 1e-20);
    let of = |request: usize| {
        let mine = answers.iter().filter(|answer| usize::from(answer.sequence) == request);
        mine.map(|answer| answer.body.clone()).collect::<Vec<_>>()
    };
    assert_eq!(of(0), [Response::Ready], "the image");
    let reset = of(load);
    assert!(matches!(reset.last(), Some(Response::Ready)));
    // 52 codes in pieces of 16, totals.
    assert_eq!(reset.len(), 4 + 1 + 1);
    let frame = of(load + 2);
    assert_eq!(frame.len(), 4 * 4 + 2);
    let Some(Response::Report(report)) = frame.last() else { panic!("{frame:?}") };
    assert_eq!(report.valid, 52);
    let sent = desk.rig.dacs.sent.borrow();
    let told: Vec<_> = frame
        .iter()
        .filter_map(|answer| match answer {
            Response::Codes { items, .. } => Some(items.to_vec()),
            _ => None,
        })
        .flatten()
        .collect();
    assert!(sent.contains(&told), "what was told is what went to the DACs");
}

#[test]
fn a_board_without_frames_says_so_and_goes_on() {
    let mut requests = image(bank());
    requests.extend([
        Request::Frame { number: 0, pixels: 4096 },
        Request::MeasuredFrame { number: 1, count: 0 },
        Request::Identify,
    ]);
    let (_, answers) = serve(None, &requests);
    let none = Response::Refused(Reason::Row(RowError::NotBegun));
    let bodies = bodies(&answers);
    assert_eq!(bodies[..3], [&Response::Ready, &none, &none]);
    assert!(matches!(bodies[3], Response::Identity(_)));
}

/// Neither a damaged image nor one that this board cannot do changes anything.
#[test]
fn an_image_that_is_refused_leaves_the_loop_running() {
    let loaded = |instrument: &Instrument| {
        let mut config = Box::new(Bank::new());
        config.build(&instrument.spec()).expect("valid");
        image(&config)
    };
    let mut sixteen_bits = instrument();
    sixteen_bits.detector.bits = 16;
    let mut odd = instrument();
    odd.detector.width += 1;
    let mut shallow = instrument();
    shallow.gate.depth_m = 0.002;
    let mut damaged = loaded(&instrument());
    let Some(Request::Piece { bytes, .. }) = damaged.last_mut() else { panic!("a piece") };
    bytes[0] ^= 1;
    let fields = [
        (loaded(&sixteen_bits), Some(Field::DetectorBits)),
        (loaded(&odd), Some(Field::DetectorWidth)),
        (loaded(&shallow), Some(Field::GateDepth)),
        (damaged, None),
    ];
    for (bad, expected) in fields {
        let mut requests = image(bank());
        let good = requests.len();
        requests.push(Request::Reset);
        requests.extend(bad);
        requests.push(Request::Frame { number: 0, pixels: 4096 });
        let (desk, answers) = serve(Some(&detector_frames(1)[0]), &requests);
        let refused = answers.iter().find_map(|answer| match &answer.body {
            Response::Refused(reason) => Some((usize::from(answer.sequence), reason)),
            _ => None,
        });
        let (at, reason) = refused.expect("a refusal");
        assert_eq!(at, good + 1);
        match (reason, expected) {
            (Reason::Value { field, .. }, Some(expected)) => assert_eq!(*field, expected),
            (reason, None) => assert_eq!(*reason, Reason::ImageDamaged),
            (reason, _) => panic!("{reason:?}"),
        }
        assert!(desk.armed, "the enables are still up");
        assert!(matches!(bodies(&answers).last(), Some(Response::Report(_))));
    }
}
