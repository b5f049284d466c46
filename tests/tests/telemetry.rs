//! Telemetry: what a frame left arrives whole, at the rate that the link has, and what did not is counted.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::controller::FrameResult;
use splash_firmware::fault::{Fault, Faults, Moment, RECORDS};
use splash_firmware::gate::{GateStamp, Range};
use splash_firmware::ladder::Rung;
use splash_firmware::link::{List, Message, Response, WIRE, encode};
use splash_firmware::mode::Mode;
use splash_firmware::pipeline::{Pipeline, Report};
use splash_firmware::segments::Position;
use splash_firmware::slopes::Slope;
use splash_firmware::telemetry::{Cycles, Decimation, FrameRecord, Record, Ring, STREAMS, Stamp};
use splash_tests::frames::{Background, Rng, frame, scattered};
use splash_tests::instrument::{Instrument, run_frame};
use std::collections::VecDeque;

const ALL: Decimation = Decimation { frames: 1, slopes: 1, commands: 1, codes: 1, fluxes: 1 };

fn wire(record: Record) -> usize {
    let mut wire = [0; WIRE];
    let message = Message { sequence: 0, body: Response::Telemetry(record) };
    encode(&message, &mut wire).expect("not too long").len()
}

/// A run of the loop: configuration, state and the reports of its frames.
fn run(frames: u32, mut each: impl FnMut(&Pipeline<64, 0>, &Report)) -> usize {
    let instrument = Instrument::circle(8, 8);
    let config: Box<Config<64, 4096, 0>> = instrument.config();
    let mut pipeline = Box::new(Pipeline::<64, 0>::new());
    let mut rng = Rng::new(80);
    let spots = scattered(&instrument, (2000, 400, 500), &mut rng);
    for number in 0..frames {
        let pixels = frame(&instrument, &spots, &Background::DEFAULT, &mut rng);
        let report = run_frame(&mut pipeline, &config, number, &pixels);
        each(&pipeline, &report);
    }
    config.subapertures()
}

const GATE: GateStamp = GateStamp {
    range: Range { altitude_mm: u32::MAX, depth_mm: u32::MAX, zenith_mdeg: u32::MAX },
    delay: u32::MAX,
    width: u32::MAX,
    asked: u32::MAX,
    seen: u32::MAX,
};
const STAMP: Stamp = Stamp {
    configuration: 0xfeed_f00d,
    cycles: Cycles { rows: 1, stages: [2, 3, 4, 5, 6], latency: 7 },
};

/// What a controller would say of it.
fn result(report: &Report) -> FrameResult {
    let at = Moment { frame: report.frame, ticks: 1 << 40 };
    FrameResult {
        report: *report,
        mode: Mode::ClosedLoop,
        rung: Some(Rung::GiveUp(Fault::TotalFlux { flux: u64::MAX, limit: u64::MAX })),
        fault: Some(Fault::TotalFlux { flux: u64::MAX, limit: u64::MAX }),
        gate: GATE,
        at,
    }
}

/// The place of a record's stream among the counts.
const fn stream(record: &Record) -> usize {
    match record {
        Record::Frame(_) => 0,
        Record::Slopes { .. } => 1,
        Record::Commands { .. } => 2,
        Record::Codes { .. } => 3,
        Record::Fluxes { .. } => 4,
        Record::Fault(_) => 5,
    }
}

fn put<T: Copy>(all: &mut Vec<T>, first: u16, items: &List<T>) {
    assert_eq!(usize::from(first), all.len());
    all.extend_from_slice(items);
}

