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
//! The slopes come one by one as windows end (`Taking::take`); what needs all of them is left for
//! `Control::update`. With a second gate x is [corrected](crate::modal) in between.
//!
//! **Scaling and overflow.** Slopes and commands are i32 ulp within +-2^23, what the mirror showed less
//! a global tilt within +-2^24, so |x| <= 3 x 2^23, and twice that at most after a mean is off. x is kept
//! times 8, in its low bits whether it was measured, so that the sum over four neighbours (below
//! 3 x 2^28 + 5) counts them as well. Coefficients are Q13 i16 within +-4, products i64, rounded once;
//! c' before its mean and limit is below 2^28. The mean is the sum (below 1600 x 2^28 < 2^39) times the
//! floor of 2^24 / count: low by less than 1e-4 of itself, far below what the next frame removes again.

#[cfg(any(target_arch = "riscv32", armv7em))]
use crate::dsp::law;
use crate::fixed::{self, TILT_LIMIT, mul_high};
use crate::geometry::Grid;
use crate::redblack::{COLOURS, Place, RedBlack};
use crate::slopes::{MeanSlope, Slope};
use serde::{Deserialize, Serialize};

/// Fraction bits of the control coefficients.
pub(crate) const GAIN_BITS: u32 = 13;
/// Largest L: frames between the end of an exposure and the start of its command.
pub const MAX_DELAY: usize = 3;

/// The coefficients of one subaperture, Q13.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gains {
    /// 1 - g.
    pub keep: i16,
    /// g f.
    pub take: i16,
}

/// [`Gains`] as what is added to c: zero where there is no subaperture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C, align(4))]
pub(crate) struct Changes {
    /// keep - 1: of a subaperture below 0 and above -2^14, as 0 < g < 2.
    drop: i16,
    take: i16,
}

/// What the control law needs beside the gains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ControlConfig {
    /// What is done with the mean.
    pub mean: MeanSlope,
    /// L: frames between the end of an exposure and the start of the command made from it.
    pub delay: u8,
}

/// The integrator's state and the commands' recent past.
#[derive(Debug)]
pub(crate) struct Control<const M: usize> {
    /// c per node, ulp; zero where there is no subaperture.
    command: RedBlack<[i32; 2], M>,
    /// What the mirror showed in the last frames, a ring; `newest` is its head.
    applied: [[[i32; 2]; M]; HISTORY],
    newest: usize,
    /// Of the frame being read: 8 x per node, the tip's with [`MEASURED`] in it; zero where nothing
    /// was measured.
    open_loop: RedBlack<[i32; 2], M>,
    /// Of the frame being read: the sums of x, and how many.
    sums: [i64; 2],
    valid: u32,
    /// Of those, that were measured in earlier sub-cycles.
    retained: u32,
}

/// Length of the ring of applied commands: a power of two, so that its head wraps by a mask.
const HISTORY: usize = MAX_DELAY + 1;

/// Largest magnitude of x, ulp: a slope within 2^23, and what the mirror showed less a global tilt.
const OPEN_LOOP_LIMIT: i32 = 3 << 23;
/// Bits by which x is shifted up in [`Control::open_loop`].
pub(crate) const GUARD_BITS: u32 = 3;
/// What a measured subaperture's 8 x has in its low bits.
const MEASURED: i32 = 1;
/// Those bits, of one node or of a sum over four.
const COUNT: i32 = (1 << GUARD_BITS) - 1;

/// Floor of 2^29 / n for the mean over up to four neighbours, of which the upper half of its product
/// with a sum of 8 x is; 0 for none.
pub(crate) static INVERSES: [i32; 8] = [0, 1 << 29, 1 << 28, (1 << 29) / 3, 1 << 27, 0, 0, 0];

impl<const M: usize> Control<M> {
    pub(crate) const fn new() -> Self {
        Self {
            command: RedBlack::new([0; 2]),
            applied: [[[0; 2]; M]; HISTORY],
            newest: 0,
            open_loop: RedBlack::new([0; 2]),
            sums: [0; 2],
            valid: 0,
            retained: 0,
        }
    }

