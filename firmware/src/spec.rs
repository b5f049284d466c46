//! What an instrument is, in physical units: the input of [`crate::config::Config::build`].
//!
//! Lengths are optical path differences in metres (twice the motion of a mirror surface), signals
//! are in ADU, angles on the detector in pixels. Nothing here is validated; `build` does that.

use crate::actuators::Law;
use crate::gate::GateSpec;
use crate::geometry::Mask;
use crate::mirror::Serials;
use crate::pixels::Convention;
use crate::segments::ACTUATORS;
use crate::slopes::MeanSlope;

/// One value for all, or one for each.
///
/// "Each" is in row-major order: of the detector's pixels, or of the mask's subapertures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Map<'a, T> {
    /// The same everywhere.
    Uniform(T),
    /// One entry each.
    Each(&'a [T]),
}

impl<T: Copy> Map<'_, T> {
    /// The value for entry `index`; `None` beyond the end.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<T> {
        match self {
            Self::Uniform(value) => Some(*value),
            Self::Each(values) => values.get(index).copied(),
        }
    }

    /// The number of entries, if the map has one each.
    #[must_use]
    pub fn entries(&self) -> Option<usize> {
        match self {
            Self::Uniform(_) => None,
            Self::Each(values) => Some(values.len()),
        }
    }
}

/// The detector, as it is read out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DetectorSpec {
    /// Pixels in a row, 1 to 4096.
    pub width: u16,
    /// Rows in a frame, 1 to 4096.
    pub height: u16,
    /// Bits of a pixel, 8 to 16.
    pub bits: u8,
}

/// Where the windows are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WindowSpec<'a> {
    /// W, pixels on a side, 4 to 32.
    pub size: u8,
    /// Column and row of each subaperture's first pixel. Windows lie on the detector; those of one
    /// colour of the schedule do not overlap, and no two are in the same place.
    pub origins: &'a [[u16; 2]],
}

/// The detector's calibration. Maps are over the detector, row-major.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelSpec<'a> {
    /// Dark level with bias, ADU, 0 to 65534.
    pub dark_adu: Map<'a, f64>,
    /// Factor that makes the pixel's response that of a mean pixel, 1/4 to 4.
    pub gain: Map<'a, f64>,
    /// Noise of a dark pixel, ADU rms, 0 to 65534.
    pub noise_adu: Map<'a, f64>,
    /// Threshold in units of that noise, 0 to 100.
    pub threshold_sigma: f64,
    /// What a threshold does.
    pub convention: Convention,
    /// Column and row of each bad pixel, in row-major order. Their calibration is not looked at.
    pub bad: &'a [[u16; 2]],
    /// Raw value from which a pixel counts as saturated, ADU; 2^bits - 1 if `None`.
    pub saturation_adu: Option<u16>,
}

/// How a window becomes a centroid. See [`crate::centroid`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Estimator {
    /// Centre of gravity of what is above the pixels' own threshold.
    CentreOfGravity,
    /// Centre of gravity above max(k sigma, `peak_fraction` of the subaperture's previous peak).
    ThresholdedCentreOfGravity {
        /// 0 to 0.9.
        peak_fraction: f64,
    },
    /// The same, weighted with a Gaussian centred on the previous centroid.
    WeightedCentreOfGravity {
        /// 0 to 0.9.
        peak_fraction: f64,
        /// Full width at half maximum of the weight, pixels, 0.5 to 64.
        fwhm_px: f64,
        /// Displacement per measured displacement from the weight's centre, 1/4096 to 7.
        gain: f64,
    },
    /// Centre of gravity of the `count` brightest pixels above the next one.
    Brightest {
        /// 1 to W^2 - 1.
        count: u16,
    },
}

/// Centroids to slopes. Maps are over the subapertures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlopeSpec<'a> {
    /// Reference slopes: the centroid (x, y) of a flat wavefront from the window's centre, pixels,
    /// within +-32.
    pub reference_px: Map<'a, [f64; 2]>,
    /// Centre-to-edge path difference per pixel of centroid, m: rows tip and tilt, columns x and
    /// y.
    pub gain_m_per_px: Map<'a, [[f64; 2]; 2]>,
    /// Least flux of a valid measurement, calibrated ADU.
    pub flux_min_adu: Map<'a, f64>,
    /// Greatest flux of a valid measurement, calibrated ADU.
    pub flux_max_adu: Map<'a, f64>,
    /// Whether the mean slope is removed.
    pub mean: MeanSlope,
}

