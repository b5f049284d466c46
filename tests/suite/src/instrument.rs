//! The instruments of the suite, each a few numbers that become a specification.

use splash_firmware::actuators::Law;
use splash_firmware::error::ConfigError;
use splash_firmware::gate::{GateSpec, ShortFrame};
use splash_firmware::geometry::Mask;
use splash_firmware::mirror::Serials;
use splash_firmware::pixels::Convention;
use splash_firmware::slopes::MeanSlope;
use splash_firmware::spec::{
    ActuatorSpec, ControlSpec, DetectorSpec, Estimator, Map, ModalSpec, PixelSpec, SafetySpec,
    ScheduleSpec, SegmentSpec, SlopeSpec, SorSpec, Spec, WindowSpec, triangle,
};

use crate::maps::Maps;

/// Full range of every actuator, m of optical path.
const STROKE_M: f64 = 8e-6;
/// Centre-to-edge path per pixel of lambda / 2d at 532 nm, m.
const QUARTER_WAVE_M: f64 = 133e-9;

/// Which cells are subapertures.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Pupil {
    /// The first two cells of the first row.
    Pair,
    /// The first row, columns below some of it, and one cell by itself: nodes of one neighbour, and of none.
    Comb,
    /// The first cell of the first row: a node by itself, and a black one.
    Lone,
    /// Those in the circle.
    Circle,
    /// All.
    Square,
    /// Those in the annulus with an obstruction of 0.3, cut in four by a spider.
    Spider,
}

/// A second gate. Its windows are like the first's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Second {
    /// M.
    pub(crate) modes: usize,
    /// Whether its windows are beside the first's, or below them.
    pub(crate) beside: bool,
}

/// An instrument. What is not a number of its own is the same in all of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instrument {
    pub(crate) name: &'static str,
    pub(crate) pupil: Pupil,
    pub(crate) across: usize,
    /// W, pixels.
    pub(crate) window: u8,
    /// Pixels around and between the windows, which start in rows of their own where there are any.
    pub(crate) gap: u16,
    pub(crate) bits: u8,
    /// Every pixel and every subaperture has a calibration of its own. For detectors of at most
    /// [`crate::maps::PIXELS`] pixels, and at most [`crate::maps::SUBAPERTURES`] subapertures.
    pub(crate) calibrated: bool,
    pub(crate) dark_adu: u16,
    pub(crate) noise_adu: f64,
    pub(crate) convention: Convention,
    pub(crate) saturation_adu: Option<u16>,
    pub(crate) estimator: Estimator,
    /// Slope gain in quarter waves of path a pixel.
    pub(crate) quarter_waves: f64,
    pub(crate) flux_adu: [f64; 2],
    pub(crate) mean: MeanSlope,
    pub(crate) control_gain: f64,
    pub(crate) lever_arm: f64,
    pub(crate) delay_frames: u8,
    pub(crate) second: Option<Second>,
    pub(crate) sor: SorSpec,
    /// Lowest and highest height, and motion in a frame, as parts of the stroke.
    pub(crate) limits: [f64; 2],
    pub(crate) slew: Option<f64>,
    pub(crate) law: Law,
    pub(crate) dac_bits: u8,
    /// Heights at code 0 and at the highest, as parts of the stroke.
    pub(crate) response: [f64; 2],
}

/// N = 4, windows of 8 x 8 pixels edge to edge, 12 bits, thresholded centre of gravity, one
/// calibration for all; relaxation factor and sweeps given, because finding them takes floats.
pub(crate) const DEFAULT: Instrument = Instrument {
    name: "default",
    pupil: Pupil::Circle,
    across: 4,
    window: 8,
    gap: 0,
    bits: 12,
    calibrated: false,
    dark_adu: 100,
    noise_adu: 0.75,
    convention: Convention::Subtract,
    saturation_adu: None,
    estimator: Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.1 },
    quarter_waves: 1.0,
    flux_adu: [200.0, 4e6],
    mean: MeanSlope::Remove,
    control_gain: 0.5,
    lever_arm: 1.125,
    delay_frames: 0,
    second: None,
    sor: SorSpec { omega: Some(1.5), sweeps: Some(4), cold_sweeps: None },
    limits: [0.0, 1.0],
    slew: None,
    law: Law::Quadratic,
    dac_bits: 16,
    response: [0.0, 1.0],
};

impl Pupil {
    fn mask(self, across: usize) -> Result<Mask, ConfigError> {
        match self {
            Self::Pair => Mask::from_fn(across, |x, y| x < 2 && y == 0),
            Self::Lone => Mask::from_fn(across, |x, y| [x, y] == [0, 0]),
            Self::Comb => {
                Mask::from_fn(across, |x, y| y == 0 || (x % 2 == 0 && x != 4) || [x, y] == [4, 5])
            }
            Self::Circle => Mask::circle(across),
            Self::Square => Mask::square(across),
            Self::Spider => Mask::annulus(across, 0.3).map(Mask::with_spider),
        }
    }

