use std::path::Path;

use super::axes::{Axes, Layout, Symbol};
use super::canvas::{Area, Stroke};
use super::{FigureError, check_size};

/// Width and height of the plotting area, px.
const SIZE: [f64; 2] = [640.0, 320.0];
/// Points that a curve may have: more than the area has pixels are not seen.
const MOST_POINTS: usize = 1280;
const INSTANTANEOUS: Stroke = Stroke::solid("#7aa6c2", 1.0);
const LONG_EXPOSURE: Stroke = Stroke::solid("#b3261e", 1.8);
const SETTLING: (&str, f64) = ("#000000", 0.08);

/// Draws the Strehl ratio over time: per frame, and of the exposure so far.
///
/// The three slices have one element per frame, times in s and increasing. The first `settle_s`
/// seconds, which averages leave out, are shaded. Long series are thinned to the smallest and the
/// largest value of each stretch, so that no peak is lost.
///
/// # Errors
/// [`FigureError::Size`] if the slices differ in length, [`FigureError::Io`].
pub fn strehl_series(
    path: impl AsRef<Path>,
    time_s: &[f64],
    instantaneous: &[f64],
    long_exposure: &[f64],
    settle_s: f64,
    title: &str,
) -> Result<(), FigureError> {
    check_size("instantaneous Strehl ratio", time_s.len(), instantaneous.len())?;
    check_size("long-exposure Strehl ratio", time_s.len(), long_exposure.len())?;
    let ends = |pick: fn(f64, f64) -> f64| {
        time_s.iter().copied().filter(|time| time.is_finite()).reduce(pick)
    };
    let (start, end) = (ends(f64::min).unwrap_or(0.0), ends(f64::max).unwrap_or(1.0));
    let end = if end > start { end } else { start + 1.0 };
    let mut axes = Axes::new(
        &Layout {
            title,
            x_label: "time (s)",
            y_label: "Strehl ratio",
            x: [start, end],
            y: [0.0, 1.0],
            size: SIZE,
        },
        false,
    );
    let settled = settle_s.min(end);
    let shaded = settled > start;
    if shaded {
        let Area { top, height, .. } = axes.area;
        let area = Area { top, height, ..axes.area_between([start, 0.0], [settled, 1.0]) };
        axes.canvas.fill(area, SETTLING.0, SETTLING.1);
    }
    for (values, stroke) in [(instantaneous, INSTANTANEOUS), (long_exposure, LONG_EXPOSURE)] {
        let points: Vec<[f64; 2]> = thinned(time_s, values)
            .into_iter()
            .map(|[time, value]| axes.place(time, value))
            .collect();
        axes.canvas.curve(&points, stroke);
    }
    if shaded {
        axes.legend(&Symbol::Patch(SETTLING.0, SETTLING.1), "settling");
    }
    axes.legend(&Symbol::Line(LONG_EXPOSURE), "long exposure");
    axes.legend(&Symbol::Line(INSTANTANEOUS), "instantaneous");
    axes.frame();
    axes.canvas.save(path.as_ref())
}

/// The points of a curve, or of each stretch of it the two extremes in their order.
fn thinned(times: &[f64], values: &[f64]) -> Vec<[f64; 2]> {
    let point = |index: usize| [times[index], values[index]];
    let indices: Vec<usize> = (0..times.len()).collect();
    if indices.len() <= MOST_POINTS {
        return indices.into_iter().map(point).collect();
    }
    let stretch = indices.len().div_ceil(MOST_POINTS / 2);
    let extremes = |indices: &[usize]| {
        let finite = || indices.iter().copied().filter(|&index| values[index].is_finite());
        let by_value = |a: &usize, b: &usize| values[*a].total_cmp(&values[*b]);
        match (finite().min_by(by_value), finite().max_by(by_value)) {
            (Some(low), Some(high)) => [low.min(high), low.max(high)],
            // Nothing finite: any point of the stretch breaks the curve.
            _ => [indices[0]; 2],
        }
    };
    indices.chunks(stretch).flat_map(extremes).map(point).collect()
}
