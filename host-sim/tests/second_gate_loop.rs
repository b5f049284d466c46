//! Two gates by images: in a closed loop beside exact gradients, with noise, and recorded.

use host_sim::atmosphere::Atmosphere;
use host_sim::board::in_process;
use host_sim::calibration::calibrated;
use host_sim::closed_loop::{ClosedLoop, Run, Sensing};
use host_sim::files::fits::FitsReader;
use host_sim::imager::Imager;
use host_sim::instrument::Instrument;
use host_sim::monte_carlo::statistics::Mean;
use host_sim::optics::geometric::Sensor;
use host_sim::pupil::Mirror;
use host_sim::reconstructor::Reconstructor;

const TWO_GATES: &str = "[second_gate]\nheight_m = 6000.0\n";

/// That description under layers that stand still, without noise.
fn frozen(toml: &str) -> Instrument {
    let instrument = Instrument::parse(toml, "test").unwrap().noise_free().frozen();
    instrument.check().unwrap();
    instrument
}

fn prepared(instrument: &Instrument, sensing: Sensing) -> Reconstructor {
    let reconstructor = Reconstructor::new(instrument).unwrap().with_second_gate(&|_| ()).unwrap();
    match sensing {
        Sensing::Images => calibrated(Sensor::Splash, reconstructor, &mut |_| ()).unwrap(),
        Sensing::Geometric => reconstructor,
    }
}

/// The variance, rad^2, that frozen turbulence is corrected to, for each seed.
fn converged(reconstructor: &Reconstructor, sensing: Sensing, seeds: u64) -> Vec<f64> {
    const FRAMES: u32 = 30;
    let instrument = reconstructor.instrument();
    let one = |seed| {
        let mut board = in_process(&reconstructor.spec()).unwrap();
        let run = Run { sensor: Sensor::Splash, sensing, frames: FRAMES, seed, noise_free: true };
        let board = board.as_mut();
        let mut closed =
            ClosedLoop::new(instrument, reconstructor, board, run, &mut |_| ()).unwrap();
        (0..FRAMES).map(|_| closed.step().unwrap().observation.variance_rad2).last().unwrap()
    };
    (0..seeds).map(one).collect()
}

/// Thresholds and windows cost images of one gate some hundredths of a rad^2; those of two no more.
#[test]
fn images_of_two_gates_leave_what_gradients_do() {
    let (one, two) = (frozen(""), frozen(TWO_GATES));
    let of =
        |instrument: &Instrument, sensing| converged(&prepared(instrument, sensing), sensing, 6);
    let [one, images, gradients] =
        [of(&one, Sensing::Images), of(&two, Sensing::Images), of(&two, Sensing::Geometric)];
    println!("one gate {one:.3?}, images {images:.3?}, gradients {gradients:.3?}");
    let Mean { mean, standard_error } = Mean::of_differences(&images, &gradients);
    println!("images less gradients: {mean:.4}({standard_error:.4}) rad^2");
    assert!(mean.abs() < 0.05, "images less gradients: {mean} +- {standard_error}");
    // By theory 0.37 less 0.15.
    let Mean { mean, standard_error } = Mean::of_differences(&one, &images);
    println!("one gate less two: {mean:.4}({standard_error:.4}) rad^2");
    assert!(mean > 3.0 * standard_error && mean > 0.1, "{mean} +- {standard_error}");
}

/// Frames of a flat wavefront: the light in each half of the detector, and centroids that follow their segments.
#[test]
fn both_gates_have_their_light_and_their_calibration() {
    let toml =
        "[telescope]\nsubapertures = 4\nsamples = 16\n[windows]\nsize = 32\nspacing_px = 32\n\
                [centroids]\nestimator = \"plain\"\nthreshold_sigma = 0\n"
            .to_string()
            + TWO_GATES;
    let instrument = frozen(&toml);
    let reconstructor = prepared(&instrument, Sensing::Images);
    let pupil = instrument.pupil().unwrap();
    let still = Atmosphere::from_screens(vec![], pupil.diameter_m(), 0.0).unwrap();
    let mut imager = Imager::new(&reconstructor, Sensor::Splash, &pupil, &still).unwrap();
    let flat = Mirror::flat(pupil.subapertures().len());
    let pixels = imager.expose(&still, 0.0, &flat, None).unwrap();
    let bias = instrument.detector.bias_adu;
    let halves = pixels.chunks(pixels.len() / 2);
    let light: Vec<f64> =
        halves.map(|half| half.iter().map(|&p| f64::from(p) - bias).sum()).collect();
    // Wings reach beyond the windows of both.
    let expected = instrument.gate_light().unwrap();
    assert!((light[1] / light[0] / expected - 1.0).abs() < 0.03, "{light:?}, {expected}");
    // Half a wave from centre to edge is a pixel of lambda/d; of a window that is as wide as the spots' distance, the
    // light at its edges is missing of a shift.
    let gates = [
        (reconstructor.slopes(), instrument.windows.pixels_per_lambda_d),
        (reconstructor.second_slopes().unwrap(), instrument.gate_pixels_per_lambda_d()),
    ];
    for (slopes, scale) in gates {
        let path_m = instrument.laser.wavelength_m / (2.0 * scale);
        for (reference, gain) in slopes.reference_px.iter().zip(&slopes.gain_m_per_px) {
            assert!(reference.iter().all(|c| c.abs() < 0.02), "{reference:?}");
            assert!((gain[0][0] / path_m - 1.0).abs() < 0.1, "{gain:?} of {path_m}");
            assert!(gain[0][1].abs() < 0.02 * path_m, "{gain:?}");
        }
    }
}

