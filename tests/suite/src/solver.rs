//! The piston solver alone, on the pupil of an instrument.

use splash_firmware::config::Config;
use splash_firmware::fixed::TILT_LIMIT;
use splash_firmware::geometry::Grid;
use splash_firmware::redblack::{Place, RedBlack};
use splash_firmware::sor::Sor;

use crate::digest::{Digest, Hasher};
use crate::generator::Generator;

/// The solver and its input.
#[derive(Debug)]
pub(crate) struct Solver<const M: usize> {
    sor: Sor<M>,
    /// Tip and tilt.
    field: RedBlack<[i32; 2], M>,
}

impl<const M: usize> Solver<M> {
    pub(crate) const fn new() -> Self {
        Self { sor: Sor::new(), field: RedBlack::new([0; 2]) }
    }

    /// Pistons and residuals of tips and tilts up to `limit` ulp, and at their edges: three times,
    /// starting from what was there.
    pub(crate) fn relax<const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        limit: i32,
    ) -> [(&'static str, Digest); 2] {
        let numbers = &mut Generator::new(limit.unsigned_abs());
        let (mut pistons, mut residuals) = (Hasher::default(), Hasher::default());
        self.sor.reset();
        for sweeps in [1, 4, 2] {
            self.load(config, limit.min(TILT_LIMIT), numbers);
            self.sor.relax(config.solver(), sweeps);
            residuals.u64(self.sor.residual_squared(config.solver()));
            self.sor.remove_means(config.solver(), config.nodes());
            for node in config.nodes() {
                pistons.i32(self.sor.piston(*node));
            }
        }
        [("pistons", pistons.finish()), ("residuals", residuals.finish())]
    }

    fn load<const P: usize, const B: usize, const K: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        limit: i32,
        numbers: &mut Generator,
    ) {
        let Some(mask) = config.mask() else { return };
        let grid = Grid::new(mask.across());
        self.field.fill([0; 2]);
        for axis in 0..2 {
            for (x, y) in mask.cells() {
                let place = Place::new::<M>(grid.node(x, y));
                if let Some(tilt) = self.field.get_mut(place).and_then(|tilt| tilt.get_mut(axis)) {
                    *tilt = match numbers.below(4) {
                        0 => limit,
                        1 => -limit,
                        _ => numbers.between(-limit, limit),
                    };
                }
            }
        }
        self.sor.load(config.solver(), &self.field);
    }
}
