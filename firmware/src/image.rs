//! The configuration as bytes: what a PC built from physical values, for a board to load.
//!
//! ```text
//! "SPLI"  version u16                              little-endian, as everything below
//! rows of the mask, N u64, after the calibration   bit x of row y is the cell (x, y)
//! head, calibration, slots, subapertures           postcard, each after its length (u8)
//! template, floors u16, losses u16, thresholds u8  in the bank's order
//! CRC-32 (ISO-HDLC) of all before
//! ```
//!
//! One gate makes an image of version 2, as ever; two make one of version 3, in which there are also
//!
//! ```text
//! how modes are stored                             postcard, between calibration and rows
//! second gate's subapertures                       postcard, behind subapertures, as what follows
//! gradients i16, subaperture by subaperture        x and y of each mode
//! C i32, row by row                                of a and b of each mode
//! ```
//!
//! What follows from the mask (grid, links, components, relaxation steps) is not in the image but
//! computed again. Every number is checked against the bounds that the frame path relies on; an image
//! that breaks one leaves a configuration without subapertures, which holds every frame.

use crate::actuators::{Drive, Response};
use crate::centroid::{EstimatorConfig, MAX_WINDOW, MIN_WINDOW};
use crate::config::{Config, Slot};
use crate::control::{ControlConfig, Gains, MAX_DELAY};
use crate::error::{ConfigError, Field, Limit};
use crate::gate::{GateTiming, Range, ShortFrame};
use crate::geometry::Mask;
use crate::ladder::LadderLimits;
use crate::loader::Loader;
use crate::mirror::Serials;
use crate::pixels::Convention;
use crate::quality::QualityLimits;
use crate::schedule;
use crate::segments::{ACTUATORS, RATIO_BITS, Segment, Travel};
use crate::slopes::SlopeCalibration;
use crate::spec::SorSpec;
use crate::validate;
use core::fmt;
use serde::{Deserialize, Serialize};

pub(crate) const MAGIC: [u8; 4] = *b"SPLI";
/// Version of the layout with one gate.
pub const VERSION: u16 = 2;
/// With two.
pub const VERSION_TWO_GATES: u16 = 3;
pub(crate) const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
/// Longest record, bytes: its length is one byte.
pub(crate) const RECORD: usize = u8::MAX as usize;

/// Why an image was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ImageError {
    /// The bytes ended early.
    Cut,
    /// It does not start as an image does.
    NotAnImage,
    /// It is of another version.
    Version {
        /// What it has.
        found: u16,
    },
    /// A record cannot be read.
    Malformed,
    /// The checksum is not that of the bytes.
    Checksum,
    /// A value is out of its limits, or does not fit this board.
    Refused(ConfigError),
}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cut => f.write_str("configuration image ends early"),
            Self::NotAnImage => f.write_str("not a configuration image"),
            Self::Version { found } => {
                write!(
                    f,
                    "configuration image of version {found}, must be {VERSION} or {VERSION_TWO_GATES}"
                )
            }
            Self::Malformed => f.write_str("configuration image has an unreadable record"),
            Self::Checksum => f.write_str("configuration image has a wrong checksum"),
            Self::Refused(error) => write!(f, "configuration image: {error}"),
        }
    }
}

impl core::error::Error for ImageError {}

impl From<ConfigError> for ImageError {
    fn from(error: ConfigError) -> Self {
        Self::Refused(error)
    }
}

