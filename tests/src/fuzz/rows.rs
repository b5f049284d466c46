//! Sequences of rows, good and bad, through the pipeline.

use super::Bytes;
use crate::instrument::{Instrument, Values};
use splash_firmware::actuators::Law;
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::fixed::TILT_LIMIT;
use splash_firmware::pipeline::{GlobalTilt, Hold, Outcome, Pipeline, Report, Totals};
use splash_firmware::spec::Estimator;

const CELLS: usize = 16;
const PIXELS: usize = CELLS * 16;
/// Part of the stroke that an actuator may use, and move in a frame.
const REACH: [f64; 2] = [0.25, 0.75];
const SLEW: f64 = 1.0 / 64.0;

/// Bit of an instrument's choice by which it has a slew limit.
pub(super) const SLEWS: u8 = 32;

/// Whatever comes, in whatever order: codes stay within limits and slew, move only when a frame says
/// so, and every `finish` is counted once.
pub(super) fn run(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let instrument = instrument(bytes.u8());
    let config = instrument.config();
    let mut watched = Watched {
        pipeline: Box::new(Pipeline::new()),
        config: &config,
        linear: instrument.law == Law::Linear,
        slews: instrument.slew_m_per_frame.is_some(),
        finishes: 0,
        codes: Vec::new(),
    };
    watched.pipeline.reset(&config);
    watched.look(None);
    while !bytes.is_empty() {
        watched.operate(&mut bytes);
    }
}

/// 4 x 4 subapertures, windows of 4 x 4 pixels, by what `choice` says.
pub(super) fn instrument(choice: u8) -> Instrument {
    let mut instrument = Instrument::circle(4, 4);
    instrument.estimator = match choice & 3 {
        0 => Estimator::CentreOfGravity,
        1 => Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.1 },
        2 => Estimator::WeightedCentreOfGravity { peak_fraction: 0.1, fwhm_px: 2.0, gain: 1.5 },
        _ => Estimator::Brightest { count: 5 },
    };
    instrument.law = if choice & 4 == 0 { Law::Linear } else { Law::Quadratic };
    instrument.delay_frames = (choice >> 3) & 3;
    instrument.flux_min_adu = Values::Uniform(1.0);
    let stroke_m = instrument.stroke_m;
    instrument.limits_m = Values::Uniform([REACH.map(|part| part * stroke_m); 3]);
    instrument.slew_m_per_frame = (choice & SLEWS != 0).then_some(SLEW * stroke_m);
    instrument.lever_arm = if choice & 64 == 0 { 1.0 } else { 1.9 };
    instrument
}

struct Watched<'a> {
    pipeline: Box<Pipeline<CELLS, PIXELS>>,
    config: &'a Config<CELLS, PIXELS, PIXELS>,
    linear: bool,
    slews: bool,
    finishes: u64,
    codes: Vec<[u16; 3]>,
}

