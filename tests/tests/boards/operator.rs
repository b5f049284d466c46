//! An operator's calibration: spots that are anywhere are found, on every board alike.

use super::emulated::or_skip;
use host_sim::board::{BoardError, Options, ibex, image, qemu};
use host_sim::error::Error;
use host_sim::instrument::Instrument;
use host_sim::link::calibrate::{Calibrated, Effort, calibrate};
use host_sim::link::light::{Light, Scene, Simulated};
use host_sim::link::operator::{Frames, Operator};
use host_sim::link::thread::Threaded;
use host_sim::link::{Failure, Transport};
use host_sim::reconstructor::Reconstructor;
use splash_firmware::calibration::{Step, Uncalibrated};
use splash_firmware::link::Reason;
use splash_firmware::mode::Mode;
use std::time::Duration;

/// Twelve subapertures in windows of 8 x 8 pixels, under a sky that stands still.
const SMALL: &str = "
[telescope]
subapertures = 4
[windows]
size = 8
spacing_px = 8
[[atmosphere.layers]]
weight = 1.0
height_m = 0.0
wind_speed_m_per_s = 0.0
wind_direction_deg = 0.0
";
const QUICK: Effort = Effort { frames: 16, averaged: 2 };

/// A detector on which the spots are elsewhere.
struct Scrambled {
    scene: Simulated,
    /// For each pixel, the one whose light it gets.
    from: Vec<usize>,
    pixels: Vec<u16>,
}

impl Scrambled {
    /// The light of the pixel in column x, row y of the detector of `gate` goes to its pixel `to(gate, x, y)`.
    fn new(instrument: &Instrument, to: impl Fn(usize, usize, usize) -> (usize, usize)) -> Self {
        let reconstructor = reconstructor(instrument);
        let side = instrument.detector_side();
        let mut from = vec![0; side * reconstructor.detector().spec().height];
        for i in 0..from.len() {
            let (gate, y, x) = (i / (side * side), i / side % side, i % side);
            let (column, row) = to(gate, x, y);
            from[(gate * side + row) * side + column] = i;
        }
        let scene = Simulated::new(reconstructor, 3).expect("a scene");
        Self { scene, from, pixels: Vec::new() }
    }
}

impl Scene for Scrambled {
    fn set_light(&mut self, light: Light) -> Result<(), Error> {
        self.scene.set_light(light)
    }

    fn expose(&mut self, codes: &[[u16; 3]]) -> Result<&[u16], Error> {
        let pixels = self.scene.expose(codes)?;
        assert_eq!(pixels.len(), self.from.len());
        self.pixels = self.from.iter().map(|&from| pixels[from]).collect();
        Ok(&self.pixels)
    }
}

fn operator(
    board: &'static str,
    transport: Box<dyn Transport>,
    instrument: &Instrument,
    scene: Box<dyn Scene>,
) -> Operator {
    let (mut operator, _) = Operator::new(board, transport, Frames::Here(scene)).expect("a board");
    let reconstructor = reconstructor(instrument);
    let image = image(&reconstructor.spec(), &[], 0).expect("a configuration");
    operator.start(&image, reconstructor.mask().count()).expect("it fits");
    operator
}

/// With what an instrument of two gates makes of them.
fn reconstructor(instrument: &Instrument) -> Reconstructor {
    let reconstructor = Reconstructor::new(instrument).expect("an instrument");
    reconstructor.with_second_gate(&|_| ()).expect("a design")
}

fn here(instrument: &Instrument, scene: impl Scene + 'static) -> Operator {
    let patience = Duration::from_secs(60);
    let threaded = Threaded::start(&reconstructor(instrument).spec(), patience).expect("a thread");
    operator("host", Box::new(threaded), instrument, Box::new(scene))
}

fn small() -> Instrument {
    Instrument::parse(SMALL, "small").expect("an instrument")
}

/// Column and row of each subaperture.
fn cells(instrument: &Instrument) -> Vec<(usize, usize)> {
    instrument.mask().expect("a mask").cells().collect()
}

