//! Parameters by name, in physical units, from and to the formats of the running configuration.
//!
//! Names are those of the fields in errors. A value is refused here if it does not fit its format, and by
//! the board, with the same words, if it breaks a bound of the configuration.

use splash_firmware::adjust::{Adjustment, Parameter as Asked};
use splash_firmware::centroid::EstimatorConfig;
use splash_firmware::fixed::{CENTROID_BITS, LENGTH_BITS};
use splash_firmware::image::{Head, SecondGate, Subaperture};
use splash_firmware::slopes::SlopeCalibration;

/// One in Q13, the format of the control coefficients.
const GAIN_ONE: f64 = 8192.0;
/// One in Q16.
const Q16: f64 = 65536.0;

/// A parameter.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// Its name.
    pub name: &'static str,
    /// Its unit, and how many values it has if that is not one.
    pub unit: &'static str,
    access: Access,
}

#[derive(Clone, Copy, Debug)]
enum Access {
    /// There once; `None` where the configuration has none.
    Head { read: fn(&Head) -> Option<f64>, write: fn(&mut Head, f64) -> Result<(), Bound> },
    /// There once a subaperture, so many values.
    Subaperture {
        values: usize,
        read: fn(&Head, &Subaperture) -> Vec<f64>,
        write: fn(&Head, &mut Subaperture, &[f64]) -> Result<(), Bound>,
    },
    /// There once a subaperture in the slope calibration of a gate, so many values.
    Slope {
        gate: Gate,
        values: usize,
        read: fn(&Head, &SlopeCalibration) -> Vec<f64>,
        write: fn(&Head, &mut SlopeCalibration, &[f64]) -> Result<(), Bound>,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Gate {
    First,
    Second,
}

/// What there is once a subaperture.
#[derive(Clone, Copy, Debug)]
pub enum Entry {
    /// For all that there is but a second gate.
    Subaperture(Subaperture),
    /// For that.
    SecondGate(SecondGate),
}

impl Entry {
    /// The change that makes this the entry of subaperture `index`.
    pub fn adjustment(self, index: u16) -> Adjustment {
        match self {
            Self::Subaperture(entry) => Adjustment::Subaperture { index, entry },
            Self::SecondGate(entry) => Adjustment::SecondGate { index, entry },
        }
    }

    fn slope(&self) -> &SlopeCalibration {
        match self {
            Self::Subaperture(entry) => &entry.slope,
            Self::SecondGate(entry) => &entry.slope,
        }
    }

    fn slope_mut(&mut self) -> &mut SlopeCalibration {
        match self {
            Self::Subaperture(entry) => &mut entry.slope,
            Self::SecondGate(entry) => &mut entry.slope,
        }
    }
}

/// Why a value was not taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// It is not within the format.
    Within {
        /// What was found.
        found: f64,
        /// Lowest and highest.
        limits: [f64; 2],
    },
    /// It is not whole.
    Whole {
        /// What was found.
        found: f64,
    },
    /// There are so many values.
    Values {
        /// What was found.
        found: usize,
        /// How many there are.
        values: usize,
    },
    /// The running configuration has no such parameter.
    Absent,
}

impl std::fmt::Display for Bound {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::Within { found, limits: [low, high] } => {
                write!(f, " = {found}: must be from {low} to {high}")
            }
            Self::Whole { found } => write!(f, " = {found}: must be a whole number"),
            Self::Values { found, values } => write!(f, " = {found} values: must be {values}"),
            Self::Absent => f.write_str(": the running configuration has none"),
        }
    }
}

/// The parameter of that name.
pub fn find(name: &str) -> Option<&'static Parameter> {
    PARAMETERS.iter().find(|parameter| parameter.name == name)
}

impl Parameter {
    /// Whether there is one for each subaperture.
    pub fn is_indexed(&self) -> bool {
        !matches!(self.access, Access::Head { .. })
    }

