//! Two banks: the one that runs, and the other one, in which the next configuration is made.
//!
//! ```text
//!              begin            last chunk, whole and valid
//!   Empty ---------------> Receiving ----------------------> Checked --switch--> Ordered
//!     |                        | refused: Empty                ^  |                  |
//!     '---- copy ----> Open ---+-------- check ----------------'  | adjust           | frame boundary
//!                       ^ '- adjust                               |                  v
//!                       '-----------------------------------------'        the banks are exchanged
//! ```
//!
//! Nothing that is done to the other bank can touch the running one: a [`Draft`] has no access to it.
//! The loop may refuse the exchange ([`crate::controller::Controller::exchange`]); the bank is then checked
//! as it was. Behind an exchange the bank that ran before is `Open`: checked and switched to, it runs again.
//! What is refused says why; a refused adjustment changes nothing, a refused image leaves `Empty`.

use crate::adjust::{AdjustError, Adjustment};
use crate::config::Config;
use crate::image::ImageError;
use crate::link::Reason;
use crate::loader::Loader;
use crate::mode::Refusal;
use crate::store::{Store, StoreError, Stored};
use core::fmt;
use embedded_storage::nor_flash::NorFlash;
use serde::{Deserialize, Serialize};

/// Why something was not done to the other bank.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BankError {
    /// There is nothing in it.
    Empty,
    /// An image is still coming.
    Receiving {
        /// Where its next bytes belong.
        due: u32,
        /// Its length.
        length: u32,
    },
    /// No image is coming.
    NotReceiving,
    /// A chunk belongs elsewhere; the one that is due can still come.
    Offset {
        /// Where it belongs.
        found: u32,
        /// Where the next bytes belong.
        due: u32,
    },
    /// The image is longer than was said.
    Length {
        /// Its end.
        found: u32,
        /// What was said.
        length: u32,
    },
    /// The image is refused.
    Image(ImageError),
    /// The adjustment is refused.
    Adjust(AdjustError),
    /// It has not been checked since the last change.
    NotChecked,
    /// It is about to run: it can be discarded, not changed.
    Ordered,
}

impl fmt::Display for BankError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => f.write_str("the other bank is empty"),
            Self::Receiving { due, length } => {
                write!(f, "image of {length} bytes: only {due} have come")
            }
            Self::NotReceiving => f.write_str("chunk without an image"),
            Self::Offset { found, due } => write!(f, "chunk at {found}: must be at {due}"),
            Self::Length { found, length } => {
                write!(f, "chunk up to {found}: the image has {length} bytes")
            }
            Self::Image(error) => error.fmt(f),
            Self::Adjust(error) => error.fmt(f),
            Self::NotChecked => f.write_str("the other bank has changed since it was checked"),
            Self::Ordered => f.write_str("the other bank is about to run"),
        }
    }
}

impl core::error::Error for BankError {}

impl From<AdjustError> for BankError {
    fn from(error: AdjustError) -> Self {
        Self::Adjust(error)
    }
}

/// What is in the other bank.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum DraftState {
    /// Nothing that counts.
    Empty,
    /// An image is coming.
    Receiving {
        /// Where its next bytes belong.
        due: u32,
        /// Its length.
        length: u32,
    },
    /// A whole configuration, changed since it was last checked.
    Open,
    /// A valid configuration.
    Checked {
        /// Its hash.
        hash: u32,
    },
    /// A valid configuration that runs from the next frame on.
    Ordered {
        /// Its hash.
        hash: u32,
    },
}

/// The other bank, and what is being done to it.
pub struct Draft<'a, const M: usize, const P: usize, const B: usize, const K: usize = 0> {
    bank: &'a mut Config<M, P, B, K>,
    state: DraftState,
    loader: Loader,
}

impl<'a, const M: usize, const P: usize, const B: usize, const K: usize> Draft<'a, M, P, B, K> {
    /// One of what is in `bank`.
    pub fn new(bank: &'a mut Config<M, P, B, K>) -> Self {
        let state = state_of(bank);
        Self { bank, state, loader: Loader::new() }
    }

