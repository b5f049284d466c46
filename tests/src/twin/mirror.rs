//! What a segment reaches, and the codes of its actuators.

use splash_firmware::actuators::Law;
use splash_firmware::segments::ACTUATORS;

use super::pixels::Numbers;
use super::stored;
use crate::instrument::{Instrument, STROKE_LSB, ULP_PER_LSB};

/// Exact codes, the least and the most, of which a code may be what a drive makes: half a code to either side for
/// rounding. A quadratic drive takes a root by lines that are within a third of a 16-bit code below code 2896 and a
/// quarter above, or within 12 of 2^24 of what it is the root of, which is one too low or too high itself.
pub fn exact_codes(law: Law, dac_bits: u8, code: u16) -> [f64; 2] {
    let code = f64::from(code);
    match law {
        Law::Linear => [code - 0.5, code + 0.5],
        Law::Quadratic => {
            let scale = f64::powi(2.0, i32::from(dac_bits));
            let unit = scale / 65_536.0;
            let [line, v] = match code / unit {
                2896.0.. => [0.25, 1.0],
                362.0.. => [1.0 / 3.0, 1.0],
                _ => [0.0, 13.0],
            };
            let off = 0.5 + line * unit;
            let drive = v * f64::powi(2.0, -24) * scale * scale;
            [-1.0, 1.0].map(|side: f64| {
                let code = f64::max(code + side * off, 0.0);
                f64::max(code * code + side * drive, 0.0).sqrt()
            })
        }
    }
}

/// Piston, tip and tilt of a segment, ulp.
pub type Place = [f64; 3];

/// One segment: heights in ulp relative to flat.
#[derive(Clone, Debug)]
pub struct Segment {
    matrix: [[f64; 3]; ACTUATORS],
    /// Lowest and highest height of each actuator.
    pub limits: [[f64; 2]; ACTUATORS],
    /// Flat heights above the actuators' zero.
    pub flat: [f64; ACTUATORS],
    /// Heights at code 0 and at the highest code, above the actuators' zero.
    response: [[f64; 2]; ACTUATORS],
    law: Law,
    dac_bits: u8,
    top_code: f64,
}

impl Segment {
    /// Segment `i` of `instrument`. Stored are each row of the matrix over its first entry, with 10
    /// to 15 fraction bits, as many as fit all segments, and the heights in whole LSB, limits
    /// rounded inwards to at most 65535.
    pub fn new(instrument: &Instrument, i: usize, numbers: Numbers) -> Self {
        let lsb_m = instrument.stroke_m / STROKE_LSB;
        let is_stored = numbers == Numbers::Stored;
        let lsb = |m: f64, rule: &dyn Fn(f64) -> f64| {
            ULP_PER_LSB * if is_stored { rule(m / lsb_m) } else { m / lsb_m }
        };
        let flat = instrument.flat_m.at(i).map(|m| lsb(m, &super::round));
        let mut limits = instrument.limits_m.at(i).map(|[low, high]| {
            [lsb(low, &f64::ceil), lsb(high, &|h| f64::min(h.floor(), STROKE_LSB - 1.0))]
        });
        limits.iter_mut().zip(flat).for_each(|(l, flat)| *l = l.map(|l| l - flat));
        let steepness = |[piston, tip, tilt]: [f64; 3]| f64::max(tip.abs(), tilt.abs()) / piston;
        let matrices = (0..instrument.count()).flat_map(|i| instrument.matrix.at(i));
        let steepest = matrices.map(steepness).fold(0.0, f64::max);
        let bits = (10..=15).rev().find(|bits| steepest * f64::powi(2.0, *bits) < 32767.0);
        let entry = |m: f64, piston: f64| match bits {
            Some(bits) if is_stored => piston * stored(m / piston, bits),
            _ => m,
        };
        Self {
            matrix: instrument
                .matrix
                .at(i)
                .map(|[piston, tip, tilt]| [piston, entry(tip, piston), entry(tilt, piston)]),
            limits,
            flat,
            response: instrument.response_m.at(i).map(|ends| ends.map(|m| m / lsb_m * ULP_PER_LSB)),
            law: instrument.law,
            dac_bits: instrument.dac_bits,
            top_code: f64::powi(2.0, i32::from(instrument.dac_bits)) - 1.0,
        }
    }

    /// Heights relative to flat.
    pub fn heights(&self, [piston, tip, tilt]: Place) -> [f64; ACTUATORS] {
        self.matrix.map(|[m0, m1, m2]| m0 * piston + m1 * tip + m2 * tilt)
    }

    /// The pistons at which tip and tilt are within every actuator's limits; empty if the first
    /// is above the second.
    pub fn pistons(&self, [tip, tilt]: [f64; 2]) -> [f64; 2] {
        let bounds =
            self.matrix.iter().zip(self.limits).map(|([m0, m1, m2], limits)| {
                limits.map(|limit| (limit - m1 * tip - m2 * tilt) / m0)
            });
        bounds.fold([f64::NEG_INFINITY, f64::INFINITY], |[low, high], [l, h]| {
            [f64::max(low, l), f64::min(high, h)]
        })
    }

    /// How far the pistons' interval is from empty at these tilts, ulp.
    pub fn room(&self, tilts: [f64; 2]) -> f64 {
        let [low, high] = self.pistons(tilts);
        high - low
    }

    /// The largest part, 0 to 1, of tip and tilt for which some piston is in reach: by bisection,
    /// since the region is convex and holds the flat segment.
    pub fn scale(&self, tilts: [f64; 2]) -> f64 {
        let reaches = |part: f64| self.room(tilts.map(|t| t * part)) >= 0.0;
        if reaches(1.0) {
            return 1.0;
        }
        let (mut inside, mut outside) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = (inside + outside) / 2.0;
            if reaches(middle) {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        inside
    }

    /// The exact code of an actuator at a height relative to flat.
    pub fn code(&self, actuator: usize, height: f64) -> f64 {
        let [zero, full] = self.response[actuator];
        let part = ((height + self.flat[actuator] - zero) / (full - zero)).clamp(0.0, 1.0);
        self.top_code
            * match self.law {
                Law::Linear => part,
                Law::Quadratic => f64::sqrt(part),
            }
    }

    /// Exact codes, the least and the most, of which `code` may be what the drive makes.
    pub fn exact_codes(&self, code: u16) -> [f64; 2] {
        exact_codes(self.law, self.dac_bits, code)
    }

    /// The height relative to flat that a code gives.
    pub fn height(&self, actuator: usize, code: f64) -> f64 {
        let [zero, full] = self.response[actuator];
        let part = code / self.top_code;
        let part = match self.law {
            Law::Linear => part,
            Law::Quadratic => part * part,
        };
        zero + part * (full - zero) - self.flat[actuator]
    }

    /// The highest code.
    pub fn top_code(&self) -> f64 {
        self.top_code
    }
}
