//! The instrument description: a TOML file, laid over the default one.
//!
//! [`DEFAULT_TOML`] is both the documentation of every field and its default: a user's file is
//! merged over it, table by table, and unknown names are refused. [`Instrument::check`] says which
//! values are out of their limits.

mod beacon;
mod limits;
mod schedule;
mod second_gate;
mod windows;

use crate::atmosphere::Layer;
use crate::cn2::{self, Profile};
use crate::detector::BadPixel;
use crate::error::{Error, refuse};
use crate::optics::geometric::Sensor;
use crate::pupil::{Obstruction, Pupil};
use crate::theory;
use crate::theory::lever_arm::{self, Beacon};
use clap::ValueEnum;
use limits::{MAX_PROFILE_LAYERS, within};
pub use schedule::{Colours, Lattice, LatticeName, PowerName, ScheduleSection};
use serde::{Deserialize, Serialize};
use splash_firmware::centroid::MAX_WINDOW;
use splash_firmware::geometry::Mask;
use std::path::Path;
pub use windows::{LayoutName, Windows};

/// The default instrument, with a comment for every field.
pub const DEFAULT_TOML: &str = include_str!("default.toml");

/// No other profile than the description's layers.
const LAYERS: &str = "layers";

fn layers() -> String {
    LAYERS.into()
}

/// An instrument. Fields are documented in [`DEFAULT_TOML`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct Instrument {
    pub telescope: Telescope,
    pub atmosphere: AtmosphereSection,
    pub laser: Laser,
    pub second_gate: SecondGate,
    pub photons: PhotonsSection,
    pub science: ScienceSection,
    pub detector: DetectorSection,
    pub windows: Windows,
    pub centroids: Centroids,
    pub control: ControlSection,
    pub mirror: MirrorSection,
    pub schedule: ScheduleSection,
    pub gate: GateSection,
    pub safety: SafetySection,
    pub serials: SerialsSection,
}

/// Pupil and subapertures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct Telescope {
    pub subapertures: usize,
    pub pitch_m: f64,
    pub pupil: PupilShape,
    pub obstruction: f64,
    pub spider: bool,
    pub disc_m: f64,
    pub vane_width_m: f64,
    pub vanes: u32,
    pub vane_angle_deg: f64,
    pub samples: usize,
}

/// The pupil's outline: a name, or one string a row with `#` for a subaperture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = r#"must be "circle", "square", "annulus" or a list of rows such as "..####..""#
)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum PupilShape {
    Named(PupilName),
    Rows(Vec<String>),
}

/// A pupil that needs no drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum PupilName {
    Circle,
    Square,
    Annulus,
}

/// Turbulence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct AtmosphereSection {
    pub r0_m: f64,
    pub r0_wavelength_m: f64,
    /// "layers" once the description has been read: a profile's layers have taken the place of the others.
    #[serde(default = "layers", skip_serializing)]
    pub profile: String,
    #[serde(default, skip_serializing)]
    pub profile_layers: usize,
    pub layers: Vec<LayerSection>,
}

/// A turbulent layer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct LayerSection {
    pub weight: f64,
    pub height_m: f64,
    pub wind_speed_m_per_s: f64,
    pub wind_direction_deg: f64,
}

/// The laser, its beacon and the range gate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct Laser {
    pub wavelength_m: f64,
    pub beacon_height_m: f64,
    pub gate_depth_m: f64,
    pub slices: usize,
    pub scatterer: ScattererName,
    pub zenith_angle_deg: f64,
    pub pulse_rate_hz: f64,
    pub pulses_per_frame: u32,
    pub electrons_per_spot: f64,
    pub launch: LaunchName,
    pub launch_waist_pitches: f64,
}

/// Intensity over a subaperture of the beam launched through it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum LaunchName {
    Uniform,
    Gaussian,
}

/// What scatters the laser's light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum ScattererName {
    Rayleigh,
    Sodium,
}

/// How much of the laser's light comes back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct PhotonsSection {
    pub number: PhotonNumberName,
    pub laser_power_w: f64,
    pub launch_throughput: f64,
    pub transmission: f64,
    pub receive_throughput: f64,
    pub quantum_efficiency: f64,
    pub site_altitude_m: f64,
    pub sodium_altitude_m: f64,
    pub sodium_fwhm_m: f64,
    pub sodium_atoms_per_m2: f64,
    pub sodium_cross_section_m2: f64,
}

