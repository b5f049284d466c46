//! Two gates: what a second range says of the height of the turbulence, as a low-order correction.
//!
//! One beacon height cannot tell a high layer from the ground. A second gate images the same pulses
//! at another range, in windows of its own; the modes in which the two differ tell them apart:
//!
//! ```text
//! x1 = s1 + c_applied,  x2 = s2 + c_applied                 both see the mirror alike
//! c' = (1 - g) c + g (f x1 + q B [q^T x1; q^T x2])
//! ```
//!
//! q: M orthonormal gradients over both axes, none with a uniform tilt; B: M x 2M = [B1 B2]. Since
//! x2 = x1 + d with d = s2 - s1, this is the [control law](crate::control) with x1 replaced by
//!
//! ```text
//! x = x1 + q C [a; b],   a = q^T (x1 - mean_valid(x1)),   b = q^T (d - mean_valid(d))
//! C = [B1 + B2, B2] / f
//! ```
//!
//! The mirror is not in d: with the command that was on it while the slopes were taken the pole is
//! 1 - g whatever B is.
//!
//! **What is invalid.** A subaperture whose first gate is invalid is in neither a nor b, and takes
//! its neighbours' mean of x, as without modes. Where only the second is invalid, d counts as its mean:
//! the second gate is taken to see there what the first sees. (To leave out x2 alone would leave B1 x1,
//! in which nothing cancels.) Both means are over the valid, and taken off with the sum of q
//! over the valid, so that no mode has a part of a uniform tilt whoever is missing. Without any of the
//! second gate's the law is f x1 + q (B1 + B2) q^T x1; it is no reason to hold a frame.
//!
//! **Time.** a and b are summed as windows end: each of the second gate comes after its
//! subaperture's first. 2 M^2 + 2 n M multiplications are left when the last has ended. No time depends
//! on what is valid. All of it is left out where `K` is 0.
//!
//! **Formats.** q: i16 under one binary exponent, the largest with 15 bits; C: Q12 within +-64. With x1
//! within 3 x 2^23 and d within 2^24, the sum over 2 x 1600 products is below 2^52, less the mean's part
//! below 2^53. a and b are rounded once, to an ulp; C [a; b] sums 50 products below 2^48, and q of
//! it 25 below 2^45, each rounded once to an ulp. a, b, C [a; b] and the correction saturate at +-2^30, x
//! at 3 x 2^23, the range of x1. The means have the floor of 2^32 / count, low by less than 4e-7 of
//! themselves.

use crate::control::{Control, mean, reciprocal};
use crate::error::{ConfigError, Field, Limit};
use crate::fixed;
use crate::slopes::Slope;
use crate::sor::Node;
use serde::{Deserialize, Serialize};

/// Most modes.
pub const MAX_MODES: usize = 25;
/// Fraction bits of C.
pub(crate) const COUPLING_BITS: u32 = 12;
/// Largest magnitude of an entry of C.
pub(crate) const COUPLING_LIMIT: f64 = 64.0;
/// Binary exponents of q: no entry of a unit vector is above 1, and the largest of 3200 not below 1/57.
pub(crate) const EXPONENTS: (u32, u32) = (14, 20);
const EXPONENT_RULE: Limit = Limit::Rule("binary exponent: must be 14 to 20");
/// Bits to which modes are orthonormal and without uniform tilt.
const ORTHONORMAL_BITS: u32 = 8;

/// How modes are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModalHead {
    /// M, 1 to [`MAX_MODES`]; 0 for one gate alone.
    pub modes: u8,
    /// Binary exponent: q = entry 2^-exponent, 14 to 20.
    pub exponent: u8,
}

/// Modes and what becomes of them. Capacities: `M` subapertures, `K` modes.
#[derive(Debug)]
pub(crate) struct ModalConfig<const M: usize, const K: usize> {
    pub(crate) head: ModalHead,
    /// Of each subaperture, the x and y gradient of each mode.
    pub(crate) gradients: [[[i16; 2]; K]; M],
    /// Row by row, Q12: what a and b of each mode add to that of the row.
    pub(crate) coupling: [[[i32; 2]; K]; K],
}

