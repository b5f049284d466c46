//! Range gate and frame timing: delay and width of the gate from the beacon's geometry, and back.
//!
//! ```text
//! delay = 2 (H - dH/2) / (c cos z)      from the pulse to the gate's opening
//! width = 2 dH / (c cos z)              1 us of width is 150 m of range
//! delay + width <= T                    one pulse is in flight at a time
//! sin e >= 2 (H + dH/2) / (c T)         the elevations e = 90 deg - z at which that is so
//! integration = pulses T                of the detector, from pulse to pulse
//! ```
//!
//! H beacon altitude above the telescope, dH gate depth, z zenith angle, T pulse period. A board's timer
//! counts whole ticks: delay, width and period are each rounded to the nearest tick, ties up, and back
//! to the nearest millimetre; the least elevation in an error is rounded up to a millidegree. At 10 kHz a
//! beacon at 12 km with a gate of 300 m fits from 54.2 degrees of elevation.
//!
//! [`Gate`] is the gate that runs: altitude, depth and zenith angle are asked for at any time and change
//! at a frame boundary, all at once, since the altitude of a beacon tracks the zenith angle.
//! Conversions use `libm`, for the same ticks on every machine, and are done when a change is asked for,
//! never in a frame.

use crate::error::{ConfigError, Field, Limit};
use core::fmt;
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
    /// What becomes of a frame with fewer pulses.
    pub short_frame: ShortFrame,
}

/// What becomes of a frame that had fewer laser pulses than asked. In any case the missing pulses are
/// counted and the frame is marked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ShortFrame {
    /// It is used as it is.
    #[default]
    Mark,
    /// It is used; the limits of its fluxes shrink in proportion to its pulses.
    Scale,
    /// It is not used.
    Drop,
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

impl GateTiming {
    /// From one frame to the next, ns.
    #[must_use]
    pub fn frame_ns(&self) -> u64 {
        u64::from(self.period_ns) * u64::from(self.pulses_per_frame)
    }
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
        let end_s = delay_s + width_s;
        if end_s > period_s {
            let least_deg = least_elevation_deg(end_s / airmass, period_s);
            let limit = Limit::Elevation { most: period_s, least_deg };
            return Err(ConfigError::new(Field::GateEnd, end_s, limit));
        }
        check(Field::Readout, self.readout_s, (0.0, frame_s))?;
        let ns = |seconds: f64| libm::round(seconds * 1e9) as u32;
        Ok(GateTiming {
            delay_ns: ns(delay_s),
            width_ns: ns(width_s),
            period_ns: ns(period_s),
            pulses_per_frame: self.pulses_per_frame,
        })
    }

    /// The range that is gated.
    #[must_use]
    pub fn range(&self) -> Range {
        Range {
            altitude_mm: libm::round(self.beacon_height_m * 1e3) as u32,
            depth_mm: libm::round(self.depth_m * 1e3) as u32,
            zenith_mdeg: libm::round(self.zenith_angle_deg * 1e3) as u32,
        }
    }

    /// The time of a frame, s.
    #[must_use]
    pub fn frame_s(&self) -> f64 {
        f64::from(self.pulses_per_frame) / self.pulse_rate_hz
    }
}

/// Elevation from which a gate that ends `vertical_s` after the pulse at the zenith ends within
/// `period_s`, degrees; above 90 where it never does.
fn least_elevation_deg(vertical_s: f64, period_s: f64) -> f64 {
    let sine = vertical_s / period_s;
    if sine > 1.0 { f64::INFINITY } else { libm::asin(sine) * 180.0 / core::f64::consts::PI }
}

/// What is gated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Range {
    /// Altitude of the beacon's middle above the telescope, mm; up to 1000 km.
    pub altitude_mm: u32,
    /// Depth of the gate, mm of altitude; at most twice the altitude.
    pub depth_mm: u32,
    /// Zenith angle, 1/1000 degree; up to 80 degrees.
    pub zenith_mdeg: u32,
}

/// Highest beacon, mm.
const MAX_ALTITUDE_MM: u32 = 1_000_000_000;
/// Largest zenith angle, 1/1000 degree.
const MAX_ZENITH_MDEG: u32 = 80_000;

