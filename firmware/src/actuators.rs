//! Actuators: heights to DAC codes through each actuator's response.
//!
//! ```text
//! linear      code   = c0 + c1 h            v = 2^15 code
//! quadratic   code^2 = c0 + c1 h            v = code^2 / 2     (electrostatic: stroke ~ V^2)
//! ```
//!
//! Both are one line v(h) and, for the quadratic response, a [root]. `h` is relative to
//! the flat map in ulp of piston, within +-2^27; v is 31 bits within the range in use; c0 (v of the
//! flat mirror) and c1 (the change of v over 2^21 ulp, which has the actuator's height per piston in
//! it) are i32 and the product i64 (2^31 x 2^27 = 2^58). The response is monotonic and both ends of
//! the height range are checked when the configuration is built, so a code never leaves its DAC;
//! rounding is to nearest, of a root as [there](root). A DAC of fewer than 16 bits uses the upper ones of a 16-bit
//! code, rounded.
//!
//! A root is of 24 bits of v: less than one of these too low or too high, 2^-24 of the highest, as both c0 and the
//! product lose what is below. Of an actuator that needs the whole stroke for all its codes that is 2 ulp.

use crate::fixed::{self, mul_high, positive};
use crate::root;
use serde::{Deserialize, Serialize};

/// How an actuator's height follows from its DAC code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Law {
    /// Height goes with the code.
    #[default]
    Linear,
    /// Height goes with the square of the code, as in electrostatic mirrors.
    Quadratic,
}

/// The line v(h) of one actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(C)]
pub struct Response {
    /// v of the flat mirror.
    pub offset: i32,
    /// Change of v over 2^21 ulp of piston.
    pub slope: i32,
}

impl Response {
    /// Whether its [`Line`] has room for it, and between these heights has no v that a root is not of.
    pub(crate) fn is_short(&self, (lowest, highest): (i32, i32)) -> bool {
        // One more of a line's v fits.
        let is_v = |v: i64| (0..(1 << 31) - (1 << ROOT_SHIFT)).contains(&v);
        let fits = self.slope.unsigned_abs() < 1 << (31 - LINE_SHIFT);
        fits && is_v(self.value(lowest)) && is_v(self.value(highest))
    }

    /// The line of v's upper 24 bits.
    pub(crate) const fn line(&self) -> Line {
        Line { offset: self.root_offset(), slope: self.slope << LINE_SHIFT }
    }

    /// v of the flat mirror, its upper 24 bits: up to one more, for what a product loses.
    const fn root_offset(&self) -> i32 {
        (self.offset >> ROOT_SHIFT) + 1
    }

    /// v at a height within +-2^27 ulp of piston.
    pub(crate) const fn value(&self, height_ulp: i32) -> i64 {
        self.offset as i64 + ((self.slope as i64 * height_ulp as i64) >> SLOPE_BITS)
    }
}

/// ulp, as a power of two, over which [`Response::slope`] is the change: an actuator that reaches
/// no more than a quarter of the nominal stroke, four times faster than the piston, still fits.
pub(crate) const SLOPE_BITS: u32 = 21;

/// Bits of v below those that a root is of.
const ROOT_SHIFT: u32 = 31 - root::BITS;

/// What takes a slope to the word of which an upper half of a product is v's upper 24 bits.
const LINE_SHIFT: u32 = 32 - SLOPE_BITS - ROOT_SHIFT;

/// A [`Response`] as one product of two words, of whose v the upper 24 bits are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub(crate) struct Line {
    pub(crate) offset: i32,
    pub(crate) slope: i32,
}

impl Line {
    /// Code of 16 bits for a height: [`code`] of the quadratic law, where that [is short](Response::is_short).
    ///
    /// v is not negative: it is above what the response's is at least, less one.
    #[cfg_attr(target_arch = "riscv32", allow(dead_code, reason = "`dsp::codes` does that"))]
    #[inline(always)]
    pub(crate) fn code(&self, height_ulp: i32) -> u16 {
        root::root(self.offset.wrapping_add(mul_high(self.slope, height_ulp)) as u32) as u16
    }
}

/// What all actuators share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Drive {
    /// How height follows from code.
    pub law: Law,
    /// Bits that the DAC lacks of 16.
    pub spare_bits: u32,
}

impl Drive {
    /// v of the highest code.
    pub(crate) fn full(self) -> f64 {
        let top = f64::from((1u32 << 16) - (1 << self.spare_bits));
        match self.law {
            Law::Linear => top * 32_768.0,
            Law::Quadratic => top * top / 2.0,
        }
    }

