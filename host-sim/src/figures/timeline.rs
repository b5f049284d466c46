use std::path::Path;

use super::FigureError;
use super::axes::{Axes, Layout, Symbol, Tick};

/// Width and height of the plotting area, px.
const SIZE: [f64; 2] = [760.0, 130.0];
/// Height of a bar, of the distance between two.
const BAR: f64 = 0.7;
const READOUT: &str = "#b8c4cc";
const ROWS: &str = "#4477aa";
/// Of the stages after the last row, in turn.
const STAGES: [&str; 5] = ["#66ccee", "#228833", "#ccbb44", "#ee6677", "#aa3377"];

/// One frame on a board, times in us.
#[derive(Clone, Copy, Debug)]
pub struct Timeline<'a> {
    /// Above the figure.
    pub title: &'a str,
    /// From the first pixel to the last.
    pub readout_us: f64,
    /// Before the first row.
    pub begin_us: f64,
    /// Each block of rows; they take equal parts of the readout.
    pub blocks_us: &'a [f64],
    /// Each stage after the last row.
    pub tail_us: &'a [(&'a str, f64); 5],
}

/// Draws when the detector is read and when the processor works: a block of rows is done when it is
/// there and what came before is done, the stages after the last row one after the other.
///
/// # Errors
/// [`FigureError::Io`].
pub fn timeline(path: impl AsRef<Path>, frame: &Timeline<'_>) -> Result<(), FigureError> {
    let blocks = frame.blocks_us.len();
    let arrival = |k: usize| frame.readout_us * k as f64 / blocks.max(1) as f64;
    // Lane from the bottom up, start, length and colour.
    let mut bars = Vec::new();
    let mut now = 0.0;
    let mut run = |from: f64, length: f64, colour, bars: &mut Vec<_>| {
        let start = f64::max(now, from);
        bars.push((0, start, length, colour));
        now = start + length;
    };
    run(0.0, frame.begin_us, ROWS, &mut bars);
    for (k, &length) in frame.blocks_us.iter().enumerate() {
        bars.push((1, arrival(k), arrival(k + 1) - arrival(k), READOUT));
        run(arrival(k + 1), length, ROWS, &mut bars);
    }
    for (&(_, length), colour) in frame.tail_us.iter().zip(STAGES) {
        run(frame.readout_us, length, colour, &mut bars);
    }
    let end = f64::max(now, frame.readout_us).max(f64::MIN_POSITIVE);
    let mut axes = Axes::new(
        &Layout {
            title: frame.title,
            x_label: "time (us)",
            y_label: "",
            x: [0.0, 1.02 * end],
            y: [-0.5, 1.5],
            size: SIZE,
        },
        false,
    );
    for (lane, start, length, colour) in bars {
        let lane = f64::from(lane);
        let low = [start, lane - BAR / 2.0];
        let area = axes.area_between(low, [start + length, lane + BAR / 2.0]);
        axes.canvas.fill(area, colour, 1.0);
    }
    for (&(name, _), colour) in frame.tail_us.iter().zip(STAGES).rev() {
        axes.legend(&Symbol::Patch(colour, 1.0), name);
    }
    axes.legend(&Symbol::Patch(ROWS, 1.0), "rows");
    axes.legend(&Symbol::Patch(READOUT, 1.0), "readout");
    let lanes = [(0.0, "processor"), (1.0, "detector")];
    axes.frame_with(&lanes.map(|(value, label)| Tick { value, label: label.into() }));
    axes.canvas.save(path.as_ref())
}