    /// Forgets the slopes of an unfinished frame.
    pub(crate) fn begin(&mut self) {
        self.sums = [0; 2];
        self.valid = 0;
        self.retained = 0;
    }

    /// What the mirror showed while the frame being read was exposed, by subaperture, and where its slopes
    /// go: always there.
    #[inline(always)]
    pub(crate) fn taking(
        &mut self,
        config: &ControlConfig,
    ) -> Option<(&[[i32; 2]; M], Taking<'_, M>)> {
        let Self { applied, open_loop, sums, valid, retained, .. } = self;
        let exposed = self.newest.wrapping_add(config.delay.into()) % HISTORY;
        Some((applied.get(exposed)?, Taking { open_loop, sums, valid, retained }))
    }

    /// Makes the new commands of the slopes that were taken since [`Control::begin`].
    ///
    /// A subaperture that was not measured takes the mean x of its measured neighbours, rounded down,
    /// and holds where they have none.
    ///
    /// Not inlined: a board may keep it in other memory than what decides on it.
    #[inline(never)]
    pub(crate) fn update(
        &mut self,
        config: &ControlConfig,
        grid: &Grid,
        changes: &RedBlack<Changes, M>,
    ) {
        let inverse = removal(config.mean, self.valid);
        let means = self.sums.map(|sum| mean(sum, inverse));
        let [red, black] = COLOURS.map(|colour| self.update_colour(grid, colour, changes, means));
        let ([red_c, red_d], [black_c, black_d]) = (red, black);
        let sums = [red_c.wrapping_add(black_c), red_d.wrapping_add(black_d)];
        let least = sums.map(|sum| mean(sum, inverse).wrapping_sub(TILT_LIMIT));
        for colour in COLOURS {
            self.settle_colour(grid, colour, changes, least);
        }
    }

    /// The new commands of one colour's nodes with their mean still in them, of x less `means`, and the sums
    /// of those that were measured.
    fn update_colour(
        &mut self,
        grid: &Grid,
        colour: usize,
        changes: &RedBlack<Changes, M>,
        means: [i32; 2],
    ) -> [i64; 2] {
        #[cfg(any(target_arch = "riscv32", armv7em))]
        {
            let Self { open_loop, command, .. } = self;
            let sums = law::update(open_loop, command, changes, (grid, colour), means);
            sums.unwrap_or_default()
        }
        #[cfg(not(any(target_arch = "riscv32", armv7em)))]
        {
            let mut sums = [0; 2];
            let around = self.open_loop.sides(grid, colour).iter();
            let open_loop = self.open_loop.nodes(grid, colour).iter().zip(around);
            let commands = self.command.nodes_mut(grid, colour).iter_mut();
            for ((command, changes), (&own, around)) in
                commands.zip(changes.nodes(grid, colour)).zip(open_loop)
            {
                changes.update(command, own, around, means, &mut sums);
            }
            sums
        }
    }

    /// Takes the mean off the commands of one colour, of which `least` is less by their limit.
    fn settle_colour(
        &mut self,
        grid: &Grid,
        colour: usize,
        changes: &RedBlack<Changes, M>,
        least: [i32; 2],
    ) {
        #[cfg(any(target_arch = "riscv32", armv7em))]
        let _ = law::settle(&mut self.command, changes, (grid, colour), least);
        #[cfg(not(any(target_arch = "riscv32", armv7em)))]
        {
            let commands = self.command.nodes_mut(grid, colour).iter_mut();
            for (command, changes) in commands.zip(changes.nodes(grid, colour)) {
                if changes.present() {
                    let ([c, d], [least_c, least_d]) = (*command, least);
                    *command = [
                        fixed::clamp_raised(c.wrapping_sub(least_c), TILT_LIMIT),
                        fixed::clamp_raised(d.wrapping_sub(least_d), TILT_LIMIT),
                    ];
                }
            }
        }
    }

