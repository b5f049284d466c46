use std::path::Path;

use super::axes::{Axes, Layout, Symbol};
use super::canvas::Stroke;
use super::colour::ColourScale;
use super::{FigureError, check_size};

/// Side of the plotting area, px.
const SIDE: f64 = 440.0;
/// Decades of intensity that a point-spread function is shown over.
const PSF_DECADES: i32 = 4;
const HALF_MAXIMUM: Stroke = Stroke::dashed("#ff2a2a", 1.2);

/// A square image to be drawn: what the three kinds of map have in common.
struct SquareMap<'a> {
    title: &'a str,
    labels: [&'a str; 2],
    /// First and last coordinate, of both axes.
    range: [f64; 2],
    side: usize,
    scale: ColourScale,
    unit: &'a str,
}

impl SquareMap<'_> {
    fn draw(&self, path: &Path, value: impl Fn(usize) -> Option<f64>) -> Result<Axes, FigureError> {
        let layout = Layout {
            title: self.title,
            x_label: self.labels[0],
            y_label: self.labels[1],
            x: self.range,
            y: self.range,
            size: [SIDE; 2],
        };
        let mut axes = Axes::new(&layout, true);
        axes.image(self.side, self.side, value, &self.scale, self.unit)
            .map_err(|source| FigureError::Io { file: path.to_path_buf(), source })?;
        Ok(axes)
    }
}

/// First and last coordinate of a side; at least as far apart as a pixel, even if there is none.
fn range(first: f64, side: usize, pixel: f64) -> [f64; 2] {
    let pixel = if pixel.is_finite() && pixel > 0.0 { pixel } else { 1.0 };
    [first * pixel, (first + side.max(1) as f64) * pixel]
}

/// Draws one value per segment of the mirror, `across` x `across`, row-major, row 0 at the bottom;
/// `None` where the pupil has no segment. Colours are symmetric about zero.
///
/// `label` names the quantity and its unit, such as `piston (nm)`.
///
/// # Errors
/// [`FigureError::Size`] if `values` does not have `across` x `across` elements,
/// [`FigureError::Io`].
pub fn segment_map(
    path: impl AsRef<Path>,
    values: &[Option<f64>],
    across: usize,
    label: &str,
    title: &str,
) -> Result<(), FigureError> {
    let path = path.as_ref();
    check_size("segments", across * across, values.len())?;
    let map = SquareMap {
        title,
        labels: ["segment column", "segment row"],
        range: range(-0.5, across, 1.0),
        side: across,
        scale: ColourScale::diverging(values.iter().flatten().copied()),
        unit: label,
    };
    let mut axes = map.draw(path, |index| values[index])?;
    axes.frame();
    axes.canvas.save(path)
}

/// Draws a phase in radians over the pupil, `side` x `side`, row-major, row 0 at the bottom.
///
/// `inside` tells which points belong to the pupil; the others are left blank. `extent_m` is the
/// side of the square, m; its centre is the origin of the axes.
///
/// # Errors
/// [`FigureError::Size`] if `phase` or `inside` does not have `side` x `side` elements,
/// [`FigureError::Io`].
pub fn phase_map(
    path: impl AsRef<Path>,
    phase: &[f32],
    side: usize,
    inside: &[bool],
    extent_m: f64,
    title: &str,
) -> Result<(), FigureError> {
    let path = path.as_ref();
    check_size("phase", side * side, phase.len())?;
    check_size("pupil", side * side, inside.len())?;
    let value = |index: usize| inside[index].then(|| f64::from(phase[index]));
    let map = SquareMap {
        title,
        labels: ["x (m)", "y (m)"],
        range: range(-0.5 * side.max(1) as f64, side, extent_m / side as f64),
        side,
        scale: ColourScale::diverging((0..phase.len()).filter_map(value)),
        unit: "phase (rad)",
    };
    let mut axes = map.draw(path, value)?;
    axes.frame();
    axes.canvas.save(path)
}

/// Draws a point-spread function relative to its maximum over four decades, `side` x `side`,
/// row-major, row 0 at the bottom, with a circle of its full width at half maximum.
///
/// Pixels are `arcsec_per_px` wide; the origin of the axes is the centre of pixel
/// (side / 2, side / 2). The width is the diameter of a disc with the area of the pixels at or
/// above half the maximum.
///
/// # Errors
/// [`FigureError::Size`] if `psf` does not have `side` x `side` elements, [`FigureError::Io`].
pub fn psf(
    path: impl AsRef<Path>,
    psf: &[f32],
    side: usize,
    arcsec_per_px: f64,
    title: &str,
) -> Result<(), FigureError> {
    let path = path.as_ref();
    check_size("point-spread function", side * side, psf.len())?;
    let peak = psf.iter().copied().filter(|value| value.is_finite()).fold(0.0, f32::max);
    let map = SquareMap {
        title,
        labels: ["x (arcsec)", "y (arcsec)"],
        range: range(-((side / 2) as f64) - 0.5, side, arcsec_per_px),
        side,
        scale: ColourScale::decades(PSF_DECADES),
        unit: "intensity relative to peak",
    };
    // Without light, nothing has a relative intensity.
    let relative = |index: usize| (peak > 0.0).then(|| f64::from(psf[index] / peak));
    let mut axes = map.draw(path, relative)?;

    let bright: Vec<usize> =
        (0..psf.len()).filter(|&index| relative(index).is_some_and(|value| value >= 0.5)).collect();
    if !bright.is_empty() {
        let count = bright.len() as f64;
        let mean = |coordinate: fn(usize, usize) -> usize| {
            let sum: usize = bright.iter().map(|&index| coordinate(index, side)).sum();
            sum as f64 / count - (side / 2) as f64
        };
        let pixel = (map.range[1] - map.range[0]) / side as f64;
        let (x, y) = (mean(|i, side| i % side) * pixel, mean(|i, side| i / side) * pixel);
        let width = (4.0 * count / std::f64::consts::PI).sqrt() * pixel;
        let centre = axes.place(x, y);
        let radius = axes.place(x + width / 2.0, y)[0] - centre[0];
        axes.canvas.circle(centre, radius, HALF_MAXIMUM);
        axes.legend(&Symbol::Circle(HALF_MAXIMUM), &format!("FWHM {width:.3} arcsec"));
    }
    axes.frame();
    axes.canvas.save(path)
}
