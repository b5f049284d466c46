//! Control law: slopes to tip/tilt commands by a pseudo-open-loop integrator.
//!
//! ```text
//! x_i  = s_i + c_applied_i          tilt the atmosphere would show with a flat mirror
//! x_i  = x_i - mean_valid(x)        per axis, where the sensor is blind to it
//! c_i' = (1 - g_i) c_i + g_i f x_i  0 < g < 2
//! c'   = c' - mean_valid(c')
//! ```
//!
//! `c_applied` is what the mirror really showed while `s` was exposed, after every limit: a
//! clipped or slewing segment never winds the state up. `f` makes up for the lever arm of high
//! layers (f = 1 is the plain integrator); with f > 1 whatever the sensor cannot see would grow
//! as (1 + g (f - 1))^k, so the mean is removed from slopes *and* state, and an invalid
//! subaperture takes the mean x of its valid neighbours or, without one, holds: it never
//! integrates on its own.
//!
//! **Scaling and overflow.** Slopes, state and commands are i32 ulp within +-2^23, what the mirror
//! showed less a global tilt within +-2^24, so |x| < 2^25, and < 2^26 after the mean is off; coefficients are Q13 i16 within +-4; products i64, rounded once,
//! saturated to +-2^23. The mean is the sum (below 1600 x 2^25 < 2^36) times the floor of 2^24 /
//! count: low by less than 1e-4 of itself, far below what the next frame removes again.

use crate::fixed::{self, TILT_LIMIT, mul_high};
use crate::geometry::Grid;
use crate::redblack::{COLOURS, RedBlack};
use crate::slopes::{MeanSlope, Slope};
use crate::sor::Node;
use serde::{Deserialize, Serialize};

/// Fraction bits of the control coefficients.
pub(crate) const GAIN_BITS: u32 = 13;
/// Largest L: frames between the end of an exposure and the start of its command.
pub const MAX_DELAY: usize = 3;

/// The coefficients of one subaperture, Q13.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Gains {
    /// 1 - g.
    pub(crate) keep: i16,
    /// g f.
    pub(crate) take: i16,
}

/// What the control law needs beside the gains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct ControlConfig {
    /// What is done with the mean.
    pub(crate) mean: MeanSlope,
    /// L: frames between the end of an exposure and the start of the command made from it.
    pub(crate) delay: u8,
}

/// The integrator's state and the commands' recent past.
#[derive(Debug)]
pub(crate) struct Control<const M: usize> {
    /// c per subaperture, ulp.
    command: [[i32; 2]; M],
    /// What the mirror showed in the last frames, a ring; `newest` is its head.
    applied: [[[i32; 2]; M]; HISTORY],
    newest: usize,
    /// Tip and tilt on the padded grid: x where it was measured, then c.
    field: [RedBlack<i32, M>; 2],
    /// Tip and tilt that a subaperture without a measurement gets from its neighbours; zero
    /// elsewhere.
    filled: [RedBlack<i32, M>; 2],
    /// [`MEASURED`], [`GAP`] or zero, per padded node.
    status: RedBlack<i32, M>,
    /// 1 for a subaperture that got something from its neighbours, else 0.
    fed: RedBlack<u8, M>,
}

/// Length of the ring of applied commands: a power of two, so that its head wraps by a mask.
const HISTORY: usize = MAX_DELAY + 1;

/// Status of a subaperture that was measured in this frame: four of them add up in the lower half.
const MEASURED: i32 = 1;
/// Status of a subaperture that was not.
const GAP: i32 = 1 << 16;

/// Floor of 2^29 / n for the mean over up to four neighbours; 0 for none.
const INVERSE: [i32; 5] = [0, 1 << 29, 1 << 28, (1 << 29) / 3, 1 << 27];
/// Bits by which a sum of four x is shifted up, so that the upper half of its product with
/// [`INVERSE`] is their mean.
const INVERSE_SHIFT: u32 = 3;

