//! The firmware's configuration for an instrument: what its team would measure and calibrate.

use crate::calibration::SlopeCalibration;
use crate::detector::{Calibration, Detector, DetectorSpec};
use crate::error::Error;
use crate::instrument::{
    Centroids, EstimatorName, Instrument, ResponseName, SecondGate as SecondGateSection,
    ShortFrameName, ThresholdName,
};
use crate::lighting::Lighting;
use crate::optics::geometric::Sensor;
use crate::range_diversity::design::{Design, Purpose};
use crate::range_diversity::law::Law as Combination;
use splash_firmware::actuators::Law;
use splash_firmware::gate::{GateSpec, ShortFrame};
use splash_firmware::geometry::Mask;
use splash_firmware::mirror::Serials;
use splash_firmware::pixels::Convention;
use splash_firmware::slopes::MeanSlope;
use splash_firmware::spec::{
    ActuatorSpec, Colouring, ControlSpec, DetectorSpec as Readout, Estimator, Map, ModalSpec,
    PixelSpec, SafetySpec, ScheduleSpec, SegmentSpec, SlopeSpec, SorSpec, Spec, WindowSpec,
    triangle,
};

/// Largest pixel gain that the firmware takes: what answers less than a quarter is called bad.
const MAX_PIXEL_GAIN: f32 = 4.0;
/// Frames after which a global tilt is stale; the simulator gives none.
const GLOBAL_TILT_MAX_AGE: u32 = 10;

/// Everything a [`Spec`] borrows.
#[derive(Clone, Debug)]
pub struct Reconstructor {
    instrument: Instrument,
    mask: Mask,
    detector: Detector,
    origins: Vec<[u16; 2]>,
    dark_adu: Vec<f64>,
    gain: Vec<f64>,
    noise_adu: Vec<f64>,
    bad: Vec<[u16; 2]>,
    slopes: SlopeCalibration,
    lighting: Lighting,
    /// Least and greatest flux of each subaperture's valid measurements, calibrated ADU.
    flux_limits_adu: [Vec<f64>; 2],
    /// The control law's factor: SPLASH's, if the description has it by name.
    lever_arm: f64,
    second: Option<SecondGate>,
}

/// The second gate: its windows lie in the rows behind those of the first, on a detector twice as high.
#[derive(Clone, Debug)]
struct SecondGate {
    law: Combination,
    origins: Vec<[u16; 2]>,
    slopes: SlopeCalibration,
    /// A spot's light over its light at the first gate.
    light: f64,
    /// Least and greatest flux of each subaperture's valid measurements, calibrated ADU.
    flux_limits_adu: [Vec<f64>; 2],
}

/// What is known of each pixel, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct PixelMaps {
    /// Mean without light, ADU.
    pub dark_adu: Vec<f64>,
    /// Calibrated ADU per raw ADU above dark.
    pub gain: Vec<f64>,
    /// Rms without light, ADU.
    pub noise_adu: Vec<f64>,
    /// Pixels not to be used, column and row, by row and then column.
    pub bad: Vec<[u16; 2]>,
}

impl Reconstructor {
    /// Calibrates the instrument's detector; slopes are those of an ideal sensor.
    ///
    /// # Errors
    /// [`Error::Config`] with field, value and limit of what cannot be.
    pub fn new(instrument: &Instrument) -> Result<Self, Error> {
        let origins = instrument.origins()?;
        let (detector, maps) = detector(instrument, instrument.detector_side())?;
        let mask = instrument.mask()?;
        let lighting = Lighting::new(instrument)?;
        let Centroids { flux_min, flux_max, .. } = instrument.centroids;
        let flux_limits_adu = [flux_min, flux_max].map(|part| {
            let limit = |electrons| part * (electrons / instrument.detector.gain_e_per_adu);
            lighting.electrons_per_spot().map(limit).collect()
        });
        let PixelMaps { dark_adu, gain, noise_adu, bad } = maps;
        Ok(Self {
            slopes: SlopeCalibration::ideal(instrument, mask.count()),
            flux_limits_adu,
            lighting,
            lever_arm: instrument.lever_arm(Sensor::Splash)?,
            instrument: instrument.clone(),
            mask,
            detector,
            origins,
            dark_adu,
            gain,
            noise_adu,
            bad,
            second: None,
        })
    }

