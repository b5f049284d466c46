//! A Monte Carlo run of several pupils: what is there already, what the rest will take, and doing it.

use super::{output, progress};
use crate::closed_loop::Sensing;
use crate::error::Error;
use crate::monte_carlo::budget::{Case, Step, chain};
use crate::monte_carlo::campaign::{self, Job};
use crate::monte_carlo::checkpoint::Checkpoint;
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::cost::{self, Cost};
use crate::monte_carlo::point::{Conditions, Outcome, Point};
use crate::monte_carlo::shard::Shard;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// A run that takes longer, s, says so instead.
const LONG_S: f64 = 86400.0;

/// What is run.
pub(super) struct Campaign {
    /// In the order of the points; at least one.
    pub(super) tasks: Vec<Task>,
    /// In the order of [`Comparator::ALL`], each once.
    pub(super) comparators: Vec<Comparator>,
    /// With the steps of the sensors' error budgets.
    pub(super) budget: bool,
}

/// One size of pupil with what is to be done for it.
pub(super) struct Task {
    pub(super) point: Point,
    pub(super) screens: u32,
    /// Screens under which all cases are there: what results are made of.
    pub(super) finished: Vec<u32>,
    /// What is run under each screen.
    cases: Vec<Case>,
    /// Of the checkpoint.
    name: String,
    checkpoint: Checkpoint,
    jobs: Vec<Job>,
    /// Of each job, s on one core.
    core_s: Vec<f64>,
    /// Why nothing was run: a sensor that cannot be calibrated.
    pub(super) refused: Option<String>,
}

/// How much of a size of pupil is there.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Progress {
    pub(super) n: usize,
    pub(super) screens: u32,
    pub(super) finished: u32,
    pub(super) missing: u32,
}

/// Where a run in `directory` keeps its screens.
const KEPT: &str = "screens";

impl Campaign {
    /// Opens the checkpoints in `directory` of points with their numbers of screens, and finds what is missing.
    ///
    /// # Errors
    /// [`Error`] if a checkpoint cannot be used, or a screen would be too large for any memory.
    pub(super) fn open(
        directory: &Path,
        points: Vec<(Point, u32)>,
        comparators: &[Comparator],
        budget: bool,
    ) -> Result<Self, Error> {
        Self::open_part(directory, points, comparators, budget, None)
    }

