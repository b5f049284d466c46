//! Segments: piston, tip and tilt to the heights of three actuators, inside what they can reach.
//!
//! ```text
//! h_a = m_a0 p + m_a1 tip + m_a2 tilt,   a = 0, 1, 2
//! h_a / m_a0 = p + q_a,                  q_a = t_a1 tip + t_a2 tilt,   t = m / m_a0
//! ```
//!
//! Everything here is in units of piston: the configuration divides each actuator's row, and its
//! limits, by its influence m_a0, and the actuators' responses take it back. Heights are relative to
//! the flat map.
//!
//! The reachable region of a segment is where all three heights are within their actuators'
//! limits: a sheared box in (p, tip, tilt), not a box per axis. Priority: tip and tilt are kept
//! and the piston gives way; if no piston makes the tip/tilt reachable, tip and tilt shrink by one
//! common factor to where exactly one does. Then the slew limit: the segment goes along the
//! straight line from where it is as far as its slowest actuator allows in one frame (in steps of a
//! quarter of an LSB, rounded down: all of it when the move fits, half of it at worst at a limit of 1
//! LSB, 15/16 at 16 LSB). The region is convex, so every point of that line is reachable too.
//!
//! ```text
//! piston interval   max_a (lo_a - q_a) <= p <= min_a (hi_a - q_a)
//! tilt scale        min over a != b of (hi_b - lo_a) / (q_b - q_a)
//! ```
//!
//! Whether a tip/tilt within +-2^23 can fail to fit, and a move be too fast, is known when the
//! configuration is built (`Travel`); a mirror where neither can happen, a free one, spends no time on it. Level is
//! one where every tip/tilt fits at piston 0.
//!
//! **Scaling and overflow.** Targets in ulp: |p| < 2^29.4 with a global tilt's plane, |tip|, |tilt| <=
//! 2^23; a position's |p| <= 2^28.6, the farthest limit and the largest q. Ratios t within +-16, in i16 with 10 to 15
//! fraction bits; a tilt is shifted by what they lack of 16, which leaves it within 2^29.
//! Each of the two products is rounded down: |q| <= 2^28, low by less than 2 ulp and by one in the mean, which all actuators
//! alike take for piston. Limits within +-2^27. Scales are Q16 fractions from operands in
//! quarters of an LSB up to 2^22 ([`fixed::ratio_q16`]), rounded down so that the result is inside.

use crate::actuators::Response;
use crate::error::{ConfigError, Field};
use crate::fixed::{self, TILT_LIMIT, larger, mul_short, negative, positive, smaller};
use serde::{Deserialize, Serialize};

/// Actuators of a segment.
pub const ACTUATORS: usize = 3;

/// Fraction bits of an actuator's height per piston.
pub(crate) const INFLUENCE_BITS: u32 = 13;

/// Fraction bits that the ratios have at least, and at most.
pub(crate) const RATIO_BITS: (u32, u32) = (10, 15);

/// Fraction bits that the upper half of a product with a ratio is to have.
const WHOLE_BITS: u32 = 16;

/// Farthest limit from flat, ulp: the stroke, 2^25, at an influence of a quarter.
pub(crate) const FARTHEST: i32 = 1 << 27;

/// One segment's mechanics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(C)]
pub struct Segment {
    /// Height per tip and per tilt over height per piston, in 10 to 15 fraction bits: those of the configuration.
    pub ratios: [[i16; 2]; ACTUATORS],
    /// Height per piston, Q13, 1/4 to 4, rounded up.
    pub influence: [u16; ACTUATORS],
    /// Lowest height of each actuator, ulp of piston relative to flat: 0 or less.
    pub lowest: [i32; ACTUATORS],
    /// Highest height of each actuator, ulp of piston relative to flat: 0 or more.
    pub highest: [i32; ACTUATORS],
}

/// A segment's ratios as the upper halves of words, for a machine that multiplies no others.
#[cfg(target_arch = "riscv32")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub(crate) struct Lever([[i32; 2]; ACTUATORS]);

