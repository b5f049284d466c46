//! Segments: piston, tip and tilt to the heights of three actuators, inside what they can reach.
//!
//! ```text
//! h_a = m_a0 p + m_a1 tip + m_a2 tilt,   a = 0, 1, 2
//! ```
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
//! piston interval   max_a (lo_a - q_a) / m_a0 <= p <= min_a (hi_a - q_a) / m_a0,  q_a = tilt part
//! tilt scale        min over a != b of (hi_b/m_b0 - lo_a/m_a0) / (q_b/m_b0 - q_a/m_a0)
//! ```
//!
//! **Scaling and overflow.** Positions in ulp: |p| <= 2^26 with a global tilt's plane, |tip|,
//! |tilt| <= 2^23. Matrix Q13 in i16 (within +-4), inverse of m_a0 Q13 in u16 (m_a0 from 1/4 to
//! 4) refined to Q26: i64 products, |q| <= 2^26, |q / m_a0| <= 2^28. Scales are Q16 fractions from operands in
//! quarters of an LSB up to 2^22 ([`fixed::ratio_q16`]), rounded down so that the result is inside.
//! Limits are relative to the flat map.

use crate::fixed::{self, LENGTH_BITS};

/// Actuators of a segment.
pub const ACTUATORS: usize = 3;

/// Fraction bits of the segment matrix.
pub(crate) const MATRIX_BITS: u32 = 13;

/// One segment's mechanics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Segment {
    /// Rows: actuators; columns: piston, tip, tilt. Q13.
    pub(crate) matrix: [[i16; 3]; ACTUATORS],
    /// 1 / m_a0, Q13.
    pub(crate) inverse_piston: [u16; ACTUATORS],
    /// Height of each actuator when the segment is flat, LSB.
    pub(crate) flat: [u16; ACTUATORS],
    /// Lowest height of each actuator, LSB.
    pub(crate) lowest: [u16; ACTUATORS],
    /// Highest height of each actuator, LSB.
    pub(crate) highest: [u16; ACTUATORS],
}

/// Piston, tip and tilt of a segment, ulp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Position {
    /// Piston, optical path difference.
    pub piston_ulp: i32,
    /// Tip and tilt, centre-to-edge path difference.
    pub tilt_ulp: [i32; 2],
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
    /// Heights above each actuator's zero, ulp, within `lowest ..= highest`.
    pub(crate) heights_ulp: [u32; ACTUATORS],
    /// What had to give way.
    pub(crate) limited: Limited,
}

impl Segment {
    /// Heights relative to flat of a position, ulp.
    #[inline(always)]
    fn heights(&self, position: Position) -> [i32; ACTUATORS] {
        let Position { piston_ulp, tilt_ulp: [tip, tilt] } = position;
        self.matrix.map(|[m0, m1, m2]| {
            let sum = i64::from(m0) * i64::from(piston_ulp)
                + i64::from(m1) * i64::from(tip)
                + i64::from(m2) * i64::from(tilt);
            fixed::round_shift(sum, MATRIX_BITS) as i32
        })
    }

    /// Lower and upper limits relative to flat, ulp.
    #[inline(always)]
    fn limits(&self) -> [(i32, i32); ACTUATORS] {
        let relative = |limit: u16, flat: u16| (i32::from(limit) - i32::from(flat)) << LENGTH_BITS;
        let ([f0, f1, f2], [l0, l1, l2], [h0, h1, h2]) = (self.flat, self.lowest, self.highest);
        [(l0, h0, f0), (l1, h1, f1), (l2, h2, f2)]
            .map(|(low, high, flat)| (relative(low, flat), relative(high, flat)))
    }

    /// A height divided by each actuator's piston influence.
    #[inline(always)]
    fn as_piston(&self, heights: [i32; ACTUATORS]) -> [i32; ACTUATORS] {
        let ([a, b, c], [ia, ib, ic]) = (heights, self.inverse_piston);
        let [[ma, ..], [mb, ..], [mc, ..]] = self.matrix;
        [(a, ia, ma), (b, ib, mb), (c, ic, mc)].map(|(height, inverse, influence)| {
            let inverse = refine(inverse, influence);
            fixed::round_shift(i64::from(height) * inverse, 2 * MATRIX_BITS) as i32
        })
    }

    /// Limits as pistons, and the tilt part of each height as a piston.
    #[inline(always)]
    fn pistons(&self, tilt_ulp: [i32; 2]) -> [(i32, i32, i32); ACTUATORS] {
        let limits = self.limits();
        let [l0, l1, l2] = self.as_piston(limits.map(|(low, _)| low));
        let [h0, h1, h2] = self.as_piston(limits.map(|(_, high)| high));
        let [q0, q1, q2] = self.as_piston(self.heights(Position { piston_ulp: 0, tilt_ulp }));
        [(l0, h0, q0), (l1, h1, q1), (l2, h2, q2)]
    }

