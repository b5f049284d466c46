//! The server in memory: requests from a list, answers into one.

use super::{frames, usual};
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use splash_firmware::banks::Banks;
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::error::Field;
use splash_firmware::link::{
    LIST, Message, PIECE, Reason, Receiver, Request, Response, Stack, WIRE, encode,
};
use splash_firmware::pipeline::{GlobalTilt, Hold, Outcome, Pipeline, Report, RowError};
use splash_firmware::telemetry::Ring;
use splash_server::{Port, controller, serve};
use splash_tests::instrument::Instrument;
use std::cell::Cell;

type Bank = Config<64, 4096, 0>;
type State = Pipeline<64, 0>;

thread_local! {
    static MARKS: Cell<usize> = const { Cell::new(0) };
}

/// What comes in, and what went out.
#[derive(Default)]
struct Memory {
    requests: Vec<u8>,
    received: usize,
    pixels: Vec<u16>,
    read: usize,
    /// Pixels of a row, and where the frame ends.
    width: usize,
    end: usize,
    answers: Vec<u8>,
    actuated: Vec<Vec<[u16; 3]>>,
    flash: Ram,
}

/// A flash that never fails.
struct Ram(Vec<u8>);

impl Default for Ram {
    fn default() -> Self {
        Self(vec![0; 4 * Self::ERASE_SIZE])
    }
}