/// What the motion of all segments has in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Travel {
    /// Fraction bits of the ratios, 10 to 15.
    pub(crate) ratio_bits: u32,
    /// Greatest motion of any actuator, ulp of its height per frame.
    pub(crate) slew_ulp: i32,
    /// Whether some tip/tilt is beyond what some segment reaches with any piston.
    pub(crate) tilts_shrink: bool,
    /// Whether some motion between two limits is longer than `slew_ulp`.
    pub(crate) slews: bool,
    /// Whether at piston 0 every tip/tilt is in every segment's reach.
    pub(crate) is_level: bool,
    /// Whether all actuators' responses are [short](Response::is_short) within their limits.
    pub(crate) is_short: bool,
}

/// Piston, tip and tilt of a segment, ulp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(C)]
pub struct Position {
    /// Piston, optical path difference.
    pub piston_ulp: i32,
    /// Tip and tilt, centre-to-edge path difference.
    pub tilt_ulp: [i32; 2],
}

impl Position {
    /// Within the formats: a piston that is a target's (see the module), and tilts within +-2^23.
    #[must_use]
    pub(crate) fn bounded(self) -> Self {
        let within = |x: i32, limit: i32| x.max(-limit).min(limit);
        Self {
            piston_ulp: within(self.piston_ulp, 1 << 29),
            tilt_ulp: self.tilt_ulp.map(|tilt| within(tilt, TILT_LIMIT)),
        }
    }
}

/// What limited a segment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Limited {
    /// Actuators that the command would have taken beyond their limits.
    pub(crate) saturated: u32,
    /// Actuators that the command would have moved faster than the slew limit.
    pub(crate) slewed: u32,
}

/// Where a segment goes: its position and the heights of its actuators.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Move {
    /// Position after all limits.
    pub(crate) position: Position,
    /// Heights relative to flat, ulp of piston, within `lowest ..= highest`.
    pub(crate) heights_ulp: [i32; ACTUATORS],
    /// What had to give way.
    pub(crate) limited: Limited,
}

/// What limits make of a piston.
#[derive(Clone, Copy)]
struct Fit {
    /// What it changes by: to the nearest that all actuators allow, and to the least that no lower limit
    /// forbids where none will do, as rounding can have it by two ulp where exactly one did.
    change: i32,
    /// Actuators that were beyond their limits.
    saturated: u32,
}

impl Segment {
    /// Refuses what breaks the bounds of the module.
    pub(crate) fn check(&self, i: usize) -> Result<(), ConfigError> {
        for influence in self.influence {
            let value = f64::from(influence) / f64::from(1u32 << INFLUENCE_BITS);
            ConfigError::check(Field::SegmentMatrix, Some(i), value, (0.25, 4.0))?;
        }
        let far = f64::from(FARTHEST);
        for (low, high) in self.lowest.into_iter().zip(self.highest) {
            ConfigError::check(Field::HeightLimits, Some(i), low.into(), (-far, 0.0))?;
            ConfigError::check(Field::HeightLimits, Some(i), high.into(), (0.0, far))?;
        }
        Ok(())
    }

    /// Whether some tip and tilt within their limits has no piston.
    fn can_shrink(&self, ratio_bits: u32) -> bool {
        let rows = self.ratios.iter().zip(&self.lowest);
        rows.into_iter().any(|([ax, ay], &low)| {
            self.ratios.iter().zip(&self.highest).any(|([bx, by], &high)| {
                let steepest = i64::from(ax.abs_diff(*bx)) + i64::from(ay.abs_diff(*by));
                // Each q is low by less than two.
                let taken = ((steepest * i64::from(TILT_LIMIT)) >> ratio_bits) + 3;
                steepest > 0 && taken > i64::from(high) - i64::from(low)
            })
        })
    }

    /// Whether at piston 0 every tip and tilt within their limits is in reach.
    fn is_level(&self, ratio_bits: u32) -> bool {
        let limits = self.lowest.iter().zip(&self.highest);
        self.ratios.iter().zip(limits).all(|([x, y], (&low, &high))| {
            let steepest = i64::from(x.unsigned_abs()) + i64::from(y.unsigned_abs());
            let taken = ((steepest * i64::from(TILT_LIMIT)) >> ratio_bits) + 3;
            taken <= i64::from(high).min(-i64::from(low))
        })
    }

    /// Its ratios as words.
    #[cfg(target_arch = "riscv32")]
    pub(crate) fn lever(&self) -> Lever {
        Lever(self.ratios.map(|row| row.map(|t| i32::from(t) << WHOLE_BITS)))
    }

