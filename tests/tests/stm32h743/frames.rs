//! Blocks of rows as the DMA leaves them, through interrupts and queues, to the DACs: the codes are those of the
//! library given the same frames row by row, whatever is late, short or lost.

use crate::rig::{M, P, PULSES, Rig, bank, bank_of, detector_frames, instrument, next};
use splash_firmware::fault::Fault;
use splash_firmware::mode::Mode;
use splash_firmware::pipeline::{GlobalTilt, Hold, Outcome, Pipeline};
use splash_tests::instrument::Values;
use stm32h743_logic::frame_loop::Record;
use stm32h743_logic::queues::News;
use stm32h743_logic::ring;

/// The library alone.
struct Plain {
    bank: &'static mut splash_firmware::config::Config<M, P, 0>,
    pipeline: Pipeline<M, 0>,
}

impl Plain {
    fn new() -> Self {
        let bank = bank();
        let mut pipeline = Pipeline::new();
        pipeline.reset(bank);
        Self { bank, pipeline }
    }

    /// The codes after a frame of these rows.
    fn frame(&mut self, number: u32, pixels: &[u16]) -> Vec<[u16; 3]> {
        self.pipeline.begin(self.bank, number);
        for row in pixels.chunks(self.bank.width().into()) {
            self.pipeline.push_row(self.bank, row).expect("a row");
        }
        self.pipeline.finish(self.bank);
        self.pipeline.codes().to_vec()
    }
}

fn records(news: &[News]) -> Vec<Record> {
    let record = |news: &News| match news {
        News::Frame(record) => Some(*record),
        News::Fault(_) => None,
    };
    news.iter().filter_map(record).collect()
}

fn faults(news: &[News]) -> Vec<ring::Fault> {
    let fault = |news: &News| match news {
        News::Frame(_) => None,
        News::Fault(fault) => Some(*fault),
    };
    news.iter().filter_map(fault).collect()
}

#[test]
fn codes_are_those_of_the_library_row_by_row() {
    let ((mut rig, _), mut plain) = (Rig::reading(), Plain::new());
    for (number, pixels) in detector_frames(12).iter().enumerate() {
        let number = number as u32;
        rig.frame(100 + PULSES * number, pixels);
        assert_eq!(rig.sent(), [plain.frame(number, pixels)], "frame {number}");
        let record = records(&rig.told())[0];
        assert_eq!(record.result.report.frame, number);
        assert_eq!(record.result.report.outcome, Outcome::Updated);
        let gate = record.result.gate;
        // Nothing was gated before the first frame that began.
        let asked = if number == 0 { 0 } else { PULSES };
        assert_eq!((gate.asked, gate.seen, record.sent), (asked, PULSES, true));
        assert_eq!((record.result.mode, record.result.fault), (Mode::ClosedLoop, None));
        assert!(record.tilt_squared_ulp2 > 0);
        // The model's counter counts its readings: two a block of 16 rows; one between each two stages.
        assert_eq!((record.cycles.rows, record.cycles.stages), (4, [1; 5]));
    }
}

#[test]
fn frames_that_are_worked_on_late_find_every_block() {
    let ((mut rig, _), mut plain) = (Rig::reading(), Plain::new());
    rig.prompt = false;
    for (pair, pixels) in detector_frames(12).chunks(2).enumerate() {
        let mut expected = Vec::new();
        for (i, pixels) in pixels.iter().enumerate() {
            let number = (2 * pair + i) as u32;
            rig.frame(PULSES * number, pixels);
            expected.push(plain.frame(number, pixels));
        }
        rig.run();
        assert_eq!(rig.sent(), expected);
    }
    assert_eq!(faults(&rig.told()), []);
}

#[test]
fn a_ring_that_is_full_is_told_and_the_next_frames_are_right() {
    let ((mut rig, _), mut plain) = (Rig::reading(), Plain::new());
    let frames = detector_frames(14);
    rig.prompt = false;
    // At most 29 of the ring's 32 blocks wait before one more is taken, and an end counts as one: five
    // a frame. Of the seventh none is taken.
    for number in 0..7 {
        rig.frame(PULSES * number, &frames[number as usize]);
    }
    rig.run();
    let news = rig.told();
    assert_eq!(faults(&news), [ring::Fault::Full]);
    let expected =
        (0..6).map(|number| plain.frame(number, &frames[number as usize])).collect::<Vec<_>>();
    assert!(rig.sent() == expected, "codes");
    plain.frame(6, &[]);
    rig.prompt = true;
    for number in 7..14 {
        let pixels = &frames[number as usize];
        rig.frame(PULSES * number, pixels);
        assert!(rig.sent() == [plain.frame(number, pixels)], "frame {number}");
    }
}