    /// Makes the new commands of one colour, of the slopes that were taken since [`Control::begin`] and
    /// those that others have of earlier sub-cycles; all others hold.
    ///
    /// The mean of x is that over the pupil, of everyone's latest: the mean over one colour is no global
    /// tilt. With it gone from x the mean of c decays by itself, as (1 - g) a cycle, and is left alone.
    pub(crate) fn update_part(
        &mut self,
        config: &ControlConfig,
        grid: &Grid,
        changes: &RedBlack<Changes, M>,
        part: impl Iterator<Item = Place>,
    ) {
        let inverse = removal(config.mean, self.valid.wrapping_add(self.retained));
        let [mean_x, mean_y] = self.sums.map(|sum| mean(sum, inverse));
        for place in part {
            let padded = place.padded::<M>();
            let x_of = |padded| self.open_loop.get(Place::new::<M>(padded)).copied();
            let [west, east] = [padded.wrapping_sub(1), padded + 1].map(x_of);
            let [north, south] = [padded.wrapping_sub(grid.stride), padded + grid.stride].map(x_of);
            let around = [west, east, north, south].map(Option::unwrap_or_default);
            let (around_x, around_y) = (sum(around.map(|[x, _]| x)), sum(around.map(|[_, y]| y)));
            let (Some(&[x, y]), Some(changes), Some(command)) =
                (self.open_loop.get(place), changes.get(place), self.command.get_mut(place))
            else {
                continue;
            };
            let weight = INVERSES.get((around_x & COUNT) as usize).copied().unwrap_or(0);
            let (x, y) = match (x & MEASURED != 0, weight > 0) {
                (true, _) => (x >> GUARD_BITS, y >> GUARD_BITS),
                (false, true) => (mul_high(around_x & !COUNT, weight), mul_high(around_y, weight)),
                // Without a measured neighbour it holds.
                (false, false) => continue,
            };
            let [c, d] = *command;
            let next = |c: i32, x: i32, mean| {
                let change = changes.change(c, x.wrapping_sub(mean));
                fixed::clamp(c.wrapping_add(change), TILT_LIMIT)
            };
            *command = [next(c, x, mean_x), next(d, y, mean_y)];
        }
    }

    /// Mean x over the subapertures that were measured, ulp.
    pub(crate) fn mean_open_loop(&self) -> [i32; 2] {
        let inverse = reciprocal(self.valid);
        self.sums.map(|sum| mean(sum, inverse))
    }

    /// Adds to x where it was measured, within the range of x: up to +-2^30 ulp.
    #[inline(always)]
    pub(crate) fn correct(&mut self, place: Place, ulp: [i32; 2]) {
        let Some(open_loop) = self.open_loop.get_mut(place) else { return };
        let ([x, y], [dx, dy]) = (*open_loop, ulp);
        let measured = x & MEASURED;
        let [x, y] = [x >> GUARD_BITS, y >> GUARD_BITS];
        let sum = |x: i32, d: i32| {
            fixed::clamp(x.wrapping_add(d), OPEN_LOOP_LIMIT).wrapping_mul(measured)
        };
        let (new_x, new_y) = (sum(x, dx), sum(y, dy));
        *open_loop = [(new_x << GUARD_BITS).wrapping_add(measured), new_y << GUARD_BITS];
        let [sum_x, sum_y] = &mut self.sums;
        *sum_x = sum_x.wrapping_add(i64::from(new_x.wrapping_sub(x)));
        *sum_y = sum_y.wrapping_add(i64::from(new_y.wrapping_sub(y)));
    }

    /// The command of one subaperture becomes what its segment shows.
    pub(crate) fn adopt(&mut self, place: Place, tilt_ulp: [i32; 2]) {
        if let Some(command) = self.command.get_mut(place) {
            *command = tilt_ulp;
        }
    }

    /// The commands, and where what the mirror shows from now on, without the global tilt, ulp, is to be
    /// recorded.
    pub(crate) fn recording(&mut self) -> (&RedBlack<[i32; 2], M>, &mut [[i32; 2]]) {
        self.advance();
        (&self.command, self.applied.get_mut(self.newest).map_or(&mut [], |newest| newest))
    }

    /// What the mirror shows without the global tilt, ulp, in subaperture order.
    pub(crate) fn shown(&self) -> &[[i32; 2]] {
        self.applied.get(self.newest).map_or(&[], |newest| newest)
    }