/// Sums of one mode over valid subapertures.
#[derive(Clone, Copy, Debug)]
struct Projection {
    /// Of q x over both axes, 2^-exponent ulp.
    product: i64,
    /// Of q, by axis.
    gradient: [i32; 2],
}

/// What the windows of a frame have left. `K` as in [`ModalConfig`].
#[derive(Debug)]
pub(crate) struct Modal<const K: usize> {
    /// Of x1 and of d.
    projections: [[Projection; 2]; K],
    /// Sum of d over the subapertures valid in both gates, ulp, and how many.
    difference: [i64; 2],
    valid: u32,
}

/// A subaperture as both gates saw it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    /// Of the first gate, with what the mirror showed.
    pub(crate) open_loop_ulp: [i32; 2],
    /// Of the second gate, less that of the first.
    pub(crate) difference_ulp: [i32; 2],
    /// Of the first gate, and of both.
    pub(crate) valid: [bool; 2],
}

impl Pair {
    /// Of the slopes of both gates, and what the mirror showed.
    pub(crate) fn new(applied_ulp: [i32; 2], first: &Slope, second: &Slope) -> Self {
        let ([s, t], [u, v], [tip, tilt]) = (first.tilt_ulp, second.tilt_ulp, applied_ulp);
        Self {
            open_loop_ulp: [s.wrapping_add(tip), t.wrapping_add(tilt)],
            difference_ulp: [u.wrapping_sub(s), v.wrapping_sub(t)],
            valid: [first.valid, first.valid & second.valid],
        }
    }
}

impl Projection {
    const ZERO: Self = Self { product: 0, gradient: [0; 2] };

    /// Adds q x; nothing where `mask` is 0 and x with it, all where it is -1.
    #[inline(always)]
    fn add(&mut self, [qx, qy]: [i16; 2], [x, y]: [i32; 2], mask: i32) {
        let ([qx, qy], [gx, gy]) = ([i32::from(qx), i32::from(qy)], &mut self.gradient);
        let sum = i64::from(qx) * i64::from(x) + i64::from(qy) * i64::from(y);
        self.product = self.product.wrapping_add(sum);
        *gx = gx.wrapping_add(qx & mask);
        *gy = gy.wrapping_add(qy & mask);
    }

    /// q^T (x - mean), ulp.
    #[inline(always)]
    fn amplitude(&self, [mean_x, mean_y]: [i32; 2], exponent: u32) -> i32 {
        let part = |gradient: i32, mean: i32| i64::from(gradient) * i64::from(mean);
        let [gx, gy] = self.gradient;
        let sum = self.product.wrapping_sub(part(gx, mean_x)).wrapping_sub(part(gy, mean_y));
        fixed::narrow(fixed::round_shift(sum, exponent))
    }
}

impl<const K: usize> Modal<K> {
    pub(crate) const fn new() -> Self {
        Self { projections: [[Projection::ZERO; 2]; K], difference: [0; 2], valid: 0 }
    }

    /// Forgets an unfinished frame.
    pub(crate) fn begin(&mut self) {
        *self = Self::new();
    }

    /// Takes subaperture `i`.
    ///
    /// Not inlined: its loop needs all registers.
    #[inline(never)]
    pub(crate) fn take<const M: usize>(
        &mut self,
        config: &ModalConfig<M, K>,
        i: usize,
        pair: &Pair,
    ) {
        let [first, both] = pair.valid.map(|valid| 0i32.wrapping_sub(i32::from(valid)));
        let x = pair.open_loop_ulp.map(|x| x & first);
        let d = pair.difference_ulp.map(|d| d & both);
        let gradients = config.of(i);
        for (&q, [of_x, of_d]) in gradients.iter().zip(&mut self.projections) {
            of_x.add(q, x, first);
            of_d.add(q, d, both);
        }
        let ([sum_x, sum_y], [dx, dy]) = (&mut self.difference, d);
        *sum_x = sum_x.wrapping_add(i64::from(dx));
        *sum_y = sum_y.wrapping_add(i64::from(dy));
        self.valid = self.valid.wrapping_add(u32::from(pair.valid[1]));
    }

