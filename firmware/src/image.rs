//! The configuration as bytes: what a PC built from physical values, for a board to load.
//!
//! ```text
//! "SPLI"  version u16                              little-endian, as everything below
//! rows of the mask, N u64, after the head          bit x of row y is the cell (x, y)
//! head, slots, subapertures                        postcard, each after its length (u8)
//! template, floors u16, losses u16, thresholds u8  in the bank's order
//! CRC-32 (ISO-HDLC) of all before
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

const MAGIC: [u8; 4] = *b"SPLI";
/// Version of the layout.
pub const VERSION: u16 = 2;
const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
/// Longest record, bytes: its length is one byte.
const RECORD: usize = u8::MAX as usize;
/// Bytes of the pixel maps that are moved at once.
const PIECE: usize = 64;

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
                write!(f, "configuration image of version {found}, must be {VERSION}")
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
#[derive(Serialize, Deserialize)]
struct Head {
    across: u8,
    width: u16,
    height: u16,
    window: u8,
    bits: u8,
    estimator: EstimatorConfig,
    gain_exponent: u32,
    control: ControlConfig,
    tilt_max_age: u32,
    omega: f64,
    sweeps: u16,
    cold_sweeps: u16,
    ratio_bits: u32,
    slew_ulp: i32,
    drive: Drive,
    timing: GateTiming,
    range: Range,
    short_frame: ShortFrame,
    quality: QualityLimits,
    ladder: LadderLimits,
    serials: Serials,
    lsb_m: f64,
    adu_per_unit: f64,
    convention: Convention,
    threshold_shift: u32,
    saturation: u16,
}

/// Everything that is there once a subaperture.
#[derive(Serialize, Deserialize)]
struct Subaperture {
    base_threshold: u16,
    slope: SlopeCalibration,
    gains: Gains,
    colour: u8,
    segment: Segment,
    responses: [Response; ACTUATORS],
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

/// Bytes on their way in, and their checksum.
struct Reader<'a> {
    read: &'a mut dyn FnMut(&mut [u8]) -> bool,
    digest: crc::Digest<'static, u32>,
}

impl Reader<'_> {
    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), ImageError> {
        if !(self.read)(bytes) {
            return Err(ImageError::Cut);
        }
        self.digest.update(bytes);
        Ok(())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], ImageError> {
        let mut bytes = [0; N];
        self.fill(&mut bytes)?;
        Ok(bytes)
    }

    fn record<T: for<'de> Deserialize<'de>>(&mut self) -> Result<T, ImageError> {
        let [length] = self.array()?;
        let mut buffer = [0; RECORD];
        let bytes = buffer.get_mut(..usize::from(length)).ok_or(ImageError::Malformed)?;
        self.fill(bytes)?;
        match postcard::take_from_bytes(bytes) {
            Ok((value, [])) => Ok(value),
            _ => Err(ImageError::Malformed),
        }
    }

    /// Calls `take` with `count` bytes, piece by piece; pieces are whole words.
    fn pieces(&mut self, count: usize, mut take: impl FnMut(&[u8])) -> Result<(), ImageError> {
        let mut left = count;
        while left > 0 {
            let mut buffer = [0; PIECE];
            let piece = buffer.get_mut(..left.min(PIECE)).unwrap_or_default();
            self.fill(piece)?;
            left -= piece.len();
            take(piece);
        }
        Ok(())
    }
}

impl<const M: usize, const P: usize, const B: usize> Config<M, P, B> {
    /// Hands the image of this configuration to `write`, piece by piece; nothing before the first
    /// build.
    pub fn save(&self, write: &mut dyn FnMut(&[u8])) {
        let Some(mask) = &self.mask else { return };
        let mut out = Writer { write, digest: CRC.digest() };
        out.bytes(&MAGIC);
        out.bytes(&VERSION.to_le_bytes());
        out.record(&Head {
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
        });
        mask.rows().iter().for_each(|row| out.bytes(&row.to_le_bytes()));
        self.slots.iter().for_each(|slot| out.record(slot));
        let gains = self.nodes.iter().filter_map(|node| self.gains.get(node.place));
        let gains = gains.zip(&self.schedule.colours);
        let slopes = self.base_thresholds.iter().zip(&self.slopes).zip(gains);
        let mirror = self.segments.iter().zip(&self.responses);
        for (((&base_threshold, &slope), (&gains, &colour)), (&segment, &responses)) in
            slopes.zip(mirror)
        {
            out.record(&Subaperture { base_threshold, slope, gains, colour, segment, responses });
        }
        self.template.samples.iter().for_each(|samples| out.bytes(samples));
        self.bank.floors().iter().for_each(|floor| out.bytes(&floor.to_le_bytes()));
        self.bank.losses().iter().for_each(|loss| out.bytes(&loss.to_le_bytes()));
        out.bytes(self.bank.thresholds());
        let checksum = out.digest.clone().finalize();
        out.bytes(&checksum.to_le_bytes());
    }