/// The gate of a board, ticks of its timer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ticks {
    /// From the pulse to the gate's opening; at least 1.
    pub delay: u32,
    /// From the opening to the closing; at least 1.
    pub width: u32,
    /// From one pulse to the next.
    pub period: u32,
    /// The detector's integration: all pulses of a frame.
    pub integration: u64,
}

/// Why a range cannot be gated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum GateError {
    /// The altitude is out of its limits.
    Altitude {
        /// What was asked for, mm.
        mm: u32,
    },
    /// The depth is zero, or more than twice the altitude.
    Depth {
        /// What was asked for, mm.
        mm: u32,
        /// The most it may be, mm.
        most_mm: u32,
    },
    /// The zenith angle is out of its limits.
    Zenith {
        /// What was asked for, 1/1000 degree.
        mdeg: u32,
    },
    /// The gate closes after the next pulse.
    Overlap {
        /// From the pulse to the closing, ticks.
        end: u64,
        /// From one pulse to the next, ticks.
        period: u32,
        /// The elevation from which it would fit, 1/1000 degree; `None` if it never does.
        least_elevation_mdeg: Option<u32>,
    },
    /// Delay, width or period is less than half a tick of the board's timer, or more than it counts.
    Timer {
        /// Ticks of the board's timer per second.
        ticks_per_second: u32,
    },
}

impl fmt::Display for GateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Altitude { mm } => {
                write!(f, "gate altitude = {mm} mm: must be from 1 to {MAX_ALTITUDE_MM}")
            }
            Self::Depth { mm, most_mm } => {
                write!(f, "gate depth = {mm} mm: must be from 1 to {most_mm}, twice the altitude")
            }
            Self::Zenith { mdeg } => write!(
                f,
                "zenith angle = {mdeg} thousandths of a degree: must be from 0 to {MAX_ZENITH_MDEG}"
            ),
            Self::Overlap { end, period, least_elevation_mdeg } => {
                write!(f, "gate delay + width = {end} ticks: must be at most {period}; it ")?;
                match least_elevation_mdeg {
                    Some(mdeg) => write!(
                        f,
                        "fits from {}.{:03} degrees of elevation",
                        mdeg / 1000,
                        mdeg % 1000
                    ),
                    None => f.write_str("fits at no elevation"),
                }
            }
            Self::Timer { ticks_per_second } => write!(
                f,
                "gate timer: {ticks_per_second} ticks a second are too few or too many for this gate"
            ),
        }
    }
}

impl core::error::Error for GateError {}

impl Range {
    /// The ticks of a timer of `ticks_per_second` for this range, with the pulses of `timing`.
    ///
    /// # Errors
    /// A [`GateError`].
    pub fn ticks(&self, timing: &GateTiming, ticks_per_second: u32) -> Result<Ticks, GateError> {
        let Self { altitude_mm, depth_mm, zenith_mdeg } = *self;
        if !(1..=MAX_ALTITUDE_MM).contains(&altitude_mm) {
            return Err(GateError::Altitude { mm: altitude_mm });
        }
        let most_mm = 2 * altitude_mm;
        if !(1..=most_mm).contains(&depth_mm) {
            return Err(GateError::Depth { mm: depth_mm, most_mm });
        }
        if zenith_mdeg > MAX_ZENITH_MDEG {
            return Err(GateError::Zenith { mdeg: zenith_mdeg });
        }
        let per_mm = ticks_per_mm(zenith_mdeg, ticks_per_second);
        let (altitude, depth) = (f64::from(altitude_mm), f64::from(depth_mm));
        let period_s = f64::from(timing.period_ns) * 1e-9;
        let count = |ticks: f64| {
            let ticks = libm::round(ticks);
            let counted = ticks >= 1.0 && ticks <= f64::from(u32::MAX);
            if counted { Ok(ticks as u32) } else { Err(GateError::Timer { ticks_per_second }) }
        };
        let period = count(period_s * f64::from(ticks_per_second))?;
        let end = libm::round((altitude - depth / 2.0) * per_mm) + libm::round(depth * per_mm);
        if end > f64::from(period) {
            let vertical_s = 2e-3 * (altitude + depth / 2.0) / SPEED_OF_LIGHT_M_PER_S;
            let least = libm::ceil(least_elevation_deg(vertical_s, period_s) * 1e3);
            let least_elevation_mdeg = (least <= 90e3).then_some(least as u32);
            return Err(GateError::Overlap { end: end as u64, period, least_elevation_mdeg });
        }
        Ok(Ticks {
            delay: count((altitude - depth / 2.0) * per_mm)?,
            width: count(depth * per_mm)?,
            period,
            integration: u64::from(period) * u64::from(timing.pulses_per_frame),
        })
    }

