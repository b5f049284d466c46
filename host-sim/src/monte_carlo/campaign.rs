//! Screens in parallel: one thread a screen, each with all of its cases.

use super::budget::Case;
use super::point::{Outcome, Prepared};
use crate::error::Error;
use rayon::ThreadPoolBuilder;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// A screen and what is to be run under it.
pub type Job = (u32, Vec<Case>);

/// What is told of a finished screen.
pub type Listener<'a> = dyn FnMut(u32, &[(Case, Outcome)]) -> Result<(), Error> + 'a;

/// Threads for `jobs` screens: as many as rayon would take, `RAYON_NUM_THREADS` included.
pub fn workers(jobs: usize) -> usize {
    rayon::current_num_threads().min(jobs).max(1)
}

/// Runs `jobs` on as many threads as `workers` says and hands each screen to `finished` when it is, in
/// any order. The optics below have one thread each: with screens enough, that wastes least.
///
/// # Errors
/// The first error of a screen or of `finished`; no screen is begun after it.
pub fn run(
    prepared: &Prepared<'_>,
    jobs: &[Job],
    workers: usize,
    finished: &mut Listener<'_>,
) -> Result<(), Error> {
    let next = AtomicUsize::new(0);
    let (sender, receiver) = mpsc::channel();
    std::thread::scope(|scope| {
        for _ in 0..workers {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || {
                let pool = match ThreadPoolBuilder::new().num_threads(1).build() {
                    Ok(pool) => pool,
                    Err(error) => return drop(sender.send(Err(Error::Run(error.to_string())))),
                };
                while let Some((screen, cases)) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let outcomes = pool.install(|| prepared.run(*screen, cases));
                    // Nobody listens any more after an error.
                    if sender.send(outcomes.map(|outcomes| (*screen, outcomes))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        let result = receiver.iter().try_for_each(|result| {
            let (screen, outcomes) = result?;
            finished(screen, &outcomes)
        });
        next.store(jobs.len(), Ordering::Relaxed);
        result
    })
}
