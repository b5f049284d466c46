//! An [image](crate::image) into a bank, piece by piece, as it arrives.
//!
//! The bytes may come in pieces of any length. What is checked is what [`crate::image`] says; a bank
//! has no subapertures, and holds every frame, from the first byte to the last.

use crate::config::Config;
use crate::geometry::{MAX_ACROSS, Mask};
use crate::image::{CRC, Head, ImageError, MAGIC, RECORD, VERSION, VERSION_TWO_GATES};
use crate::modal::{ModalConfig, ModalHead};
use serde::Deserialize;

/// Bytes of the pixel maps that are taken at once: whole words.
const WORDS: usize = 64;

/// What the next bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Section {
    Prefix,
    Head,
    Calibration,
    Modal,
    Rows,
    Slots,
    Subapertures,
    SecondGate,
    Gradients,
    Coupling,
    Template,
    Floors,
    Losses,
    Thresholds,
    Checksum,
    End,
}

/// How a section comes.
#[derive(Clone, Copy, Debug)]
enum Form {
    /// In all so many bytes, so many at once at most.
    Bytes(usize, usize),
    /// So many records, each after its length.
    Records(usize),
}

/// Takes an image.
pub(crate) struct Loader {
    section: Section,
    form: Form,
    /// The entry that is being gathered, and its bytes; none for a record whose length is due.
    entry: heapless::Vec<u8, RECORD>,
    length: Option<usize>,
    digest: crc::Digest<'static, u32>,
    /// Of two gates.
    two_gates: bool,
    head: Option<Head>,
    rows: [u64; MAX_ACROSS],
    /// Entries of the section that came.
    index: usize,
}

impl Loader {
    /// One that waits for the first byte.
    pub(crate) fn new() -> Self {
        let mut loader = Self {
            section: Section::Prefix,
            form: Form::Bytes(0, 0),
            entry: heapless::Vec::new(),
            length: None,
            digest: CRC.digest(),
            two_gates: false,
            head: None,
            rows: [0; MAX_ACROSS],
            index: 0,
        };
        let prefix = MAGIC.len() + size_of_val(&VERSION);
        loader.enter(Section::Prefix, Form::Bytes(prefix, prefix));
        loader
    }

    /// How many bytes it could use at once: at least 1 before the end, 0 behind it.
    pub(crate) fn wanted(&self) -> usize {
        match self.section {
            Section::End => 0,
            _ => self.length.unwrap_or(1).saturating_sub(self.entry.len()),
        }
    }

    /// Takes the next bytes. Behind the last, returns the image's checksum.
    ///
    /// # Errors
    /// An [`ImageError`]; the bank then has no subapertures, and the loader takes no more.
    pub(crate) fn push<const M: usize, const P: usize, const B: usize, const K: usize>(
        &mut self,
        bank: &mut Config<M, P, B, K>,
        bytes: &[u8],
    ) -> Result<Option<u32>, ImageError> {
        let pushed = self.push_all(bank, bytes);
        if pushed.is_err() {
            bank.forget();
            self.section = Section::End;
        }
        pushed
    }

    fn push_all<const M: usize, const P: usize, const B: usize, const K: usize>(
        &mut self,
        bank: &mut Config<M, P, B, K>,
        bytes: &[u8],
    ) -> Result<Option<u32>, ImageError> {
        let mut rest = bytes;
        let mut checksum = None;
        while !rest.is_empty() {
            let wanted = self.wanted();
            if wanted == 0 {
                // There are bytes behind its end.
                return Err(ImageError::Malformed);
            }
            let (now, after) = rest.split_at_checked(wanted).unwrap_or((rest, &[]));
            self.entry.extend_from_slice(now).map_err(|_| ImageError::Malformed)?;
            rest = after;
            if self.wanted() == 0 {
                checksum = self.take(bank)?;
            }
        }
        Ok(checksum)
    }

