//! The lidar equation against numbers worked out by hand and published, and what an instrument makes of it.

use host_sim::beacon::{Kind, Link, Scatterer};
use host_sim::instrument::Instrument;
use host_sim::lighting::Lighting;
use host_sim::pupil::Pupil;
use std::f64::consts::PI;

fn parse(toml: &str) -> Instrument {
    Instrument::parse(toml, "test").unwrap()
}

const RAYLEIGH: Scatterer = Scatterer { site_altitude_m: 0.0, kind: Kind::Rayleigh };

fn sodium(cross_section_m2: f64) -> Kind {
    Kind::Sodium { altitude_m: 92e3, fwhm_m: 10e3, atoms_per_m2: 4e13, cross_section_m2 }
}

/// Without losses, at the zenith: 1 J at 532 nm into 1 m^2.
fn ideal(scatterer: Scatterer, height_m: f64, depth_m: f64) -> Link {
    Link {
        scatterer,
        wavelength_m: 532e-9,
        energy_j: 1.0,
        height_m,
        depth_m,
        zenith_angle_rad: 0.0,
        launch_throughput: 1.0,
        transmission: 1.0,
        area_m2: 1.0,
        receive_throughput: 1.0,
        quantum_efficiency: 1.0,
    }
}

/// Molecules scatter isotropically but for 3/4 (1 + cos^2): backwards, 3/(8 pi) of the total cross section,
/// 5.167e-31 m^2 at 532 nm (Bucholtz 1995, Appl. Opt. 34, 2765), less 1.5 % for anisotropy.
#[test]
fn air_scatters_as_published() {
    let total_m2 = 5.167e-31;
    for (height_m, molecules_per_m3) in [(0.0, 2.547e25), (12_000.0, 19_399.0 / 2.991_18e-21)] {
        let expected = molecules_per_m3 * total_m2 * 3.0 / (8.0 * PI);
        let sent = RAYLEIGH.backscatter_per_m_sr(height_m, 532e-9);
        assert!((sent / expected - 1.0).abs() < 0.02, "{height_m} m: {sent}, {expected}");
    }
    let colours = [355e-9, 710e-9].map(|m| RAYLEIGH.backscatter_per_m_sr(0.0, m));
    assert!((colours[0] / colours[1] - 16.0).abs() < 1e-9);
}

/// ARGOS on the Large Binocular Telescope (Rabien et al. 2019, A&A 621, A4): 18 W at 532 nm, 12 km away, a gate of
/// 300 m, 15 subapertures across 8.25 m, about 1800 photons per subaperture and millisecond. Above the telescope
/// there are more, by what air (twice), launch, telescope and sensor lose: 0.15 to 0.4 pass where each of the
/// five passes 0.7 to 0.85.
#[test]
fn argos_has_the_light_that_it_has() {
    let scatterer = Scatterer { site_altitude_m: 3_200.0, kind: Kind::Rayleigh };
    let subaperture_m = 8.25 / 15.0;
    let photons = Link {
        energy_j: 18.0 * 1e-3,
        area_m2: subaperture_m * subaperture_m,
        ..ideal(scatterer, 12_000.0, 300.0)
    }
    .photons();
    println!("ARGOS: {photons:.0} photons without losses, {:.2} of them seen", 1800.0 / photons);
    assert!((0.15..0.4).contains(&(1800.0 / photons)), "{photons}");
    assert!((0.7_f64.powi(5)..0.85_f64.powi(5)).contains(&(1800.0 / photons)));
}

/// A gate through the whole layer has all atoms: C sigma/(4 pi H^2) of the photons; one of a width has 0.761.
#[test]
fn sodium_returns_its_column() {
    let scatterer = Scatterer { site_altitude_m: 0.0, kind: sodium(1e-15) };
    let photons =
        |depth_m| Link { wavelength_m: 589e-9, ..ideal(scatterer, 92e3, depth_m) }.photons();
    let photon_j = 6.626e-34 * 2.998e8 / 589e-9;
    let column = 4e13 * 1e-15 / (4.0 * PI * 92e3_f64.powi(2)) / photon_j;
    // Of 1/z^2 over the layer the mean is 3 sigma^2/H^2 = 0.6 % above that of its middle.
    assert!((photons(60e3) / column - 1.006).abs() < 0.002, "{}", photons(60e3) / column);
    assert!((photons(10e3) / column - 0.761).abs() < 0.003, "{}", photons(10e3) / column);
}

