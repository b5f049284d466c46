//! An instrument that owns its maps, and lends them as a `Spec`.

use splash_firmware::actuators::Law;
use splash_firmware::config::Config;
use splash_firmware::error::ConfigError;
use splash_firmware::gate::{GateSpec, ShortFrame};
use splash_firmware::geometry::Mask;
use splash_firmware::mirror::Serials;
use splash_firmware::pipeline::{Outcome, Pipeline, Progress, Report};
use splash_firmware::pixels::Convention;
use splash_firmware::segments::ACTUATORS;
use splash_firmware::slopes::MeanSlope;
use splash_firmware::spec::{
    ActuatorSpec, Colouring, ControlSpec, DetectorSpec, Estimator, Map, ModalSpec, PixelSpec,
    SafetySpec, ScheduleSpec, SegmentSpec, SlopeSpec, SorSpec, Spec, WindowSpec, triangle,
};

/// Wavelength of the beacon, m.
pub const WAVELENGTH_M: f64 = 532e-9;
/// Length LSB in a stroke, and ulp in an LSB.
pub const STROKE_LSB: f64 = 65536.0;
/// See [`STROKE_LSB`].
pub const ULP_PER_LSB: f64 = 512.0;

/// One value for all, or one each: the owner of a `Map`.
#[derive(Clone, Debug, PartialEq)]
pub enum Values<T> {
    /// The same everywhere.
    Uniform(T),
    /// One entry each.
    Each(Vec<T>),
}

impl<T: Copy> Values<T> {
    /// The map that borrows these values.
    pub fn map(&self) -> Map<'_, T> {
        match self {
            Self::Uniform(value) => Map::Uniform(*value),
            Self::Each(values) => Map::Each(values),
        }
    }

    /// Entry `index`.
    pub fn at(&self, index: usize) -> T {
        match self {
            Self::Uniform(value) => *value,
            Self::Each(values) => values[index],
        }
    }
}

/// Everything that a `ModalSpec` says, owned. Units as there.
#[derive(Clone, Debug)]
#[allow(
    missing_docs,
    reason = "each field is documented at the field of ModalSpec that it becomes"
)]
pub struct SecondGate {
    pub origins: Vec<[u16; 2]>,
    pub reference_px: Values<[f64; 2]>,
    pub slope_gain_m_per_px: Values<[[f64; 2]; 2]>,
    pub flux_min_adu: Values<f64>,
    pub flux_max_adu: Values<f64>,
    pub modes: Vec<[f64; 2]>,
    pub coupling: Vec<f64>,
}

impl SecondGate {
    /// The specification, borrowed from here.
    pub fn spec(&self) -> ModalSpec<'_> {
        ModalSpec {
            origins: &self.origins,
            reference_px: self.reference_px.map(),
            gain_m_per_px: self.slope_gain_m_per_px.map(),
            flux_min_adu: self.flux_min_adu.map(),
            flux_max_adu: self.flux_max_adu.map(),
            modes: &self.modes,
            coupling: &self.coupling,
        }
    }
}

/// Everything that a `Spec` says, owned. Units as there.
#[derive(Clone, Debug)]
#[allow(missing_docs, reason = "each field is documented at the field of Spec that it becomes")]
pub struct Instrument {
    pub mask: Mask,
    pub detector: DetectorSpec,
    pub window: u8,
    pub origins: Vec<[u16; 2]>,
    pub dark_adu: Values<f64>,
    pub pixel_gain: Values<f64>,
    pub noise_adu: Values<f64>,
    pub threshold_sigma: f64,
    pub convention: Convention,
    pub bad: Vec<[u16; 2]>,
    pub saturation_adu: Option<u16>,
    pub estimator: Estimator,
    pub reference_px: Values<[f64; 2]>,
    pub slope_gain_m_per_px: Values<[[f64; 2]; 2]>,
    pub flux_min_adu: Values<f64>,
    pub flux_max_adu: Values<f64>,
    pub mean: MeanSlope,
    pub control_gain: Values<f64>,
    pub lever_arm: f64,
    pub delay_frames: u8,
    pub global_tilt_max_age: u32,
    pub second: Option<SecondGate>,
    pub sor: SorSpec,
    pub stroke_m: f64,
    pub matrix: Values<[[f64; 3]; ACTUATORS]>,
    pub flat_m: Values<[f64; ACTUATORS]>,
    pub limits_m: Values<[[f64; 2]; ACTUATORS]>,
    pub slew_m_per_frame: Option<f64>,
    pub dac_bits: u8,
    pub law: Law,
    pub response_m: Values<[[f64; 2]; ACTUATORS]>,
    pub gate: GateSpec,
    /// The colour of each subaperture; all are lit together where there are none.
    pub colours: Vec<u8>,
    /// Of more weight than `colours`.
    pub lattice: Option<[u8; 3]>,
    pub separation: f64,
    pub safety: SafetySpec,
    pub serials: Serials,
}

