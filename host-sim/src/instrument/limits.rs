//! What an instrument's values may be, by the names they have in its description.
//!
//! Optics, detector and firmware check what they are given as well, in their own words; this comes
//! first, so that an error names what a user wrote.

use super::{Instrument, LeverArm, PhotonNumberName};
use crate::error::{Error, refuse};
use crate::optics::slab::MAX_SLICES;
use crate::pupil::MAX_SAMPLES;
use splash_firmware::centroid::{MAX_WINDOW, MIN_WINDOW};
use splash_firmware::control::MAX_DELAY;
use splash_firmware::gate::SPEED_OF_LIGHT_M_PER_S;
use splash_firmware::geometry::{MAX_ACROSS, MIN_ACROSS};
use splash_firmware::schedule::MAX_COLOURS;

/// Pixels on a side of the largest detector that the firmware reads.
pub(super) const MAX_DETECTOR_SIDE: usize = 4096;

/// Layers that a profile may be reduced to: each is a screen to draw and to look through.
pub(super) const MAX_PROFILE_LAYERS: f64 = 100.0;

impl Instrument {
    /// Refuses the first value that is out of its limits.
    ///
    /// # Errors
    /// [`Error::Config`] with its name, the value and the limit.
    pub fn check(&self) -> Result<(), Error> {
        self.check_light()?;
        self.check_camera()?;
        self.check_second_gate()?;
        self.check_loop()?;
        self.check_safety()
    }

    /// Telescope, turbulence, laser and star.
    fn check_light(&self) -> Result<(), Error> {
        let Self { telescope, atmosphere, laser, science, .. } = self;
        let across = telescope.subapertures as f64;
        within("telescope.subapertures", across, MIN_ACROSS as f64, MAX_ACROSS as f64)?;
        within("telescope.pitch_m", telescope.pitch_m, 1e-3, 100.0)?;
        within("telescope.obstruction", telescope.obstruction, 0.0, 0.99)?;
        let diameter_m = across * telescope.pitch_m;
        within("telescope.disc_m", telescope.disc_m, 0.0, 0.99 * diameter_m)?;
        within("telescope.vane_width_m", telescope.vane_width_m, 0.0, 0.5 * diameter_m)?;
        within("telescope.vanes", f64::from(telescope.vanes), 1.0, 12.0)?;
        within("telescope.vane_angle_deg", telescope.vane_angle_deg, -360.0, 360.0)?;
        within("telescope.samples", telescope.samples as f64, 2.0, MAX_SAMPLES as f64)?;
        within("atmosphere.r0_m", atmosphere.r0_m, 1e-4, 1e9)?;
        if atmosphere.r0_wavelength_m != 0.0 {
            within("atmosphere.r0_wavelength_m", atmosphere.r0_wavelength_m, 1e-7, 1e-4)?;
        }
        let profile_layers = atmosphere.profile_layers as f64;
        within("atmosphere.profile_layers", profile_layers, 0.0, MAX_PROFILE_LAYERS)?;
        for (index, layer) in atmosphere.layers.iter().enumerate() {
            let check = |field: &str, value, from, to| {
                within(&format!("atmosphere.layers[{index}].{field}"), value, from, to)
            };
            check("weight", layer.weight, 0.0, 1e9)?;
            check("height_m", layer.height_m, 0.0, 1e6)?;
            check("wind_speed_m_per_s", layer.wind_speed_m_per_s, 0.0, 1e5)?;
            check("wind_direction_deg", layer.wind_direction_deg, -360.0, 360.0)?;
        }
        let weights: f64 = atmosphere.layers.iter().map(|layer| layer.weight).sum();
        if weights <= 0.0 {
            return Err(refuse("atmosphere.layers: sum of weights", weights.abs(), "above 0"));
        }
        within("laser.wavelength_m", laser.wavelength_m, 1e-7, 1e-4)?;
        within("laser.beacon_height_m", laser.beacon_height_m, 1.0, 1e6)?;
        within("laser.gate_depth_m", laser.gate_depth_m, 1e-3, 2.0 * laser.beacon_height_m)?;
        within("laser.zenith_angle_deg", laser.zenith_angle_deg, 0.0, 80.0)?;
        within("laser.pulse_rate_hz", laser.pulse_rate_hz, 0.25, 1e8)?;
        // One pulse is in flight at a time: the gate closes before the next.
        let farthest_m = laser.beacon_height_m + laser.gate_depth_m / 2.0;
        let closed_s =
            2.0 * farthest_m / (SPEED_OF_LIGHT_M_PER_S * laser.zenith_angle_deg.to_radians().cos());
        if closed_s * laser.pulse_rate_hz > 1.0 {
            let zenith_s = 2.0 * farthest_m / SPEED_OF_LIGHT_M_PER_S;
            let sine = zenith_s * laser.pulse_rate_hz;
            let fits = match sine <= 1.0 {
                // Rounded up: at the elevation that is written it fits.
                true => format!("from {:.1} degrees of elevation", ceil_tenth(sine.asin())),
                false => "at no elevation".to_string(),
            };
            let limit = format!(
                "at most {:.0}: the gate closes before the next pulse; it fits {fits}",
                1.0 / closed_s
            );
            return Err(refuse("laser.pulse_rate_hz", laser.pulse_rate_hz, &limit));
        }
        within("laser.pulses_per_frame", f64::from(laser.pulses_per_frame), 1.0, 1e6)?;
        within("laser.electrons_per_spot", laser.electrons_per_spot, 1e-3, 1e9)?;
        // Narrower beams would be lost between two samples, wider ones are uniform.
        within("laser.launch_waist_pitches", laser.launch_waist_pitches, 0.2, 10.0)?;
        within("science.wavelength_m", science.wavelength_m, 1e-7, 1e-4)?;
        self.check_beacon()
    }

