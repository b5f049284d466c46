//! What is run for which curve.
//!
//! The law c = f (s + c) of a loop that has converged under a sky that stands still needs one frame of exact
//! gradients and no loop. Images need the loop. Three more runs of images, twice as finely sampled, take the
//! centroid apart: with the whole of a spot's image in a window twice as wide, plain centre of gravity, what
//! differs from the gradient is diffraction and the speckle of the way back; then the window cuts the
//! wings, then the threshold takes off what is faint.

use crate::cli::ScaleArgs;
use crate::closed_loop::Sensing;
use crate::commands::strehl::SETTLE;
use crate::commands::{increasing, once};
use crate::error::{Error, refuse};
use crate::instrument::{EstimatorName, Instrument, LeverArm};
use crate::monte_carlo::budget::{Case, Step};
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::point::{Conditions, Point};
use crate::optics::geometric::Sensor;
use splash_firmware::centroid::MAX_WINDOW;

/// Screens for N up to the first number, gradients and images.
const SCREENS: [(usize, u32); 3] = [(32, 200), (64, 100), (usize::MAX, 48)];
const IMAGE_SCREENS: [(usize, u32); 3] = [(8, 100), (16, 50), (usize::MAX, 16)];
/// N with images, of those that are asked for.
const IMAGES: [usize; 3] = [8, 16, 32];
/// The integrator of Butterley et al. 2006.
const PLAIN: LeverArm = LeverArm::Factor(1.0);

/// Points with their screens and cases, and what they are for.
pub(super) struct Plan {
    pub(super) points: Vec<(Point, u32, Vec<Case>)>,
    pub(super) curves: Vec<Curve>,
}

/// One curve's place at one N.
pub(super) struct Curve {
    pub(super) n: usize,
    /// The name in files.
    pub(super) name: String,
    /// f, where there is a control law.
    pub(super) lever_arm: Option<f64>,
    /// Which of the points, and which of its cases.
    pub(super) point: usize,
    pub(super) case: Case,
    /// What it is compared with under the same screens, by name.
    pub(super) against: Vec<String>,
}

impl Plan {
    /// What the arguments ask for.
    ///
    /// # Errors
    /// [`Error::Config`] with field, value and limit.
    pub(super) fn new(args: &ScaleArgs) -> Result<Self, Error> {
        let description = args.description.load()?;
        let laws = once([PLAIN].into_iter().chain(args.lever_arm.iter().copied()));
        let across = increasing(&args.n, Ord::cmp);
        let with_images = args.images.as_deref().unwrap_or(&IMAGES);
        let stray = with_images.iter().find(|n| !across.contains(n));
        if let Some(n) = stray.filter(|_| args.images.is_some()) {
            return Err(refuse("--images", n, "one of --n"));
        }
        let mut plan = Self { points: Vec::new(), curves: Vec::new() };
        for n in across {
            let screens = args.screens.unwrap_or_else(|| for_size(&SCREENS, n));
            let maker = Maker { description: &description, n, seed: args.kept.seed };
            plan.gradients(maker, &laws, screens)?;
            if with_images.contains(&n) {
                let images = args.image_screens.unwrap_or_else(|| for_size(&IMAGE_SCREENS, n));
                plan.images(maker, &laws, images.min(screens))?;
                plan.centroids(maker, images.min(screens))?;
            }
        }
        Ok(plan)
    }

    /// All sensors by exact gradients: those with a beacon with each law.
    fn gradients(
        &mut self,
        maker: Maker<'_>,
        laws: &[LeverArm],
        screens: u32,
    ) -> Result<(), Error> {
        for &law in laws {
            let place = self.add(maker.gradients(law)?, screens);
            for comparator in [Comparator::Splash, Comparator::Lgs] {
                let mut against = Vec::new();
                if law != PLAIN {
                    against.push(named("", comparator, PLAIN));
                }
                if comparator == Comparator::Splash {
                    against.push(named("", Comparator::Lgs, law));
                }
                self.curve(place, named("", comparator, law), converged(comparator), against)?;
            }
            if law == PLAIN {
                for comparator in [Comparator::Ngs, Comparator::Fit] {
                    let name = named("", comparator, law);
                    self.curve(place, name, converged(comparator), Vec::new())?;
                }
            }
        }
        Ok(())
    }