/// The control law. See [`crate::control`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlSpec<'a> {
    /// Integrator gain g of each subaperture, above 0 and below 2.
    pub gain: Map<'a, f64>,
    /// f, which makes up for the lever arm of high layers; 1 for none, 0.5 to 1.9.
    pub lever_arm: f64,
    /// L, frames between the end of an exposure and the start of its command; 0 to 3.
    pub delay_frames: u8,
    /// Frames after which an unrenewed global tilt counts as stale.
    pub global_tilt_max_age: u32,
}

/// A second gate, and what it adds to the control law. See [`crate::modal`].
///
/// Its windows have the size of the first's, and lie on the same detector: one pass over the rows
/// measures both. Maps are over the subapertures; the pixels' calibration is the detector's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModalSpec<'a> {
    /// Column and row of each subaperture's first pixel. No window overlaps another of either gate;
    /// each starts after its subaperture's of the first gate, by row, then column.
    pub origins: &'a [[u16; 2]],
    /// As [`SlopeSpec::reference_px`].
    pub reference_px: Map<'a, [f64; 2]>,
    /// As [`SlopeSpec::gain_m_per_px`]: of the same path differences in the pupil.
    pub gain_m_per_px: Map<'a, [[f64; 2]; 2]>,
    /// As [`SlopeSpec::flux_min_adu`].
    pub flux_min_adu: Map<'a, f64>,
    /// As [`SlopeSpec::flux_max_adu`].
    pub flux_max_adu: Map<'a, f64>,
    /// q: mode by mode the x and y gradient at each subaperture. 1 to 25 modes, orthonormal over both
    /// axes and without uniform tilt, within 1/256.
    pub modes: &'a [[f64; 2]],
    /// B: mode by mode what it takes of each of the first gate's modes, then of the second's. B over
    /// [`ControlSpec::lever_arm`], and its two halves' sum over it, within +-64.
    pub coupling: &'a [f64],
}

/// The piston solver. See [`crate::sor`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SorSpec {
    /// Relaxation factor, 1 to 1.99; from the mask if `None`. Below the mask's it converges more
    /// slowly than `sweeps: None` provides for.
    pub omega: Option<f64>,
    /// Sweeps of a frame, 1 to 1000; from omega if `None`, ceil(N/2) on a circle.
    pub sweeps: Option<u16>,
    /// Sweeps of the first frame after a reset, 1 to 10000; four times the others if `None`.
    pub cold_sweeps: Option<u16>,
}

/// The mirror's segments. Maps are over the subapertures, arrays over the actuators of a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentSpec<'a> {
    /// Full range of the height scale, path difference in m: 65536 LSB.
    pub stroke_m: f64,
    /// Height of each actuator per piston, tip and tilt of its segment, from -4 to 3.999; the
    /// piston column from 1/4.
    pub matrix: Map<'a, [[f64; 3]; ACTUATORS]>,
    /// Heights of the flat segment, m above the actuators' zero.
    pub flat_m: Map<'a, [f64; ACTUATORS]>,
    /// Lowest and highest height of each actuator, m above its zero, within the stroke.
    pub limits_m: Map<'a, [[f64; 2]; ACTUATORS]>,
    /// Greatest motion of an actuator in a frame, m; none if `None`.
    pub slew_m_per_frame: Option<f64>,
}

/// The actuators' drive. The map is over the subapertures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorSpec<'a> {
    /// Bits of the DAC, 8 to 16.
    pub dac_bits: u8,
    /// How height follows from code.
    pub law: Law,
    /// Height of each actuator at code 0 and at the highest code, m.
    pub response_m: Map<'a, [[f64; 2]; ACTUATORS]>,
}

