//! What becomes of windows whose rows are in, in RISC-V's own instructions: measurement, what the next frame does
//! with the window, slope and pseudo-open-loop slope of one after the other.
//!
//! [`crate::readout`], [`crate::slopes`] and [`crate::control`] say what these are. Here nothing is stored and read
//! again in between, and there is one loop in place of two.

use crate::centroid::Measurement;
use crate::control::{GUARD_BITS, Taking};
use crate::inverse::{Cell, INVERSES, SPARE_BITS};
use crate::pixels::Seen;
use crate::readout::{Tracking, Window};
use crate::slopes::{HEADROOM, Slope, SlopeCalibration, SlopeScale};
use crate::sor::Node;
use core::arch::asm;
use core::mem::offset_of;

/// What there is of each window.
pub(crate) struct Spots<'a, const M: usize> {
    pub(crate) windows: &'a [Window],
    pub(crate) tracking: &'a [Tracking],
    pub(crate) next: &'a mut [Tracking],
    pub(crate) limits: &'a [Limits<M>],
    pub(crate) measurements: &'a mut [Measurement],
    /// Of the last peak, Q16.
    pub(crate) peak_fraction: u16,
}

/// What a configuration has for a window, in the form in which it is needed here.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits<const M: usize> {
    /// If thresholds are low, what the next moving one has beyond the fixed one, Q16, but for the peak times its
    /// fraction: half of the last place, and the fixed one's fraction less the fixed one. Else the fixed one.
    threshold: i32,
    /// Valid fluxes from the least one on.
    flux_span: u32,
    /// Rows tip and tilt, columns x and y: as of [`SlopeScale::factor`].
    gain: [[i32; 2]; 2],
    /// Bytes before the place of its subaperture's node among 2 `M` slopes.
    place: u32,
}

impl<const M: usize> Limits<M> {
    /// Of a fixed threshold, below 2^15 if it is `low`.
    pub(crate) fn new(
        (base, low): (u16, bool),
        peak_fraction: u16,
        (slope, scale): (&SlopeCalibration, SlopeScale),
        node: &Node,
    ) -> Self {
        let base = i32::from(base);
        let threshold = match low {
            // Above -2^31: at most 2^15 - 1 times 2^16.
            true => (1 << 15) - base * ((1 << 16) - i32::from(peak_fraction)),
            false => base,
        };
        let flux_span = slope.flux_max.wrapping_sub(slope.flux_min).wrapping_add(1);
        // Never more, which memory safety relies on.
        let place = node.place.index().min((2 * M).saturating_sub(1)) * size_of::<[i32; 2]>();
        Self {
            threshold,
            flux_span,
            gain: slope.gain.map(|row| row.map(|gain| scale.factor(gain))),
            place: place as u32,
        }
    }
}

/// What there is of each one's subaperture.
pub(crate) struct Subapertures<'a, const M: usize> {
    pub(crate) calibration: &'a [SlopeCalibration],
    pub(crate) applied: &'a [[i32; 2]],
    pub(crate) slopes: &'a mut [Slope],
    pub(crate) taking: Taking<'a, M>,
    pub(crate) saturated_pixels: &'a mut u32,
}

const _: () = assert!(
    offset_of!(Measurement, centroid_q16) == 0
        && size_of::<Cell>() == 8
        && offset_of!(Cell, start) == 0
        // Two lanes.
        && size_of::<Seen>() == 8
        && SPARE_BITS == 6
);

/// Windows a turn.
const TURN: usize = 4;

/// Bits of a small flux.
const SMALL_BITS: u32 = 18;

/// Whether all fluxes of windows with `pixels` up to `top` are below 2^18.
pub(crate) const fn are_small(pixels: usize, top: u16) -> bool {
    pixels * (top as usize) < 1 << SMALL_BITS
}

/// Of numbers of nine bits, the leading zeros among nine, and as many and 8: a small flux has these at least, beside
/// those that all have.
static LEADING_ZEROS: [[u8; 512]; 2] = {
    let more = (u32::BITS - SPARE_BITS - SMALL_BITS) as u8;
    let mut zeros = [[0; 512]; 2];
    let mut x = 0;
    while x < 512 {
        let few = (x as u32).leading_zeros() as u8 - 23;
        zeros[0][x] = few;
        zeros[1][x] = few + more;
        x += 1;
    }
    zeros
};

