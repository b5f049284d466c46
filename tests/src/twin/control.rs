//! The pseudo-open-loop integrator.

use splash_firmware::slopes::MeanSlope;

use super::pistons::Pupil;
use super::pixels::Numbers;
use super::{round, stored};
use crate::instrument::Instrument;

/// The law and its state.
#[derive(Clone, Debug)]
pub struct Integrator {
    /// 1 - g and g f.
    gains: Vec<[f64; 2]>,
    removes_mean: bool,
    pupil: Pupil,
    /// c of each subaperture.
    pub command: Vec<[f64; 2]>,
}

impl Integrator {
    /// The law of `instrument`, at rest.
    pub fn new(instrument: &Instrument, numbers: Numbers) -> Self {
        let pupil = Pupil::new(&instrument.mask);
        let f = instrument.lever_arm;
        let gains = |i| {
            let g = instrument.control_gain.at(i);
            match numbers {
                Numbers::Physical => [1.0 - g, g * f],
                // 13-bit fractions; the second from the rounded first.
                Numbers::Stored => {
                    let g = stored(g, 13);
                    [1.0 - g, round(g * 8192.0 * f) / 8192.0]
                }
            }
        };
        Self {
            gains: (0..pupil.count()).map(gains).collect(),
            removes_mean: instrument.mean == MeanSlope::Remove,
            command: vec![[0.0; 2]; pupil.count()],
            pupil,
        }
    }

    /// One frame: slopes (`None` where invalid) and what the mirror showed while they were
    /// exposed.
    pub fn update(&mut self, slopes: &[Option<[f64; 2]>], applied: &[[f64; 2]]) {
        for axis in 0..2 {
            let seen =
                |(s, applied): (&Option<[f64; 2]>, &[f64; 2])| s.map(|s| s[axis] + applied[axis]);
            let mut open: Vec<Option<f64>> = slopes.iter().zip(applied).map(seen).collect();
            if self.removes_mean {
                let mean = mean(open.iter().flatten().copied());
                open.iter_mut().flatten().for_each(|x| *x -= mean);
            }
            for (i, [keep, take]) in self.gains.iter().enumerate() {
                let beside = self.pupil.neighbours(i).iter().filter_map(|&j| open[j]);
                let x = open[i].or_else(|| (beside.clone().count() > 0).then(|| mean(beside)));
                if let Some(x) = x {
                    let c = &mut self.command[i][axis];
                    *c = keep * *c + take * x;
                }
            }
        }
    }
}

/// The mean; zero of none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    if count > 0.0 { sum / count } else { 0.0 }
}
