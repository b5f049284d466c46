//! Where beams cross a layer: the squares over which gradients are averaged.
//!
//! Lengths are in units of the pupil's radius R = N d / 2; a layer at height h below a beacon at
//! height H has beta = 1 - h / H.
//!
//! | light | side | centre of subaperture i |
//! |---|---|---|
//! | from a star, or any at the ground | d | x_i |
//! | SPLASH, going up | beta d | x_i |
//! | from a laser guide star | beta d | beta x_i |

use splash_firmware::geometry::Mask;

/// Squares of one size on a regular grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Squares {
    /// Twice the column and row, from the middle of the grid: whole numbers at any N.
    cells: Vec<[i32; 2]>,
    pitch: f64,
    side: f64,
}

impl Squares {
    /// The subapertures themselves: how a star sees them.
    pub fn subapertures(mask: &Mask) -> Self {
        let last = mask.across() as i32 - 1;
        let cells = mask.cells().map(|(x, y)| [2 * x as i32 - last, 2 * y as i32 - last]).collect();
        let pitch = 2.0 / mask.across() as f64;
        Self { cells, pitch, side: pitch }
    }

    /// What SPLASH's beams cover at `beta`: smaller squares about the same centres.
    #[must_use]
    pub fn splash(&self, beta: f64) -> Self {
        Self { side: beta * self.side, ..self.clone() }
    }

    /// What a laser guide star's light crosses at `beta`: everything smaller.
    #[must_use]
    pub fn lgs(&self, beta: f64) -> Self {
        Self { side: beta * self.side, pitch: beta * self.pitch, ..self.clone() }
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.cells.len()
    }

    /// The side of each.
    pub fn side(&self) -> f64 {
        self.side
    }

    /// The distance between neighbours' centres.
    pub fn pitch(&self) -> f64 {
        self.pitch
    }

    /// Twice the column and row of each, from the middle of the grid.
    pub(super) fn cells(&self) -> &[[i32; 2]] {
        &self.cells
    }

    /// The centre of square `index`.
    pub fn centre(&self, index: usize) -> [f64; 2] {
        self.cells[index].map(|cell| 0.5 * f64::from(cell) * self.pitch)
    }
}
