//! All nodes of one colour, in the machine's own instructions: what [`super::edges`], [`super::totals`] and the
//! Cortex-M7's [`super::law`] have in common.
//!
//! Four places a turn, or eight, each with a constant offset: there is a pointer for each thing that is read or
//! written, and it moves once a turn. Where there is no node the east is read, at most: the mask decides about
//! time, and never the data.

use crate::redblack::{Offsets, RedBlack};
use core::marker::PhantomData;

/// Places a turn, but where one says otherwise.
pub(super) const TURN: usize = 4;

/// Places by which the first turn's pointers are before the first place: it is entered behind them.
pub(super) const fn first_turn(places: usize, turn: usize) -> usize {
    turn - places % turn
}

/// Where the nodes of one colour are in a field, and their neighbours.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk<'a, T> {
    own: *const T,
    /// The west of each is the east of the place before.
    east: *const T,
    north: *const T,
    south: *const T,
    places: usize,
    lent: PhantomData<&'a [T]>,
}

/// Where the first turn's pointers are.
pub(super) struct Start<T> {
    pub(super) own: *const T,
    pub(super) east: *const T,
    pub(super) north: *const T,
    pub(super) south: *const T,
    /// That of `own` in the last turn.
    pub(super) end: *const T,
    /// Places by which they are before the first one.
    pub(super) back: usize,
}

impl<'a, T: Copy + Default> Walk<'a, T> {
    /// `None` unless each pointer is followed by as many places within its half as there are, and the first east
    /// has one before it.
    #[inline(always)]
    pub(super) fn new<const M: usize>(
        field: &'a RedBlack<T, M>,
        colour: usize,
        at: &Offsets,
    ) -> Option<Self> {
        let (own, other) = (field.half(colour).as_ptr(), field.half(1 - colour).as_ptr());
        let last = M.checked_sub(at.places)?;
        let starts = [at.own, at.east, at.north, at.south];
        let whole = starts.into_iter().all(|start| start <= last) && at.west + 1 == at.east;
        (whole && at.west < M).then_some(Self {
            own: own.wrapping_add(at.own),
            east: other.wrapping_add(at.east),
            north: other.wrapping_add(at.north),
            south: other.wrapping_add(at.south),
            places: at.places,
            lent: PhantomData,
        })
    }

    /// The first node's west.
    #[inline(always)]
    pub(super) fn west(&self) -> T {
        // SAFETY: `new` found it within its half, which the lifetime lends.
        #[allow(unsafe_code)]
        unsafe {
            *self.east.wrapping_sub(1)
        }
    }

    /// Where the first turn starts.
    #[cfg(armv7em)]
    #[inline(always)]
    pub(super) fn start(&self) -> Start<T> {
        self.start_of(TURN)
    }

    /// The same of turns of so many places.
    #[inline(always)]
    pub(super) fn start_of(&self, turn: usize) -> Start<T> {
        let back = first_turn(self.places, turn);
        Start {
            own: self.own.wrapping_sub(back),
            east: self.east.wrapping_sub(back),
            north: self.north.wrapping_sub(back),
            south: self.south.wrapping_sub(back),
            end: self.own.wrapping_add(self.places).wrapping_sub(turn),
            back,
        }
    }
}

/// A sum of numbers within 2^28, of what it is modulo 2^32 and of what it is without their 14 lowest bits.
pub(super) const fn sum(low: i32, high: i32) -> i64 {
    let rest = low.wrapping_sub(high << 14) as u32;
    ((high as i64) << 14) + rest as i64
}