/// Where the number of photo-electrons comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum PhotonNumberName {
    Given,
    Lidar,
}

/// The second gate, and what it is combined for with the first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct SecondGate {
    pub height_m: f64,
    pub depth_m: f64,
    pub electrons_per_spot: f64,
    pub pixels_per_lambda_d: f64,
    pub modes: usize,
    pub slope_noise_rad: [f64; 2],
    pub layers: Vec<ExpectedLayer>,
}

/// A layer that is expected.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct ExpectedLayer {
    pub weight: f64,
    pub height_m: f64,
}

/// The science camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct ScienceSection {
    pub wavelength_m: f64,
}

/// The wavefront sensor's detector.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct DetectorSection {
    pub bits: u32,
    pub gain_e_per_adu: f64,
    pub read_noise_e: f64,
    pub dark_e_per_frame: f64,
    pub bias_adu: f64,
    pub full_well_e: f64,
    pub response_rms: f64,
    pub bad_pixels: Vec<BadPixel>,
    pub readout_s: f64,
}

/// The centroid's estimator.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct Centroids {
    pub estimator: EstimatorName,
    pub threshold_sigma: f64,
    pub threshold: ThresholdName,
    pub peak_fraction: f64,
    pub weight_fwhm_px: f64,
    pub weight_gain: f64,
    pub brightest: u16,
    pub flux_min: f64,
    pub flux_max: f64,
}

/// Which estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum EstimatorName {
    Thresholded,
    Plain,
    Weighted,
    Brightest,
}

/// What a threshold does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum ThresholdName {
    Subtract,
    ZeroBelow,
}

/// The control law.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct ControlSection {
    pub gain: f64,
    pub lever_arm: LeverArm,
    pub delay_frames: u8,
    pub sweeps: u16,
}

/// What makes up for the lever arm: a factor, or how it follows from the turbulence profile.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = r#"must be a number, "profile" or "best""#)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum LeverArm {
    Factor(f64),
    Named(LeverArmName),
}

/// A lever arm that follows from the turbulence profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum LeverArmName {
    Profile,
    Best,
}

impl std::str::FromStr for LeverArm {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.trim() {
            "profile" => Ok(Self::Named(LeverArmName::Profile)),
            "best" => Ok(Self::Named(LeverArmName::Best)),
            number => match number.parse() {
                Ok(factor) => Ok(Self::Factor(factor)),
                Err(_) => Err("must be a number, profile or best".into()),
            },
        }
    }
}

impl std::fmt::Display for LeverArm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Factor(factor) => write!(f, "{factor}"),
            Self::Named(LeverArmName::Profile) => f.write_str("profile"),
            Self::Named(LeverArmName::Best) => f.write_str("best"),
        }
    }
}

/// The segmented mirror.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct MirrorSection {
    pub stroke_m: f64,
    pub actuator_radius: f64,
    pub response: ResponseName,
    pub dac_bits: u8,
    pub slew_m_per_frame: f64,
}

/// How an actuator answers its code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum ResponseName {
    Linear,
    Quadratic,
}

/// What the range gate does beside opening.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct GateSection {
    pub short_frames: ShortFrameName,
}

/// What becomes of a frame with fewer laser pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum ShortFrameName {
    Mark,
    Scale,
    Drop,
}

/// Which frames are followed, and when the loop is given up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct SafetySection {
    pub valid_min: f64,
    pub flux_min: f64,
    pub flux_max: f64,
    pub saturated_pixels_max: u32,
    pub hold_frames: u16,
    pub safe_frames: u16,
    pub leak: f64,
    pub saturated_share: f64,
    pub saturated_frames: u16,
}

/// What the configuration is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct SerialsSection {
    pub mirror: u32,
    pub detector: u32,
}

/// Part of the peak that is a spot's threshold where there is no noise.
const NOISE_FREE_PEAK_FRACTION: f64 = 0.005;

/// Side of a window that holds a whole spot, lambda/d: what is beyond it costs the Strehl ratio less than 0.003
/// at D/r0 = 8 (8 lambda/d cost up to 0.007, 16 less than 0.001 at four times the work).
const WHOLE_SPOT_LAMBDA_D: f64 = 12.0;

impl Instrument {
    /// The default instrument.
    ///
    /// # Errors
    /// None in practice: a test reads the default.
    pub fn standard() -> Result<Self, Error> {
        Self::parse("", "default")
    }