    /// Height of each actuator at piston 0.
    #[inline(always)]
    fn tilted(&self, tilt_ulp: [i32; 2], ratio_bits: u32) -> [i32; ACTUATORS] {
        let shift = tilt_shift(ratio_bits);
        let [tip, tilt] = tilt_ulp.map(|tilt| tilt.wrapping_shl(shift));
        let tilted = |[tx, ty]: [i16; 2]| mul_short(tx, tip).wrapping_add(mul_short(ty, tilt));
        let [t0, t1, t2] = self.ratios;
        [tilted(t0), tilted(t1), tilted(t2)]
    }

    /// Whether some actuator's whole range is more than a frame's motion.
    fn can_slew(&self, slew_ulp: i32) -> bool {
        let ranges = self.lowest.iter().zip(&self.highest).zip(&self.influence);
        ranges.into_iter().any(|((&low, &high), &influence)| {
            motion(high.wrapping_sub(low), influence) > slew_ulp.unsigned_abs()
        })
    }

    /// What the limits make of a piston that has brought the actuators to these heights, within 2^30.
    #[inline(always)]
    fn fit(&self, heights_ulp: [i32; ACTUATORS]) -> Fit {
        let ([l0, l1, l2], [h0, h1, h2]) = (self.lowest, self.highest);
        let [a, b, c] = heights_ulp;
        // What is left above and below, negative beyond a limit: of one actuator never both.
        let (up0, up1, up2) = (h0.wrapping_sub(a), h1.wrapping_sub(b), h2.wrapping_sub(c));
        let (down0, down1, down2) = (a.wrapping_sub(l0), b.wrapping_sub(l1), c.wrapping_sub(l2));
        let beyond = |up: i32, down: i32| (up | down) as u32 >> 31;
        let most = smaller(smaller(negative(up0), up1), up2);
        let least = smaller(smaller(down0, down1), down2).wrapping_neg();
        Fit {
            change: larger(most, least),
            saturated: beyond(up0, down0) + beyond(up1, down1) + beyond(up2, down2),
        }
    }

    /// Goes to `target` within limits, for a mirror of [`Travel::is_free`]: at most the piston gives way.
    #[inline(always)]
    pub(crate) fn go(&self, target: Position, ratio_bits: u32) -> Move {
        let heights = raised(self.tilted(target.tilt_ulp, ratio_bits), target.piston_ulp);
        let Fit { change, saturated } = self.fit(heights);
        Move {
            position: Position { piston_ulp: target.piston_ulp.wrapping_add(change), ..target },
            // Within the limits, since the piston is within what each leaves it.
            heights_ulp: raised(heights, change),
            limited: Limited { saturated, slewed: 0 },
        }
    }

    /// Moves from `previous`, with actuators at `from_ulp`, towards `target` within limits.
    #[inline(always)]
    pub(crate) fn advance(
        &self,
        previous: Position,
        from_ulp: [i32; ACTUATORS],
        target: Position,
        travel: &Travel,
    ) -> Move {
        let mut position = target;
        let mut tilted = self.tilted(target.tilt_ulp, travel.ratio_bits);
        let wanted = target.piston_ulp;
        let Fit { mut change, saturated } = self.fit(raised(tilted, wanted));
        if travel.tilts_shrink {
            let scale = self.tilt_scale(tilted);
            position.tilt_ulp = target.tilt_ulp.map(|tilt| shrink(tilt, scale));
            tilted = self.tilted(position.tilt_ulp, travel.ratio_bits);
            change = self.fit(raised(tilted, wanted)).change;
        }
        position.piston_ulp = wanted.wrapping_add(change);
        let mut slewed = 0;
        if travel.slews {
            let heights = raised(tilted, position.piston_ulp);
            let steps = pairs(heights, from_ulp).map(|(to, from)| to.wrapping_sub(from));
            let motions = pairs(steps, self.influence).map(|(step, m)| motion(step, m));
            slewed = motions.into_iter().map(|m| u32::from(m > travel.slew_ulp as u32)).sum();
            let longest = motions.into_iter().fold(0, |longest, m| larger(longest, m as i32));
            position = towards(previous, position, scale(travel.slew_ulp, longest));
            tilted = self.tilted(position.tilt_ulp, travel.ratio_bits);
        }
        let limits = pairs(pairs(self.lowest, self.highest), tilted);
        // Inside by construction but for the rounding of the last products.
        let heights_ulp = limits.map(|((low, high), q)| {
            smaller(larger(position.piston_ulp.wrapping_add(q), low), high)
        });
        Move { position, heights_ulp, limited: Limited { saturated, slewed } }
    }