    /// With the second gate of the description, if it has one: designs the combination, for which `progress` is told the
    /// fraction done. As [`Self::combining_gates`] otherwise.
    ///
    /// # Errors
    /// As [`Reconstructor::new`].
    pub fn with_second_gate(self, progress: &(dyn Fn(f64) + Sync)) -> Result<Self, Error> {
        let instrument = &self.instrument;
        if !instrument.has_second_gate() {
            return Ok(self);
        }
        let SecondGateSection { height_m, modes, slope_noise_rad, .. } = instrument.second_gate;
        let purpose = Purpose::of(instrument, height_m, slope_noise_rad);
        let design = Design::new(&instrument.pupil()?, &purpose, modes, progress)?;
        self.combining_gates(Combination::from(&design))
    }

    /// With the second gate of the description and this law. The second gate's slopes are those of an ideal sensor, the
    /// first's stay.
    ///
    /// # Errors
    /// As [`Reconstructor::new`].
    pub fn combining_gates(self, law: Combination) -> Result<Self, Error> {
        let instrument = &self.instrument;
        let light = instrument.gate_light()?;
        let side = instrument.detector_side();
        let second = SecondGate {
            law,
            light,
            // At most 4096 rows: both fit in 16 bits.
            origins: self.origins.iter().map(|&[x, y]| [x, y + side as u16]).collect(),
            slopes: SlopeCalibration::ideal_at_gate(instrument, self.mask.count()),
            flux_limits_adu: self
                .flux_limits_adu
                .each_ref()
                .map(|limits| limits.iter().map(|limit| light * limit).collect()),
        };
        let (detector, maps) = detector(instrument, 2 * side)?;
        Ok(Self { detector, second: Some(second), ..self }.with_pixels(maps))
    }

    /// For an instrument whose commands reach the mirror at the end of the exposure.
    #[must_use]
    pub fn without_delay(mut self) -> Self {
        self.instrument.control.delay_frames = 0;
        self
    }

    /// The instrument.
    pub fn instrument(&self) -> &Instrument {
        &self.instrument
    }

    /// The law that combines two gates; `None` for one.
    pub fn law(&self) -> Option<&Combination> {
        self.second.as_ref().map(|second| &second.law)
    }

    /// The detector.
    pub fn detector(&self) -> &Detector {
        &self.detector
    }

    /// First column and row of each window.
    pub fn origins(&self) -> &[[u16; 2]] {
        &self.origins
    }

    /// Those of the second gate; `None` for one.
    pub fn second_origins(&self) -> Option<&[[u16; 2]]> {
        self.second.as_ref().map(|second| second.origins.as_slice())
    }

    /// A spot's light at the second gate over its light at the first; `None` for one.
    pub fn second_light(&self) -> Option<f64> {
        self.second.as_ref().map(|second| second.light)
    }

    /// The mask of subapertures.
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// With these maps of the detector in place of those of its description.
    #[must_use]
    pub fn with_pixels(self, maps: PixelMaps) -> Self {
        let PixelMaps { dark_adu, gain, noise_adu, bad } = maps;
        Self { dark_adu, gain, noise_adu, bad, ..self }
    }

    /// With each subaperture's window at the first gate there.
    #[must_use]
    pub fn with_origins(self, origins: Vec<[u16; 2]>) -> Self {
        Self { origins, ..self }
    }

    /// With each window of the second gate there, if there is one.
    #[must_use]
    pub fn with_second_origins(mut self, origins: Vec<[u16; 2]>) -> Self {
        if let Some(second) = &mut self.second {
            second.origins = origins;
        }
        self
    }

    /// With these reference slopes and gains.
    #[must_use]
    pub fn with_slopes(self, slopes: SlopeCalibration) -> Self {
        Self { slopes, ..self }
    }

    /// With these reference slopes and gains of the second gate, if there is one.
    #[must_use]
    pub fn with_second_slopes(mut self, slopes: SlopeCalibration) -> Self {
        if let Some(second) = &mut self.second {
            second.slopes = slopes;
        }
        self
    }

