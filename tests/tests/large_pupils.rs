//! Golden digests of pupils that no board holds, and of calibrated pixels at N = 16: what the suite
//! (`tests/suite.rs`), which runs on boards too, has to leave out.
//!
//! `SPLASH_ACCEPT=1 cargo test -p splash-tests --test large_pupils` rewrites
//! `golden/large_pupils.txt`.

use sha2::{Digest, Sha256};
use splash_firmware::geometry::Mask;
use splash_firmware::pipeline::{GlobalTilt, Outcome, Pipeline};
use splash_tests::frames::{Background, Rng, frame, scattered};
use splash_tests::instrument::{Instrument, Values, run_frame};
use splash_tests::{golden, with_big_stack};

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

/// The stages, in the order in which a frame meets them, and their digests.
struct Stages([(&'static str, Sha256); 5]);

impl Stages {
    fn new() -> Self {
        let names = ["measurements", "slopes", "commands", "positions", "codes"];
        Self(names.map(|name| (name, Sha256::new())))
    }

    /// Adds a frame: integers are little-endian, in mask order.
    fn add<const M: usize, const B: usize>(&mut self, pipeline: &Pipeline<M, B>) {
        let [measurements, slopes, commands, positions, codes] =
            self.0.each_mut().map(|(_, digest)| digest);
        for m in pipeline.measurements() {
            m.centroid_q16.iter().for_each(|c| measurements.update(c.to_le_bytes()));
            measurements.update(m.flux.to_le_bytes());
            measurements.update(m.peak.to_le_bytes());
            measurements.update(m.saturated.to_le_bytes());
        }
        for s in pipeline.slopes() {
            s.tilt_ulp.iter().for_each(|t| slopes.update(t.to_le_bytes()));
            slopes.update([u8::from(s.valid)]);
        }
        for command in pipeline.commands().as_flattened() {
            commands.update(command.to_le_bytes());
        }
        for p in pipeline.positions() {
            positions.update(p.piston_ulp.to_le_bytes());
            p.tilt_ulp.iter().for_each(|t| positions.update(t.to_le_bytes()));
        }
        for code in pipeline.codes().as_flattened() {
            codes.update(code.to_le_bytes());
        }
    }
}

/// The digests of all stages over the frames of one instrument.
fn digests(instrument: &Instrument) -> Stages {
    let config = instrument.config::<1600, 65536, 8192>();
    let mut pipeline = Box::new(Pipeline::<1600, 8192>::new());
    let mut rng = Rng::new(u64::from(instrument.window));
    let mut stages = Stages::new();
    for number in 0..FRAMES {
        let wander = 32 * i32::from(instrument.window);
        let spots = scattered(instrument, (2000, 384, wander), &mut rng);
        let pixels = frame(instrument, &spots, &Background::DEFAULT, &mut rng);
        if number == 2 {
            pipeline.set_global_tilt(GlobalTilt { tilt_ulp: [40_000, -70_000], frame: 1 });
        }
        let report = run_frame(&mut pipeline, &config, number, &pixels);
        assert_eq!(report.outcome, Outcome::Updated);
        stages.add(&pipeline);
    }
    stages
}

#[test]
fn every_stage_gives_its_golden_bits() {
    let spider = Mask::annulus(16, 0.3).expect("16 is allowed").with_spider();
    let instruments = [
        ("annulus-spider", calibrated(Instrument::new(spider, 8), 7)),
        ("circle-24-window-6", calibrated(Instrument::circle(24, 6), 24)),
        ("circle-40-window-4", calibrated(Instrument::circle(40, 4), 40)),
    ];
    let mut lines = Vec::new();
    for (name, instrument) in instruments {
        for (stage, digest) in with_big_stack(|| digests(&instrument)).0 {
            let hex: String = digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
            lines.push(format!("{name}.{stage} {hex}"));
        }
    }
    golden::check("large_pupils", "host", &lines);
}