    /// The position whose heights are nearest to `heights_ulp`, each first brought within its actuator's
    /// limits; `None` where the matrix cannot be inverted.
    ///
    /// With d = h - h_0 and the ratios' differences e: e tilt = d for two actuators, by Cramer's rule.
    /// |d| <= 2^28 and |e| < 2^16: the numerators stay below 2^45, 2^60 with the ratios' fraction bits.
    /// Tip and tilt are nearest, ties away from zero, saturated to their format; with the piston, the
    /// height of actuator 0 then is exact and the others are within the rounding of their products.
    pub(crate) fn position(
        &self,
        heights_ulp: [i32; ACTUATORS],
        ratio_bits: u32,
    ) -> Option<Position> {
        let limits = pairs(pairs(self.lowest, self.highest), heights_ulp);
        // Heights that an operator asks for may be any.
        let [h0, h1, h2] = limits.map(|((low, high), height)| height.max(low).min(high));
        let [[x0, y0], [x1, y1], [x2, y2]] = self.ratios.map(|row| row.map(i64::from));
        let ([a, b], [c, d]) = ([x1 - x0, y1 - y0], [x2 - x0, y2 - y0]);
        let (u, v) = (i64::from(h1) - i64::from(h0), i64::from(h2) - i64::from(h0));
        let determinant = a * d - b * c;
        let limit = i64::from(TILT_LIMIT);
        let solve = |numerator: i64| {
            let doubled = (numerator << (ratio_bits + 1)).checked_div(determinant)?;
            let nearest = (doubled + doubled.signum()) / 2;
            Some(nearest.max(-limit).min(limit) as i32)
        };
        let tilt_ulp = [solve(u * d - v * b)?, solve(a * v - c * u)?];
        let [q0, ..] = self.tilted(tilt_ulp, ratio_bits);
        Some(Position { piston_ulp: h0.wrapping_sub(q0), tilt_ulp })
    }

    /// Calls of the guard that a segment takes at most from anywhere to the flat map: each goes at
    /// least half as far as the slew limit (see the module).
    pub(crate) fn steps(&self, slew_ulp: i32) -> u32 {
        let ranges = pairs(pairs(self.lowest, self.highest), self.influence);
        let longest = ranges.map(|((low, high), m)| motion(high.wrapping_sub(low), m));
        let longest = longest.into_iter().fold(0, u32::max);
        2 * (longest / slew_ulp.max(1).unsigned_abs()) + 2
    }

    /// The part of a tip/tilt that exactly one piston makes reachable, Q16, at most 1.
    #[inline]
    fn tilt_scale(&self, tilted: [i32; ACTUATORS]) -> u32 {
        let [a, b, c] = pairs(pairs(self.lowest, self.highest), tilted);
        // From one actuator's lower limit to the other's upper one: what is there, and what the
        // tilt takes.
        [(a, b), (b, a), (a, c), (c, a), (b, c), (c, b)]
            .into_iter()
            .map(|(((low, _), q_low), ((_, high), q_high))| {
                scale(high.wrapping_sub(low), q_high.wrapping_sub(q_low))
            })
            .fold(1 << 16, |least, scale| smaller(least, scale as i32)) as u32
    }
}

impl Travel {
    /// Whether these segments run into nothing but the ends of their pistons.
    pub(crate) const fn is_free(&self) -> bool {
        !self.tilts_shrink && !self.slews
    }

    /// What these segments can run into.
    pub(crate) fn new(
        ratio_bits: u32,
        slew_ulp: i32,
        segments: &[Segment],
        responses: &[[Response; ACTUATORS]],
    ) -> Self {
        let limits = segments.iter().map(|segment| pairs(segment.lowest, segment.highest));
        let mut all = responses.iter().zip(limits).flat_map(|(&of, limits)| pairs(of, limits));
        Self {
            is_short: all.all(|(response, limits)| response.is_short(limits)),
            ratio_bits,
            slew_ulp,
            tilts_shrink: segments.iter().any(|segment| segment.can_shrink(ratio_bits)),
            slews: segments.iter().any(|segment| segment.can_slew(slew_ulp)),
            is_level: segments.iter().all(|segment| segment.is_level(ratio_bits)),
        }
    }
}