    /// What a board is asked for the entry of subaperture `index` that this is in.
    pub fn entry(&self, index: u16) -> Asked {
        match self.access {
            Access::Slope { gate: Gate::Second, .. } => Asked::SecondGate { index },
            _ => Asked::Subaperture { index },
        }
    }

    /// Its values; `entry` is the subaperture's, for a parameter that has an index.
    ///
    /// # Errors
    /// [`Bound::Absent`].
    pub fn read(&self, head: &Head, entry: Option<&Entry>) -> Result<Vec<f64>, Bound> {
        match (self.access, entry) {
            (Access::Head { read, .. }, _) => {
                read(head).map(|value| vec![value]).ok_or(Bound::Absent)
            }
            (Access::Subaperture { read, .. }, Some(Entry::Subaperture(entry))) => {
                Ok(read(head, entry))
            }
            (Access::Slope { read, .. }, Some(entry)) => Ok(read(head, entry.slope())),
            (Access::Subaperture { .. } | Access::Slope { .. }, _) => Err(Bound::Absent),
        }
    }

    /// Sets one that is there once.
    ///
    /// # Errors
    /// [`Bound`]; nothing has changed.
    pub fn write_head(&self, head: &mut Head, values: &[f64]) -> Result<(), Bound> {
        match (self.access, values) {
            (Access::Head { write, .. }, &[value]) => write(head, value),
            (Access::Head { .. }, _) => Err(Bound::Values { found: values.len(), values: 1 }),
            _ => Err(Bound::Absent),
        }
    }

    /// Sets one of a subaperture.
    ///
    /// # Errors
    /// [`Bound`]; nothing has changed.
    pub fn write_entry(&self, head: &Head, entry: &mut Entry, found: &[f64]) -> Result<(), Bound> {
        match (self.access, entry) {
            (Access::Subaperture { values, .. } | Access::Slope { values, .. }, _)
                if found.len() != values =>
            {
                Err(Bound::Values { found: found.len(), values })
            }
            (Access::Subaperture { write, .. }, Entry::Subaperture(entry)) => {
                write(head, entry, found)
            }
            (Access::Slope { write, .. }, entry) => write(head, entry.slope_mut(), found),
            _ => Err(Bound::Absent),
        }
    }
}

/// Optical path per length ulp, m.
pub fn ulp_m(head: &Head) -> f64 {
    head.lsb_m / f64::from(1u32 << LENGTH_BITS)
}

/// Rounds `value` times `scale`, which must be within the limits.
pub(crate) fn quantise(value: f64, scale: f64, limits: [f64; 2]) -> Result<f64, Bound> {
    let [low, high] = limits;
    let rounded = (value * scale).round();
    if rounded >= low && rounded <= high {
        Ok(rounded)
    } else {
        Err(Bound::Within { found: value, limits: limits.map(|limit| limit / scale) })
    }
}

/// A whole number from 0 to `high`.
fn whole(value: f64, high: f64) -> Result<f64, Bound> {
    if value.fract() == 0.0 {
        quantise(value, 1.0, [0.0, high])
    } else {
        Err(Bound::Whole { found: value })
    }
}

macro_rules! count {
    ($name:literal, $unit:literal, $type:ty, $($field:ident).+) => {
        Parameter {
            name: $name,
            unit: $unit,
            access: Access::Head {
                read: |head| Some(f64::from(head.$($field).+)),
                write: |head, value| {
                    head.$($field).+ = whole(value, f64::from(<$type>::MAX))? as $type;
                    Ok(())
                },
            },
        }
    };
}

macro_rules! flux {
    ($name:literal, $field:ident) => {
        Parameter {
            name: $name,
            unit: "ADU, all windows together",
            access: Access::Head {
                read: |head| Some(head.quality.$field as f64 * head.adu_per_unit),
                write: |head, value| {
                    // What a double holds exactly is more than any detector gives.
                    let limits = [0.0, (1u64 << 53) as f64];
                    head.quality.$field = quantise(value, 1.0 / head.adu_per_unit, limits)? as u64;
                    Ok(())
                },
            },
        }
    };
}

