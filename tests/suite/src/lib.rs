//! Named cases for every stage of the reconstructor, each with a digest of what came out.
//!
//! The digests are the same on every target, whatever its word, its kernels and its floats, and in
//! every profile; `tests/golden/suite.txt` says what they are. Frames, calibrations and arguments come
//! from an integer generator in here, so that a board needs nothing but this library and a console:
//! `examples/host.rs` is all that its program is.
//!
//! Two thirds of its time on a core without floats are `Config::build`, which the suite proves as
//! well; hence instruments of few pixels, each with many cases.

#![cfg_attr(not(test), no_std)]

mod cases;
mod digest;
mod generator;
mod instrument;
mod maps;
mod play;
mod primitives;
mod scene;
mod solver;
mod stages;

use core::fmt;

use splash_firmware::config::Config;
use splash_firmware::error::ConfigError;
use splash_firmware::modal::MAX_MODES;
use splash_firmware::pipeline::Pipeline;

pub use digest::Digest;

/// Windows of the largest pupil with two gates; its cells are fewer.
pub const WINDOWS: usize = 2 * 208;
/// Window pixels of the largest detector.
pub const PIXELS: usize = 208 * 8 * 8;
/// Pixels that brightest-n has to buffer.
pub const BUFFER: usize = 8 * 8 * 8;

/// Modes of a second gate.
pub const MODES: usize = MAX_MODES;

/// One result: of a case and a stage. Displayed as one line of the golden file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    /// The instrument, or what else the case is about.
    pub subject: &'static str,
    /// What is done with it.
    pub case: &'static str,
    /// The stage.
    pub stage: &'static str,
    /// What it computed.
    pub digest: Digest,
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {} {}", self.subject, self.case, self.stage, self.digest)
    }
}

/// All the memory that the suite needs beside a stack: one bank, one pipeline, one solver. Too large
/// for the stack of a board: make it a `static`.
///
/// Capacities as in [`Config`], at least [`WINDOWS`], [`PIXELS`], [`BUFFER`] and [`MODES`]. The digests do not
/// depend on them.
#[derive(Debug)]
pub struct Workspace<const M: usize, const P: usize, const B: usize, const K: usize> {
    config: Config<M, P, B, K>,
    pipeline: Pipeline<M, B, K>,
    solver: solver::Solver<M>,
    maps: maps::Maps,
    source: play::Source,
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Default
    for Workspace<M, P, B, K>
{
    fn default() -> Self {
        Self::new()
    }
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Workspace<M, P, B, K> {
    /// A workspace that has run nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            config: Config::new(),
            pipeline: Pipeline::new(),
            solver: solver::Solver::new(),
            maps: maps::Maps::new(),
            source: play::Source::new(),
        }
    }

    /// Runs all cases; `each` gets the lines as they come, always the same ones in the same order.
    ///
    /// # Errors
    /// That of [`Config::build`], if an instrument does not fit the capacities; the rest is then not
    /// run.
    pub fn run(&mut self, each: &mut dyn FnMut(Line)) -> Result<(), ConfigError> {
        let mut line = |subject, case, stage, digest| each(Line { subject, case, stage, digest });
        for (case, digest) in primitives::digests() {
            line("fixed", case, "results", digest);
        }
        for subject in cases::SUBJECTS.into_iter().flatten() {
            let instrument = &subject.instrument;
            let name = instrument.name;
            self.config.build(&instrument.spec(&mut self.maps)?)?;
            line(name, "build", "configuration", digest::configuration(&self.config));
            for &(case, limit) in subject.tilts {
                for (stage, digest) in self.solver.relax(&self.config, limit) {
                    line(name, case, stage, digest);
                }
            }
            for case in subject.cases {
                let (maps, config, pipeline) = (&self.maps, &self.config, &mut self.pipeline);
                let stages = play::play(case, instrument, maps, config, pipeline, &mut self.source);
                stages.finish(pipeline.totals(), case.shown, |stage, digest| {
                    line(name, case.name, stage, digest);
                });
            }
        }
        Ok(())
    }
}
