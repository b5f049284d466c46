//! Actuators: heights to DAC codes through each actuator's response.
//!
//! ```text
//! linear      code   = c0 + c1 h            v = 2^15 code
//! quadratic   code^2 = c0 + c1 h            v = code^2 / 2     (electrostatic: stroke ~ V^2)
//! ```
//!
//! Both are one line v(h) and, for the quadratic response, a rounded square root. `h` is relative to
//! the flat map in ulp of piston, within +-2^27; v is 31 bits within the range in use; c0 (v of the
//! flat mirror) and c1 (the change of v over 2^21 ulp, which has the actuator's height per piston in
//! it) are i32 and the product i64 (2^31 x 2^27 = 2^58). The response is monotonic and both ends of
//! the height range are checked when the configuration is built, so a code never leaves its DAC;
//! rounding is to nearest. A DAC of fewer than 16 bits uses the upper ones of a 16-bit code, rounded.

use crate::fixed::{self, positive};
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
    /// Whether between these heights v is never negative, and what they make of it is the upper half of one product of
    /// two words, the slope's without a sign: slope 2^5 and height 2^6 fit.
    pub(crate) fn is_short(&self, (lowest, highest): (i32, i32)) -> bool {
        let fits = lowest >= -(1 << 25) && highest < 1 << 25;
        fits && (0..1 << 27).contains(&self.slope) && self.value(lowest) >= 0
    }

    /// v at a height within +-2^27 ulp of piston.
    pub(crate) const fn value(&self, height_ulp: i32) -> i64 {
        self.offset as i64 + ((self.slope as i64 * height_ulp as i64) >> SLOPE_BITS)
    }
}

/// ulp, as a power of two, over which [`Response::slope`] is the change: an actuator that reaches
/// no more than a quarter of the nominal stroke, four times faster than the piston, still fits.
pub(crate) const SLOPE_BITS: u32 = 21;

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
    /// inverse of [`codes`], off by half a code at most. Saturated to `limit`.
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
    let rise = (i64::from(response.slope) * i64::from(height_ulp)) >> SLOPE_BITS;
    // Up to 2^31 - 2^15 within the limits, but for the last bits of the product.
    let v = positive(response.offset.wrapping_add(rise as i32)) as u32;
    let code = match law {
        Law::Linear => {
            let code = (v + (1 << (14 + spare_bits))) >> (15 + spare_bits);
            // Rounding up at the very top is the only way past the highest code, to the next.
            code - (code >> (16 - spare_bits))
        }
        Law::Quadratic => {
            // n - 1/2 <= sqrt(v) / 2^s where v / 4^s >= n^2 - n + 1/4: three quarters more make
            // the lower bits' part in that known before they are dropped.
            let quarters = 3 * ((1 << (2 * spare_bits)) >> 2);
            // The highest code N has N^2 / 2 and the next begins above it by N / 2, of which the tolerance of
            // the limits takes half.
            fixed::square_root(((v << 1) + quarters) >> (2 * spare_bits))
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
                assert_eq!(
                    u32::from(code(highest)),
                    (1 << (16 - spare_bits)) - 1,
                    "{law:?} {spare_bits}"
                );
                assert_eq!(code(-24_576.0), 0, "{law:?} {spare_bits}");
            }
        }
    }
}