    /// Loads an image in place; `read` fills what it is given, or returns `false` if it cannot.
    ///
    /// # Errors
    /// An [`ImageError`]; the configuration then has no subapertures and holds every frame, since an
    /// image is larger than what a board could keep beside its banks.
    pub fn load(&mut self, read: &mut dyn FnMut(&mut [u8]) -> bool) -> Result<(), ImageError> {
        let loaded = self.load_all(&mut Reader { read, digest: CRC.digest() });
        if loaded.is_err() {
            self.forget();
        }
        loaded
    }

    fn load_all(&mut self, from: &mut Reader<'_>) -> Result<(), ImageError> {
        if from.array()? != MAGIC {
            return Err(ImageError::NotAnImage);
        }
        let found = u16::from_le_bytes(from.array()?);
        if found != VERSION {
            return Err(ImageError::Version { found });
        }
        let head: Head = from.record()?;
        let mut rows = [0; crate::geometry::MAX_ACROSS];
        for row in rows.iter_mut().take(usize::from(head.across)) {
            *row = u64::from_le_bytes(from.array()?);
        }
        let bit = |x: usize, y: usize| rows.get(y).is_some_and(|row| (row >> x) & 1 == 1);
        let mask = Mask::from_fn(head.across.into(), bit)?;
        self.forget();
        self.load_head(&head, &mask)?;
        self.fill_nodes(&mask);
        for _ in 0..mask.count() {
            self.load_slot(from.record()?, mask.count())?;
        }
        for i in 0..mask.count() {
            self.load_subaperture(i, from.record()?)?;
        }
        schedule::check_used(self.schedule.colours.iter().copied())?;
        self.schedule.count_colours();
        for samples in &mut self.template.samples {
            from.fill(samples)?;
        }
        let pixels = mask.count() * self.window * self.window;
        let bank = &mut self.bank;
        let words = |piece: &[u8], push: &mut dyn FnMut(u16)| {
            piece.as_chunks().0.iter().for_each(|&word| push(u16::from_le_bytes(word)));
        };
        from.pieces(2 * pixels, |piece| words(piece, &mut |floor| bank.push_floor(floor)))?;
        from.pieces(2 * pixels, |piece| words(piece, &mut |loss| bank.push_loss(loss)))?;
        from.pieces(pixels, |piece| piece.iter().for_each(|&t| bank.push_threshold(t)))?;
        let top = bank.top;
        if let Some(i) = bank.floors().iter().position(|&floor| floor > top) {
            let limit = Limit::Rule("floor: must not be above the highest raw value");
            return Err(ConfigError::at(Field::Dark, i, f64::from(top), limit).into());
        }
        let checksum = from.digest.clone().finalize();
        if u32::from_le_bytes(from.array()?) != checksum {
            return Err(ImageError::Checksum);
        }
        let origins =
            heapless::Vec::<[u16; 2], M>::from_iter(self.slots.iter().map(|s| [s.x0, s.y0]));
        self.concurrent = validate::buffer::<B>(&self.estimator, head.window.into(), &origins)?;
        self.travel = Travel::new(head.ratio_bits, head.slew_ulp, &self.segments);
        self.fill_sor(mask.across(), &head.sor());
        self.mask = Some(mask);
        Ok(())
    }

