//! Whether a configuration has been calibrated on the instrument that it is for.
//!
//! A calibration holds for one mask, placement of the windows, detector and mirror, and for their serial
//! numbers. Its record carries a fingerprint of them; what it measured (floors, losses, reference slopes,
//! 2 x 2 gains) and what is chosen freely (gains, limits, thresholds, gate) is not in it.

use crate::config::Config;
use crate::image::CRC;
use crate::mirror::Serials;
use core::fmt;
use serde::{Deserialize, Serialize};

/// A step of a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Step {
    /// Frames without light: the floors.
    Darks,
    /// Frames of even light: the losses.
    Flats,
    /// Centroids of the flat mirror: the reference slopes.
    References,
    /// Segments poked one by one: whose spot is whose, and the 2 x 2 gains.
    Pokes,
}

impl Step {
    /// All, in the order in which they are done.
    pub const ALL: [Self; 4] = [Self::Darks, Self::Flats, Self::References, Self::Pokes];

    const fn bit(self) -> u8 {
        1 << self as u8
    }
}

/// The record of a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Calibration {
    /// Of what it was made on: [`Config::fingerprint`].
    pub fingerprint: u32,
    /// The steps that were done: bit k is `Step::ALL[k]`.
    pub steps: u8,
    /// Share of the variance of the poked slopes that the fitted gains explain, Q16; 65535 for all.
    pub quality_q16: u16,
}

/// Why a configuration counts as uncalibrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Uncalibrated {
    /// It has no subapertures.
    NotConfigured,
    /// It has no record of a calibration.
    Never,
    /// A step was not done.
    Missing(Step),
    /// Mask, detector, windows or mirror are not those that were calibrated.
    Changed {
        /// Fingerprint of those that were.
        calibrated: u32,
        /// Fingerprint of those that are.
        configured: u32,
    },
}

impl fmt::Display for Uncalibrated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotConfigured => f.write_str("no configuration"),
            Self::Never => f.write_str("configuration without a calibration"),
            Self::Missing(step) => f.write_str(match step {
                Step::Darks => "calibration without darks",
                Step::Flats => "calibration without flats",
                Step::References => "calibration without reference slopes",
                Step::Pokes => "calibration without pokes",
            }),
            Self::Changed { calibrated, configured } => write!(
                f,
                "calibration of another mask, detector, placement of windows or mirror: \
                 fingerprint {calibrated:08x}, must be {configured:08x}"
            ),
        }
    }
}

impl core::error::Error for Uncalibrated {}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Config<M, P, B, K> {
    /// CRC-32 (ISO-HDLC) of what a calibration depends on: mask, detector, windows, mirror.
    #[must_use]
    pub fn fingerprint(&self) -> u32 {
        let mut digest = CRC.digest();
        let mut words = |words: &[u16]| words.iter().for_each(|w| digest.update(&w.to_le_bytes()));
        words(&[self.width, self.height, self.bits.into(), self.window as u16]);
        words(&[self.drive.law as u16, self.drive.spare_bits as u16]);
        words(&[self.travel.ratio_bits as u16]);
        for slot in &self.slots {
            words(&[slot.x0, slot.y0, slot.subaperture]);
        }
        for segment in &self.segments {
            words(&segment.influence);
            segment.ratios.as_flattened().iter().for_each(|&ratio| words(&[ratio as u16]));
        }
        let rows = self.mask.as_ref().map(|mask| mask.rows()).unwrap_or_default();
        rows.iter().for_each(|row| digest.update(&row.to_le_bytes()));
        digest.update(&self.lsb_m.to_le_bytes());
        let Serials { mirror, detector } = self.serials;
        [mirror, detector].iter().for_each(|serial| digest.update(&serial.to_le_bytes()));
        digest.finalize()
    }

    /// The calibration of this configuration.
    ///
    /// # Errors
    /// [`Uncalibrated`]: what is missing, or that it was made on something else.
    pub fn calibration(&self) -> Result<Calibration, Uncalibrated> {
        if self.subapertures() == 0 {
            return Err(Uncalibrated::NotConfigured);
        }
        let calibration = self.calibrated.ok_or(Uncalibrated::Never)?;
        let done = |step: &Step| calibration.steps & step.bit() != 0;
        if let Some(&missing) = Step::ALL.iter().find(|step| !done(step)) {
            return Err(Uncalibrated::Missing(missing));
        }
        let configured = self.fingerprint();
        if calibration.fingerprint != configured {
            let calibrated = calibration.fingerprint;
            return Err(Uncalibrated::Changed { calibrated, configured });
        }
        Ok(calibration)
    }

    /// Records that these steps were done on what this configuration is for.
    pub fn set_calibrated(&mut self, steps: &[Step], quality_q16: u16) {
        let steps = steps.iter().fold(0, |steps, step| steps | step.bit());
        let fingerprint = self.fingerprint();
        self.calibrated = Some(Calibration { fingerprint, steps, quality_q16 });
    }
}
