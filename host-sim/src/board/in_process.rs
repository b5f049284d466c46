//! The library in this process.

use super::capacity::smallest;
use super::{Board, BoardError, Frame, Options, Standing};
use splash_firmware::calibration::Step;
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::controller::{Command, Controller, Start};
use splash_firmware::error::ConfigError;
use splash_firmware::link::Stack;
use splash_firmware::pipeline::{Probe, Report, Stage, Totals};
use splash_firmware::segments::Position;
use splash_firmware::slopes::Slope;
use splash_firmware::spec::Spec;
use splash_server::{PERMITTED, controller};
use std::time::Instant;

/// A configuration and the state of its loop.
struct InProcess<const M: usize, const P: usize, const B: usize, const K: usize> {
    config: Box<Config<M, P, B, K>>,
    controller: Box<Controller<M, B, K>>,
    /// Frames go through the controller.
    controlled: bool,
    /// The board's clock, ns of frames.
    ticks: u64,
    clock: Clock,
}

/// Rows that are handed over at once, as on the other boards.
const BLOCK: usize = 16;

/// Looks at the time where the other boards make a mark.
struct Clock {
    start: Instant,
    marks: Vec<u64>,
    /// Whether someone wants to know.
    runs: bool,
}

impl Clock {
    fn new(runs: bool) -> Self {
        let mut clock = Self { start: Instant::now(), marks: Vec::new(), runs };
        // The first look at the time takes longer than any other.
        (0..100).for_each(|_| clock.mark());
        clock.marks.drain(..clock.marks.len().saturating_sub(2));
        clock
    }

    fn mark(&mut self) {
        if self.runs {
            self.marks.push(self.start.elapsed().as_nanos() as u64);
        }
    }
}

impl Probe for Clock {
    fn after(&mut self, _: Stage) {
        self.mark();
    }
}

/// The library in this process, with the smallest capacities that hold the instrument. Results do
/// not depend on them.
///
/// # Errors
/// The [`ConfigError`] of the library.
pub fn in_process(spec: &Spec<'_>) -> Result<Box<dyn Board + Send>, ConfigError> {
    Ok(local(spec, Options::default())?)
}

/// [`in_process`], with marks if they are asked for.
///
/// # Errors
/// The [`ConfigError`] of the library.
pub fn open(spec: &Spec<'_>, options: Options) -> Result<Box<dyn Board + Send>, ConfigError> {
    Ok(local(spec, options)?)
}

/// A board here, which can say what one elsewhere has to know.
pub(super) trait Local: Board {
    /// The image of its configuration.
    fn image(&self) -> Vec<u8>;

    /// Records that it was calibrated.
    fn set_calibrated(&mut self, steps: &[Step], quality_q16: u16);
}

/// The image of a configuration that a board can load, with the record of these steps of a
/// calibration and its quality.
///
/// # Errors
/// The [`ConfigError`] of the library.
pub fn image(spec: &Spec<'_>, steps: &[Step], quality_q16: u16) -> Result<Vec<u8>, ConfigError> {
    let mut board = local(spec, Options::default())?;
    if !steps.is_empty() {
        board.set_calibrated(steps, quality_q16);
    }
    Ok(board.image())
}

pub(super) fn local(
    spec: &Spec<'_>,
    options: Options,
) -> Result<Box<dyn Local + Send>, ConfigError> {
    macro_rules! with {
        ($cells:literal, $pixels:literal, $modes:expr) => {
            InProcess::<$cells, $pixels, $pixels, { $modes }>::boxed(spec, options)
        };
    }
    smallest!(spec, with)
}

/// Stack of the thread that makes the largest board: configuration and state are made on the
/// stack before they are boxed, and a debug build copies them on the way.
const BUILD_STACK: usize = 256 << 20;

