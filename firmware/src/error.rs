//! Why a configuration was refused: the field, the value it had and the limit it broke.

use core::fmt;
use serde::{Deserialize, Serialize};

/// A field of the configuration, displayed by the name it has in an instrument description.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
#[allow(missing_docs, reason = "each variant is displayed as, and documented at, its field")]
pub enum Field {
    Across,
    Obstruction,
    Subapertures,
    DetectorWidth,
    DetectorHeight,
    DetectorBits,
    WindowSize,
    WindowOrigin,
    WindowPixels,
    Dark,
    PixelGain,
    Noise,
    ThresholdSigma,
    BadPixels,
    Saturation,
    PeakFraction,
    WeightFwhm,
    WeightGain,
    BrightestCount,
    BrightestBuffer,
    ReferenceSlope,
    SlopeGain,
    FluxMin,
    FluxMax,
    ControlGain,
    LeverArm,
    DelayFrames,
    Omega,
    Sweeps,
    ColdSweeps,
    Stroke,
    SegmentMatrix,
    Flat,
    HeightLimits,
    Slew,
    DacBits,
    Response,
    BeaconHeight,
    GateDepth,
    ZenithAngle,
    PulseRate,
    PulsesPerFrame,
    GateEnd,
    Readout,
    Lattice,
    Colours,
    Separation,
    ValidMin,
    TotalFluxMin,
    TotalFluxMax,
    HoldFrames,
    Leak,
    SaturatedShare,
    Windows,
    Modes,
    Coupling,
    SecondOrigin,
    SecondReference,
    SecondGain,
    SecondFluxMin,
    SecondFluxMax,
}

impl Field {
    /// The field's name, section first.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Across => "pupil.across",
            Self::Obstruction => "pupil.obstruction",
            Self::Subapertures => "pupil.subapertures",
            Self::DetectorWidth => "detector.width",
            Self::DetectorHeight => "detector.height",
            Self::DetectorBits => "detector.bits",
            Self::WindowSize => "windows.size",
            Self::WindowOrigin => "windows.origins",
            Self::WindowPixels => "windows.pixels",
            Self::Dark => "pixels.dark_adu",
            Self::PixelGain => "pixels.gain",
            Self::Noise => "pixels.noise_adu",
            Self::ThresholdSigma => "pixels.threshold_sigma",
            Self::BadPixels => "pixels.bad",
            Self::Saturation => "pixels.saturation_adu",
            Self::PeakFraction => "estimator.peak_fraction",
            Self::WeightFwhm => "estimator.fwhm_px",
            Self::WeightGain => "estimator.gain",
            Self::BrightestCount => "estimator.count",
            Self::BrightestBuffer => "estimator.buffered_pixels",
            Self::ReferenceSlope => "slopes.reference_px",
            Self::SlopeGain => "slopes.gain_m_per_px",
            Self::FluxMin => "slopes.flux_min_adu",
            Self::FluxMax => "slopes.flux_max_adu",
            Self::ControlGain => "control.gain",
            Self::LeverArm => "control.lever_arm",
            Self::DelayFrames => "control.delay_frames",
            Self::Omega => "sor.omega",
            Self::Sweeps => "sor.sweeps",
            Self::ColdSweeps => "sor.cold_sweeps",
            Self::Stroke => "segments.stroke_m",
            Self::SegmentMatrix => "segments.matrix",
            Self::Flat => "segments.flat_m",
            Self::HeightLimits => "segments.limits_m",
            Self::Slew => "segments.slew_m_per_frame",
            Self::DacBits => "actuators.dac_bits",
            Self::Response => "actuators.response_m",
            Self::BeaconHeight => "gate.beacon_height_m",
            Self::GateDepth => "gate.depth_m",
            Self::ZenithAngle => "gate.zenith_angle_deg",
            Self::PulseRate => "gate.pulse_rate_hz",
            Self::PulsesPerFrame => "gate.pulses_per_frame",
            Self::GateEnd => "gate.delay_s + gate.width_s",
            Self::Readout => "gate.readout_s",
            Self::Lattice => "schedule.lattice",
            Self::Colours => "schedule.colours",
            Self::Separation => "schedule.separation",
            Self::ValidMin => "safety.valid_min",
            Self::TotalFluxMin => "safety.flux_min_adu",
            Self::TotalFluxMax => "safety.flux_max_adu",
            Self::HoldFrames => "safety.hold_frames",
            Self::Leak => "safety.leak",
            Self::SaturatedShare => "safety.saturated_share",
            Self::Windows => "windows.count",
            Self::Modes => "modal.modes",
            Self::Coupling => "modal.coupling",
            Self::SecondOrigin => "modal.origins",
            Self::SecondReference => "modal.reference_px",
            Self::SecondGain => "modal.gain_m_per_px",
            Self::SecondFluxMin => "modal.flux_min_adu",
            Self::SecondFluxMax => "modal.flux_max_adu",
        }
    }
}

/// The limit that a value broke.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Limit {
    /// From the first to the second, both included.
    Within(f64, f64),
    /// Between the first and the second, both excluded.
    Between(f64, f64),
    /// A rule that a range does not say.
    Rule(&'static str),
    /// From 0 to a time, s, that the gate keeps only at high elevations.
    Elevation {
        /// The most it may be.
        most: f64,
        /// The elevation from which it fits, degrees; above 90 if at none.
        least_deg: f64,
    },
}

/// A refused value.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ConfigError {
    /// The field.
    pub field: Field,
    /// Which entry of a field that has many: a subaperture, a detector pixel in row-major order, or
    /// a place in the list of bad pixels.
    pub index: Option<u32>,
    /// The value it had.
    pub value: f64,
    /// The limit it broke.
    pub limit: Limit,
}

impl ConfigError {
    /// A refusal of a field that has one value.
    #[must_use]
    pub const fn new(field: Field, value: f64, limit: Limit) -> Self {
        Self { field, index: None, value, limit }
    }

    /// A refusal of entry `index` of a field.
    #[must_use]
    pub const fn at(field: Field, index: usize, value: f64, limit: Limit) -> Self {
        Self { field, index: Some(index as u32), value, limit }
    }

    /// Refuses a value outside `min ..= max`, and one that is not a number.
    pub(crate) fn check(
        field: Field,
        index: Option<usize>,
        value: f64,
        (min, max): (f64, f64),
    ) -> Result<f64, Self> {
        if value >= min && value <= max {
            return Ok(value);
        }
        let limit = Limit::Within(min, max);
        Err(Self { field, index: index.map(|i| i as u32), value, limit })
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.field.name())?;
        if let Some(index) = self.index {
            write!(f, "[{index}]")?;
        }
        write!(f, " = {}: ", self.value)?;
        match self.limit {
            Limit::Within(min, max) => write!(f, "must be from {min} to {max}"),
            Limit::Between(above, below) => write!(f, "must be above {above} and below {below}"),
            Limit::Rule(rule) => f.write_str(rule),
            Limit::Elevation { most, least_deg } if least_deg <= 90.0 => {
                // Rounded up: at the elevation that is written it fits.
                let least_deg = libm::ceil(least_deg * 100.0) / 100.0;
                write!(f, "must be at most {most}; it fits from {least_deg} degrees of elevation")
            }
            Limit::Elevation { most, .. } => {
                write!(f, "must be at most {most}; it fits at no elevation")
            }
        }
    }
}

impl core::error::Error for ConfigError {}