    /// Those of the second gate; `None` for one.
    pub fn second_slopes(&self) -> Option<&SlopeCalibration> {
        self.second.as_ref().map(|second| &second.slopes)
    }

    /// Reference slopes and gains in use.
    pub fn slopes(&self) -> &SlopeCalibration {
        &self.slopes
    }

    /// Which spots are lit, and with how much light.
    pub fn lighting(&self) -> &Lighting {
        &self.lighting
    }

    /// The flux of each whole spot in the frames that light it, calibrated ADU, one gate after the other: what a
    /// measurement made without images claims.
    pub fn nominal_fluxes(&self) -> Vec<u32> {
        let gain = self.instrument.detector.gain_e_per_adu;
        let of_gate = |light: f64| {
            let spots = self.lighting.electrons_per_spot();
            spots.map(move |electrons| (light * electrons / gain) as u32)
        };
        [Some(1.0), self.second_light()].into_iter().flatten().flat_map(of_gate).collect()
    }

    /// The firmware's specification.
    pub fn spec(&self) -> Spec<'_> {
        let Instrument { laser, detector, windows, centroids, control, mirror, schedule, .. } =
            &self.instrument;
        let (side, height) =
            (self.instrument.detector_side() as u16, self.detector.spec().height as u16);
        let (stroke_m, peak_fraction) = (mirror.stroke_m, centroids.peak_fraction);
        Spec {
            mask: self.mask,
            detector: Readout { width: side, height, bits: detector.bits as u8 },
            windows: WindowSpec {
                size: windows.size.min(usize::from(u8::MAX)) as u8,
                origins: &self.origins,
            },
            pixels: PixelSpec {
                dark_adu: Map::Each(&self.dark_adu),
                gain: Map::Each(&self.gain),
                noise_adu: Map::Each(&self.noise_adu),
                threshold_sigma: centroids.threshold_sigma,
                convention: match centroids.threshold {
                    ThresholdName::Subtract => Convention::Subtract,
                    ThresholdName::ZeroBelow => Convention::ZeroBelow,
                },
                bad: &self.bad,
                saturation_adu: None,
            },
            estimator: match centroids.estimator {
                EstimatorName::Plain => Estimator::CentreOfGravity,
                EstimatorName::Thresholded => {
                    Estimator::ThresholdedCentreOfGravity { peak_fraction }
                }
                EstimatorName::Weighted => Estimator::WeightedCentreOfGravity {
                    peak_fraction,
                    fwhm_px: centroids.weight_fwhm_px,
                    gain: centroids.weight_gain,
                },
                EstimatorName::Brightest => Estimator::Brightest { count: centroids.brightest },
            },
            slopes: SlopeSpec {
                reference_px: Map::Each(&self.slopes.reference_px),
                gain_m_per_px: Map::Each(&self.slopes.gain_m_per_px),
                flux_min_adu: Map::Each(&self.flux_limits_adu[0]),
                flux_max_adu: Map::Each(&self.flux_limits_adu[1]),
                mean: MeanSlope::Remove,
            },
            control: ControlSpec {
                gain: Map::Uniform(control.gain),
                lever_arm: self.law().map_or(self.lever_arm, |law| law.lever_arm),
                delay_frames: control.delay_frames,
                global_tilt_max_age: GLOBAL_TILT_MAX_AGE,
            },
            modal: self.second.as_ref().map(|second| ModalSpec {
                origins: &second.origins,
                reference_px: Map::Each(&second.slopes.reference_px),
                gain_m_per_px: Map::Each(&second.slopes.gain_m_per_px),
                flux_min_adu: Map::Each(&second.flux_limits_adu[0]),
                flux_max_adu: Map::Each(&second.flux_limits_adu[1]),
                modes: &second.law.modes,
                coupling: &second.law.coupling,
            }),
            sor: SorSpec {
                sweeps: (control.sweeps > 0).then_some(control.sweeps),
                ..SorSpec::default()
            },
            segments: SegmentSpec {
                stroke_m,
                matrix: Map::Uniform(triangle(mirror.actuator_radius)),
                flat_m: Map::Uniform([stroke_m / 2.0; 3]),
                limits_m: Map::Uniform([[0.0, stroke_m]; 3]),
                slew_m_per_frame: Some(mirror.slew_m_per_frame),
            },
            actuators: ActuatorSpec {
                dac_bits: mirror.dac_bits,
                law: match mirror.response {
                    ResponseName::Linear => Law::Linear,
                    ResponseName::Quadratic => Law::Quadratic,
                },
                response_m: Map::Uniform([[0.0, stroke_m]; 3]),
            },
            gate: GateSpec {
                beacon_height_m: laser.beacon_height_m,
                depth_m: laser.gate_depth_m,
                zenith_angle_deg: laser.zenith_angle_deg,
                pulse_rate_hz: laser.pulse_rate_hz,
                pulses_per_frame: laser.pulses_per_frame,
                readout_s: detector.readout_s,
                short_frame: match self.instrument.gate.short_frames {
                    ShortFrameName::Mark => ShortFrame::Mark,
                    ShortFrameName::Scale => ShortFrame::Scale,
                    ShortFrameName::Drop => ShortFrame::Drop,
                },
            },
            schedule: ScheduleSpec {
                colouring: match schedule.lattice() {
                    Some(lattice) => Colouring::Lattice(lattice),
                    None if self.lighting.count() > 1 => Colouring::List(self.lighting.colours()),
                    None => Colouring::None,
                },
                separation: schedule.separation,
            },
            safety: self.safety(),
            serials: Serials {
                mirror: self.instrument.serials.mirror,
                detector: self.instrument.serials.detector,
            },
        }
    }

    /// Limits of fluxes in ADU.
    fn safety(&self) -> SafetySpec {
        let Instrument { safety, detector, .. } = &self.instrument;
        // A spot that is not lit counts with its last flux.
        let flux_adu = |(spots, electrons)| electrons / detector.gain_e_per_adu * spots as f64;
        let nominal_adu: f64 = self.lighting.groups().map(flux_adu).sum();
        SafetySpec {
            valid_min: safety.valid_min,
            flux_min_adu: safety.flux_min * nominal_adu,
            flux_max_adu: safety.flux_max * nominal_adu,
            saturated_pixels_max: safety.saturated_pixels_max,
            hold_frames: safety.hold_frames,
            safe_frames: safety.safe_frames,
            leak: safety.leak,
            saturated_share: safety.saturated_share,
            saturated_frames: safety.saturated_frames,
        }
    }
}