impl<const M: usize> Control<M> {
    pub(crate) const fn new() -> Self {
        Self {
            command: [[0; 2]; M],
            applied: [[[0; 2]; M]; HISTORY],
            newest: 0,
            field: [const { RedBlack::new(0) }; 2],
            filled: [const { RedBlack::new(0) }; 2],
            status: RedBlack::new(0),
            fed: RedBlack::new(0),
        }
    }

    /// Takes one frame of slopes and leaves the new commands in [`Control::field`].
    ///
    /// `slopes`, `gains` and `nodes` are in subaperture order.
    pub(crate) fn update(
        &mut self,
        config: &ControlConfig,
        grid: &Grid,
        slopes: &[Slope],
        gains: &[Gains],
        nodes: &[Node],
    ) {
        let exposed = (self.newest + usize::from(config.delay)) % HISTORY;
        let exposed = self.applied.get(exposed).map_or(&[][..], |frame| frame);
        let mut valid_count = 0u32;
        let mut sums = [0i64; 2];
        for ((slope, applied), node) in slopes.iter().zip(exposed).zip(nodes) {
            let valid = i32::from(slope.valid);
            valid_count += valid as u32;
            put(&mut self.status, *node, valid * MEASURED + (1 - valid) * GAP);
            let terms = slope.tilt_ulp.iter().zip(applied).zip(&mut self.field).zip(&mut sums);
            for (((&s, &applied), field), sum) in terms {
                let x = s.wrapping_add(applied).wrapping_mul(valid);
                put(field, *node, x);
                *sum = sum.wrapping_add(i64::from(x));
            }
        }
        let inverse = removal(config.mean, valid_count);
        for (field, sum) in self.field.iter_mut().zip(sums) {
            let mean = mean(sum, inverse);
            for (slope, node) in slopes.iter().zip(nodes) {
                if let Some(x) = field.get_mut(node.padded) {
                    // Only what was measured: a gap stays zero.
                    *x = x.wrapping_sub(mean.wrapping_mul(i32::from(slope.valid)));
                }
            }
        }
        self.fill_gaps(grid);
        self.integrate(slopes, gains, nodes, inverse);
    }

    /// Gives every subaperture that was not measured the mean x of its measured neighbours, rounded
    /// down.
    ///
    /// One pass: a filled subaperture feeds none, since `field` is zero where nothing was measured.
    fn fill_gaps(&mut self, grid: &Grid) {
        let [filled_tip, filled_tilt] = &mut self.filled;
        let [tip, tilt] = &self.field;
        for colour in COLOURS {
            let status = self.status.nodes(grid, colour).iter();
            let status = status.zip(self.status.sides(grid, colour).iter());
            let x = tip.sides(grid, colour).iter().zip(tilt.sides(grid, colour).iter());
            let filled_tip = filled_tip.nodes_mut(grid, colour).iter_mut();
            let filled = filled_tip.zip(filled_tilt.nodes_mut(grid, colour));
            let filled = filled.zip(self.fed.nodes_mut(grid, colour));
            for (((&status, beside), (tip, tilt)), ((filled_tip, filled_tilt), fed)) in
                status.zip(x).zip(filled)
            {
                let count = sum(beside) & (GAP - 1);
                let inverse = INVERSE.get(count as usize).copied().unwrap_or(0);
                let weight = inverse.wrapping_mul(status / GAP);
                *fed = u8::from(weight > 0);
                // |x| < 2^26: four of them, shifted, stay below 2^31.
                *filled_tip = mul_high(sum(tip) << INVERSE_SHIFT, weight);
                *filled_tilt = mul_high(sum(tilt) << INVERSE_SHIFT, weight);
            }
        }
    }

