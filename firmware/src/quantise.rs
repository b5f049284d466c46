//! Physical values to the integers of the frame path, each checked on the way.
//!
//! Floats end here. Every conversion uses only +, -, x, /, rounding and `libm`, in one order, so
//! that a board that builds its own configuration gets the integers that a PC gets.

use crate::actuators::{Drive, Response, SLOPE_BITS};
use crate::centroid::EstimatorConfig;
use crate::control::{GAIN_BITS, Gains};
use crate::error::{ConfigError, Field, Limit};
use crate::fixed::{CENTROID_BITS, LENGTH_BITS};
use crate::ladder::LadderLimits;
use crate::modal::{self, COUPLING_BITS, COUPLING_LIMIT, ModalHead};
use crate::pixels::{Convention, PixelCalibration};
use crate::quality::QualityLimits;
use crate::segments::{ACTUATORS, INFLUENCE_BITS, RATIO_BITS, Segment};
use crate::slopes::SlopeCalibration;
use crate::spec::{Estimator, Map, Spec};
use crate::validate;

/// Heights of the scale that a stroke spans, LSB.
const STROKE_LSB: f64 = 65536.0;

/// A specification with the scales that all its conversions share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quantiser<'a> {
    spec: &'a Spec<'a>,
    /// Optical path per height LSB, m.
    pub(crate) lsb_m: f64,
    /// Largest pixel gain: calibrated ADU per unit of signal.
    pub(crate) adu_per_unit: f64,
    /// Exponent of the stored thresholds.
    pub(crate) threshold_shift: u32,
    /// Exponent of the slope gain's mantissas.
    pub(crate) gain_exponent: u32,
    /// Fraction bits of the segments' ratios.
    pub(crate) ratio_bits: u32,
}

/// The slope calibration of a gate, and what its fields are called.
#[derive(Clone, Copy, Debug)]
struct Gate<'a> {
    reference_px: Map<'a, [f64; 2]>,
    gain_m_per_px: Map<'a, [[f64; 2]; 2]>,
    flux_min_adu: Map<'a, f64>,
    flux_max_adu: Map<'a, f64>,
    fields: GateFields,
}

#[derive(Clone, Copy, Debug)]
struct GateFields {
    reference: Field,
    gain: Field,
    flux_min: Field,
    flux_max: Field,
}

/// `2^bits`.
fn power(bits: u32) -> f64 {
    (1u64 << bits) as f64
}

fn round(x: f64) -> f64 {
    libm::floor(x + 0.5)
}