#[test]
fn what_a_frame_left_arrives_whole() {
    let mut ring = Box::new(Ring::<64>::new());
    ring.subscribe(ALL);
    run(3, |pipeline, report| {
        ring.fill(pipeline, &result(report), &STAMP);
        let Some(Record::Frame(found)) = ring.pop() else { panic!("the frame comes first") };
        let squares =
            |slope: &Slope| slope.tilt_ulp.map(|t| i64::from(t).pow(2)).iter().sum::<i64>();
        let valid = pipeline.slopes().iter().filter(|slope| slope.valid);
        assert_eq!(found.tilt_squared_ulp2, valid.map(squares).sum::<i64>() as u64);
        assert_eq!((found.result, found.cycles), (result(report), STAMP.cycles));
        assert_eq!(found.configuration, STAMP.configuration);
        let (mut slopes, mut positions, mut codes, mut fluxes) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        while let Some(record) = ring.pop() {
            let number = match record {
                Record::Frame(_) => panic!("one is enough"),
                Record::Fault(_) => panic!("there was none"),
                Record::Slopes { frame, first, items } => {
                    put(&mut slopes, first, &items);
                    frame
                }
                Record::Commands { frame, first, items } => {
                    put(&mut positions, first, &items);
                    frame
                }
                Record::Codes { frame, first, items } => {
                    put(&mut codes, first, &items);
                    frame
                }
                Record::Fluxes { frame, first, items } => {
                    put(&mut fluxes, first, &items);
                    frame
                }
            };
            assert_eq!(number, report.frame);
        }
        assert_eq!(slopes, pipeline.slopes());
        assert_eq!(positions, pipeline.positions());
        assert_eq!(codes, pipeline.codes());
        assert_eq!(fluxes, pipeline.measurements());
        assert_eq!(ring.dropped(), [0; STREAMS]);
    });
}

/// Without a subscription nothing is kept; each stream comes with its own frames.
#[test]
fn streams_come_every_so_many_frames() {
    let mut ring = Box::new(Ring::<64>::new());
    let decimation = Decimation { frames: 1, slopes: 2, commands: 0, codes: 3, fluxes: 0 };
    run(7, |pipeline, report| {
        ring.subscribe(Decimation::OFF);
        ring.fill(pipeline, &result(report), &STAMP);
        assert_eq!(ring.pop(), None);
        ring.subscribe(decimation);
        ring.fill(pipeline, &result(report), &STAMP);
        let mut pieces = [0; STREAMS];
        while let Some(record) = ring.pop() {
            pieces[stream(&record)] += 1;
        }
        // 52 subapertures in pieces of 16.
        let list = |every: u32| if report.frame % every == 0 { 4 } else { 0 };
        assert_eq!(pieces, [1, list(2), 0, list(3), 0, 0], "frame {}", report.frame);
    });
}

/// Every fault is told once, in order, from the subscription on, whatever frames do; of more than are
/// kept the oldest count as dropped.
#[test]
fn every_fault_is_told_once() {
    let mut ring = Box::new(Ring::<32>::new());
    let mut faults = Faults::new();
    let mut frame = 0;
    let mut book = |faults: &mut Faults, count: u32| {
        for _ in 0..count {
            frame += 1;
            faults.book(Fault::Dacs, Moment { frame, ticks: 1 << 40 });
        }
    };
    let told = |ring: &mut Ring<32>| -> Vec<u32> {
        let frames = std::iter::from_fn(|| ring.pop()).map(|record| match record {
            Record::Fault(record) => record.at.frame,
            other => panic!("{other:?}"),
        });
        frames.collect()
    };
    book(&mut faults, 3);
    ring.tell(&faults);
    assert_eq!(told(&mut ring), []);
    ring.subscribe(Decimation { frames: 1, ..Decimation::OFF });
    ring.tell(&faults);
    assert_eq!(told(&mut ring), []);
    book(&mut faults, 2);
    ring.tell(&faults);
    ring.tell(&faults);
    assert_eq!(told(&mut ring), [4, 5]);
    // The operator forgets those that were told, not those to come.
    faults.clear();
    book(&mut faults, 1);
    ring.tell(&faults);
    assert_eq!((told(&mut ring), ring.dropped()), (vec![6], [0; STREAMS]));
    book(&mut faults, RECORDS as u32 + 4);
    ring.tell(&faults);
    let newest: Vec<u32> = (11..=RECORDS as u32 + 10).collect();
    assert_eq!((told(&mut ring), ring.dropped()), (newest, [0, 0, 0, 0, 0, 4]));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, rng_seed: RngSeed::Fixed(80), ..ProptestConfig::default() })]

    /// However fill and link interleave: the ring is a queue of the newest records, and what is
    /// missing was counted.
    #[test]
    fn a_full_ring_drops_its_oldest_and_counts_them(pops in prop::collection::vec(0usize..40, 12)) {
        const ROOM: usize = 30;
        let mut ring = Box::new(Ring::<ROOM>::new());
        let mut endless = Box::new(Ring::<64>::new());
        ring.subscribe(ALL);
        endless.subscribe(ALL);
        let mut expected = VecDeque::new();
        let mut dropped = [0; STREAMS];
        let mut pops = pops.into_iter();
        run(12, |pipeline, report| {
            ring.fill(pipeline, &result(report), &STAMP);
            endless.fill(pipeline, &result(report), &STAMP);
            while let Some(record) = endless.pop() {
                expected.push_back(record);
                if expected.len() > ROOM {
                    let oldest = expected.pop_front().expect("one more than there is room for");
                    dropped[stream(&oldest)] += 1;
                }
            }
            for _ in 0..pops.next().unwrap_or_default() {
                assert_eq!(ring.pop(), expected.pop_front());
            }
        });
        prop_assert_eq!(ring.dropped(), dropped);
    }
}