    /// The state's step, its mean's removal, and the state into the field.
    ///
    /// A subaperture without a measurement holds where its neighbours have none either: their mean
    /// is then zero, and so is what they are weighted with.
    fn integrate(&mut self, slopes: &[Slope], gains: &[Gains], nodes: &[Node], inverse: i64) {
        let mut sums = [0i64; 2];
        for (((slope, gain), node), command) in
            slopes.iter().zip(gains).zip(nodes).zip(&mut self.command)
        {
            let valid = i32::from(slope.valid);
            let known = valid | self.fed.get(node.padded).map_or(0, |&fed| i32::from(fed));
            let x = self.field.iter().zip(&self.filled).map(|(field, filled)| {
                let at = |field: &RedBlack<i32, M>| field.get(node.padded).copied().unwrap_or(0);
                at(field).wrapping_add(at(filled))
            });
            for ((c, x), sum) in command.iter_mut().zip(x).zip(&mut sums) {
                let next =
                    i64::from(gain.keep) * i64::from(*c) + i64::from(gain.take) * i64::from(x);
                // Within 2^29.
                let next = fixed::clamp(fixed::round_shift(next, GAIN_BITS) as i32, TILT_LIMIT);
                *c = c.wrapping_add(next.wrapping_sub(*c).wrapping_mul(known));
                *sum = sum.wrapping_add(i64::from(c.wrapping_mul(valid)));
            }
        }
        let means = sums.map(|sum| mean(sum, inverse));
        for (node, command) in nodes.iter().zip(&mut self.command) {
            for ((c, field), mean) in command.iter_mut().zip(&mut self.field).zip(means) {
                *c = fixed::clamp(c.wrapping_sub(mean), TILT_LIMIT);
                put(field, *node, *c);
            }
        }
    }

    /// Records what the mirror shows from now on, without the global tilt, ulp.
    pub(crate) fn record(&mut self, applied: impl Iterator<Item = [i32; 2]>) {
        self.advance();
        if let Some(newest) = self.applied.get_mut(self.newest) {
            newest.iter_mut().zip(applied).for_each(|(place, tilt)| *place = tilt);
        }
    }

    /// Records that the mirror keeps what it shows.
    pub(crate) fn hold(&mut self) {
        let shown = self.newest;
        self.advance();
        if let Ok([shown, newest]) = self.applied.get_disjoint_mut([shown, self.newest]) {
            *newest = *shown;
        }
    }

    /// Moves the head of the ring to the place of its oldest frame.
    fn advance(&mut self) {
        self.newest = (self.newest + HISTORY - 1) % HISTORY;
    }

    /// Tip and tilt commands on the padded grid, ulp; zero where there is no subaperture.
    pub(crate) fn field(&self) -> &[RedBlack<i32, M>; 2] {
        &self.field
    }

    /// Tip and tilt commands per subaperture without the global tilt, ulp.
    pub(crate) fn commands(&self) -> &[[i32; 2]] {
        &self.command
    }

    /// Forgets state and past: flat commands.
    pub(crate) fn reset(&mut self) {
        self.command = [[0; 2]; M];
        self.applied = [[[0; 2]; M]; HISTORY];
        // Another mask may follow: what it leaves out has to be zero.
        self.field.iter_mut().for_each(|field| field.fill(0));
        self.filled.iter_mut().for_each(|field| field.fill(0));
        self.status.fill(0);
        self.fed.fill(0);
    }
}

#[inline(always)]
fn sum([west, east, north, south]: [i32; 4]) -> i32 {
    west.wrapping_add(east).wrapping_add(north).wrapping_add(south)
}

#[inline(always)]
fn put<const M: usize>(field: &mut RedBlack<i32, M>, node: Node, value: i32) {
    if let Some(place) = field.get_mut(node.padded) {
        *place = value;
    }
}

/// Floor of 2^24 / count, or zero where the mean stays.
#[inline]
fn removal(mean: MeanSlope, count: u32) -> i64 {
    let inverse = (1u32 << 24) / count.max(1);
    i64::from(inverse) * i64::from(mean == MeanSlope::Remove)
}

#[inline]
fn mean(sum: i64, inverse_q24: i64) -> i32 {
    fixed::round_shift(sum.wrapping_mul(inverse_q24), 24) as i32
}
