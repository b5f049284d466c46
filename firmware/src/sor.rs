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
//! south, n_w = 1 where that neighbour exists. Absent neighbours are padded zeros of X and Y.
//! Red nodes are updated from black ones, then black from red: every masked 4-neighbour grid is
//! bipartite, so that this has the optimal omega of lexicographic order and no order of its own
//! within a colour.
//!
//! Written with the mean over the neighbours in place of the residual, a step has one sum less:
//!
//! ```text
//! p_i <- (omega / degree_i) (b_i + sum_j p_j) - (omega - 1) p_i
//! ```
//!
//! **Limits.** A red piston is kept from falling below -P, a black one from rising above P
//! ([`PISTON_LIMIT`]), each by what takes two instructions, and that bounds both on both sides: with each of
//! four differences of an edge within +-2^24 ulp, so that |b_i| / degree_i <= 2^24, and no black neighbour
//! above P, a red piston that is not below -P goes to omega (P + 2^24) + (omega - 1) P at most; black ones
//! mirror that. Both limits hold for all at the end of a frame, when the mean is off.
//!
//! **Scaling and overflow.** Everything is i32, in halves of an ulp. A red node has u = 2 (p + P), a black one
//! u = 2 (p - P), so that the limits are at 0, and where there is no node it is the other end of the room
//! R = 4 P. Then for both
//!
//! ```text
//! u_i <- (omega / degree_i) (2 b_i + sum_j u_j +- 4 R) - (omega - 1) u_i       + red, - black
//! ```
//!
//! over all four sides. |X|, |Y| <= 2^23 ulp and each edge has two of them, hence |2 b| / degree <= 2^25 and
//! |u| <= omega (R + 2^25) = omega 2^27 < 2^28. The bracket is within 4 (R + 2^25) = 2^29 one way and
//! 4 (2^28 + 2^25 - R) < 2^29.6 the other, and twice that fits: omega / degree is a Q31 number below 2, unsigned,
//! and omega - 1 is Q32. Both products are rounded down, and one is taken from the other: together within
//! half an ulp and even on average. That leaves at most 0.06 LSB of error, limit cycles included, at N = 40.
//!
//! The right-hand side is absolute (the whole tip/tilt command, not its change) and the solver
//! starts from the last frame's pistons. Then a fixed number of sweeps, ceil(N/2) on a circle and
//! more where the mask relaxes more slowly, keeps the error within 10 % rms of the residual
//! wavefront error, where a cold start would leave 40-50 %.

#[cfg(target_arch = "riscv32")]
use crate::dsp::quads;
#[cfg(any(target_arch = "riscv32", armv7em))]
use crate::dsp::{edges, relax::Lines, totals};
use crate::fixed::{self, PISTON_LIMIT};
use crate::geometry::Grid;
#[cfg(any(target_arch = "riscv32", armv7em))]
use crate::redblack::Offsets;
use crate::redblack::{COLOURS, Place, RED, RedBlack};

/// What a relaxation step needs of the pupil.
#[derive(Debug)]
pub struct SorConfig<const M: usize> {
    /// The padded grid.
    pub(crate) grid: Grid,
    /// Steps and neighbourhoods.
    pub(crate) couplings: RedBlack<Coupling, M>,
    /// omega - 1, Q32.
    pub(crate) overshoot_q32: u32,
    /// Fraction bits that steps are short of 32: 1, but on RISC-V none where every node has two neighbours at least.
    pub(crate) short_by: u32,
    /// Red nodes less black ones.
    pub(crate) surplus: i32,
    /// Sweeps of a warm frame.
    pub(crate) warm_sweeps: u16,
    /// Sweeps of the first frame after a reset.
    pub(crate) cold_sweeps: u16,
    /// Subapertures of each connected component.
    pub(crate) sizes: heapless::Vec<u16, M>,
}

/// A node's step, and its neighbourhood; nothing of both where there is no node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Coupling {
    /// omega / degree, below 2, with 32 fraction bits less [`SorConfig::short_by`]. 0 without neighbours: nothing moves
    /// such a node.
    pub(crate) step: u32,
    /// Degree in bits 0-2, n_w - n_e in bits 3-4 and n_n - n_s in bits 5-6, both signed, and whether there is
    /// a subaperture in bit 7.
    neighbourhood: i32,
}

impl Coupling {
    /// A place without a node.
    pub(crate) const NONE: Self = Self { step: 0, neighbourhood: 0 };