    /// The instrument described in `file`, laid over the default.
    ///
    /// # Errors
    /// [`Error::Config`] if the file cannot be read, is not TOML, or has a field that is unknown
    /// or of the wrong type.
    pub fn load(file: &Path) -> Result<Self, Error> {
        let name = file.display().to_string();
        let text = std::fs::read_to_string(file)
            .map_err(|source| Error::Config(format!("{name}: {source}")))?;
        Self::parse_in(&text, &name, file.parent())
    }

    /// The instrument described in `file`, or the default one.
    ///
    /// # Errors
    /// As [`Instrument::load`].
    pub fn described(file: Option<&Path>) -> Result<Self, Error> {
        file.map_or_else(Self::standard, Self::load)
    }

    /// The instrument in a TOML text that is called `name` in errors.
    ///
    /// # Errors
    /// As [`Instrument::load`].
    pub fn parse(text: &str, name: &str) -> Result<Self, Error> {
        Self::parse_in(text, name, None)
    }

    /// The same, where a profile's file is looked for in `directory`.
    fn parse_in(text: &str, name: &str, directory: Option<&Path>) -> Result<Self, Error> {
        let mut merged = table(DEFAULT_TOML, "default")?;
        let given = table(text, name)?;
        let own = given.get("atmosphere").is_some_and(|section| section.get("layers").is_some());
        lay_over(&mut merged, given);
        let mut instrument: Self = merged
            .try_into()
            .map_err(|error| Error::Config(format!("{name}: {}", in_words(&error))))?;
        if instrument.atmosphere.profile != LAYERS {
            if own {
                let profile = &instrument.atmosphere.profile;
                return Err(refuse(
                    "atmosphere.profile",
                    profile,
                    "without atmosphere.layers beside it",
                ));
            }
            instrument.take_profile(directory)?;
        }
        Ok(instrument)
    }

    /// Puts a profile's layers in place of the others.
    fn take_profile(&mut self, directory: Option<&Path>) -> Result<(), Error> {
        let AtmosphereSection { profile, profile_layers, .. } = &self.atmosphere;
        within("atmosphere.profile_layers", *profile_layers as f64, 0.0, MAX_PROFILE_LAYERS)?;
        let (layers, count) = match Profile::named(profile) {
            Some(named) => (named.layers(self.laser.beacon_height_m), named.default_count()),
            None if profile.ends_with(".csv") => {
                let path = directory.unwrap_or_else(|| Path::new("")).join(profile);
                (cn2::read(&path)?, 0)
            }
            None => {
                let names = Profile::ALL.map(Profile::name).join(", ");
                let limit = format!("{LAYERS}, {names}, or the name of a file that ends in .csv");
                return Err(refuse("atmosphere.profile", profile, &limit));
            }
        };
        let count = if *profile_layers > 0 { *profile_layers } else { count };
        let section = |l: &Layer| LayerSection {
            weight: l.weight,
            height_m: l.height_m,
            wind_speed_m_per_s: l.wind_speed_m_per_s,
            wind_direction_deg: l.wind_direction_deg,
        };
        // Values that no layer may have are kept as they are, to be refused by name.
        let strange = |l: &Layer| !(l.weight >= 0.0 && l.height_m >= 0.0);
        let layers = if layers.iter().any(strange) { layers } else { cn2::reduced(&layers, count) };
        self.atmosphere = AtmosphereSection {
            layers: layers.iter().map(section).collect(),
            profile: LAYERS.into(),
            profile_layers: 0,
            ..self.atmosphere
        };
        Ok(())
    }

    /// The same instrument with a detector that adds nothing: no read noise, no dark charge, and
    /// 16 bits over the same range, so that rounding to codes is no noise either. A threshold against noise
    /// only cuts the spots' wings: `peak_fraction` is at most 0.005.
    #[must_use]
    pub fn noise_free(mut self) -> Self {
        let scale = 2f64.powi(16 - self.detector.bits.clamp(8, 16) as i32);
        let detector = &mut self.detector;
        detector.bits = detector.bits.max(16);
        detector.gain_e_per_adu /= scale;
        detector.bias_adu *= scale;
        detector.read_noise_e = 0.0;
        detector.dark_e_per_frame = 0.0;
        let fraction = &mut self.centroids.peak_fraction;
        *fraction = fraction.min(NOISE_FREE_PEAK_FRACTION);
        self
    }

