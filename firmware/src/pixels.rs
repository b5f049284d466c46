//! Pixels: raw detector values of one window row to calibrated, thresholded signal.
//!
//! Order per pixel: dark, gain (flat field), threshold.
//!
//! ```text
//! a = max(raw - floor, 0)                       u16, saturating
//! b = a - round(a loss / 2^16)                  u16: times 1 - loss/2^16, the flat field
//! s = max(b - excess, 0)          (subtract)    u16
//! s = b if b > threshold + excess else 0        (zero below)
//! ```
//!
//! * `floor` is the dark level; with the subtracting convention the pixel's own threshold is
//!   folded into it (threshold divided by the gain, since it acts after the gain). A bad pixel
//!   has floor 65535: it never shows a signal and never counts as saturated.
//! * Gains are divided by the largest of the windows, so that they lie in (0, 1] and no product
//!   can overflow or saturate; that largest gain is part of the unit of `s` (see
//!   [`crate::config::Config::adu_per_unit`]).
//! * `excess` is the amount by which a subaperture's moving threshold (a fraction of its previous
//!   peak) exceeds its fixed one, u16, one value a window and frame.
//!
//! Scaling and overflow: every quantity is a u16 and every operation saturating or exact;
//! rounding of the gain is to nearest, ties down in `b` (ties up in the loss).

use serde::{Deserialize, Serialize};

/// What becomes of a pixel at or below its threshold, and of one above it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Convention {
    /// The threshold is subtracted, and what falls below zero is zero.
    #[default]
    Subtract,
    /// Pixels at or below the threshold are zero; the others keep their whole signal.
    ZeroBelow,
}

/// Floor of a bad pixel: no raw value exceeds it.
pub const BAD: u16 = u16::MAX;

/// The calibration of one pixel, as it is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelCalibration {
    /// ADU below which a raw value is no signal.
    pub floor: u16,
    /// 2^16 times what the flat field takes away.
    pub loss: u16,
    /// Threshold of the zero-below convention, in units of 2^shift calibrated ADU.
    pub threshold: u8,
}

/// The detector calibration of every window pixel: five bytes a pixel.
///
/// Shape: window slot (in readout order), window row, column.
#[derive(Debug)]
pub struct Bank<const P: usize> {
    floor: heapless::Vec<u16, P>,
    loss: heapless::Vec<u16, P>,
    threshold: heapless::Vec<u8, P>,
    /// Binary exponent of the stored thresholds.
    pub(crate) threshold_shift: u32,
    /// Raw value from which a pixel counts as saturated, ADU.
    pub(crate) saturation: u16,
    /// The convention.
    pub(crate) convention: Convention,
}

/// One window row of the bank.
#[derive(Clone, Copy, Debug)]
pub struct BankRow<'a> {
    /// See [`PixelCalibration::floor`].
    pub floor: &'a [u16],
    /// See [`PixelCalibration::loss`].
    pub loss: &'a [u16],
    /// See [`PixelCalibration::threshold`].
    pub threshold: &'a [u8],
}

/// What a row tells about its pixels besides the signal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RowPixels {
    /// Largest calibrated value `b` of the row, before the excess is taken off.
    pub peak: u16,
    /// Pixels at or above the saturation level.
    pub saturated: u16,
}

impl<const P: usize> Bank<P> {
    /// A bank without pixels.
    pub(crate) const fn new() -> Self {
        Self {
            floor: heapless::Vec::new(),
            loss: heapless::Vec::new(),
            threshold: heapless::Vec::new(),
            threshold_shift: 0,
            saturation: u16::MAX,
            convention: Convention::Subtract,
        }
    }

    pub(crate) fn clear(&mut self) {
        self.floor.clear();
        self.loss.clear();
        self.threshold.clear();
    }

    /// Appends a pixel; the caller has checked that at most `P` are appended.
    pub(crate) fn push(&mut self, pixel: PixelCalibration) {
        // Cannot fail below the capacity, which `Config::build` checks first.
        let _ = self.floor.push(pixel.floor);
        let _ = self.loss.push(pixel.loss);
        let _ = self.threshold.push(pixel.threshold);
    }

    pub(crate) fn push_floor(&mut self, floor: u16) {
        let _ = self.floor.push(floor);
    }

    pub(crate) fn push_loss(&mut self, loss: u16) {
        let _ = self.loss.push(loss);
    }

    pub(crate) fn push_threshold(&mut self, threshold: u8) {
        let _ = self.threshold.push(threshold);
    }

    pub(crate) fn floors(&self) -> &[u16] {
        &self.floor
    }

    pub(crate) fn losses(&self) -> &[u16] {
        &self.loss
    }

    pub(crate) fn thresholds(&self) -> &[u8] {
        &self.threshold
    }

    /// The pixels of windows `first .. next`, `area` each, one window after the other.
    #[inline(always)]
    pub(crate) fn windows(
        &self,
        first: usize,
        next: usize,
        area: usize,
    ) -> impl Iterator<Item = BankRow<'_>> {
        let area = area.max(1);
        let all = first.wrapping_mul(area)..next.wrapping_mul(area);
        // Beyond the end, where a validated configuration never asks, there are no windows.
        let floor = self.floor.get(all.clone()).unwrap_or_default().chunks_exact(area);
        let loss = self.loss.get(all.clone()).unwrap_or_default().chunks_exact(area);
        let threshold = self.threshold.get(all).unwrap_or_default().chunks_exact(area);
        floor.zip(loss).zip(threshold).map(|((floor, loss), threshold)| BankRow {
            floor,
            loss,
            threshold,
        })
    }
}

