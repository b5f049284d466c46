//! Breaks every rule that the check knows, one per entry, so that the check can be seen to see it.
#![no_std]
#![no_main]

use core::hint::black_box;

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop {}
}

/// A bounds check.
#[unsafe(no_mangle)]
extern "C" fn probe_begin(i: usize) -> u32 {
    black_box([1u32, 2, 3])[i]
}

/// Floating point, and a 64-bit division.
#[unsafe(no_mangle)]
extern "C" fn probe_push_row(a: u64, b: u64) -> u64 {
    let x = a as u32 as f32 * 1.5;
    u64::from(x as u32) + a / b.max(1)
}

/// A call through a pointer.
#[unsafe(no_mangle)]
extern "C" fn probe_finish(n: u32, f: extern "C" fn(u32) -> u32) -> u32 {
    f(n) + 1
}

/// A large frame.
#[unsafe(no_mangle)]
extern "C" fn probe_large(n: u32) -> u32 {
    black_box(&[n; 1000]).iter().fold(0, |sum, x| sum ^ x)
}

/// Recursion.
#[unsafe(no_mangle)]
extern "C" fn probe_recurse(n: u32) -> u32 {
    if n == 0 { 0 } else { black_box(probe_recurse(n - 1)) ^ n }
}