    fn load_head(&mut self, head: &Head, mask: &Mask) -> Result<(), ConfigError> {
        let check = |field, value: f64, limit| ConfigError::check(field, None, value, limit);
        let capacity = libm::floor(libm::sqrt(M as f64));
        check(Field::Across, head.across.into(), (4.0, capacity))?;
        check(Field::Subapertures, mask.count() as f64, (1.0, M as f64))?;
        check(Field::DetectorWidth, head.width.into(), (1.0, 4096.0))?;
        check(Field::DetectorHeight, head.height.into(), (1.0, 4096.0))?;
        check(Field::DetectorBits, head.bits.into(), (8.0, 16.0))?;
        let window = f64::from(head.window);
        check(Field::WindowSize, window, (MIN_WINDOW as f64, MAX_WINDOW as f64))?;
        let pixels = mask.count() as f64 * window * window;
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
        check(Field::ValidMin, quality.valid_min.into(), (0.0, mask.count() as f64))?;
        check(Field::TotalFluxMin, quality.flux_min as f64, (0.0, quality.flux_max as f64))?;
        let hold = f64::from(head.ladder.hold_frames);
        check(Field::HoldFrames, hold, (0.0, head.ladder.safe_frames.into()))?;
        check(Field::Stroke, head.lsb_m, (f64::MIN_POSITIVE, 1.0))?;
        check(Field::PixelGain, head.adu_per_unit, (0.25, 4.0))?;
        check(Field::Noise, head.threshold_shift.into(), (0.0, 8.0))?;
        self.width = head.width;
        self.height = head.height;
        self.window = usize::from(head.window);
        self.bits = head.bits;
        self.estimator = head.estimator;
        self.gain_exponent = head.gain_exponent;
        self.control = head.control;
        self.tilt_max_age = head.tilt_max_age;
        self.drive = head.drive;
        self.timing = timing;
        self.range = head.range;
        self.short_frame = head.short_frame;
        self.quality = quality;
        self.ladder = head.ladder;
        self.serials = head.serials;
        self.lsb_m = head.lsb_m;
        self.adu_per_unit = head.adu_per_unit;
        self.bank.convention = head.convention;
        self.bank.threshold_shift = head.threshold_shift;
        self.bank.top = ((1u32 << head.bits) - 1) as u16;
        check(Field::Saturation, head.saturation.into(), (1.0, self.bank.top.into()))?;
        self.bank.saturation = head.saturation;
        self.short_sums = self.sums_are_short();
        Ok(())
    }

    /// Slots come in readout order, each subaperture once.
    fn load_slot(&mut self, slot: Slot, count: usize) -> Result<(), ConfigError> {
        let index = self.slots.len();
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
        let known = self.slots.iter().any(|other| other.subaperture == slot.subaperture);
        if known || usize::from(slot.subaperture) >= count {
            return refuse(slot.subaperture, Limit::Rule("must be each subaperture once"));
        }
        let _ = self.slots.push(slot);
        Ok(())
    }

    fn load_subaperture(&mut self, i: usize, entry: Subaperture) -> Result<(), ConfigError> {
        let check = |field, value: f64, limit| ConfigError::check(field, Some(i), value, limit);
        let Subaperture { base_threshold, slope, gains, colour, segment, responses } = entry;
        for reference in slope.reference_q16 {
            let limit = f64::from(1u32 << 21);
            check(Field::ReferenceSlope, reference.into(), (-limit, limit))?;
        }
        check(Field::FluxMin, slope.flux_min.into(), (1.0, slope.flux_max.into()))?;
        // 1 - g and g f in Q13, 0 < g < 2.
        check(Field::ControlGain, gains.keep.into(), (-8191.0, 8191.0))?;
        check(Field::LeverArm, gains.take.into(), (1.0, f64::from(i16::MAX)))?;
        segment.check(i)?;
        let _ = self.base_thresholds.push(base_threshold);
        let _ = self.slopes.push(slope);
        self.set_gains(i, gains);
        let _ = self.schedule.colours.push(colour);
        let _ = self.segments.push(segment);
        let _ = self.responses.push(responses);
        Ok(())
    }
}

impl Head {
    fn sor(&self) -> SorSpec {
        SorSpec {
            omega: Some(self.omega),
            sweeps: Some(self.sweeps),
            cold_sweeps: Some(self.cold_sweeps),
        }
    }
}