    /// Gives the bank back, with what is in it.
    #[must_use]
    pub fn into_bank(self) -> &'a mut Config<M, P, B, K> {
        self.bank
    }

    /// What is in it.
    #[must_use]
    pub const fn state(&self) -> DraftState {
        self.state
    }

    /// The configuration, when it is a whole one.
    #[must_use]
    pub const fn whole(&self) -> Option<&Config<M, P, B, K>> {
        match self.state {
            DraftState::Empty | DraftState::Receiving { .. } => None,
            DraftState::Open | DraftState::Checked { .. } | DraftState::Ordered { .. } => {
                Some(self.bank)
            }
        }
    }

    fn changeable(&self) -> Result<(), BankError> {
        match self.state {
            DraftState::Ordered { .. } => Err(BankError::Ordered),
            _ => Ok(()),
        }
    }

    /// An image of so many bytes comes. What was in the bank is gone.
    ///
    /// # Errors
    /// [`BankError::Ordered`].
    pub fn begin(&mut self, length: u32) -> Result<(), BankError> {
        self.changeable()?;
        self.bank.forget();
        self.loader = Loader::new();
        self.state = DraftState::Receiving { due: 0, length };
        Ok(())
    }

    /// Takes the next bytes of the image, and returns where those behind them belong. The last ones
    /// make the bank [`DraftState::Checked`].
    ///
    /// # Errors
    /// [`BankError::NotReceiving`]; [`BankError::Offset`], behind which the image can go on;
    /// [`BankError::Length`] and [`BankError::Image`], behind which the bank is empty.
    pub fn chunk(&mut self, offset: u32, bytes: &[u8]) -> Result<u32, BankError> {
        let DraftState::Receiving { due, length } = self.state else {
            return Err(BankError::NotReceiving);
        };
        if offset != due {
            return Err(BankError::Offset { found: offset, due });
        }
        let end = due.saturating_add(bytes.len() as u32);
        self.state = DraftState::Empty;
        if end > length {
            self.bank.forget();
            return Err(BankError::Length { found: end, length });
        }
        match self.loader.push(self.bank, bytes).map_err(BankError::Image)? {
            Some(hash) if end == length => self.state = DraftState::Checked { hash },
            None if end < length => self.state = DraftState::Receiving { due: end, length },
            Some(_) => {
                self.bank.forget();
                return Err(BankError::Length { found: end, length });
            }
            None => {
                self.bank.forget();
                return Err(BankError::Image(ImageError::Cut));
            }
        }
        Ok(end)
    }

    /// Makes it a copy of `running`, as by an upload of its image.
    ///
    /// # Errors
    /// [`BankError::Ordered`]; [`BankError::Empty`] if `running` has no subapertures.
    pub fn copy(&mut self, running: &Config<M, P, B, K>) -> Result<(), BankError> {
        self.changeable()?;
        self.state = DraftState::Empty;
        let mut loader = Loader::new();
        let mut copied = Err(BankError::Empty);
        running.save(&mut |bytes| {
            if !matches!(copied, Err(BankError::Image(_))) {
                copied = loader.push(self.bank, bytes).map_err(BankError::Image);
            }
        });
        copied.map(|_| self.state = DraftState::Open)
    }

    /// Loads what is stored in flash.
    ///
    /// # Errors
    /// As [`Store::restore`], and [`BankError::Ordered`]. Without a stored image nothing changes;
    /// behind one that does not fit the bank is empty.
    pub fn restore<F: NorFlash>(&mut self, store: &mut Store<F>) -> Result<Stored, Reason> {
        self.changeable()?;
        if store.newest_stored()?.is_none() {
            return Err(StoreError::<F::Error>::Nothing.into());
        }
        self.state = DraftState::Empty;
        let stored = store.restore(self.bank)?;
        self.state = DraftState::Checked { hash: stored.hash };
        Ok(stored)
    }

    /// Makes one change.
    ///
    /// # Errors
    /// [`BankError::Ordered`], [`BankError::Receiving`], [`BankError::Empty`],
    /// [`BankError::Adjust`].
    pub fn adjust(&mut self, adjustment: &Adjustment) -> Result<(), BankError> {
        match self.state {
            DraftState::Ordered { .. } => return Err(BankError::Ordered),
            DraftState::Receiving { due, length } => {
                return Err(BankError::Receiving { due, length });
            }
            DraftState::Empty => return Err(BankError::Empty),
            DraftState::Open | DraftState::Checked { .. } => {}
        }
        self.bank.adjust(adjustment)?;
        self.state = DraftState::Open;
        Ok(())
    }

    /// Checks all of it, and returns its hash.
    ///
    /// # Errors
    /// [`BankError::Receiving`], [`BankError::Empty`]; [`BankError::Adjust`] with what does not go
    /// together, which can then be adjusted.
    pub fn check(&mut self) -> Result<u32, BankError> {
        match self.state {
            DraftState::Checked { hash } | DraftState::Ordered { hash } => Ok(hash),
            DraftState::Receiving { due, length } => Err(BankError::Receiving { due, length }),
            DraftState::Empty => Err(BankError::Empty),
            DraftState::Open => {
                self.bank.check().map_err(AdjustError::Value)?;
                let hash = self.bank.hash();
                self.state = DraftState::Checked { hash };
                Ok(hash)
            }
        }
    }

    /// Orders it to run from the next frame on, and returns its hash.
    ///
    /// # Errors
    /// [`BankError::NotChecked`] and as [`Draft::check`].
    pub fn switch(&mut self) -> Result<u32, BankError> {
        match self.state {
            DraftState::Checked { hash } | DraftState::Ordered { hash } => {
                self.state = DraftState::Ordered { hash };
                Ok(hash)
            }
            DraftState::Open => Err(BankError::NotChecked),
            DraftState::Receiving { due, length } => Err(BankError::Receiving { due, length }),
            DraftState::Empty => Err(BankError::Empty),
        }
    }

    /// Gives up what is in it, and an order to run.
    pub fn discard(&mut self) {
        self.bank.forget();
        self.state = DraftState::Empty;
    }

    /// At a frame's boundary: gives the bank that was ordered to run for the one that ran, if `admit`
    /// lets the second of the two follow on the first. `None` if none was ordered.
    ///
    /// # Errors
    /// What `admit` says; the banks stay as they are, and this one is checked.
    pub fn exchange(
        &mut self,
        running: &mut &'a mut Config<M, P, B, K>,
        admit: impl FnOnce(&Config<M, P, B, K>, &Config<M, P, B, K>) -> Result<(), Refusal>,
    ) -> Option<Result<u32, Refusal>> {
        let DraftState::Ordered { hash } = self.state else { return None };
        if let Err(refusal) = admit(running, self.bank) {
            self.state = DraftState::Checked { hash };
            return Some(Err(refusal));
        }
        core::mem::swap(&mut self.bank, running);
        self.state = state_of(self.bank);
        Some(Ok(hash))
    }
}

