//! Control law: slopes to tip/tilt commands by a pseudo-open-loop integrator.
//!
//! ```text
//! x_i  = s_i + c_applied_i          tilt the atmosphere would show with a flat mirror
//! u_i  = x_i - mean_valid(x)        per axis, where the sensor is blind to it
//! c_i' = (1 - g_i) c_i + g_i f u_i  0 < g < 2
//! ```
//!
//! `c_applied` is what the mirror really showed while `s` was exposed, after every limit: a
//! clipped or slewing segment never winds the state up. `f` makes up for the lever arm of high
//! layers (f = 1 is the plain integrator); with f > 1 whatever the sensor cannot see would grow
//! as (1 + g (f - 1))^k, so the mean of x is removed, and an invalid subaperture takes the mean x of its
//! valid neighbours or, without one, holds: it never integrates on its own.
//!
//! **The mean of c.** A tilt that all commands have in common is in every x and in their mean, and so in no u: it
//! decays by itself, as (1 - g)^k. So does what another set of valid subapertures leaves of one, and what
//! subapertures of unlike gains follow of a changing wavefront at unlike paces: all of it bounded by f u, on the
//! mirror for 1/g frames, and for the global tilt's own loop. It is not taken off: that would be a step of all
//! segments whenever one subaperture comes or goes, and would move those that hold.
//!
//! The slopes come one by one as windows end (`Taking::take`); what needs all of them is left for
//! `Control::update`. With a second gate x is [corrected](crate::modal) in between.
//!
//! **Scaling and overflow.** Slopes and commands are i32 ulp within +-2^23, what the mirror showed less
//! a global tilt within +-2^24, so |x| <= 3 x 2^23, and twice that at most after a mean is off. x is kept
//! times 16, in its low bits whether it was measured, so that the sum over four neighbours (up to
//! 3 x 2^29 + 4) counts them as well; u is below 3 x 2^28 + 2. Coefficients are Q13 within +-4. Both products are
//! rounded down to an ulp, and 1 is added to their sum: it is off by more than -1 and up to 1 ulp, by none in the
//! mean and by 0.41 rms. c' before its limit is below 2^28. The mean is the sum (below 1600 x 3 x 2^23 < 2^36) times
//! the floor of 2^32 / count: low by less than 4e-7 of itself.

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

/// [`Gains`] in a word, take above the [`KEEP_BITS`] of keep, less [`Changes::HOLD`]: zero where there is no
/// subaperture, as none takes nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub(crate) struct Changes(i32);

/// Bits of keep in [`Changes`]: of a subaperture it is within +-2^13, as 0 < g < 2, and 2^13 where one holds.
const KEEP_BITS: u32 = GAIN_BITS + 2;

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
    /// Of the frame being read: 16 x per node, the tip's with [`MEASURED`] in it; zero where nothing
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
pub(crate) const GUARD_BITS: u32 = 4;
/// What a measured subaperture's 16 x has in its low bits.
const MEASURED: i32 = 1;
/// Bits of how many of four neighbours were measured.
const COUNT_BITS: u32 = 3;

/// 2^31 / n for the mean over up to four neighbours, from the [`COUNT_BITS`] of how many were measured and the
/// bit above them of whether their middle was, which needs none: rounded down, and what fits for one.
pub(crate) static INVERSES: [i32; 2 << COUNT_BITS] = {
    let mut inverses = [0; 2 << COUNT_BITS];
    [inverses[1], inverses[2], inverses[3], inverses[4]] =
        [i32::MAX, 1 << 30, i32::MAX / 3, 1 << 29];
    inverses
};

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
        let means = self.means(config, self.valid);
        let Self { open_loop, command, .. } = self;
        #[cfg(any(target_arch = "riscv32", armv7em))]
        if law::update(open_loop, command, changes, grid, means).is_some() {
            return;
        }
        for colour in COLOURS {
            let around = open_loop.sides(grid, colour).iter();
            let open_loop = open_loop.nodes(grid, colour).iter().zip(around);
            let commands = command.nodes_mut(grid, colour).iter_mut();
            for ((command, changes), (&own, around)) in
                commands.zip(changes.nodes(grid, colour)).zip(open_loop)
            {
                changes.update(command, own, around, means);
            }
        }
    }

    /// 16 x the means of x, where they are removed.
    fn means(&self, config: &ControlConfig, count: u32) -> [i32; 2] {
        let inverse = reciprocal(count) * i64::from(config.mean == MeanSlope::Remove);
        self.sums.map(|sum| mean(sum << GUARD_BITS, inverse))
    }

    /// Makes the new commands of one colour, of the slopes that were taken since [`Control::begin`] and
    /// those that others have of earlier sub-cycles; all others hold.
    ///
    /// The mean of x is that over the pupil, of everyone's latest: the mean over one colour is no global
    /// tilt.
    pub(crate) fn update_part(
        &mut self,
        config: &ControlConfig,
        grid: &Grid,
        changes: &RedBlack<Changes, M>,
        part: impl Iterator<Item = Place>,
    ) {
        let means = self.means(config, self.valid.wrapping_add(self.retained));
        for place in part {
            let padded = place.padded::<M>();
            let x_of = |padded| self.open_loop.get(Place::new::<M>(padded)).copied();
            let [west, east] = [padded.wrapping_sub(1), padded + 1].map(x_of);
            let [north, south] = [padded.wrapping_sub(grid.stride), padded + grid.stride].map(x_of);
            let around = [west, east, north, south].map(Option::unwrap_or_default);
            let own = self.open_loop.get(place).copied().unwrap_or_default();
            if let (Some(changes), Some(command)) =
                (changes.get(place), self.command.get_mut(place))
            {
                changes.update(command, own, around, means);
            }
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

    /// 16 x of all nodes, to write.
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
        let keep = i32::from(keep) & ((1 << KEEP_BITS) - 1);
        Self((i32::from(take) << KEEP_BITS | keep).wrapping_sub(Self::HOLD))
    }
}