    /// Columns and rows of cells that windows are laid out for.
    const fn extent(self, across: usize) -> [u16; 2] {
        match self {
            Self::Pair => [2, 1],
            _ => [across as u16; 2],
        }
    }
}

impl Instrument {
    /// Columns and rows of the detector.
    pub(crate) fn detector(&self) -> [u16; 2] {
        let [x, y] = self.gate();
        match self.second {
            None => [x, y],
            Some(Second { beside: true, .. }) => [2 * x, y],
            Some(Second { beside: false, .. }) => [x, 2 * y],
        }
    }

    /// Columns and rows that one gate takes of it.
    fn gate(&self) -> [u16; 2] {
        let pitch = u16::from(self.window) + self.gap;
        self.pupil.extent(self.across).map(|cells| self.gap + cells * pitch)
    }

    /// First column and row of the window of that cell in the second gate, if there is one.
    fn second_origin(&self, x: usize, y: usize) -> Option<[u16; 2]> {
        let ([x, y], [width, height]) = (self.origin(x, y), self.gate());
        Some(if self.second?.beside { [x + width, y] } else { [x, y + height] })
    }

    /// First column and row of the window of the cell at column `x`, row `y`.
    fn origin(&self, x: usize, y: usize) -> [u16; 2] {
        let pitch = u16::from(self.window) + self.gap;
        let stagger = x as u16 % (self.gap + 1);
        [self.gap + x as u16 * pitch, y as u16 * pitch + stagger]
    }

    /// The specification, with its lists in `maps`.
    pub(crate) fn spec<'a>(&self, maps: &'a mut Maps) -> Result<Spec<'a>, ConfigError> {
        let mask = self.pupil.mask(self.across)?;
        let [width, height] = self.detector();
        let gain = self.quarter_waves * QUARTER_WAVE_M;
        let dark = f64::from(self.dark_adu);
        let second = mask.cells().filter_map(|(x, y)| self.second_origin(x, y));
        maps.place(mask.cells().map(|(x, y)| self.origin(x, y)), second);
        if let Some(Second { modes, .. }) = self.second {
            maps.draw_modes(modes);
        }
        if self.calibrated {
            maps.draw(dark, gain, STROKE_M);
        }
        let maps = &*maps;
        let [origins, second_origins] = maps.gates();
        let modal = self.second.map(|Second { modes, .. }| {
            let (modes, coupling) = maps.modes(modes);
            ModalSpec {
                origins: second_origins,
                reference_px: Map::Uniform([0.25, -0.125]),
                gain_m_per_px: Map::Uniform([[gain * 1.25, 0.0], [0.0, gain * 1.25]]),
                flux_min_adu: Map::Uniform(self.flux_adu[0]),
                flux_max_adu: Map::Uniform(self.flux_adu[1]),
                modes,
                coupling,
            }
        });
        let length = |part: f64| part * STROKE_M;
        let [lowest, highest] = self.limits.map(length);
        let uniform = Spec {
            mask,
            detector: DetectorSpec { width, height, bits: self.bits },
            windows: WindowSpec { size: self.window, origins },
            pixels: PixelSpec {
                dark_adu: Map::Uniform(dark),
                gain: Map::Uniform(1.0),
                noise_adu: Map::Uniform(self.noise_adu),
                threshold_sigma: 3.0,
                convention: self.convention,
                bad: &[],
                saturation_adu: self.saturation_adu,
            },
            estimator: self.estimator,
            slopes: SlopeSpec {
                reference_px: Map::Uniform([0.0; 2]),
                gain_m_per_px: Map::Uniform([[gain, 0.0], [0.0, gain]]),
                flux_min_adu: Map::Uniform(self.flux_adu[0]),
                flux_max_adu: Map::Uniform(self.flux_adu[1]),
                mean: self.mean,
            },
            control: ControlSpec {
                gain: Map::Uniform(self.control_gain),
                lever_arm: self.lever_arm,
                delay_frames: self.delay_frames,
                global_tilt_max_age: 2,
            },
            modal,
            sor: self.sor,
            segments: SegmentSpec {
                stroke_m: STROKE_M,
                matrix: Map::Uniform(triangle(0.6)),
                flat_m: Map::Uniform([(lowest + highest) / 2.0; 3]),
                limits_m: Map::Uniform([[lowest, highest]; 3]),
                slew_m_per_frame: self.slew.map(length),
            },
            actuators: ActuatorSpec {
                dac_bits: self.dac_bits,
                law: self.law,
                response_m: Map::Uniform([self.response.map(length); 3]),
            },
            gate: GateSpec {
                beacon_height_m: 12_000.0,
                depth_m: 300.0,
                zenith_angle_deg: 30.0,
                pulse_rate_hz: 10_000.0,
                pulses_per_frame: 10,
                readout_s: 0.2e-3,
                short_frame: ShortFrame::Mark,
            },
            schedule: ScheduleSpec::default(),
            safety: SafetySpec::default(),
            serials: Serials::default(),
        };
        Ok(if self.calibrated { maps.calibrate(uniform) } else { uniform })
    }
}
