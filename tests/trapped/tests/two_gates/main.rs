//! Two gates: the correction that their difference makes, and what carries its configuration.

mod carried;
mod exchanged;
mod extremes;
mod law;
mod refused;
mod rows;
mod stability;
mod told;

use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::geometry::Mask;
use splash_firmware::pipeline::{Pipeline, Report};
use splash_firmware::spec::SorSpec;
use splash_tests::frames::Rng;
use splash_tests::instrument::Instrument;
use splash_tests::twin::modal::polynomials;

/// Two gates of up to 8 x 8 subapertures with windows of 4 x 4 pixels, and 25 modes.
type Bank = Config<128, { 128 * 16 }, 0, 25>;
type Path = Pipeline<128, 0, 25>;

/// What both gates see, ulp; `None` where dark.
type Seen = [Vec<Option<[f64; 2]>>; 2];

fn circle(across: usize) -> Mask {
    Mask::circle(across).expect("4 to 40")
}

/// A coupling within +-`size`.
fn coupling(modes: usize, size: f64, rng: &mut Rng) -> Vec<f64> {
    (0..2 * modes * modes).map(|_| rng.uniform(-size, size)).collect()
}

/// Two gates with windows of 4 x 4 pixels and few sweeps: pistons are not of interest.
fn instrument(across: usize, modes: usize, coupling: Vec<f64>) -> Instrument {
    let mask = circle(across);
    let mut instrument = Instrument::ideal(mask, 4);
    instrument.sor = SorSpec { sweeps: Some(1), cold_sweeps: Some(1), ..SorSpec::default() };
    instrument.with_second_gate(polynomials(&mask, modes), coupling)
}

/// Tilts within `size` ulp, without a mean.
fn tilts(count: usize, size: f64, rng: &mut Rng) -> Vec<[f64; 2]> {
    let mut tilts: Vec<_> = (0..count).map(|_| [0; 2].map(|_| rng.uniform(-size, size))).collect();
    for axis in 0..2 {
        let mean = tilts.iter().map(|t| t[axis]).sum::<f64>() / count as f64;
        tilts.iter_mut().for_each(|t| t[axis] -= mean);
    }
    tilts
}

/// A pipeline whose slopes are given to it.
struct Rig {
    config: Box<Bank>,
    path: Box<Path>,
    frame: u32,
    ulp_per_px: f64,
}

impl Rig {
    fn new(instrument: &Instrument) -> Self {
        Self {
            ulp_per_px: instrument.slope_gain_m_per_px.at(0)[0][0] / instrument.ulp_m(),
            config: instrument.bank(),
            path: Box::new(Path::new()),
            frame: 0,
        }
    }

    /// The measurement of a slope, ulp.
    fn measurement(&self, slope: Option<[f64; 2]>) -> Measurement {
        let centroid = |s: f64| (s / self.ulp_per_px * 65536.0).round() as i32;
        Measurement {
            centroid_q16: slope.map_or([0; 2], |s| s.map(centroid)),
            flux: if slope.is_some() { 10_000 } else { 0 },
            peak: 1000,
            saturated: 0,
        }
    }

    /// One frame of what both gates see before a flat mirror, ulp.
    fn frame(&mut self, seen: &Seen) -> Report {
        let shown = self.shown();
        let left = |(i, s): (usize, &Option<[f64; 2]>)| {
            // None before the first frame.
            let [tip, tilt] = shown.get(i).copied().unwrap_or_default();
            s.map(|[x, y]| [x - tip, y - tilt])
        };
        let slopes = [0, 1].map(|gate| seen[gate].iter().enumerate().map(left).collect());
        self.slopes_of(&slopes)
    }

    /// One frame of slopes, ulp.
    fn slopes_of(&mut self, slopes: &Seen) -> Report {
        let all = slopes.iter().flatten().map(|&s| self.measurement(s)).collect::<Vec<_>>();
        self.path.begin(&self.config, self.frame);
        self.path.push_measurements(&self.config, &all).expect("one a window");
        self.frame += 1;
        self.path.finish(&self.config)
    }

    /// The slopes as they were measured.
    fn slopes(&self) -> Seen {
        [self.path.slopes(), self.path.second_slopes()].map(|slopes| {
            let tilt = |s: &splash_firmware::slopes::Slope| s.tilt_ulp.map(f64::from);
            slopes.iter().map(|s| s.valid.then(|| tilt(s))).collect()
        })
    }

    /// What the mirror shows.
    fn shown(&self) -> Vec<[f64; 2]> {
        self.path.positions().iter().map(|p| p.tilt_ulp.map(f64::from)).collect()
    }

    /// Largest difference between the commands and others, ulp.
    fn distance(&self, others: &[[f64; 2]]) -> f64 {
        let commands = self.path.commands().as_flattened().iter().zip(others.as_flattened());
        splash_tests::largest(commands.map(|(&a, b)| f64::from(a) - b))
    }
}
