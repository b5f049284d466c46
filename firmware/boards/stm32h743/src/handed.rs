//! What the main program hands to interrupts of one priority, once, before they are enabled.
#![allow(unsafe_code, reason = "a value that interrupts own")]

use core::cell::UnsafeCell;

/// A place for it.
pub(crate) struct Handed<T>(UnsafeCell<Option<T>>);

// SAFETY: the value is written before the interrupts are enabled, and used by them only.
unsafe impl<T: Send> Sync for Handed<T> {}

impl<T> Handed<T> {
    /// An empty place.
    pub(crate) const fn new() -> Self {
        Self(UnsafeCell::new(None))
    }

    /// Puts the value there.
    ///
    /// # Safety
    /// The interrupts are not enabled yet, and nobody else calls this.
    pub(crate) unsafe fn give(&self, value: T) {
        // SAFETY: as the caller says, there is no other reference.
        unsafe { *self.0.get() = Some(value) };
    }

    /// The value.
    ///
    /// # Safety
    /// Only interrupts that do not interrupt one another call this, once each time they run.
    #[allow(clippy::mut_from_ref, reason = "the caller is the only one")]
    #[inline(always)]
    pub(crate) unsafe fn mine(&self) -> Option<&mut T> {
        // SAFETY: as the caller says, there is no other reference.
        unsafe { (*self.0.get()).as_mut() }
    }
}