    /// Records what the mirror shows from now on, ulp.
    pub(crate) fn record(&mut self, applied: impl Iterator<Item = [i32; 2]>) {
        self.advance();
        if let Some(newest) = self.applied.get_mut(self.newest) {
            newest.iter_mut().zip(applied).for_each(|(place, tilt)| *place = tilt);
        }
    }

    /// The mirror has shown this for as long as matters.
    pub(crate) fn fill_past(&mut self, shown: impl Iterator<Item = [i32; 2]> + Clone) {
        for frame in &mut self.applied {
            frame.iter_mut().zip(shown.clone()).for_each(|(place, tilt)| *place = tilt);
        }
    }

    /// Records that the mirror keeps what it shows.
    pub(crate) fn hold(&mut self) {
        let shown = self.newest;
        self.advance();
        if let Ok([shown, newest]) = self.applied.get_disjoint_mut([shown, self.newest]) {
            newest.copy_from_slice(shown);
        }
    }

    /// Moves the head of the ring to the place of its oldest frame.
    fn advance(&mut self) {
        self.newest = (self.newest + HISTORY - 1) % HISTORY;
    }

    /// Tip and tilt commands without the global tilt on the padded grid, ulp; zero where there is no
    /// subaperture.
    pub(crate) const fn commands(&self) -> &RedBlack<[i32; 2], M> {
        &self.command
    }

    /// Subapertures with a valid slope in the frame being read.
    pub(crate) const fn valid(&self) -> u32 {
        self.valid
    }

    /// Forgets state and past: flat commands.
    pub(crate) fn reset(&mut self) {
        self.begin();
        self.applied = [[[0; 2]; M]; HISTORY];
        // Another mask may follow: what it leaves out has to be zero.
        self.command.fill([0; 2]);
        self.open_loop.fill([0; 2]);
    }
}

/// Where the slopes of a frame go.
pub(crate) struct Taking<'a, const M: usize> {
    open_loop: &'a mut RedBlack<[i32; 2], M>,
    sums: &'a mut [i64; 2],
    valid: &'a mut u32,
    retained: &'a mut u32,
}

impl<const M: usize> Taking<'_, M> {
    /// Takes up to 64 slopes, each with the place of its node and what the mirror showed there. Every
    /// subaperture has one a frame.
    #[inline(always)]
    pub(crate) fn take(&mut self, slopes: impl Iterator<Item = (Place, Slope, [i32; 2])>) {
        // Within 64 x 3 x 2^23 < 2^31.
        let (mut sum_x, mut sum_y, mut count) = (0i32, 0i32, 0);
        for (place, slope, [applied_tip, applied_tilt]) in slopes {
            let valid = i32::from(slope.valid);
            let [s, t] = slope.tilt_ulp;
            let x = s.wrapping_add(applied_tip).wrapping_mul(valid);
            let y = t.wrapping_add(applied_tilt).wrapping_mul(valid);
            // Always there.
            if let Some(open_loop) = self.open_loop.get_mut(place) {
                *open_loop = [(x << GUARD_BITS).wrapping_add(MEASURED * valid), y << GUARD_BITS];
            }
            sum_x = sum_x.wrapping_add(x);
            sum_y = sum_y.wrapping_add(y);
            count += valid as u32;
        }
        self.add([sum_x, sum_y], count);
    }

    /// Adds the sums of x, and how many they are.
    #[inline(always)]
    pub(crate) fn add(&mut self, sums: [i32; 2], count: u32) {
        let sums = self.sums.iter_mut().zip(sums);
        sums.for_each(|(sum, x)| *sum = sum.wrapping_add(x.into()));
        *self.valid = self.valid.wrapping_add(count);
    }

    /// 8 x of all nodes, to write.
    #[cfg(target_arch = "riscv32")]
    #[inline(always)]
    pub(crate) fn open_loop(&mut self) -> &mut RedBlack<[i32; 2], M> {
        self.open_loop
    }

    /// Lets a subaperture that this sub-cycle does not light keep its x, and counts it for the mean.
    pub(crate) fn retain(&mut self, place: Place) {
        let Some(&[x, y]) = self.open_loop.get(place) else { return };
        if x & MEASURED != 0 {
            let [sum_x, sum_y] = &mut self.sums;
            *sum_x = sum_x.wrapping_add(i64::from(x >> GUARD_BITS));
            *sum_y = sum_y.wrapping_add(i64::from(y >> GUARD_BITS));
            *self.retained = self.retained.wrapping_add(1);
        }
    }
}

