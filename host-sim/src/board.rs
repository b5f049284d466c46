//! Where the firmware library runs: a board takes rows and gives DAC codes.

use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::error::ConfigError;
use splash_firmware::pipeline::{Pipeline, Report, RowError, Totals};
use splash_firmware::segments::Position;
use splash_firmware::slopes::Slope;
use splash_firmware::spec::Spec;

/// What a frame is made of.
#[derive(Clone, Copy, Debug)]
pub enum Frame<'a> {
    /// Detector pixels, row-major, ADU.
    Pixels(&'a [u16]),
    /// Measurements made elsewhere, in mask order.
    Measurements(&'a [Measurement]),
}

/// Why a board could not take a frame.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// A row, or a list of measurements, was refused.
    #[error("frame {frame}: {source}")]
    Refused {
        /// The frame.
        frame: u32,
        /// Why.
        source: RowError,
    },
}

/// A reconstructor that runs somewhere.
pub trait Board {
    /// Opens the loop: forgets every frame and flattens the mirror.
    fn reset(&mut self);

    /// Feeds a frame and returns what became of it.
    ///
    /// # Errors
    /// [`BoardError`] if a row is refused; the rest of the frame is not sent.
    fn frame(&mut self, number: u32, frame: Frame<'_>) -> Result<Report, BoardError>;

    /// DAC codes of each segment's actuators.
    fn codes(&self) -> &[[u16; 3]];

    /// Measurements of the last frame.
    fn measurements(&self) -> &[Measurement];

    /// Slopes of the last frame.
    fn slopes(&self) -> &[Slope];

    /// Positions of the segments.
    fn positions(&self) -> &[Position];

    /// Parts of the pupil that no edge connects: the relative pistons of two are not measured.
    fn components(&self) -> usize;

    /// Optical path per length ulp, m.
    fn ulp_m(&self) -> f64;

    /// What went wrong so far.
    fn totals(&self) -> Totals;
}

/// The library in this process.
struct InProcess<const M: usize, const P: usize, const B: usize> {
    config: Box<Config<M, P, B>>,
    pipeline: Box<Pipeline<M, B>>,
}

/// The library in this process, with the smallest capacities that hold the instrument. Results do
/// not depend on them.
///
/// # Errors
/// The [`ConfigError`] of the library.
pub fn in_process(spec: &Spec<'_>) -> Result<Box<dyn Board + Send>, ConfigError> {
    let across = spec.mask.across();
    let pixels = spec.mask.count() * usize::from(spec.windows.size).pow(2);
    match (across, pixels) {
        (..=8, ..=16_384) => InProcess::<64, 16_384, 16_384>::boxed(spec),
        (..=16, ..=65_536) => InProcess::<256, 65_536, 65_536>::boxed(spec),
        _ => InProcess::<1600, 1_638_400, 1_638_400>::boxed(spec),
    }
}

/// Stack of the thread that makes the largest board: configuration and state are made on the
/// stack before they are boxed, and a debug build copies them on the way.
const BUILD_STACK: usize = 256 << 20;

impl<const M: usize, const P: usize, const B: usize> InProcess<M, P, B> {
    fn boxed(spec: &Spec<'_>) -> Result<Box<dyn Board + Send>, ConfigError> {
        let build = || {
            let mut config = Box::new(Config::<M, P, B>::new());
            config.build(spec)?;
            let mut pipeline = Box::new(Pipeline::new());
            pipeline.reset(&config);
            Ok(Box::new(Self { config, pipeline }) as Box<dyn Board + Send>)
        };
        std::thread::scope(|scope| {
            let builder = std::thread::Builder::new().stack_size(BUILD_STACK);
            let thread = builder.spawn_scoped(scope, build).expect("the system starts a thread");
            thread.join().expect("building a configuration does not panic")
        })
    }
}

impl<const M: usize, const P: usize, const B: usize> Board for InProcess<M, P, B> {
    fn reset(&mut self) {
        self.pipeline.reset(&self.config);
    }

    fn frame(&mut self, number: u32, frame: Frame<'_>) -> Result<Report, BoardError> {
        let refused = |source| BoardError::Refused { frame: number, source };
        self.pipeline.begin(&self.config, number);
        match frame {
            Frame::Pixels(pixels) => {
                for row in pixels.chunks(usize::from(self.config.width()).max(1)) {
                    self.pipeline.push_row(&self.config, row).map_err(refused)?;
                }
            }
            Frame::Measurements(measurements) => {
                self.pipeline.push_measurements(&self.config, measurements).map_err(refused)?;
            }
        }
        Ok(self.pipeline.finish(&self.config))
    }

    fn codes(&self) -> &[[u16; 3]] {
        self.pipeline.codes()
    }

    fn measurements(&self) -> &[Measurement] {
        self.pipeline.measurements()
    }

    fn slopes(&self) -> &[Slope] {
        self.pipeline.slopes()
    }

    fn positions(&self) -> &[Position] {
        self.pipeline.positions()
    }

    fn components(&self) -> usize {
        self.config.components()
    }

    fn ulp_m(&self) -> f64 {
        self.config.ulp_m()
    }

    fn totals(&self) -> Totals {
        self.pipeline.totals()
    }
}