/// Continuous sodium lasers of 20 W return some 1e7 photons/s/m^2 to the top of the telescope (Holzloehner et al.
/// 2010: s_ce C P T^2 / L^2, s_ce = 130 to 260 photons/s/W per atom/m^2).
#[test]
fn the_default_cross_section_is_a_published_coupling() {
    let instrument = parse("[laser]\nscatterer = \"sodium\"");
    let scatterer = Scatterer { site_altitude_m: 0.0, ..instrument.scatterer() };
    let flux = Link {
        wavelength_m: 589.159e-9,
        energy_j: 20.0,
        transmission: 0.84,
        ..ideal(scatterer, 92e3, 60e3)
    }
    .photons();
    let published = 130.0 * 4e13 * 20.0 * 0.84 * 0.84 / 92e3_f64.powi(2);
    assert!((flux / published - 1.0).abs() < 0.02, "{flux} of {published} photons/s/m^2");
}

/// Losses multiply; what goes with the zenith angle is the path: 1/R^2, its length in the gate, the air twice.
#[test]
fn losses_and_slant() {
    let plain = ideal(RAYLEIGH, 12_000.0, 100.0);
    let lossy = Link {
        launch_throughput: 0.5,
        transmission: 0.9,
        receive_throughput: 0.4,
        quantum_efficiency: 0.8,
        ..plain
    };
    let expected = 0.5 * 0.81 * 0.4 * 0.8;
    assert!((lossy.electrons() / plain.electrons() / expected - 1.0).abs() < 1e-12);
    let slant = Link { zenith_angle_rad: PI / 3.0, ..lossy };
    // At 60 degrees: 1/4 from the range, 2 from the gate, 0.9^4 from the air.
    let expected = 0.5 * 0.9_f64.powi(2);
    assert!((slant.photons() / lossy.photons() / expected - 1.0).abs() < 1e-9);
}

/// An instrument shares the power among its spots and collects with all of its subapertures: more of the same size
/// change nothing, a Gaussian beam loses what its square cuts off.
#[test]
fn instruments_count_their_photons() {
    let electrons = |toml: &str| {
        let lidar = format!("[photons]\nnumber = \"lidar\"\n{toml}");
        parse(&lidar).electrons_per_spot().unwrap()
    };
    let eight = electrons("laser_power_w = 20");
    assert!((electrons("laser_power_w = 40") / eight - 2.0).abs() < 1e-12);
    let sixteen = electrons("[telescope]\nsubapertures = 16");
    assert!((sixteen / eight - 1.0).abs() < 1e-12);
    // erf(1/sqrt(2))^2 (sixes of a waist of one pitch) = 0.6827^2.
    let waist = electrons("[laser]\nlaunch = \"gaussian\"\nlaunch_waist_pitches = 1");
    assert!((waist / eight - 0.682_69_f64.powi(2)).abs() < 1e-4, "{waist} of {eight}");
    // By hand: 0.02 J of 532 nm, 0.7 launched, 0.85^2 through the air, beta = 2.78e-7 per m and sr at 14.4 km,
    // 300 m, 0.25 m^2 at 12 km, 0.5 and 0.8 on the way to an electron.
    let hand = 0.02 / 3.734e-19 * 0.7 * 0.7225 * 2.78e-7 * 300.0 * 0.25 / 1.44e8 * 0.4;
    assert!((eight / hand - 1.0).abs() < 0.01, "{eight} of {hand}");
    assert_eq!(parse("").electrons_per_spot().unwrap(), 1e4);
    let faint = parse("[photons]\nnumber = \"lidar\"\nlaser_power_w = 1e-6\n");
    let faint = Instrument {
        laser: host_sim::instrument::Laser { gate_depth_m: 1e-3, ..faint.laser },
        ..faint
    };
    let error = faint.check().unwrap_err().to_string();
    assert!(error.starts_with("photons: photo-electrons per spot and frame = "), "{error}");
}

#[test]
fn gates_that_blur_beyond_the_image_are_refused() {
    // 1/z - 1/H = n lambda/(2 d D) = 1.064e-6 per m at z = 11848.7 m: half of the gate is 151.3 m.
    parse("[laser]\nslices = 0\ngate_depth_m = 302").check().unwrap();
    let error = parse("[laser]\nslices = 3\ngate_depth_m = 303").check().unwrap_err().to_string();
    assert!(error.starts_with("laser.gate_depth_m = 303: must be at most 302.6"), "{error}");
    parse("[laser]\ngate_depth_m = 303").check().unwrap();
}

/// Twice the spots share the laser's power and are seen by twice the area: beyond what the firmware takes as well.
#[test]
fn a_spot_has_as_much_light_on_any_telescope() {
    let instrument = parse("[photons]\nnumber = \"lidar\"");
    let on = |across| {
        let pupil = Pupil::square(across, 2, instrument.telescope.pitch_m).unwrap();
        assert_eq!(Lighting::on(&instrument, &pupil).unwrap().count(), 1);
        instrument.electrons_per_spot_on(&pupil)
    };
    assert!((on(48) / on(8) - 1.0).abs() < 1e-12, "{} {}", on(48), on(8));
}
