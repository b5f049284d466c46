//! Instrument descriptions: what a file changes, what a pupil looks like, what is refused.

use host_sim::instrument::{DEFAULT_TOML, Instrument, LeverArm, PupilShape};
use host_sim::optics::geometric::Sensor;
use splash_firmware::geometry::Mask;

fn parse(toml: &str) -> Instrument {
    Instrument::parse(toml, "test").unwrap()
}

/// The mask as rows of `#` and `.`.
fn rows(toml: &str) -> Vec<String> {
    let mask = parse(toml).mask().unwrap();
    let cell = |x, y| if mask.contains(x, y) { '#' } else { '.' };
    (0..mask.across()).map(|y| (0..mask.across()).map(|x| cell(x, y)).collect()).collect()
}

#[test]
fn pupils_by_name() {
    assert_eq!(rows("[telescope]\nsubapertures = 4"), [".##.", "####", "####", ".##."]);
    let square = rows("[telescope]\nsubapertures = 4\npupil = \"square\"");
    assert_eq!(square, ["####"; 4]);
    let annulus = "[telescope]\nsubapertures = 6\npupil = \"annulus\"\nobstruction = 0.4";
    assert_eq!(rows(annulus), [".####.", "######", "##..##", "##..##", "######", ".####."]);
    assert_eq!(parse("").mask().unwrap().count(), 52);
}

#[test]
fn spiders_cover_the_middle() {
    let even = "[telescope]\nsubapertures = 6\npupil = \"square\"\nspider = true";
    assert_eq!(rows(even), ["##..##", "##..##", "......", "......", "##..##", "##..##"]);
    let odd = "[telescope]\nsubapertures = 5\npupil = \"square\"\nspider = true";
    assert_eq!(rows(odd), ["##.##", "##.##", ".....", "##.##", "##.##"]);
}

#[test]
fn pupils_drawn_by_hand() {
    let drawn = ["#...", ".##.", "..##", "...#"];
    let toml = format!("[telescope]\nsubapertures = 4\npupil = {drawn:?}");
    assert_eq!(rows(&toml), drawn);
    let instrument = parse(&toml);
    assert_eq!(instrument.telescope.pupil, PupilShape::Rows(drawn.map(String::from).to_vec()));
    let cells = instrument.mask().unwrap();
    assert_eq!(cells.cells().collect::<Vec<_>>(), [(0, 0), (1, 1), (2, 1), (2, 2), (3, 2), (3, 3)]);
    // Optics, firmware and windows see the same subapertures in the same order.
    let optics = instrument.pupil().unwrap();
    let expected = [[0, 0], [1, 1], [2, 1], [2, 2], [3, 2], [3, 3]];
    assert_eq!(optics.subapertures(), expected);
    let origins = instrument.origins().unwrap();
    assert_eq!(origins, expected.map(|cell: [usize; 2]| cell.map(|i| 16 * i as u16)));
}

#[test]
fn windows_stand_in_the_middle_of_their_space() {
    let toml = "[telescope]\nsubapertures = 4\npupil = \"square\"\n[windows]\nspacing_px = 24";
    let instrument = parse(toml);
    let origins = instrument.origins().unwrap();
    assert_eq!(instrument.detector_side(), 96);
    assert_eq!(origins[0], [4, 4]);
    assert_eq!(origins[1], [28, 4]);
    assert_eq!(origins[15], [76, 76]);
}

#[test]
fn a_file_is_laid_over_the_default() {
    assert_eq!(parse(""), Instrument::standard().unwrap());
    assert_eq!(parse(DEFAULT_TOML), Instrument::standard().unwrap());
    let mut expected = Instrument::standard().unwrap();
    expected.telescope.pitch_m = 1.0;
    expected.laser.pulses_per_frame = 20;
    // A whole number is a number.
    assert_eq!(parse("[telescope]\npitch_m = 1\n[laser]\npulses_per_frame = 20"), expected);
    assert!((expected.frame_s() - 2e-3).abs() < 1e-15);
    // Layers are replaced as a whole.
    let layer = "[[atmosphere.layers]]\nweight = 1\nheight_m = 5000\nwind_speed_m_per_s = 20\n\
                 wind_direction_deg = 45";
    let layers = parse(layer).atmosphere.layers;
    assert_eq!(layers.len(), 1);
    assert_eq!(layers[0].height_m, 5000.0);
    assert_eq!(parse(layer).atmosphere.r0_m, 0.5);
}