/// Everything that is there once.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Head {
    /// N, subapertures across the pupil.
    pub across: u8,
    /// Pixels in a detector row.
    pub width: u16,
    /// Rows in a frame.
    pub height: u16,
    /// W, pixels on a side of a window.
    pub window: u8,
    /// Bits of a raw pixel.
    pub bits: u8,
    /// How a window becomes a centroid.
    pub estimator: EstimatorConfig,
    /// Binary exponent of the slope gains' mantissas, 0 to 15.
    pub gain_exponent: u32,
    /// The control law beside its gains.
    pub control: ControlConfig,
    /// Frames after which an unrenewed global tilt counts as stale.
    pub tilt_max_age: u32,
    /// Relaxation factor, 1 to 1.99.
    pub omega: f64,
    /// Sweeps of a warm frame, 1 to 1000.
    pub sweeps: u16,
    /// Sweeps of the first frame after a reset, 1 to 10000.
    pub cold_sweeps: u16,
    /// Fraction bits of the segments' ratios, 10 to 15.
    pub ratio_bits: u32,
    /// Greatest motion of any actuator, ulp of its height per frame.
    pub slew_ulp: i32,
    /// What all actuators share.
    pub drive: Drive,
    /// The gate's and the frame's timing.
    pub timing: GateTiming,
    /// The range that is gated at the start.
    pub range: Range,
    /// What becomes of a frame with fewer laser pulses.
    pub short_frame: ShortFrame,
    /// What a frame must be to be followed.
    pub quality: QualityLimits,
    /// When the ladder is climbed.
    pub ladder: LadderLimits,
    /// The mirror and the detector it is for.
    pub serials: Serials,
    /// Optical path per height LSB, m.
    pub lsb_m: f64,
    /// Calibrated ADU per unit of flux and peak.
    pub adu_per_unit: f64,
    /// What a threshold does.
    pub convention: Convention,
    /// Binary exponent of the stored thresholds, 0 to 8.
    pub threshold_shift: u32,
    /// Raw value from which a pixel counts as saturated, ADU.
    pub saturation: u16,
}

/// Everything that is there once a subaperture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Subaperture {
    /// Mean fixed threshold of its window, signal units.
    pub base_threshold: u16,
    /// Its slope calibration.
    pub slope: SlopeCalibration,
    /// Its control coefficients.
    pub gains: Gains,
    /// The sub-cycle that lights it.
    pub colour: u8,
    /// Its segment's mechanics.
    pub segment: Segment,
    /// Its actuators' responses.
    pub responses: [Response; ACTUATORS],
}

/// Everything that there is once a subaperture for a second gate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SecondGate {
    /// Mean fixed threshold of its window, signal units.
    pub base_threshold: u16,
    /// Its slope calibration.
    pub slope: SlopeCalibration,
}

/// Bytes on their way out, and their checksum.
struct Writer<'a> {
    write: &'a mut dyn FnMut(&[u8]),
    digest: crc::Digest<'static, u32>,
}

