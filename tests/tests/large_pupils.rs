//! Golden digests: what every stage computed when this was last accepted, over frames made of
//! integers. They lock the bits, on any machine; what is right is for the other tests to say.
//!
//! `SPLASH_ACCEPT=1 cargo test -p splash-tests --test golden` rewrites `golden/*.txt`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use sha2::{Digest, Sha256};
use splash_firmware::actuators::Law;
use splash_firmware::geometry::Mask;
use splash_firmware::pipeline::{GlobalTilt, Outcome, Pipeline};
use splash_firmware::pixels::Convention;
use splash_firmware::slopes::MeanSlope;
use splash_firmware::spec::{Estimator, SorSpec};
use splash_tests::frames::{Background, Rng, frame, scattered};
use splash_tests::instrument::{Instrument, Values, run_frame};
use splash_tests::with_big_stack;

const FRAMES: u32 = 6;

/// A calibration of its own for each pixel and subaperture, from integers.
fn calibrated(mut instrument: Instrument, seed: u64) -> Instrument {
    let mut rng = Rng::new(seed);
    let count = instrument.count();
    let pixels = usize::from(instrument.detector.width) * usize::from(instrument.detector.height);
    let mut each = |count: usize, low: i32, high: i32, scale: f64| -> Vec<f64> {
        (0..count).map(|_| f64::from(rng.between(low, high)) * scale).collect()
    };
    instrument.dark_adu = Values::Each(each(pixels, 180, 220, 0.5));
    instrument.pixel_gain = Values::Each(each(pixels, 200, 300, 1.0 / 256.0));
    instrument.noise_adu = Values::Each(each(pixels, 16, 48, 1.0 / 32.0));
    instrument.control_gain = Values::Each(each(count, 16, 48, 1.0 / 64.0));
    let reference = each(2 * count, -128, 128, 1.0 / 256.0);
    let pairs = reference.as_chunks::<2>().0.to_vec();
    instrument.reference_px = Values::Each(pairs);
    instrument.bad = vec![[5, 3], [6, 3], [17, 12]];
    instrument.lever_arm = 1.125;
    instrument
}

/// Name and instrument of every case.
fn instruments() -> Vec<(String, Instrument)> {
    let mut cases = Vec::new();
    for (across, window) in [(4, 32), (5, 9), (8, 16), (10, 8), (13, 7), (16, 8), (24, 6), (40, 4)]
    {
        let instrument = calibrated(Instrument::circle(across, window), across as u64);
        cases.push((format!("circle-{across}-window-{window}"), instrument));
    }
    let weighted =
        Estimator::WeightedCentreOfGravity { peak_fraction: 0.125, fwhm_px: 4.0, gain: 1.5 };
    for (name, estimator) in [
        ("plain", Estimator::CentreOfGravity),
        ("thresholded", Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.25 }),
        ("weighted", weighted),
        ("brightest", Estimator::Brightest { count: 16 }),
    ] {
        for (rule, convention) in
            [("subtract", Convention::Subtract), ("zero-below", Convention::ZeroBelow)]
        {
            let mut instrument = calibrated(Instrument::circle(8, 8), 3);
            instrument.estimator = estimator;
            instrument.convention = convention;
            cases.push((format!("{name}-{rule}"), instrument));
        }
    }
    let mut one = |name: &str, mask: Mask, change: fn(&mut Instrument)| {
        let mut instrument = calibrated(Instrument::new(mask, 8), 7);
        change(&mut instrument);
        cases.push((name.to_owned(), instrument));
    };
    let square = Mask::square(8).expect("8 is allowed");
    one("annulus-spider", Mask::annulus(16, 0.3).expect("16 is allowed").with_spider(), |_| ());
    one("dead-subapertures", square, |i| {
        let mut least = vec![100.0; 64];
        [0, 9, 10, 27, 28, 36].iter().for_each(|&dead| least[dead] = 3e6);
        i.flux_min_adu = Values::Each(least);
    });
    one("delay-2", square, |i| i.delay_frames = 2);
    one("mean-kept", square, |i| i.mean = MeanSlope::Keep);
    one("linear-12-bit", square, |i| (i.law, i.dac_bits) = (Law::Linear, 12));
    one("slew", square, |i| i.slew_m_per_frame = Some(i.stroke_m / 256.0));
    one("short-stroke", square, |i| {
        let stroke_m = i.stroke_m;
        i.limits_m = Values::Uniform([[0.46875 * stroke_m, 0.53125 * stroke_m]; 3]);
    });
    one("sweeps", square, |i| {
        i.sor = SorSpec { omega: Some(1.5), sweeps: Some(3), cold_sweeps: Some(5) };
    });
    cases
}