#[test]
fn without_noise_the_range_stays() {
    let noisy = parse("[detector]\nbits = 10\nread_noise_e = 5\ndark_e_per_frame = 2");
    let clean = noisy.clone().noise_free();
    assert_eq!((clean.detector.read_noise_e, clean.detector.dark_e_per_frame), (0.0, 0.0));
    assert_eq!(clean.detector.bits, 16);
    let electrons = |i: &Instrument| {
        let codes = 2f64.powi(i.detector.bits as i32) - i.detector.bias_adu;
        codes * i.detector.gain_e_per_adu
    };
    assert!((electrons(&clean) - electrons(&noisy)).abs() < 1e-9);
    let section = (&clean.telescope, &clean.laser, &clean.windows, &clean.control, &clean.mirror);
    let before = (&noisy.telescope, &noisy.laser, &noisy.windows, &noisy.control, &noisy.mirror);
    assert_eq!(section, before);
    clean.check().unwrap();
    assert_eq!(clean.clone().noise_free(), clean);
}

#[test]
fn written_and_read_again_it_is_the_same() {
    for toml in [
        "",
        "[telescope]\nsubapertures = 4\npupil = [\"####\", \"#..#\", \"#..#\", \"####\"]",
        "[telescope]\npupil = \"annulus\"\nobstruction = 0.30000000000000004",
        "[second_gate]\nheight_m = 6000.0\nlayers = [{ weight = 0.3, height_m = 1.0 }]",
        "[detector]\nbad_pixels = [{ x = 3, y = 7, kind = \"hot\" }]\n\
         [centroids]\nestimator = \"weighted\"\nthreshold = \"zero-below\"\n\
         [mirror]\nresponse = \"linear\"",
    ] {
        for instrument in [parse(toml), parse(toml).noise_free()] {
            let written = instrument.to_toml().unwrap();
            assert_eq!(parse(&written), instrument, "{written}");
        }
    }
}

/// For each whole number of the default description: too small, where it can be, and too large.
const WRONG_COUNTS: [(&str, &[u32]); 21] = [
    ("atmosphere.profile_layers", &[101]),
    ("telescope.subapertures", &[0, 3, 41]),
    ("telescope.vanes", &[0, 13]),
    ("telescope.samples", &[0, 1, 33]),
    ("laser.slices", &[65]),
    ("laser.pulses_per_frame", &[0, 1_000_001]),
    ("second_gate.modes", &[1, 11, 13, 26]),
    ("detector.bits", &[0, 7, 17]),
    ("windows.size", &[0, 3, 33]),
    ("windows.spacing_px", &[0, 15, 513]),
    ("centroids.brightest", &[0, 256]),
    ("control.delay_frames", &[4]),
    ("control.sweeps", &[1001]),
    ("mirror.dac_bits", &[0, 7, 17]),
    ("safety.saturated_pixels_max", &[]),
    ("safety.hold_frames", &[101]),
    ("safety.safe_frames", &[]),
    ("safety.saturated_frames", &[]),
    ("second_gate.modes", &[1, 11, 26]),
    ("serials.mirror", &[]),
    ("serials.detector", &[]),
];

#[test]
fn every_number_has_limits() {
    Instrument::standard().unwrap().check().unwrap();
    let default: toml::Table = DEFAULT_TOML.parse().unwrap();
    let fields = default.iter().flat_map(|(section, table)| {
        table.as_table().unwrap().iter().map(move |(field, value)| (section, field, value))
    });
    let mut refused = 0;
    for (section, field, value) in fields {
        let name = format!("{section}.{field}");
        let wrong: Vec<String> = match value {
            toml::Value::Float(_) => {
                ["nan", "inf", "-inf", "-1e300", "1e300"].map(String::from).into()
            }
            toml::Value::Integer(_) => {
                let (_, counts) = WRONG_COUNTS.iter().find(|(of, _)| *of == name).unwrap();
                counts.iter().map(u32::to_string).collect()
            }
            _ => continue,
        };
        for wrong in wrong {
            // Its number is not looked at by another estimator.
            let brightest = if field == "brightest" { "estimator = \"brightest\"\n" } else { "" };
            let toml = format!("[{section}]\n{brightest}{field} = {wrong}");
            let error = parse(&toml).check().expect_err(&toml).to_string();
            assert!(error.starts_with(&format!("{name} = ")), "{toml}: {error}");
            assert!(error.contains(": must be ") && error.len() < 120, "{toml}: {error}");
            refused += 1;
        }
    }
    assert!(refused > 140, "{refused}");
}