    /// The beacon's depth and light.
    fn check_beacon(&self) -> Result<(), Error> {
        let Self { telescope, laser, photons, .. } = self;
        within("laser.slices", laser.slices as f64, 0.0, MAX_SLICES as f64)?;
        within("photons.laser_power_w", photons.laser_power_w, 1e-6, 1e6)?;
        within("photons.launch_throughput", photons.launch_throughput, 1e-3, 1.0)?;
        within("photons.transmission", photons.transmission, 1e-3, 1.0)?;
        within("photons.receive_throughput", photons.receive_throughput, 1e-3, 1.0)?;
        within("photons.quantum_efficiency", photons.quantum_efficiency, 1e-3, 1.0)?;
        within("photons.site_altitude_m", photons.site_altitude_m, 0.0, 1e4)?;
        within("photons.sodium_altitude_m", photons.sodium_altitude_m, 7e4, 12e4)?;
        within("photons.sodium_fwhm_m", photons.sodium_fwhm_m, 100.0, 5e4)?;
        within("photons.sodium_atoms_per_m2", photons.sodium_atoms_per_m2, 1e11, 1e15)?;
        within("photons.sodium_cross_section_m2", photons.sodium_cross_section_m2, 1e-19, 1e-12)?;
        if photons.number == PhotonNumberName::Lidar {
            let electrons = self.electrons_per_spot()?;
            within("photons: photo-electrons per spot and frame", electrons, 1e-3, 1e9)?;
        }
        if laser.slices == 1 {
            return Ok(());
        }
        // From the slab's lower end z a spot at the pupil's edge is blurred by (1/z - 1/H) D to one side: within
        // half of the image's period, n lambda/d.
        let diameter_m = telescope.subapertures as f64 * telescope.pitch_m;
        let period_rad = telescope.samples as f64 * laser.wavelength_m / telescope.pitch_m;
        let steepest = period_rad * laser.beacon_height_m / (2.0 * diameter_m);
        let deepest_m = 2.0 * laser.beacon_height_m * steepest / (1.0 + steepest);
        if laser.gate_depth_m > deepest_m {
            let limit = format!(
                "at most {deepest_m:.1} with laser.slices = {}: beyond, the blur of the slab is wider than the \
                 image of telescope.samples = {}",
                laser.slices, telescope.samples
            );
            return Err(refuse("laser.gate_depth_m", laser.gate_depth_m, &limit));
        }
        Ok(())
    }

    /// Detector and windows.
    fn check_camera(&self) -> Result<(), Error> {
        let Self { detector, windows, .. } = self;
        within("detector.bits", f64::from(detector.bits), 8.0, 16.0)?;
        within("detector.gain_e_per_adu", detector.gain_e_per_adu, 1e-6, 1e6)?;
        within("detector.read_noise_e", detector.read_noise_e, 0.0, 1e6)?;
        within("detector.dark_e_per_frame", detector.dark_e_per_frame, 0.0, 1e9)?;
        let top = 2f64.powi(detector.bits as i32) - 1.0;
        within("detector.bias_adu", detector.bias_adu, 0.0, top)?;
        within("detector.full_well_e", detector.full_well_e, 1.0, 1e9)?;
        within("detector.response_rms", detector.response_rms, 0.0, 0.25)?;
        within("detector.readout_s", detector.readout_s, 0.0, self.frame_s())?;
        within("windows.size", windows.size as f64, MIN_WINDOW as f64, MAX_WINDOW as f64)?;
        within("windows.pixels_per_lambda_d", windows.pixels_per_lambda_d, 1.0, 8.0)?;
        // Whatever it decides on has to be sound first.
        self.schedule.check()?;
        // The sampled pupil's image repeats itself there.
        let period_px = self.telescope.samples as f64 * windows.pixels_per_lambda_d;
        if windows.size as f64 > period_px {
            let limit = format!(
                "at most telescope.samples x windows.pixels_per_lambda_d = {period_px} pixels"
            );
            return Err(refuse("windows.size", windows.size, &limit));
        }
        self.origins()?;
        let side = self.detector_side();
        let rows = if self.has_second_gate() { 2 * side } else { side };
        for (index, pixel) in detector.bad_pixels.iter().enumerate() {
            for (axis, value, count) in [("x", pixel.x, side), ("y", pixel.y, rows)] {
                let field = format!("detector.bad_pixels[{index}].{axis}");
                within(&field, value as f64, 0.0, (count - 1) as f64)?;
            }
        }
        Ok(())
    }

