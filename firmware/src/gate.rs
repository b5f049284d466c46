//! Range gate and frame timing: delay and width of the gate from the beacon's geometry.
//!
//! ```text
//! delay = 2 (H - dH/2) / (c cos z)      from the pulse to the gate's opening
//! width = 2 dH / (c cos z)              1 us of width is 150 m of range
//! ```
//!
//! H beacon height, dH gate depth, z zenith angle. One pulse is in flight at a time, so that
//! delay + width must end before the next pulse, and the detector must be read out within a frame.

use crate::error::{ConfigError, Field};
use serde::{Deserialize, Serialize};

/// Speed of light, m/s (exact by definition).
pub const SPEED_OF_LIGHT_M_PER_S: f64 = 299_792_458.0;

/// What sets the gate and the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GateSpec {
    /// Beacon height above the telescope, m.
    pub beacon_height_m: f64,
    /// Depth of the gated range, m of height.
    pub depth_m: f64,
    /// Zenith angle, degrees, 0 to 80.
    pub zenith_angle_deg: f64,
    /// Pulses of the laser per second, Hz.
    pub pulse_rate_hz: f64,
    /// Pulses accumulated in one frame.
    pub pulses_per_frame: u32,
    /// Time the detector needs to read a frame out, s.
    pub readout_s: f64,
}

/// The timing of a frame, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GateTiming {
    /// From the pulse to the gate's opening, ns.
    pub delay_ns: u32,
    /// Width of the gate, ns.
    pub width_ns: u32,
    /// From one pulse to the next, ns.
    pub period_ns: u32,
    /// Pulses in a frame.
    pub pulses_per_frame: u32,
}

/// Longest pulse period, s: it must fit [`GateTiming`] in u32 nanoseconds.
const MAX_PERIOD_S: f64 = 4.0;

impl GateSpec {
    /// The timing, rounded to the nanosecond.
    ///
    /// # Errors
    /// A [`ConfigError`] that names the field out of its range; [`Field::GateEnd`] when the gate
    /// closes after the next pulse, [`Field::Readout`] when the readout outlasts the frame.
    pub fn timing(&self) -> Result<GateTiming, ConfigError> {
        let check = |field, value, limit| ConfigError::check(field, None, value, limit);
        check(Field::BeaconHeight, self.beacon_height_m, (1.0, 1e6))?;
        check(Field::GateDepth, self.depth_m, (1e-3, 2.0 * self.beacon_height_m))?;
        check(Field::ZenithAngle, self.zenith_angle_deg, (0.0, 80.0))?;
        check(Field::PulseRate, self.pulse_rate_hz, (1.0 / MAX_PERIOD_S, 1e8))?;
        check(Field::PulsesPerFrame, f64::from(self.pulses_per_frame), (1.0, 1e6))?;
        let airmass = 1.0 / libm::cos(self.zenith_angle_deg * core::f64::consts::PI / 180.0);
        let two_way_s = |height_m: f64| 2.0 * height_m * airmass / SPEED_OF_LIGHT_M_PER_S;
        let delay_s = two_way_s(self.beacon_height_m - self.depth_m / 2.0);
        let width_s = two_way_s(self.depth_m);
        let period_s = 1.0 / self.pulse_rate_hz;
        let frame_s = period_s * f64::from(self.pulses_per_frame);
        check(Field::GateEnd, delay_s + width_s, (0.0, period_s))?;
        check(Field::Readout, self.readout_s, (0.0, frame_s))?;
        let ns = |seconds: f64| libm::round(seconds * 1e9) as u32;
        Ok(GateTiming {
            delay_ns: ns(delay_s),
            width_ns: ns(width_s),
            period_ns: ns(period_s),
            pulses_per_frame: self.pulses_per_frame,
        })
    }

    /// The time of a frame, s.
    #[must_use]
    pub fn frame_s(&self) -> f64 {
        f64::from(self.pulses_per_frame) / self.pulse_rate_hz
    }
}