#[test]
fn every_number_of_an_expected_layer_has_limits() {
    for (weight, height, field) in [
        ("0.0", "0.0", "weight"),
        ("nan", "0.0", "weight"),
        ("1e300", "0.0", "weight"),
        ("1.0", "-1.0", "height_m"),
        // Not below the beacon.
        ("1.0", "12000.0", "height_m"),
    ] {
        let layer = format!("{{ weight = {weight}, height_m = {height} }}");
        let error = parse(&format!("[second_gate]\nlayers = [{layer}]")).check().unwrap_err();
        let start = format!("second_gate.layers[0].{field} = ");
        assert!(error.to_string().starts_with(&start), "{layer}: {error}");
    }
}

#[test]
fn every_number_of_a_layer_has_limits() {
    for field in ["weight", "height_m", "wind_speed_m_per_s", "wind_direction_deg"] {
        for wrong in ["nan", "inf", "-1e300", "1e300"] {
            let mut toml = String::from("[[atmosphere.layers]]\n");
            for name in ["weight", "height_m", "wind_speed_m_per_s", "wind_direction_deg"] {
                toml += &format!("{name} = {}\n", if name == field { wrong } else { "1" });
            }
            let error = parse(&toml).check().unwrap_err().to_string();
            let name = format!("atmosphere.layers[0].{field} = ");
            assert!(error.starts_with(&name), "{toml}: {error}");
        }
    }
    let none = parse("[atmosphere]\nlayers = []").check().unwrap_err().to_string();
    assert_eq!(none, "atmosphere.layers: sum of weights = 0: must be above 0");
}

/// What passes the check, the firmware takes: at both ends of every limit that both have.
#[test]
fn the_firmware_agrees_with_the_limits() {
    for toml in [
        "[centroids]\nthreshold_sigma = 0",
        "[centroids]\nthreshold_sigma = 100",
        "[centroids]\npeak_fraction = 0",
        "[centroids]\npeak_fraction = 0.9",
        "[centroids]\nestimator = \"weighted\"\nweight_fwhm_px = 0.5",
        "[centroids]\nestimator = \"weighted\"\nweight_fwhm_px = 64",
        "[centroids]\nestimator = \"weighted\"\nweight_gain = 0.001",
        "[centroids]\nestimator = \"weighted\"\nweight_gain = 7",
        "[centroids]\nestimator = \"brightest\"\nbrightest = 1",
        "[centroids]\nestimator = \"brightest\"\nbrightest = 255",
        "[centroids]\nflux_min = 0\nflux_max = 0",
        "[centroids]\nflux_min = 1000\nflux_max = 1000",
        "[control]\ngain = 0.0001",
        "[control]\ngain = 1.9999",
        "[control]\nlever_arm = 0.5",
        "[control]\nlever_arm = 1.9",
        "[control]\ndelay_frames = 3",
        "[control]\nsweeps = 1000",
        "[mirror]\nstroke_m = 1\nslew_m_per_frame = 1",
        "[mirror]\nactuator_radius = 0.05",
        "[mirror]\nactuator_radius = 2",
        "[mirror]\ndac_bits = 8",
        "[mirror]\nslew_m_per_frame = 1.3e-10",
        "[laser]\nzenith_angle_deg = 80\npulse_rate_hz = 2000",
        "[laser]\npulse_rate_hz = 12336",
        "[laser]\npulse_rate_hz = 0.25",
        "[laser]\ngate_depth_m = 0.001",
        "[laser]\npulses_per_frame = 1000000",
        "[laser]\nbeacon_height_m = 1\ngate_depth_m = 2",
        "[detector]\nbits = 16\nbias_adu = 65534",
        "[detector]\nreadout_s = 0.001",
        "[windows]\nsize = 4",
        "[telescope]\nsamples = 16\n[windows]\nsize = 32\nspacing_px = 512",
        "[telescope]\nsubapertures = 4\nobstruction = 0.99",
    ] {
        let instrument = parse(toml);
        instrument.check().unwrap_or_else(|error| panic!("{toml}: {error}"));
        let reconstructor = host_sim::reconstructor::Reconstructor::new(&instrument).unwrap();
        let board = host_sim::board::in_process(&reconstructor.spec());
        assert!(board.is_ok(), "{toml}: {}", board.err().unwrap());
    }
}