impl Writer<'_> {
    fn bytes(&mut self, bytes: &[u8]) {
        self.digest.update(bytes);
        (self.write)(bytes);
    }

    fn record(&mut self, value: &impl Serialize) {
        let mut buffer = [0; RECORD];
        // The largest record takes less than half of the buffer.
        if let Ok(used) = postcard::to_slice(value, &mut buffer) {
            self.bytes(&[used.len() as u8]);
            self.bytes(used);
        }
    }
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Config<M, P, B, K> {
    /// Hands the image of this configuration to `write`, piece by piece; nothing before the first
    /// build.
    pub fn save(&self, write: &mut dyn FnMut(&[u8])) {
        let Some(mask) = &self.mask else { return };
        let mut out = Writer { write, digest: CRC.digest() };
        out.bytes(&MAGIC);
        let two_gates = self.modal.is_on();
        out.bytes(&if two_gates { VERSION_TWO_GATES } else { VERSION }.to_le_bytes());
        out.record(&self.head(mask));
        out.record(&self.calibrated);
        if two_gates {
            out.record(&self.modal.head);
        }
        mask.rows().iter().for_each(|row| out.bytes(&row.to_le_bytes()));
        self.slots.iter().for_each(|slot| out.record(slot));
        for i in 0..self.subapertures() {
            if let Some(entry) = self.subaperture(i) {
                out.record(&entry);
            }
        }
        if two_gates {
            self.save_second_gate(&mut out);
        }
        self.template.samples.iter().for_each(|samples| out.bytes(samples));
        self.bank.floors().iter().for_each(|floor| out.bytes(&floor.to_le_bytes()));
        self.bank.losses().iter().for_each(|loss| out.bytes(&loss.to_le_bytes()));
        out.bytes(self.bank.thresholds());
        let checksum = out.digest.clone().finalize();
        out.bytes(&checksum.to_le_bytes());
    }

    fn save_second_gate(&self, out: &mut Writer<'_>) {
        for i in 0..self.subapertures() {
            if let Some(entry) = self.second_gate(i) {
                out.record(&entry);
            }
        }
        for i in 0..self.subapertures() {
            let gradients = self.modal.of(i).as_flattened();
            gradients.iter().for_each(|entry| out.bytes(&entry.to_le_bytes()));
        }
        for row in self.modal.rows() {
            row.as_flattened().iter().for_each(|entry| out.bytes(&entry.to_le_bytes()));
        }
    }

    /// The record of what is there once.
    pub(crate) fn head(&self, mask: &Mask) -> Head {
        Head {
            across: mask.across() as u8,
            width: self.width,
            height: self.height,
            window: self.window as u8,
            bits: self.bits,
            estimator: self.estimator,
            gain_exponent: self.gain_exponent,
            control: self.control,
            tilt_max_age: self.tilt_max_age,
            omega: self.omega,
            sweeps: self.sor.warm_sweeps,
            cold_sweeps: self.sor.cold_sweeps,
            ratio_bits: self.travel.ratio_bits,
            slew_ulp: self.travel.slew_ulp,
            drive: self.drive,
            timing: self.timing,
            range: self.range,
            short_frame: self.short_frame,
            quality: self.quality,
            ladder: self.ladder,
            serials: self.serials,
            lsb_m: self.lsb_m,
            adu_per_unit: self.adu_per_unit,
            convention: self.bank.convention,
            threshold_shift: self.bank.threshold_shift,
            saturation: self.bank.saturation,
        }
    }

    /// The record of subaperture `i`.
    pub(crate) fn subaperture(&self, i: usize) -> Option<Subaperture> {
        Some(Subaperture {
            base_threshold: *self.base_thresholds.get(i)?,
            slope: *self.slopes.get(i)?,
            gains: (*self.changes.get(self.nodes.get(i)?.place)?).into(),
            colour: *self.schedule.colours.get(i)?,
            segment: *self.segments.get(i)?,
            responses: *self.responses.get(i)?,
        })
    }

    /// The record of subaperture `i` in the second gate.
    pub(crate) fn second_gate(&self, i: usize) -> Option<SecondGate> {
        let window = self.second_window(i)?;
        Some(SecondGate {
            base_threshold: *self.base_thresholds.get(window)?,
            slope: *self.slopes.get(window)?,
        })
    }

    /// The place of subaperture `i` of the second gate among all windows.
    pub(crate) fn second_window(&self, i: usize) -> Option<usize> {
        let there = self.modal.is_on() && i < self.subapertures();
        there.then(|| self.subapertures() + i)
    }

    /// Loads an image in place; `read` fills what it is given, or returns `false` if it cannot.
    ///
    /// # Errors
    /// An [`ImageError`]; the configuration then has no subapertures and holds every frame, since an
    /// image is larger than what a board could keep beside its banks.
    pub fn load(&mut self, read: &mut dyn FnMut(&mut [u8]) -> bool) -> Result<(), ImageError> {
        let mut loader = Loader::new();
        let mut buffer = [0; RECORD];
        loop {
            let bytes = buffer.get_mut(..loader.wanted()).unwrap_or_default();
            if !read(bytes) {
                self.forget();
                return Err(ImageError::Cut);
            }
            if loader.push(self, bytes)?.is_some() {
                return Ok(());
            }
        }
    }

    /// Takes the record of what is there once, for so many subapertures.
    pub(crate) fn set_head(&mut self, head: &Head, count: usize) -> Result<(), ConfigError> {
        let check = |field, value: f64, limit| ConfigError::check(field, None, value, limit);
        let capacity = libm::floor(libm::sqrt(M as f64));
        check(Field::Across, head.across.into(), (4.0, capacity))?;
        check(Field::Subapertures, count as f64, (1.0, M as f64))?;
        let windows = count * self.modal.gates();
        check(Field::Windows, windows as f64, (1.0, M as f64))?;
        check(Field::DetectorWidth, head.width.into(), (1.0, 4096.0))?;
        check(Field::DetectorHeight, head.height.into(), (1.0, 4096.0))?;
        check(Field::DetectorBits, head.bits.into(), (8.0, 16.0))?;
        let window = f64::from(head.window);
        check(Field::WindowSize, window, (MIN_WINDOW as f64, MAX_WINDOW as f64))?;
        let pixels = windows as f64 * window * window;
        check(Field::WindowPixels, pixels, (1.0, P as f64))?;
        match head.estimator {
            EstimatorConfig::CentreOfGravity { .. } => {}
            EstimatorConfig::Weighted { gain, .. } => {
                // 7 in Q12, see `centroid::unweighted`.
                check(Field::WeightGain, gain.into(), (1.0, 7.0 * 4096.0))?;
            }
            EstimatorConfig::Brightest { n, bits } => {
                check(Field::BrightestCount, n.into(), (1.0, window * window - 1.0))?;
                check(Field::DetectorBits, bits.into(), (1.0, 16.0))?;
            }
        }
        check(Field::SlopeGain, head.gain_exponent.into(), (0.0, 15.0))?;
        check(Field::DelayFrames, head.control.delay.into(), (0.0, MAX_DELAY as f64))?;
        check(Field::Omega, head.omega, (1.0, 1.99))?;
        check(Field::Sweeps, head.sweeps.into(), (1.0, 1000.0))?;
        check(Field::ColdSweeps, head.cold_sweeps.into(), (1.0, 10_000.0))?;
        let (least, most) = RATIO_BITS;
        check(Field::SegmentMatrix, head.ratio_bits.into(), (least.into(), most.into()))?;
        check(Field::Slew, head.slew_ulp.into(), (1.0, i32::MAX.into()))?;
        check(Field::DacBits, 16.0 - f64::from(head.drive.spare_bits), (8.0, 16.0))?;
        let timing = head.timing;
        let gate = f64::from(timing.delay_ns) + f64::from(timing.width_ns);
        check(Field::GateEnd, gate, (0.0, timing.period_ns.into()))?;
        check(Field::PulsesPerFrame, timing.pulses_per_frame.into(), (1.0, 1e6))?;
        let quality = head.quality;
        check(Field::ValidMin, quality.valid_min.into(), (0.0, count as f64))?;
        check(Field::TotalFluxMin, quality.flux_min as f64, (0.0, quality.flux_max as f64))?;
        let hold = f64::from(head.ladder.hold_frames);
        check(Field::HoldFrames, hold, (0.0, head.ladder.safe_frames.into()))?;
        check(Field::Stroke, head.lsb_m, (f64::MIN_POSITIVE, 1.0))?;
        check(Field::PixelGain, head.adu_per_unit, (0.25, 4.0))?;
        check(Field::Noise, head.threshold_shift.into(), (0.0, 8.0))?;
        let top = ((1u32 << head.bits) - 1) as u16;
        check(Field::Saturation, head.saturation.into(), (1.0, top.into()))?;
        self.width = head.width;
        self.height = head.height;
        self.window = usize::from(head.window);
        self.bits = head.bits;
        self.estimator = head.estimator;
        self.set_gain_exponent(head.gain_exponent);
        self.control = head.control;
        self.tilt_max_age = head.tilt_max_age;
        self.drive = head.drive;
        self.timing = timing;
        self.range = head.range;
        self.short_frame = head.short_frame;
        self.quality = quality;
        self.ladder = head.ladder;
        self.serials = head.serials;
        self.travel.ratio_bits = head.ratio_bits;
        self.travel.slew_ulp = head.slew_ulp;
        self.omega = head.omega;
        self.sor.warm_sweeps = head.sweeps;
        self.sor.cold_sweeps = head.cold_sweeps;
        self.lsb_m = head.lsb_m;
        self.adu_per_unit = head.adu_per_unit;
        self.bank.convention = head.convention;
        self.bank.threshold_shift = head.threshold_shift;
        self.bank.top = top;
        self.bank.saturation = head.saturation;
        Ok(())
    }

    /// Slots come in readout order, each window once, a subaperture's second after its first.
    pub(crate) fn load_slot(&mut self, slot: Slot) -> Result<(), ConfigError> {
        let (index, count) = (self.slots.len(), self.nodes.len() * self.modal.gates());
        let refuse = |value: u16, limit| {
            Err(ConfigError::at(Field::WindowOrigin, index, f64::from(value), limit))
        };
        for (origin, room) in [(slot.x0, self.width), (slot.y0, self.height)] {
            if usize::from(origin) + self.window > usize::from(room) {
                return refuse(origin, Limit::Within(0.0, f64::from(room) - self.window as f64));
            }
        }
        if self.slots.last().is_some_and(|last| (last.y0, last.x0) >= (slot.y0, slot.x0)) {
            return refuse(slot.x0, Limit::Rule("must be sorted by row, then column"));
        }
        let known = |subaperture| self.slots.iter().any(|other| other.subaperture == subaperture);
        if known(slot.subaperture) || usize::from(slot.subaperture) >= count {
            return refuse(slot.subaperture, Limit::Rule("must be each subaperture once"));
        }
        let subapertures = self.nodes.len() as u16;
        let first = slot.subaperture.checked_sub(subapertures);
        if first.is_some_and(|first| !known(first)) {
            return refuse(slot.y0, validate::SECOND_COMES_LATER);
        }
        let _ = self.slots.push(slot);
        Ok(())
    }

    pub(crate) fn load_subaperture(&mut self, entry: Subaperture) -> Result<(), ConfigError> {
        let i = self.slopes.len();
        entry.check(i, self.drive)?;
        let Subaperture { base_threshold, slope, gains, colour, segment, responses } = entry;
        let _ = self.base_thresholds.push(base_threshold);
        let _ = self.slopes.push(slope);
        self.set_gains(i, gains);
        let _ = self.schedule.colours.push(colour);
        let _ = self.segments.push(segment);
        let _ = self.responses.push(responses);
        Ok(())
    }

    pub(crate) fn load_second_gate(&mut self, entry: SecondGate) -> Result<(), ConfigError> {
        entry.check(self.slopes.len().saturating_sub(self.subapertures()))?;
        let _ = self.base_thresholds.push(entry.base_threshold);
        let _ = self.slopes.push(entry.slope);
        Ok(())
    }

    /// What follows from several records, and what has to hold between them: the end of a change.
    pub(crate) fn settle(&mut self, mask: &Mask) -> Result<(), ConfigError> {
        let top = self.bank.top;
        if let Some(i) = self.bank.floors().iter().position(|&floor| floor > top) {
            let limit = Limit::Rule("floor: must not be above the highest raw value");
            return Err(ConfigError::at(Field::Dark, i, f64::from(top), limit));
        }
        self.find_order();
        self.find_bounds();
        let origins = self.slots.iter().map(|slot| [slot.x0, slot.y0]);
        self.concurrent = validate::buffer::<B>(&self.estimator, self.window as u16, origins)?;
        schedule::check_used(self.schedule.colours.iter().copied())?;
        self.schedule.count_colours();
        if self.modal.is_on() {
            self.modal.check(mask.count())?;
            if self.schedule.is_partial() {
                let modes = f64::from(self.modal.head.modes);
                return Err(ConfigError::new(Field::Modes, modes, validate::NO_SCHEDULE));
            }
        }
        let Travel { ratio_bits, slew_ulp, .. } = self.travel;
        self.fill_mirror(ratio_bits, slew_ulp);
        let spec = SorSpec {
            omega: Some(self.omega),
            sweeps: Some(self.sor.warm_sweeps),
            cold_sweeps: Some(self.sor.cold_sweeps),
        };
        self.fill_sor(mask.across(), &spec);
        Ok(())
    }
}

