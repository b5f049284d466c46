//! The mark that the instruction counter recognises.
#![allow(unsafe_code, reason = "the one instruction that no intrinsic has")]

/// Marks this moment: a hint that the architecture reserves and every core takes for a NOP.
#[inline(always)]
pub fn mark() {
    // SAFETY: a NOP. It is said to touch memory, so that no work moves across it.
    unsafe { core::arch::asm!(".inst.n 0xbfd0", options(nostack, preserves_flags)) };
}