    /// The range that `ticks` of such a timer gate at a zenith angle.
    #[must_use]
    pub fn of(ticks: &Ticks, zenith_mdeg: u32, ticks_per_second: u32) -> Self {
        let per_mm = ticks_per_mm(zenith_mdeg, ticks_per_second);
        let mm = |ticks: f64| libm::round(ticks / per_mm) as u32;
        let (delay, width) = (f64::from(ticks.delay), f64::from(ticks.width));
        Self { altitude_mm: mm(delay + width / 2.0), depth_mm: mm(width), zenith_mdeg }
    }
}

/// Ticks that light takes to a mm of altitude and back.
fn ticks_per_mm(zenith_mdeg: u32, ticks_per_second: u32) -> f64 {
    let zenith = f64::from(zenith_mdeg) * core::f64::consts::PI / 180e3;
    2e-3 * f64::from(ticks_per_second) / (SPEED_OF_LIGHT_M_PER_S * libm::cos(zenith))
}

/// The gate that a frame was exposed through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GateStamp {
    /// What was gated.
    pub range: Range,
    /// From the pulse to the gate's opening, ticks.
    pub delay: u32,
    /// From the opening to the closing, ticks.
    pub width: u32,
    /// Pulses asked for.
    pub asked: u32,
    /// Pulses that came.
    pub seen: u32,
}