/// The description's detector with that height, pixels, and what its calibration says of it.
fn detector(instrument: &Instrument, height: usize) -> Result<(Detector, PixelMaps), Error> {
    let section = &instrument.detector;
    let detector = Detector::new(DetectorSpec {
        width: instrument.detector_side(),
        height,
        bits: section.bits,
        gain_e_per_adu: section.gain_e_per_adu,
        read_noise_e: section.read_noise_e,
        dark_e_per_frame: section.dark_e_per_frame,
        bias_adu: section.bias_adu,
        full_well_e: section.full_well_e,
        bad_pixels: section.bad_pixels.clone(),
        response_rms: section.response_rms,
        // One instrument has one detector, whatever the run's seed.
        response_seed: 0,
    })?;
    let Calibration { dark_adu, flat, sigma_adu, bad_pixels } = detector.calibration();
    let width = instrument.detector_side();
    let blind = flat.iter().enumerate().filter(|(_, flat)| **flat < 1.0 / MAX_PIXEL_GAIN);
    let mut bad: Vec<[u16; 2]> = blind
        .map(|(i, _)| [i % width, i / width])
        .chain(bad_pixels)
        .map(|pixel| pixel.map(|i| i as u16))
        .collect();
    bad.sort_unstable_by_key(|&[x, y]| (y, x));
    bad.dedup();
    let maps = PixelMaps {
        dark_adu: dark_adu.into_iter().map(f64::from).collect(),
        gain: flat.into_iter().map(|flat| 1.0 / f64::from(flat)).collect(),
        noise_adu: sigma_adu.into_iter().map(f64::from).collect(),
        bad,
    };
    Ok((detector, maps))
}