impl From<Changes> for Gains {
    fn from(Changes(changes): Changes) -> Self {
        let gains = changes.wrapping_add(Changes::HOLD);
        let keep = gains << (32 - KEEP_BITS) >> (32 - KEEP_BITS);
        Self { keep: keep as i16, take: (gains >> KEEP_BITS) as i16 }
    }
}

impl Changes {
    /// No subaperture.
    pub(crate) const NONE: Self = Self(0);
    /// The gains of one that holds: it keeps all and takes nothing.
    pub(crate) const HOLD: i32 = 1 << GAIN_BITS;

    /// Makes the new command of a subaperture, from 16 x of itself and its neighbours less `means`.
    #[inline(always)]
    fn update(
        self,
        command: &mut [i32; 2],
        [x, y]: [i32; 2],
        around: [[i32; 2]; 4],
        [mean_x, mean_y]: [i32; 2],
    ) {
        let Self(changes) = self;
        if changes == 0 {
            return;
        }
        let (around_x, around_y) = (sum(around.map(|[x, _]| x)), sum(around.map(|[_, y]| y)));
        let index = around_x.wrapping_add(x << COUNT_BITS) & (INVERSES.len() as i32 - 1);
        let inverse = INVERSES.get(index as usize).copied().unwrap_or(0);
        // Where x is not known it holds.
        let known = i32::from(index != 0);
        let gains = changes.wrapping_mul(known).wrapping_add(Self::HOLD);
        let next = |c: i32, own: i32, around: i32, mean| {
            let around = (i64::from(around) * i64::from(inverse)) >> 31;
            let u = own.wrapping_sub(mean).wrapping_add(around as i32);
            advance(gains, c, u).wrapping_add(known)
        };
        let [c, d] = *command;
        *command = [next(c, x, around_x, mean_x), next(d, y, around_y, mean_y)].map(limited);
    }
}

/// keep c + take u / 16, each rounded down to an ulp; of one that holds c itself.
#[inline(always)]
const fn advance(gains: i32, c: i32, u: i32) -> i32 {
    let (keep, take) = (gains << (32 - KEEP_BITS), gains >> KEEP_BITS << KEEP_BITS);
    mul_high(keep, c << (KEEP_BITS - GAIN_BITS)).wrapping_add(mul_high(take, u))
}

/// A command as one of 24 bits.
#[inline(always)]
fn limited(c: i32) -> i32 {
    let raised = fixed::positive(c.wrapping_add(TILT_LIMIT));
    fixed::negative(raised.wrapping_sub(2 * TILT_LIMIT - 1)).wrapping_add(TILT_LIMIT - 1)
}

#[inline(always)]
fn sum([west, east, north, south]: [i32; 4]) -> i32 {
    west.wrapping_add(east).wrapping_add(north).wrapping_add(south)
}

/// Floor of 2^32 / count, or one less; that of one for none.
#[inline]
pub(crate) fn reciprocal(count: u32) -> i64 {
    i64::from(u32::MAX / count.max(1))
}

