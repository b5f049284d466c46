//! The mirror's guard: the one place that makes DAC codes, whatever asks for them.
//!
//! ```text
//! wanted piston, tip, tilt -> reachable region -> slew limit -> heights within limits -> codes
//! ```
//!
//! Frames, pokes, patterns, leaks and ramps all ask for a position of each segment and get what is
//! inside the per-actuator limits on both sides, the slew limit and the segment's reachable region
//! (see [`crate::segments`]). Nothing else writes positions, heights or codes. Flat is the flat
//! map, of which heights are relative: never code zero.
//!
//! Between two calls of the guard an actuator moves by the slew limit at most, but in two cases where
//! there is nothing to be slow from: at a cold start, before the drive is on; and where another
//! configuration's limits leave out what the mirror shows: limits come first.

use crate::actuators::{self, Drive, Law, Response};
use crate::config::Config;
#[cfg(target_arch = "riscv32")]
use crate::dsp;
#[cfg(any(target_arch = "riscv32", armv7em))]
use crate::dsp::reach::{Subapertures, reach};
#[cfg(any(target_arch = "riscv32", armv7em))]
use crate::redblack::RedBlack;
use crate::segments::{self, ACTUATORS, FARTHEST, Move, Position, Segment};
#[cfg(any(target_arch = "riscv32", armv7em))]
use crate::sor::Unknown;
use core::fmt;
use serde::{Deserialize, Serialize};

/// Serial numbers of what a configuration was made for; 0 is not stated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Serials {
    /// Of the mirror.
    pub mirror: u32,
    /// Of the detector.
    pub detector: u32,
}

/// A configuration was made for hardware that is not there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OtherHardware {
    /// What the configuration states.
    pub made_for: Serials,
    /// What the board has.
    pub found: Serials,
}

impl fmt::Display for OtherHardware {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { made_for, found } = self;
        for (name, made_for, found) in [
            ("mirror", made_for.mirror, found.mirror),
            ("detector", made_for.detector, found.detector),
        ] {
            if !fits(made_for, found) {
                return write!(f, "serials.{name} = {made_for}: must be {found}, or 0 for any");
            }
        }
        f.write_str("serial numbers fit")
    }
}

impl core::error::Error for OtherHardware {}

/// Whether two serial numbers can be the same thing's.
const fn fits(a: u32, b: u32) -> bool {
    a == b || a == 0 || b == 0
}

impl Serials {
    /// Refuses a configuration made for another mirror or detector. What either side does not state
    /// fits.
    ///
    /// # Errors
    /// [`OtherHardware`] with both sides' numbers.
    pub const fn admit(self, made_for: Self) -> Result<(), OtherHardware> {
        if fits(made_for.mirror, self.mirror) && fits(made_for.detector, self.detector) {
            Ok(())
        } else {
            Err(OtherHardware { made_for, found: self })
        }
    }
}

/// What gave way in a step of the whole mirror.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits {
    /// Actuators that would have gone beyond their limits.
    pub saturated: u16,
    /// Actuators that would have moved faster than the slew limit.
    pub slewed: u16,
}

/// Where the mirror is, and the codes that put it there.
#[derive(Debug)]
pub(crate) struct Mirror<const M: usize> {
    positions: [Position; M],
    /// Relative to flat, ulp of piston.
    heights_ulp: [[i32; ACTUATORS]; M],
    codes: [[u16; ACTUATORS]; M],
    subapertures: usize,
    /// Whether the codes are those of a configuration.
    driven: bool,
}

/// A step that has been taken, and whose codes are still to be made.
#[must_use = "the codes are those of the step before until `drive`"]
pub(crate) struct Step<'a, const M: usize> {
    mirror: &'a mut Mirror<M>,
    /// What gave way.
    pub(crate) limits: Limits,
}

impl<const M: usize> Mirror<M> {
    pub(crate) const fn new() -> Self {
        Self {
            positions: [Position { piston_ulp: 0, tilt_ulp: [0; 2] }; M],
            heights_ulp: [[0; ACTUATORS]; M],
            codes: [[0; ACTUATORS]; M],
            subapertures: 0,
            driven: false,
        }
    }