#[test]
fn masks_are_the_firmware_s() {
    let annulus = parse("[telescope]\npupil = \"annulus\"\nobstruction = 0.25\nspider = true");
    let expected = Mask::annulus(8, 0.25).unwrap().with_spider();
    assert_eq!(annulus.mask().unwrap(), expected);
}

/// w b / w b^2 = 0.9 / 0.825 with the default's layers; 1 for a star; numbers are everybody's.
#[test]
fn a_lever_arm_by_name_follows_the_sensor() {
    let named = parse("[control]\nlever_arm = \"profile\"");
    for (sensor, expected) in
        [(Sensor::Splash, 0.9 / 0.825), (Sensor::Lgs, 0.9 / 0.825), (Sensor::Ngs, 1.0)]
    {
        assert!((named.lever_arm(sensor).unwrap() - expected).abs() < 1e-15);
        let set = named.clone().with_lever_arm_of(sensor).unwrap();
        assert_eq!(set.control.lever_arm, LeverArm::Factor(named.lever_arm(sensor).unwrap()));
        assert_eq!(parse("[control]\nlever_arm = 1.2").lever_arm(sensor).unwrap(), 1.2);
    }
    let best = parse("[control]\nlever_arm = \"best\"");
    assert!(best.lever_arm(Sensor::Splash).unwrap() > named.lever_arm(Sensor::Splash).unwrap());
    let wrong = Instrument::parse("[control]\nlever_arm = \"most\"", "x").unwrap_err().to_string();
    assert!(wrong.contains("a number, \"profile\" or \"best\""), "{wrong}");
    let high = "[laser]\nbeacon_height_m = 3100\n[control]\nlever_arm = \"profile\"";
    let high = parse(high).lever_arm(Sensor::Splash).unwrap_err().to_string();
    assert!(high.contains("control.lever_arm = profile") && high.contains("0.968"), "{high}");
}

/// A profile's layers take the place of the others; what is written has them and no name.
#[test]
fn profiles_by_name_and_from_a_table() {
    let paper = parse("[atmosphere]\nprofile = \"paper\"");
    assert_eq!(paper, Instrument::standard().unwrap());
    let count = |toml: &str| parse(&format!("[atmosphere]\n{toml}")).atmosphere.layers.len();
    assert_eq!(count("profile = \"hufnagel-valley-57\""), 10);
    assert_eq!(count("profile = \"eso-median-35\""), 35);
    assert_eq!(count("profile = \"eso-median-35\"\nprofile_layers = 6"), 6);
    let six = parse("[atmosphere]\nprofile = \"mauna-kea-7\"\nprofile_layers = 6");
    six.check().unwrap();
    assert_eq!(parse(&six.to_toml().unwrap()), six);

    let place = tempfile::tempdir().unwrap();
    let (description, table) = (place.path().join("site.toml"), place.path().join("cn2.csv"));
    std::fs::write(&description, "[atmosphere]\nprofile = \"cn2.csv\"\n").unwrap();
    std::fs::write(&table, "weight,height_m,wind_speed_m_per_s\n1,5000,20\n3,0,5\n").unwrap();
    let layers = Instrument::load(&description).unwrap().atmosphere.layers;
    let found: Vec<_> =
        layers.iter().map(|l| [l.height_m, l.weight, l.wind_speed_m_per_s]).collect();
    assert_eq!(found, [[0.0, 3.0, 5.0], [5000.0, 1.0, 20.0]]);
    std::fs::write(&table, "weight,height_m\n1,-5\n").unwrap();
    let error = Instrument::load(&description).unwrap().check().unwrap_err().to_string();
    assert!(error.contains("atmosphere.layers[0].height_m = -5"), "{error}");
    std::fs::write(&table, "weight,height\n1,5\n").unwrap();
    let error = Instrument::load(&description).unwrap_err();
    assert!(error.exit_code() == 2 && error.to_string().contains("no column height_m"), "{error}");

    for (toml, words) in [
        ("profile = \"hufnagel\"", ["atmosphere.profile = hufnagel", "hufnagel-valley-57"]),
        ("profile = \"none.csv\"", ["none.csv", ""]),
        ("profile = \"paper\"\nlayers = []", ["atmosphere.profile = paper", "atmosphere.layers"]),
        ("profile = \"paper\"\nprofile_layers = 101", ["profile_layers = 101", "100"]),
    ] {
        let error =
            Instrument::parse(&format!("[atmosphere]\n{toml}"), "x").unwrap_err().to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{toml}: {error}");
    }
}
