//! SPLASH on the Cortex-M7 that QEMU emulates (`qemu-system-arm -machine mps2-an500`).
//!
//! What any program on this board needs: logs by defmt over semihosting, an exit code for whatever
//! ends it, and the mark at which the instruction counter outside looks.

#![no_std]

mod mark;
mod pipes;
mod stack;
mod stop;

pub use mark::mark;
pub use pipes::Pipes;
pub use stop::{Exit, exit};

// For its critical section, and for the logger itself.
use cortex_m as _;
use defmt_semihosting as _;

/// RAM for `.data`, `.bss` and the stack, bytes, as in `memory.x`.
pub const RAM_BYTES: usize = 4 << 20;

/// What of it is kept for the stack, bytes: many times what any program here takes.
pub const STACK_BYTES: usize = 64 << 10;