/// Rms of what the tips and tilts leave, nm, before and after the loop is closed.
fn closed(operator: &mut Operator) -> [f64; 2] {
    operator.set_light(Light::Sky).expect("a sky");
    operator.wait_for_frames(2).expect("frames");
    let before = operator.status().expect("a status").tilt_rms_nm.into();
    operator.enter(Mode::ClosedLoop).expect("it is calibrated");
    operator.wait_for_frames(30).expect("frames");
    [before, operator.status().expect("a status").tilt_rms_nm.into()]
}

/// Where x, y come by so many quarter turns, after x was reflected if so.
fn turned((turns, reflected): (u16, bool), edge: usize, x: usize, y: usize) -> (usize, usize) {
    let start = if reflected { (edge - x, y) } else { (x, y) };
    (0..turns).fold(start, |(x, y), _| (edge - y, x))
}

#[test]
fn a_turned_or_reflected_camera_is_found_and_the_loop_closes() {
    let instrument = small();
    let (side, last) = (instrument.detector_side(), instrument.telescope.subapertures - 1);
    let cells = cells(&instrument);
    for (turns, reflected) in [(0, false), (1, false), (2, false), (3, false), (0, true), (1, true)]
    {
        let turned = |edge, x, y| turned((turns, reflected), edge, x, y);
        let scene = Scrambled::new(&instrument, |_, x, y| turned(side - 1, x, y));
        let mut operator = here(&instrument, scene);
        let found = calibrate(&mut operator, reconstructor(&instrument), QUICK, &mut |_, _| ());
        let [gate] = &found.expect("a working instrument").gates[..] else { panic!("one gate") };
        let place = |&(x, y)| cells.iter().position(|&cell| cell == turned(last, x, y));
        let windows: Vec<usize> = cells.iter().filter_map(place).collect();
        assert_eq!(gate.windows, windows, "{turns} {reflected}");
        assert_eq!(gate.arrangement, Some((90 * turns, reflected)));
        assert_eq!(gate.reflected, reflected);
        let off = (gate.rotation_deg - f64::from(90 * turns) + 180.0).rem_euclid(360.0) - 180.0;
        let [before, after] = closed(&mut operator);
        println!(
            "{turns} turns, reflected {reflected}: quality {:.4}, {off:.2} degrees off, centroid \
             gain {:.3}, tilts {before:.1} to {after:.1} nm",
            gate.quality, gate.centroid_gain
        );
        // Noise of 0.01 px on 12 spots that move by 0.5 px: a tenth of a degree.
        assert!(off.abs() < 1.0, "{off}");
        assert!(gate.quality > 0.95, "{}", gate.quality);
        assert!(after < 0.3 * before, "{before} nm to {after} nm");
    }
}

/// Twelve modes of twelve subapertures, whose spots are seen halfway as well.
fn small_of_two_gates() -> Instrument {
    let gates = "[second_gate]\nheight_m = 6000.0\n";
    let instrument = Instrument::parse(&format!("{SMALL}{gates}"), "small").expect("toml");
    instrument.check().expect("an instrument");
    instrument
}

#[test]
fn each_gate_has_its_own_camera() {
    let instrument = small_of_two_gates();
    let (side, last) = (instrument.detector_side(), instrument.telescope.subapertures - 1);
    let cells = cells(&instrument);
    let ways = [(1, false), (2, true)];
    let scene = Scrambled::new(&instrument, |gate, x, y| turned(ways[gate], side - 1, x, y));
    let mut operator = here(&instrument, scene);
    let found = calibrate(&mut operator, reconstructor(&instrument), QUICK, &mut |_, _| ());
    let found = found.expect("a working instrument");
    assert_eq!(found.gates.len(), 2);
    for (gate, way) in found.gates.iter().zip(ways) {
        let place = |&(x, y)| cells.iter().position(|&cell| cell == turned(way, last, x, y));
        let windows: Vec<usize> = cells.iter().filter_map(place).collect();
        println!("{gate:?}");
        assert_eq!(gate.windows, windows, "{way:?}");
        assert_eq!((gate.arrangement, gate.reflected), (Some((90 * way.0, way.1)), way.1));
        let off = (gate.rotation_deg - f64::from(90 * way.0) + 180.0).rem_euclid(360.0) - 180.0;
        assert!(off.abs() < 1.0, "{off}");
        assert!(gate.quality > 0.95, "{}", gate.quality);
    }
    let [before, after] = closed(&mut operator);
    println!("tilts {before:.1} to {after:.1} nm");
    assert!(after < 0.3 * before, "{before} nm to {after} nm");
}

