//! The library in this process.

use super::{Board, BoardError, Frame};
use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::error::ConfigError;
use splash_firmware::pipeline::{Pipeline, Report, Totals};
use splash_firmware::segments::Position;
use splash_firmware::slopes::Slope;
use splash_firmware::spec::Spec;

/// A configuration and the state of its loop.
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
    Ok(local(spec)?)
}

/// A board here, which can say what one elsewhere has to know.
pub(super) trait Local: Board {
    /// The image of its configuration.
    fn image(&self) -> Vec<u8>;
}

pub(super) fn local(spec: &Spec<'_>) -> Result<Box<dyn Local + Send>, ConfigError> {
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
    fn boxed(spec: &Spec<'_>) -> Result<Box<dyn Local + Send>, ConfigError> {
        let build = || {
            let mut config = Box::new(Config::<M, P, B>::new());
            config.build(spec)?;
            let mut pipeline = Box::new(Pipeline::new());
            pipeline.reset(&config);
            Ok(Box::new(Self { config, pipeline }) as Box<dyn Local + Send>)
        };
        std::thread::scope(|scope| {
            let builder = std::thread::Builder::new().stack_size(BUILD_STACK);
            let thread = builder.spawn_scoped(scope, build).expect("the system starts a thread");
            thread.join().expect("building a configuration does not panic")
        })
    }
}

impl<const M: usize, const P: usize, const B: usize> Local for InProcess<M, P, B> {
    fn image(&self) -> Vec<u8> {
        let mut image = Vec::new();
        self.config.save(&mut |piece| image.extend_from_slice(piece));
        image
    }
}

impl<const M: usize, const P: usize, const B: usize> Board for InProcess<M, P, B> {
    fn reset(&mut self) -> Result<(), BoardError> {
        self.pipeline.reset(&self.config);
        Ok(())
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