impl<const M: usize, const P: usize, const B: usize, const K: usize> InProcess<M, P, B, K> {
    fn boxed(spec: &Spec<'_>, options: Options) -> Result<Box<dyn Local + Send>, ConfigError> {
        let build = || {
            let mut config = Box::new(Config::<M, P, B, K>::new());
            config.build(spec)?;
            let mut controller = Box::new(controller());
            controller.reset_bench(&config);
            let clock = Clock::new(options.marks);
            Ok(Box::new(Self { config, controller, controlled: false, ticks: 0, clock })
                as Box<dyn Local + Send>)
        };
        std::thread::scope(|scope| {
            let builder = std::thread::Builder::new().stack_size(BUILD_STACK);
            let thread = builder.spawn_scoped(scope, build).expect("the system starts a thread");
            thread.join().expect("building a configuration does not panic")
        })
    }
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Local
    for InProcess<M, P, B, K>
{
    fn image(&self) -> Vec<u8> {
        let mut image = Vec::new();
        self.config.save(&mut |piece| image.extend_from_slice(piece));
        image
    }

    fn set_calibrated(&mut self, steps: &[Step], quality_q16: u16) {
        self.config.set_calibrated(steps, quality_q16);
    }
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Board
    for InProcess<M, P, B, K>
{
    fn reset(&mut self) -> Result<(), BoardError> {
        if self.controlled {
            // Into safe leads a way from everywhere.
            self.controller.request(&self.config, Command::Disarm, false, self.ticks)?;
            self.controlled = false;
        }
        self.controller.reset_bench(&self.config);
        Ok(())
    }

    fn command(&mut self, command: Command) -> Result<(), BoardError> {
        let Self { config, controller, controlled, ticks, .. } = self;
        if !*controlled {
            controller.exchange(config, config, true)?;
            *controlled = true;
        }
        controller.interlock(PERMITTED, *ticks);
        // What its slopes are calibrated by is in the specification.
        let asked = controller.request(config, command, true, *ticks);
        controller.interlock(PERMITTED, *ticks);
        Ok(asked?)
    }

    fn standing(&mut self) -> Result<Standing, BoardError> {
        let Self { controller, .. } = self;
        Ok(Standing { mode: controller.mode(), faults: *controller.faults().counts() })
    }

    fn frame(&mut self, number: u32, frame: Frame<'_>) -> Result<Report, BoardError> {
        let refused = |source| BoardError::Refused { frame: number, source };
        self.clock.mark();
        let timing = self.config.timing();
        self.ticks += timing.frame_ns();
        if self.controlled {
            let pulses = timing.pulses_per_frame;
            let start = Start { number, pulses, ticks: self.ticks };
            self.controller.begin(&self.config, start);
        } else {
            self.controller.bench().begin(&self.config, number);
        }
        self.clock.mark();
        match frame {
            Frame::Pixels(pixels) => {
                let width = usize::from(self.config.width()).max(1);
                // A row that is cut short comes alone.
                let (whole, cut) = pixels.split_at(pixels.len() - pixels.len() % width);
                for rows in whole.chunks(BLOCK * width).chain(cut.chunks(width)) {
                    let count = rows.len().div_ceil(width) as u16;
                    self.clock.mark();
                    let pushed = self.controller.push_rows(&self.config, rows, count);
                    self.clock.mark();
                    pushed.map_err(refused)?;
                }
            }
            Frame::Measurements(measurements) => {
                self.controller.push_measurements(&self.config, measurements).map_err(refused)?;
            }
        }
        self.clock.mark();
        let report = if self.controlled {
            self.controller.finish(&self.config, &mut self.clock).report
        } else {
            self.controller.bench().finish_probed(&self.config, &mut self.clock)
        };
        self.clock.mark();
        if self.controlled {
            self.controller.interlock(PERMITTED, self.ticks);
        }
        Ok(report)
    }

    fn codes(&self) -> &[[u16; 3]] {
        self.controller.pipeline().codes()
    }

    fn measurements(&self) -> &[Measurement] {
        self.controller.pipeline().measurements()
    }

    fn second_measurements(&self) -> &[Measurement] {
        self.controller.pipeline().second_measurements()
    }

    fn slopes(&self) -> &[Slope] {
        self.controller.pipeline().slopes()
    }

    fn second_slopes(&self) -> &[Slope] {
        self.controller.pipeline().second_slopes()
    }

    fn positions(&self) -> &[Position] {
        self.controller.pipeline().positions()
    }

    fn components(&self) -> usize {
        self.config.components()
    }

    fn ulp_m(&self) -> f64 {
        self.config.ulp_m()
    }

    fn totals(&self) -> Totals {
        self.controller.pipeline().totals()
    }

    fn marks(&mut self) -> Result<Vec<u64>, BoardError> {
        Ok(std::mem::take(&mut self.clock.marks))
    }

    fn stack(&mut self) -> Result<Option<Stack>, BoardError> {
        Ok(None)
    }
}