fn state_of<const M: usize, const P: usize, const B: usize, const K: usize>(
    bank: &Config<M, P, B, K>,
) -> DraftState {
    if bank.mask.is_some() { DraftState::Open } else { DraftState::Empty }
}

/// Both banks.
pub struct Banks<'a, const M: usize, const P: usize, const B: usize, const K: usize = 0> {
    running: &'a mut Config<M, P, B, K>,
    hash: u32,
    refused: Option<Refusal>,
    /// The other bank.
    pub draft: Draft<'a, M, P, B, K>,
}

impl<'a, const M: usize, const P: usize, const B: usize, const K: usize> Banks<'a, M, P, B, K> {
    /// `running` runs; what is in `other` may be checked and switched to.
    pub fn new(running: &'a mut Config<M, P, B, K>, other: &'a mut Config<M, P, B, K>) -> Self {
        let hash = running.hash();
        Self { running, hash, refused: None, draft: Draft::new(other) }
    }

    /// What runs.
    #[must_use]
    pub const fn running(&self) -> &Config<M, P, B, K> {
        self.running
    }

    /// Its hash; 0 without a configuration.
    #[must_use]
    pub const fn hash(&self) -> u32 {
        self.hash
    }

    /// Gives both banks back, the one that runs first.
    #[must_use]
    pub fn into_banks(self) -> [&'a mut Config<M, P, B, K>; 2] {
        [self.running, self.draft.bank]
    }

    /// Makes the other bank a copy of what runs.
    ///
    /// # Errors
    /// As [`Draft::copy`].
    pub fn copy(&mut self) -> Result<(), BankError> {
        self.draft.copy(self.running)
    }

    /// Why the last exchange that was due did not come to be; `None` if it did.
    #[must_use]
    pub const fn refused(&self) -> Option<Refusal> {
        self.refused
    }

    /// Between two frames: has the other bank run if that was ordered and `admit` lets it follow on
    /// what runs. Returns its hash, or what `admit` says; `None` if nothing was ordered.
    pub fn frame_boundary(
        &mut self,
        admit: impl FnOnce(&Config<M, P, B, K>, &Config<M, P, B, K>) -> Result<(), Refusal>,
    ) -> Option<Result<u32, Refusal>> {
        let exchanged = self.draft.exchange(&mut self.running, admit)?;
        self.refused = exchanged.err();
        self.hash = exchanged.unwrap_or(self.hash);
        Some(exchanged)
    }
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Config<M, P, B, K> {
    /// Checks all that [`Config::load`] checks, and brings up to date what follows from it.
    fn check(&mut self) -> Result<(), crate::error::ConfigError> {
        let Some(mask) = self.mask else { return Ok(()) };
        let head = self.head(&mask);
        self.set_head(&head, mask.count())?;
        for i in 0..mask.count() {
            self.subaperture(i).map_or(Ok(()), |entry| entry.check(i, self.drive))?;
            self.second_gate(i).map_or(Ok(()), |entry| entry.check(i))?;
        }
        self.settle(&mask)
    }

    /// Whether frames can go on from `before` to this without a reset: the same subapertures and
    /// gates, windows of the same size, the same mirror with the same flat map and limits.
    #[must_use]
    pub fn continues(&self, before: &Self) -> bool {
        self.mask == before.mask
            && self.windows() == before.windows()
            && self.window == before.window
            && self.same_mechanics(before)
    }
}