impl GateStamp {
    /// Pulses that did not come.
    #[must_use]
    pub const fn missed(&self) -> u32 {
        self.asked.saturating_sub(self.seen)
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Setting {
    range: Range,
    ticks: Ticks,
    asked: u32,
}

/// The gate as part of the loop's state.
#[derive(Debug)]
pub struct Gate {
    ticks_per_second: u32,
    running: Setting,
    pending: Option<Setting>,
    /// Since the start; saturates.
    missed: u32,
}

impl Gate {
    /// A gate that is not set, of a timer that counts `ticks_per_second`.
    #[must_use]
    pub const fn new(ticks_per_second: u32) -> Self {
        const NONE: Setting = Setting {
            range: Range { altitude_mm: 0, depth_mm: 0, zenith_mdeg: 0 },
            ticks: Ticks { delay: 0, width: 0, period: 0, integration: 0 },
            asked: 0,
        };
        Self { ticks_per_second, running: NONE, pending: None, missed: 0 }
    }

    /// Asks for a range, from the next frame boundary on; one that was asked for before and has not
    /// come to run is forgotten.
    ///
    /// # Errors
    /// A [`GateError`]; nothing changes.
    pub fn ask(&mut self, range: Range, timing: &GateTiming) -> Result<Ticks, GateError> {
        let ticks = range.ticks(timing, self.ticks_per_second)?;
        self.pending = Some(Setting { range, ticks, asked: timing.pulses_per_frame });
        Ok(ticks)
    }

    /// A frame has been exposed, with `seen` pulses: its stamp. What was asked for runs from now on.
    pub fn frame(&mut self, seen: u32) -> GateStamp {
        let Setting { range, ticks, asked } = self.running;
        let stamp = GateStamp { range, delay: ticks.delay, width: ticks.width, asked, seen };
        self.missed = self.missed.saturating_add(stamp.missed());
        self.boundary();
        stamp
    }

    /// A frame boundary without a frame: what was asked for runs from now on.
    pub fn boundary(&mut self) {
        if let Some(pending) = self.pending.take() {
            self.running = pending;
        }
    }

    /// What the board's timer must be set to for the frames from now on.
    #[must_use]
    pub const fn running(&self) -> Ticks {
        self.running.ticks
    }

    /// What is gated from now on.
    #[must_use]
    pub const fn range(&self) -> Range {
        self.running.range
    }

    /// What will be gated from the next boundary on.
    #[must_use]
    pub fn asked(&self) -> Range {
        self.pending.map_or(self.running.range, |pending| pending.range)
    }

    /// Pulses missed since the start.
    #[must_use]
    pub const fn missed(&self) -> u32 {
        self.missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HZ: u32 = 240_000_000;
    const TIMING: GateTiming =
        GateTiming { delay_ns: 0, width_ns: 0, period_ns: 100_000, pulses_per_frame: 10 };
    const RAYLEIGH: Range = Range { altitude_mm: 12_000_000, depth_mm: 300_000, zenith_mdeg: 0 };

    fn spec(zenith_angle_deg: f64) -> GateSpec {
        GateSpec {
            beacon_height_m: 12_000.0,
            depth_m: 300.0,
            zenith_angle_deg,
            pulse_rate_hz: 10_000.0,
            pulses_per_frame: 10,
            readout_s: 0.2e-3,
            short_frame: ShortFrame::Mark,
        }
    }

    /// 2 x 11.85 km / c = 79.0547 us and 2 x 300 m / c = 2.00138 us, of which 240 ticks are one.
    #[test]
    fn ticks_are_the_times_light_takes() {
        let ticks = RAYLEIGH.ticks(&TIMING, HZ).expect("fits");
        assert_eq!((ticks.delay, ticks.width), (18_973, 480));
        assert_eq!((ticks.period, ticks.integration), (24_000, 240_000));
    }

    /// Against the formula in f64 from the geometry, and back within half a tick of range.
    #[test]
    fn ticks_and_ranges_are_nearest_both_ways() {
        let timing = GateTiming { period_ns: 4_000_000_000, ..TIMING };
        for hz in [1_000_000, 37_300_000, HZ] {
            for altitude_mm in [3_000_000, 12_345_678, 90_000_000] {
                for zenith_mdeg in (0..=80_000).step_by(7_777) {
                    let range = Range { altitude_mm, depth_mm: 301_000, zenith_mdeg };
                    let ticks = range.ticks(&timing, hz).expect("fits");
                    let cosine = (f64::from(zenith_mdeg) / 1e3).to_radians().cos();
                    let exact = |m: f64| 2.0 * m * f64::from(hz) / (299_792_458.0 * cosine);
                    let altitude_m = f64::from(altitude_mm) / 1e3;
                    let error = exact(altitude_m - 150.5) - f64::from(ticks.delay);
                    assert!(error.abs() <= 0.5 + 1e-6, "{range:?}: {error}");
                    let error = exact(301.0) - f64::from(ticks.width);
                    assert!(error.abs() <= 0.5 + 1e-6, "{range:?}: {error}");
                    let back = Range::of(&ticks, zenith_mdeg, hz);
                    // Half a tick each of the delay and of half the width.
                    let most_mm = 0.75 * 1e3 / exact(1.0) + 0.5;
                    let off = f64::from(back.altitude_mm) - f64::from(altitude_mm);
                    assert!(off.abs() <= most_mm, "{back:?}: {off} mm");
                    assert!((f64::from(back.depth_mm) - 301e3).abs() <= most_mm);
                }
            }
        }
    }

    /// sin e = 2 x 12.15 km / (c 100 us) = 0.81056: e = 54.1508 degrees.
    #[test]
    fn a_gate_that_overlaps_says_from_where_it_fits() {
        let at = |zenith_mdeg| Range { zenith_mdeg, ..RAYLEIGH }.ticks(&TIMING, HZ);
        let elevation = f64::asin(2.0 * 12_150.0 / (299_792_458.0 * 1e-4)).to_degrees();
        assert!((elevation - 54.1508).abs() < 1e-4);
        let least = (elevation * 1e3).ceil() as u32;
        assert!(at(90_000 - least).is_ok(), "at that elevation it fits");
        let error = at(90_000 - least + 20).expect_err("a little below it");
        let GateError::Overlap { end, period: 24_000, least_elevation_mdeg } = error else {
            panic!("{error}")
        };
        assert!(end > 24_000);
        assert_eq!(least_elevation_mdeg, Some(least));
        assert!(error.to_string().ends_with("it fits from 54.151 degrees of elevation"), "{error}");

        let sodium = Range { altitude_mm: 90_000_000, ..RAYLEIGH };
        let error = sodium.ticks(&TIMING, HZ).expect_err("600 us");
        assert!(error.to_string().ends_with("it fits at no elevation"), "{error}");
    }

    #[test]
    fn a_specification_says_so_too() {
        assert!(spec(35.8).timing().is_ok());
        let error = spec(36.0).timing().expect_err("too low");
        assert_eq!(error.field, Field::GateEnd);
        let Limit::Elevation { most, least_deg } = error.limit else { panic!("{error}") };
        assert_eq!(most, 1e-4);
        assert!((least_deg - 54.1508).abs() < 1e-4, "{least_deg}");
        assert!(error.to_string().ends_with("fits from 54.16 degrees of elevation"), "{error}");
    }

    #[test]
    fn ranges_out_of_limits_are_refused() {
        let refused = |range: Range| range.ticks(&TIMING, HZ).expect_err("out of limits");
        let altitude = |altitude_mm| Range { altitude_mm, ..RAYLEIGH };
        assert_eq!(refused(altitude(0)), GateError::Altitude { mm: 0 });
        assert_eq!(refused(altitude(u32::MAX)), GateError::Altitude { mm: u32::MAX });
        let depth = |depth_mm| Range { depth_mm, ..RAYLEIGH };
        for mm in [0, 24_000_001] {
            assert_eq!(refused(depth(mm)), GateError::Depth { mm, most_mm: 24_000_000 });
        }
        let steep = Range { zenith_mdeg: 80_001, ..RAYLEIGH };
        assert_eq!(refused(steep), GateError::Zenith { mdeg: 80_001 });
        let slow = RAYLEIGH.ticks(&TIMING, 100_000);
        assert_eq!(slow, Err(GateError::Timer { ticks_per_second: 100_000 }));
    }

    /// The frame being read was exposed through the gate that ran, not through the one asked for.
    #[test]
    fn a_change_waits_for_the_boundary_and_frames_bear_their_own_stamp() {
        let mut gate = Gate::new(HZ);
        gate.ask(RAYLEIGH, &TIMING).expect("fits");
        assert_eq!(gate.running(), Ticks::default(), "not before a boundary");
        gate.frame(0);
        let first = gate.running();
        let higher = Range { altitude_mm: 13_000_000, ..RAYLEIGH };
        let asked = gate.ask(higher, &TIMING).expect("fits");
        assert_eq!(gate.running(), first);
        assert_eq!((gate.range(), gate.asked()), (RAYLEIGH, higher));
        let stamp = gate.frame(10);
        assert_eq!((stamp.range, stamp.delay, stamp.width), (RAYLEIGH, first.delay, first.width));
        assert_eq!((stamp.asked, stamp.seen, stamp.missed()), (10, 10, 0));
        assert_eq!(gate.running(), asked);
        assert_eq!(gate.frame(10).range, higher);

        let low = Range { zenith_mdeg: 60_000, ..RAYLEIGH };
        assert!(gate.ask(low, &TIMING).is_err());
        gate.frame(10);
        assert_eq!(gate.range(), higher, "what is refused changes nothing");
    }

    #[test]
    fn missed_pulses_are_counted() {
        let mut gate = Gate::new(HZ);
        gate.ask(RAYLEIGH, &TIMING).expect("fits");
        gate.frame(0);
        for (seen, missed) in [(10, 0), (7, 3), (12, 0), (0, 10)] {
            assert_eq!(gate.frame(seen).missed(), missed);
        }
        assert_eq!(gate.missed(), 13);
    }
}
