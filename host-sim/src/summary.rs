//! What a run comes to: averages, their error, the digest of the codes and the faults.

use crate::optics::science::Observation;
use sha2::{Digest, Sha256};
use splash_firmware::fault::{KINDS, NAMES};
use splash_firmware::pipeline::{Report, Totals};
use std::collections::BTreeMap;

/// Correlation times over which a series' own autocorrelation is summed (Sokal): beyond, it is
/// noise.
const WINDOW: f64 = 5.0;

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
    /// Its standard error, from scatter and autocorrelation of the frames. A lower bound unless
    /// the run is many times the turbulence's crossing of the pupil: one run is one realisation.
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
        correlated_mean(self.strehl.get(settle..).unwrap_or_default())
    }

    /// Mean residual variance from frame `settle` on, rad^2.
    pub fn mean_variance(&self, settle: usize) -> Mean {
        correlated_mean(self.variance_rad2.get(settle..).unwrap_or_default())
    }

    /// The mean of the Strehl ratio from `settle` up to each frame; NaN before.
    pub fn running_strehl(&self, settle: usize) -> Vec<f64> {
        let mut sum = 0.0;
        let mean = |(frame, strehl): (usize, &f64)| {
            if frame < settle {
                return f64::NAN;
            }
            sum += strehl;
            sum / (frame - settle + 1) as f64
        };
        self.strehl.iter().enumerate().map(mean).collect()
    }
}

/// Mean and standard error of a correlated series: variance tau / n, with the integrated
/// autocorrelation time tau = 1 + 2 sum rho_k summed to `WINDOW` times itself (Sokal 1997).
fn correlated_mean(values: &[f64]) -> Mean {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let covariance = |lag: usize| {
        let pairs = values.iter().zip(values.iter().skip(lag));
        pairs.map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>() / count
    };
    let variance = covariance(0);
    if variance <= 0.0 {
        return Mean { mean, standard_error: 0.0 };
    }
    let mut tau = 1.0;
    for lag in 1..values.len() {
        if lag as f64 >= WINDOW * tau {
            break;
        }
        tau += 2.0 * covariance(lag) / variance;
    }
    Mean { mean, standard_error: (variance * tau.max(1.0) / count).sqrt() }
}

/// The faults of a run by name, without those that did not happen: those that the frame path counts, and
/// those that the controller books.
pub fn faults(totals: &Totals, booked: &[u32; KINDS]) -> BTreeMap<&'static str, u32> {
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
    // A row of the wrong length is both counted and booked, as the same.
    let all = NAMES.into_iter().zip(booked.iter().copied()).chain(all);
    all.filter(|(_, count)| *count > 0).collect()
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
    fn standard_error_knows_the_correlation() {
        // x_k = a x_{k-1} + e_k has unit-variance e: variance 1 / (1 - a^2), correlation a^k,
        // hence tau = (1 + a) / (1 - a) and a standard error of 1 / (1 - a) / sqrt(n).
        let (a, n) = (0.9, 100_000);
        let mut seed = 1u64;
        let mut uniform = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let mut x = 0.0;
        let series: Vec<f64> = (0..n)
            .map(|_| {
                x = a * x + 12f64.sqrt() * uniform();
                x
            })
            .collect();
        let Mean { mean, standard_error } = correlated_mean(&series);
        let expected = 1.0 / (1.0 - a) / f64::from(n).sqrt();
        // The estimate's own scatter is sqrt(2 (2 x 5 tau + 1) / n) / 2 = 5 % (Sokal 1997).
        assert!((standard_error / expected - 1.0).abs() < 0.15, "{standard_error} {expected}");
        assert!(mean.abs() < 4.0 * expected, "{mean}");
    }
}
