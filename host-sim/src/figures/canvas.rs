//! The drawing surface: a few shapes, text and embedded pixels, written as SVG.

use std::path::Path;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use svg::Document;
use svg::node::element::{Circle, Image, Line, Path as Curve, Rectangle, Text};

use super::FigureError;

pub(super) const FONT_SIZE: f64 = 13.0;

/// A figure being drawn; x to the right, y downwards, in SVG user units ("px").
pub(super) struct Canvas {
    document: Document,
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stroke {
    pub(super) colour: &'static str,
    pub(super) width: f64,
    pub(super) dashed: bool,
}

impl Stroke {
    pub(super) const fn solid(colour: &'static str, width: f64) -> Self {
        Self { colour, width, dashed: false }
    }

    pub(super) const fn dashed(colour: &'static str, width: f64) -> Self {
        Self { colour, width, dashed: true }
    }

    fn dashes(self) -> &'static str {
        if self.dashed { "4 3" } else { "none" }
    }
}

/// Where a text stands relative to its point.
#[derive(Debug, Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// A rectangle by its left, top, width and height.
#[derive(Debug, Clone, Copy)]
pub(super) struct Area {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Canvas {
    pub(super) fn new(width: f64, height: f64) -> Self {
        let whole = Area { left: 0.0, top: 0.0, width, height };
        let document = Document::new()
            .set("width", width)
            .set("height", height)
            .set("viewBox", (0.0, 0.0, width, height))
            .set("font-family", "DejaVu Sans, Helvetica, Arial, sans-serif")
            .set("font-size", FONT_SIZE);
        let mut canvas = Self { document };
        canvas.fill(whole, "white", 1.0);
        canvas
    }

    fn add(&mut self, node: impl Into<Box<dyn svg::Node>>) {
        svg::Node::append(&mut self.document, node);
    }

    pub(super) fn fill(&mut self, area: Area, colour: &str, opacity: f64) {
        self.add(rectangle(area).set("fill", colour).set("fill-opacity", opacity));
    }

    pub(super) fn outline(&mut self, area: Area, stroke: Stroke) {
        let outline = rectangle(area).set("fill", "none").set("stroke", stroke.colour);
        self.add(
            outline.set("stroke-width", stroke.width).set("stroke-dasharray", stroke.dashes()),
        );
    }

    pub(super) fn line(&mut self, from: [f64; 2], to: [f64; 2], stroke: Stroke) {
        let line = Line::new()
            .set("x1", round(from[0]))
            .set("y1", round(from[1]))
            .set("x2", round(to[0]))
            .set("y2", round(to[1]));
        self.add(
            line.set("stroke", stroke.colour)
                .set("stroke-width", stroke.width)
                .set("stroke-dasharray", stroke.dashes()),
        );
    }

    pub(super) fn circle(&mut self, centre: [f64; 2], radius: f64, stroke: Stroke) {
        let circle = Circle::new()
            .set("cx", round(centre[0]))
            .set("cy", round(centre[1]))
            .set("r", round(radius))
            .set("fill", "none");
        self.add(
            circle
                .set("stroke", stroke.colour)
                .set("stroke-width", stroke.width)
                .set("stroke-dasharray", stroke.dashes()),
        );
    }

    /// A line through points; a NaN breaks it.
    pub(super) fn curve(&mut self, points: &[[f64; 2]], stroke: Stroke) {
        let mut data = String::new();
        let mut joined = false;
        for point in points {
            if point.iter().all(|coordinate| coordinate.is_finite()) {
                let command = if joined { 'L' } else { 'M' };
                data += &format!("{command}{},{} ", round(point[0]), round(point[1]));
                joined = true;
            } else {
                joined = false;
            }
        }
        if !data.is_empty() {
            let curve = Curve::new().set("d", data.trim_end()).set("fill", "none");
            self.add(
                curve
                    .set("stroke", stroke.colour)
                    .set("stroke-width", stroke.width)
                    .set("stroke-dasharray", stroke.dashes())
                    .set("stroke-linejoin", "round"),
            );
        }
    }

    pub(super) fn text(&mut self, at: [f64; 2], anchor: Anchor, text: &str) {
        self.add(label(at, anchor, text));
    }

    /// Text that reads upwards, centred on its point.
    pub(super) fn text_upwards(&mut self, at: [f64; 2], text: &str) {
        let turn = format!("rotate(-90 {} {})", round(at[0]), round(at[1]));
        self.add(label(at, Anchor::Middle, text).set("transform", turn));
    }

    /// Embeds RGBA pixels, row-major from the top left, stretched over the area without smoothing.
    pub(super) fn pixels(
        &mut self,
        area: Area,
        id: &str,
        columns: usize,
        rgba: &[u8],
    ) -> Result<(), std::io::Error> {
        let rows = rgba.len() / 4 / columns;
        let mut png = Vec::new();
        // Sides come from slices in memory and fit.
        let mut encoder = png::Encoder::new(&mut png, columns as u32, rows as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(rgba)?;
        let image = Image::new()
            .set("id", id)
            .set("x", round(area.left))
            .set("y", round(area.top))
            .set("width", round(area.width))
            .set("height", round(area.height))
            .set("preserveAspectRatio", "none")
            .set("href", format!("data:image/png;base64,{}", BASE64_STANDARD.encode(&png)));
        // Browsers know the property, older converters only the attribute's value.
        self.add(
            image.set("image-rendering", "optimizeSpeed").set("style", "image-rendering:pixelated"),
        );
        Ok(())
    }

    pub(super) fn save(self, path: &Path) -> Result<(), FigureError> {
        svg::save(path, &self.document)
            .map_err(|source| FigureError::Io { file: path.to_path_buf(), source })
    }
}

fn rectangle(area: Area) -> Rectangle {
    Rectangle::new()
        .set("x", round(area.left))
        .set("y", round(area.top))
        .set("width", round(area.width))
        .set("height", round(area.height))
}

fn label(at: [f64; 2], anchor: Anchor, text: &str) -> Text {
    let anchor = match anchor {
        Anchor::Start => "start",
        Anchor::Middle => "middle",
        Anchor::End => "end",
    };
    // XML has no place for control characters.
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    Text::new(text).set("x", round(at[0])).set("y", round(at[1])).set("text-anchor", anchor)
}

/// A hundredth of a px is finer than any screen, and keeps files small.
fn round(coordinate: f64) -> f64 {
    (coordinate * 100.0).round() / 100.0
}
