//! The sections of an instrument's description, as they are written in TOML.

use crate::detector::BadPixel;
use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// No other profile than the description's layers.
pub(super) const LAYERS: &str = "layers";

fn layers() -> String {
    LAYERS.into()
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