    /// The same, where only a part is to be run.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub(super) fn open_part(
        directory: &Path,
        points: Vec<(Point, u32)>,
        comparators: &[Comparator],
        budget: bool,
        shard: Option<Shard>,
    ) -> Result<Self, Error> {
        let comparators: Vec<_> =
            Comparator::ALL.into_iter().filter(|known| comparators.contains(known)).collect();
        let kept = output::directory(Some(&directory.join(KEPT)), "")?;
        let mut tasks = Vec::new();
        for (place, (point, screens)) in points.into_iter().enumerate() {
            let ours = |screen: &u32| shard.is_none_or(|shard| shard.holds(place, *screen));
            let cases = cases(&point, &comparators, budget);
            tasks.push(Task::open(&kept, point, screens, cases, (0..screens).filter(ours))?);
        }
        Ok(Self { tasks, comparators, budget })
    }

    /// Points with what is to be run under the screens of each, their own list of cases.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub(super) fn of_cases(
        directory: &Path,
        points: Vec<(Point, u32, Vec<Case>)>,
    ) -> Result<Self, Error> {
        let kept = output::directory(Some(&directory.join(KEPT)), "")?;
        let open = |(point, screens, cases)| Task::open(&kept, point, screens, cases, 0..screens);
        let tasks = points.into_iter().map(open).collect::<Result<_, _>>()?;
        Ok(Self { tasks, comparators: Vec::new(), budget: false })
    }

    /// Takes over what other runs have, which may be going on.
    ///
    /// # Errors
    /// [`Error::Run`] if their screens cannot be read, or one came to something else than it did here.
    pub(super) fn absorb<P: AsRef<Path>>(&mut self, directories: &[P]) -> Result<(), Error> {
        for directory in directories {
            let kept = directory.as_ref().join(KEPT);
            self.tasks.iter_mut().try_for_each(|task| task.absorb(&kept))?;
        }
        self.tasks.iter_mut().for_each(Task::count);
        Ok(())
    }

    /// What is there, by N.
    pub(super) fn progress(&self) -> Vec<Progress> {
        let of = |task: &Task| {
            let (screens, finished) = (task.screens, task.finished.len() as u32);
            Progress { n: task.point.n(), screens, finished, missing: screens - finished }
        };
        self.tasks.iter().map(of).collect()
    }

    /// How many screens are still to be run here.
    pub(super) fn to_run(&self) -> usize {
        self.tasks.iter().map(|task| task.jobs.len()).sum()
    }

    /// Time and memory in words; an error where the memory is not there, or for more than a day.
    ///
    /// # Errors
    /// [`Error::Config`].
    pub(super) fn estimate(&self, long: bool) -> Result<String, Error> {
        let (mut seconds, mut bytes) = (0.0, 0);
        for task in self.tasks.iter().filter(|task| !task.jobs.is_empty()) {
            let workers = campaign::workers(task.jobs.len());
            let most = task.jobs.iter().max_by_key(|(_, cases)| cases.len());
            let Some((_, cases)) = most else { continue };
            let cost = Cost::of_screen(&task.point, cases)?;
            seconds += task.core_s.iter().sum::<f64>() / workers as f64;
            bytes = bytes.max(cost.shared + workers as u64 * cost.each);
        }
        let gigabytes = bytes as f64 / 1e9;
        let words = format!("{}, {gigabytes:.1} GB", in_words(seconds));
        match cost::available() {
            Some(available) if bytes > available => Err(Error::Config(format!(
                "the run would take {words}, of which {:.1} GB are available: take a smaller --n, a lower --wind \
                 or --frames, or RAYON_NUM_THREADS=1",
                available as f64 / 1e9
            ))),
            _ if seconds > LONG_S && !long => Err(Error::Config(format!(
                "the run would take about {words}: take fewer --screens or a smaller --n, or --long to start it"
            ))),
            _ => Ok(words),
        }
    }

    /// Runs what is missing, behind bars that know the time left.
    ///
    /// # Errors
    /// [`Error`] of the first screen that fails.
    pub(super) fn run(&mut self) -> Result<(), Error> {
        self.run_but(|_, error| Err(error))
    }

    /// The same, but a point whose sensors cannot be calibrated is a result: it has no numbers.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub(super) fn run_what_can_be(&mut self) -> Result<(), Error> {
        self.run_but(|task, error| match error {
            Error::Uncalibrated(words) => {
                task.refused = Some(words);
                Ok(())
            }
            other => Err(other),
        })
    }

    fn run_but(
        &mut self,
        failed: impl Fn(&mut Task, Error) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let total_s: f64 = self.tasks.iter().flat_map(|task| &task.core_s).sum();
        let mut done_s = 0.0;
        self.tasks.iter_mut().try_for_each(|task| {
            task.run(&mut done_s, total_s).or_else(|error| failed(task, error))
        })
    }

    /// How many screens are finished, in words.
    pub(super) fn screens(&self) -> String {
        count_in_words(self.tasks.iter().map(|task| task.finished.len()))
    }

    /// How many screens are asked for, in words.
    pub(super) fn asked(&self) -> String {
        count_in_words(self.tasks.iter().map(|task| task.screens as usize))
    }

    /// The sky and the sensing, in words.
    pub(super) fn sky(&self) -> String {
        let point = &self.tasks[0].point;
        let sky = if point.still() { "frozen" } else { "moving" };
        let Conditions { sensing, noise_free, .. } = point.conditions();
        let detector = match (sensing, noise_free) {
            (Sensing::Geometric, _) => "exact gradients",
            (Sensing::Images, true) => "images without noise",
            (Sensing::Images, false) => "images with noise",
        };
        format!("{sky}, {detector}")
    }

    /// Sky, sensing, frames and seed, in words.
    pub(super) fn conditions(&self) -> String {
        let point = &self.tasks[0].point;
        let (Conditions { frames, seed, .. }, settle) = (point.conditions(), point.settle());
        format!("{}, {frames} frames after {settle} to settle, seed {seed}", self.sky())
    }
}

/// The runs of `comparators`, with the steps towards them for a budget, each once.
fn cases(point: &Point, comparators: &[Comparator], budget: bool) -> Vec<Case> {
    let mut cases: Vec<Case> = comparators.iter().map(|&comparator| comparator.into()).collect();
    if budget {
        let chains = comparators.iter().flat_map(|&comparator| chain(point, comparator));
        for (_, case) in chains {
            if !cases.contains(&case) {
                cases.push(case);
            }
        }
    }
    cases
}

impl Task {
    /// What is known of a point in `kept`, and what is missing of the screens to run.
    fn open(
        kept: &Path,
        point: Point,
        screens: u32,
        cases: Vec<Case>,
        to_run: impl Iterator<Item = u32>,
    ) -> Result<Self, Error> {
        let name = format!("n{}-{}.csv", point.n(), point.digest()?);
        let checkpoint = Checkpoint::open(&kept.join(&name))?;
        let missing = |screen: u32| -> Option<Job> {
            let known = |case| checkpoint.finished().contains_key(&(screen, case));
            let missing: Vec<_> = cases.iter().copied().filter(|&case| !known(case)).collect();
            (!missing.is_empty()).then_some((screen, missing))
        };
        let jobs: Vec<Job> = to_run.filter_map(missing).collect();
        let cost = |(_, cases): &Job| Ok(Cost::of_screen(&point, cases)?.core_s);
        let core_s = jobs.iter().map(cost).collect::<Result<_, Error>>()?;
        let (finished, refused) = (Vec::new(), None);
        let mut task =
            Self { point, screens, finished, cases, name, checkpoint, jobs, core_s, refused };
        task.count();
        Ok(task)
    }