impl Watched<'_> {
    fn operate(&mut self, bytes: &mut Bytes<'_>) {
        let width = self.config.width();
        match bytes.u8() % 10 {
            0 | 1 => self.pipeline.begin(self.config, bytes.u32()),
            2 => {
                let row = row(bytes, width);
                // Refused where it does not fit; what comes after tells.
                let _ = self.pipeline.push_row(self.config, &row);
            }
            3 => {
                let length = usize::from(width) + usize::from(bytes.u8() % 3) - 1;
                let row = vec![bytes.u16() & 0xfff; length];
                let _ = self.pipeline.push_row(self.config, &row);
            }
            4 | 5 => {
                let rows = u16::from(bytes.u8() % 20);
                let block: Vec<u16> = (0..rows).flat_map(|_| row(bytes, width)).collect();
                let _ = self.pipeline.push_rows(self.config, &block, rows);
            }
            6 => {
                let count = self.config.subapertures() + usize::from(bytes.u8() % 3) - 1;
                let list: Vec<Measurement> = (0..count).map(|_| measurement(bytes)).collect();
                let _ = self.pipeline.push_measurements(self.config, &list);
            }
            7 => {
                let tilt_ulp = [(); 2].map(|()| bytes.u32() as i32);
                self.pipeline.set_global_tilt(GlobalTilt { tilt_ulp, frame: bytes.u32() });
            }
            8 => {
                let report = self.pipeline.finish(self.config);
                self.finishes += 1;
                return self.look(Some(report));
            }
            _ => {
                // Rarely, or no sequence would get far.
                if bytes.u8() == 0 {
                    self.pipeline.reset(self.config);
                    self.finishes = 0;
                    self.codes.clear();
                }
            }
        }
        self.look(None);
    }

    fn look(&mut self, report: Option<Report>) {
        let codes = self.pipeline.codes();
        let updated = report.is_some_and(|report| report.outcome == Outcome::Updated);
        if !self.codes.is_empty() && !updated {
            assert_eq!(codes, self.codes, "codes moved without a frame: {report:?}");
        }
        // A code more on either side: heights are rounded to LSB, and LSB to codes.
        let code = |height: f64| 65535.0 * if self.linear { height } else { height.sqrt() };
        let [least, most] = REACH.map(code);
        for (i, code) in codes.as_flattened().iter().enumerate() {
            let value = f64::from(*code);
            assert!(value >= least - 1.0 && value <= most + 1.0, "actuator {i}: code {code}");
        }
        if self.slews && !self.codes.is_empty() {
            within_slew(self.linear, &self.codes, codes);
        }
        self.codes = codes.to_vec();
        for position in self.pipeline.positions() {
            assert!(position.tilt_ulp.iter().all(|tilt| tilt.abs() <= TILT_LIMIT), "{position:?}");
            // Half the limits' range, and what a tilt leaves of it.
            assert!(position.piston_ulp.abs() < 1 << 29, "{position:?}");
        }
        let totals = self.pipeline.totals();
        assert_eq!(counted(&totals), self.finishes, "{totals:?}");
        if let Some(Report { outcome: Outcome::Held(Hold::CutShort { rows }), .. }) = report {
            assert!(rows < self.config.height(), "a whole frame is not cut short");
        }
    }
}

/// No actuator moves by more than the slew limit, but for the rounding of both codes.
pub(super) fn within_slew(linear: bool, before: &[[u16; 3]], now: &[[u16; 3]]) {
    let height = |code: u16| {
        let part = f64::from(code) / 65535.0;
        if linear { part } else { part * part }
    };
    assert_eq!(now.len(), before.len(), "segments");
    let pairs = now.as_flattened().iter().zip(before.as_flattened());
    for (i, (&now, &before)) in pairs.enumerate() {
        let step = (height(now) - height(before)).abs();
        assert!(step <= SLEW + 2.0 / 65536.0, "actuator {i} moved by {step} of its stroke");
    }
}

/// Frames that ended, one way or another.
fn counted(totals: &Totals) -> u64 {
    let ended =
        [totals.updated, totals.cut_short, totals.wrong_row, totals.no_light, totals.not_ready];
    ended.into_iter().map(u64::from).sum()
}

/// A row of one level with one pixel that is brighter.
fn row(bytes: &mut Bytes<'_>, width: u16) -> Vec<u16> {
    let (level, place, peak) = (u16::from(bytes.u8()), bytes.u8(), bytes.u16());
    let mut row = vec![level; usize::from(width)];
    row[usize::from(place) % usize::from(width)] = peak & 0xfff;
    row
}

pub(super) fn measurement(bytes: &mut Bytes<'_>) -> Measurement {
    let centroid_q16 = [(); 2].map(|()| bytes.u32() as i32);
    Measurement { centroid_q16, flux: bytes.u32(), peak: bytes.u16(), saturated: bytes.u16() }
}