    /// Moves from `previous` towards `target` within limits; `slew_ulp` bounds the motion of any
    /// actuator, ulp per frame.
    #[inline]
    pub(crate) fn advance(&self, previous: Position, target: Position, slew_ulp: i32) -> Move {
        let limits = self.limits();
        let wanted = self.heights(target);
        let saturated = count(wanted, limits, |h, (low, high)| h < low || h > high);

        let reachable = self.reach(target);
        let from = self.heights(previous);
        let to = self.heights(reachable);
        let [(f0, t0), (f1, t1), (f2, t2)] = pairs(from, to);
        let steps = [t0.wrapping_sub(f0), t1.wrapping_sub(f1), t2.wrapping_sub(f2)];
        let slewed = count(steps, limits, |step, _| step.unsigned_abs() > slew_ulp as u32);
        let longest = steps.into_iter().fold(0, |longest, step| longest.max(step.unsigned_abs()));
        let position = towards(previous, reachable, scale(slew_ulp, longest as i32));

        let [(h0, l0), (h1, l1), (h2, l2)] = pairs(self.heights(position), limits);
        let [f0, f1, f2] = self.flat.map(|flat| u32::from(flat) << LENGTH_BITS);
        // Inside by construction but for the rounding of the last products.
        let heights_ulp = [(h0, l0, f0), (h1, l1, f1), (h2, l2, f2)]
            .map(|(h, (low, high), flat)| flat.wrapping_add_signed(h.max(low).min(high)));
        Move { position, heights_ulp, limited: Limited { saturated, slewed } }
    }

    /// The nearest reachable position by priority: tip/tilt first, then piston.
    #[inline]
    fn reach(&self, target: Position) -> Position {
        let [a, b, c] = self.pistons(target.tilt_ulp);
        // From actuator a's lower limit to b's upper one: what is there, and what tilt takes.
        let scale = [(a, b), (b, a), (a, c), (c, a), (b, c), (c, b)]
            .into_iter()
            .map(|((low, _, q_low), (_, high, q_high))| {
                scale(high.wrapping_sub(low), q_high.wrapping_sub(q_low))
            })
            .fold(1 << 16, u32::min);
        let tilt_ulp = target.tilt_ulp.map(|tilt| shrink(tilt, scale));
        let bounds = self.pistons(tilt_ulp);
        let low = bounds.into_iter().fold(i32::MIN, |p, (low, _, q)| p.max(low.wrapping_sub(q)));
        let high = bounds.into_iter().fold(i32::MAX, |p, (_, high, q)| p.min(high.wrapping_sub(q)));
        // Rounding can leave low one ulp above high when the interval is a point.
        let piston_ulp = target.piston_ulp.min(high).max(low.min(high));
        Position { piston_ulp, tilt_ulp }
    }
}

/// 1 / influence in Q26 from a Q13 approximation: one step of Newton's, r (2 - m r), takes its
/// relative error from 2^-12 to 2^-24.
#[inline(always)]
fn refine(inverse: u16, influence: i16) -> i64 {
    let r = i64::from(inverse);
    (r << (MATRIX_BITS + 1)) - ((i64::from(influence) * r * r) >> MATRIX_BITS)
}

#[inline(always)]
fn pairs<A: Copy, B: Copy>([a0, a1, a2]: [A; 3], [b0, b1, b2]: [B; 3]) -> [(A, B); 3] {
    [(a0, b0), (a1, b1), (a2, b2)]
}

#[inline(always)]
fn count<A: Copy, B: Copy>(a: [A; 3], b: [B; 3], rule: impl Fn(A, B) -> bool) -> u32 {
    pairs(a, b).into_iter().map(|(a, b)| u32::from(rule(a, b))).sum()
}

/// `room / need` in Q16, at most 1, rounded down; 1 where nothing is needed.
///
/// Both are ulp within 2^29; quarters of an LSB (2^7 ulp) fit the 22 bits of the division. `room`
/// is rounded down and `need` up.
#[inline(always)]
fn scale(room: i32, need: i32) -> u32 {
    let fits = u32::from(need <= room.max(0)) << 16;
    let room = (room.max(0) >> 7) as u32;
    let need = (need.max(0).wrapping_add(127) >> 7) as u32;
    // Rounding must not slow down what fits.
    fixed::ratio_q16(room, need).max(fits)
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