    /// Finds the screens that are finished.
    fn count(&mut self) {
        let known = |screen, case| self.checkpoint.finished().contains_key(&(screen, case));
        let finished = |screen: &u32| self.cases.iter().all(|&case| known(*screen, case));
        self.finished = (0..self.screens).filter(finished).collect();
    }

    /// Takes over what is kept elsewhere.
    fn absorb(&mut self, kept: &Path) -> Result<(), Error> {
        let path = kept.join(&self.name);
        let mut news: BTreeMap<u32, Vec<(Case, Outcome)>> = BTreeMap::new();
        for ((screen, case), outcome) in Checkpoint::read(&path)? {
            match self.checkpoint.finished().get(&(screen, case)) {
                None => news.entry(screen).or_default().push((case, outcome)),
                Some(known) if *known == outcome => {}
                Some(known) => {
                    return Err(Error::Run(format!(
                        "{}: screen {screen}, {}: Strehl ratio {}, and {} elsewhere: of another processor?",
                        path.display(),
                        case.name(),
                        outcome.strehl,
                        known.strehl
                    )));
                }
            }
        }
        news.iter().try_for_each(|(&screen, outcomes)| self.checkpoint.add(screen, outcomes))
    }

    /// Runs what is missing, behind a bar that knows `done_s` of `total_s`.
    fn run(&mut self, done_s: &mut f64, total_s: f64) -> Result<(), Error> {
        let Self { point, checkpoint, jobs, core_s, .. } = &mut *self;
        if jobs.is_empty() {
            return Ok(());
        }
        let (bar, mut progress) = progress::fraction("calibration");
        let mut needed: Vec<_> = jobs.iter().flat_map(|(_, cases)| cases).copied().collect();
        needed.sort_unstable();
        needed.dedup();
        let prepared = point.prepare(&needed, &mut progress)?;
        bar.finish_and_clear();
        let bar = progress::share(format!("N = {}", point.n()));
        let mean_s = core_s.iter().sum::<f64>() / core_s.len() as f64;
        bar.set_position((1000.0 * *done_s / total_s) as u64);
        bar.reset_eta();
        let workers = campaign::workers(jobs.len());
        campaign::run(&prepared, jobs, workers, &mut |screen, outcomes| {
            *done_s += mean_s;
            bar.set_position((1000.0 * *done_s / total_s) as u64);
            checkpoint.add(screen, outcomes)
        })?;
        bar.finish_and_clear();
        self.count();
        Ok(())
    }

    /// D / r0.
    pub(super) fn diameter_in_r0(&self) -> f64 {
        self.point.pupil().diameter_m() / self.point.instrument().r0_m()
    }

    /// What a case came to under a screen that is finished.
    pub(super) fn outcome(&self, screen: u32, case: impl Into<Case>) -> Outcome {
        self.checkpoint.finished()[&(screen, case.into())]
    }

    /// One number of each screen that is finished, in their order; of what was refused no number.
    pub(super) fn values(&self, case: impl Into<Case>, of: fn(&Outcome) -> f64) -> Vec<f64> {
        if self.refused.is_some() {
            return vec![f64::NAN; self.screens as usize];
        }
        let case = case.into();
        self.finished.iter().map(|&screen| of(&self.outcome(screen, case))).collect()
    }

    /// The chain of a sensor's error budget, with the variance of each screen.
    pub(super) fn chain(&self, comparator: Comparator) -> Vec<(Step, Vec<f64>)> {
        let variance = |case| self.values(case, |outcome| outcome.variance_rad2);
        chain(&self.point, comparator).into_iter().map(|(s, case)| (s, variance(case))).collect()
    }
}

fn count_in_words(screens: impl Iterator<Item = usize> + Clone) -> String {
    match (screens.clone().min(), screens.max()) {
        (Some(least), Some(most)) if least < most => format!("{least} to {most} screens"),
        (_, most) => format!("{} screens", most.unwrap_or(0)),
    }
}

fn in_words(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} minutes", s / 60.0),
        s if s < 2.0 * LONG_S => format!("{:.0} hours", s / 3600.0),
        s => format!("{:.0} days", s / LONG_S),
    }
}