/// Bits that a tilt is shifted by before its products with ratios of so many fraction bits.
pub(crate) const fn tilt_shift(ratio_bits: u32) -> u32 {
    WHOLE_BITS.saturating_sub(ratio_bits)
}

/// The position with `part` of it taken off, Q16, towards zero.
pub(crate) fn leaked(position: Position, part_q16: u16) -> Position {
    let keep = (1 << 16) - u32::from(part_q16);
    Position {
        piston_ulp: shrink(position.piston_ulp, keep),
        tilt_ulp: position.tilt_ulp.map(|tilt| shrink(tilt, keep)),
    }
}

/// Length of a step of `step_ulp` of piston in its actuator's own height, ulp, up to 2^30 and 8: rounded up,
/// with two ulp for the rounding of both heights, so that no actuator is ever faster than its limit.
#[inline(always)]
fn motion(step_ulp: i32, influence: u16) -> u32 {
    let product = u64::from(step_ulp.unsigned_abs() + 2) * u64::from(influence);
    ((product + (1 << INFLUENCE_BITS) - 1) >> INFLUENCE_BITS) as u32
}

/// Heights with a piston added.
#[inline(always)]
fn raised([a, b, c]: [i32; ACTUATORS], piston_ulp: i32) -> [i32; ACTUATORS] {
    [a.wrapping_add(piston_ulp), b.wrapping_add(piston_ulp), c.wrapping_add(piston_ulp)]
}

#[inline(always)]
fn pairs<A: Copy, B: Copy>([a0, a1, a2]: [A; 3], [b0, b1, b2]: [B; 3]) -> [(A, B); 3] {
    [(a0, b0), (a1, b1), (a2, b2)]
}

/// `room / need` in Q16, at most 1, rounded down; 1 where nothing is needed.
///
/// Both are ulp within 2^29; quarters of an LSB (2^7 ulp) fit the 22 bits of the division. `room`
/// is rounded down and `need` up.
#[inline(always)]
fn scale(room: i32, need: i32) -> u32 {
    let (room, need) = (positive(room), positive(need));
    // Rounding must not slow down what fits.
    let fits = i32::from(need <= room) << 16;
    let ratio = fixed::ratio_q16((room >> 7) as u32, (need.wrapping_add(127) >> 7) as u32);
    larger(ratio as i32, fits) as u32
}

/// `x scale`, scale in Q16 up to 1, rounded towards zero.
#[inline(always)]
fn shrink(x: i32, scale_q16: u32) -> i32 {
    let magnitude = (u64::from(x.unsigned_abs()) * u64::from(scale_q16)) >> 16;
    (magnitude as i32).wrapping_mul(x.signum())
}

