//! How deep the stack went: `cortex-m-rt` has painted it before anything ran.
#![allow(unsafe_code, reason = "memory between the data and the stack's top")]

use crate::geometry::STACK_BYTES;
use cortex_m_rt::STACK_PAINT_VALUE;
use splash_firmware::link::Stack;

/// Bytes of the stack that were ever in use, and that are kept for it.
pub(crate) fn stack() -> Stack {
    unsafe extern "C" {
        static _stack_end: u32;
        static _stack_start: u32;
    }
    let (end, top) = (&raw const _stack_end, &raw const _stack_start);
    let free = (0..).map(|k| end.wrapping_add(k)).take_while(|&word| {
        // SAFETY: a word between the data and the stack's top; nothing but the stack is there, and
        // what it holds is looked at as a number only.
        word < top && unsafe { word.read_volatile() } == STACK_PAINT_VALUE
    });
    let used = top.addr() - end.addr() - size_of::<u32>() * free.count();
    Stack { used: used as u32, reserved: STACK_BYTES as u32 }
}
