//! `host-sim power`: the laser power that a beacon needs.
//!
//! Measured with the defaults (N = 8, d = r0 = 0.5 m at 532 nm, star at 532 nm, 1 ms frames, 3 electrons of read
//! noise, gate of one depth of focus, 12 screens, seed 1), Strehl ratio:
//!
//! | laser, W | Rayleigh, 12 km, gate 38 m: electrons | Strehl | sodium, 89.6 km, gate 2365 m: electrons | Strehl |
//! |---|---|---|---|---|
//! | 10 | 100 | 0.021(6) | 72 | 0.015(5) |
//! | 20 | 200 | 0.343(26) | 144 | 0.213(31) |
//! | 40 | 399 | 0.508(39) | 287 | 0.673(12) |
//! | 80 | 798 | 0.518(39) | 574 | 0.691(11) |
//! | 160 | 1597 | 0.526(40) | 1148 | 0.703(11) |
//! | 640 | 6387 | 0.529(40) | 4592 | 0.712(10) |
//! | without noise | | 0.529(40) | | 0.712(9) |
//! | 90 % of that | 35(3) W | | 38(1) W | |
//!
//! The digits in brackets are one standard error, mostly the scatter of the screens, which all powers share; that of
//! the least powers is from differences under the same screens. Below 300 electrons the loop fails all at once:
//! thresholds of three sigma of a pixel's noise leave too little of a spot. A gate twice as deep (Rayleigh, 77 m)
//! has twice the light and costs less than it brings: 19(1) W, of 0.528(40) without noise.

mod results;

use super::campaign::Campaign;
use super::strehl::SETTLE;
use super::{increasing, once, output};
use crate::cli::{BeaconName, PowerArgs};
use crate::closed_loop::Sensing;
use crate::error::{Error, refuse};
use crate::files::lock::Lock;
use crate::instrument::{Instrument, PhotonNumberName, ScattererName};
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::point::{Conditions, Point};
use std::time::Instant;

/// Wavelength of sodium's D2 line in air, m.
const SODIUM_WAVELENGTH_M: f64 = 589.159e-9;
/// Pulses of a sodium laser that is gated: one in flight at a time.
const SODIUM_PULSE_RATE_HZ: f64 = 1000.0;
/// Of a pixel: the brightest spots do not saturate it.
const BITS: u32 = 16;

/// What is run for a beacon: its points follow one another in the campaign, the one without noise first.
struct Study {
    beacon: BeaconName,
    instrument: Instrument,
    electrons: Vec<f64>,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &PowerArgs) -> Result<(), Error> {
    let start = Instant::now();
    let powers_w = increasing(&args.powers, f64::total_cmp);
    let description = args.description.load()?.of_one_gate()?;
    let (mut studies, mut points) = (Vec::new(), Vec::new());
    for beacon in once(args.beacons.iter().copied()) {
        let (study, its_points) = study(args, &description, beacon, &powers_w)?;
        studies.push(study);
        points.extend(its_points.into_iter().map(|point| (point, args.screens)));
    }
    let directory = output::directory(args.output.out.as_deref(), "power")?;
    let _lock = Lock::take(&directory, "host-sim power")?;
    let mut campaign = Campaign::open(&directory, points, &[Comparator::Splash], false)?;
    let estimate = campaign.estimate(args.long)?;
    campaign.run_what_can_be()?;
    // All else is measured against what has no noise.
    let bright = campaign.tasks.chunks(powers_w.len() + 1).filter_map(|tasks| tasks.first());
    if let Some(words) = bright.filter_map(|task| task.refused.clone()).next() {
        return Err(Error::Uncalibrated(words));
    }
    let result = results::gather(&campaign, &studies, &powers_w);
    results::write(&directory, &campaign, &result, args.seed)?;
    let mut table = results::table(&result);
    let screens = format!(
        "{}, frozen, {} frames after {SETTLE} to settle, seed {}",
        args.screens, args.frames, args.seed
    );
    table.push(("screens", screens));
    table.push(("estimate", estimate));
    output::finish(&args.output, start, &directory, &result, table)
}

/// The points of one beacon: without noise, then by power.
fn study(
    args: &PowerArgs,
    description: &Instrument,
    beacon: BeaconName,
    powers_w: &[f64],
) -> Result<(Study, Vec<Point>), Error> {
    let instrument = instrument(args, description, beacon)?;
    let point = |instrument: &Instrument, noise_free: bool| {
        let conditions = Conditions {
            sensing: Sensing::Images,
            noise_free,
            settle: SETTLE,
            frames: args.frames,
            seed: args.seed,
        };
        Point::new(instrument, instrument.telescope.subapertures, conditions)
    };
    // What has no noise has the light that is given, whatever the power.
    let mut bright = instrument.clone();
    bright.photons.number = PhotonNumberName::Given;
    let mut points = vec![point(&bright, true)?];
    let mut electrons = Vec::new();
    for &power_w in powers_w {
        let mut powered = instrument.clone();
        powered.photons.laser_power_w = power_w;
        points.push(point(&powered, false)?);
        electrons.push(powered.electrons_per_spot()?);
    }
    Ok((Study { beacon, instrument, electrons }, points))
}

/// The instrument with that beacon and frozen screens.
fn instrument(
    args: &PowerArgs,
    description: &Instrument,
    beacon: BeaconName,
) -> Result<Instrument, Error> {
    let mut instrument = description.clone().frozen();
    let Instrument { telescope, atmosphere, laser, photons, detector, .. } = &mut instrument;
    telescope.subapertures = args.n.unwrap_or(telescope.subapertures);
    photons.number = PhotonNumberName::Lidar;
    // An electron a code: at any power the noise is that of photons and readout, not of rounding.
    detector.gain_e_per_adu = detector.gain_e_per_adu.min(1.0);
    detector.bits = BITS;
    match beacon {
        BeaconName::Rayleigh => laser.scatterer = ScattererName::Rayleigh,
        BeaconName::Sodium => {
            if atmosphere.r0_wavelength_m == 0.0 {
                atmosphere.r0_wavelength_m = laser.wavelength_m;
            }
            laser.scatterer = ScattererName::Sodium;
            laser.wavelength_m = SODIUM_WAVELENGTH_M;
            laser.beacon_height_m = photons.sodium_altitude_m - photons.site_altitude_m;
            laser.pulse_rate_hz = SODIUM_PULSE_RATE_HZ;
            laser.pulses_per_frame = 1;
        }
    }
    if !(0.01..=10.0).contains(&args.depth) {
        return Err(refuse("--depth", args.depth, "from 0.01 to 10 depths of focus"));
    }
    let diameter_m = telescope.subapertures as f64 * telescope.pitch_m;
    let focus_m =
        laser.wavelength_m * laser.beacon_height_m.powi(2) / (telescope.pitch_m * diameter_m);
    laser.gate_depth_m = args.depth * focus_m;
    laser.slices = 0;
    instrument.check()?;
    Ok(instrument)
}
