//! One change of a configuration, in the integers that the frame path has: what a PC that knows the
//! physical units sends.
//!
//! | adjustment | what can change |
//! |---|---|
//! | `Head` | estimator, sweeps, omega, delay, slew limit, gate, limits of frame quality and ladder, saturation level, scales |
//! | `Subaperture` | gain and lever arm, reference slope, 2 x 2 gain, flux limits, flat map, height limits, matrix, mean threshold, sub-cycle |
//! | `Template` | one of the eight rows of the weight |
//! | `Floors`, `Losses`, `Thresholds` | of window pixels, in the bank's order |
//! | `Calibration` | the record of a calibration |
//! | `SecondGate` | of a subaperture in the second gate: reference slope, 2 x 2 gain, flux limits, mean threshold |
//! | `Gradients`, `Coupling` | of the [modes](crate::modal) |
//!
//! Mask, windows, gates and detector change by whole images only: the pixels' order follows from them.
//! An adjustment is refused by the bounds by which an image is, and then changes nothing.

use crate::calibration::Calibration;
use crate::centroid::TEMPLATE;
use crate::config::Config;
use crate::error::{ConfigError, Field};
use crate::image::{Head, SecondGate, Subaperture};
use crate::modal::{MAX_MODES, ModalConfig};
use core::fmt;
use serde::{Deserialize, Serialize};

/// Pixels in an adjustment.
pub const PIXELS: usize = 64;

/// A change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "without allocation nothing can be put elsewhere")]
pub enum Adjustment {
    /// What is there once.
    Head(Head),
    /// What is there once a subaperture.
    Subaperture {
        /// In mask order.
        index: u16,
        /// All of it.
        entry: Subaperture,
    },
    /// A row of the weighted estimator's template.
    Template {
        /// Which eighth of a pixel, 0 to 7.
        phase: u8,
        /// All of the row, Q8.
        samples: heapless::Vec<u8, TEMPLATE>,
    },
    /// Raw values below which pixels have no signal.
    Floors {
        /// Place of the first in the bank.
        first: u32,
        /// ADU.
        values: heapless::Vec<u16, PIXELS>,
    },
    /// What the flat field takes from pixels.
    Losses {
        /// Place of the first in the bank.
        first: u32,
        /// 2^16 times it.
        values: heapless::Vec<u16, PIXELS>,
    },
    /// Thresholds of the zero-below convention.
    Thresholds {
        /// Place of the first in the bank.
        first: u32,
        /// In units of 2^`threshold_shift`.
        values: heapless::Vec<u8, PIXELS>,
    },
    /// The record of a calibration.
    Calibration(Option<Calibration>),
    /// What there is once a subaperture for a second gate.
    SecondGate {
        /// In mask order.
        index: u16,
        /// All of it.
        entry: SecondGate,
    },
    /// Gradients of all modes at one subaperture.
    Gradients {
        /// In mask order.
        index: u16,
        /// x and y of each mode.
        values: heapless::Vec<[i16; 2], MAX_MODES>,
    },
    /// What one mode takes of the others.
    Coupling {
        /// Which mode, from 0 on.
        row: u8,
        /// Of a and b of each mode, Q12.
        values: heapless::Vec<[i32; 2], MAX_MODES>,
    },
}

/// What an [`Adjustment`] changes, and a value can be asked of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Parameter {
    /// [`Adjustment::Head`].
    Head,
    /// [`Adjustment::Subaperture`].
    Subaperture {
        /// In mask order.
        index: u16,
    },
    /// [`Adjustment::Template`].
    Template {
        /// 0 to 7.
        phase: u8,
    },
    /// [`Adjustment::Floors`], up to [`PIXELS`].
    Floors {
        /// Place of the first in the bank.
        first: u32,
    },
    /// [`Adjustment::Losses`], up to [`PIXELS`].
    Losses {
        /// Place of the first in the bank.
        first: u32,
    },
    /// [`Adjustment::Thresholds`], up to [`PIXELS`].
    Thresholds {
        /// Place of the first in the bank.
        first: u32,
    },
    /// [`Adjustment::Calibration`].
    Calibration,
    /// [`Adjustment::SecondGate`].
    SecondGate {
        /// In mask order.
        index: u16,
    },
    /// [`Adjustment::Gradients`].
    Gradients {
        /// In mask order.
        index: u16,
    },
    /// [`Adjustment::Coupling`].
    Coupling {
        /// Which mode, from 0 on.
        row: u8,
    },
}

