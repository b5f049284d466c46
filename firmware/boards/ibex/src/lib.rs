//! SPLASH on an Ibex soft core: what any program on it needs.

#![no_std]

mod console;
mod map;
mod ports;
mod start;

pub use console::{Console, Exit, exit};
pub use ports::{Closed, Ports, mark};
pub use start::Once;

/// Data memory of the simulator, bytes, as in `server.x`.
pub const DMEM_BYTES: usize = 1 << 20;

/// What of it is kept for the stack, bytes, as in `sections.x`: the suite, which takes most, was
/// painted to 17.5 KiB, the server to 20.8 KiB.
pub const STACK_BYTES: usize = 28 << 10;