/// The point `scale` of the way from `a` to `b`.
#[inline(always)]
fn towards(a: Position, b: Position, scale_q16: u32) -> Position {
    let go = |a: i32, b: i32| a.wrapping_add(shrink(b.wrapping_sub(a), scale_q16));
    let ([ax, ay], [bx, by]) = (a.tilt_ulp, b.tilt_ulp);
    Position { piston_ulp: go(a.piston_ulp, b.piston_ulp), tilt_ulp: [go(ax, bx), go(ay, by)] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle of radius 0.6 in f64, and a segment of it with limits that are wide but for one.
    fn segment() -> (Segment, [[f64; 2]; ACTUATORS]) {
        let side = 0.6 * f64::sqrt(3.0) / 2.0;
        let rows = [[0.0, 0.6], [-side, -0.3], [side, -0.3]];
        let ratios = rows.map(|row| row.map(|t| (t * f64::from(1 << 15)).round() as i16));
        let (lowest, highest) = ([-(1 << 24); 3], [1 << 24, 1 << 24, 1 << 20]);
        (Segment { ratios, influence: [1 << INFLUENCE_BITS; 3], lowest, highest }, rows)
    }

    /// Positions of heights, back to heights by the matrix in f64: exact to the rounding of tip and tilt
    /// (1/2 ulp each, and that of the ratios, 2^-16 of the tilt) and of two products.
    #[test]
    fn heights_have_the_position_that_has_them() {
        let (segment, rows) = segment();
        for heights in [[0, 0, 0], [1 << 20, -(1 << 20), 77], [-12_345, 1 << 22, 1 << 19]] {
            let position = segment.position(heights, 15).expect("a triangle");
            let Position { piston_ulp, tilt_ulp: [tip, tilt] } = position;
            for ([x, y], height) in rows.into_iter().zip(heights) {
                let found = f64::from(piston_ulp) + x * f64::from(tip) + y * f64::from(tilt);
                let largest = f64::from(tip.abs().max(tilt.abs()));
                let error = (found - f64::from(height)).abs();
                assert!(error <= 3.0 + largest / 32_768.0, "{heights:?}: {error}");
            }
        }
    }

    /// Against products in f64, which are exact, with tilts up to their limits.
    #[test]
    fn heights_are_low_by_less_than_two_ulp() {
        let mut x = 1u32;
        let mut next = || {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            x as i32
        };
        for _ in 0..20_000 {
            for ratio_bits in RATIO_BITS.0..=RATIO_BITS.1 {
                let ratios = [(); ACTUATORS].map(|()| [next(), next()].map(|t| (t >> 16) as i16));
                let tilt_ulp =
                    [next(), next()].map(|t| fixed::clamp(t >> (6 + (t & 7)), TILT_LIMIT));
                let (segment, _) = segment();
                let tilted = Segment { ratios, ..segment }.tilted(tilt_ulp, ratio_bits);
                for ([tx, ty], found) in
                    ratios.map(|row| row.map(f64::from)).into_iter().zip(tilted)
                {
                    let [tip, tilt] = tilt_ulp.map(f64::from);
                    let exact = (tx * tip + ty * tilt) / f64::from(1 << ratio_bits);
                    let low = exact - f64::from(found);
                    assert!((0.0..2.0).contains(&low), "{ratios:?} {tilt_ulp:?}: {low}");
                }
            }
        }
    }

    /// Where the flat piston is in reach at the steepest tilt, and not where a limit is nearer than that.
    #[test]
    fn a_level_segment_reaches_every_tilt_at_piston_0() {
        let (mut segment, _) = segment();
        let [[x, y], ..] = segment.ratios.map(|row| row.map(|t| i32::from(t).abs()));
        // Rounding is up to three ulp.
        let limit = (((x + y) * (TILT_LIMIT >> 10)) >> 5) + 3;
        assert!(!segment.is_level(15), "a limit of 2^20");
        segment.lowest = [-(1 << 23); 3];
        segment.highest = [limit, 1 << 23, 1 << 23];
        assert!(segment.is_level(15));
        // What is shown in the corners, where heights are the largest.
        for corner in [[1, 1], [1, -1], [-1, 1], [-1, -1]] {
            let tilted = segment.tilted(corner.map(|side| side * TILT_LIMIT), 15);
            for ((height, low), high) in tilted.into_iter().zip(segment.lowest).zip(segment.highest)
            {
                assert!((low..=high).contains(&height), "{corner:?}: {height}");
            }
        }
        segment.highest[0] -= 1;
        assert!(!segment.is_level(15));
    }

    #[test]
    fn heights_beyond_a_limit_stop_there_alone() {
        let (segment, _) = segment();
        let at_limit = segment.position([100, 200, 1 << 20], 15);
        assert_eq!(segment.position([100, 200, i32::MAX], 15), at_limit);
    }

    #[test]
    fn a_matrix_without_inverse_has_no_position() {
        let (mut segment, _) = segment();
        segment.ratios = [[100, 200]; ACTUATORS];
        assert_eq!(segment.position([1, 2, 3], 15), None);
    }

    #[test]
    fn a_leak_ends_at_the_flat_map() {
        let mut position = Position { piston_ulp: 1 << 24, tilt_ulp: [-(1 << 22), 3] };
        let half = leaked(position, 1 << 15);
        assert_eq!(half, Position { piston_ulp: 1 << 23, tilt_ulp: [-(1 << 21), 1] });
        for _ in 0..100_000 {
            position = leaked(position, 655);
        }
        assert_eq!(position, Position::default());
        assert_eq!(leaked(half, 0), half);
    }
}