/// Which subapertures are lit together. See [`crate::schedule`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScheduleSpec<'a> {
    /// The colouring.
    pub colouring: Colouring<'a>,
    /// Least distance of two subapertures of one colour, pitches; 0 for any.
    pub separation: f64,
}

/// A colouring of the subapertures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Colouring<'a> {
    /// All are lit in every frame.
    #[default]
    None,
    /// The lattice (a, b, c) of a c colours.
    Lattice([u8; 3]),
    /// The colour of each subaperture, from 0 without gaps, at most 64.
    List(&'a [u8]),
}

/// When a frame is not followed, and when the loop is given up. See [`crate::quality`] and
/// [`crate::ladder`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafetySpec {
    /// Least share of the subapertures with a valid flux, 0 to 1; of those that are lit, with a
    /// schedule.
    pub valid_min: f64,
    /// Least flux of all windows together, calibrated ADU.
    pub flux_min_adu: f64,
    /// Greatest flux of all windows together, calibrated ADU; infinite for none.
    pub flux_max_adu: f64,
    /// Watched pixels, four a window, that may be saturated.
    pub saturated_pixels_max: u32,
    /// Bad or missing frames one after the other that are held.
    pub hold_frames: u16,
    /// Those, with the held ones, after which the loop is given up; at least `hold_frames`.
    pub safe_frames: u16,
    /// Part of the way to the flat map that the mirror goes in each frame in between, 0 to 1.
    pub leak: f64,
    /// Share of the actuators that may be at their limits, 0 to 1.
    pub saturated_share: f64,
    /// Frames with more of them that open the loop; 0 for never.
    pub saturated_frames: u16,
}

impl Default for SafetySpec {
    /// Every complete frame is followed; 10 are held, the loop is given up after 1000, and opens when
    /// half of the actuators have been at their limits for 100.
    fn default() -> Self {
        Self {
            valid_min: 0.0,
            flux_min_adu: 0.0,
            flux_max_adu: f64::INFINITY,
            saturated_pixels_max: u32::MAX,
            hold_frames: 10,
            safe_frames: 1000,
            leak: 0.01,
            saturated_share: 0.5,
            saturated_frames: 100,
        }
    }
}

/// Everything the reconstructor needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spec<'a> {
    /// The subapertures.
    pub mask: Mask,
    /// The detector.
    pub detector: DetectorSpec,
    /// The windows.
    pub windows: WindowSpec<'a>,
    /// The pixels' calibration.
    pub pixels: PixelSpec<'a>,
    /// The centroid's estimator.
    pub estimator: Estimator,
    /// The slopes.
    pub slopes: SlopeSpec<'a>,
    /// The control law.
    pub control: ControlSpec<'a>,
    /// A second gate; not with a schedule.
    pub modal: Option<ModalSpec<'a>>,
    /// The piston solver.
    pub sor: SorSpec,
    /// The segments.
    pub segments: SegmentSpec<'a>,
    /// The actuators.
    pub actuators: ActuatorSpec<'a>,
    /// The range gate and the frame's timing.
    pub gate: GateSpec,
    /// Which subapertures are lit together.
    pub schedule: ScheduleSpec<'a>,
    /// When a frame is not followed, and when the loop is given up.
    pub safety: SafetySpec,
    /// The mirror and the detector it is for.
    pub serials: Serials,
}

impl<'a> Spec<'a> {
    /// Origins of all windows: the first gate's, then the second's.
    pub fn origins(&self) -> impl Iterator<Item = [u16; 2]> + Clone + use<'a> {
        let second = self.modal.map_or(&[][..], |modal| modal.origins);
        self.windows.origins.iter().chain(second).copied()
    }

    /// How many windows a subaperture has.
    #[must_use]
    pub fn gates(&self) -> usize {
        1 + usize::from(self.modal.is_some())
    }
}

/// Heights of three actuators on a circle of `radius` half pitches, the first one towards +y, for
/// unit piston, tip and tilt.
#[must_use]
pub fn triangle(radius: f64) -> [[f64; 3]; ACTUATORS] {
    let side = radius * libm::sqrt(3.0) / 2.0;
    [[1.0, 0.0, radius], [1.0, -side, -radius / 2.0], [1.0, side, -radius / 2.0]]
}