#[test]
fn spots_in_any_order_are_found() {
    let instrument = small();
    let cells = cells(&instrument);
    let (count, window) = (cells.len(), instrument.windows.size);
    // 5 and 12 have no common factor.
    let order: Vec<usize> = (0..count).map(|i| (5 * i + 3) % count).collect();
    let scene = Scrambled::new(&instrument, |_, x, y| {
        let cell = (x / window, y / window);
        let Some(i) = cells.iter().position(|&c| c == cell) else { return (x, y) };
        let (column, row) = cells[order[i]];
        (column * window + x % window, row * window + y % window)
    });
    let mut operator = here(&instrument, scene);
    let found = calibrate(&mut operator, reconstructor(&instrument), QUICK, &mut |_, _| ());
    let [gate] = &found.expect("it works").gates[..] else { panic!("one gate") };
    assert_eq!(gate.windows, order);
    assert_eq!((gate.arrangement, gate.reflected), (None, false));
    let [before, after] = closed(&mut operator);
    assert!(after < 0.3 * before, "{before} nm to {after} nm");
}

/// Against what the description says of the detector.
#[test]
fn dark_level_gain_and_bad_pixels_are_measured() {
    let text = format!(
        "{SMALL}[detector]\nresponse_rms = 0.03\nbias_adu = 100.0\ngain_e_per_adu = 3.0\n\
         bad_pixels = [{{ x = 3, y = 17, kind = \"hot\" }}, {{ x = 20, y = 9, kind = \"dead\" }}]\n"
    );
    let instrument = Instrument::parse(&text, "bad").expect("an instrument");
    let scene = Simulated::new(reconstructor(&instrument), 5).expect("a scene");
    let mut operator = here(&instrument, scene);
    let effort = Effort { frames: 64, averaged: 2 };
    let found = calibrate(&mut operator, reconstructor(&instrument), effort, &mut |_, _| ())
        .expect("it works");
    println!("{found:?}");
    assert_eq!(found.bad_pixels, 2);
    assert!((found.dark_adu - 100.0).abs() < 0.1, "{}", found.dark_adu);
    // Read noise of 3 electrons, and rounding.
    assert!((found.noise_adu - (1.0f64 + 1.0 / 12.0).sqrt()).abs() < 0.1, "{}", found.noise_adu);
    // A variance of 64 frames and 1022 pixels: 0.6 %.
    assert!((found.gain_e_per_adu / 3.0 - 1.0).abs() < 0.03, "{}", found.gain_e_per_adu);
}

