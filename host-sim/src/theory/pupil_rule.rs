//! Which squares of the grid are subapertures, by a rule on the circle of diameter N d about them.

use clap::ValueEnum;
use splash_firmware::error::ConfigError;
use splash_firmware::geometry::Mask;

/// A rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PupilRule {
    /// The centre is inside the circle: 52, 112 and 208 of N = 8, 12 and 16
    Circle,
    /// The centre is inside the circle, and not inside the central obstruction
    Annulus,
    /// All of the square is inside the circle: 32, 88 and 164
    Inside,
    /// Any of the square is inside the circle: 60, 132 and 224
    Touching,
    /// Every square of the grid
    Square,
}

impl PupilRule {
    /// The subapertures of an N x N grid; `obstruction` is a fraction of the diameter, for an annulus.
    ///
    /// # Errors
    /// [`ConfigError`] unless 4 <= N <= 40 and 0 <= obstruction <= 0.99.
    pub fn mask(self, across: usize, obstruction: f64) -> Result<Mask, ConfigError> {
        // Distances from the middle in pitches / 2, where centres and corners are whole numbers.
        let distance = |k: usize| (2 * k + 1).abs_diff(across);
        let farthest = |k: usize| distance(k) + 1;
        let nearest = |k: usize| distance(k).saturating_sub(1);
        let squared = across * across;
        match self {
            Self::Circle => Mask::circle(across),
            Self::Annulus => Mask::annulus(across, obstruction),
            Self::Inside => {
                Mask::from_fn(across, |x, y| farthest(x).pow(2) + farthest(y).pow(2) <= squared)
            }
            Self::Touching => {
                Mask::from_fn(across, |x, y| nearest(x).pow(2) + nearest(y).pow(2) < squared)
            }
            Self::Square => Mask::square(across),
        }
    }
}