/// The default keeps the streams within half of the link, whatever they hold, and uses a fair part of
/// it: each stream comes as often as its tenth of the link allows.
#[test]
fn the_default_fits_the_link() {
    let widest = [
        Record::Slopes {
            frame: u32::MAX,
            first: u16::MAX,
            items: std::iter::repeat_n(Slope { tilt_ulp: [i32::MIN; 2], valid: true }, 16)
                .collect(),
        },
        Record::Commands {
            frame: u32::MAX,
            first: u16::MAX,
            items: std::iter::repeat_n(
                Position { piston_ulp: i32::MIN, tilt_ulp: [i32::MIN; 2] },
                16,
            )
            .collect(),
        },
        Record::Codes {
            frame: u32::MAX,
            first: u16::MAX,
            items: std::iter::repeat_n([u16::MAX; 3], 16).collect(),
        },
        Record::Fluxes {
            frame: u32::MAX,
            first: u16::MAX,
            items: std::iter::repeat_n(
                Measurement {
                    centroid_q16: [i32::MIN; 2],
                    flux: u32::MAX,
                    peak: u16::MAX,
                    saturated: u16::MAX,
                },
                16,
            )
            .collect(),
        },
    ]
    .map(wire);
    let mut frame_bytes = 0;
    run(1, |_, report| {
        let mut report = *report;
        (report.frame, report.saturated_pixels) = (u32::MAX, u32::MAX);
        (report.residual_squared, report.global_tilt_age) = (u64::MAX, Some(u32::MAX));
        (report.valid, report.extra_rows) = (u16::MAX, u16::MAX);
        (report.saturated_actuators, report.slewed_actuators) = (u16::MAX, u16::MAX);
        frame_bytes = wire(Record::Frame(FrameRecord {
            result: FrameResult {
                at: Moment { frame: u32::MAX, ticks: u64::MAX },
                ..result(&report)
            },
            configuration: u32::MAX,
            tilt_squared_ulp2: u64::MAX,
            cycles: Cycles { rows: u32::MAX, stages: [u32::MAX; 5], latency: u32::MAX },
        }));
    });
    // 921600 baud, ten bits a byte, with one gate and with two; a slow line; USB.
    for (bytes_per_s, frame_hz, subapertures, windows) in [
        (92_160, 1000, 52, 52),
        (92_160, 1000, 52, 104),
        (960, 100, 208, 208),
        (1_000_000, 2000, 52, 52),
        (100_000_000, 1000, 208, 416),
    ] {
        let frame_ns = 1_000_000_000 / frame_hz;
        let chosen = Decimation::for_link(bytes_per_s, frame_ns, subapertures, windows);
        let every = [chosen.frames, chosen.slopes, chosen.commands, chosen.codes, chosen.fluxes];
        // Whole pieces of 16 are counted here, the last of which may be shorter.
        let items = [windows, subapertures, subapertures, windows];
        let lists = widest.into_iter().zip(items).map(|(bytes, items): (usize, usize)| {
            let pieces = items.div_ceil(16);
            (bytes * pieces, 16.0 * pieces as f64 / items as f64)
        });
        let streams = std::iter::once((frame_bytes, 1.0)).chain(lists);
        for ((bytes, last), every) in streams.zip(every) {
            assert!(every > 0);
            let rate = bytes as f64 * frame_hz as f64 / f64::from(every);
            let share = f64::from(bytes_per_s) / 10.0;
            assert!(rate <= share * last, "{bytes} bytes every {every}: {rate} of {share} B/s");
            assert!(every == 1 || rate > 0.4 * share, "{bytes} every {every}: {rate} of {share}");
        }
    }
    assert_eq!(Decimation::for_link(9, 1_000_000, 52, 52), Decimation::OFF, "not a byte for each");
}