    fn enter(&mut self, section: Section, form: Form) {
        (self.section, self.form, self.index) = (section, form, 0);
        self.await_entry();
    }

    fn await_entry(&mut self) {
        self.entry.clear();
        self.length = match self.form {
            Form::Bytes(left, most) => Some(left.min(most)),
            Form::Records(_) => None,
        };
    }

    /// Takes a whole entry, or the length of one.
    fn take<const M: usize, const P: usize, const B: usize, const K: usize>(
        &mut self,
        bank: &mut Config<M, P, B, K>,
    ) -> Result<Option<u32>, ImageError> {
        let entry = core::mem::take(&mut self.entry);
        if self.section == Section::Checksum {
            let found = entry.as_slice().try_into().map_or(0, u32::from_le_bytes);
            if found != self.digest.clone().finalize() {
                return Err(ImageError::Checksum);
            }
            self.end(bank)?;
            return Ok(Some(found));
        }
        self.digest.update(&entry);
        if self.length.is_none() {
            let length = usize::from(entry.first().copied().unwrap_or_default());
            self.length = Some(length);
            return if length == 0 { Err(ImageError::Malformed) } else { Ok(None) };
        }
        self.keep(bank, &entry)?;
        let left = match &mut self.form {
            Form::Bytes(left, _) => {
                *left = left.saturating_sub(entry.len());
                *left
            }
            Form::Records(left) => {
                *left = left.saturating_sub(1);
                *left
            }
        };
        if left == 0 {
            self.advance(bank)?;
        } else {
            self.await_entry();
        }
        Ok(None)
    }

    /// What an entry says.
    fn keep<const M: usize, const P: usize, const B: usize, const K: usize>(
        &mut self,
        bank: &mut Config<M, P, B, K>,
        entry: &[u8],
    ) -> Result<(), ImageError> {
        let words = || entry.as_chunks().0.iter().map(|&word| u16::from_le_bytes(word));
        match self.section {
            Section::Prefix => {
                let (magic, version) = entry.split_at_checked(MAGIC.len()).unwrap_or_default();
                let found = version.try_into().map_or(0, u16::from_le_bytes);
                if magic != MAGIC {
                    return Err(ImageError::NotAnImage);
                }
                self.two_gates = found == VERSION_TWO_GATES;
                if found != VERSION && !self.two_gates {
                    return Err(ImageError::Version { found });
                }
            }
            Section::Head => self.head = Some(record(entry)?),
            Section::Calibration => bank.calibrated = record(entry)?,
            Section::Rows => {
                if let Some(row) = self.rows.get_mut(self.index) {
                    *row = entry.try_into().map_or(0, u64::from_le_bytes);
                }
            }
            Section::Modal => {
                let head: ModalHead = record(entry)?;
                ModalConfig::<M, K>::check_head(head)?;
                bank.modal.head = head;
            }
            Section::Slots => bank.load_slot(record(entry)?)?,
            Section::Subapertures => bank.load_subaperture(record(entry)?)?,
            Section::SecondGate => bank.load_second_gate(record(entry)?)?,
            Section::Gradients => {
                let values = entry.as_chunks().0.iter().map(|&bytes| i16::from_le_bytes(bytes));
                let places = bank.modal.of_mut(self.index).as_flattened_mut();
                places.iter_mut().zip(values).for_each(|(place, value)| *place = value);
            }
            Section::Coupling => {
                let modes = bank.modes();
                let row = bank.modal.row_mut(self.index).unwrap_or_default();
                let values = entry.as_chunks().0.iter().map(|&bytes| i32::from_le_bytes(bytes));
                let places = row.as_flattened_mut();
                for (j, (place, value)) in places.iter_mut().zip(values).enumerate() {
                    let at = 2 * modes * self.index + j;
                    ModalConfig::<M, K>::check_coupling(value, at)?;
                    *place = value;
                }
            }
            Section::Template => {
                if let Some(samples) = bank.template.samples.get_mut(self.index) {
                    samples.iter_mut().zip(entry).for_each(|(sample, &byte)| *sample = byte);
                }
            }
            Section::Floors => words().for_each(|floor| bank.bank.push_floor(floor)),
            Section::Losses => words().for_each(|loss| bank.bank.push_loss(loss)),
            Section::Thresholds => entry.iter().for_each(|&t| bank.bank.push_threshold(t)),
            Section::Checksum | Section::End => {}
        }
        self.index += 1;
        Ok(())
    }