    /// Adds the correction to every measured x, once all subapertures were taken.
    ///
    /// Not inlined: its loops need all registers.
    #[inline(never)]
    pub(crate) fn correct<const M: usize>(
        &self,
        config: &ModalConfig<M, K>,
        nodes: &[Node],
        control: &mut Control<M>,
    ) {
        let weights = self.weights(config, control.mean_open_loop());
        let exponent = u32::from(config.head.exponent);
        for (node, gradients) in nodes.iter().zip(&config.gradients) {
            let [mut x, mut y] = [0i64; 2];
            for (&[qx, qy], &weight) in gradients.iter().zip(config.in_use(&weights)) {
                x = x.wrapping_add(i64::from(qx) * i64::from(weight));
                y = y.wrapping_add(i64::from(qy) * i64::from(weight));
            }
            let ulp = [x, y].map(|sum| fixed::narrow(fixed::round_shift(sum, exponent)));
            control.correct(node.place, ulp);
        }
    }

    /// C [a; b], ulp.
    fn weights<const M: usize>(&self, config: &ModalConfig<M, K>, mean_x: [i32; 2]) -> [i32; K] {
        let inverse = reciprocal(self.valid);
        let mean_d = self.difference.map(|sum| mean(sum, inverse));
        let exponent = u32::from(config.head.exponent);
        let amplitudes = self
            .projections
            .map(|[x, d]| [x.amplitude(mean_x, exponent), d.amplitude(mean_d, exponent)]);
        let mut weights = [0; K];
        for (weight, row) in weights.iter_mut().zip(config.in_use(&config.coupling)) {
            let mut sum = 0i64;
            for ([of_a, of_b], [a, b]) in row.iter().zip(config.in_use(&amplitudes)) {
                sum = sum.wrapping_add(i64::from(*of_a) * i64::from(*a));
                sum = sum.wrapping_add(i64::from(*of_b) * i64::from(*b));
            }
            *weight = fixed::narrow(fixed::round_shift(sum, COUPLING_BITS));
        }
        weights
    }
}

impl<const M: usize, const K: usize> ModalConfig<M, K> {
    pub(crate) const NONE: Self = Self {
        head: ModalHead { modes: 0, exponent: 0 },
        gradients: [[[0; 2]; K]; M],
        coupling: [[[0; 2]; K]; K],
    };

    /// Whether there is a second gate.
    #[inline(always)]
    pub(crate) const fn is_on(&self) -> bool {
        K > 0 && self.head.modes > 0
    }

    /// How many windows a subaperture has.
    pub(crate) const fn gates(&self) -> usize {
        if self.is_on() { 2 } else { 1 }
    }