/// One digest a stage.
#[derive(Default)]
struct Stages(BTreeMap<&'static str, Sha256>);

impl Stages {
    fn add(&mut self, stage: &'static str, bytes: impl AsRef<[u8]>) {
        self.0.entry(stage).or_default().update(bytes);
    }
}

/// The digests of all stages over the frames of one instrument. Integers are little-endian, in
/// mask order; of the codes, u16, the three of a segment follow each other.
fn digests(instrument: &Instrument) -> BTreeMap<&'static str, String> {
    let config = instrument.config::<1600, 65536, 8192>();
    let mut pipeline = Box::new(Pipeline::<1600, 8192>::new());
    let mut rng = Rng::new(u64::from(instrument.window));
    let mut stages = Stages::default();
    for number in 0..FRAMES {
        let wander = 32 * i32::from(instrument.window);
        let spots = scattered(instrument, (2000, 384, wander), &mut rng);
        let pixels = frame(instrument, &spots, &Background::DEFAULT, &mut rng);
        if number == 2 {
            pipeline.set_global_tilt(GlobalTilt { tilt_ulp: [40_000, -70_000], frame: 1 });
        }
        let report = run_frame(&mut pipeline, &config, number, &pixels);
        assert_eq!(report.outcome, Outcome::Updated);
        for m in pipeline.measurements() {
            m.centroid_q16.iter().for_each(|c| stages.add("measurements", c.to_le_bytes()));
            stages.add("measurements", m.flux.to_le_bytes());
            stages.add("measurements", m.peak.to_le_bytes());
            stages.add("measurements", m.saturated.to_le_bytes());
        }
        for s in pipeline.slopes() {
            s.tilt_ulp.iter().for_each(|t| stages.add("slopes", t.to_le_bytes()));
            stages.add("slopes", [u8::from(s.valid)]);
        }
        for command in pipeline.commands().as_flattened() {
            stages.add("commands", command.to_le_bytes());
        }
        for p in pipeline.positions() {
            stages.add("positions", p.piston_ulp.to_le_bytes());
            p.tilt_ulp.iter().for_each(|t| stages.add("positions", t.to_le_bytes()));
        }
        for code in pipeline.codes().as_flattened() {
            stages.add("codes", code.to_le_bytes());
        }
    }
    let hex = |hash: Sha256| {
        hash.finalize().iter().fold(String::new(), |mut text, byte| {
            write!(text, "{byte:02x}").expect("a string");
            text
        })
    };
    stages.0.into_iter().map(|(stage, hash)| (stage, hex(hash))).collect()
}

fn path() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "golden", "frame_path.txt"].iter().collect()
}

/// The stages, in the order in which a frame meets them: the first that differs is the cause.
const STAGES: [&str; 5] = ["measurements", "slopes", "commands", "positions", "codes"];

#[test]
fn every_stage_gives_its_golden_bits() {
    let mut found = Vec::new();
    for (name, instrument) in instruments() {
        let digests = with_big_stack(|| digests(&instrument));
        assert_eq!(digests.len(), STAGES.len());
        for stage in STAGES {
            found.push((format!("{name}.{stage}"), digests[stage].clone()));
        }
    }
    if std::env::var_os("SPLASH_ACCEPT").is_some_and(|value| value == "1") {
        let text: String =
            found.iter().map(|(name, digest)| format!("{name} {digest}\n")).collect();
        std::fs::write(path(), text).expect("the golden file can be written");
        return;
    }
    let text = std::fs::read_to_string(path()).unwrap_or_default();
    let golden: BTreeMap<&str, &str> =
        text.lines().filter_map(|line| line.split_once(' ')).collect();
    let different = found.iter().filter_map(|(name, digest)| match golden.get(name.as_str()) {
        Some(golden) if golden == digest => None,
        Some(golden) => Some(format!("{name}: {digest}, golden {golden}")),
        None => Some(format!("{name}: {digest}, no golden value")),
    });
    let gone = golden.keys().filter(|name| !found.iter().any(|(found, _)| found == *name));
    let lines: Vec<String> = different
        .chain(gone.map(|name| format!("{name}: golden, but no longer computed")))
        .collect();
    assert!(
        lines.is_empty(),
        "\n{}\n{} of {} differ. If that is meant:\n    \
         SPLASH_ACCEPT=1 cargo test -p splash-tests --test golden\nand commit {}",
        lines.join("\n"),
        lines.len(),
        found.len(),
        path().display()
    );
}