    /// From the end of a section to the next.
    fn advance<const M: usize, const P: usize, const B: usize, const K: usize>(
        &mut self,
        bank: &mut Config<M, P, B, K>,
    ) -> Result<(), ImageError> {
        let (count, modes) = (bank.nodes.len(), bank.modes());
        let pixels = bank.windows() * bank.window * bank.window;
        let [phase, ..] = &bank.template.samples;
        match self.section {
            Section::Prefix => {
                bank.forget();
                self.enter(Section::Head, Form::Records(1));
            }
            Section::Head => self.enter(Section::Calibration, Form::Records(1)),
            Section::Calibration if self.two_gates => {
                self.enter(Section::Modal, Form::Records(1));
            }
            Section::Calibration | Section::Modal => {
                let across = self.mask()?.across();
                self.enter(Section::Rows, Form::Bytes(8 * across, 8));
            }
            Section::Rows => {
                let mask = self.mask()?;
                let head = self.head.ok_or(ImageError::Malformed)?;
                bank.set_head(&head, mask.count())?;
                bank.fill_nodes(&mask);
                self.enter(Section::Slots, Form::Records(bank.nodes.len() * bank.modal.gates()));
            }
            Section::Slots => self.enter(Section::Subapertures, Form::Records(count)),
            Section::Subapertures if self.two_gates => {
                self.enter(Section::SecondGate, Form::Records(count));
            }
            Section::SecondGate => {
                self.enter(Section::Gradients, Form::Bytes(4 * modes * count, 4 * modes));
            }
            Section::Gradients => {
                self.enter(Section::Coupling, Form::Bytes(8 * modes * modes, 8 * modes));
            }
            Section::Subapertures | Section::Coupling => {
                let bytes = bank.template.samples.as_flattened().len();
                self.enter(Section::Template, Form::Bytes(bytes, phase.len()));
            }
            Section::Template => self.enter(Section::Floors, Form::Bytes(2 * pixels, WORDS)),
            Section::Floors => self.enter(Section::Losses, Form::Bytes(2 * pixels, WORDS)),
            Section::Losses => self.enter(Section::Thresholds, Form::Bytes(pixels, WORDS)),
            Section::Thresholds => self.enter(Section::Checksum, Form::Bytes(4, 4)),
            Section::Checksum | Section::End => self.section = Section::End,
        }
        Ok(())
    }

    /// All is there: what follows from it.
    fn end<const M: usize, const P: usize, const B: usize, const K: usize>(
        &mut self,
        bank: &mut Config<M, P, B, K>,
    ) -> Result<(), ImageError> {
        let mask = self.mask()?;
        bank.settle(&mask)?;
        bank.mask = Some(mask);
        self.section = Section::End;
        Ok(())
    }

    fn mask(&self) -> Result<Mask, ImageError> {
        let across = self.head.map_or(0, |head| usize::from(head.across));
        let bit = |x: usize, y: usize| self.rows.get(y).is_some_and(|row| (row >> x) & 1 == 1);
        Ok(Mask::from_fn(across, bit)?)
    }
}

fn record<T: for<'de> Deserialize<'de>>(bytes: &[u8]) -> Result<T, ImageError> {
    match postcard::take_from_bytes(bytes) {
        Ok((value, [])) => Ok(value),
        _ => Err(ImageError::Malformed),
    }
}