    /// Images through the firmware, the description's centroids: SPLASH with each law.
    fn images(&mut self, maker: Maker<'_>, laws: &[LeverArm], screens: u32) -> Result<(), Error> {
        const IMAGES: &str = "images_";
        for &law in laws {
            let place = self.add(maker.images(law, maker.description)?, screens);
            let plain = [Comparator::Splash, Comparator::Lgs, Comparator::Ngs];
            for &comparator in if law == PLAIN { &plain[..] } else { &plain[..1] } {
                let mut against = vec![named("", comparator, law)];
                if law != PLAIN {
                    against.push(named(IMAGES, comparator, PLAIN));
                }
                let name = named(IMAGES, comparator, law);
                self.curve(place, name, comparator.into(), against)?;
            }
        }
        Ok(())
    }

    /// SPLASH's centroids taken apart, each step against the one before.
    fn centroids(&mut self, maker: Maker<'_>, screens: u32) -> Result<(), Error> {
        let mut fine = maker.description.clone();
        fine.telescope.samples *= 2;
        let mut plain = fine.clone();
        plain.centroids.estimator = EstimatorName::Plain;
        let mut wide = plain.clone();
        wide.windows.size = (2 * wide.windows.size).min(MAX_WINDOW);
        wide.windows.spacing_px = wide.windows.spacing_px.max(wide.windows.size);
        let fine_maker = Maker { description: &fine, ..maker };
        let place = self.add(fine_maker.gradients(PLAIN)?, screens);
        let names = ["fine_gradients", "fine_speckle", "fine_window", "fine_threshold"];
        self.curve(place, names[0].into(), converged(Comparator::Splash), Vec::new())?;
        for (k, description) in [&wide, &plain, &fine].into_iter().enumerate() {
            let place = self.add(maker.images(PLAIN, description)?, screens);
            let against = vec![names[k].into()];
            self.curve(place, names[k + 1].into(), Comparator::Splash.into(), against)?;
        }
        Ok(())
    }

    fn add(&mut self, point: Point, screens: u32) -> usize {
        self.points.push((point, screens, Vec::new()));
        self.points.len() - 1
    }

    fn curve(
        &mut self,
        place: usize,
        name: String,
        case: Case,
        against: Vec<String>,
    ) -> Result<(), Error> {
        let (point, _, cases) = &mut self.points[place];
        cases.push(case);
        let lever_arm = case.comparator.sensor().filter(|sensor| *sensor != Sensor::Ngs);
        let lever_arm = lever_arm.map(|sensor| point.instrument().lever_arm(sensor)).transpose()?;
        self.curves.push(Curve { n: point.n(), name, lever_arm, point: place, case, against });
        Ok(())
    }
}

/// What makes the points of an N.
#[derive(Clone, Copy)]
struct Maker<'a> {
    description: &'a Instrument,
    n: usize,
    seed: u64,
}

impl Maker<'_> {
    fn gradients(self, law: LeverArm) -> Result<Point, Error> {
        let conditions = Conditions {
            sensing: Sensing::Geometric,
            noise_free: true,
            settle: 0,
            frames: 1,
            seed: self.seed,
        };
        self.point(law, self.description, conditions)
    }

    fn images(self, law: LeverArm, description: &Instrument) -> Result<Point, Error> {
        let conditions = Conditions {
            sensing: Sensing::Images,
            noise_free: true,
            settle: SETTLE,
            // Nothing moves, and nothing is noisy: one frame is like the next.
            frames: 1,
            seed: self.seed,
        };
        self.point(law, description, conditions)
    }

    fn point(
        self,
        law: LeverArm,
        description: &Instrument,
        conditions: Conditions,
    ) -> Result<Point, Error> {
        let mut description = description.clone();
        description.control.lever_arm = law;
        Point::new(&description, self.n, conditions)
    }
}

/// The run with all its effects, as if it had all the time to converge.
fn converged(comparator: Comparator) -> Case {
    let until = match comparator {
        Comparator::Splash => Some(Step::ReturnPath),
        Comparator::Lgs => Some(Step::LeverArm),
        Comparator::Ngs => Some(Step::Aliasing),
        Comparator::Fit => None,
    };
    Case { comparator, until }
}

fn named(path: &str, comparator: Comparator, law: LeverArm) -> String {
    let sensor = comparator.name();
    if law == PLAIN { format!("{path}{sensor}") } else { format!("{path}{sensor}_{law}") }
}

fn for_size(screens: &[(usize, u32)], n: usize) -> u32 {
    screens.iter().find(|(up_to, _)| n <= *up_to).map_or(1, |(_, screens)| *screens)
}