impl ErrorType for Ram {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Ram {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        bytes.copy_from_slice(&self.0[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for Ram {
    const WRITE_SIZE: usize = 32;
    const ERASE_SIZE: usize = 1 << 14;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.0[from as usize..to as usize].fill(0xff);
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let places = &mut self.0[offset as usize..][..bytes.len()];
        places.iter_mut().zip(bytes).for_each(|(place, byte)| *place &= byte);
        Ok(())
    }
}

/// All requests were served.
struct End;

impl Port for Memory {
    type Error = End;
    type Flash = Ram;

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

    fn expose(&mut self, pixels: usize, width: usize) -> Result<(), End> {
        assert_eq!(self.read, self.end, "the frame before was read to its end");
        self.end += pixels;
        self.width = width;
        Ok(())
    }

    fn rows(&mut self) -> Result<Option<&[u16]>, End> {
        let start = self.read;
        self.read = self.end.min(start + self.width);
        let row = self.pixels.get(start..self.read).ok_or(End)?;
        Ok((!row.is_empty()).then_some(row))
    }

    fn actuate(&mut self, codes: &[[u16; 3]]) -> Result<(), End> {
        self.actuated.push(codes.to_vec());
        Ok(())
    }

    fn stack(&self) -> Stack {
        Stack { used: 1000, reserved: 4000 }
    }

    fn flash(&mut self) -> Option<&mut Ram> {
        Some(&mut self.flash)
    }

    fn mark() {
        MARKS.set(MARKS.get() + 1);
    }
}

/// A run of the server that is being written down.
#[derive(Default)]
pub(crate) struct Script {
    memory: Memory,
    sequence: u16,
}

impl Script {
    pub(crate) fn ask(&mut self, body: Request) -> &mut Self {
        self.sequence += 1;
        let mut wire = [0; WIRE];
        let bytes = encode(&Message { sequence: self.sequence, body }, &mut wire);
        self.memory.requests.extend(bytes.expect("not too long"));
        self
    }

    pub(crate) fn load(&mut self, image: &[u8]) -> &mut Self {
        self.ask(Request::Load { bytes: image.len() as u32 });
        for (i, piece) in image.chunks(PIECE).enumerate() {
            let offset = (i * PIECE) as u32;
            self.ask(Request::Piece { offset, bytes: piece.iter().copied().collect() });
        }
        self
    }

    pub(crate) fn frame(&mut self, number: u32, pixels: &[u16]) -> &mut Self {
        self.memory.pixels.extend(pixels);
        self.ask(Request::Frame { number, pixels: pixels.len() as u32 })
    }

    pub(crate) fn measured(
        &mut self,
        number: u32,
        measurements: &[Measurement],
        count: u32,
    ) -> &mut Self {
        for (i, items) in measurements.chunks(LIST).enumerate() {
            let items = items.iter().copied().collect();
            self.ask(Request::Measurements { first: (i * LIST) as u16, items });
        }
        self.ask(Request::MeasuredFrame { number, count })
    }

    /// Runs it: the answers, what was given to the DACs, and the marks.
    pub(crate) fn run(&mut self) -> (Vec<Response>, Vec<Vec<[u16; 3]>>, usize) {
        MARKS.set(0);
        let mut memory = std::mem::take(&mut self.memory);
        let (mut running, mut other) = (Box::new(Bank::new()), Box::new(Bank::new()));
        let (mut control, mut telemetry) = (Box::new(controller()), Box::new(Ring::<40>::new()));
        let banks = Banks::new(&mut running, &mut other);
        let End = serve(&mut memory, "memory", banks, &mut control, &mut telemetry);
        assert_eq!(memory.read, memory.pixels.len(), "every pixel was read");
        let mut receiver = Receiver::new();
        let found = memory.answers.iter().filter_map(|&byte| receiver.push(byte));
        let found = found.map(|message| message.expect("a message").body).collect();
        (found, memory.actuated, MARKS.get())
    }
}

pub(crate) fn image(instrument: &Instrument) -> Vec<u8> {
    let mut image = Vec::new();
    instrument.config::<256, 16_384, 0>().save(&mut |piece| image.extend_from_slice(piece));
    image
}

/// What the answers to one frame say.
fn left(responses: &[Response]) -> State4 {
    let mut state = State4::default();
    for response in responses {
        match response {
            Response::Codes { items, .. } => state.codes.extend(items),
            Response::Measurements { items, .. } => state.measurements.extend(items),
            Response::Slopes { items, .. } => state.slopes.extend(items.iter().map(|s| s.tilt_ulp)),
            Response::Positions { items, .. } => {
                state.pistons.extend(items.iter().map(|p| p.piston_ulp));
            }
            _ => {}
        }
    }
    state
}

#[derive(Debug, Default, PartialEq)]
struct State4 {
    codes: Vec<[u16; 3]>,
    measurements: Vec<Measurement>,
    slopes: Vec<[i32; 2]>,
    pistons: Vec<i32>,
}

impl State4 {
    fn of(pipeline: &State) -> Self {
        Self {
            codes: pipeline.codes().to_vec(),
            measurements: pipeline.measurements().to_vec(),
            slopes: pipeline.slopes().iter().map(|s| s.tilt_ulp).collect(),
            pistons: pipeline.positions().iter().map(|p| p.piston_ulp).collect(),
        }
    }
}

/// Splits answers behind each message that ends some.
fn by_request(responses: &[Response]) -> Vec<&[Response]> {
    let last = |response: &Response| {
        matches!(
            response,
            Response::Ready | Response::Refused(_) | Response::Report(_) | Response::Identity(_)
        )
    };
    responses.split_inclusive(last).collect()
}

fn reports(responses: &[Response]) -> Vec<Report> {
    let report = |response: &Response| match response {
        Response::Report(report) => Some(*report),
        _ => None,
    };
    responses.iter().filter_map(report).collect()
}

#[test]
fn a_loop_by_the_server_is_the_loop_itself() {
    let instrument = usual();
    let config = instrument.config::<64, 4096, 0>();
    let mut pipeline = State::new();
    pipeline.reset(&config);
    let pixels = frames(&instrument, 4);
    let (width, height) = (usize::from(config.width()), usize::from(config.height()));
    let tilt = GlobalTilt { tilt_ulp: [40_000, -25_000], frame: 2 };

    let mut script = Script::default();
    script.load(&image(&instrument)).ask(Request::Reset);
    let mut expected = vec![(State4::of(&pipeline), pipeline.totals(), None)];
    let mut marks = 2;
    // Whole frames, one cut in the middle of a row's end, and a tilt from elsewhere.
    let cut = &pixels[2][..width * (height - 3)];
    for (number, pixels) in [&pixels[0], &pixels[1], cut, &pixels[3]].into_iter().enumerate() {
        let number = number as u32;
        script.ask(Request::GlobalTilt(tilt)).frame(number, pixels);
        pipeline.set_global_tilt(tilt);
        pipeline.begin(&config, number);
        for row in pixels.chunks(width) {
            pipeline.push_row(&config, row).expect("a row");
        }
        let report = pipeline.finish(&config);
        let stages = if report.outcome == Outcome::Updated { 5 } else { 1 };
        marks += 2 + 2 * (pixels.len() / width) + 2 + stages;
        expected.push((State4::of(&pipeline), pipeline.totals(), Some(report)));
    }
    let measured: Vec<Measurement> = pipeline.measurements().to_vec();
    script.measured(9, &measured, measured.len() as u32);
    pipeline.begin(&config, 9);
    pipeline.push_measurements(&config, &measured).expect("one each");
    let report = pipeline.finish(&config);
    marks += 2 + 2 + 5;
    expected.push((State4::of(&pipeline), pipeline.totals(), Some(report)));

    let (responses, actuated, marked) = script.run();
    assert_eq!(responses[0], Response::Ready, "loaded");
    let answers = by_request(&responses[1..]);
    let answers = answers.iter().filter(|answers| answers.len() > 1).collect::<Vec<_>>();
    assert_eq!(answers.len(), expected.len());
    for (i, (answers, (state, totals, report))) in answers.iter().zip(&expected).enumerate() {
        let found = left(answers);
        assert_eq!(found.codes, state.codes, "{i}");
        assert!(answers.contains(&Response::Totals(*totals)), "{i}: {totals:?}");
        assert_eq!(actuated[i], state.codes, "{i}");
        if let Some(report) = report {
            assert_eq!(&found, state, "{i}");
            assert_eq!(answers.last(), Some(&Response::Report(*report)));
        }
    }
    assert_eq!(marked, marks);
    let held = Outcome::Held(Hold::CutShort { rows: height as u16 - 3 });
    assert_eq!(reports(&responses)[2].outcome, held);
}

#[test]
fn refused_rows_are_told_and_the_detector_stays_in_step() {
    let instrument = usual();
    let pixels = frames(&instrument, 1).remove(0);
    let width = instrument.detector.width;
    let ragged = &pixels[..pixels.len() - 5];
    let long = [pixels.as_slice(), &pixels[..2 * usize::from(width)]].concat();
    let few = [Measurement::default(); 20];
    let (responses, ..) = Script::default()
        .frame(0, &pixels)
        .load(&image(&instrument))
        .frame(1, ragged)
        .frame(2, &long)
        .measured(3, &few, 20)
        .measured(4, &few, 52)
        .frame(5, &pixels)
        .run();
    let last: Vec<_> = by_request(&responses).iter().map(|answers| answers.last()).collect();
    let refused = |error| Response::Refused(Reason::Row(error));
    let short = RowError::Length { found: u32::from(width) - 5, expected: width };
    let count = instrument.count() as u16;
    assert_eq!(last[0], Some(&refused(RowError::Extra)), "without a configuration");
    assert_eq!(last[1], Some(&Response::Ready));
    assert_eq!(last[2], Some(&refused(short)));
    assert_eq!(last[3], Some(&refused(RowError::Extra)));
    assert_eq!(last[4], Some(&refused(RowError::Length { found: 20, expected: count })));
    assert_eq!(last[5], Some(&refused(RowError::Length { found: 52, expected: count })));
    let [report] = reports(&responses)[..] else { panic!("one frame was good: {last:?}") };
    assert_eq!((report.frame, report.outcome), (5, Outcome::Updated));
    // A refused frame is not finished: the next one drops it.
    assert!(report.restarted);
}

#[test]
fn an_image_is_loaded_whole_or_not_at_all() {
    let good = image(&usual());
    let mut damaged = good.clone();
    damaged[good.len() / 2] ^= 1;
    let mut large = usual();
    large.window = 16;
    large.origins.iter_mut().flatten().for_each(|origin| *origin *= 2);
    large.detector.width *= 2;
    large.detector.height *= 2;
    let large = image(&large);
    let interrupted = |script: &mut Script| {
        script
            .ask(Request::Load { bytes: 1000 })
            .ask(Request::Piece { offset: 0, bytes: good[..256].iter().copied().collect() });
    };
    let mut script = Script::default();
    script.load(&damaged).load(&good[..good.len() - 9]).load(&large);
    interrupted(&mut script);
    script.ask(Request::Identify);
    interrupted(&mut script);
    // A piece is missing.
    script.ask(Request::Piece { offset: 512, bytes: good[512..700].iter().copied().collect() });
    script.ask(Request::Identify).load(&good);
    let (responses, ..) = script.run();

    let identity = |response: &Response| match response {
        Response::Identity(identity) => {
            let sizes = (identity.cells, identity.pixels, identity.buffered);
            assert_eq!((identity.board.as_str(), sizes), ("memory", (64, 4096, 0)));
            true
        }
        _ => false,
    };
    assert_eq!(responses[0], Response::Refused(Reason::ImageDamaged));
    assert_eq!(responses[1], Response::Refused(Reason::ImageCut));
    let too_large = Reason::Value {
        field: Field::WindowPixels,
        index: None,
        value: 52.0 * 256.0,
        limits: Some([1.0, 4096.0]),
    };
    assert_eq!(responses[2], Response::Refused(too_large));
    assert_eq!(responses[3], Response::Refused(Reason::ImageCut));
    assert!(identity(&responses[4]), "the request that cut the image short is served");
    assert_eq!(responses[5], Response::Refused(Reason::ImageCut));
    assert!(identity(&responses[6]));
    assert_eq!(responses[7..], [Response::Ready]);
}

#[test]
fn garbage_between_requests_is_passed_over() {
    let mut script = Script::default();
    script.memory.requests.extend([1, 2, 3, 0, 0, 200, 7, 7, 0]);
    script.ask(Request::Identify);
    script.memory.requests.extend([3, 9, 9, 0]);
    script.ask(Request::Identify);
    assert_eq!(script.run().0.len(), 2);
}
