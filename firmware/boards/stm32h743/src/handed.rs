//! What the main program hands to an interrupt, once, before it is enabled.
#![allow(unsafe_code, reason = "a value that one interrupt owns")]

use core::cell::UnsafeCell;

/// A place for it.
pub(crate) struct Handed<T>(UnsafeCell<Option<T>>);

// SAFETY: the value is written before the interrupt is enabled, and used by that interrupt only.
unsafe impl<T: Send> Sync for Handed<T> {}

impl<T> Handed<T> {
    /// An empty place.
    pub(crate) const fn new() -> Self {
        Self(UnsafeCell::new(None))
    }

    /// Puts the value there.
    ///
    /// # Safety
    /// The interrupt is not enabled yet, and nobody else calls this.
    pub(crate) unsafe fn give(&self, value: T) {
        // SAFETY: as the caller says, there is no other reference.
        unsafe { *self.0.get() = Some(value) };
    }

    /// The value.
    ///
    /// # Safety
    /// Only the interrupt that it was given to calls this, once each time it runs.
    #[allow(clippy::mut_from_ref, reason = "the caller is the only one")]
    #[inline(always)]
    pub(crate) unsafe fn mine(&self) -> Option<&mut T> {
        // SAFETY: as the caller says: an interrupt does not interrupt itself.
        unsafe { (*self.0.get()).as_mut() }
    }
}