/// Why an adjustment was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum AdjustError {
    /// There is no configuration to change.
    NotConfigured,
    /// Mask, windows and detector change by whole images only.
    Geometry,
    /// There are fewer entries than that.
    Place {
        /// First entry that there is not.
        found: u32,
        /// How many there are.
        entries: u32,
    },
    /// A value is out of its limits.
    Value(ConfigError),
}

impl From<ConfigError> for AdjustError {
    fn from(error: ConfigError) -> Self {
        Self::Value(error)
    }
}

impl fmt::Display for AdjustError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotConfigured => f.write_str("no configuration to adjust"),
            Self::Geometry => {
                f.write_str("mask, windows and detector can be changed by a whole image only")
            }
            Self::Place { found, entries } => write!(f, "entry {found}: there are {entries}"),
            Self::Value(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for AdjustError {}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Config<M, P, B, K> {
    /// Makes one change. What follows from it is brought up to date by [`Config::settle`], without
    /// which no frame may be run.
    pub(crate) fn adjust(&mut self, adjustment: &Adjustment) -> Result<(), AdjustError> {
        let mask = self.mask.ok_or(AdjustError::NotConfigured)?;
        match adjustment {
            Adjustment::Head(head) => {
                let geometry = |h: &Head| (h.across, h.width, h.height, h.window, h.bits);
                if geometry(head) != geometry(&self.head(&mask)) {
                    return Err(AdjustError::Geometry);
                }
                self.set_head(head, mask.count())?;
            }
            Adjustment::Subaperture { index, entry } => {
                let i = usize::from(*index);
                if i >= self.subapertures() {
                    return Err(place(i, self.subapertures()));
                }
                entry.check(i, self.drive)?;
                put(self.base_thresholds.get_mut(i), entry.base_threshold);
                put(self.slopes.get_mut(i), entry.slope);
                self.set_gains(i, entry.gains);
                put(self.schedule.colours.get_mut(i), entry.colour);
                put(self.segments.get_mut(i), entry.segment);
                put(self.responses.get_mut(i), entry.responses);
            }
            Adjustment::Template { phase, samples } => {
                let (i, phases) = (usize::from(*phase), self.template.samples.len());
                let row = self.template.samples.get_mut(i).ok_or(place(i, phases))?;
                *row = samples.as_slice().try_into().map_err(|_| place(samples.len(), TEMPLATE))?;
            }
            Adjustment::Floors { first, values } => {
                let top = self.bank.top;
                for (i, &floor) in values.iter().enumerate() {
                    let i = Some((*first as usize).saturating_add(i));
                    ConfigError::check(Field::Dark, i, floor.into(), (0.0, top.into()))?;
                }
                replace(self.bank.floors_mut(), *first, values)?;
            }
            Adjustment::Losses { first, values } => {
                replace(self.bank.losses_mut(), *first, values)?;
                self.bank.find_flat_field();
            }
            Adjustment::Thresholds { first, values } => {
                replace(self.bank.thresholds_mut(), *first, values)?;
            }
            Adjustment::Calibration(calibration) => self.calibrated = *calibration,
            Adjustment::SecondGate { index, entry } => {
                let i = usize::from(*index);
                let window = self.second_window(i).ok_or(place(i, self.second_entries()))?;
                entry.check(i)?;
                put(self.base_thresholds.get_mut(window), entry.base_threshold);
                put(self.slopes.get_mut(window), entry.slope);
            }
            Adjustment::Gradients { index, values } => {
                let i = usize::from(*index);
                self.second_window(i).ok_or(place(i, self.second_entries()))?;
                let all = self.modal.of_mut(i);
                let entries = all.len();
                let all = (entries == values.len()).then_some(all);
                let all = all.ok_or(place(values.len(), entries))?;
                all.iter_mut().zip(values).for_each(|(to, &value)| *to = value);
            }
            Adjustment::Coupling { row, values } => {
                let (k, modes) = (usize::from(*row), self.modes());
                let to = self.modal.row_mut(k).ok_or(place(k, modes))?;
                if values.len() != modes {
                    return Err(place(values.len(), modes));
                }
                for (j, &value) in values.as_flattened().iter().enumerate() {
                    ModalConfig::<M, K>::check_coupling(value, 2 * modes * k + j)?;
                }
                to.iter_mut().zip(values).for_each(|(to, &value)| *to = value);
            }
        }
        Ok(())
    }

    /// The present value of a parameter, as the adjustment that would set it.
    ///
    /// # Errors
    /// [`AdjustError::NotConfigured`], [`AdjustError::Place`].
    pub fn value(&self, parameter: Parameter) -> Result<Adjustment, AdjustError> {
        let mask = self.mask.as_ref().ok_or(AdjustError::NotConfigured)?;
        let bank = &self.bank;
        Ok(match parameter {
            Parameter::Head => Adjustment::Head(self.head(mask)),
            Parameter::Subaperture { index } => {
                let i = usize::from(index);
                let entry = self.subaperture(i).ok_or(place(i, self.subapertures()))?;
                Adjustment::Subaperture { index, entry }
            }
            Parameter::Template { phase } => {
                let (i, samples) = (usize::from(phase), &self.template.samples);
                let row = samples.get(i).ok_or(place(i, samples.len()))?;
                Adjustment::Template { phase, samples: row.iter().copied().collect() }
            }
            Parameter::Floors { first } => {
                Adjustment::Floors { first, values: from(bank.floors(), first)? }
            }
            Parameter::Losses { first } => {
                Adjustment::Losses { first, values: from(bank.losses(), first)? }
            }
            Parameter::Thresholds { first } => {
                Adjustment::Thresholds { first, values: from(bank.thresholds(), first)? }
            }
            Parameter::Calibration => Adjustment::Calibration(self.calibrated),
            Parameter::SecondGate { index } => {
                let i = usize::from(index);
                let entry = self.second_gate(i).ok_or(place(i, self.second_entries()))?;
                Adjustment::SecondGate { index, entry }
            }
            Parameter::Gradients { index } => {
                let i = usize::from(index);
                self.second_window(i).ok_or(place(i, self.second_entries()))?;
                // There is room for every mode.
                let values = heapless::Vec::from_slice(self.modal.of(i)).unwrap_or_default();
                Adjustment::Gradients { index, values }
            }
            Parameter::Coupling { row } => {
                let k = usize::from(row);
                let values = self.modal.rows().nth(k).ok_or(place(k, self.modes()))?;
                let values = heapless::Vec::from_slice(values).unwrap_or_default();
                Adjustment::Coupling { row, values }
            }
        })
    }

    /// Entries that there are one a subaperture for a second gate.
    fn second_entries(&self) -> usize {
        self.windows().saturating_sub(self.subapertures())
    }
}

fn put<T>(place: Option<&mut T>, value: T) {
    if let Some(place) = place {
        *place = value;
    }
}

fn place(found: usize, entries: usize) -> AdjustError {
    let count = |n| u32::try_from(n).unwrap_or(u32::MAX);
    AdjustError::Place { found: count(found), entries: count(entries) }
}

/// Puts values in place of those from `first` on, if there are as many.
fn replace<T: Copy>(all: &mut [T], first: u32, values: &[T]) -> Result<(), AdjustError> {
    let (entries, end) = (all.len(), (first as usize).saturating_add(values.len()));
    let places = all.get_mut(first as usize..end).ok_or(place(end.saturating_sub(1), entries))?;
    places.iter_mut().zip(values).for_each(|(to, &value)| *to = value);
    Ok(())
}

/// Up to [`PIXELS`] values from `first` on.
fn from<T: Copy>(all: &[T], first: u32) -> Result<heapless::Vec<T, PIXELS>, AdjustError> {
    let rest = all.get(first as usize..).filter(|rest| !rest.is_empty());
    let rest = rest.ok_or(place(first as usize, all.len()))?;
    Ok(rest.iter().copied().take(PIXELS).collect())
}
