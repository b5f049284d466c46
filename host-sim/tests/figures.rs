//! Figures: well-formed SVG with the right pixels in the right places.

use std::fs;
use std::path::Path;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use host_sim::figures::{
    Curve, FigureError, Measured, Panel, Stack, StackPanel, Term, WindowMark, detector_frame,
    error_bars, panels, phase_map, psf, segment_map, stacks, strehl_series,
};
use tempfile::TempDir;

/// An embedded image, row-major from the top left.
struct Pixels {
    columns: usize,
    rows: usize,
    rgba: Vec<[u8; 4]>,
}

impl Pixels {
    /// The colour of a cell of an image of `cells` x `cells`, row 0 at the bottom.
    fn cell(&self, column: usize, row: usize, cells: usize) -> [u8; 4] {
        let size = self.columns / cells;
        let (x, y) = (column * size + size / 2, self.rows - 1 - (row * size + size / 2));
        self.rgba[y * self.columns + x]
    }
}

/// Parses a figure and decodes the image of its data, if there is one.
fn open(path: &Path) -> (String, Option<Pixels>) {
    let text = fs::read_to_string(path).unwrap();
    assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
    let document = roxmltree::Document::parse(&text).unwrap();
    assert_eq!(document.root_element().tag_name().name(), "svg");
    let image = document.descendants().find(|node| node.attribute("id") == Some("data"));
    let pixels = image.map(|image| {
        let data = image.attribute("href").unwrap().strip_prefix("data:image/png;base64,").unwrap();
        let png = BASE64_STANDARD.decode(data).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        let rgba = bytes.as_chunks().0.to_vec();
        Pixels { columns: info.width as usize, rows: info.height as usize, rgba }
    });
    (text, pixels)
}

const YELLOW: [u8; 4] = [253, 231, 37, 255];
const PURPLE: [u8; 4] = [68, 1, 84, 255];
const NOTHING: [u8; 4] = [0; 4];

/// As bright as the end of viridis, as the colour map's own rounding has it.
fn near(found: [u8; 4], expected: [u8; 4]) -> bool {
    found.iter().zip(expected).all(|(&a, b)| a.abs_diff(b) <= 3)
}

#[test]
fn frames_stand_upright() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("frame.svg");
    let (width, height) = (12, 6);
    let mut pixels = vec![10_u16; width * height];
    pixels[width + 9] = 4000;
    let windows = [
        WindowMark { x0: 0, y0: 0, size: 6, centroid: None, valid: false },
        WindowMark { x0: 6, y0: 0, size: 6, centroid: Some([9.0, 1.0]), valid: true },
        WindowMark { x0: 6, y0: 0, size: 6, centroid: Some([f64::NAN, 1.0]), valid: true },
    ];
    detector_frame(&path, &pixels, width, height, &windows, "a < b & c\u{7}").unwrap();
    let (text, data) = open(&path);
    let data = data.unwrap();
    let size = data.columns / width;
    assert_eq!((data.columns, data.rows), (size * width, size * height));
    for (index, &colour) in data.rgba.iter().enumerate() {
        let (x, y) = (index % data.columns / size, height - 1 - index / data.columns / size);
        assert!(near(colour, if (x, y) == (9, 1) { YELLOW } else { PURPLE }), "({x}, {y})");
    }
    assert!(text.contains("a &lt; b &amp; c "), "title");

    // The cross is on the bright pixel: the plotting area is 560 px wide from (72, 58).
    let document = roxmltree::Document::parse(&text).unwrap();
    let place = [72.0 + 9.5 / 12.0 * 560.0, 58.0 + 280.0 - 1.5 / 6.0 * 280.0];
    let number = |node: roxmltree::Node, name| node.attribute(name)?.parse::<f64>().ok();
    let crossed =
        document.descendants().filter(|node| node.tag_name().name() == "line").any(|line| {
            let middle = |a, b| Some((number(line, a)? + number(line, b)?) / 2.0);
            let (x, y) = (middle("x1", "x2").unwrap(), middle("y1", "y2").unwrap());
            (x - place[0]).abs() < 0.02 && (y - place[1]).abs() < 0.02
        });
    assert!(crossed);
}