    /// A node that does not relax yet, from the presence of its neighbours to the west, east, north
    /// and south.
    pub(crate) const fn new([west, east, north, south]: [bool; 4]) -> Self {
        let degree = west as i32 + east as i32 + north as i32 + south as i32;
        let dx = (west as i32 - east as i32) & 3;
        let dy = (north as i32 - south as i32) & 3;
        Self { step: 0, neighbourhood: degree | dx << 3 | dy << 5 | 1 << 7 }
    }

    /// The same node with the step that omega - 1, Q32, gives it, rounded to 31 bits. Its product with the degree
    /// has to be omega to the last bits: a step of the bracket of [the module](self) and one of u rest against
    /// each other.
    pub(crate) const fn with_overshoot(self, overshoot_q32: u32, short_by: u32) -> Self {
        let omega_q32 = (1u64 << 32) + overshoot_q32 as u64;
        let step_q31 = match self.degree() as u64 {
            0 => 0,
            // Below 2^32: overshoots are.
            degree => ((omega_q32 + degree) / (2 * degree)) as u32,
        };
        Self { step: step_q31 << (1 - short_by), ..self }
    }

    #[inline(always)]
    pub(crate) const fn present(self) -> bool {
        self.neighbourhood != 0
    }

    #[inline(always)]
    pub(crate) const fn degree(self) -> i32 {
        self.neighbourhood & 7
    }

    /// A step of a node that has neighbours.
    #[cfg(not(any(target_arch = "riscv32", armv7em)))]
    #[inline(always)]
    pub(crate) fn relax(
        self,
        own: &mut Unknown,
        sides: [Unknown; 4],
        colour: usize,
        overshoot_q32: u32,
    ) {
        let bracket = own.rhs.wrapping_add(around(sides) << RHS_BITS);
        let to = fixed::mul_high_unsigned(bracket, self.step);
        let moved = to.wrapping_sub(fixed::mul_high_unsigned(own.doubled, overshoot_q32));
        own.doubled = if colour == RED { fixed::positive(moved) } else { fixed::negative(moved) };
    }

    /// 2 r = 2 (b + sum of the neighbours - degree p): within 2^29.6 and 4 x 2^28.
    #[cfg(not(any(target_arch = "riscv32", armv7em)))]
    #[inline(always)]
    fn residual(self, own: Unknown, sides: [Unknown; 4]) -> i32 {
        let bracket = (own.rhs >> RHS_BITS).wrapping_add(around(sides));
        bracket.wrapping_sub(own.doubled.wrapping_mul(self.degree()))
    }

    /// What [`Unknown::rhs`] has of a node that is there, from tip and tilt of it and its neighbours.
    #[cfg(not(any(target_arch = "riscv32", armv7em)))]
    #[inline(always)]
    fn edges(
        self,
        [x, y]: [i32; 2],
        [[xw, _], [xe, _], [_, yn], [_, ys]]: [[i32; 2]; 4],
        colour: usize,
    ) -> i32 {
        let (dx, dy) = (self.neighbourhood << 27 >> 30, self.neighbourhood << 25 >> 30);
        let across = xw.wrapping_sub(xe).wrapping_add(x.wrapping_mul(dx));
        let down = yn.wrapping_sub(ys).wrapping_add(y.wrapping_mul(dy));
        (across.wrapping_add(down) << (1 + RHS_BITS)).wrapping_add(offset(colour))
    }

    /// Adds a node that is there to the sums.
    #[cfg(not(any(target_arch = "riscv32", armv7em)))]
    #[inline(always)]
    fn total(self, own: Unknown, sides: [Unknown; 4], totals: &mut Totals) {
        let r = i64::from(self.residual(own, sides) >> 4);
        totals.residual_squared = totals.residual_squared.wrapping_add(r.wrapping_mul(r) as u64);
        totals.doubled = totals.doubled.wrapping_add(own.doubled.into());
    }
}

/// The sum of u over the sides.
#[cfg(not(any(target_arch = "riscv32", armv7em)))]
#[inline(always)]
fn around([w, e, n, s]: [Unknown; 4]) -> i32 {
    w.doubled.wrapping_add(e.doubled).wrapping_add(n.doubled.wrapping_add(s.doubled))
}

/// Bits by which [`Unknown::rhs`] is shifted up: brackets have as many as make 32 with their steps'. On RISC-V most
/// steps have all, and where one needs another, its kernel shifts.
const RHS_BITS: u32 = if cfg!(target_arch = "riscv32") { 0 } else { 1 };

/// What right-hand sides of a colour have beside b: 4 R, less for black nodes.
#[inline(always)]
pub(crate) const fn offset(colour: usize) -> i32 {
    let offset = (4 * ROOM) << RHS_BITS;
    if colour == RED { offset } else { -offset }
}

