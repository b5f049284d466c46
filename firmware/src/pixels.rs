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
//! Without a flat field (no pixel's gain differs) and with the subtracting convention this is
//! s = max(raw - (floor + excess), 0), which the packed kernels of the `dsp` module compute.
//!
//! Peak and saturated pixels are looked for where the spot is: in [`WATCHED`] pixels next to the last
//! centroid, of the row nearest it. They cost more than the moments, and what a moving threshold has to
//! follow is the spot, not a hit in the window's corner.
//!
//! Scaling and overflow: every quantity is a u16 and every operation saturating or exact;
//! rounding of the gain is to nearest, ties down in `b` (ties up in the loss).

use crate::fixed::{self, positive};
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

/// Pixels of a window in which its peak is looked for, in the row nearest the last centroid: from an even column
/// on, with the centroid next to their middle, as far as the window goes. A spot is two pixels wide at half maximum
/// where a pixel is lambda/2d, so that this row has 84 % of its peak at least; of it all pixels are watched that are
/// nearer to the last centroid than a pixel and a half.
pub const WATCHED: usize = 4;

/// The calibration of one pixel, as it is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelCalibration {
    /// ADU below which a raw value is no signal; the highest raw value for a bad pixel.
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
    /// Highest raw value, and floor of a bad pixel: none exceeds it.
    pub(crate) top: u16,
    /// Whether some pixel has a loss.
    pub(crate) flat_field: bool,
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

/// What the watched pixels of a window told besides the signal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Noted {
    /// Largest signal: 16 bits.
    pub(crate) peak: i32,
    /// Pixels with a signal whose raw value is at or above the saturation level.
    pub(crate) saturated: u16,
}

impl<const P: usize> Bank<P> {
    /// A bank without pixels.
    pub(crate) const fn new() -> Self {
        Self {
            floor: heapless::Vec::new(),
            loss: heapless::Vec::new(),
            threshold: heapless::Vec::new(),
            threshold_shift: 0,
            saturation: 0,
            convention: Convention::Subtract,
            top: 0,
            flat_field: false,
        }
    }

    pub(crate) fn clear(&mut self) {
        self.flat_field = false;
        self.floor.clear();
        self.loss.clear();
        self.threshold.clear();
    }

    /// Appends a pixel; the caller has checked that at most `P` are appended.
    pub(crate) fn push(&mut self, pixel: PixelCalibration) {
        // Cannot fail below the capacity, which `Config::build` checks first.
        self.push_floor(pixel.floor);
        self.push_loss(pixel.loss);
        self.push_threshold(pixel.threshold);
    }

    pub(crate) fn push_floor(&mut self, floor: u16) {
        let _ = self.floor.push(floor);
    }

    pub(crate) fn push_loss(&mut self, loss: u16) {
        self.flat_field |= loss != 0;
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

    pub(crate) fn floors_mut(&mut self) -> &mut [u16] {
        &mut self.floor
    }

    /// [`Bank::find_flat_field`] is due behind a change.
    pub(crate) fn losses_mut(&mut self) -> &mut [u16] {
        &mut self.loss
    }

    pub(crate) fn thresholds_mut(&mut self) -> &mut [u8] {
        &mut self.threshold
    }

    pub(crate) fn find_flat_field(&mut self) {
        self.flat_field = self.loss.iter().any(|&loss| loss != 0);
    }

    /// The `window` pixels from place `start`: of window k and its row y, k W^2 + y W.
    #[inline(always)]
    pub(crate) fn row(&self, start: usize, window: usize) -> Option<BankRow<'_>> {
        let end = start.wrapping_add(window);
        Some(BankRow {
            floor: self.floor.get(start..end)?,
            loss: self.loss.get(start..end)?,
            threshold: self.threshold.get(start..end)?,
        })
    }

    /// The floors of windows `first .. next`, `area` each, one window after the other.
    #[inline(always)]
    pub(crate) fn floors_of(&self, first: usize, next: usize, area: usize) -> &[u16] {
        let all = first.wrapping_mul(area)..next.wrapping_mul(area);
        // Beyond the end, where a validated configuration never asks, there are no windows.
        self.floor.get(all).unwrap_or_default()
    }

    /// Whether signals are raw values less a floor.
    #[inline(always)]
    pub(crate) fn only_floors(&self) -> bool {
        self.convention == Convention::Subtract && !self.flat_field
    }

    /// What all cuts of this bank share.
    #[inline(always)]
    pub(crate) fn cut(&self, excess: u16) -> Cut {
        Cut {
            convention: self.convention,
            shift: self.threshold_shift,
            top: self.top,
            saturation: self.saturation,
            excess,
        }
    }
}

/// What a window's watched pixels told besides the signal, those of even columns and those of odd ones: lanes
/// of the packed kernels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Seen {
    pub(crate) peak: [u16; 2],
    pub(crate) saturated: [u16; 2],
}

impl Seen {
    pub(crate) const NOTHING: Self = Self { peak: [0; 2], saturated: [0; 2] };

