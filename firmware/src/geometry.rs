//! Pupil mask and grid: which of the N x N cells are subapertures, and who neighbours whom.
//!
//! Column x grows to the east, row y to the south; subapertures are numbered in row-major order
//! of the mask (x fastest). The relaxation sees the grid padded to an odd stride, so that the
//! four neighbours of padded node `f` are `f - 1`, `f + 1`, `f - stride` and `f + stride`, an
//! absent neighbour is a padded zero (or what [`crate::sor`] has for one), and the parity of `f` is the red-black colour.

use crate::error::{ConfigError, Field, Limit};

/// Smallest number of subapertures across the pupil.
pub const MIN_ACROSS: usize = 4;
/// Largest number of subapertures across the pupil.
pub const MAX_ACROSS: usize = 40;

/// The subapertures of an N x N grid, one bit a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mask {
    across: u8,
    rows: [u64; MAX_ACROSS],
}

impl Mask {
    /// A mask from a rule on the column and the row of a cell.
    ///
    /// # Errors
    /// [`Field::Across`] unless `4 <= across <= 40`.
    pub fn from_fn(
        across: usize,
        mut inside: impl FnMut(usize, usize) -> bool,
    ) -> Result<Self, ConfigError> {
        if !(MIN_ACROSS..=MAX_ACROSS).contains(&across) {
            let limit = Limit::Within(MIN_ACROSS as f64, MAX_ACROSS as f64);
            return Err(ConfigError::new(Field::Across, across as f64, limit));
        }
        let mut rows = [0; MAX_ACROSS];
        for (y, row) in rows.iter_mut().take(across).enumerate() {
            for x in 0..across {
                *row |= u64::from(inside(x, y)) << x;
            }
        }
        Ok(Self { across: across as u8, rows })
    }

    /// Every cell.
    ///
    /// # Errors
    /// As [`Mask::from_fn`].
    pub fn square(across: usize) -> Result<Self, ConfigError> {
        Self::from_fn(across, |_, _| true)
    }

    /// The cells whose centre lies inside the circle of N pitches' diameter (52, 112 and 208 of
    /// them for N = 8, 12 and 16).
    ///
    /// # Errors
    /// As [`Mask::from_fn`].
    pub fn circle(across: usize) -> Result<Self, ConfigError> {
        Self::annulus(across, 0.0)
    }

    /// The cells whose centre lies inside the circle and not inside a central obstruction of
    /// `obstruction` (0 to 1) of its diameter.
    ///
    /// # Errors
    /// As [`Mask::from_fn`], and [`Field::Obstruction`] unless `0 <= obstruction <= 0.99`.
    pub fn annulus(across: usize, obstruction: f64) -> Result<Self, ConfigError> {
        ConfigError::check(Field::Obstruction, None, obstruction, (0.0, 0.99))?;
        let outer = across as f64 * across as f64;
        let inner = outer * obstruction * obstruction;
        Self::from_fn(across, |x, y| {
            let r2 = radius_squared(across, x, y) as f64;
            r2 < outer && r2 >= inner
        })
    }

    /// This mask without the cells that a horizontal and a vertical spider vane cover: the middle
    /// row and column (two of each when N is even).
    #[must_use]
    pub fn with_spider(self) -> Self {
        let last = self.across() - 1;
        self.without(|x, y| (2 * x).abs_diff(last) <= 1 || (2 * y).abs_diff(last) <= 1)
    }

    /// This mask without the cells that `hole` names.
    #[must_use]
    pub fn without(mut self, mut hole: impl FnMut(usize, usize) -> bool) -> Self {
        let across = self.across();
        for (y, row) in self.rows.iter_mut().take(across).enumerate() {
            for x in 0..across {
                *row &= !(u64::from(hole(x, y)) << x);
            }
        }
        self
    }

    /// N, the subapertures across the pupil.
    #[must_use]
    pub const fn across(&self) -> usize {
        self.across as usize
    }

    /// One bit a cell, x from bit 0, row by row.
    pub(crate) fn rows(&self) -> &[u64] {
        self.rows.get(..self.across()).unwrap_or_default()
    }

    /// Whether the cell in column `x`, row `y` is a subaperture; `false` off the grid.
    #[must_use]
    pub fn contains(&self, x: usize, y: usize) -> bool {
        x < self.across() && self.rows.get(y).is_some_and(|row| (row >> x) & 1 == 1)
    }

    /// The number of subapertures.
    #[must_use]
    pub fn count(&self) -> usize {
        self.rows.iter().map(|row| row.count_ones() as usize).sum()
    }

    /// Column and row of each subaperture, in row-major order.
    pub fn cells(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let across = self.across();
        (0..across * across)
            .map(move |i| (i % across, i / across))
            .filter(|&(x, y)| self.contains(x, y))
    }
}

/// The squared distance of a cell's centre from the grid's centre, in half pitches.
fn radius_squared(across: usize, x: usize, y: usize) -> usize {
    let last = across - 1;
    (2 * x).abs_diff(last).pow(2) + (2 * y).abs_diff(last).pow(2)
}

/// The padded grid of an N x N pupil.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Nodes from one row to the next: N + 1 or N + 2, whichever is odd.
    pub stride: usize,
    /// Nodes in all, rounded up to whole red-black pairs. At most 2 N^2 for N >= 4.
    pub nodes: usize,
}

impl Grid {
    /// The padded grid for `across` subapertures: one empty row above, one below, and one or two
    /// empty columns between the end of a row and the start of the next.
    #[must_use]
    pub const fn new(across: usize) -> Self {
        let stride = across + 1 + across % 2;
        Self { stride, nodes: ((across + 2) * stride).next_multiple_of(2) }
    }

    /// The node of the cell in column `x`, row `y`.
    #[must_use]
    pub const fn node(&self, x: usize, y: usize) -> usize {
        (y + 1) * self.stride + x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn circles_have_the_published_counts() {
        for (across, count) in [(8, 52), (12, 112), (16, 208)] {
            assert_eq!(Mask::circle(across).map(|m| m.count()), Ok(count));
        }
    }

    #[test]
    fn grid_fits_its_capacity_and_colours_alternate() {
        for across in MIN_ACROSS..=MAX_ACROSS {
            let grid = Grid::new(across);
            assert!(grid.nodes <= 2 * across * across, "N = {across}");
            assert_eq!(grid.stride % 2, 1);
            assert!(grid.node(across - 1, across - 1) + grid.stride < grid.nodes);
            for y in 0..across {
                for x in 0..across {
                    assert_eq!(grid.node(x, y) % 2, (x + y + 1) % 2);
                }
            }
        }
    }

    #[test]
    fn refuses_what_it_cannot_hold() {
        for across in [0, 3, 41] {
            let error = ConfigError::new(Field::Across, across as f64, Limit::Within(4.0, 40.0));
            assert_eq!(Mask::square(across), Err(error));
        }
        assert!(Mask::annulus(8, 1.0).is_err());
        assert!(Mask::annulus(8, f64::NAN).is_err());
    }
}