/// Where a subaperture is in the solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct Node {
    /// In every field on the grid.
    pub(crate) place: Place,
    /// Connected component, numbered by first subaperture.
    pub(crate) component: u16,
    /// 2x - (N - 1) and 2y - (N - 1): the centre from the pupil's, half pitches.
    pub(crate) centre: [i8; 2],
}

impl<const M: usize> SorConfig<M> {
    /// Sets every step from omega - 1, Q32, below 2^32 - 2^25.
    pub(crate) fn relax_by(&mut self, overshoot_q32: u32, nodes: &[Node]) {
        let degree = |node: &Node| self.couplings.get(node.place).map_or(0, |c| c.degree());
        let single = nodes.iter().any(|node| degree(node) <= 1);
        self.short_by = u32::from(single || cfg!(not(target_arch = "riscv32")));
        self.overshoot_q32 = overshoot_q32;
        for node in nodes {
            if let Some(coupling) = self.couplings.get_mut(node.place) {
                *coupling = coupling.with_overshoot(overshoot_q32, self.short_by);
            }
        }
    }

    pub(crate) const EMPTY: Self = Self {
        grid: Grid { stride: 0, nodes: 0 },
        couplings: RedBlack::new(Coupling::NONE),
        overshoot_q32: 0,
        short_by: 0,
        surplus: 0,
        warm_sweeps: 0,
        cold_sweeps: 0,
        sizes: heapless::Vec::new(),
    };
}

/// A node's piston and its right-hand side: one read brings both.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub(crate) struct Unknown {
    /// u of [the module](self): 2 (p + P) of a red node, 2 (p - P) of a black one; see [`Unknown::absent`].
    pub(crate) doubled: i32,
    /// 2 b + 4 R of a red node, 2 b - 4 R of a black one, shifted up by [`RHS_BITS`].
    pub(crate) rhs: i32,
}

/// R: from the piston's lower limit to its upper one, doubled.
pub(crate) const ROOM: i32 = 4 * PISTON_LIMIT;

impl Unknown {
    /// Piston 0.
    const fn zero(colour: usize) -> Self {
        Self { doubled: if colour == RED { ROOM / 2 } else { -ROOM / 2 }, rhs: 0 }
    }

    /// Where there is no node: what an edge less is to a neighbour of the other colour.
    pub(crate) const fn absent(colour: usize) -> Self {
        Self { doubled: if colour == RED { ROOM } else { -ROOM }, rhs: 0 }
    }

    /// Takes a mean off the piston, ulp below 2^27, brings it within both limits, and tells it, ulp, rounded
    /// down.
    #[inline(always)]
    fn centre(&mut self, black: bool, mean: i32) -> i32 {
        let shift = if black { ROOM } else { 0 };
        let above = fixed::positive(self.doubled.wrapping_add(shift.wrapping_sub(mean << 1)));
        let below = fixed::negative(above.wrapping_sub(ROOM));
        self.doubled = below.wrapping_add(ROOM - shift);
        (below >> 1).wrapping_add(PISTON_LIMIT)
    }

    /// Twice the piston, ulp.
    #[inline(always)]
    pub(crate) const fn doubled_piston(self, black: bool) -> i32 {
        self.doubled.wrapping_add(if black { ROOM / 2 } else { -ROOM / 2 })
    }
}

/// Sums over all nodes.
#[derive(Debug, Default)]
pub(crate) struct Totals {
    /// Of (r / 8)^2: |r / 8| < 2^27 and at most 800 nodes a colour, below 2^64 for one; limited for both.
    pub(crate) residual_squared: u64,
    /// Of u.
    pub(crate) doubled: i64,
}

impl Totals {
    /// Of the nodes of both.
    const fn and(self, other: Self) -> Self {
        Self {
            residual_squared: self.residual_squared.saturating_add(other.residual_squared),
            doubled: self.doubled.wrapping_add(other.doubled),
        }
    }
}

