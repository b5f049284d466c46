//! A plotting area with its axes, title, legend and colour bar.

use super::canvas::{Anchor, Area, Canvas, FONT_SIZE, Stroke};
use super::colour::ColourScale;

const INK: Stroke = Stroke::solid("#222222", 1.0);
/// Shown where an image has no value.
const NO_VALUE: &str = "#c8c8c8";
const LEFT_MARGIN: f64 = 72.0;
const TOP_MARGIN: f64 = 58.0;
const BOTTOM_MARGIN: f64 = 54.0;
const RIGHT_MARGIN: f64 = 24.0;
const COLOUR_BAR_MARGIN: f64 = 112.0;
const COLOUR_BAR_STEPS: usize = 256;
const COLOUR_BAR_COLUMNS: usize = 16;
/// Width of an average character.
const CHARACTER: f64 = 0.58 * FONT_SIZE;
/// Height of a row of the legend, width of an entry's symbol, and between two entries.
const LEGEND_ROW: f64 = 18.0;
const SYMBOL: f64 = 26.0;
const LEGEND_GAP: f64 = 12.0;

/// A value on an axis and how it is written.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) label: String,
}

/// What a figure shows, before the data.
pub(super) struct Layout<'a> {
    pub(super) title: &'a str,
    pub(super) x_label: &'a str,
    pub(super) y_label: &'a str,
    /// First and last x.
    pub(super) x: [f64; 2],
    /// First and last y, from the bottom up.
    pub(super) y: [f64; 2],
    /// Width and height of the plotting area, px.
    pub(super) size: [f64; 2],
}

/// A figure with a coordinate system.
pub(super) struct Axes {
    pub(super) canvas: Canvas,
    pub(super) area: Area,
    x: [f64; 2],
    y: [f64; 2],
    /// Where the next entry of the legend ends, and rows below it.
    legend_end: f64,
    legend_row: usize,
}

/// Where the text of the legend's next entry starts; one that does not fit begins another row.
fn legend_start(end: &mut f64, row: &mut usize, [left, right]: [f64; 2], text: &str) -> f64 {
    let width = text.chars().count() as f64 * CHARACTER;
    if *end - width - SYMBOL < left && *end < right {
        (*end, *row) = (right, *row + 1);
    }
    *end - width
}

/// What stands before an entry of the legend.
pub(super) enum Symbol {
    Line(Stroke),
    Outline(Stroke),
    Cross(Stroke),
    Circle(Stroke),
    Patch(&'static str, f64),
}

impl Axes {
    /// Lays out a figure; data are drawn next, [`Axes::frame`] last, over them.
    pub(super) fn new(layout: &Layout, colour_bar: bool) -> Self {
        let [width, height] = Self::outer_size(layout.size, colour_bar);
        Self::on(Canvas::new(width, height), [0.0, 0.0], layout, colour_bar)
    }

    /// Lays out one panel of a figure, its top left corner at `corner` of the canvas.
    pub(super) fn on(
        mut canvas: Canvas,
        corner: [f64; 2],
        layout: &Layout,
        colour_bar: bool,
    ) -> Self {
        let [width, height] = layout.size;
        let (left, top) = (corner[0] + LEFT_MARGIN, corner[1] + TOP_MARGIN);
        let area = Area { left, top, width, height };
        let bottom = corner[1] + Self::outer_size(layout.size, colour_bar)[1];
        canvas.text([left, corner[1] + 24.0], Anchor::Start, layout.title);
        let middle = [left + width / 2.0, top + height / 2.0];
        canvas.text([middle[0], bottom - 14.0], Anchor::Middle, layout.x_label);
        canvas.text_upwards([corner[0] + 20.0, middle[1]], layout.y_label);
        let legend_end = left + width;
        Self { canvas, area, x: layout.x, y: layout.y, legend_end, legend_row: 0 }
    }

