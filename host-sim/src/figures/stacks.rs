use std::path::Path;

use super::FigureError;
use super::axes::{Axes, Layout};
use super::canvas::{Anchor, Area, Canvas, FONT_SIZE, Stroke};
use super::check_size;

/// Width and height of the plotting area of a panel, px.
const SIZE: [f64; 2] = [320.0, 360.0];
/// Width of the legend, right of the panels, and from one entry to the next, px.
const LEGEND: f64 = 130.0;
const LINE: f64 = 20.0;
/// Width of a bar, of the smallest distance between two.
const BAR: f64 = 0.7;
/// Widest bar, px.
const WIDEST: f64 = 44.0;
/// Radius of the mark at the total, and half the width of its bar's ends, px.
const MARK: f64 = 3.0;
const CAP: f64 = 4.0;
const INK: Stroke = Stroke::solid("#111111", 1.4);
/// Around ink that lies on a bar.
const HALO: Stroke = Stroke::solid("#ffffff", 4.0);

/// A term of all stacks.
#[derive(Clone, Copy, Debug)]
pub struct Term<'a> {
    /// In the legend.
    pub name: &'a str,
    /// `#rrggbb`.
    pub colour: &'static str,
    /// Whether the legend has it.
    pub shown: bool,
}

/// Terms that add up to a total.
#[derive(Clone, Debug)]
pub struct Stack {
    /// Where it stands.
    pub x: f64,
    /// One value for each term; what is not finite is left out.
    pub terms: Vec<f64>,
    /// What they add up to.
    pub total: f64,
    /// Its standard error; one that is not finite has no bar.
    pub error: f64,
}

/// One diagram of several.
#[derive(Clone, Debug)]
pub struct StackPanel {
    /// Above it.
    pub title: String,
    /// By increasing x.
    pub stacks: Vec<Stack>,
}

/// Draws panels side by side, all with the same scale along y: terms above zero are stacked upwards from it,
/// terms below downwards, and a ring with an error bar of one standard error marks the total.
///
/// # Errors
/// [`FigureError::Size`] if a stack has not one value for each term, [`FigureError::Io`].
pub fn stacks(
    path: impl AsRef<Path>,
    [x_label, y_label]: [&str; 2],
    panels: &[StackPanel],
    terms: &[Term<'_>],
) -> Result<(), FigureError> {
    let all = || panels.iter().flat_map(|panel| &panel.stacks);
    for stack in all() {
        check_size("stack", terms.len(), stack.terms.len())?;
    }
    let ends = all().flat_map(|stack| {
        let error = if stack.error.is_finite() { stack.error } else { 0.0 };
        let sum = |sign: f64| sign * stack.terms.iter().map(|t| (sign * t).max(0.0)).sum::<f64>();
        [sum(-1.0), sum(1.0), stack.total - error, stack.total + error]
    });
    let (low, high) = ends
        .filter(|end| end.is_finite())
        .fold((0.0, 0.0), |(low, high): (f64, f64), end| (low.min(end), high.max(end)));
    let room = if high > low { 0.04 * (high - low) } else { 1.0 };
    let y = [if low < 0.0 { low - room } else { 0.0 }, high + room];
    let [width, height] = Axes::outer_size(SIZE, false);
    let mut canvas = Canvas::new(width * panels.len().max(1) as f64 + LEGEND, height);
    for (index, panel) in panels.iter().enumerate() {
        let last = panel.stacks.iter().map(|stack| stack.x).fold(1.0, f64::max);
        let gaps = panel.stacks.windows(2).map(|pair| pair[1].x - pair[0].x);
        let gap = gaps.fold(last, f64::min);
        let x = [0.0, last + 0.6 * gap];
        let layout = Layout { title: &panel.title, x_label, y_label, x, y, size: SIZE };
        let mut axes = Axes::on(canvas, [width * index as f64, 0.0], &layout, false);
        let bar = (BAR * gap * SIZE[0] / (x[1] - x[0])).min(WIDEST);
        for stack in &panel.stacks {
            let mut ends = [0.0, 0.0];
            for (&value, term) in stack.terms.iter().zip(terms) {
                if !value.is_finite() || value == 0.0 {
                    continue;
                }
                let end = &mut ends[usize::from(value < 0.0)];
                let (from, to) = (*end, *end + value);
                *end = to;
                let [middle, top] = axes.place(stack.x, from.max(to));
                let [_, bottom] = axes.place(stack.x, from.min(to));
                let left = middle - bar / 2.0;
                let area = Area { left, top, width: bar, height: bottom - top };
                axes.canvas.fill(area, term.colour, 1.0);
            }
            mark(&mut axes, stack);
        }
        let [left, zero] = axes.place(x[0], 0.0);
        axes.canvas.line([left, zero], [left + SIZE[0], zero], Stroke::solid("#222222", 0.8));
        axes.frame();
        canvas = axes.canvas;
    }
    let left = width * panels.len().max(1) as f64;
    // As stacked: the last on top.
    for (line, term) in terms.iter().rev().filter(|term| term.shown).enumerate() {
        let top = 58.0 + LINE * line as f64;
        canvas.fill(Area { left, top, width: 12.0, height: 12.0 }, term.colour, 1.0);
        canvas.text([left + 20.0, top + 0.85 * FONT_SIZE], Anchor::Start, term.name);
    }
    let entries = terms.iter().filter(|term| term.shown).count();
    let top = 58.0 + LINE * entries as f64;
    canvas.circle([left + 6.0, top + 6.0], MARK, INK);
    canvas.text([left + 20.0, top + 0.85 * FONT_SIZE], Anchor::Start, "total");
    canvas.save(path.as_ref())
}

/// A ring at the total, and its error bar.
fn mark(axes: &mut Axes, stack: &Stack) {
    if !stack.total.is_finite() {
        return;
    }
    for stroke in [HALO, INK] {
        axes.canvas.circle(axes.place(stack.x, stack.total), MARK, stroke);
        if stack.error.is_finite() {
            let [middle, low] = axes.place(stack.x, stack.total - stack.error);
            let [_, high] = axes.place(stack.x, stack.total + stack.error);
            axes.canvas.line([middle, low], [middle, high], stroke);
            for end in [low, high] {
                axes.canvas.line([middle - CAP, end], [middle + CAP, end], stroke);
            }
        }
    }
}
