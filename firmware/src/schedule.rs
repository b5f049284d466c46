//! Schedule: which subapertures are lit together, where spots would overlap if all were.
//!
//! A schedule is a colouring of the subapertures. Each frame is a sub-cycle and lights one colour;
//! k sub-cycles are a cycle. After each of them only its colour's tips and tilts are updated, the
//! others hold, and the pistons relax over the whole pupil by max(1, round(K / k)) sweeps, K being those
//! of a frame without schedule. A sub-cycle that is skipped leaves its colour where it was and does not
//! stop the others.
//!
//! ```text
//! colour(x, y) = ((x - b floor(y / c)) mod a) + a (y mod c)       lattice (a, b, c), k = a c
//! ```
//!
//! | least separation, pitches | k | (a, b, c) |
//! |---|---|---|
//! | sqrt 2 | 2 | (2, 1, 1) |
//! | 2 | 4 | (2, 0, 2) |
//! | sqrt 5 | 5 | (5, 2, 1) |
//! | sqrt 8 | 8 | (4, 2, 2) |
//! | 3 | 9 | (3, 0, 3) |
//! | sqrt 10 | 10 | (10, 3, 1) |
//!
//! Two subapertures of one colour are never closer than the separation that the specification asks
//! for: that is checked, for a lattice as for a list.

use crate::error::{ConfigError, Field, Limit};
use crate::geometry::Mask;
use crate::spec::{Colouring, Spec};

/// Most sub-cycles of a cycle.
pub const MAX_COLOURS: usize = 64;

/// A colouring in use.
#[derive(Debug)]
pub(crate) struct Schedule<const M: usize> {
    /// Colour of each subaperture.
    pub(crate) colours: heapless::Vec<u8, M>,
    /// Colours: 1 without a schedule.
    pub(crate) count: u8,
    /// Warm sweeps after a sub-cycle.
    pub(crate) sweeps: u16,
}

impl<const M: usize> Schedule<M> {
    pub(crate) const NONE: Self = Self { colours: heapless::Vec::new(), count: 0, sweeps: 0 };

    /// Whether frames light a part of the pupil each.
    #[inline(always)]
    pub(crate) const fn is_partial(&self) -> bool {
        self.count > 1
    }

    /// The colour that frame `frame` lights, where the schedule does not follow another count.
    #[inline(always)]
    pub(crate) fn colour_of(&self, frame: u32) -> u8 {
        lit_by(frame, self.count)
    }

    /// Takes the colours of `spec`, which were checked.
    pub(crate) fn fill(&mut self, spec: &Spec<'_>) {
        self.colours.clear();
        for (i, cell) in spec.mask.cells().enumerate() {
            // One a subaperture, of which there are at most M.
            let _ = self.colours.push(colour(&spec.schedule.colouring, i, cell));
        }
        self.count_colours();
    }

    /// Counts the colours.
    pub(crate) fn count_colours(&mut self) {
        self.count = self.colours.iter().max().map_or(1, |&last| last.saturating_add(1));
    }

    /// The sweeps of a sub-cycle, from those of a whole frame.
    pub(crate) fn share(&mut self, sweeps: u16) {
        let count = u16::from(self.count.max(1));
        self.sweeps = ((sweeps.saturating_add(count / 2)) / count).max(1);
    }
}

/// The colour that frame `frame` lights, of `colours`: 0 of one or none.
#[inline(always)]
#[must_use]
pub const fn lit_by(frame: u32, colours: u8) -> u8 {
    // Below 256, as `colours` is.
    if colours > 1 { (frame % colours as u32) as u8 } else { 0 }
}

/// The colour of subaperture `i`, in cell (x, y); 0 where a list has none.
#[must_use]
pub fn colour(colouring: &Colouring<'_>, i: usize, (x, y): (usize, usize)) -> u8 {
    match *colouring {
        Colouring::None => 0,
        Colouring::Lattice([a, b, c]) => {
            let [a, b, c] = [a, b, c].map(i32::from);
            // Neither is zero once the colouring is checked.
            let (a, c) = (a.max(1), c.max(1));
            let (x, y) = (x as i32, y as i32);
            ((x - b * (y / c)).rem_euclid(a) + a * (y % c)) as u8
        }
        Colouring::List(colours) => colours.get(i).copied().unwrap_or(0),
    }
}

/// Refuses a colouring of too many colours, with one that no subaperture has, or with two subapertures
/// of one colour that are too close.
pub(crate) fn check(spec: &Spec<'_>) -> Result<(), ConfigError> {
    let count = spec.mask.count();
    if let Colouring::Lattice(lattice) = spec.schedule.colouring {
        let [a, _, c] = lattice.map(f64::from);
        ConfigError::check(Field::Lattice, Some(0), a, (1.0, MAX_COLOURS as f64))?;
        ConfigError::check(Field::Lattice, Some(2), c, (1.0, MAX_COLOURS as f64))?;
        ConfigError::check(Field::Colours, None, a * c, (1.0, MAX_COLOURS as f64))?;
    }
    if let Colouring::List(colours) = spec.schedule.colouring
        && colours.len() != count
    {
        let limit = Limit::Rule("entries: must be one a subaperture");
        return Err(ConfigError::new(Field::Colours, colours.len() as f64, limit));
    }
    let of = |(i, cell)| (colour(&spec.schedule.colouring, i, cell), cell);
    check_used(spec.mask.cells().enumerate().map(of).map(|(colour, _)| colour))?;
    if matches!(spec.schedule.colouring, Colouring::None) {
        return Ok(());
    }
    let separation = spec.schedule.separation;
    ConfigError::check(Field::Separation, None, separation, (0.0, MAX_COLOURS as f64))?;
    check_separation(&spec.mask, separation, |i, cell| colour(&spec.schedule.colouring, i, cell))
}