    /// The same as [`Axes::new`] with room for a legend of all these texts, in rows.
    pub(super) fn with_legend<'a>(
        layout: &Layout,
        texts: impl DoubleEndedIterator<Item = &'a str>,
    ) -> Self {
        let width = layout.size[0];
        let (mut end, mut rows) = (width, 0);
        for text in texts.rev() {
            let start = legend_start(&mut end, &mut rows, [0.0, width], text);
            end = start - SYMBOL - LEGEND_GAP;
        }
        let above = rows as f64 * LEGEND_ROW;
        let [width, height] = Self::outer_size(layout.size, false);
        let mut canvas = Canvas::new(width, height + above);
        canvas.text([LEFT_MARGIN, 24.0], Anchor::Start, layout.title);
        Self::on(canvas, [0.0, above], &Layout { title: "", ..*layout }, false)
    }

    /// Width and height with everything around the plotting area, px.
    pub(super) fn outer_size([width, height]: [f64; 2], colour_bar: bool) -> [f64; 2] {
        let right_margin = if colour_bar { COLOUR_BAR_MARGIN } else { RIGHT_MARGIN };
        [LEFT_MARGIN + width + right_margin, TOP_MARGIN + height + BOTTOM_MARGIN]
    }

    /// Where a point lies on the canvas.
    pub(super) fn place(&self, x: f64, y: f64) -> [f64; 2] {
        let across = (x - self.x[0]) / (self.x[1] - self.x[0]);
        let up = (y - self.y[0]) / (self.y[1] - self.y[0]);
        let Area { left, top, width, height } = self.area;
        [left + across * width, top + (1.0 - up) * height]
    }

    /// The area between two corners.
    pub(super) fn area_between(&self, low: [f64; 2], high: [f64; 2]) -> Area {
        let [left, bottom] = self.place(low[0], low[1]);
        let [right, top] = self.place(high[0], high[1]);
        Area { left, top, width: right - left, height: bottom - top }
    }

    /// Fills the plotting area with an image, row 0 at the bottom, and draws its colour bar.
    pub(super) fn image(
        &mut self,
        columns: usize,
        rows: usize,
        value: impl Fn(usize) -> Option<f64>,
        scale: &ColourScale,
        unit: &str,
    ) -> std::io::Result<()> {
        self.canvas.fill(self.area, NO_VALUE, 1.0);
        if columns > 0 && rows > 0 {
            // Some converters smooth what they enlarge: leave them nothing to enlarge.
            let repeat = (self.area.width / columns as f64).ceil() as usize;
            let colours: Vec<[u8; 4]> =
                (0..rows * columns).map(|index| scale.rgba(value(index))).collect();
            let rgba: Vec<u8> = (0..rows * repeat)
                .rev()
                .flat_map(|y| (0..columns * repeat).map(move |x| (x / repeat, y / repeat)))
                .flat_map(|(x, y)| colours[y * columns + x])
                .collect();
            self.canvas.pixels(self.area, "data", columns * repeat, &rgba)?;
        }
        self.colour_bar(scale, unit)
    }

    fn colour_bar(&mut self, scale: &ColourScale, unit: &str) -> std::io::Result<()> {
        let Area { left, top, width, height } = self.area;
        let bar = Area { left: left + width + 16.0, width: COLOUR_BAR_COLUMNS as f64, ..self.area };
        let colours: Vec<u8> = (0..COLOUR_BAR_STEPS)
            .rev()
            .map(|step| scale.at(step as f64 / (COLOUR_BAR_STEPS - 1) as f64))
            .flat_map(|colour| colour.repeat(COLOUR_BAR_COLUMNS))
            .collect();
        self.canvas.pixels(bar, "colour-bar", COLOUR_BAR_COLUMNS, &colours)?;
        self.canvas.outline(bar, INK);
        let right = bar.left + bar.width;
        for tick in scale.ticks() {
            let y = top + (1.0 - scale.position(tick.value)) * height;
            self.canvas.line([right, y], [right + 4.0, y], INK);
            self.canvas.text([right + 7.0, y + 0.35 * FONT_SIZE], Anchor::Start, &tick.label);
        }
        let middle = top + height / 2.0;
        self.canvas.text_upwards([left + width + COLOUR_BAR_MARGIN - 10.0, middle], unit);
        Ok(())
    }