impl Instrument {
    /// A mask with windows of `window` pixels laid edge to edge on a square detector.
    ///
    /// 12 bits, dark level 100 ADU, 3 e- of read noise at 4 e-/ADU, pixels of lambda/2d, that is a
    /// quarter of a wave from centre to edge per pixel; mirror and gate as described in the
    /// fields.
    pub fn new(mask: Mask, window: u8) -> Self {
        let size = u16::from(window);
        let side = mask.across() as u16 * size;
        let stroke_m = 8e-6;
        let quarter = WAVELENGTH_M / 4.0;
        Self {
            mask,
            detector: DetectorSpec { width: side, height: side, bits: 12 },
            window,
            origins: mask.cells().map(|(x, y)| [x as u16 * size, y as u16 * size]).collect(),
            dark_adu: Values::Uniform(100.0),
            pixel_gain: Values::Uniform(1.0),
            noise_adu: Values::Uniform(0.75),
            threshold_sigma: 3.0,
            convention: Convention::Subtract,
            bad: Vec::new(),
            saturation_adu: None,
            estimator: Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.1 },
            reference_px: Values::Uniform([0.0; 2]),
            slope_gain_m_per_px: Values::Uniform([[quarter, 0.0], [0.0, quarter]]),
            flux_min_adu: Values::Uniform(200.0),
            flux_max_adu: Values::Uniform(4e6),
            mean: MeanSlope::Remove,
            control_gain: Values::Uniform(0.5),
            lever_arm: 1.0,
            delay_frames: 0,
            global_tilt_max_age: 100,
            second: None,
            sor: SorSpec::default(),
            stroke_m,
            matrix: Values::Uniform(triangle(0.6)),
            flat_m: Values::Uniform([stroke_m / 2.0; ACTUATORS]),
            limits_m: Values::Uniform([[0.0, stroke_m]; ACTUATORS]),
            slew_m_per_frame: None,
            dac_bits: 16,
            law: Law::Quadratic,
            response_m: Values::Uniform([[0.0, stroke_m]; ACTUATORS]),
            gate: GateSpec {
                beacon_height_m: 12_000.0,
                depth_m: 300.0,
                zenith_angle_deg: 0.0,
                pulse_rate_hz: 10_000.0,
                pulses_per_frame: 10,
                readout_s: 0.2e-3,
                short_frame: ShortFrame::Mark,
            },
            colours: Vec::new(),
            lattice: None,
            separation: 0.0,
            safety: SafetySpec::default(),
            serials: Serials::default(),
        }
    }

    /// The same with a second gate calibrated like the first, its windows below the first's on a detector
    /// of twice the height.
    pub fn with_second_gate(mut self, modes: Vec<[f64; 2]>, coupling: Vec<f64>) -> Self {
        let height = self.detector.height;
        self.second = Some(SecondGate {
            origins: self.origins.iter().map(|&[x, y]| [x, y + height]).collect(),
            reference_px: self.reference_px.clone(),
            slope_gain_m_per_px: self.slope_gain_m_per_px.clone(),
            flux_min_adu: self.flux_min_adu.clone(),
            flux_max_adu: self.flux_max_adu.clone(),
            modes,
            coupling,
        });
        self.detector.height *= 2;
        self
    }

    /// [`Instrument::new`] with the circular pupil of `across` subapertures.
    ///
    /// # Panics
    /// Unless `across` is from 4 to 40.
    pub fn circle(across: usize, window: u8) -> Self {
        Self::new(Mask::circle(across).expect("4 to 40 across"), window)
    }

    /// An instrument whose centroids are exact functions of the frame, for tests of what comes
    /// after them: 16 bits, no dark level, no threshold, plain centre of gravity.
    pub fn ideal(mask: Mask, window: u8) -> Self {
        let mut ideal = Self::new(mask, window);
        ideal.detector.bits = 16;
        ideal.dark_adu = Values::Uniform(0.0);
        ideal.noise_adu = Values::Uniform(0.0);
        ideal.threshold_sigma = 0.0;
        ideal.estimator = Estimator::CentreOfGravity;
        ideal
    }

    /// The specification, borrowed from here.
    pub fn spec(&self) -> Spec<'_> {
        Spec {
            mask: self.mask,
            detector: self.detector,
            windows: WindowSpec { size: self.window, origins: &self.origins },
            pixels: PixelSpec {
                dark_adu: self.dark_adu.map(),
                gain: self.pixel_gain.map(),
                noise_adu: self.noise_adu.map(),
                threshold_sigma: self.threshold_sigma,
                convention: self.convention,
                bad: &self.bad,
                saturation_adu: self.saturation_adu,
            },
            estimator: self.estimator,
            slopes: SlopeSpec {
                reference_px: self.reference_px.map(),
                gain_m_per_px: self.slope_gain_m_per_px.map(),
                flux_min_adu: self.flux_min_adu.map(),
                flux_max_adu: self.flux_max_adu.map(),
                mean: self.mean,
            },
            control: ControlSpec {
                gain: self.control_gain.map(),
                lever_arm: self.lever_arm,
                delay_frames: self.delay_frames,
                global_tilt_max_age: self.global_tilt_max_age,
            },
            modal: self.second.as_ref().map(SecondGate::spec),
            sor: self.sor,
            segments: SegmentSpec {
                stroke_m: self.stroke_m,
                matrix: self.matrix.map(),
                flat_m: self.flat_m.map(),
                limits_m: self.limits_m.map(),
                slew_m_per_frame: self.slew_m_per_frame,
            },
            actuators: ActuatorSpec {
                dac_bits: self.dac_bits,
                law: self.law,
                response_m: self.response_m.map(),
            },
            gate: self.gate,
            schedule: ScheduleSpec {
                colouring: match (self.lattice, self.colours.as_slice()) {
                    (Some(lattice), _) => Colouring::Lattice(lattice),
                    (None, []) => Colouring::None,
                    (None, colours) => Colouring::List(colours),
                },
                separation: self.separation,
            },
            safety: self.safety,
            serials: self.serials,
        }
    }

    /// The configuration, or why it was refused.
    ///
    /// # Errors
    /// That of `Config::build`.
    pub fn try_config<const M: usize, const P: usize, const B: usize>(
        &self,
    ) -> Result<Box<Config<M, P, B>>, ConfigError> {
        self.try_bank()
    }

    /// The same with room for the modes of a second gate.
    ///
    /// # Errors
    /// That of `Config::build`.
    pub fn try_bank<const M: usize, const P: usize, const B: usize, const K: usize>(
        &self,
    ) -> Result<Box<Config<M, P, B, K>>, ConfigError> {
        let mut config = Box::new(Config::new());
        config.build(&self.spec())?;
        Ok(config)
    }

    /// The configuration.
    ///
    /// # Panics
    /// If it is refused.
    pub fn config<const M: usize, const P: usize, const B: usize>(&self) -> Box<Config<M, P, B>> {
        self.bank()
    }

    /// The same with room for the modes of a second gate.
    ///
    /// # Panics
    /// If it is refused.
    pub fn bank<const M: usize, const P: usize, const B: usize, const K: usize>(
        &self,
    ) -> Box<Config<M, P, B, K>> {
        self.try_bank().unwrap_or_else(|error| panic!("refused: {error}"))
    }

    /// The number of subapertures.
    pub fn count(&self) -> usize {
        self.mask.count()
    }

    /// Optical path of one ulp, m.
    pub fn ulp_m(&self) -> f64 {
        self.stroke_m / STROKE_LSB / ULP_PER_LSB
    }
}

/// Pushes a whole frame, row by row, and finishes it.
///
/// # Panics
/// If a row is refused, or if the frame is not complete after its last row.
pub fn run_frame<const M: usize, const P: usize, const B: usize, const K: usize>(
    pipeline: &mut Pipeline<M, B, K>,
    config: &Config<M, P, B, K>,
    number: u32,
    pixels: &[u16],
) -> Report {
    pipeline.begin(config, number);
    let mut progress = Progress::More;
    for row in pixels.chunks_exact(usize::from(config.width())) {
        progress = pipeline.push_row(config, row).expect("a row of the detector");
    }
    assert_eq!(progress, Progress::Complete, "frame {number} is complete");
    pipeline.finish(config)
}

/// [`run_frame`] for a frame that must move the mirror.
///
/// # Panics
/// As [`run_frame`], and if the frame is held.
pub fn step<const M: usize, const P: usize, const B: usize, const K: usize>(
    pipeline: &mut Pipeline<M, B, K>,
    config: &Config<M, P, B, K>,
    number: u32,
    pixels: &[u16],
) -> Report {
    let report = run_frame(pipeline, config, number, pixels);
    assert_eq!(report.outcome, Outcome::Updated, "frame {number}");
    report
}
