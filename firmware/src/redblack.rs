//! A field on the padded grid, split by colour, with its four neighbours as plain slices.
//!
//! Padded node `f` is red if even: red node h is `f = 2 h`, black node h is `f = 2 h + 1`, each in
//! its own half-length array. With an odd stride S the neighbours of every node of one colour lie
//! in the other at one offset each:
//!
//! | | west f-1 | east f+1 | north f-S | south f+S |
//! |---|---|---|---|---|
//! | red h | black h-1 | black h | black h-(S+1)/2 | black h+(S-1)/2 |
//! | black h | red h | red h+1 | red h-(S-1)/2 | red h+(S+1)/2 |
//!
//! so that a stage over all nodes of a colour is one loop over parallel slices, without an index,
//! a bound check or an order of its own.

use crate::geometry::Grid;

/// The colours.
pub(crate) const COLOURS: [usize; 2] = [RED, 1];
/// The one that is updated first.
pub(crate) const RED: usize = 0;

/// One value a padded node; zero where there is no subaperture, but for unknowns of [`crate::sor`].
#[derive(Debug)]
pub struct RedBlack<T, const M: usize>([[T; M]; 2]);

/// Where a padded node's value is: its colour's half and its place there, as one index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct Place(u16);

impl Place {
    /// The place of padded node `padded` in fields of capacity `M`.
    #[must_use]
    pub const fn new<const M: usize>(padded: usize) -> Self {
        // Below 2 x 1600.
        Self((padded / 2 + padded % 2 * M) as u16)
    }

    /// Whether it is one of a black node, in fields of capacity `M`.
    #[must_use]
    #[inline(always)]
    pub(crate) const fn is_black<const M: usize>(self) -> bool {
        self.0 as usize >= M
    }

    /// Which of both halves one after the other.
    #[cfg(target_arch = "riscv32")]
    pub(crate) const fn index(self) -> usize {
        self.0 as usize
    }

    /// The padded node, in fields of capacity `M`: even if red, odd if black.
    #[must_use]
    pub(crate) const fn padded<const M: usize>(self) -> usize {
        let place = self.0 as usize;
        if place < M { 2 * place } else { 2 * (place - M) + 1 }
    }
}

/// The neighbours of the nodes of one colour, in step with [`RedBlack::nodes`].
#[derive(Clone, Copy)]
pub(crate) struct Sides<'a, T> {
    /// The west of the first node; the east of each is the west of the next.
    west: T,
    east: &'a [T],
    north: &'a [T],
    south: &'a [T],
}

impl<'a, T: Copy> Sides<'a, T> {
    /// West, east, north and south of one node after the other.
    #[inline(always)]
    pub(crate) fn iter(self) -> impl Iterator<Item = [T; 4]> + 'a {
        let mut next = self.west;
        let rows = self.north.iter().zip(self.south);
        self.east.iter().zip(rows).map(move |(&east, (&north, &south))| {
            let west = core::mem::replace(&mut next, east);
            [west, east, north, south]
        })
    }
}

/// Where the nodes of one colour, all rows but the padded ones, start in its half, and their neighbours in
/// the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Offsets {
    pub(crate) own: usize,
    pub(crate) west: usize,
    pub(crate) east: usize,
    pub(crate) north: usize,
    pub(crate) south: usize,
    /// How many they are.
    pub(crate) places: usize,
}

impl Offsets {
    #[inline(always)]
    pub(crate) const fn new(grid: &Grid, colour: usize) -> Self {
        let (row, red) = (grid.stride / 2, 1 - colour);
        let own = row + red;
        Self {
            own,
            west: own - red,
            east: own + colour,
            // A row is half a node longer than its half.
            north: own - row - red,
            south: own + row + colour,
            places: (grid.nodes / 2).saturating_sub(grid.stride),
        }
    }

    /// As many of a half as there are places, from `start` on.
    #[inline(always)]
    fn of<T>(self, half: &[T], start: usize) -> &[T] {
        half.get(start..start + self.places).unwrap_or_default()
    }

    /// The sides, from the other colour's half.
    #[inline(always)]
    fn sides<T: Copy + Default>(self, other: &[T]) -> Sides<'_, T> {
        Sides {
            west: other.get(self.west).copied().unwrap_or_default(),
            east: self.of(other, self.east),
            north: self.of(other, self.north),
            south: self.of(other, self.south),
        }
    }
}