/// Takes up to 64 windows of an even number of columns and rows, of signals above floors, with slopes that
/// need no limits and gains without a shift to the left; if `LOW`, with low thresholds, and if `SMALL`, with small
/// fluxes.
#[allow(unsafe_code)]
#[inline(always)]
pub(crate) fn take<const M: usize, const LOW: bool, const SMALL: bool>(
    spots: Spots<'_, M>,
    subapertures: Subapertures<'_, M>,
) {
    let Spots { windows, tracking, next, limits, measurements, peak_fraction } = spots;
    let Subapertures { calibration, applied, slopes, mut taking, saturated_pixels } = subapertures;
    let lengths = [
        tracking.len(),
        next.len(),
        limits.len(),
        measurements.len(),
        calibration.len(),
        applied.len(),
        slopes.len(),
    ];
    let count = lengths.into_iter().fold(windows.len(), usize::min);
    if count == 0 {
        return;
    }
    let back = count.wrapping_neg() % TURN;
    let from = windows.as_ptr().wrapping_sub(back);
    let shared =
        [from.wrapping_add(count + back).addr() as u32, u16::MAX.into(), peak_fraction.into()];
    let [any, small] = &LEADING_ZEROS;
    let zeros = if SMALL { small } else { any };
    let (mut sum_x, mut sum_y, mut valid, mut saturated) = (0i32, 0i32, 0u32, 0u32);
    let open_loop = taking.open_loop().halves_mut().as_flattened_mut().as_mut_ptr();
    // SAFETY: the instructions go through `count` of each slice, which are as long at least, a turn at once, the
    // first time behind `back` that are none; they write elements of those that are lent to be written, and of
    // `open_loop`, which has 2 M, at places that are in it, read the others and `shared`, `zeros` and the inverses at
    // nine bits, whatever a flux is, and write registers that are given here.
    unsafe {
        asm!(include_str!("spots_rv32.s"),
            low = const LOW as u32, small = const SMALL as u32, window = const size_of::<Window>(),
            sum = const offset_of!(Window, moments.sum), mx = const offset_of!(Window, moments.x),
            my = const offset_of!(Window, moments.y),
            peak = const offset_of!(Window, seen) + offset_of!(Seen, peak),
            white = const offset_of!(Window, seen) + offset_of!(Seen, saturated),
            tracking = const size_of::<Tracking>(),
            excess = const offset_of!(Tracking, excess), near = const offset_of!(Tracking, near),
            measurement = const size_of::<Measurement>(),
            flux = const offset_of!(Measurement, flux), highest = const offset_of!(Measurement, peak),
            saturated = const offset_of!(Measurement, saturated),
            calibration = const size_of::<SlopeCalibration>(),
            reference = const offset_of!(SlopeCalibration, reference_q16),
            gain = const offset_of!(Limits<M>, gain),
            flux_min = const offset_of!(SlopeCalibration, flux_min),
            limit = const size_of::<Limits<M>>(), threshold = const offset_of!(Limits<M>, threshold),
            flux_span = const offset_of!(Limits<M>, flux_span), place = const offset_of!(Limits<M>, place),
            slope = const size_of::<Slope>(),
            tilt = const offset_of!(Slope, tilt_ulp), valid = const offset_of!(Slope, valid),
            headroom = const HEADROOM, guard = const GUARD_BITS,
            from = inout(reg) from => _, at = inout(reg) measurements.as_mut_ptr().wrapping_sub(back) => _,
            done = inout(reg) tracking.as_ptr().wrapping_sub(back) => _,
            next = inout(reg) next.as_mut_ptr().wrapping_sub(back) => _,
            limits = inout(reg) limits.as_ptr().wrapping_sub(back) => _,
            cal = inout(reg) calibration.as_ptr().wrapping_sub(back) => _,
            applied = inout(reg) applied.as_ptr().wrapping_sub(back) => _,
            to = inout(reg) slopes.as_mut_ptr().wrapping_sub(back) => _,
            shared = in(reg) shared.as_ptr(), open_loop = in(reg) open_loop,
            sum_x = inout(reg) sum_x, sum_y = inout(reg) sum_y,
            count = inout(reg) valid, saturated_sum = inout(reg) saturated,
            t = inout(reg) back => _, d = out(reg) _, x = out(reg) _, y = out(reg) _, s = out(reg) _,
            u = out(reg) _, q = out(reg) _, p = out(reg) _, z = out(reg) _,
            zeros = in(reg) zeros.as_ptr(), inverses = in(reg) INVERSES.as_ptr(),
            options(nostack));
    }
    taking.add([sum_x, sum_y], valid);
    *saturated_pixels = saturated_pixels.wrapping_add(saturated);
}