#[test]
fn maps_stand_upright_and_leave_out_what_is_masked() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("map.svg");
    let blue = |[red, _, blue, alpha]: [u8; 4]| alpha == 255 && blue > red;
    let red = |[red, _, blue, alpha]: [u8; 4]| alpha == 255 && red > blue;

    let mut values = vec![Some(0.0); 9];
    (values[1], values[3], values[8]) = (Some(5.0), Some(-5.0), None);
    values[4] = Some(f64::NAN);
    segment_map(&path, &values, 3, "piston (nm)", "mirror").unwrap();
    let (text, data) = open(&path);
    let data = data.unwrap();
    assert!(text.contains("piston (nm)"));
    assert!(red(data.cell(1, 0, 3)) && blue(data.cell(0, 1, 3)));
    assert_eq!((data.cell(2, 2, 3), data.cell(1, 1, 3)), (NOTHING, NOTHING));
    assert!(data.cell(0, 0, 3)[..3].iter().all(|&channel| channel > 235), "zero is white");

    let mut phase = [0.0_f32; 16];
    (phase[2], phase[4], phase[15]) = (2.0, -1.0, 1e9);
    let mut inside = [true; 16];
    inside[15] = false;
    phase_map(&path, &phase, 4, &inside, 4.2, "phase").unwrap();
    let data = open(&path).1.unwrap();
    assert!(red(data.cell(2, 0, 4)) && blue(data.cell(0, 1, 4)));
    assert_eq!(data.cell(3, 3, 4), NOTHING);

    let mut image = vec![1e-7_f32; 25];
    (image[5 + 3], image[9], image[20]) = (7.0, f32::NAN, -1.0);
    psf(&path, &image, 5, 0.1, "psf").unwrap();
    let (text, data) = open(&path);
    let data = data.unwrap();
    assert!(near(data.cell(3, 1, 5), YELLOW) && near(data.cell(1, 3, 5), PURPLE));
    assert!(near(data.cell(0, 4, 5), PURPLE) && data.cell(4, 1, 5) == NOTHING);
    // One pixel of 0.1 arcsec: a disc of the same area.
    assert!(text.contains("FWHM 0.113 arcsec"));
}

#[test]
fn figures_of_nothing_are_empty_axes() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("empty.svg");
    detector_frame(&path, &[], 0, 0, &[], "").unwrap();
    assert!(open(&path).1.is_none());
    segment_map(&path, &[], 0, "", "").unwrap();
    assert!(open(&path).1.is_none());
    phase_map(&path, &[], 0, &[], 0.0, "").unwrap();
    open(&path);
    psf(&path, &[], 0, f64::NAN, "").unwrap();
    open(&path);
    psf(&path, &[0.0; 4], 2, 0.1, "").unwrap();
    assert!(open(&path).1.unwrap().rgba.iter().all(|&colour| colour == NOTHING));
    phase_map(&path, &[f32::NAN; 4], 2, &[true; 4], f64::INFINITY, "").unwrap();
    open(&path);
    segment_map(&path, &[None; 4], 2, "", "").unwrap();
    open(&path);
    detector_frame(&path, &[7; 4], 2, 2, &[], "").unwrap();
    open(&path);
    strehl_series(&path, &[], &[], &[], 1.0, "").unwrap();
    open(&path);
    strehl_series(&path, &[f64::NAN; 2], &[f64::NAN; 2], &[0.5; 2], f64::NAN, "").unwrap();
    open(&path);
}

#[test]
fn long_series_keep_their_peaks() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("strehl.svg");
    let count = 100_000;
    let time: Vec<f64> = (0..count).map(|frame| f64::from(frame) * 1e-3).collect();
    let mut strehl = vec![0.5; count as usize];
    (strehl[5000], strehl[70_001]) = (1.0, f64::NAN);
    strehl_series(&path, &time, &strehl, &strehl, 10.0, "loop").unwrap();
    let (text, _) = open(&path);
    assert!(text.len() < 100_000, "{} bytes", text.len());
    // Strehl 1 is at the top of the plotting area, 58 px down; 5 s are 5 % across its 640 px.
    assert!(text.contains(",58 ") && text.contains("L104,58"), "{text}");
    assert!(text.contains("settling"));
}

