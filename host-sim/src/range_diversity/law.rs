//! Commands from the slopes of both gates: f x1 + q B [q^T x1; q^T x2].

use super::design::Design;

/// f, q and B as the firmware takes them.
#[derive(Clone, Debug, PartialEq)]
pub struct Law {
    /// f.
    pub lever_arm: f64,
    /// q, mode after mode, x and y of each subaperture in the order of the mask's rows.
    pub modes: Vec<[f64; 2]>,
    /// B, M rows of 2M: what the gate at H, then what the other, adds to a mode.
    pub coupling: Vec<f64>,
}

impl Law {
    /// One gate and the number f.
    pub fn scalar(lever_arm: f64) -> Self {
        Self { lever_arm, modes: Vec::new(), coupling: Vec::new() }
    }

    /// Commands in the unit of `first` and `second`, the slopes of both gates with what the mirror took out added
    /// back.
    ///
    /// # Panics
    /// If the slopes are not those of the modes' subapertures.
    pub fn commands(&self, first: &[[f64; 2]], second: &[[f64; 2]], commands: &mut [[f64; 2]]) {
        assert_eq!(first.len(), commands.len(), "slopes");
        for (command, slope) in commands.iter_mut().zip(first) {
            *command = slope.map(|slope| self.lever_arm * slope);
        }
        let each = || self.modes.chunks_exact(commands.len().max(1));
        let seen = |slopes: &[[f64; 2]]| -> Vec<f64> {
            assert!(self.modes.is_empty() || slopes.len() == first.len(), "slopes");
            let along = |mode: &[[f64; 2]]| {
                mode.iter().zip(slopes).map(|(q, s)| q[0] * s[0] + q[1] * s[1]).sum()
            };
            each().map(along).collect()
        };
        let seen = [seen(first), seen(second)].concat();
        let added: Vec<f64> = self
            .coupling
            .chunks_exact(seen.len().max(1))
            .map(|row| row.iter().zip(&seen).map(|(b, m)| b * m).sum())
            .collect();
        for (mode, added) in each().zip(added) {
            for (command, q) in commands.iter_mut().zip(mode) {
                command[0] += added * q[0];
                command[1] += added * q[1];
            }
        }
    }
}

impl From<&Design> for Law {
    fn from(design: &Design) -> Self {
        Self {
            lever_arm: design.lever_arm,
            modes: design.modes.mode_major(),
            coupling: design.coupling.transpose().as_slice().to_vec(),
        }
    }
}