/// Pistons and right-hand side of the relaxation.
#[derive(Debug)]
pub struct Sor<const M: usize> {
    unknowns: RedBlack<Unknown, M>,
    /// Whether the next right-hand side finds pistons.
    warm: bool,
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
        Self { unknowns: RedBlack::new(Unknown { doubled: 0, rhs: 0 }), warm: false, means: [0; M] }
    }

    /// The right-hand side from tips and tilts, ulp, which are zero outside the mask.
    #[inline(never)]
    pub fn load(&mut self, config: &SorConfig<M>, tilts: &RedBlack<[i32; 2], M>) {
        if !self.warm {
            self.start(config);
        }
        for colour in COLOURS {
            self.load_colour(config, tilts, colour);
        }
    }

    fn load_colour(&mut self, config: &SorConfig<M>, tilts: &RedBlack<[i32; 2], M>, colour: usize) {
        let SorConfig { grid, couplings, .. } = config;
        #[cfg(any(target_arch = "riscv32", armv7em))]
        let _ = edges::load(tilts, &mut self.unknowns, couplings, (grid, colour));
        #[cfg(not(any(target_arch = "riscv32", armv7em)))]
        {
            let own = tilts.nodes(grid, colour).iter().zip(tilts.sides(grid, colour).iter());
            let unknowns = self.unknowns.nodes_mut(grid, colour).iter_mut();
            for ((unknown, coupling), (&own, sides)) in
                unknowns.zip(couplings.nodes(grid, colour)).zip(own)
            {
                if coupling.present() {
                    unknown.rhs = coupling.edges(own, sides, colour);
                }
            }
        }
    }

    /// Pistons of 0.
    #[cold]
    #[inline(never)]
    fn start(&mut self, config: &SorConfig<M>) {
        self.warm = true;
        for colour in COLOURS {
            let unknowns = self.unknowns.half_mut(colour).iter_mut();
            for (unknown, coupling) in unknowns.zip(config.couplings.half(colour)) {
                *unknown = match coupling.present() {
                    true => Unknown::zero(colour),
                    false => Unknown::absent(colour),
                };
            }
        }
    }

    /// Relaxes `sweeps` times, red nodes then black ones.
    ///
    /// Not inlined: it needs all registers.
    #[cfg(any(target_arch = "riscv32", armv7em))]
    #[inline(never)]
    pub fn relax(&mut self, config: &SorConfig<M>, sweeps: u16) {
        #[cfg(target_arch = "riscv32")]
        if self.relax_quads(config, sweeps).is_some() {
            return;
        }
        let at = COLOURS.map(|colour| Offsets::new(&config.grid, colour));
        let lines = Lines::new(self.unknowns.halves_mut(), config.couplings.halves(), &at);
        if let Some(lines) = lines {
            lines.relax(config.overshoot_q32, config.short_by, sweeps);
        }
    }

    /// Relaxes `sweeps` times, red nodes then black ones.
    #[cfg(not(any(target_arch = "riscv32", armv7em)))]
    pub fn relax(&mut self, config: &SorConfig<M>, sweeps: u16) {
        for _ in 0..sweeps {
            for colour in COLOURS {
                self.relax_colour(config, colour);
            }
        }
    }

    #[cfg(not(any(target_arch = "riscv32", armv7em)))]
    fn relax_colour(&mut self, config: &SorConfig<M>, colour: usize) {
        let (own, sides) = self.unknowns.nodes_and_sides(&config.grid, colour);
        let couplings = config.couplings.nodes(&config.grid, colour);
        for ((unknown, &coupling), sides) in own.iter_mut().zip(couplings).zip(sides.iter()) {
            if coupling.step > 0 {
                coupling.relax(unknown, sides, colour, config.overshoot_q32);
            }
        }
    }

    /// [`Sor::relax`] and the sums over black nodes, where [`quads`] does it.
    #[cfg(target_arch = "riscv32")]
    #[inline(always)]
    fn relax_quads(&mut self, config: &SorConfig<M>, sweeps: u16) -> Option<Totals> {
        let (nodes, couplings) = (self.unknowns.halves_mut(), config.couplings.halves());
        // It goes by steps, of all fraction bits, and one by itself has none.
        match config.short_by {
            0 => quads::relax(nodes, couplings, &config.grid, config.overshoot_q32, sweeps),
            _ => None,
        }
    }

    /// [`Sor::relax`], and what is then known of all nodes together.
    #[inline(always)]
    pub(crate) fn relax_and_total(&mut self, config: &SorConfig<M>, sweeps: u16) -> Totals {
        #[cfg(target_arch = "riscv32")]
        if let Some(black) = self.relax_quads(config, sweeps) {
            let [red, _] = COLOURS;
            return self.totals_of(config, red).and(black);
        }
        self.relax(config, sweeps);
        self.totals(config)
    }

    /// The sum of (r / 8)^2 over all nodes, ulp^2 / 64.
    ///
    /// r is that of the unnormalised Laplacian, so that the error obeys |e| <= |r| / lambda_2.
    pub fn residual_squared(&self, config: &SorConfig<M>) -> u64 {
        self.totals(config).residual_squared
    }

    /// What is known of all nodes together.
    #[inline(never)]
    pub(crate) fn totals(&self, config: &SorConfig<M>) -> Totals {
        let [red, black] = COLOURS.map(|colour| self.totals_of(config, colour));
        red.and(black)
    }

    fn totals_of(&self, config: &SorConfig<M>, colour: usize) -> Totals {
        let SorConfig { grid, couplings, .. } = config;
        #[cfg(any(target_arch = "riscv32", armv7em))]
        {
            totals::totals(&self.unknowns, couplings, (grid, colour)).unwrap_or_default()
        }
        #[cfg(not(any(target_arch = "riscv32", armv7em)))]
        {
            let mut totals = Totals::default();
            let own = self.unknowns.nodes(grid, colour).iter();
            let sides = self.unknowns.sides(grid, colour).iter();
            for ((&own, coupling), sides) in own.zip(couplings.nodes(grid, colour)).zip(sides) {
                if coupling.present() {
                    coupling.total(own, sides, &mut totals);
                }
            }
            totals
        }
    }

    /// Takes the mean piston off each connected component.
    pub fn remove_means(&mut self, config: &SorConfig<M>, nodes: &[Node]) {
        let mean = self.common_mean(config, nodes, &self.totals(config));
        for node in nodes {
            self.centred_piston(node.place, mean);
        }
    }

    /// The mean piston of the one connected component, ulp, still to be taken off; of several each has
    /// its own taken off here, and nothing is left.
    ///
    /// A mean is the sum (below 1600 x 2^27 < 2^38) times the floor of 2^24 / size, i64. The
    /// reciprocal is low by less than size / 2^24 of itself, which of a mean that was zero a
    /// frame ago leaves nothing.
    pub(crate) fn common_mean(
        &mut self,
        config: &SorConfig<M>,
        nodes: &[Node],
        totals: &Totals,
    ) -> i32 {
        let &[size] = config.sizes.as_slice() else {
            self.remove_own_means(config, nodes);
            return 0;
        };
        // Of n nodes, 2 p = u -+ R / 2.
        let offsets = i64::from(ROOM / 2) * i64::from(config.surplus);
        mean(totals.doubled.wrapping_sub(offsets) >> 1, size)
    }

    #[cold]
    #[inline(never)]
    fn remove_own_means(&mut self, config: &SorConfig<M>, nodes: &[Node]) {
        let components = config.sizes.len();
        self.means.iter_mut().take(components).for_each(|sum| *sum = 0);
        for node in nodes {
            let p = self.piston(*node);
            if let Some(sum) = self.means.get_mut(usize::from(node.component)) {
                *sum = sum.wrapping_add(i64::from(p));
            }
        }
        for (sum, &size) in self.means.iter_mut().zip(&config.sizes) {
            *sum = mean(*sum, size).into();
        }
        for node in nodes {
            let mean = self.means.get(usize::from(node.component)).copied().unwrap_or(0) as i32;
            self.centred_piston(node.place, mean);
        }
    }

    /// Takes the mean off one piston, ulp, and tells it within its limits; `None` off the grid.
    #[inline(always)]
    pub(crate) fn centred_piston(&mut self, place: Place, mean: i32) -> Option<i32> {
        Some(self.unknowns.get_mut(place)?.centre(place.is_black::<M>(), mean))
    }

    /// Pistons and right-hand sides.
    #[cfg(any(target_arch = "riscv32", armv7em))]
    pub(crate) const fn unknowns_mut(&mut self) -> &mut RedBlack<Unknown, M> {
        &mut self.unknowns
    }

    /// The piston of a subaperture, ulp, rounded down.
    #[inline(always)]
    pub fn piston(&self, node: Node) -> i32 {
        self.doubled_piston(node) >> 1
    }

    /// Twice the piston of a subaperture, ulp: all that the solver has of it.
    #[inline(always)]
    pub fn doubled_piston(&self, Node { place, .. }: Node) -> i32 {
        let black = place.is_black::<M>();
        self.unknowns.get(place).map_or(0, |unknown| unknown.doubled_piston(black))
    }

    /// Forgets the pistons: the next frame starts cold.
    pub fn reset(&mut self) {
        self.warm = false;
    }
}

/// What sums up to `sum`, of so many.
fn mean(sum: i64, size: u16) -> i32 {
    let inverse = (1 << 24) / u32::from(size.max(1));
    fixed::round_shift(sum.wrapping_mul(i64::from(inverse)), 24) as i32
}