fn held(rows: u16) -> Outcome {
    Outcome::Held(Hold::CutShort { rows })
}

/// A frame of other than 64 rows is held, or its first 64 count. Where the DMA is no more at the start of
/// a block the detector is started again, which loses no whole frame: the next one comes after VSYNC.
#[test]
fn a_frame_of_another_length_spoils_no_other() {
    let frames = detector_frames(7);
    for rows in [0, 1, 15, 16, 17, 48, 63, 64, 65, 80, 100, 128] {
        let ((mut rig, _), mut plain) = (Rig::reading(), Plain::new());
        for number in 0..6 {
            let longer: Vec<_> = frames[2].iter().chain(&frames[6]).copied().collect();
            let pixels = if number == 2 { &longer[..rows * 64] } else { &frames[number as usize] };
            rig.frame(PULSES * number, pixels);
            plain.frame(number, &pixels[..pixels.len().min(64 * 64)]);
        }
        let news = rig.told();
        let whole_blocks = rows % 16 == 0 && rows <= 64;
        let expected: &[ring::Fault] = if whole_blocks { &[] } else { &[ring::Fault::Astray] };
        assert_eq!(faults(&news), expected, "{rows} rows");
        let outcome = records(&news)
            .iter()
            .find(|r| r.result.report.frame == 2)
            .map(|r| r.result.report.outcome);
        match rows {
            // Without a block it is known from the count of pulses only.
            0..16 => assert_eq!(outcome, None),
            16..64 => assert_eq!(outcome, Some(held(rows as u16 / 16 * 16))),
            _ => assert_eq!(outcome, Some(Outcome::Updated)),
        }
        let last = records(&news).last().copied().expect("a frame");
        assert_eq!(
            (last.result.report.frame, last.result.report.outcome),
            (5, Outcome::Updated),
            "{rows}"
        );
        // The loop's past is that of a library which was told of every exposure.
        assert_eq!(rig.sent().last().expect("codes"), plain.pipeline.codes(), "{rows} rows");
    }
}

#[test]
fn lost_pixels_and_late_interrupts_hold_one_frame() {
    let frames = detector_frames(6);
    for fault in [ring::Fault::Overrun, ring::Fault::Late] {
        let ((mut rig, _), mut plain) = (Rig::reading(), Plain::new());
        rig.frame(0, &frames[0]);
        plain.frame(0, &frames[0]);
        rig.hardware.overrun = fault == ring::Fault::Overrun;
        rig.hardware.masked = usize::from(fault == ring::Fault::Late);
        rig.frame(PULSES, &frames[1]);
        plain.frame(1, &[]);
        for number in 2..6 {
            let pixels = &frames[number as usize];
            rig.frame(PULSES * number, pixels);
            plain.frame(number, pixels);
        }
        let news = rig.told();
        assert_eq!(faults(&news), [fault]);
        assert_eq!(records(&news).last().expect("a frame").result.report.frame, 5);
        assert_eq!(rig.sent().last().expect("codes"), plain.pipeline.codes(), "{fault:?}");
    }
}

#[test]
fn frames_that_never_came_are_held_in_the_loops_past() {
    let ((mut rig, mut main), mut plain) = (Rig::reading(), Plain::new());
    let frames = detector_frames(8);
    for number in [0, 1, 4, 5] {
        rig.frame(PULSES * number, &frames[number as usize]);
        if number == 4 {
            plain.frame(2, &[]);
            plain.frame(3, &[]);
        }
        assert_eq!(rig.sent(), [plain.frame(number, &frames[number as usize])]);
    }
    let books = main.books(&mut rig);
    assert_eq!(books.faults[Fault::FrameMissing.kind()], 2);
    assert_eq!(books.mode, Mode::ClosedLoop);
}