impl<'a> Quantiser<'a> {
    /// The shared scales. The geometry of `spec` has been checked; its maps' lengths have not.
    pub(crate) fn new(spec: &'a Spec<'a>) -> Result<Self, ConfigError> {
        Self::check_lengths(spec)?;
        let stroke_m =
            ConfigError::check(Field::Stroke, None, spec.segments.stroke_m, (1e-9, 1.0))?;
        let mut quantiser = Self {
            spec,
            lsb_m: stroke_m / STROKE_LSB,
            adu_per_unit: 0.0,
            threshold_shift: 0,
            gain_exponent: 0,
            ratio_bits: 0,
        };
        let sigma = spec.pixels.threshold_sigma;
        ConfigError::check(Field::ThresholdSigma, None, sigma, (0.0, 100.0))?;
        let (mut largest, mut threshold) = (0.0f64, 0.0f64);
        quantiser.each_pixel(|index| {
            let pixels = &spec.pixels;
            let field = |field, map: &Map<'_, f64>, limit| {
                let value = map.get(index).unwrap_or(f64::NAN);
                ConfigError::check(field, Some(index), value, limit)
            };
            field(Field::Dark, &pixels.dark_adu, (0.0, 65534.0))?;
            let gain = field(Field::PixelGain, &pixels.gain, (0.25, 4.0))?;
            let noise = field(Field::Noise, &pixels.noise_adu, (0.0, 65534.0))?;
            largest = largest.max(gain);
            threshold = threshold.max(noise * sigma * gain);
            Ok(())
        })?;
        // Without one good pixel there is no gain to divide by; such a detector sees nothing.
        quantiser.adu_per_unit = if largest > 0.0 { largest } else { 1.0 };
        let highest = (threshold / quantiser.adu_per_unit).min(65535.0);
        // At most 8: a u8 shifted by that still is a u16, and 255 x 256 is high enough.
        while highest / power(quantiser.threshold_shift) > 255.0 && quantiser.threshold_shift < 8 {
            quantiser.threshold_shift += 1;
        }
        quantiser.gain_exponent = quantiser.common_exponent()?;
        quantiser.ratio_bits = quantiser.ratio_bits();
        Ok(quantiser)
    }

    /// Refuses maps whose length is not that of what they describe.
    fn check_lengths(spec: &Spec<'_>) -> Result<(), ConfigError> {
        let pixels = usize::from(spec.detector.width) * usize::from(spec.detector.height);
        let subapertures = spec.mask.count();
        let check = |field, len: Option<usize>, expected: usize, rule| match len {
            Some(len) if len != expected => {
                Err(ConfigError::new(field, len as f64, Limit::Rule(rule)))
            }
            _ => Ok(()),
        };
        let pixel = |field, len| check(field, len, pixels, "entries: must be one a detector pixel");
        let each =
            |field, len| check(field, len, subapertures, "entries: must be one a subaperture");
        pixel(Field::Dark, spec.pixels.dark_adu.entries())?;
        pixel(Field::PixelGain, spec.pixels.gain.entries())?;
        pixel(Field::Noise, spec.pixels.noise_adu.entries())?;
        each(Field::WindowOrigin, Some(spec.windows.origins.len()))?;
        each(Field::ReferenceSlope, spec.slopes.reference_px.entries())?;
        each(Field::SlopeGain, spec.slopes.gain_m_per_px.entries())?;
        each(Field::FluxMin, spec.slopes.flux_min_adu.entries())?;
        each(Field::FluxMax, spec.slopes.flux_max_adu.entries())?;
        each(Field::ControlGain, spec.control.gain.entries())?;
        each(Field::SegmentMatrix, spec.segments.matrix.entries())?;
        each(Field::Flat, spec.segments.flat_m.entries())?;
        each(Field::HeightLimits, spec.segments.limits_m.entries())?;
        each(Field::Response, spec.actuators.response_m.entries())?;
        let Some(modal) = &spec.modal else { return Ok(()) };
        each(Field::SecondOrigin, Some(modal.origins.len()))?;
        each(Field::SecondReference, modal.reference_px.entries())?;
        each(Field::SecondGain, modal.gain_m_per_px.entries())?;
        each(Field::SecondFluxMin, modal.flux_min_adu.entries())?;
        each(Field::SecondFluxMax, modal.flux_max_adu.entries())?;
        let modes = validate::modes(spec);
        let rule = "entries: must be one a mode and subaperture";
        check(Field::Modes, Some(modal.modes.len()), modes * subapertures, rule)?;
        let rule = "entries: must be two a mode, of each mode";
        check(Field::Coupling, Some(modal.coupling.len()), 2 * modes * modes, rule)
    }

    /// Calls `visit` with the detector index of every window pixel that is not bad.
    fn each_pixel(
        &self,
        mut visit: impl FnMut(usize) -> Result<(), ConfigError>,
    ) -> Result<(), ConfigError> {
        for origin in self.spec.origins() {
            for (x, y) in self.window(origin).filter(|&(x, y)| !self.is_bad(x, y)) {
                visit(self.index(x, y))?;
            }
        }
        Ok(())
    }

    /// Column and row of every pixel of the window at an origin, row by row.
    pub(crate) fn window(&self, [x0, y0]: [u16; 2]) -> impl Iterator<Item = (u16, u16)> + use<> {
        let size = u16::from(self.spec.windows.size);
        (y0..y0 + size).flat_map(move |y| (x0..x0 + size).map(move |x| (x, y)))
    }

    fn index(&self, x: u16, y: u16) -> usize {
        usize::from(y) * usize::from(self.spec.detector.width) + usize::from(x)
    }

    /// The bad-pixel list is sorted by row, then column.
    fn is_bad(&self, x: u16, y: u16) -> bool {
        self.spec.pixels.bad.binary_search_by_key(&(y, x), |&[bx, by]| (by, bx)).is_ok()
    }

    /// The least exponent under which every slope gain fits a 16-bit mantissa.
    fn common_exponent(&self) -> Result<u32, ConfigError> {
        let rule = Limit::Rule("each entry must be a number, and the matrix invertible");
        let mut largest = 0.0f64;
        for gate in [Some(self.first_gate()), self.second_gate()].into_iter().flatten() {
            for i in 0..self.spec.mask.count() {
                let gain = gate.gain_m_per_px.get(i).unwrap_or([[f64::NAN; 2]; 2]);
                let [[a, b], [c, d]] = gain;
                let determinant = a * d - b * c;
                if !determinant.is_finite() || determinant == 0.0 {
                    return Err(ConfigError::at(gate.fields.gain, i, determinant, rule));
                }
                largest = gain.as_flattened().iter().fold(largest, |m, g| m.max(g.abs()));
            }
        }
        let highest = largest * self.ulp_per_m();
        // A mantissa under the largest exponent that leaves a bit to round on.
        let limit_ulp = 32767.0 * power(15);
        if highest > limit_ulp {
            let limit = Limit::Within(0.0, limit_ulp / self.ulp_per_m());
            return Err(ConfigError::new(Field::SlopeGain, largest, limit));
        }
        let mut exponent = 0;
        while highest / power(exponent) > 32767.0 {
            exponent += 1;
        }
        Ok(exponent)
    }

    /// Length ulp per metre of path.
    pub(crate) fn ulp_per_m(&self) -> f64 {
        power(LENGTH_BITS) / self.lsb_m
    }

    /// The highest raw value, ADU.
    pub(crate) fn top(&self) -> u16 {
        ((1u32 << self.spec.detector.bits) - 1) as u16
    }

    /// The stored calibration of the detector pixel in column `x`, row `y`.
    pub(crate) fn pixel(&self, x: u16, y: u16) -> PixelCalibration {
        let top = self.top();
        if self.is_bad(x, y) {
            return PixelCalibration { floor: top, loss: 0, threshold: 0 };
        }
        let (dark, gain, threshold) = self.pixel_values(x, y);
        let folded = match self.spec.pixels.convention {
            Convention::Subtract => threshold,
            Convention::ZeroBelow => 0.0,
        };
        let relative = gain / self.adu_per_unit;
        let stored = round(threshold * relative / power(self.threshold_shift));
        PixelCalibration {
            // A pixel that no value lifts above its floor is as good as bad.
            floor: round(dark + folded).min(f64::from(top)) as u16,
            loss: round(power(16) * (1.0 - relative)).min(65535.0) as u16,
            threshold: stored.min(255.0) as u8,
        }
    }

    /// Dark (ADU), gain and threshold (raw ADU) of a good pixel.
    fn pixel_values(&self, x: u16, y: u16) -> (f64, f64, f64) {
        let (i, pixels) = (self.index(x, y), &self.spec.pixels);
        let value = |map: &Map<'_, f64>| map.get(i).unwrap_or(0.0);
        let threshold = pixels.threshold_sigma * value(&pixels.noise_adu);
        (value(&pixels.dark_adu), value(&pixels.gain), threshold)
    }

    /// The mean threshold over the good pixels of the window at `origin`, in signal units.
    pub(crate) fn base_threshold(&self, origin: [u16; 2]) -> u16 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (x, y) in self.window(origin).filter(|&(x, y)| !self.is_bad(x, y)) {
            let (_, gain, threshold) = self.pixel_values(x, y);
            sum += threshold * gain / self.adu_per_unit;
            count += 1.0;
        }
        round(if count > 0.0 { sum / count } else { 0.0 }).min(65535.0) as u16
    }

    /// The estimator, and the width of its weight if it has one.
    pub(crate) fn estimator(&self) -> Result<(EstimatorConfig, Option<f64>), ConfigError> {
        let fraction = |value| -> Result<u16, ConfigError> {
            let value = ConfigError::check(Field::PeakFraction, None, value, (0.0, 0.9))?;
            Ok(round(value * power(16)) as u16)
        };
        Ok(match self.spec.estimator {
            Estimator::CentreOfGravity => {
                (EstimatorConfig::CentreOfGravity { peak_fraction: 0 }, None)
            }
            Estimator::ThresholdedCentreOfGravity { peak_fraction } => {
                let peak_fraction = fraction(peak_fraction)?;
                (EstimatorConfig::CentreOfGravity { peak_fraction }, None)
            }
            Estimator::WeightedCentreOfGravity { peak_fraction, fwhm_px, gain } => {
                ConfigError::check(Field::WeightFwhm, None, fwhm_px, (0.5, 64.0))?;
                // 7 is far above what any width of the weight asks for.
                ConfigError::check(Field::WeightGain, None, gain, (1.0 / 4096.0, 7.0))?;
                let peak_fraction = fraction(peak_fraction)?;
                let gain = round(gain * power(12)) as i32;
                (EstimatorConfig::Weighted { peak_fraction, gain }, Some(fwhm_px))
            }
            Estimator::Brightest { count } => {
                let size = f64::from(self.spec.windows.size);
                let limit = (1.0, size * size - 1.0);
                ConfigError::check(Field::BrightestCount, None, f64::from(count), limit)?;
                let bits = u32::from(self.spec.detector.bits);
                (EstimatorConfig::Brightest { n: u32::from(count), bits }, None)
            }
        })
    }

    /// The slope calibration of subaperture `i`.
    pub(crate) fn slope(&self, i: usize) -> Result<SlopeCalibration, ConfigError> {
        self.slope_of(&self.first_gate(), i)
    }

    /// The slope calibration of subaperture `i` in the second gate, if there is one.
    pub(crate) fn second_slope(&self, i: usize) -> Option<Result<SlopeCalibration, ConfigError>> {
        self.second_gate().map(|gate| self.slope_of(&gate, i))
    }

    fn first_gate(&self) -> Gate<'_> {
        let slopes = &self.spec.slopes;
        Gate {
            reference_px: slopes.reference_px,
            gain_m_per_px: slopes.gain_m_per_px,
            flux_min_adu: slopes.flux_min_adu,
            flux_max_adu: slopes.flux_max_adu,
            fields: GateFields {
                reference: Field::ReferenceSlope,
                gain: Field::SlopeGain,
                flux_min: Field::FluxMin,
                flux_max: Field::FluxMax,
            },
        }
    }

    fn second_gate(&self) -> Option<Gate<'_>> {
        self.spec.modal.as_ref().map(|modal| Gate {
            reference_px: modal.reference_px,
            gain_m_per_px: modal.gain_m_per_px,
            flux_min_adu: modal.flux_min_adu,
            flux_max_adu: modal.flux_max_adu,
            fields: GateFields {
                reference: Field::SecondReference,
                gain: Field::SecondGain,
                flux_min: Field::SecondFluxMin,
                flux_max: Field::SecondFluxMax,
            },
        })
    }

    fn slope_of(&self, gate: &Gate<'_>, i: usize) -> Result<SlopeCalibration, ConfigError> {
        let fields = gate.fields;
        let reference = gate.reference_px.get(i).unwrap_or([f64::NAN; 2]);
        for value in reference {
            ConfigError::check(fields.reference, Some(i), value, (-32.0, 32.0))?;
        }
        let top = f64::from(u32::MAX) * self.adu_per_unit;
        let flux = |field, map: &Map<'_, f64>, low| {
            ConfigError::check(field, Some(i), map.get(i).unwrap_or(f64::NAN), (low, top))
        };
        let flux_min = flux(fields.flux_min, &gate.flux_min_adu, 0.0)?;
        let flux_max = flux(fields.flux_max, &gate.flux_max_adu, flux_min)?;
        let gain = gate.gain_m_per_px.get(i).unwrap_or([[0.0; 2]; 2]);
        let mantissa = |g: f64| round(g * self.ulp_per_m() / power(self.gain_exponent)) as i16;
        let gain = gain.map(|row| row.map(mantissa));
        let [[a, b], [c, d]] = gain.map(|row| row.map(i32::from));
        if i64::from(a) * i64::from(d) == i64::from(b) * i64::from(c) {
            let rule = Limit::Rule("ulp per pixel: must be invertible after rounding; too small");
            return Err(ConfigError::at(fields.gain, i, f64::from(a.max(d)), rule));
        }
        Ok(SlopeCalibration {
            reference_q16: reference.map(|r| round(r * power(CENTROID_BITS)) as i32),
            gain,
            flux_min: (round(flux_min / self.adu_per_unit) as u32).max(1),
            flux_max: round(flux_max / self.adu_per_unit) as u32,
        })
    }

    /// How the modes are stored; none without a second gate. Refuses what is no number, or above 1.
    pub(crate) fn modal(&self) -> Result<ModalHead, ConfigError> {
        let Some(modal) = &self.spec.modal else { return Ok(ModalHead::default()) };
        let mut largest = 0.0f64;
        for (i, &q) in modal.modes.as_flattened().iter().enumerate() {
            ConfigError::check(Field::Modes, Some(i / 2), q, (-1.0, 1.0))?;
            largest = largest.max(q.abs());
        }
        let (least, most) = modal::EXPONENTS;
        let exponent = (least..=most).rev().find(|&e| largest * power(e) <= 32_767.0);
        let (modes, exponent) = (validate::modes(self.spec) as u8, exponent.unwrap_or(least) as u8);
        for k in 0..usize::from(modes) {
            for j in 0..usize::from(modes) {
                self.coupling(k, j)?;
            }
        }
        Ok(ModalHead { modes, exponent })
    }

    /// The gradients of the modes at subaperture `i`.
    pub(crate) fn gradients<const K: usize>(&self, head: ModalHead, i: usize) -> [[i16; 2]; K] {
        let mut gradients = [[0; 2]; K];
        let modes = self.spec.modal.map_or(&[][..], |modal| modal.modes);
        let of_mode = modes.chunks_exact(self.spec.mask.count().max(1));
        for (gradient, q) in gradients.iter_mut().zip(of_mode.filter_map(|mode| mode.get(i))) {
            *gradient = q.map(|q| round(q * power(head.exponent.into())) as i16);
        }
        gradients
    }

    /// What mode `k` takes of mode `j` of the first gate's slopes and of their difference.
    pub(crate) fn coupling(&self, k: usize, j: usize) -> Result<[i32; 2], ConfigError> {
        let Some(modal) = &self.spec.modal else { return Ok([0; 2]) };
        let modes = validate::modes(self.spec);
        let at = |j: usize| 2 * modes * k + j;
        let of = |j: usize| modal.coupling.get(at(j)).copied().unwrap_or(f64::NAN);
        let (b1, b2) = (of(j), of(modes + j));
        let limit = (-COUPLING_LIMIT, COUPLING_LIMIT);
        let scaled = |value: f64, j: usize| {
            let value = value / self.spec.control.lever_arm;
            let value = ConfigError::check(Field::Coupling, Some(at(j)), value, limit)?;
            Ok(round(value * power(COUPLING_BITS)) as i32)
        };
        Ok([scaled(b1 + b2, j)?, scaled(b2, modes + j)?])
    }

    /// The control coefficients of subaperture `i`.
    pub(crate) fn gains(&self, i: usize) -> Result<Gains, ConfigError> {
        let control = &self.spec.control;
        let f = ConfigError::check(Field::LeverArm, None, control.lever_arm, (0.5, 1.9))?;
        let g = control.gain.get(i).unwrap_or(f64::NAN);
        // Below 2 after rounding, too: at 2 the command would never settle.
        let q = round(g * power(GAIN_BITS)).min(2.0 * power(GAIN_BITS) - 1.0);
        if !(g > 0.0 && g < 2.0 && q > 0.0) {
            let limit = Limit::Between(0.0, 2.0);
            return Err(ConfigError::at(Field::ControlGain, i, g, limit));
        }
        // From the rounded g, so that with f = 1 the two add up to one exactly.
        Ok(Gains { keep: (power(GAIN_BITS) - q) as i16, take: round(q * f).max(1.0) as i16 })
    }

    /// What a frame must be, and when the ladder is climbed.
    pub(crate) fn safety(&self) -> Result<(QualityLimits, LadderLimits), ConfigError> {
        let safety = &self.spec.safety;
        let check = |field, value, limit| ConfigError::check(field, None, value, limit);
        let share = |field, value: f64| check(field, value, (0.0, 1.0));
        let subapertures = self.spec.mask.count() as f64;
        let valid_min = share(Field::ValidMin, safety.valid_min)? * subapertures;
        let flux_min = check(Field::TotalFluxMin, safety.flux_min_adu, (0.0, f64::MAX))?;
        let flux_max = check(Field::TotalFluxMax, safety.flux_max_adu, (flux_min, f64::INFINITY))?;
        let hold_frames = f64::from(safety.hold_frames);
        check(Field::HoldFrames, hold_frames, (0.0, safety.safe_frames.into()))?;
        let leak = share(Field::Leak, safety.leak)?;
        let saturated = share(Field::SaturatedShare, safety.saturated_share)?;
        let actuators = subapertures * ACTUATORS as f64;
        // Casts saturate: no limit is beyond any flux.
        let units = |adu: f64| round(adu / self.adu_per_unit) as u64;
        let quality = QualityLimits {
            valid_min: libm::ceil(valid_min) as u16,
            flux_min: units(flux_min),
            flux_max: units(flux_max),
            saturated_pixels_max: safety.saturated_pixels_max,
        };
        let ladder = LadderLimits {
            hold_frames: safety.hold_frames,
            safe_frames: safety.safe_frames,
            leak_q16: round(leak * power(16)).min(65535.0) as u16,
            saturated_actuators: libm::floor(saturated * actuators) as u16,
            saturated_frames: safety.saturated_frames,
        };
        Ok((quality, ladder))
    }

    /// The mechanics of segment `i`.
    pub(crate) fn segment(&self, i: usize) -> Result<Segment, ConfigError> {
        let segments = &self.spec.segments;
        let matrix = segments.matrix.get(i).unwrap_or([[f64::NAN; 3]; ACTUATORS]);
        for row in matrix {
            let [piston, tip, tilt] = row;
            ConfigError::check(Field::SegmentMatrix, Some(i), piston, (0.25, 3.999))?;
            for value in [tip, tilt] {
                ConfigError::check(Field::SegmentMatrix, Some(i), value, (-4.0, 3.999))?;
            }
        }
        let determinant = determinant(matrix);
        if determinant.abs() < 1e-3 {
            let rule = Limit::Rule("determinant: the three actuators must not lie on one line");
            return Err(ConfigError::at(Field::SegmentMatrix, i, determinant, rule));
        }
        let heights = self.heights(i)?;
        let lowest = |[piston, ..]: [f64; 3], low: f64, flat: f64| {
            libm::ceil((low - flat) * power(LENGTH_BITS) / piston) as i32
        };
        let highest = |[piston, ..]: [f64; 3], high: f64, flat: f64| {
            libm::floor((high - flat) * power(LENGTH_BITS) / piston) as i32
        };
        let q = |value: f64, bits: u32| round(value * power(bits));
        let ratio = |value: f64, piston: f64| q(value / piston, self.ratio_bits) as i16;
        let ([m0, m1, m2], [h0, h1, h2]) = (matrix, heights);
        let rows = [(m0, h0), (m1, h1), (m2, h2)];
        Ok(Segment {
            ratios: matrix.map(|[piston, tip, tilt]| [ratio(tip, piston), ratio(tilt, piston)]),
            influence: matrix.map(|[piston, ..]| libm::ceil(piston * power(INFLUENCE_BITS)) as u16),
            lowest: rows.map(|(row, [low, _, flat])| lowest(row, low, flat)),
            highest: rows.map(|(row, [_, high, flat])| highest(row, high, flat)),
        })
    }

    /// Lowest, highest and flat height of each actuator of segment `i`, whole LSB above its zero.
    fn heights(&self, i: usize) -> Result<[[f64; 3]; ACTUATORS], ConfigError> {
        let segments = &self.spec.segments;
        let limits = segments.limits_m.get(i).unwrap_or([[f64::NAN; 2]; ACTUATORS]);
        let flats = segments.flat_m.get(i).unwrap_or([f64::NAN; ACTUATORS]);
        let mut heights = [[0.0; 3]; ACTUATORS];
        for ((heights, [low, high]), flat) in heights.iter_mut().zip(limits).zip(flats) {
            let check = |field, value, limit| ConfigError::check(field, Some(i), value, limit);
            check(Field::HeightLimits, low, (0.0, segments.stroke_m))?;
            check(Field::HeightLimits, high, (low, segments.stroke_m))?;
            // Inwards, so that no code leaves what the limits allow.
            let low_lsb = libm::ceil(low / self.lsb_m);
            let high_lsb = libm::floor(high / self.lsb_m).min(STROKE_LSB - 1.0);
            let flat_lsb = round(flat / self.lsb_m);
            let room = (low_lsb * self.lsb_m, high_lsb * self.lsb_m);
            if !(flat_lsb >= low_lsb && flat_lsb <= high_lsb) {
                check(Field::Flat, flat, room)?;
                return Err(ConfigError::at(Field::Flat, i, flat, Limit::Within(room.0, room.1)));
            }
            *heights = [low_lsb, high_lsb, flat_lsb];
        }
        Ok(heights)
    }

    /// The most fraction bits with which every ratio of a segment matrix fits 16 bits.
    fn ratio_bits(&self) -> u32 {
        let mut largest = 0.0f64;
        for i in 0..self.spec.mask.count() {
            for [piston, tip, tilt] in self.spec.segments.matrix.get(i).unwrap_or_default() {
                largest = largest.max((tip / piston).abs()).max((tilt / piston).abs());
            }
        }
        let (least, most) = RATIO_BITS;
        // Values that no matrix may have are refused with their segment.
        (least..=most).rev().find(|&bits| largest * power(bits) < 32_767.0).unwrap_or(least)
    }

    /// The slew limit, ulp per frame.
    pub(crate) fn slew_ulp(&self) -> Result<i32, ConfigError> {
        let stroke = self.spec.segments.stroke_m;
        match self.spec.segments.slew_m_per_frame {
            // No motion within the stroke is longer than this.
            None => Ok(i32::MAX),
            Some(slew) => {
                // At 1 LSB a move over the whole stroke still has a step of 2^-16 of itself.
                let limit = (self.lsb_m, stroke);
                let slew = ConfigError::check(Field::Slew, None, slew, limit)?;
                Ok(round(slew * self.ulp_per_m()) as i32)
            }
        }
    }

    /// The responses of segment `i`'s actuators.
    pub(crate) fn responses(&self, i: usize) -> Result<[Response; ACTUATORS], ConfigError> {
        let actuators = &self.spec.actuators;
        let bits = f64::from(actuators.dac_bits);
        ConfigError::check(Field::DacBits, None, bits, (8.0, 16.0))?;
        // Codes with fewer bits have a fraction, up to 16 bits in all.
        let spare = 16u32.saturating_sub(u32::from(actuators.dac_bits));
        let full_v = Drive { law: actuators.law, spare_bits: spare }.full();
        let ends = actuators.response_m.get(i).unwrap_or([[f64::NAN; 2]; ACTUATORS]);
        let mut responses = [Response { offset: 0, slope: 0 }; ACTUATORS];
        let heights = self.heights(i)?;
        let matrix = self.spec.segments.matrix.get(i).unwrap_or_default();
        let mirror = heights.into_iter().zip(matrix);
        let places = responses.iter_mut().zip(ends);
        for ((response, [zero, full]), ([low, high, flat], [influence, ..])) in places.zip(mirror) {
            let stroke = self.spec.segments.stroke_m;
            let span = (full - zero).abs();
            let rule = Limit::Rule(
                "m from code 0 to the highest: must be 1/4 to 64 times segments.stroke_m",
            );
            if !(span >= stroke / 4.0 && span <= 64.0 * stroke) {
                return Err(ConfigError::at(Field::Response, i, span, rule));
            }
            let v = |height_lsb: f64| full_v * (height_lsb * self.lsb_m - zero) / (full - zero);
            for lsb in [low, high] {
                let reached = v(lsb) / full_v;
                // Half an LSB of a 16-bit scale outside is rounding, not a range that is missing.
                if !(-1.0 / 131_072.0..=1.0 + 1.0 / 131_072.0).contains(&reached) {
                    let rule = Limit::Rule(
                        "of the response needed at a height limit: must be from 0 to 1",
                    );
                    return Err(ConfigError::at(Field::Response, i, reached, rule));
                }
            }
            let slope = (v(STROKE_LSB) - v(0.0)) / STROKE_LSB * power(SLOPE_BITS - LENGTH_BITS);
            *response =
                Response { offset: round(v(flat)) as i32, slope: round(slope * influence) as i32 };
        }
        Ok(responses)
    }
}

fn determinant([[a, b, c], [d, e, f], [g, h, i]]: [[f64; 3]; 3]) -> f64 {
    a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
}
