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
//! **Scaling and overflow.** Everything is i32 in ulp. |X|, |Y| <= 2^23 and each of four edges has two
//! of them, hence |b| <= 2^25; |p| <= 3 x 2^23, hence each of four p_j - p is within 3 x 2^24 and
//! |r| <= 2^25 + 3 x 2^26 = 7 x 2^25 < 2^28. The step is one rounded multiply-high
//! ([`fixed::mul_q30`]); p is then saturated to +-3 x 2^23. Rounding to nearest leaves at most 0.56 LSB of error, limit cycles
//! included, at N = 40.
//!
//! The right-hand side is absolute (the whole tip/tilt command, not its change) and the solver
//! starts from the last frame's pistons. Then a fixed number of sweeps, ceil(N/2) on a circle and
//! more where the mask relaxes more slowly, keeps the error within 10 % rms of the residual
//! wavefront error, where a cold start would leave 40-50 %.

use crate::fixed::{self, PISTON_LIMIT};
use crate::geometry::Grid;
use crate::redblack::{COLOURS, Place, RedBlack};

/// What a relaxation step needs of the pupil.
#[derive(Debug)]
pub struct SorConfig<const M: usize> {
    /// The padded grid.
    pub(crate) grid: Grid,
    /// Steps and neighbourhoods.
    pub(crate) couplings: RedBlack<Coupling, M>,
    /// Sweeps of a warm frame.
    pub(crate) warm_sweeps: u16,
    /// Sweeps of the first frame after a reset.
    pub(crate) cold_sweeps: u16,
    /// Subapertures of each connected component.
    pub(crate) sizes: heapless::Vec<u16, M>,
}

/// A node's step omega / degree in Q30, with its neighbourhood in the lowest byte: degree in bits 0-2,
/// n_w - n_e in bits 3-4 and n_n - n_s in bits 5-6, both signed, and whether there is a subaperture in
/// bit 7.
///
/// The byte is left in where the step is multiplied by: it changes it by less than 2^-22, and the point
/// where the relaxation comes to rest not at all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coupling(i32);

/// Bits of a coupling that hold its neighbourhood.
const NEIGHBOURHOOD: i32 = 0xff;

impl Coupling {
    /// A place without a node.
    pub(crate) const NONE: Self = Self(0);

    /// A node that does not relax yet, from the presence of its neighbours to the west, east, north
    /// and south.
    pub(crate) const fn new([west, east, north, south]: [bool; 4]) -> Self {
        let degree = west as i32 + east as i32 + north as i32 + south as i32;
        let dx = (west as i32 - east as i32) & 3;
        let dy = (north as i32 - south as i32) & 3;
        Self(degree | dx << 3 | dy << 5 | 1 << 7)
    }

    /// The same node with another step, Q30 in 0 ..= 2^31 - 1; one without neighbours takes none.
    pub(crate) const fn with_step(self, step_q30: i32) -> Self {
        let step = if self.degree() == 0 { 0 } else { step_q30 };
        Self((step & !NEIGHBOURHOOD) | (self.0 & NEIGHBOURHOOD))
    }

    #[inline(always)]
    pub(crate) const fn present(self) -> bool {
        self.0 != 0
    }

    #[inline(always)]
    pub(crate) const fn degree(self) -> i32 {
        self.0 & 7
    }

    #[inline(always)]
    const fn dx(self) -> i32 {
        self.0 << 27 >> 30
    }

    #[inline(always)]
    const fn dy(self) -> i32 {
        self.0 << 25 >> 30
    }

    /// r = b + sum of the neighbours - degree p.
    #[inline(always)]
    fn residual(self, own: Unknown, [w, e, n, s]: [Unknown; 4]) -> i32 {
        let around = w.piston.wrapping_add(e.piston).wrapping_add(n.piston.wrapping_add(s.piston));
        own.rhs.wrapping_add(around).wrapping_sub(own.piston.wrapping_mul(self.degree()))
    }
}

/// Where a subaperture is in the solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// In every field on the grid.
    pub(crate) place: Place,
    /// Connected component, numbered by first subaperture.
    pub(crate) component: u16,
    /// 2x - (N - 1) and 2y - (N - 1): the centre from the pupil's, half pitches.
    pub(crate) centre: [i8; 2],
}

impl<const M: usize> SorConfig<M> {
    pub(crate) const EMPTY: Self = Self {
        grid: Grid { stride: 0, nodes: 0 },
        couplings: RedBlack::new(Coupling::NONE),
        warm_sweeps: 0,
        cold_sweeps: 0,
        sizes: heapless::Vec::new(),
    };
}

/// A node's piston and its right-hand side, ulp: one read brings both.
#[derive(Clone, Copy, Debug, Default)]
struct Unknown {
    piston: i32,
    rhs: i32,
}