/// A recording has both gates' pixels, calibration and law: it replays to the same codes.
#[test]
fn recorded_frames_of_two_gates_are_replayed() {
    let place = tempfile::TempDir::new().unwrap();
    let run = |arguments: &[&str]| -> serde_json::Value {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_host-sim"));
        let output = command.args(arguments).current_dir(&place).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    std::fs::write(place.path().join("two.toml"), TWO_GATES).unwrap();
    let loops = ["--config", "two.toml", "--frames", "8", "--json"];
    let recorded = run(&[&["frames", "run.fits"], &loops[..]].concat());
    assert_eq!(recorded["shape"], serde_json::json!([8, 256, 128]));
    let replayed = run(&["replay", "run.fits", "--out", "replay", "--json"]);
    assert_eq!(replayed["digest"], recorded["digest"]);
    let closed = run(&[&["loop", "--out", "loop"], &loops[..]].concat());
    assert_eq!(closed["digest"], recorded["digest"]);
    let mut file = FitsReader::open(place.path().join("run.fits")).unwrap();
    let truth = file.find("TRUTH").unwrap();
    assert_eq!(file.image::<f32>(truth).unwrap().0, [2, 104, 8]);
    assert!(std::fs::read_to_string(place.path().join("loop/detector.svg")).is_ok());
}

/// The lidar equation's proportion of light, by density and distance; and pixels such that a window reaches from spot
/// to spot.
#[test]
fn light_and_pixels_are_those_of_the_gate() {
    let instrument = Instrument::parse(TWO_GATES, "test").unwrap();
    // U.S. Standard Atmosphere 1976, kg/m^3 at 8.4 and 14.4 km: 0.5027 and 0.2145 by its table. A sixth of the depth.
    let expected = 0.5027 / 0.2145 * 4.0 / 6.0;
    let light = instrument.gate_light().unwrap();
    assert!((light / expected - 1.0).abs() < 0.02, "{light} of {expected}");
    let given = format!("{TWO_GATES}electrons_per_spot = 5000\npixels_per_lambda_d = 0.3");
    let given = Instrument::parse(&given, "test").unwrap();
    assert_eq!(given.gate_light().unwrap(), 0.5);
    assert_eq!(given.gate_pixels_per_lambda_d(), 0.3);
    // 16 pixels for d^2 / (lambda z) = 78.3.
    let scale = instrument.gate_pixels_per_lambda_d();
    assert!((scale - 16.0 / 78.32).abs() < 1e-4, "{scale}");
}

#[test]
fn second_gates_that_cannot_be_are_refused() {
    for (toml, error) in [
        // 12 km less half of both gates.
        ("height_m = 11900.0", "second_gate.height_m = 11900: must be from 0 to 11825"),
        (
            "height_m = 6000.0\nelectrons_per_spot = -1",
            "second_gate.electrons_per_spot = -1: must be from 0 to 1e9",
        ),
        (
            "height_m = 6000.0\npixels_per_lambda_d = 9",
            "second_gate.pixels_per_lambda_d = 9: must be from 0 to 8",
        ),
        // A window of 160 lambda/d, for spots that are 78 apart.
        (
            "height_m = 6000.0\npixels_per_lambda_d = 0.1",
            "second_gate.pixels_per_lambda_d = 0.1: must be from 0.2042",
        ),
        (
            "height_m = 6000.0\nslope_noise_rad = [0.1, -0.2]",
            "second_gate.slope_noise_rad[1] = -0.2: must be from 0 to 100",
        ),
        // d/H = 39 lambda/d are left between spots: z^2 / D of it.
        (
            "height_m = 6000.0\ndepth_m = 400.0\n[laser]\nslices = 0\ngate_depth_m = 30.0",
            "second_gate.depth_m = 400: must be at most 375.0 with laser.slices = 0",
        ),
        (
            "height_m = 6000.0\n[schedule]\nlattice = \"2\"",
            "second_gate.height_m = 6000: must be 0 with [schedule]",
        ),
        (
            "height_m = 6000.0\n[windows]\nlayout = \"sky\"",
            "windows.layout = \"sky\": must be \"relayed\" with a second gate",
        ),
        (
            "height_m = 500.0",
            "second_gate.height_m = 500: must be higher: spots are 940 lambda/d apart there, at most 480",
        ),
        (
            "height_m = 6000.0\n[windows]\nspacing_px = 300",
            "second_gate: rows of the detector = 4800: must be from 1 to 4096",
        ),
        (
            "height_m = 6000.0\n[[detector.bad_pixels]]\nx = 0\ny = 256\nkind = \"hot\"",
            "detector.bad_pixels[0].y = 256: must be from 0 to 255",
        ),
    ] {
        let found = Instrument::parse(&format!("[second_gate]\n{toml}"), "test").unwrap().check();
        let found = found.unwrap_err().to_string();
        assert!(found.starts_with(error), "{found}");
    }
}