/// Refuses colours beyond the most, and gaps between them.
pub(crate) fn check_used(colours: impl Iterator<Item = u8>) -> Result<(), ConfigError> {
    let mut used = 0u64;
    for (i, colour) in colours.enumerate() {
        let highest = MAX_COLOURS as f64 - 1.0;
        ConfigError::check(Field::Colours, Some(i), colour.into(), (0.0, highest))?;
        used |= 1 << colour;
    }
    // The lowest zero is above the highest one.
    if used & used.wrapping_add(1) != 0 {
        let limit = Limit::Rule("is a colour that no subaperture has; there must be no gaps");
        let missing = f64::from(used.trailing_ones());
        return Err(ConfigError::new(Field::Colours, missing, limit));
    }
    Ok(())
}

/// Refuses two subapertures of one colour closer than `separation` pitches.
fn check_separation(
    mask: &Mask,
    separation: f64,
    colour: impl Fn(usize, (usize, usize)) -> u8,
) -> Result<(), ConfigError> {
    for (i, (x, y)) in mask.cells().enumerate() {
        for (j, (other_x, other_y)) in mask.cells().enumerate().skip(i + 1) {
            let apart = x.abs_diff(other_x).pow(2) + y.abs_diff(other_y).pow(2);
            let same = colour(i, (x, y)) == colour(j, (other_x, other_y));
            // A root that was rounded up still is met.
            if same && libm::sqrt(apart as f64) < separation {
                let limit = Limit::Within(separation, f64::INFINITY);
                return Err(ConfigError::at(Field::Separation, i, libm::sqrt(apart as f64), limit));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The least squared distance between cells of one colour on a large grid, and how many colours.
    fn apart(lattice: [u8; 3]) -> (usize, usize) {
        let mask = Mask::square(24).expect("a mask");
        let colouring = Colouring::Lattice(lattice);
        let cells: Vec<_> = mask.cells().enumerate().collect();
        let colours: Vec<u8> = cells.iter().map(|&(i, c)| colour(&colouring, i, c)).collect();
        let mut least = usize::MAX;
        for (i, &(_, (x, y))) in cells.iter().enumerate() {
            for (j, &(_, (u, v))) in cells.iter().enumerate().skip(i + 1) {
                if colours[i] == colours[j] {
                    least = least.min(x.abs_diff(u).pow(2) + y.abs_diff(v).pow(2));
                }
            }
        }
        let distinct: std::collections::BTreeSet<_> = colours.iter().collect();
        (least, distinct.len())
    }

    /// The table of the module: squared separation and colours of each lattice.
    #[test]
    fn lattices_keep_the_separations_of_the_table() {
        for (lattice, squared, colours) in [
            ([2, 1, 1], 2, 2),
            ([2, 0, 2], 4, 4),
            ([5, 2, 1], 5, 5),
            ([4, 2, 2], 8, 8),
            ([3, 0, 3], 9, 9),
            ([10, 3, 1], 10, 10),
        ] {
            assert_eq!(apart(lattice), (squared, colours), "{lattice:?}");
        }
    }

    #[test]
    fn separation_is_checked_to_the_pitch() {
        let mask = Mask::circle(8).expect("a mask");
        let colouring = Colouring::Lattice([5, 2, 1]);
        let check =
            |separation| check_separation(&mask, separation, |i, c| colour(&colouring, i, c));
        assert_eq!(check(f64::sqrt(5.0)), Ok(()));
        let error = check(2.3).expect_err("only the root of five");
        assert_eq!((error.field, error.value), (Field::Separation, f64::sqrt(5.0)));
    }

    #[test]
    fn colours_have_no_gaps_and_are_not_too_many() {
        let check = |colours: &[u8]| check_used(colours.iter().copied());
        assert_eq!(check(&[0, 2, 1, 0]), Ok(()));
        assert_eq!(check(&[0, 2, 0]).expect_err("no 1").value, 1.0);
        assert_eq!(check(&[1, 2]).expect_err("no 0").value, 0.0);
        assert_eq!(check(&[0, 64]).expect_err("too many").index, Some(1));
        let all: Vec<u8> = (0..64).collect();
        assert_eq!(check(&all), Ok(()));
    }

    #[test]
    fn sweeps_are_shared_and_at_least_one() {
        let mut schedule = Schedule::<64>::NONE;
        for (count, sweeps, expected) in [
            (1, 4, 4),
            (2, 4, 2),
            (4, 4, 1),
            (5, 4, 1),
            (5, 8, 2),
            (10, 4, 1),
            (3, 8, 3),
            (0, 7, 7),
        ] {
            schedule.count = count;
            schedule.share(sweeps);
            assert_eq!(schedule.sweeps, expected, "{sweeps} / {count}");
        }
    }
}
