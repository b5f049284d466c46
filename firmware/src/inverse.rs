//! The reciprocal of a flux: times a first moment it gives a centroid.
//!
//! ```text
//! m = I 2^s in 2^31 .. 2^32        s = leading zeros of I
//! r = 2^53 / m                     Q22, above 2^21 and at most 2^22
//! r = start - fall (m mod 2^22) / 2^22     in each of 512 cells of m
//! ```
//!
//! A chord of a cell is above the curve, by at most 2^-20 / x^3 in units of 2^22, x = m / 2^31: a start is lower by half
//! of what its cell's chord is off in the middle, so that r is within 2^-21 / x^2 of itself, and an ulp and a half, which
//! is 1.5 x 2^-22 x of itself, for all roundings: within 0.875 x 2^-20 in all, at both ends. The upper half of its product with a moment is a
//! centroid. There is no division, whose time depends on its operands where a machine ends it early.

/// Cells of the table over 2^31.
const CELLS: usize = 512;
/// Bits of an argument below its cell.
const FRACTION_BITS: u32 = 22;

/// A cell of the table.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(crate) struct Cell {
    /// Of its first argument, Q22.
    pub(crate) start: u32,
    /// By how much it is less for the next cell's first one, Q22: below 2^14.
    fall: u32,
}

/// By the nine bits of m below its first one.
pub(crate) static INVERSES: [Cell; CELLS] = cells();

const fn cells() -> [Cell; CELLS] {
    // In quarters of an ulp.
    const fn quarter(m: u64) -> u64 {
        (1 << 55) / m
    }
    let mut cells = [Cell { start: 0, fall: 0 }; CELLS];
    let mut i = 0;
    while i < CELLS {
        let from = (1 << 31) + ((i as u64) << FRACTION_BITS);
        let (low, high) = (quarter(from), quarter(from + (1 << FRACTION_BITS)));
        let middle = quarter(from + (1 << (FRACTION_BITS - 1)));
        let above = (low + high) / 2 - middle;
        // Rounded down, as what is taken off it will be.
        cells[i] =
            Cell { start: ((low - above / 2) / 4) as u32, fall: ((low - high + 2) / 4) as u32 };
        i += 1;
    }
    cells
}

/// An inverse, with the shift that its number has in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inverse {
    /// 2^53 / (I 2^s), Q22.
    pub(crate) mantissa: i32,
    /// s.
    pub(crate) shift: u32,
}

impl Inverse {
    /// Of `flux`; of zero any.
    #[inline(always)]
    #[must_use]
    pub fn new(flux: u32) -> Self {
        let shift = (flux | 1).leading_zeros();
        let m = flux << shift;
        let cell = (m << 1 >> (FRACTION_BITS + 1)) as usize;
        // Always there.
        let Cell { start, fall } =
            INVERSES.get(cell).copied().unwrap_or(Cell { start: 0, fall: 0 });
        let fraction = m << (32 - FRACTION_BITS);
        let fallen = ((u64::from(fall) * u64::from(fraction)) >> 32) as u32;
        Self { mantissa: start.wrapping_sub(fallen) as i32, shift }
    }

    /// moment / I for |moment| <= 31 (I + 1) and I < 2^26, in 2^-15: rounded down, and off by less than 2^-20 of itself
    /// beside that, which is an ulp at the edge of the largest window.
    #[inline(always)]
    #[must_use]
    pub const fn quotient_q15(self, moment: i32) -> i32 {
        // At most 31 x 2^26.
        let shifted = moment.wrapping_shl(self.shift.wrapping_sub(SPARE_BITS));
        crate::fixed::mul_high(shifted, self.mantissa)
    }
}

/// Leading zeros that a flux has at least.
pub(crate) const SPARE_BITS: u32 = 6;

#[cfg(test)]
mod tests {
    use super::*;

    /// Every cell's ends and middle, and a spread, against f64.
    #[test]
    fn inverses_are_within_a_millionth() {
        let check = |flux: u32| {
            let Inverse { mantissa, shift } = Inverse::new(flux);
            let exact = 2f64.powi(53) / (f64::from(flux) * 2f64.powi(shift as i32));
            let error = (f64::from(mantissa) - exact).abs();
            assert!(error <= exact * 2f64.powi(-20), "{flux}: {error} of {exact}");
        };
        for cell in 0..512u32 {
            for rest in [0, 1, 1 << 15, (1 << 16) - 1] {
                check(((512 | cell) << 16) | rest);
            }
        }
        (1..1u32 << 20).for_each(check);
        (0..1_000_000u32).for_each(|i| check((i.wrapping_mul(2_654_435_761) >> 6).max(1)));
    }

    /// Quotients over all that moments are, against exact ones.
    #[test]
    fn quotients_are_rounded_down() {
        let mut x = 1u32;
        let mut next = || {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            x
        };
        for _ in 0..2_000_000 {
            let flux = (next() >> 6 >> (next() >> 27).min(25)).max(1);
            let furthest = 31 * i64::from(flux);
            let share = i128::from(next()) * i128::from(2 * furthest + 1);
            let moment = (share >> 32) as i64 - furthest;
            let found = Inverse::new(flux).quotient_q15(moment as i32);
            let exact = moment as f64 * 32_768.0 / f64::from(flux);
            let (error, off) = (f64::from(found) - exact, exact.abs() * 2f64.powi(-20));
            assert!(error > -1.0 - off && error <= off, "{moment} / {flux}: {error}");
        }
        assert_eq!(Inverse::new(0).quotient_q15(0), 0);
    }
}
