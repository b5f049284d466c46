//! Figures as SVG files: data in, file out.
//!
//! Images are drawn as astronomers show them, **row 0 at the bottom**, y upwards. The pixels are an
//! embedded PNG in which a value is a square of whole pixels, so a figure of a large frame stays
//! small, and sharp in every viewer.
//! Values that are NaN or infinite are left blank, as is what is masked; figures of nothing are
//! empty axes.
//!
//! Colours are viridis where larger means more, and red-white-blue, white at zero, where values
//! have a sign.

mod axes;
mod canvas;
mod colour;
mod detector_frame;
mod error_bars;
mod maps;
mod panels;
mod series;
mod stacks;
mod timeline;

pub use detector_frame::{WindowMark, detector_frame};
pub use error_bars::{Measured, error_bars, error_bars_up_to};
pub use maps::{phase_map, psf, segment_map};
pub use panels::{Curve, Panel, panels};
pub use series::strehl_series;
pub use stacks::{Stack, StackPanel, Term, stacks};
pub use timeline::{Timeline, timeline};

use std::path::PathBuf;

/// Why a figure could not be made.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The file cannot be written.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A slice does not have the length its dimensions ask for.
    #[error("figure: {what} has {found} elements, expected {expected}")]
    Size {
        /// Which slice.
        what: &'static str,
        /// Elements it must have.
        expected: usize,
        /// Elements it has.
        found: usize,
    },
}

fn check_size(what: &'static str, expected: usize, found: usize) -> Result<(), FigureError> {
    if expected == found { Ok(()) } else { Err(FigureError::Size { what, expected, found }) }
}
