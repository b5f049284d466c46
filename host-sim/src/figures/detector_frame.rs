use std::path::Path;

use super::axes::{Axes, Layout, Symbol};
use super::canvas::Stroke;
use super::colour::{ColourScale, Stretch};
use super::{FigureError, check_size};

/// The longer side of the plotting area, px.
const SIDE: f64 = 560.0;
const WINDOW: Stroke = Stroke::solid("#bbbbbb", 0.6);
const INVALID: Stroke = Stroke::dashed("#ff8c1a", 1.2);
const CENTROID: Stroke = Stroke::solid("#ff2a2a", 1.3);

/// A subaperture's window, to be drawn over a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowMark {
    /// First column, px.
    pub x0: usize,
    /// First row, px.
    pub y0: usize,
    /// Side, px.
    pub size: usize,
    /// Centroid in detector coordinates (column, row; pixel centres at whole numbers), px.
    pub centroid: Option<[f64; 2]>,
    /// Whether the subaperture was used.
    pub valid: bool,
}

/// Draws a detector frame in ADU, stretched by square root, with windows and centroids over it.
///
/// `pixels` is row-major, `height` x `width`; axes are in pixels, row 0 at the bottom.
///
/// # Errors
/// [`FigureError::Size`] if `pixels` does not have `width` x `height` elements, [`FigureError::Io`].
pub fn detector_frame(
    path: impl AsRef<Path>,
    pixels: &[u16],
    width: usize,
    height: usize,
    windows: &[WindowMark],
    title: &str,
) -> Result<(), FigureError> {
    let path = path.as_ref();
    check_size("frame", width * height, pixels.len())?;
    let longer = width.max(height).max(1) as f64;
    // A frame without pixels still gets axes, one pixel wide.
    let sides = [width, height].map(|side| side.max(1) as f64);
    let mut axes = Axes::new(
        &Layout {
            title,
            x_label: "column (px)",
            y_label: "row (px)",
            x: [-0.5, sides[0] - 0.5],
            y: [-0.5, sides[1] - 0.5],
            size: sides.map(|side| side / longer * SIDE),
        },
        true,
    );
    let values = pixels.iter().map(|&pixel| f64::from(pixel));
    let scale = ColourScale::sequential(values, Stretch::Sqrt);
    axes.image(width, height, |index| Some(f64::from(pixels[index])), &scale, "signal (ADU)")
        .map_err(|source| FigureError::Io { file: path.to_path_buf(), source })?;

    // Invalid windows last: neighbours share their edges.
    for valid in [true, false] {
        for window in windows.iter().filter(|window| window.valid == valid) {
            let low = [window.x0, window.y0].map(|first| first as f64 - 0.5);
            let high = low.map(|first| first + window.size as f64);
            let area = axes.area_between(low, high);
            axes.canvas.outline(area, if valid { WINDOW } else { INVALID });
        }
    }
    for [x, y] in windows.iter().filter_map(|window| window.centroid) {
        if x.is_finite() && y.is_finite() {
            let point = axes.place(x, y);
            axes.cross(point, CENTROID);
        }
    }
    if windows.iter().any(|window| !window.valid) {
        axes.legend(&Symbol::Outline(INVALID), "invalid");
    }
    if windows.iter().any(|window| window.centroid.is_some()) {
        axes.legend(&Symbol::Cross(CENTROID), "centroid");
    }
    if windows.iter().any(|window| window.valid) {
        axes.legend(&Symbol::Outline(WINDOW), "window");
    }
    axes.frame();
    axes.canvas.save(path)
}