impl Subaperture {
    /// Refuses what breaks the bounds of the frame path, for subaperture `i` of a mirror with this `drive`.
    pub(crate) fn check(&self, i: usize, drive: Drive) -> Result<(), ConfigError> {
        let check = |field, value: f64, limit| ConfigError::check(field, Some(i), value, limit);
        let Self { slope, gains, segment, responses, .. } = self;
        check_slope(slope, i, Field::ReferenceSlope, Field::FluxMin)?;
        // 1 - g and g f in Q13, 0 < g < 2.
        check(Field::ControlGain, gains.keep.into(), (-8191.0, 8191.0))?;
        check(Field::LeverArm, gains.take.into(), (1.0, f64::from(i16::MAX)))?;
        segment.check(i)?;
        for (a, response) in responses.iter().enumerate() {
            let ends = [&segment.lowest, &segment.highest].map(|ends| ends.get(a));
            for height in ends.into_iter().flatten() {
                // Half an LSB of a code, 2^14, is rounding of a limit, and half as much again that of the line. The
                // code after the highest, which would be taken for 0, begins at 2^15.
                let limit = (-24_576.0, drive.full() + 24_576.0);
                check(Field::Response, response.value(*height) as f64, limit)?;
            }
        }
        Ok(())
    }
}

impl SecondGate {
    /// As [`Subaperture::check`].
    pub(crate) fn check(&self, i: usize) -> Result<(), ConfigError> {
        check_slope(&self.slope, i, Field::SecondReference, Field::SecondFluxMin)
    }
}

fn check_slope(
    slope: &SlopeCalibration,
    i: usize,
    reference: Field,
    flux: Field,
) -> Result<(), ConfigError> {
    let limit = f64::from(1u32 << 21);
    for value in slope.reference_q16 {
        ConfigError::check(reference, Some(i), value.into(), (-limit, limit))?;
    }
    let limit = (1.0, slope.flux_max.into());
    ConfigError::check(flux, Some(i), slope.flux_min.into(), limit).map(|_| ())
}