    /// Of watched pixels.
    #[inline(always)]
    pub(crate) fn of(signal: impl Iterator<Item = u32>, raw: &[u16], cut: Cut) -> Self {
        // The highest level that is not saturated: what is above takes one comparison.
        let grey = i32::from(cut.saturation.wrapping_sub(1));
        let (mut peak, mut saturated) = (0, 0);
        for (signal, &raw) in signal.zip(raw) {
            let signal = signal as i32;
            peak = fixed::larger(signal, peak);
            saturated += i32::from(i32::from(raw) > grey) & i32::from(signal > 0);
        }
        Self { peak: [peak as u16, 0], saturated: [saturated as u16, 0] }
    }

    /// The whole window.
    #[inline(always)]
    pub(crate) fn all(&self) -> Noted {
        let ([even, odd], [white, more]) = (self.peak.map(i32::from), self.saturated);
        Noted { peak: fixed::larger(even, odd), saturated: white.wrapping_add(more) }
    }
}

/// What is taken off a calibrated pixel, for one window and frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cut {
    pub(crate) convention: Convention,
    /// Binary exponent of the stored thresholds.
    pub(crate) shift: u32,
    /// Highest raw value: what a packed kernel's lanes must hold.
    #[cfg_attr(
        not(any(armv7em, target_arch = "riscv32", test)),
        allow(dead_code, reason = "no kernel asks for it")
    )]
    pub(crate) top: u16,
    /// Raw value from which a pixel counts as saturated, ADU; at least 1.
    pub(crate) saturation: u16,
    /// See the module.
    pub(crate) excess: u16,
}

/// One window row of signal, in whichever convention.
#[inline(always)]
pub(crate) fn signal(raw: &[u16], row: BankRow<'_>, cut: Cut, signal: &mut [u16]) {
    #[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
    if raw.len().is_multiple_of(crate::dsp::sse2::LANES) {
        return crate::dsp::sse2::signal(raw, row, cut, signal);
    }
    portable_signal(raw, row, cut, signal);
}

/// [`signal`] without vector instructions.
#[inline(always)]
pub(crate) fn portable_signal(raw: &[u16], row: BankRow<'_>, cut: Cut, signal: &mut [u16]) {
    match cut.convention {
        Convention::Subtract => calibrate(raw, row, cut.excess, signal),
        Convention::ZeroBelow => calibrate_zero_below(raw, row, cut.shift, cut.excess, signal),
    }
}

/// Looks at the watched pixels of a window row, from column `first` on. All there in a validated configuration and a
/// row of the right length.
#[inline(always)]
pub(crate) fn watch(raw: &[u16], row: BankRow<'_>, first: usize, cut: Cut) -> Option<Seen> {
    let watched = first..first.wrapping_add(WATCHED);
    let raw = raw.get(watched.clone())?;
    let row = BankRow {
        floor: row.floor.get(watched.clone())?,
        loss: row.loss.get(watched.clone())?,
        threshold: row.threshold.get(watched)?,
    };
    let mut signal = [0; WATCHED];
    portable_signal(raw, row, cut, &mut signal);
    Some(Seen::of(signal.iter().map(|&s| u32::from(s)), raw, cut))
}

/// Takes the floor off one window row, applies the flat field and takes off `excess`.
///
/// `raw`, the calibration and `signal` have the window's width; a shorter one ends the row.
#[inline(always)]
pub fn calibrate(raw: &[u16], row: BankRow<'_>, excess: u16, signal: &mut [u16]) {
    for (((&raw, &floor), &loss), signal) in raw.iter().zip(row.floor).zip(row.loss).zip(signal) {
        *signal = less(flat_field(less(raw, floor), loss), excess);
    }
}

/// As [`calibrate`], with the zero-below convention: a pixel passes whole or not at all.
#[inline(always)]
pub fn calibrate_zero_below(
    raw: &[u16],
    row: BankRow<'_>,
    shift: u32,
    excess: u16,
    signal: &mut [u16],
) {
    let pixels = raw.iter().zip(row.floor).zip(row.loss).zip(row.threshold).zip(signal);
    for ((((&raw, &floor), &loss), &threshold), signal) in pixels {
        let flat = flat_field(less(raw, floor), loss);
        // A u8 shifted by at most 8 fits u16; their sum may not.
        let limit = (u32::from(threshold) << shift) + u32::from(excess);
        let passes = (limit.wrapping_sub(u32::from(flat)) >> 31) as u16;
        *signal = flat.wrapping_mul(passes);
    }
}

/// `a (1 - loss / 2^16)`, rounded. Written as two 16-bit halves of one product, which vector
/// units of every PC have; `b <= a`, so that nothing overflows.
#[inline(always)]
fn flat_field(a: u16, loss: u16) -> u16 {
    let high = ((u32::from(a) * u32::from(loss)) >> 16) as u16;
    let low = a.wrapping_mul(loss);
    a.wrapping_sub(high).wrapping_sub(low >> 15)
}

/// max(a - b, 0).
#[inline(always)]
pub(crate) fn less(a: u16, b: u16) -> u16 {
    positive(i32::from(a) - i32::from(b)) as u16
}