    /// Those of `all` that are of a mode.
    #[inline(always)]
    fn in_use<'a, T>(&self, all: &'a [T; K]) -> &'a [T] {
        all.get(..usize::from(self.head.modes)).unwrap_or_default()
    }

    /// Gradients of the modes at subaperture `i`.
    #[inline(always)]
    pub(crate) fn of(&self, i: usize) -> &[[i16; 2]] {
        self.gradients.get(i).map_or(&[], |all| self.in_use(all))
    }

    /// These, to be changed.
    pub(crate) fn of_mut(&mut self, i: usize) -> &mut [[i16; 2]] {
        let modes = usize::from(self.head.modes);
        self.gradients.get_mut(i).and_then(|all| all.get_mut(..modes)).unwrap_or_default()
    }

    /// Row `k` of C, to be changed.
    pub(crate) fn row_mut(&mut self, k: usize) -> Option<&mut [[i32; 2]]> {
        let modes = usize::from(self.head.modes);
        self.coupling.get_mut(..modes)?.get_mut(k)?.get_mut(..modes)
    }

    /// Rows of C.
    pub(crate) fn rows(&self) -> impl Iterator<Item = &[[i32; 2]]> {
        self.in_use(&self.coupling).iter().map(|row| self.in_use(row))
    }

    /// Refuses modes that there is no room for.
    pub(crate) fn check_room(modes: usize) -> Result<(), ConfigError> {
        if K == 0 {
            let rule = Limit::Rule("modes: there is no room for a second gate here");
            return Err(ConfigError::new(Field::Modes, modes as f64, rule));
        }
        let limit = (1.0, K.min(MAX_MODES) as f64);
        ConfigError::check(Field::Modes, None, modes as f64, limit).map(|_| ())
    }

    /// That, and an exponent that modes cannot have.
    pub(crate) fn check_head(head: ModalHead) -> Result<(), ConfigError> {
        Self::check_room(head.modes.into())?;
        let (least, most) = EXPONENTS;
        if !(least..=most).contains(&head.exponent.into()) {
            return Err(ConfigError::new(Field::Modes, head.exponent.into(), EXPONENT_RULE));
        }
        Ok(())
    }

    /// Refuses an entry of C that is too large, the `at`-th of all.
    pub(crate) fn check_coupling(value: i32, at: usize) -> Result<(), ConfigError> {
        let unit = f64::from(1u32 << COUPLING_BITS);
        let limit = (-COUPLING_LIMIT, COUPLING_LIMIT);
        ConfigError::check(Field::Coupling, Some(at), f64::from(value) / unit, limit).map(|_| ())
    }

    /// Refuses modes that are not orthonormal, or have a uniform tilt, over `count` subapertures.
    pub(crate) fn check(&self, count: usize) -> Result<(), ConfigError> {
        let none = [[0; 2]; K];
        Self::check_modes(count, self.head, |i| self.gradients.get(i).copied().unwrap_or(none))
    }

    /// That for modes whose gradients at a subaperture are `gradients`.
    ///
    /// Not inlined: K^2 products are much to have on the stack of whatever goes on.
    #[inline(never)]
    pub(crate) fn check_modes(
        count: usize,
        head: ModalHead,
        gradients: impl Fn(usize) -> [[i16; 2]; K],
    ) -> Result<(), ConfigError> {
        let modes = usize::from(head.modes);
        if modes == 0 {
            return Ok(());
        }
        let (mut products, mut sums) = ([[0i64; K]; K], [[0i64; 2]; K]);
        for i in 0..count {
            let all = gradients(i).map(|q| q.map(i64::from));
            let all = all.get(..modes).unwrap_or_default();
            for (([x, y], products), [sum_x, sum_y]) in all.iter().zip(&mut products).zip(&mut sums)
            {
                (*sum_x, *sum_y) = (*sum_x + x, *sum_y + y);
                products.iter_mut().zip(all).for_each(|(sum, [u, v])| *sum += x * u + y * v);
            }
        }
        let unit = 1i64 << (2 * u32::from(head.exponent));
        let refuse =
            |k, value, rule| Err(ConfigError::at(Field::Modes, k, value, Limit::Rule(rule)));
        for (k, (products, sums)) in products.iter().zip(&sums).take(modes).enumerate() {
            for (j, &product) in products.iter().take(modes).enumerate() {
                let off = product - if j == k { unit } else { 0 };
                if off.abs() > unit >> ORTHONORMAL_BITS {
                    let rule =
                        "inner product with a mode: must be 1 with itself and 0 with any other";
                    return refuse(k, product as f64 / unit as f64, rule);
                }
            }
            // Of the unit vector of a uniform tilt, with 1 / sqrt(count) everywhere.
            let most = count as i64 * (unit >> (2 * ORTHONORMAL_BITS));
            if let Some(&sum) = sums.iter().find(|&&sum| sum * sum > most) {
                let rule = "sum along an axis: must be 0, a mode has no uniform tilt";
                return refuse(k, sum as f64 / libm::sqrt(unit as f64), rule);
            }
        }
        Ok(())
    }
}