macro_rules! spot_flux {
    ($name:literal, $gate:ident, $field:ident) => {
        Parameter {
            name: $name,
            unit: "ADU",
            access: Access::Slope {
                gate: Gate::$gate,
                values: 1,
                read: |head, slope| vec![f64::from(slope.$field) * head.adu_per_unit],
                write: |head, slope, values| {
                    let limits = [1.0, f64::from(u32::MAX)];
                    let units = quantise(values[0], 1.0 / head.adu_per_unit, limits)?;
                    slope.$field = units as u32;
                    Ok(())
                },
            },
        }
    };
}

const fn reference_px(name: &'static str, gate: Gate) -> Parameter {
    Parameter {
        name,
        unit: "px from the window's centre: x,y",
        access: Access::Slope {
            gate,
            values: 2,
            read: |_, slope| {
                let px = 1.0 / f64::from(1u32 << CENTROID_BITS);
                slope.reference_q16.iter().map(|&q| f64::from(q) * px).collect()
            },
            write: |_, slope, values| {
                let (scale, limit) = (f64::from(1u32 << CENTROID_BITS), f64::from(1u32 << 21));
                let q = |value| Ok(quantise(value, scale, [-limit, limit])? as i32);
                slope.reference_q16 = [q(values[0])?, q(values[1])?];
                Ok(())
            },
        },
    }
}

const fn gain_m_per_px(name: &'static str, gate: Gate) -> Parameter {
    Parameter {
        name,
        unit: "m of optical path a pixel: tip by x,tip by y,tilt by x,tilt by y",
        access: Access::Slope {
            gate,
            values: 4,
            read: |head, slope| {
                let gain = slope.gain.as_flattened().iter();
                gain.map(|&gain| f64::from(gain) * gain_m(head)).collect()
            },
            write: |head, slope, values| {
                let limits = [f64::from(i16::MIN), f64::from(i16::MAX)];
                let q = |i: usize| Ok(quantise(values[i], 1.0 / gain_m(head), limits)? as i16);
                slope.gain = [[q(0)?, q(1)?], [q(2)?, q(3)?]];
                Ok(())
            },
        },
    }
}

/// Optical path per pixel of one of a slope gain's units, m.
fn gain_m(head: &Head) -> f64 {
    ulp_m(head) * f64::from(1u32 << head.gain_exponent.min(15))
}

/// g, and f, of the control coefficients 1 - g and g f.
fn gains(entry: &Subaperture) -> [f64; 2] {
    let gain = GAIN_ONE - f64::from(entry.gains.keep);
    [gain / GAIN_ONE, f64::from(entry.gains.take) / gain]
}

fn set_gains(entry: &mut Subaperture, [gain, lever_arm]: [f64; 2]) -> Result<(), Bound> {
    let gain = quantise(gain, GAIN_ONE, [1.0, 2.0 * GAIN_ONE - 1.0])?;
    let take = (gain * lever_arm).round();
    let most = f64::from(i16::MAX);
    if !(take >= 1.0 && take <= most) {
        return Err(Bound::Within { found: lever_arm, limits: [1.0 / gain, most / gain] });
    }
    (entry.gains.keep, entry.gains.take) = ((GAIN_ONE - gain) as i16, take as i16);
    Ok(())
}

fn peak_fraction(estimator: &mut EstimatorConfig) -> Option<&mut u16> {
    match estimator {
        EstimatorConfig::CentreOfGravity { peak_fraction }
        | EstimatorConfig::Weighted { peak_fraction, .. } => Some(peak_fraction),
        EstimatorConfig::Brightest { .. } => None,
    }
}