impl BankRow<'_> {
    /// The `window` pixels from place `start` of these.
    #[inline(always)]
    pub(crate) fn part(&self, start: usize, window: usize) -> Option<Self> {
        let end = start.wrapping_add(window);
        Some(Self {
            floor: self.floor.get(start..end)?,
            loss: self.loss.get(start..end)?,
            threshold: self.threshold.get(start..end)?,
        })
    }
}

/// Lanes in which peaks and saturated pixels of a window are gathered: those of the packed kernels.
const LANES: usize = if cfg!(all(target_arch = "x86_64", target_feature = "sse2")) { 8 } else { 1 };

/// What a window's rows told about its pixels besides the signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Seen {
    pub(crate) peak: [u16; LANES],
    pub(crate) saturated: [u16; LANES],
}

impl Seen {
    pub(crate) const NOTHING: Self = Self { peak: [0; LANES], saturated: [0; LANES] };

    /// Adds a row.
    #[inline(always)]
    pub(crate) fn note(&mut self, row: RowPixels) {
        let [peak, ..] = &mut self.peak;
        *peak = (*peak).max(row.peak);
        let [saturated, ..] = &mut self.saturated;
        *saturated = saturated.wrapping_add(row.saturated);
    }

    /// The whole window.
    #[inline]
    pub(crate) fn all(&self) -> RowPixels {
        RowPixels {
            peak: self.peak.into_iter().fold(0, u16::max),
            saturated: self.saturated.into_iter().fold(0, u16::wrapping_add),
        }
    }
}

/// What is taken off a calibrated pixel, for one window and frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cut {
    pub(crate) convention: Convention,
    /// Binary exponent of the stored thresholds.
    pub(crate) shift: u32,
    /// See the module.
    pub(crate) excess: u16,
    /// Raw value from which a pixel counts as saturated, ADU.
    pub(crate) saturation: u16,
}

/// One window row of signal, in whichever convention.
#[inline(always)]
pub(crate) fn signal(raw: &[u16], row: BankRow<'_>, cut: Cut, seen: &mut Seen, signal: &mut [u16]) {
    #[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
    if raw.len().is_multiple_of(LANES) {
        return crate::dsp::sse2::signal(raw, row, cut, seen, signal);
    }
    let Cut { convention, shift, excess, saturation } = cut;
    seen.note(match convention {
        Convention::Subtract => calibrate(raw, row, excess, saturation, signal),
        Convention::ZeroBelow => calibrate_zero_below(raw, row, shift, excess, saturation, signal),
    });
}

/// Takes `excess` and the floor off one window row and applies the flat field.
///
/// `raw`, the calibration and `signal` have the window's width; a shorter one ends the row.
#[inline(always)]
pub fn calibrate(
    raw: &[u16],
    row: BankRow<'_>,
    excess: u16,
    saturation: u16,
    signal: &mut [u16],
) -> RowPixels {
    let mut peak = 0;
    let mut saturated = 0u16;
    for (((&raw, &floor), &loss), signal) in raw.iter().zip(row.floor).zip(row.loss).zip(signal) {
        let flat = flat_field(raw.saturating_sub(floor), loss);
        *signal = flat.saturating_sub(excess);
        peak = peak.max(flat);
        saturated = saturated.wrapping_add(is_saturated(raw, floor, saturation));
    }
    RowPixels { peak, saturated }
}

/// As [`calibrate`], with the zero-below convention: a pixel passes whole or not at all.
#[inline(always)]
pub fn calibrate_zero_below(
    raw: &[u16],
    row: BankRow<'_>,
    shift: u32,
    excess: u16,
    saturation: u16,
    signal: &mut [u16],
) -> RowPixels {
    let mut peak = 0;
    let mut saturated = 0u16;
    let pixels = raw.iter().zip(row.floor).zip(row.loss).zip(row.threshold).zip(signal);
    for ((((&raw, &floor), &loss), &threshold), signal) in pixels {
        let flat = flat_field(raw.saturating_sub(floor), loss);
        // A u8 shifted by at most 8 fits u16.
        let limit = u16::from(threshold).wrapping_shl(shift).saturating_add(excess);
        *signal = if flat > limit { flat } else { 0 };
        peak = peak.max(flat);
        saturated = saturated.wrapping_add(is_saturated(raw, floor, saturation));
    }
    RowPixels { peak, saturated }
}

/// `a (1 - loss / 2^16)`, rounded. Written as two 16-bit halves of one product, which vector
/// units of every PC have; `b <= a`, so that nothing overflows.
#[inline(always)]
fn flat_field(a: u16, loss: u16) -> u16 {
    let high = ((u32::from(a) * u32::from(loss)) >> 16) as u16;
    let low = a.wrapping_mul(loss);
    a.wrapping_sub(high).wrapping_sub(low >> 15)
}

#[inline(always)]
fn is_saturated(raw: u16, floor: u16, saturation: u16) -> u16 {
    u16::from(raw >= saturation) & u16::from(floor != BAD)
}