impl From<Gains> for Changes {
    fn from(Gains { keep, take }: Gains) -> Self {
        Self { drop: keep.wrapping_sub(1 << GAIN_BITS), take }
    }
}

impl From<Changes> for Gains {
    fn from(Changes { drop, take }: Changes) -> Self {
        Self { keep: drop.wrapping_add(1 << GAIN_BITS), take }
    }
}

impl Changes {
    /// No subaperture.
    pub(crate) const NONE: Self = Self { drop: 0, take: 0 };
    /// One half.
    #[cfg(target_arch = "riscv32")]
    pub(crate) const HALF: i32 = 1 << (GAIN_BITS - 1);

    /// Whether there is a subaperture: with g > 0 and f > 0 none takes nothing.
    #[cfg(not(any(target_arch = "riscv32", armv7em)))]
    #[inline(always)]
    const fn present(self) -> bool {
        self.take != 0
    }

    /// drop c + take x, rounded once: a bias of an eighth of an ulp would pass through the mean into
    /// what is held, and add up there.
    #[inline(always)]
    fn change(self, c: i32, x: i32) -> i32 {
        let sum = i64::from(self.drop) * i64::from(c) + i64::from(self.take) * i64::from(x);
        fixed::round_shift(sum, GAIN_BITS) as i32
    }

    /// Makes the new command of a subaperture, from 8 x of itself and its neighbours less `means`, and adds
    /// it to `sums` if it was measured.
    #[cfg(not(any(target_arch = "riscv32", armv7em)))]
    #[inline(always)]
    pub(crate) fn update(
        self,
        command: &mut [i32; 2],
        [x, y]: [i32; 2],
        around: [[i32; 2]; 4],
        [mean_x, mean_y]: [i32; 2],
        [sum_c, sum_d]: &mut [i64; 2],
    ) {
        if !self.present() {
            return;
        }
        let (around_x, around_y) = (sum(around.map(|[x, _]| x)), sum(around.map(|[_, y]| y)));
        let valid = x & MEASURED;
        let count = (around_x & COUNT) as usize;
        let weight = INVERSES.get(count).map_or(0, |inverse| inverse & (valid - 1));
        let x = (x >> GUARD_BITS).wrapping_add(mul_high(around_x & !COUNT, weight));
        let y = (y >> GUARD_BITS).wrapping_add(mul_high(around_y, weight));
        // Where x is not known nothing changes.
        let known = (valid | weight).wrapping_neg() >> 31;
        let [c, d] = *command;
        let c = c.wrapping_add(self.change(c, x.wrapping_sub(mean_x)) & known);
        let d = d.wrapping_add(self.change(d, y.wrapping_sub(mean_y)) & known);
        *command = [c, d];
        *sum_c = sum_c.wrapping_add((c & valid.wrapping_neg()).into());
        *sum_d = sum_d.wrapping_add((d & valid.wrapping_neg()).into());
    }
}

#[inline(always)]
fn sum([west, east, north, south]: [i32; 4]) -> i32 {
    west.wrapping_add(east).wrapping_add(north).wrapping_add(south)
}

/// Floor of 2^24 / count; 2^24 for none.
#[inline]
pub(crate) fn reciprocal(count: u32) -> i64 {
    i64::from((1u32 << 24) / count.max(1))
}

/// That, or zero where the mean stays.
#[inline]
fn removal(mean: MeanSlope, count: u32) -> i64 {
    reciprocal(count) * i64::from(mean == MeanSlope::Remove)
}

/// The mean of what sums up to `sum`, by the reciprocal of its count.
#[inline]
pub(crate) fn mean(sum: i64, inverse_q24: i64) -> i32 {
    fixed::round_shift(sum.wrapping_mul(inverse_q24), 24) as i32
}
