use std::path::Path;

use super::axes::{Axes, Layout, Symbol};
use super::canvas::Stroke;
use super::{FigureError, check_size};

/// Width and height of the plotting area, px.
const SIZE: [f64; 2] = [560.0, 380.0];
/// Radius of the mark at a point, and half the width of a bar's ends, px.
const MARK: f64 = 3.0;
const CAP: f64 = 4.0;

/// A curve through measured points.
#[derive(Clone, Debug)]
pub struct Measured {
    /// In the legend.
    pub name: String,
    /// `#rrggbb`.
    pub colour: &'static str,
    /// One value for each x; what is not finite is left out.
    pub y: Vec<f64>,
    /// The standard error of each; one that is not finite has no bar.
    pub error: Vec<f64>,
}

impl Measured {
    /// A line at `y` across `points` places, in grey: what others are compared with.
    pub fn level(name: String, y: f64, points: usize) -> Self {
        Self { name, colour: "#999999", y: vec![y; points], error: vec![f64::NAN; points] }
    }
}

/// Draws curves with error bars of one standard error up and down, y from 0 to 1; x from 0, or from the first point
/// if that is less.
///
/// # Errors
/// [`FigureError::Size`] if a curve has not one value and one error for each x, [`FigureError::Io`].
pub fn error_bars(
    path: impl AsRef<Path>,
    labels: [&str; 2],
    title: &str,
    x: &[f64],
    curves: &[Measured],
) -> Result<(), FigureError> {
    error_bars_up_to(path, labels, title, x, curves, 1.0)
}

/// The same with y from 0 to `top`, points beyond left out.
///
/// # Errors
/// As [`error_bars`].
pub fn error_bars_up_to(
    path: impl AsRef<Path>,
    [x_label, y_label]: [&str; 2],
    title: &str,
    x: &[f64],
    curves: &[Measured],
    top: f64,
) -> Result<(), FigureError> {
    for curve in curves {
        check_size("curve", x.len(), curve.y.len())?;
        check_size("error bars", x.len(), curve.error.len())?;
    }
    let first = x.iter().copied().fold(0.0, f64::min);
    let last = x.iter().copied().fold(1.0, f64::max);
    let layout =
        Layout { title, x_label, y_label, x: [first, 1.05 * last], y: [0.0, top], size: SIZE };
    let mut axes = Axes::with_legend(&layout, curves.iter().map(|curve| curve.name.as_str()));
    for Measured { name, colour, y, error } in curves.iter().rev() {
        let stroke = Stroke::solid(colour, 1.6);
        let drawn = |(_, y): &(&f64, &f64)| y.is_finite() && **y <= top;
        let points: Vec<_> =
            x.iter().zip(y).filter(drawn).map(|(&x, &y)| axes.place(x, y)).collect();
        axes.canvas.curve(&points, stroke);
        for ((&x, &y), &error) in x.iter().zip(y).zip(error).filter(|(point, _)| drawn(point)) {
            axes.canvas.circle(axes.place(x, y), MARK, stroke);
            if error.is_finite() {
                let [middle, low] = axes.place(x, y - error);
                let [_, high] = axes.place(x, y + error);
                axes.canvas.line([middle, low], [middle, high], stroke);
                for end in [low, high] {
                    axes.canvas.line([middle - CAP, end], [middle + CAP, end], stroke);
                }
            }
        }
        axes.legend(&Symbol::Line(stroke), name);
    }
    axes.frame();
    axes.canvas.save(path.as_ref())
}