#[test]
fn wrong_sizes_and_places_are_errors() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("x.svg");
    let size = |result: Result<(), FigureError>| {
        assert!(matches!(result.unwrap_err(), FigureError::Size { .. }));
    };
    size(detector_frame(&path, &[0; 5], 2, 3, &[], ""));
    size(segment_map(&path, &[None; 5], 2, "", ""));
    size(phase_map(&path, &[0.0; 4], 2, &[true; 3], 1.0, ""));
    size(psf(&path, &[0.0; 5], 2, 1.0, ""));
    size(strehl_series(&path, &[0.0], &[0.0], &[], 0.0, ""));
    assert!(!path.exists());
    let error = psf(directory.path().join("no/x.svg"), &[0.0; 4], 2, 1.0, "").unwrap_err();
    assert!(error.to_string().contains("no/x.svg: "), "{error}");
}

/// Points are where the axes say, solid and broken, in panels beside and below one another.
#[test]
fn panels_stand_in_rows_of_three() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("panels.svg");
    let y = [0.0, 0.5, 2.0];
    let curve = |name, broken| Curve { name, colour: "#000000", broken, y: &y };
    let panel = |title: &str| Panel {
        title: title.into(),
        x: vec![2.0, 3.0, 4.0],
        curves: vec![curve("one", false), curve("other", true)],
    };
    let titles = ["a", "b", "c", "d"];
    panels(&path, "order", "fraction", &titles.map(panel)).unwrap();
    let (text, _) = open(&path);
    let document = roxmltree::Document::parse(&text).unwrap();
    let number = |node: roxmltree::Node, name: &str| -> f64 {
        node.attribute(name).unwrap().parse().unwrap()
    };
    let place = |title: &str| {
        let label = document.descendants().find(|node| {
            node.tag_name().name() == "text" && node.text().is_some_and(|text| text.trim() == title)
        });
        label.map(|label| [number(label, "x"), number(label, "y")]).unwrap()
    };
    let [a, b, c, d] = titles.map(place);
    assert!(a[1] == b[1] && b[1] == c[1] && b[0] - a[0] == c[0] - b[0] && b[0] > a[0]);
    assert!(d[0] == a[0] && d[1] > a[1]);
    let curves: Vec<_> =
        document.descendants().filter(|node| node.tag_name().name() == "path").collect();
    let broken = curves.iter().filter(|node| node.attribute("stroke-dasharray") != Some("none"));
    assert_eq!((curves.len(), broken.count()), (8, 4));
    // y = 2 is as far above 0.5 as 0.5 above 0, times three; x advances evenly.
    let marks: Vec<_> = document
        .descendants()
        .filter(|node| node.tag_name().name() == "circle")
        .map(|node| [number(node, "cx"), number(node, "cy")])
        .take(3)
        .collect();
    assert!((marks[2][0] - marks[1][0] - (marks[1][0] - marks[0][0])).abs() < 0.03);
    assert!((marks[1][1] - marks[2][1] - 3.0 * (marks[0][1] - marks[1][1])).abs() < 0.05);

    let short = Panel { x: vec![2.0], ..panel("short") };
    let error = panels(&path, "order", "fraction", &[short]).unwrap_err();
    assert!(matches!(error, FigureError::Size { expected: 1, found: 3, .. }));
    panels(&path, "order", "fraction", &[]).unwrap();
    open(&path);
}

