//! Pistons by successive over-relaxation (SOR) of the segments' edges.
//!
//! Southwell geometry on a masked grid: the piston of a segment tends to the mean, over its
//! present neighbours j, of p_j plus the path difference between the two centres that their
//! tip/tilts span (Butterley et al. 2006, section 2; Southwell 1980):
//!
//! ```text
//! r_i = b_i + sum_j p_j - degree_i p_i            residual of the graph Laplacian
//! b_i = X_w - X_e + (n_w - n_e) X_i + Y_n - Y_s + (n_n - n_s) Y_i
//! p_i <- p_i + (omega / degree_i) r_i
//! ```
//!
//! X, Y are the tip and tilt, w e n s the neighbours to the west (x - 1), east, north (y - 1) and
//! south, n_w = 1 where that neighbour exists. Absent neighbours are padded zeros of X, Y and p.
//! Red nodes are updated from black ones, then black from red: every masked 4-neighbour grid is
//! bipartite, so that this has the optimal omega of lexicographic order and no order of its own
//! within a colour.
//!
//! **Scaling and overflow.** Everything is i32 in ulp. |X|, |Y| <= 2^23, hence |b| <= 2^26;
//! |p| <= 2^25, hence the sum over neighbours and degree x p are within 2^27 each and
//! |r| <= 2^26 + 2^28 < 2^29. The step is one rounded multiply-high ([`fixed::mul_q30`]); p is
//! then saturated to +-2^25. Rounding to nearest leaves at most 0.56 LSB of error, limit cycles
//! included, at N = 40.
//!
//! The right-hand side is absolute (the whole tip/tilt command, not its change) and the solver
//! starts from the last frame's pistons. Then a fixed number of sweeps, ceil(N/2) on a circle and
//! more where the mask relaxes more slowly, keeps the error within 10 % rms of the residual
//! wavefront error, where a cold start would leave 40-50 %.

use crate::fixed::{self, PISTON_LIMIT};
use crate::geometry::Grid;
use crate::redblack::{COLOURS, RedBlack};

/// What a relaxation step needs of the pupil.
#[derive(Debug)]
pub struct SorConfig<const M: usize> {
    /// The padded grid.
    pub(crate) grid: Grid,
    /// omega / degree in Q30; zero where there is no node or no neighbour.
    pub(crate) step: RedBlack<i32, M>,
    /// Presence of the neighbours.
    pub(crate) links: RedBlack<Links, M>,
    /// Sweeps of a warm frame.
    pub(crate) warm_sweeps: u16,
    /// Sweeps of the first frame after a reset.
    pub(crate) cold_sweeps: u16,
    /// Subapertures of each connected component.
    pub(crate) sizes: heapless::Vec<u16, M>,
}

/// What a node's neighbourhood looks like, in one byte: degree in bits 0-2, n_w - n_e in bits 3-4
/// and n_n - n_s in bits 5-6, both signed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Links(u8);

impl Links {
    /// A place without a node.
    pub(crate) const NONE: Self = Self(0);

    /// From the presence of the neighbours to the west, east, north and south.
    pub(crate) const fn new([west, east, north, south]: [bool; 4]) -> Self {
        let degree = west as u8 + east as u8 + north as u8 + south as u8;
        let dx = (west as u8).wrapping_sub(east as u8) & 3;
        let dy = (north as u8).wrapping_sub(south as u8) & 3;
        Self(degree | dx << 3 | dy << 5)
    }

    #[inline(always)]
    pub(crate) const fn degree(self) -> i32 {
        (self.0 & 7) as i32
    }

    #[inline(always)]
    const fn dx(self) -> i32 {
        (self.0 as i32) << 27 >> 30
    }

    #[inline(always)]
    const fn dy(self) -> i32 {
        (self.0 as i32) << 25 >> 30
    }
}

/// Where a subaperture is in the solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// Padded node.
    pub(crate) padded: u16,
    /// Connected component, numbered by first subaperture.
    pub(crate) component: u16,
    /// 2x - (N - 1) and 2y - (N - 1): the centre from the pupil's, half pitches.
    pub(crate) centre: [i8; 2],
}

impl<const M: usize> SorConfig<M> {
    pub(crate) const EMPTY: Self = Self {
        grid: Grid { stride: 0, nodes: 0 },
        step: RedBlack::new(0),
        links: RedBlack::new(Links::NONE),
        warm_sweeps: 0,
        cold_sweeps: 0,
        sizes: heapless::Vec::new(),
    };
}

/// Pistons and right-hand side of the relaxation.
#[derive(Debug)]
pub struct Sor<const M: usize> {
    piston: RedBlack<i32, M>,
    rhs: RedBlack<i32, M>,
    /// Sum, then mean, of the pistons of each component, ulp.
    means: [i64; M],
}

impl<const M: usize> Default for Sor<M> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const M: usize> Sor<M> {
    /// Zero pistons.
    pub const fn new() -> Self {
        Self { piston: RedBlack::new(0), rhs: RedBlack::new(0), means: [0; M] }
    }