/// The mean of what sums up to `sum`, below 2^31 with it, by the reciprocal of its count.
#[inline]
pub(crate) fn mean(sum: i64, inverse_q32: i64) -> i32 {
    fixed::round_shift(sum.wrapping_mul(inverse_q32), 32) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of `bits`, one after the other, of both signs.
    fn random(state: &mut u32, bits: u32) -> i32 {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (*state as i32) >> (32 - bits)
    }

    /// keep c + take x by products that are rounded down, and 1: off by more than -1 and up to 1 ulp, by none in the
    /// mean, and by two roundings' 1/12 in the square.
    #[test]
    fn a_step_is_rounded_without_a_bias() {
        let mut state = 1;
        let (mut sum, mut squares) = (0.0, 0.0);
        const STEPS: u32 = 300_000;
        for _ in 0..STEPS {
            let gains = Gains {
                keep: random(&mut state, 14).clamp(-8191, 8191) as i16,
                take: random(&mut state, 16).max(1) as i16,
            };
            let [keep, take] = [gains.keep, gains.take].map(|g| f64::from(g) / 8192.0);
            let word = Changes::from(gains);
            assert_eq!(Gains::from(word), gains);
            // c at its limits, and x twice 3 x 2^23.
            let (c, u) = (random(&mut state, 24), random(&mut state, 31) / 4 * 3);
            let step = advance(word.0.wrapping_add(Changes::HOLD), c, u) + 1;
            let error = f64::from(step) - (keep * f64::from(c) + take * f64::from(u) / 16.0);
            assert!(error > -1.0 && error <= 1.0, "{gains:?} of {c} and {u}: {error}");
            sum += error;
            squares += error * error;
        }
        let (mean, rms) = (sum / f64::from(STEPS), (squares / f64::from(STEPS)).sqrt());
        // Five standard deviations of that many.
        assert!(mean.abs() < 5.0 * 0.41 / f64::from(STEPS).sqrt(), "{mean}");
        assert!((rms - (1.0f64 / 6.0).sqrt()).abs() < 0.01, "{rms}");
    }

    /// Measured itself, by the mean over its measured neighbours, or not at all: within the two roundings of the step
    /// and, of neighbours, a sixteenth.
    #[test]
    fn what_is_known_of_x_is_taken() {
        let mut state = 2;
        let gains = Gains { keep: 4096, take: 4628 };
        for valid in 0..32u32 {
            for size in [4, 20, 25] {
                let is = |i: u32| valid >> i & 1 != 0;
                let x: [[i32; 2]; 5] = std::array::from_fn(|i| {
                    [0; 2].map(|_| random(&mut state, size) * i32::from(is(i as u32)))
                });
                let stored = |i: u32| {
                    let [x, y] = x[i as usize];
                    [x * 16 + i32::from(is(i)), y * 16]
                };
                let means = [0; 2].map(|_| random(&mut state, size + 4));
                let before = [0; 2].map(|_| random(&mut state, 20));
                let mut command = before;
                Changes::from(gains).update(
                    &mut command,
                    stored(4),
                    [0, 1, 2, 3].map(stored),
                    means,
                );
                let known: Vec<u32> =
                    if is(4) { vec![4] } else { (0..4).filter(|&i| is(i)).collect() };
                if known.is_empty() {
                    assert_eq!(command, before);
                    continue;
                }
                for axis in 0..2 {
                    let sum: f64 = known.iter().map(|&i| f64::from(x[i as usize][axis])).sum();
                    let u = sum / known.len() as f64 - f64::from(means[axis]) / 16.0;
                    let expected = 0.5 * f64::from(before[axis]) + 4628.0 / 8192.0 * u;
                    let expected =
                        expected.clamp(-f64::from(TILT_LIMIT), f64::from(TILT_LIMIT - 1));
                    let error = f64::from(command[axis]) - expected;
                    assert!(error.abs() <= 1.0 + 4628.0 / 8192.0 / 16.0, "{known:?}: {error}");
                }
            }
        }
    }

    /// A tilt that all commands have in common is in no u: what is left of it is (1 - g)^k, whatever f is, with
    /// subapertures that are dark and one that holds.
    #[test]
    fn a_common_tilt_decays() {
        const M: usize = 32;
        let config = ControlConfig { mean: MeanSlope::Remove, delay: 0 };
        let grid = Grid::new(4);
        // g = 1/4, f = 1.9.
        let gains = Gains { keep: 6144, take: 3891 };
        let mut control = Control::<M>::new();
        let mut changes = RedBlack::<Changes, M>::new(Changes::NONE);
        let places: Vec<Place> =
            (0..16).map(|i| Place::new::<M>(grid.node(i % 4, i / 4))).collect();
        for &place in &places {
            *changes.get_mut(place).expect("on the grid") = gains.into();
            control.adopt(place, [100_000, -70_000]);
        }
        for frame in 1..=40 {
            control.begin();
            let shown: Vec<[i32; 2]> = places
                .iter()
                .map(|&place| *control.commands().get(place).expect("there"))
                .collect();
            let Some((_, mut taking)) = control.taking(&config) else { unreachable!() };
            taking.take(places.iter().zip(&shown).enumerate().map(|(i, (&place, &shown))| {
                // A corner and its two neighbours: nothing is known of it. They take what is beside them.
                let valid = ![0, 1, 4, 10].contains(&i);
                (place, Slope { tilt_ulp: [0; 2], valid }, shown)
            }));
            control.update(&config, &grid, &changes);
            for (i, &place) in places.iter().enumerate() {
                let [c, d] = *control.commands().get(place).expect("there");
                if i == 0 {
                    assert_eq!([c, d], [100_000, -70_000], "it holds");
                    continue;
                }
                let part = 0.75f64.powi(frame);
                // 1 ulp a frame, over 1 / g.
                assert!((f64::from(c) - 1e5 * part).abs() <= 4.5, "{i}, frame {frame}: {c}");
                assert!((f64::from(d) + 7e4 * part).abs() <= 4.5, "{i}, frame {frame}: {d}");
            }
        }
    }
}
