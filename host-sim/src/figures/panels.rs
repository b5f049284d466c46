use std::path::Path;

use super::FigureError;
use super::axes::{Axes, Layout, Symbol};
use super::canvas::{Canvas, Stroke};
use super::check_size;

/// Width and height of the plotting area of a panel, px.
const SIZE: [f64; 2] = [440.0, 320.0];
/// Panels beside one another, before the next row.
const BESIDE: usize = 3;
/// Radius of the mark at a point, px.
const MARK: f64 = 2.0;

/// A curve through points.
#[derive(Clone, Debug)]
pub struct Curve<'a> {
    /// In the legend.
    pub name: &'a str,
    /// `#rrggbb`.
    pub colour: &'static str,
    /// Broken instead of solid.
    pub broken: bool,
    /// One value for each x.
    pub y: &'a [f64],
}

/// One diagram of several.
#[derive(Clone, Debug)]
pub struct Panel<'a> {
    /// Above it.
    pub title: String,
    /// Where the points are, increasing.
    pub x: Vec<f64>,
    /// What is drawn, the first on top.
    pub curves: Vec<Curve<'a>>,
}

/// Draws panels side by side, three in a row, all with y from 0 to 1, or to the largest value if
/// that is more.
///
/// # Errors
/// [`FigureError::Size`] if a curve has not one value for each x, [`FigureError::Io`].
pub fn panels(
    path: impl AsRef<Path>,
    x_label: &str,
    y_label: &str,
    panels: &[Panel<'_>],
) -> Result<(), FigureError> {
    for panel in panels {
        for curve in &panel.curves {
            check_size("curve", panel.x.len(), curve.y.len())?;
        }
    }
    let values = panels.iter().flat_map(|panel| &panel.curves).flat_map(|curve| curve.y);
    let largest = values.copied().filter(|y| y.is_finite()).fold(1.0, f64::max);
    let limits = |panel: &Panel<'_>| {
        let first = panel.x.first().copied().unwrap_or(0.0);
        let last = panel.x.last().copied().unwrap_or(1.0);
        // A hair of room for the marks at the ends.
        ([first - 0.2, last + 0.2], [0.0, 1.03 * largest])
    };
    let columns = panels.len().clamp(1, BESIDE);
    let rows = panels.len().div_ceil(BESIDE).max(1);
    let [width, height] = Axes::outer_size(SIZE, false);
    let mut canvas = Canvas::new(width * columns as f64, height * rows as f64);
    for (index, panel) in panels.iter().enumerate() {
        let corner = [width * (index % BESIDE) as f64, height * (index / BESIDE) as f64];
        let (x, y) = limits(panel);
        let layout = Layout { title: &panel.title, x_label, y_label, x, y, size: SIZE };
        let mut axes = Axes::on(canvas, corner, &layout, false);
        for Curve { name, colour, broken, y } in panel.curves.iter().rev() {
            let stroke = if *broken { Stroke::dashed } else { Stroke::solid }(colour, 1.6);
            let points: Vec<_> = panel.x.iter().zip(*y).map(|(&x, &y)| axes.place(x, y)).collect();
            axes.canvas.curve(&points, stroke);
            for &point in points.iter().filter(|[_, y]| y.is_finite()) {
                axes.canvas.circle(point, MARK, Stroke::solid(colour, 1.6));
            }
            axes.legend(&Symbol::Line(stroke), name);
        }
        axes.frame();
        canvas = axes.canvas;
    }
    canvas.save(path.as_ref())
}