    /// Adds an entry to the legend above the plotting area, left of those before, or above them.
    pub(super) fn legend(&mut self, symbol: &Symbol, text: &str) {
        let sides = [self.area.left, self.area.left + self.area.width];
        let start = legend_start(&mut self.legend_end, &mut self.legend_row, sides, text);
        let y = self.area.top - 14.0 - self.legend_row as f64 * LEGEND_ROW;
        self.canvas.text([start, y + 0.35 * FONT_SIZE], Anchor::Start, text);
        let (left, right) = (start - SYMBOL, start - 6.0);
        let middle = (left + right) / 2.0;
        let square = Area { left: middle - 6.0, top: y - 6.0, width: 12.0, height: 12.0 };
        match *symbol {
            Symbol::Line(stroke) => self.canvas.line([left, y], [right, y], stroke),
            Symbol::Outline(stroke) => self.canvas.outline(square, stroke),
            Symbol::Cross(stroke) => self.cross([middle, y], stroke),
            Symbol::Circle(stroke) => self.canvas.circle([middle, y], 6.0, stroke),
            Symbol::Patch(colour, opacity) => self.canvas.fill(square, colour, opacity),
        }
        self.legend_end = left - LEGEND_GAP;
    }

    /// A small cross at a point of the canvas.
    pub(super) fn cross(&mut self, [x, y]: [f64; 2], stroke: Stroke) {
        const ARM: f64 = 3.5;
        self.canvas.line([x - ARM, y], [x + ARM, y], stroke);
        self.canvas.line([x, y - ARM], [x, y + ARM], stroke);
    }

    /// Draws the frame and its ticks.
    pub(super) fn frame(&mut self) {
        self.frame_with(&linear_ticks(self.y[0], self.y[1], 9));
    }

    /// Draws the frame with these ticks along y.
    pub(super) fn frame_with(&mut self, y_ticks: &[Tick]) {
        self.canvas.outline(self.area, INK);
        let [left, bottom] = self.place(self.x[0], self.y[0]);
        for tick in linear_ticks(self.x[0], self.x[1], 9) {
            let [x, _] = self.place(tick.value, self.y[0]);
            self.canvas.line([x, bottom], [x, bottom + 4.0], INK);
            self.canvas.text([x, bottom + 18.0], Anchor::Middle, &tick.label);
        }
        for tick in y_ticks {
            let [_, y] = self.place(self.x[0], tick.value);
            self.canvas.line([left - 4.0, y], [left, y], INK);
            self.canvas.text([left - 7.0, y + 0.35 * FONT_SIZE], Anchor::End, &tick.label);
        }
    }
}

/// At most `most` round values from `low` to `high`: multiples of 1, 2 or 5 times a power of ten.
pub(super) fn linear_ticks(low: f64, high: f64, most: usize) -> Vec<Tick> {
    let span = high - low;
    if !span.is_finite() || span <= 0.0 {
        return Vec::new();
    }
    let rough = span / most as f64;
    let decade = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * decade).into_iter().find(|&step| step >= rough);
    let step = step.unwrap_or(10.0 * decade);
    // A hair beyond the ends: an end that is a multiple of the step gets its tick.
    let first = (low / step - 1e-6).ceil() as i64;
    let last = (high / step + 1e-6).floor() as i64;
    let largest = low.abs().max(high.abs());
    let scientific = !(1e-3..1e6).contains(&largest);
    let decimals = (-step.log10().floor()).max(0.0) as usize;
    (first..=last)
        .map(|multiple| {
            let value = multiple as f64 * step;
            let label = match (multiple, scientific) {
                (0, _) => "0".into(),
                (_, true) => format!("{value:.1e}"),
                (_, false) => format!("{value:.decimals$}"),
            };
            Tick { value, label: label.replace('-', "\u{2212}") }
        })
        .collect()
}