    /// The height at which an actuator has `code`, ulp of piston relative to flat, to nearest: the
    /// inverse of [`code`], off by what that is. Saturated to `limit`.
    pub(crate) fn height(self, response: &Response, code: u16, limit: i32) -> i32 {
        let code = i64::from(code) << self.spare_bits;
        let v = match self.law {
            Law::Linear => code << 15,
            Law::Quadratic => code * code / 2,
        };
        // |v - offset| < 2^32: twice that over the slope's ulp is below 2^54.
        let rise = (v - i64::from(response.offset)) << (SLOPE_BITS + 1);
        let doubled = rise.checked_div(i64::from(response.slope)).unwrap_or(0);
        fixed::saturate((doubled + doubled.signum()) / 2, limit)
    }
}

/// The DAC code for the height of an actuator, relative to the flat map.
#[inline(always)]
pub(crate) fn code(law: Law, spare_bits: u32, response: &Response, height_ulp: i32) -> u16 {
    let product = i64::from(response.slope) * i64::from(height_ulp);
    let code = match law {
        Law::Linear => {
            // Up to 2^31 - 2^15 within the limits, but for the last bits of the product.
            let rise = (product >> SLOPE_BITS) as i32;
            let v = positive(response.offset.wrapping_add(rise)) as u32;
            let code = (v + (1 << (14 + spare_bits))) >> (15 + spare_bits);
            // Rounding up at the very top is the only way past the highest code, to the next.
            code - (code >> (16 - spare_bits))
        }
        Law::Quadratic => {
            let rise = (product >> (SLOPE_BITS + ROOT_SHIFT)) as i32;
            let v = positive(response.root_offset().wrapping_add(rise)) as u32;
            // The highest code N has N^2 / 2 and the next begins above it by N / 2, of which the tolerance of
            // the limits takes three quarters at most, and v's lower bits and the line 1 / 64.
            root::coarse_root(v, spare_bits)
        }
    };
    code as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of every resolution, as far beyond the codes as a configuration may be: see `Subaperture::check`.
    #[test]
    fn codes_stay_within_the_dac() {
        for law in [Law::Linear, Law::Quadratic] {
            for spare_bits in 0..=8 {
                let highest = Drive { law, spare_bits }.full() + 24_576.0;
                let code =
                    |v: f64| code(law, spare_bits, &Response { offset: v as i32, slope: 0 }, 0);
                let top = (1 << (16 - spare_bits)) - 1;
                assert_eq!(u32::from(code(highest)), top, "{law:?} {spare_bits}");
                // The quadratic law's v is within 12 of 2^24, and one for its lower bits: a code is its root.
                let lowest = f64::from(code(-24_576.0)) * f64::from(1 << spare_bits);
                let half = f64::from(1 << spare_bits) / 2.0;
                let most = if law == Law::Linear { 0.0 } else { 16.0 * f64::sqrt(13.0) + half };
                assert!(lowest <= most, "{law:?} {spare_bits}");
            }
        }
    }

    /// Against v in f64: within what the lower bits are that each of the two loses.
    #[test]
    fn a_line_is_the_response_of_24_bits() {
        let mut x = 1u32;
        let mut next = || {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            x as i32
        };
        for _ in 0..200_000 {
            let response = Response { offset: next() & i32::MAX, slope: next() >> 4 };
            let height = next() >> 5;
            let Line { offset, slope } = response.line();
            let v = offset.wrapping_add(mul_high(slope, height));
            let rise = f64::from(response.slope) * f64::from(height) / f64::from(1 << SLOPE_BITS);
            let exact = (f64::from(response.offset) + rise) / f64::from(1 << ROOT_SHIFT);
            assert!((f64::from(v) - exact).abs() < 1.0, "{response:?} {height}");
            if response.is_short((height, height)) {
                let short = response.line().code(height);
                assert_eq!(short, code(Law::Quadratic, 0, &response, height), "{response:?}");
            }
        }
        let ends = (-1, 1);
        assert!(Response { offset: 1, slope: (1 << 27) - 1 }.is_short((0, 1)));
        assert!(!Response { offset: 1 << 30, slope: 1 << 27 }.is_short(ends), "too steep");
        assert!(!Response { offset: -1, slope: 1 }.is_short(ends), "negative");
        assert!(!Response { offset: i32::MAX, slope: 1 }.is_short(ends), "too high");
    }
}