    /// The same instrument with windows of at least 12 lambda/d, as far as 32 pixels reach, the optical samples
    /// that such a field takes, and no threshold relative to a spot's peak: centroids are those of whole
    /// spots, speckled wings and all. A window of the description's that is larger stays.
    #[must_use]
    pub fn with_whole_spots(mut self) -> Self {
        let windows = &mut self.windows;
        let wanted = (WHOLE_SPOT_LAMBDA_D * windows.pixels_per_lambda_d).ceil() as usize;
        windows.size = windows.size.max(wanted.min(MAX_WINDOW));
        windows.spacing_px = windows.spacing_px.max(windows.size);
        let field = (windows.size as f64 / windows.pixels_per_lambda_d).ceil() as usize;
        self.telescope.samples = self.telescope.samples.max(field);
        self.centroids.peak_fraction = 0.0;
        self
    }

    /// The description as TOML, complete.
    ///
    /// # Errors
    /// [`Error::Run`] if it cannot be written, which no instrument does.
    pub fn to_toml(&self) -> Result<String, Error> {
        toml::to_string(self).map_err(|error| Error::Run(error.to_string()))
    }

    /// The mask of subapertures.
    ///
    /// # Errors
    /// [`Error::Config`] if the pupil cannot be.
    pub fn mask(&self) -> Result<Mask, Error> {
        let Telescope { subapertures: across, pupil, obstruction, spider, .. } = &self.telescope;
        let mask = match pupil {
            PupilShape::Named(PupilName::Circle) => Mask::circle(*across)?,
            PupilShape::Named(PupilName::Square) => Mask::square(*across)?,
            PupilShape::Named(PupilName::Annulus) => Mask::annulus(*across, *obstruction)?,
            PupilShape::Rows(rows) => {
                let cell = |x: usize, y: usize| rows[y].as_bytes()[x] == b'#';
                let widths: Vec<usize> = rows.iter().map(String::len).collect();
                if widths.len() != *across || widths.iter().any(|width| width != across) {
                    let found = format!("{} rows of lengths {widths:?}", rows.len());
                    let limit = format!("telescope.subapertures = {across} rows of that length");
                    return Err(refuse("telescope.pupil", found, &limit));
                }
                let strange = |row: &&String| row.bytes().any(|cell| cell != b'#' && cell != b'.');
                if let Some(row) = rows.iter().find(strange) {
                    return Err(refuse("telescope.pupil", format!("{row:?}"), "'#' and '.' only"));
                }
                Mask::from_fn(*across, cell)?
            }
        };
        let mask = if *spider { mask.with_spider() } else { mask };
        if mask.count() == 0 {
            return Err(refuse("telescope.pupil", 0, "at least one subaperture"));
        }
        Ok(mask)
    }

    /// The pupil that the optics sample.
    ///
    /// # Errors
    /// [`Error::Config`] if a value is out of its range.
    pub fn pupil(&self) -> Result<Pupil, Error> {
        let (mask, across) = (self.mask()?, self.telescope.subapertures);
        let cells = (0..across * across).map(|i| mask.contains(i % across, i / across)).collect();
        let telescope = &self.telescope;
        self.obstructed(Pupil::new(across, telescope.samples, telescope.pitch_m, cells)?)
    }

    /// The same pupil with what stands in its light.
    ///
    /// # Errors
    /// [`Error::Config`] if no light is left.
    pub fn obstructed(&self, pupil: Pupil) -> Result<Pupil, Error> {
        let telescope = &self.telescope;
        if telescope.disc_m == 0.0 && telescope.vane_width_m == 0.0 {
            return Ok(pupil);
        }
        Ok(pupil.with_obstruction(&Obstruction {
            disc_m: telescope.disc_m,
            vane_width_m: telescope.vane_width_m,
            vanes: telescope.vanes,
            vane_angle_rad: telescope.vane_angle_deg.to_radians(),
        })?)
    }

    /// The turbulent layers.
    pub fn layers(&self) -> Vec<Layer> {
        let layer = |l: &LayerSection| Layer {
            weight: l.weight,
            height_m: l.height_m,
            wind_speed_m_per_s: l.wind_speed_m_per_s,
            wind_direction_deg: l.wind_direction_deg,
        };
        self.atmosphere.layers.iter().map(layer).collect()
    }

