//! From reset to `main`, and from a fault to the end.
#![allow(unsafe_code, reason = "what runs before there is a stack, and memory taken once")]

use crate::{Console, Exit, exit};
use core::arch::global_asm;
use core::cell::{Cell, UnsafeCell};
use core::fmt::Write;

// Ibex's vectors are 32 jumps; it starts at the next instruction after them.
global_asm!(
    ".section .vectors, \"ax\"",
    ".option push",
    ".option norvc",
    ".rept 32",
    "j _trap",
    ".endr",
    ".section .start, \"ax\"",
    ".globl _start",
    "_start:",
    "la sp, __stack_top",
    "la a0, __data",
    "la a1, __data_end",
    "la a2, __data_from",
    "1: bgeu a0, a1, 2f",
    "lw a3, 0(a2)",
    "sw a3, 0(a0)",
    "addi a0, a0, 4",
    "addi a2, a2, 4",
    "j 1b",
    "2: la a0, __bss",
    "la a1, __bss_end",
    "3: bgeu a0, a1, 4f",
    "sw zero, 0(a0)",
    "addi a0, a0, 4",
    "j 3b",
    // The stack is painted, so that how deep it went can be seen.
    "4: la a0, __bss_end",
    "li a2, {paint}",
    "5: bgeu a0, sp, 6f",
    "sw a2, 0(a0)",
    "addi a0, a0, 4",
    "j 5b",
    "6: call main",
    "_trap:",
    "la sp, __stack_top",
    "csrr a0, mcause",
    "csrr a1, mepc",
    "csrr a2, mtval",
    "call fault",
    ".option pop",
    paint = const PAINT,
);

/// What the stack is painted with: as good as any that code does not leave there by itself.
const PAINT: u32 = 0x5f5f_5f5f;

/// Bytes of the stack that were ever in use.
pub(crate) fn stack_used() -> usize {
    unsafe extern "C" {
        static __bss_end: u32;
        static __stack_top: u32;
    }
    let (end, top) = (&raw const __bss_end, &raw const __stack_top);
    let free = (0..).map(|k| end.wrapping_add(k)).take_while(|&word| {
        // SAFETY: a word between .bss and the stack's top; nothing but the stack is there, and what
        // it holds is looked at as a number only.
        word < top && unsafe { word.read_volatile() } == PAINT
    });
    top.addr() - end.addr() - size_of::<u32>() * free.count()
}

/// Where every fault ends: there is nothing to go back to.
// SAFETY: the name is that of the jump above and of nothing else.
#[unsafe(no_mangle)]
extern "C" fn fault(cause: u32, address: u32, value: u32) -> ! {
    let _ = writeln!(Console, "fault {cause} at {address:#010x}, value {value:#010x}");
    exit(Exit::Fault)
}

/// A value in data memory that is taken once.
pub struct Once<T> {
    taken: Cell<bool>,
    value: UnsafeCell<T>,
}

// SAFETY: there is one hart, no interrupt is ever enabled, and the fault handler, which does not
// return, takes none.
unsafe impl<T: Send> Sync for Once<T> {}

impl<T> Once<T> {
    /// With this value; all zeros take no place in the image.
    pub const fn new(value: T) -> Self {
        Self { taken: Cell::new(false), value: UnsafeCell::new(value) }
    }

    /// The value, the first time.
    #[allow(clippy::mut_from_ref, reason = "once")]
    pub fn take(&'static self) -> Option<&'static mut T> {
        if self.taken.replace(true) {
            return None;
        }
        // SAFETY: handed out once, and nothing else looks at it.
        Some(unsafe { &mut *self.value.get() })
    }
}