#[test]
fn the_main_loop_asks_and_is_answered() {
    let (mut rig, mut main) = Rig::reading();
    let asking = &mut main.asking;
    let mut plain = Plain::new();
    let frames = detector_frames(3);
    let mut none = || false;
    assert!(asking.next_frame(&mut none).is_none(), "no detector");
    rig.run();
    rig.frame(0, &frames[0]);
    plain.frame(0, &frames[0]);
    // That one was asked for before; it is not the next one.
    let mut next = 1;
    let state = asking.next_frame(&mut || {
        rig.run();
        rig.frame(PULSES * next, &frames[next as usize]);
        next += 1;
        true
    });
    let state = state.expect("a frame");
    plain.frame(1, &frames[1]);
    assert_eq!(state.result.expect("a frame").report.frame, 1);
    assert_eq!(state.codes, plain.pipeline.codes());
    assert_eq!(state.measurements, plain.pipeline.measurements());
    assert_eq!(state.slopes, plain.pipeline.slopes());
    assert_eq!(state.positions, plain.pipeline.positions());

    let tilt = GlobalTilt { tilt_ulp: [500, -300], frame: 2 };
    asking.global_tilt(tilt, &mut || true);
    rig.run();
    rig.frame(PULSES * 2, &frames[2]);
    plain.pipeline.set_global_tilt(tilt);
    assert_eq!(*rig.sent().last().expect("codes"), plain.frame(2, &frames[2]));
}

/// What was asked for and not waited for stands in nobody's way, whether it has come or not.
#[test]
fn an_answer_that_came_too_late_is_not_taken_for_another() {
    let frames = detector_frames(2);
    for comes in [false, true] {
        let (mut rig, mut main) = Rig::reading();
        assert!(main.asking.next_frame(&mut || false).is_none());
        rig.run();
        if comes {
            rig.frame(0, &frames[0]);
        }
        main.exchange(&mut rig, bank());
        assert_eq!(main.running.subapertures(), 0, "the half that is left of the first bank");
        assert!(main.asking.next_frame(&mut || false).is_none());
        let books = main.books(&mut rig);
        assert_eq!(books.last.is_some(), comes);
        let number = u32::from(comes);
        let state = main.asking.next_frame(&mut || {
            rig.run();
            rig.frame(PULSES * number, &frames[number as usize]);
            true
        });
        assert_eq!(state.expect("a frame").result.expect("its report").report.frame, number);
    }
}

/// The next frame may have begun before the interrupt of the last block is served.
#[test]
fn a_stamp_is_not_taken_for_that_of_the_frame_before() {
    let ((mut rig, _), mut plain) = (Rig::reading(), Plain::new());
    let frames = detector_frames(4);
    for number in 0..4 {
        let pixels = &frames[number as usize];
        let (most, last) = pixels.split_at(pixels.len() - 64);
        rig.rows(PULSES * number, most);
        // The stamp of the next one is there.
        rig.hardware.begin(PULSES * (number + 1));
        rig.rest(last);
        assert!(rig.sent() == [plain.frame(number, pixels)], "frame {number}");
    }
}

#[test]
fn a_bank_waits_for_the_end_of_the_frame_that_is_being_read() {
    let ((mut rig, mut main), mut plain) = (Rig::reading(), Plain::new());
    let frames = detector_frames(2);
    rig.frame(0, &frames[0]);
    plain.frame(0, &frames[0]);
    rig.sent();
    let (first, rest) = frames[1].split_at(20 * 64);
    rig.rows(PULSES, first);
    let mut half_gain = instrument();
    half_gain.control_gain = Values::Uniform(0.25);
    let mut waits = 0;
    let before = main.asking.exchange(next(bank_of(&half_gain)), &mut || {
        waits += 1;
        rig.run();
        if waits == 3 {
            rig.rest(rest);
        }
        assert!(waits < 10);
        true
    });
    assert!(waits >= 3, "in the middle of a frame nothing changes");
    assert_eq!(before.expect("the same mask").subapertures(), 52, "the bank that ran before");
    let sent = rig.sent();
    assert_eq!(sent[0], plain.frame(1, &frames[1]), "the frame is the old bank's");
    assert_eq!(sent.last(), sent.first(), "and the mirror stays");
}

#[test]
fn dacs_that_do_not_take_codes_lead_to_safe() {
    let (mut rig, mut main) = Rig::reading();
    let frames = detector_frames(2);
    rig.dacs.busy.set(true);
    rig.frame(0, &frames[0]);
    assert!(!records(&rig.told())[0].sent);
    rig.dacs.busy.set(false);
    rig.frame(PULSES, &frames[1]);
    assert!(records(&rig.told())[0].sent);
    let books = main.books(&mut rig);
    assert_eq!(books.mode, Mode::Safe);
    assert_eq!(books.faults[Fault::Dacs.kind()], 1);
}