    /// The control law's factor f for `sensor`: the description's, or the one that it names; a star has no lever
    /// arm, and one by name is 1 for it.
    ///
    /// # Errors
    /// [`Error::Config`] if it cannot be found from the layers, or is out of its limits.
    pub fn lever_arm(&self, sensor: Sensor) -> Result<f64, Error> {
        let name = match self.control.lever_arm {
            LeverArm::Factor(factor) => return Ok(factor),
            LeverArm::Named(name) => name,
        };
        let beacon = match sensor {
            Sensor::Splash => Beacon::Splash,
            Sensor::Lgs => Beacon::Lgs,
            Sensor::Ngs => return Ok(1.0),
        };
        let height_m = self.laser.beacon_height_m;
        let layer =
            |l: &Layer| theory::Layer { weight: l.weight, beta: 1.0 - l.height_m / height_m };
        let layers: Vec<theory::Layer> =
            self.layers().iter().map(layer).filter(|layer| layer.weight > 0.0).collect();
        if let Some(low) = layers.iter().find(|layer| !theory::BETAS.contains(&layer.beta)) {
            let limit = format!(
                "a number where turbulence is beyond 0.9 of the beacon's height: a layer is at {:.3}",
                1.0 - low.beta
            );
            return Err(refuse("control.lever_arm", self.control.lever_arm, &limit));
        }
        let factor = match name {
            LeverArmName::Profile => lever_arm::alone(&layers),
            LeverArmName::Best => lever_arm::least_variance(&layers, beacon),
        };
        limits::check_lever_arm(factor)?;
        Ok(factor)
    }

    /// The same instrument with the factor for `sensor` in place of a name.
    ///
    /// # Errors
    /// As [`Instrument::lever_arm`].
    pub fn with_lever_arm_of(mut self, sensor: Sensor) -> Result<Self, Error> {
        self.control.lever_arm = LeverArm::Factor(self.lever_arm(sensor)?);
        Ok(self)
    }

    /// The same instrument with another sensor: a guide star lights all subapertures at once, each of which
    /// makes its own image, so nothing of its images is interleaved or laid out as on the sky.
    #[must_use]
    pub fn seen_by(mut self, sensor: Sensor) -> Self {
        if sensor != Sensor::Splash {
            self.schedule = ScheduleSection::none();
            self.windows = self.windows.relayed();
        }
        self
    }

    /// The same instrument, for what has one gate.
    ///
    /// # Errors
    /// [`Error::Config`] if it has a second one.
    pub fn of_one_gate(self) -> Result<Self, Error> {
        match self.has_second_gate() {
            false => Ok(self),
            true => {
                let limit = "0 here; two gates are for host-sim gates, loop, frames and replay";
                Err(refuse("second_gate.height_m", self.second_gate.height_m, limit))
            }
        }
    }

    /// Time from one frame to the next, s.
    pub fn frame_s(&self) -> f64 {
        f64::from(self.laser.pulses_per_frame) / self.laser.pulse_rate_hz
    }

    /// Phase at the laser's wavelength per metre of optical path, rad/m.
    pub fn rad_per_m(&self) -> f64 {
        std::f64::consts::TAU / self.laser.wavelength_m
    }
}

/// Lays `over` on `base`: tables are merged, anything else is replaced.
fn lay_over(base: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(toml::Value::Table(base)), toml::Value::Table(over)) => lay_over(base, over),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

/// What is wrong with which field, on one line and without the names of Rust's types.
fn in_words(error: &toml::de::Error) -> String {
    let words = [
        ("usize", "a whole number, 0 or more"),
        ("u32", "a whole number from 0 to 4294967295"),
        ("u16", "a whole number from 0 to 65535"),
        ("u8", "a whole number from 0 to 255"),
        ("f64", "a number"),
        ("struct ", "the table "),
    ];
    // The error is a message, a line break and the field.
    let line = error.to_string().trim().replace('\n', " ");
    words.iter().fold(line, |line, (rust, plain)| {
        line.replace(&format!("expected {rust}"), &format!("expected {plain}"))
    })
}

/// The table that a TOML text is; an error says in which line it is not.
fn table(text: &str, name: &str) -> Result<toml::Table, Error> {
    text.parse().map_err(|error: toml::de::Error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
        let line = before.matches('\n').count() + 1;
        let message = error.message().replace('\n', " ");
        Error::Config(format!("{name}: line {line}: {message}"))
    })
}