    /// Centroids, control and mirror.
    fn check_loop(&self) -> Result<(), Error> {
        let Self { windows, centroids, control, mirror, .. } = self;
        within("centroids.threshold_sigma", centroids.threshold_sigma, 0.0, 100.0)?;
        within("centroids.peak_fraction", centroids.peak_fraction, 0.0, 0.9)?;
        within("centroids.weight_fwhm_px", centroids.weight_fwhm_px, 0.5, 64.0)?;
        within("centroids.weight_gain", centroids.weight_gain, 0.001, 7.0)?;
        if centroids.estimator == super::EstimatorName::Brightest {
            let pixels = (windows.size * windows.size) as f64;
            within("centroids.brightest", f64::from(centroids.brightest), 1.0, pixels - 1.0)?;
        }
        within("centroids.flux_min", centroids.flux_min, 0.0, 1e3)?;
        within("centroids.flux_max", centroids.flux_max, centroids.flux_min, 1e3)?;
        // As fine as the firmware's step.
        if !(control.gain >= 1e-4 && control.gain < 2.0) {
            return Err(refuse("control.gain", number(control.gain), "above 0 and below 2"));
        }
        if let LeverArm::Factor(factor) = control.lever_arm {
            check_lever_arm(factor)?;
        }
        within("control.delay_frames", f64::from(control.delay_frames), 0.0, MAX_DELAY as f64)?;
        within("control.sweeps", f64::from(control.sweeps), 0.0, 1000.0)?;
        within("mirror.stroke_m", mirror.stroke_m, 1e-9, 1.0)?;
        within("mirror.actuator_radius", mirror.actuator_radius, 0.05, 2.0)?;
        within("mirror.dac_bits", f64::from(mirror.dac_bits), 8.0, 16.0)?;
        let step_m = mirror.stroke_m / 65536.0;
        within("mirror.slew_m_per_frame", mirror.slew_m_per_frame, step_m, mirror.stroke_m)
    }

    /// Schedule and safety.
    fn check_safety(&self) -> Result<(), Error> {
        let Self { schedule, safety, .. } = self;
        self.colours()?;
        within("schedule.separation", schedule.separation, 0.0, MAX_COLOURS as f64)?;
        within("safety.valid_min", safety.valid_min, 0.0, 1.0)?;
        within("safety.flux_min", safety.flux_min, 0.0, 1e3)?;
        within("safety.flux_max", safety.flux_max, safety.flux_min, 1e3)?;
        let hold_frames = f64::from(safety.hold_frames);
        within("safety.hold_frames", hold_frames, 0.0, safety.safe_frames.into())?;
        within("safety.leak", safety.leak, 0.0, 1.0)?;
        within("safety.saturated_share", safety.saturated_share, 0.0, 1.0)
    }
}

/// Refuses rows that do not draw a grid of `across` x `across` cells.
pub(super) fn check_drawing(field: &str, rows: &[String], across: usize) -> Result<(), Error> {
    if rows.len() == across && rows.iter().all(|row| row.len() == across) {
        return Ok(());
    }
    let widths: Vec<usize> = rows.iter().map(String::len).collect();
    let found = format!("{} rows of lengths {widths:?}", rows.len());
    let limit = format!("telescope.subapertures = {across} rows of that length");
    Err(refuse(field, found, &limit))
}

/// What the firmware's law takes.
pub(super) fn check_lever_arm(factor: f64) -> Result<(), Error> {
    within("control.lever_arm", factor, 0.5, 1.9)
}

/// Degrees of an angle, rad, rounded up to a tenth.
fn ceil_tenth(angle: f64) -> f64 {
    (angle.to_degrees() * 10.0).ceil() / 10.0
}

/// Refuses what is outside, and what is not a number.
pub(super) fn within(field: &str, value: f64, from: f64, to: f64) -> Result<(), Error> {
    if value >= from && value <= to {
        return Ok(());
    }
    let limit = format!("from {} to {}", number(from), number(to));
    Err(refuse(field, number(value), &limit))
}

/// Short for any size: 1e300 is not written out.
fn number(value: f64) -> String {
    let plain = value == 0.0 || (1e-4..1e7).contains(&value.abs());
    if plain { format!("{value}") } else { format!("{value:e}") }
}