impl<T: Copy + Default, const M: usize> RedBlack<T, M> {
    /// `value` everywhere.
    pub const fn new(value: T) -> Self {
        Self([[value; M]; 2])
    }

    /// Sets every node to `value`.
    pub fn fill(&mut self, value: T) {
        self.0.as_flattened_mut().fill(value);
    }

    /// The value at a place; `None` off the grid.
    #[inline(always)]
    pub fn get(&self, place: Place) -> Option<&T> {
        self.0.as_flattened().get(usize::from(place.0))
    }

    /// The value at a place; `None` off the grid.
    #[inline(always)]
    pub fn get_mut(&mut self, place: Place) -> Option<&mut T> {
        self.0.as_flattened_mut().get_mut(usize::from(place.0))
    }

    /// One colour's half.
    #[inline(always)]
    pub(crate) fn half(&self, colour: usize) -> &[T; M] {
        let [red, black] = &self.0;
        if colour == 0 { red } else { black }
    }

    /// The same, to write.
    #[inline(always)]
    pub(crate) fn half_mut(&mut self, colour: usize) -> &mut [T; M] {
        let [red, black] = &mut self.0;
        if colour == 0 { red } else { black }
    }

    /// The nodes of one colour.
    #[inline(always)]
    pub(crate) fn nodes(&self, grid: &Grid, colour: usize) -> &[T] {
        let at = Offsets::new(grid, colour);
        at.of(self.half(colour), at.own)
    }

    /// The nodes of one colour, to write.
    #[inline(always)]
    pub(crate) fn nodes_mut(&mut self, grid: &Grid, colour: usize) -> &mut [T] {
        let at = Offsets::new(grid, colour);
        self.half_mut(colour).get_mut(at.own..at.own + at.places).unwrap_or_default()
    }

    /// The neighbours of the nodes of one colour.
    #[inline(always)]
    pub(crate) fn sides(&self, grid: &Grid, colour: usize) -> Sides<'_, T> {
        Offsets::new(grid, colour).sides(self.half(1 - colour))
    }

    /// The nodes of one colour, to write, and their neighbours.
    #[inline(always)]
    pub(crate) fn nodes_and_sides(
        &mut self,
        grid: &Grid,
        colour: usize,
    ) -> (&mut [T], Sides<'_, T>) {
        let at = Offsets::new(grid, colour);
        let [red, black] = &mut self.0;
        let (own, other) = if colour == 0 { (red, black) } else { (black, red) };
        (own.get_mut(at.own..at.own + at.places).unwrap_or_default(), at.sides(other))
    }

    /// Both halves.
    #[cfg(any(target_arch = "riscv32", armv7em, test))]
    #[inline(always)]
    pub(crate) const fn halves(&self) -> &[[T; M]; 2] {
        &self.0
    }

    /// Both halves, to write.
    #[cfg(any(target_arch = "riscv32", armv7em, test))]
    #[inline(always)]
    pub(crate) const fn halves_mut(&mut self) -> &mut [[T; M]; 2] {
        &mut self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{MAX_ACROSS, MIN_ACROSS};

    #[test]
    fn sides_are_the_four_neighbours() {
        for across in MIN_ACROSS..=MAX_ACROSS {
            let grid = Grid::new(across);
            let mut field = RedBlack::<usize, { 40 * 40 }>::new(usize::MAX);
            for f in 0..grid.nodes {
                *field.get_mut(Place::new::<{ 40 * 40 }>(f)).expect("on the grid") = f;
            }
            let mut seen = 0;
            for colour in COLOURS {
                let nodes = field.nodes(&grid, colour);
                let sides = field.sides(&grid, colour);
                assert_eq!(sides.iter().count(), nodes.len());
                for (&f, [w, e, n, s]) in nodes.iter().zip(sides.iter()) {
                    assert_eq!(f % 2, colour);
                    assert_eq!([w, e], [f - 1, f + 1]);
                    assert_eq!([n, s], [f - grid.stride, f + grid.stride]);
                    seen += 1;
                }
            }
            let (first, last) = (grid.node(0, 0), grid.node(across - 1, across - 1));
            assert!(seen > last - first, "N = {across}: every cell is visited");
            for colour in COLOURS {
                let nodes = field.nodes(&grid, colour);
                assert!(nodes.first().is_some_and(|&f| f <= first + 1));
                assert!(nodes.last().is_some_and(|&f| f + 1 >= last));
            }
        }
    }
}