    /// The flat map's codes at once: for a mirror whose drive is off, or that is no hardware.
    pub(crate) fn cold_start<const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
    ) {
        self.driven = true;
        self.subapertures = config.subapertures();
        self.positions.fill(Position::default());
        self.heights_ulp.fill([0; ACTUATORS]);
        self.drive(config);
    }

    /// Lets through of what is `wanted` for each subaperture, of which there is one of `items`, what may
    /// be, and tells what is `shown`; [`Step::drive`] then makes the codes.
    #[inline(always)]
    pub(crate) fn pass<W, const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        items: impl Iterator<Item = W>,
        mut wanted: impl FnMut(&mut W) -> Position,
        mut shown: impl FnMut(W, Position),
    ) -> Step<'_, M> {
        let travel = &config.travel;
        if travel.is_free() {
            return self.pass_freely(config, items, wanted, shown);
        }
        let limits = self.advance(config, items, move |segment, position, heights, mut item| {
            let step = segment.advance(position, heights, wanted(&mut item), travel);
            shown(item, step.position);
            step
        });
        Step { mirror: self, limits }
    }

    /// [`Mirror::pass`] for a mirror of [`is_free`](crate::segments::Travel::is_free).
    #[inline(always)]
    pub(crate) fn pass_freely<W, const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        items: impl Iterator<Item = W>,
        mut wanted: impl FnMut(&mut W) -> Position,
        mut shown: impl FnMut(W, Position),
    ) -> Step<'_, M> {
        let bits = config.travel.ratio_bits;
        let limits = self.advance(config, items, move |segment, _, _, mut item| {
            let step = segment.go(wanted(&mut item), bits);
            shown(item, step.position);
            step
        });
        Step { mirror: self, limits }
    }

    /// [`Mirror::pass_freely`] of commands and of pistons less `mean`, which what is shown is recorded of, for a
    /// mirror whose [`Travel::is_level`](crate::segments::Travel).
    #[cfg(any(target_arch = "riscv32", armv7em))]
    #[inline(always)]
    pub(crate) fn reach<const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        unknowns: &mut RedBlack<Unknown, M>,
        commands: &RedBlack<[i32; 2], M>,
        applied: &mut [[i32; 2]],
        mean: i32,
    ) -> Step<'_, M> {
        let all = Subapertures {
            nodes: &config.nodes,
            segments: &config.segments,
            #[cfg(target_arch = "riscv32")]
            levers: &config.levers,
            applied,
            positions: &mut self.positions,
            heights_ulp: &mut self.heights_ulp,
        };
        let saturated = reach(all, unknowns, commands, mean, config.travel.ratio_bits);
        Step { mirror: self, limits: Limits { saturated: saturated as u16, slewed: 0 } }
    }

    /// [`Mirror::pass`] with codes, away from the frame path: `ask` has a subaperture and its position.
    ///
    /// Not inlined, and with a walk of its own: a board may keep the frame path's in other memory.
    #[inline(never)]
    pub(crate) fn steer<const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        ask: &mut dyn FnMut(usize, Position) -> Position,
    ) -> Limits {
        let travel = &config.travel;
        let limits = self.walk(config, 0.., |segment, position, heights, i| {
            segment.advance(position, heights, ask(i, position), travel)
        });
        self.drive(config);
        limits
    }

    /// A step towards the flat map.
    pub(crate) fn flatten<const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
    ) -> Limits {
        self.steer(config, &mut |_, _| Position::default())
    }

    /// A step of `part`, Q16, of the way to the flat map.
    pub(crate) fn leak<const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        part_q16: u16,
    ) -> Limits {
        self.steer(config, &mut |_, position| segments::leaked(position, part_q16))
    }

    /// Whether the flat map is shown.
    pub(crate) fn is_flat(&self) -> bool {
        let heights = self.heights_ulp.get(..self.subapertures).unwrap_or_default();
        heights.as_flattened().iter().all(|&height| height == 0)
    }

    /// Takes over another configuration of the same mask: the codes stay, and the positions become what
    /// they are by that configuration's flat map, responses and matrices.
    ///
    /// An actuator beyond that configuration's limits is brought within them by the next step, however
    /// far that is. Where a matrix cannot be inverted the segment counts as flat.
    pub(crate) fn adopt<const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
    ) {
        let mechanics = config.segments.iter().zip(&config.responses);
        let state = self.positions.iter_mut().zip(&mut self.heights_ulp).zip(&self.codes);
        for ((segment, responses), ((position, heights_ulp), codes)) in mechanics.zip(state) {
            let ([r0, r1, r2], [c0, c1, c2]) = (responses, *codes);
            let height = |response, code| config.drive.height(response, code, FARTHEST);
            *heights_ulp = [height(r0, c0), height(r1, c1), height(r2, c2)];
            *position =
                segment.position(*heights_ulp, config.travel.ratio_bits).unwrap_or_default();
        }
    }

    /// Ramps to the flat map from wherever the program ended, for a panic or fault handler: takes no lock,
    /// allocates nothing, and ends after the steps that the slowest segment needs at most. `send` hands the
    /// codes out and lets a frame's time pass; the first codes are those of the step in which the
    /// program ended, that some segments may not have taken.
    pub(crate) fn emergency<const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        send: &mut dyn FnMut(&[[u16; ACTUATORS]]),
    ) {
        self.steer(config, &mut |_, position| position);
        send(self.codes());
        let steps = config.segments.iter().map(|segment| segment.steps(config.travel.slew_ulp));
        for _ in 0..steps.max().unwrap_or(0) {
            if self.is_flat() {
                break;
            }
            self.flatten(config);
            send(self.codes());
        }
    }

    /// [`Mirror::walk`] of a frame.
    ///
    /// Not inlined: it needs all registers.
    #[inline(never)]
    fn advance<W, const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        items: impl Iterator<Item = W>,
        go: impl FnMut(&Segment, Position, [i32; ACTUATORS], W) -> Move,
    ) -> Limits {
        self.walk(config, items, go)
    }

    /// Positions and heights by `go`, from where a segment is and what there is of `items` for it.
    #[inline(always)]
    fn walk<W, const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        items: impl Iterator<Item = W>,
        mut go: impl FnMut(&Segment, Position, [i32; ACTUATORS], W) -> Move,
    ) -> Limits {
        let (mut saturated, mut slewed) = (0u32, 0u32);
        let state = self.positions.iter_mut().zip(&mut self.heights_ulp);
        for ((item, segment), (position, heights_ulp)) in items.zip(&config.segments).zip(state) {
            let step = go(segment, *position, *heights_ulp, item);
            *position = step.position;
            *heights_ulp = step.heights_ulp;
            saturated = saturated.wrapping_add(step.limited.saturated);
            slewed = slewed.wrapping_add(step.limited.slewed);
        }
        Limits { saturated: saturated as u16, slewed: slewed as u16 }
    }

    /// Heights to codes.
    ///
    /// Not inlined: it needs all registers.
    #[inline(never)]
    fn drive<const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
    ) {
        let Self { heights_ulp, codes, .. } = self;
        let Drive { law, spare_bits } = config.drive;
        // One loop each: the law is the same for all, and most DACs have 16 bits.
        if config.travel.is_short && (law, spare_bits) == (Law::Quadratic, 0) {
            #[cfg(target_arch = "riscv32")]
            dsp::codes::codes(&config.lines, heights_ulp, codes);
            #[cfg(not(target_arch = "riscv32"))]
            each(
                config.responses.iter().zip(heights_ulp.as_slice()).zip(codes),
                |response, height| response.line().code(height),
            );
            return;
        }
        let segments = config.responses.iter().zip(heights_ulp.as_slice()).zip(codes);
        match law {
            Law::Linear => each(segments, |response, height| {
                actuators::code(Law::Linear, spare_bits, response, height)
            }),
            Law::Quadratic => each(segments, |response, height| {
                actuators::code(Law::Quadratic, spare_bits, response, height)
            }),
        }
    }

    /// Whether a configuration of so many subapertures has set the codes.
    pub(crate) const fn is_driven(&self, subapertures: usize) -> bool {
        self.driven && self.subapertures == subapertures
    }

    /// Positions after all limits, in subaperture order.
    pub(crate) fn positions(&self) -> &[Position] {
        self.positions.get(..self.subapertures).unwrap_or_default()
    }

    /// DAC codes, in subaperture order.
    pub(crate) fn codes(&self) -> &[[u16; ACTUATORS]] {
        self.codes.get(..self.subapertures).unwrap_or_default()
    }

    /// Subapertures of the configuration that drives it.
    pub(crate) const fn subapertures(&self) -> usize {
        self.subapertures
    }
}

/// Makes the codes of all segments.
#[inline(always)]
fn each<'a>(
    segments: impl Iterator<
        Item = ((&'a [Response; ACTUATORS], &'a [i32; ACTUATORS]), &'a mut [u16; ACTUATORS]),
    >,
    code: impl Fn(&Response, i32) -> u16,
) {
    for ((responses, heights_ulp), codes) in segments {
        let actuators = responses.iter().zip(heights_ulp).zip(codes);
        actuators.for_each(|((response, &height), to)| *to = code(response, height));
    }
}

impl<const M: usize> Step<'_, M> {
    /// Makes the codes.
    pub(crate) fn drive<const P: usize, const B: usize, const K: usize>(
        self,
        config: &Config<M, P, B, K>,
    ) {
        self.mirror.drive(config);
    }
}
