//! What a run comes to: averages, their error, the digest of the codes and the faults.

use crate::optics::science::Observation;
use sha2::{Digest, Sha256};
use splash_firmware::pipeline::{Report, Totals};
use std::collections::BTreeMap;

/// Blocks into which a series is cut for its standard error: frames are correlated, blocks much
/// longer than a pupil's crossing time hardly are.
const BLOCKS: usize = 10;

/// SHA-256 of DAC codes: u16 little-endian, frame after frame, segments in mask order, actuators
/// 0, 1, 2.
#[derive(Clone, Debug, Default)]
pub struct CodeDigest(Sha256);

impl CodeDigest {
    /// Adds a frame.
    pub fn add(&mut self, codes: &[[u16; 3]]) {
        for code in codes.as_flattened() {
            self.0.update(code.to_le_bytes());
        }
    }

    /// The digest so far, lower-case hexadecimal.
    pub fn hex(&self) -> String {
        self.0.clone().finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// The series of a run, one entry a frame.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// Time, s.
    pub time_s: Vec<f64>,
    /// |<exp(i phi)>|^2 with piston, tip and tilt removed.
    pub strehl: Vec<f64>,
    /// Mean square of that residual phase, rad^2.
    pub variance_rad2: Vec<f64>,
    /// The firmware's reports.
    pub reports: Vec<Report>,
}

/// Mean and standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// The mean.
    pub mean: f64,
    /// Its standard error from block averages; 0 with too few frames to tell.
    pub standard_error: f64,
}

impl Series {
    /// Adds a frame.
    pub fn push(&mut self, time_s: f64, observation: &Observation, report: Report) {
        self.time_s.push(time_s);
        self.strehl.push(observation.strehl);
        self.variance_rad2.push(observation.variance_rad2);
        self.reports.push(report);
    }

    /// Mean Strehl ratio from frame `settle` on.
    pub fn mean_strehl(&self, settle: usize) -> Mean {
        block_mean(self.strehl.get(settle..).unwrap_or_default())
    }

    /// Mean residual variance from frame `settle` on, rad^2.
    pub fn mean_variance(&self, settle: usize) -> Mean {
        block_mean(self.variance_rad2.get(settle..).unwrap_or_default())
    }

    /// The mean of the Strehl ratio up to each frame since `settle`; before that, of all.
    pub fn running_strehl(&self, settle: usize) -> Vec<f64> {
        let (mut sum, mut count) = (0.0, 0.0);
        let mut running = Vec::with_capacity(self.strehl.len());
        for (frame, strehl) in self.strehl.iter().enumerate() {
            if frame == settle {
                (sum, count) = (0.0, 0.0);
            }
            sum += strehl;
            count += 1.0;
            running.push(sum / count);
        }
        running
    }
}

fn block_mean(values: &[f64]) -> Mean {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let total = mean(values);
    if values.len() < 2 * BLOCKS {
        return Mean { mean: total, standard_error: 0.0 };
    }
    let blocks: Vec<f64> = values.chunks_exact(values.len() / BLOCKS).map(mean).collect();
    let count = blocks.len() as f64;
    let scatter = blocks.iter().map(|block| (block - total).powi(2)).sum::<f64>();
    Mean { mean: total, standard_error: (scatter / (count * (count - 1.0))).sqrt() }
}

/// The faults of a run by name, without those that did not happen.
pub fn faults(totals: &Totals) -> BTreeMap<&'static str, u32> {
    let Totals {
        updated: _,
        cut_short,
        wrong_row,
        no_light,
        not_ready,
        restarted,
        extra_rows,
        stale_tilt,
        saturated_actuators,
        slewed_actuators,
    } = *totals;
    let all = [
        ("cut_short", cut_short),
        ("wrong_row", wrong_row),
        ("no_light", no_light),
        ("not_ready", not_ready),
        ("restarted", restarted),
        ("extra_rows", extra_rows),
        ("stale_tilt", stale_tilt),
        ("saturated_actuators", saturated_actuators),
        ("slewed_actuators", slewed_actuators),
    ];
    all.into_iter().filter(|(_, count)| *count > 0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digest_is_of_little_endian_codes() {
        let mut digest = CodeDigest::default();
        digest.add(&[[0x0201, 0x0403, 0x0605]]);
        // SHA-256 of the bytes 01 02 03 04 05 06, from `printf '\1\2\3\4\5\6' | sha256sum`.
        let expected = "7192385c3c0605de55bb9476ce1d90748190ecb32a8eed7f5207b30cf6a1fe89";
        assert_eq!(digest.hex(), expected);
    }

    #[test]
    fn standard_error_is_that_of_blocks() {
        // Ten blocks of two, block means 0, 1, ... 9: variance of the mean 55/6 / 10.
        let values: Vec<f64> = (0..20).map(|i| f64::from(i / 2)).collect();
        let Mean { mean, standard_error } = block_mean(&values);
        assert!((mean - 4.5).abs() < 1e-12);
        assert!((standard_error.powi(2) - 55.0 / 60.0).abs() < 1e-12);
    }
}