/// Pistons and right-hand side of the relaxation.
#[derive(Debug)]
pub struct Sor<const M: usize> {
    unknowns: RedBlack<Unknown, M>,
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
        Self { unknowns: RedBlack::new(Unknown { piston: 0, rhs: 0 }), means: [0; M] }
    }

    /// The right-hand side from tips and tilts, ulp, which are zero outside the mask.
    pub fn load(&mut self, config: &SorConfig<M>, tilts: &RedBlack<[i32; 2], M>) {
        let grid = &config.grid;
        for colour in COLOURS {
            let own = tilts.nodes(grid, colour).iter().zip(tilts.sides(grid, colour).iter());
            let couplings = config.couplings.nodes(grid, colour);
            let unknowns = self.unknowns.nodes_mut(grid, colour).iter_mut();
            for ((unknown, &coupling), (&[x, y], [[xw, _], [xe, _], [_, yn], [_, ys]])) in
                unknowns.zip(couplings).zip(own)
            {
                if !coupling.present() {
                    continue;
                }
                let across = xw.wrapping_sub(xe).wrapping_add(x.wrapping_mul(coupling.dx()));
                let down = yn.wrapping_sub(ys).wrapping_add(y.wrapping_mul(coupling.dy()));
                unknown.rhs = across.wrapping_add(down);
            }
        }
    }

    /// Relaxes `sweeps` times, red nodes then black ones.
    pub fn relax(&mut self, config: &SorConfig<M>, sweeps: u16) {
        for _ in 0..sweeps {
            for colour in COLOURS {
                self.relax_colour(config, colour);
            }
        }
    }

    /// Not inlined: it needs all registers.
    #[inline(never)]
    fn relax_colour(&mut self, config: &SorConfig<M>, colour: usize) {
        let (own, sides) = self.unknowns.nodes_and_sides(&config.grid, colour);
        let couplings = config.couplings.nodes(&config.grid, colour);
        for ((unknown, &coupling), sides) in own.iter_mut().zip(couplings).zip(sides.iter()) {
            if !coupling.present() {
                continue;
            }
            let r = coupling.residual(*unknown, sides);
            let next = unknown.piston.wrapping_add(fixed::mul_q30(coupling.0, r));
            unknown.piston = fixed::clamp(next, PISTON_LIMIT);
        }
    }

    /// The sum of (r / 8)^2 over all nodes, ulp^2 / 64.
    ///
    /// r is that of the unnormalised Laplacian, so that the error obeys |e| <= |r| / lambda_2.
    /// |r / 8| < 2^25 and at most 1600 nodes: below 2^61.
    pub fn residual_squared(&self, config: &SorConfig<M>) -> u64 {
        let grid = &config.grid;
        let mut total = 0u64;
        for colour in COLOURS {
            let couplings = config.couplings.nodes(grid, colour);
            let nodes = self.unknowns.nodes(grid, colour).iter().zip(couplings);
            let sides = self.unknowns.sides(grid, colour);
            for ((&unknown, coupling), sides) in nodes.zip(sides.iter()) {
                if coupling.present() {
                    let r = coupling.residual(unknown, sides) >> 3;
                    total = total.wrapping_add(i64::from(r).wrapping_mul(i64::from(r)) as u64);
                }
            }
        }
        total
    }

    /// Takes the mean piston off each connected component.
    pub fn remove_means(&mut self, config: &SorConfig<M>, nodes: &[Node]) {
        self.find_means(config, nodes);
        for node in nodes {
            self.centred_piston(*node);
        }
    }

    /// The mean piston of each connected component.
    ///
    /// The mean is the sum (below 1600 x 2^25 < 2^36) times the floor of 2^24 / size, i64. The
    /// reciprocal is low by less than size / 2^24 of itself, which of a mean that was zero a
    /// frame ago leaves nothing.
    pub(crate) fn find_means(&mut self, config: &SorConfig<M>, nodes: &[Node]) {
        let components = config.sizes.len();
        self.means.iter_mut().take(components).for_each(|sum| *sum = 0);
        if let Some(sum) = self.means.first_mut()
            && components == 1
        {
            for colour in COLOURS {
                // Where there is no node the piston is zero.
                for unknown in self.unknowns.nodes(&config.grid, colour) {
                    *sum = sum.wrapping_add(i64::from(unknown.piston));
                }
            }
        } else {
            for node in nodes {
                let p = self.piston(*node);
                if let Some(sum) = self.means.get_mut(usize::from(node.component)) {
                    *sum = sum.wrapping_add(i64::from(p));
                }
            }
        }
        for (sum, &size) in self.means.iter_mut().zip(&config.sizes) {
            let inverse = (1 << 24) / u32::from(size.max(1));
            *sum = fixed::round_shift(sum.wrapping_mul(i64::from(inverse)), 24);
        }
    }

    /// Takes the mean off one piston, ulp, and tells it.
    #[inline(always)]
    pub(crate) fn centred_piston(&mut self, node: Node) -> i32 {
        let mean = self.means.get(usize::from(node.component)).copied().unwrap_or(0) as i32;
        let Some(Unknown { piston, .. }) = self.unknowns.get_mut(node.place) else { return 0 };
        // |p| and |mean| are within 2^25; a pathological component may need the limit.
        *piston = fixed::clamp(piston.wrapping_sub(mean), PISTON_LIMIT);
        *piston
    }

    /// The piston of a subaperture, ulp.
    #[inline(always)]
    pub fn piston(&self, node: Node) -> i32 {
        self.unknowns.get(node.place).map_or(0, |unknown| unknown.piston)
    }

    /// Forgets the pistons: the next frame starts cold.
    pub fn reset(&mut self) {
        self.unknowns.fill(Unknown::default());
    }
}