/// What is missing is said, and what cannot be calibrated is not loaded.
#[test]
fn without_light_there_is_no_calibration() {
    struct Blind(Simulated);
    impl Scene for Blind {
        fn set_light(&mut self, light: Light) -> Result<(), Error> {
            self.0.set_light(if light == Light::Bench { Light::Dark } else { light })
        }
        fn expose(&mut self, codes: &[[u16; 3]]) -> Result<&[u16], Error> {
            self.0.expose(codes)
        }
    }
    let instrument = small();
    let mut operator =
        here(&instrument, Blind(Simulated::new(reconstructor(&instrument), 1).expect("a scene")));
    let refused = |operator: &mut Operator| match operator.calibration() {
        Err(host_sim::link::operator::OperatorError::Refused { reason, .. }) => reason,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&mut operator), Reason::Uncalibrated(Uncalibrated::Never));
    let found = calibrate(&mut operator, reconstructor(&instrument), QUICK, &mut |_, _| ());
    let error = found.expect_err("it is dark");
    assert_eq!(error.exit_code(), 1);
    assert!(error.to_string().starts_with("calibration: "), "{error}");
    assert_eq!(refused(&mut operator), Reason::Uncalibrated(Uncalibrated::Never));
    // A record of some steps says which is missing.
    let reconstructor = reconstructor(&instrument);
    let steps = [Step::Darks, Step::Flats, Step::References];
    let partial = image(&reconstructor.spec(), &steps, 0).expect("a configuration");
    operator.upload(&partial, &mut |_| ()).expect("it is loaded");
    let missing = Uncalibrated::Missing(Step::Pokes);
    assert_eq!(refused(&mut operator), Reason::Uncalibrated(missing));
}

/// Calibrates a board and closes its loop: what was found, and the codes' configuration and counters.
fn operated(mut operator: Operator, instrument: &Instrument) -> (Calibrated, String) {
    let effort = Effort { frames: 2, averaged: 1 };
    let found = calibrate(&mut operator, reconstructor(instrument), effort, &mut |_, _| ())
        .expect("it works");
    let [_, after] = closed(&mut operator);
    operator.set("control.gain", &[0.25], None).expect("a parameter");
    operator.wait_for_frames(2).expect("frames");
    let (status, counters) = (operator.status(), operator.counters());
    let image = operator.read_back().expect("an image");
    let status = status.expect("a status");
    assert_eq!(status.mode, Mode::ClosedLoop);
    let said = format!("{after} {status:?} {:?} {image:?}", counters.expect("counters"));
    (found, said)
}

fn same_as_here(
    board: &'static str,
    instrument: &Instrument,
    started: Result<Box<dyn Transport>, BoardError>,
) {
    let Some(transport) = or_skip(started) else { return };
    let scene = || Box::new(Simulated::new(reconstructor(instrument), 9).expect("a scene"));
    let there = operated(operator(board, transport, instrument, scene()), instrument);
    let here = operated(here(instrument, *scene()), instrument);
    assert_eq!(there, here);
}

fn qemu_as_here(instrument: &Instrument) {
    let started = qemu::start(Options::default());
    let started = started.map(|process| Box::new(process) as Box<dyn Transport>);
    same_as_here("qemu", instrument, started);
}

#[test]
fn qemu_is_operated_as_the_library_here() {
    qemu_as_here(&small());
}

#[test]
fn qemu_with_two_gates_is_operated_as_the_library_here() {
    qemu_as_here(&small_of_two_gates());
}

#[test]
fn ibex_is_operated_as_the_library_here() {
    let started = ibex::start(Options::default());
    let started = started.map(|process| Box::new(process) as Box<dyn Transport>);
    same_as_here("ibex", &small(), started);
}

/// A board that says nothing more is given up, and the message says what it was asked.
#[test]
fn a_board_that_hangs_is_given_up() {
    struct Deaf;
    impl Transport for Deaf {
        fn patience(&self) -> Duration {
            Duration::from_millis(10)
        }
        fn send(&mut self, _: &[u8], _: std::time::Instant) -> Result<(), Failure> {
            Ok(())
        }
        fn receive(&mut self, _: &mut [u8], _: std::time::Instant) -> Result<usize, Failure> {
            Err(Failure::Silent { patience: self.patience() })
        }
    }
    let frames = Frames::There(Box::new(|_| Ok(())));
    let error = Operator::new("serial", Box::new(Deaf), frames).err().expect("no answer");
    let expected = "board serial: no answer within 0.01 s, when it was asked what it is";
    assert_eq!(error.to_string(), expected);
    assert_eq!(Error::from(error).exit_code(), 1);
}