/// Terms above zero go up, terms below go down, from zero; all panels have one scale.
#[test]
fn stacks_of_either_sign() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("stacks.svg");
    let colours = ["#110000", "#220000", "#330000"];
    let term = |k: usize| Term { name: "term", colour: colours[k], shown: k != 1 };
    let terms = [0, 1, 2].map(term);
    let stack = |x: f64, values: [f64; 3], error: f64| Stack {
        x,
        terms: values.to_vec(),
        total: values.iter().sum(),
        error,
    };
    let panel = |stacks: Vec<Stack>| StackPanel { title: "panel".into(), stacks };
    let both = [
        panel(vec![stack(4.0, [1.0, -0.5, 2.0], 0.25), stack(8.0, [0.0, f64::NAN, 1.0], f64::NAN)]),
        panel(vec![stack(4.0, [3.0, 0.0, 0.0], 0.1)]),
    ];
    stacks(&path, ["x", "y"], &both, &terms).unwrap();
    let (text, _) = open(&path);
    let document = roxmltree::Document::parse(&text).unwrap();
    let number = |node: roxmltree::Node, name: &str| -> f64 {
        node.attribute(name).unwrap().parse().unwrap()
    };
    let bars = |colour: &str| -> Vec<[f64; 2]> {
        let all = document.descendants().filter(|node| node.attribute("fill") == Some(colour));
        // Those of the legend are 12 px on a side.
        let bars = all.filter(|node| number(*node, "width") != 12.0);
        bars.map(|bar| [number(bar, "y"), number(bar, "y") + number(bar, "height")]).collect()
    };
    let [first, second, third] = colours.map(bars);
    assert_eq!((first.len(), second.len(), third.len()), (2, 1, 2));
    let unit = first[0][1] - first[0][0];
    let near = |a: f64, b: f64| (a - b).abs() < 0.03;
    let zero = first[0][1];
    // -0.5 hangs from zero; 2 stands on 1; alone, 1 stands on zero; 3 in the other panel has the same scale.
    assert!(near(second[0][0], zero) && near(second[0][1] - zero, 0.5 * unit), "{second:?}");
    assert!(near(third[0][1], first[0][0]) && near(third[0][1] - third[0][0], 2.0 * unit));
    assert!(near(third[1][1], zero) && near(third[1][1] - third[1][0], unit));
    assert!(near(first[1][1], zero) && near(first[1][1] - first[1][0], 3.0 * unit));
    let rings: Vec<_> =
        document.descendants().filter(|node| node.tag_name().name() == "circle").collect();
    assert!(near(number(rings[0], "cy"), zero - 2.5 * unit));
    assert!(!text.contains("NaN"));

    let short = Stack { terms: vec![1.0], ..stack(1.0, [1.0; 3], 0.1) };
    let error = stacks(&path, ["x", "y"], &[panel(vec![short])], &terms).unwrap_err();
    assert!(matches!(error, FigureError::Size { expected: 3, found: 1, .. }));
    stacks(&path, ["x", "y"], &[], &[]).unwrap();
    open(&path);
    stacks(&path, ["x", "y"], &[panel(vec![])], &terms).unwrap();
    open(&path);
}

/// More curves than have room beside each other are named in rows, all of them within the picture.
#[test]
fn a_long_legend_has_rows() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("legend.svg");
    let names: Vec<String> = (0..9).map(|k| format!("curve of number {k}")).collect();
    let curves: Vec<_> = names
        .iter()
        .map(|name| Measured {
            name: name.clone(),
            colour: "#123456",
            y: vec![0.5],
            error: vec![0.1],
        })
        .collect();
    error_bars(&path, ["x", "y"], "a title", &[1.0], &curves).unwrap();
    let (text, _) = open(&path);
    let document = roxmltree::Document::parse(&text).unwrap();
    let place = |name: &str| {
        let node =
            document.descendants().find(|node| node.text().map(str::trim) == Some(name)).unwrap();
        ["x", "y"].map(|axis| node.attribute(axis).unwrap().parse::<f64>().unwrap())
    };
    let [_, title] = place("a title");
    let places: Vec<_> = names.iter().map(|name| place(name)).collect();
    for (k, &[x, y]) in places.iter().enumerate() {
        assert!(x > 30.0 && y > title + 10.0, "{k}: {x}, {y}");
        for &[other_x, other_y] in &places[k + 1..] {
            // A hundred and ten pixels are less than the text and its line.
            assert!((x - other_x).abs() > 110.0 || (y - other_y).abs() > 14.0, "{k}");
        }
    }
}

/// Logarithms have a sign: all points are within the frame.
#[test]
fn points_left_of_zero_are_in_the_frame() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("negative.svg");
    let x = [-2.0, 0.0, 1.5];
    let curve = Measured {
        name: "a curve".into(),
        colour: "#123456",
        y: vec![0.2, 0.5, 0.9],
        error: vec![0.1; 3],
    };
    error_bars(&path, ["x", "y"], "a title", &x, &[curve]).unwrap();
    let (text, _) = open(&path);
    let document = roxmltree::Document::parse(&text).unwrap();
    let circles = document.descendants().filter(|node| node.tag_name().name() == "circle");
    let places: Vec<f64> =
        circles.map(|node| node.attribute("cx").unwrap().parse().unwrap()).collect();
    // The frame begins where the title does.
    let title = document.descendants().find(|node| node.text().map(str::trim) == Some("a title"));
    let left: f64 = title.unwrap().attribute("x").unwrap().parse().unwrap();
    assert_eq!(places.len(), 3);
    assert!(places.iter().all(|place| *place >= left), "{places:?} {left}");
    assert!((places[2] - places[1] - 0.75 * (places[1] - places[0])).abs() < 0.02, "{places:?}");
}