    /// The right-hand side from tip and tilt, ulp, which are zero outside the mask.
    pub fn load(&mut self, config: &SorConfig<M>, tip: &RedBlack<i32, M>, tilt: &RedBlack<i32, M>) {
        let grid = &config.grid;
        for colour in COLOURS {
            let own = tip.nodes(grid, colour).iter().zip(tilt.nodes(grid, colour));
            let sides = tip.sides(grid, colour).iter().zip(tilt.sides(grid, colour).iter());
            let links = config.links.nodes(grid, colour);
            let rhs = self.rhs.nodes_mut(grid, colour).iter_mut();
            for (((rhs, links), (&x, &y)), ([xw, xe, _, _], [_, _, yn, ys])) in
                rhs.zip(links).zip(own).zip(sides)
            {
                let across = xw.wrapping_sub(xe).wrapping_add(x.wrapping_mul(links.dx()));
                let down = yn.wrapping_sub(ys).wrapping_add(y.wrapping_mul(links.dy()));
                *rhs = across.wrapping_add(down);
            }
        }
    }

    /// Relaxes `sweeps` times, red nodes then black ones.
    pub fn relax(&mut self, config: &SorConfig<M>, sweeps: u16) {
        let grid = &config.grid;
        for _ in 0..sweeps {
            for colour in COLOURS {
                let (own, sides) = self.piston.nodes_and_sides(grid, colour);
                let step = config.step.nodes(grid, colour);
                let links = config.links.nodes(grid, colour);
                let rhs = self.rhs.nodes(grid, colour);
                let nodes = own.iter_mut().zip(step).zip(links).zip(rhs);
                for ((((p, &step), &links), &rhs), sides) in nodes.zip(sides.iter()) {
                    let r = residual(*p, links, rhs, sides);
                    let next = p.wrapping_add(fixed::mul_q30(step, r));
                    *p = fixed::clamp(next, PISTON_LIMIT);
                }
            }
        }
    }

    /// The sum of (r / 8)^2 over all nodes that have a neighbour, ulp^2 / 64.
    ///
    /// r is that of the unnormalised Laplacian, so that the error obeys |e| <= |r| / lambda_2.
    /// |r / 8| < 2^26 and at most 1600 nodes: below 2^63.
    pub fn residual_squared(&self, config: &SorConfig<M>) -> u64 {
        let grid = &config.grid;
        let mut total = 0u64;
        for colour in COLOURS {
            let step = config.step.nodes(grid, colour);
            let links = config.links.nodes(grid, colour);
            let rhs = self.rhs.nodes(grid, colour);
            let nodes = self.piston.nodes(grid, colour).iter().zip(step).zip(links).zip(rhs);
            let sides = self.piston.sides(grid, colour);
            for ((((&p, &step), &links), &rhs), sides) in nodes.zip(sides.iter()) {
                let r = residual(p, links, rhs, sides).wrapping_mul(i32::from(step != 0)) >> 3;
                total = total.wrapping_add(i64::from(r).wrapping_mul(i64::from(r)) as u64);
            }
        }
        total
    }

    /// Takes the mean piston off each connected component.
    ///
    /// The mean is the sum (below 1600 x 2^25 < 2^36) times the floor of 2^24 / size, i64. The
    /// reciprocal is low by less than size / 2^24 of itself, which of a mean that was zero a
    /// frame ago leaves nothing.
    pub fn remove_means(&mut self, config: &SorConfig<M>, nodes: &[Node]) {
        let components = config.sizes.len();
        self.means.iter_mut().take(components).for_each(|sum| *sum = 0);
        for node in nodes {
            let p = self.piston(*node);
            if let Some(sum) = self.means.get_mut(usize::from(node.component)) {
                *sum = sum.wrapping_add(i64::from(p));
            }
        }
        for (sum, &size) in self.means.iter_mut().zip(&config.sizes) {
            let inverse = (1 << 24) / u32::from(size.max(1));
            *sum = fixed::round_shift(sum.wrapping_mul(i64::from(inverse)), 24);
        }
        for node in nodes {
            let mean = self.means.get(usize::from(node.component)).copied().unwrap_or(0) as i32;
            if let Some(p) = self.piston.get_mut(node.padded) {
                // |p| and |mean| are within 2^25; a pathological component may need the limit.
                *p = fixed::clamp(p.wrapping_sub(mean), PISTON_LIMIT);
            }
        }
    }

    /// The piston of a subaperture, ulp.
    #[inline(always)]
    pub fn piston(&self, node: Node) -> i32 {
        self.piston.get(node.padded).copied().unwrap_or(0)
    }

    /// Forgets the pistons: the next frame starts cold.
    pub fn reset(&mut self) {
        self.piston.fill(0);
    }
}

/// r = b + sum of the neighbours - degree p.
#[inline(always)]
fn residual(p: i32, links: Links, rhs: i32, [w, e, n, s]: [i32; 4]) -> i32 {
    let around = w.wrapping_add(e).wrapping_add(n).wrapping_add(s);
    rhs.wrapping_add(around).wrapping_sub(p.wrapping_mul(links.degree()))
}
