//! The segmented mirror: DAC codes to the shape of its segments.
//!
//! This is the device, not the firmware: it inverts the drive with its own arithmetic, in f64,
//! from the same physical description.
//!
//! ```text
//! height_a = stroke (code / code_max)^(1 or 2) - flat      optical path, m
//! [p, tip, tilt] = inverse of [1, u_a, v_a] applied to the heights
//! ```

use crate::instrument::{Instrument, ResponseName};
use crate::pupil::Mirror;

/// The device.
#[derive(Clone, Debug)]
pub struct SegmentedMirror {
    stroke_m: f64,
    code_max: f64,
    power: i32,
    actuator_radius: f64,
    rad_per_m: f64,
}

impl SegmentedMirror {
    /// The mirror of an instrument.
    pub fn new(instrument: &Instrument) -> Self {
        let section = &instrument.mirror;
        Self {
            stroke_m: section.stroke_m,
            code_max: f64::from((1u32 << section.dac_bits.min(16)) - 1),
            power: match section.response {
                ResponseName::Linear => 1,
                ResponseName::Quadratic => 2,
            },
            actuator_radius: section.actuator_radius,
            rad_per_m: instrument.rad_per_m(),
        }
    }

    /// Piston, tip and tilt (centre to edge) of a segment, rad of the sensing wavelength.
    ///
    /// The actuators lie on a circle of radius r half segments, at 90, 210 and 330 degrees: a
    /// plane through their heights has its mean as piston and
    /// tip = (h2 - h1) / (sqrt(3) r), tilt = (2 h0 - h1 - h2) / (3 r).
    pub fn segment_rad(&self, codes: [u16; 3]) -> [f64; 3] {
        let [h0, h1, h2] = codes.map(|code| {
            let height = self.stroke_m * (f64::from(code) / self.code_max).powi(self.power);
            (height - self.stroke_m / 2.0) * self.rad_per_m
        });
        let radius = self.actuator_radius;
        [
            (h0 + h1 + h2) / 3.0,
            (h2 - h1) / (3f64.sqrt() * radius),
            (2.0 * h0 - h1 - h2) / (3.0 * radius),
        ]
    }

    /// Sets `shape` to what the codes ask for.
    pub fn apply(&self, codes: &[[u16; 3]], shape: &mut Mirror) {
        for (segment, &codes) in shape.segments.iter_mut().zip(codes) {
            *segment = self.segment_rad(codes);
        }
    }
}