/// All parameters.
pub static PARAMETERS: &[Parameter] = &[
    Parameter {
        name: "control.gain",
        unit: "",
        access: Access::Subaperture {
            values: 1,
            read: |_, entry| vec![gains(entry)[0]],
            write: |_, entry, values| set_gains(entry, [values[0], gains(entry)[1]]),
        },
    },
    Parameter {
        name: "control.lever_arm",
        unit: "",
        access: Access::Subaperture {
            values: 1,
            read: |_, entry| vec![gains(entry)[1]],
            write: |_, entry, values| set_gains(entry, [gains(entry)[0], values[0]]),
        },
    },
    count!("control.delay_frames", "frames", u8, control.delay),
    Parameter {
        name: "estimator.peak_fraction",
        unit: "of the last peak",
        access: Access::Head {
            read: |head| {
                let mut estimator = head.estimator;
                peak_fraction(&mut estimator).map(|fraction| f64::from(*fraction) / Q16)
            },
            write: |head, value| {
                let fraction = peak_fraction(&mut head.estimator).ok_or(Bound::Absent)?;
                *fraction = quantise(value, Q16, [0.0, 0.9 * Q16])? as u16;
                Ok(())
            },
        },
    },
    reference_px("modal.reference_px", Gate::Second),
    gain_m_per_px("modal.gain_m_per_px", Gate::Second),
    spot_flux!("modal.flux_min_adu", Second, flux_min),
    spot_flux!("modal.flux_max_adu", Second, flux_max),
    count!("pixels.saturation_adu", "ADU", u16, saturation),
    count!("safety.hold_frames", "frames", u16, ladder.hold_frames),
    count!("safety.safe_frames", "frames", u16, ladder.safe_frames),
    count!("safety.saturated_actuators", "actuators", u16, ladder.saturated_actuators),
    count!("safety.saturated_frames", "frames", u16, ladder.saturated_frames),
    count!("safety.saturated_pixels_max", "pixels", u32, quality.saturated_pixels_max),
    count!("safety.valid_min", "subapertures", u16, quality.valid_min),
    flux!("safety.flux_min_adu", flux_min),
    flux!("safety.flux_max_adu", flux_max),
    Parameter {
        name: "safety.leak",
        unit: "of the way to flat, a frame",
        access: Access::Head {
            read: |head| Some(f64::from(head.ladder.leak_q16) / Q16),
            write: |head, value| {
                head.ladder.leak_q16 = quantise(value, Q16, [0.0, Q16 - 1.0])? as u16;
                Ok(())
            },
        },
    },
    Parameter {
        name: "schedule.colour",
        unit: "sub-cycle",
        access: Access::Subaperture {
            values: 1,
            read: |_, entry| vec![f64::from(entry.colour)],
            write: |_, entry, values| {
                entry.colour = whole(values[0], f64::from(u8::MAX))? as u8;
                Ok(())
            },
        },
    },
    Parameter {
        name: "segments.slew_m_per_frame",
        unit: "m of optical path a frame",
        access: Access::Head {
            read: |head| Some(f64::from(head.slew_ulp) * ulp_m(head)),
            write: |head, value| {
                let limits = [1.0, f64::from(i32::MAX)];
                head.slew_ulp = quantise(value, 1.0 / ulp_m(head), limits)? as i32;
                Ok(())
            },
        },
    },
    count!("serials.mirror", "0 for any", u32, serials.mirror),
    count!("serials.detector", "0 for any", u32, serials.detector),
    reference_px("slopes.reference_px", Gate::First),
    gain_m_per_px("slopes.gain_m_per_px", Gate::First),
    spot_flux!("slopes.flux_min_adu", First, flux_min),
    spot_flux!("slopes.flux_max_adu", First, flux_max),
    count!("sor.sweeps", "", u16, sweeps),
    count!("sor.cold_sweeps", "", u16, cold_sweeps),
    Parameter {
        name: "sor.omega",
        unit: "",
        access: Access::Head {
            read: |head| Some(head.omega),
            write: |head, value| {
                head.omega = value;
                Ok(())
            },
        },
    },
];
