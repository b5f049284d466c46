//! Codes of 16 bits for actuators with a quadratic response, in RISC-V's own instructions: [`Line::code`] of all.

use crate::actuators::Line;
use crate::root::{BITS, LINES, Lines, STEP_BITS, place};
use crate::segments::ACTUATORS;

/// Where a step's lines would start, and how many bits of v are below a cell: the lowest five of the address, which is
/// three too high for that. A shift takes no more of it.
#[repr(transparent)]
struct Step(#[allow(dead_code, reason = "instructions read it")] *const u8);

// SAFETY: it points to what never changes.
#[allow(unsafe_code)]
unsafe impl Sync for Step {}

static STEPS: [Step; 1 << (BITS - STEP_BITS)] = {
    let mut steps = [const { Step(core::ptr::null()) }; 1 << (BITS - STEP_BITS)];
    let mut i = 0;
    while i < steps.len() {
        let (word, width) = place(i as u32);
        assert!((4 * word + 3) % 32 == width && align_of::<Lines>() == 32);
        steps[i] = Step((&raw const LINES).cast::<u8>().wrapping_add(4 * word as usize + 3));
        i += 1;
    }
    steps
};

/// Makes the codes of all segments that there is one of each for, all of [short](crate::actuators::Response::is_short)
/// responses.
#[allow(unsafe_code)]
#[inline(never)]
pub(crate) fn codes(
    lines: &[[Line; ACTUATORS]],
    heights_ulp: &[[i32; ACTUATORS]],
    codes: &mut [[u16; ACTUATORS]],
) {
    use core::mem::offset_of;
    const {
        assert!(offset_of!(Line, offset) == 0);
        assert!(offset_of!(Line, slope) == 4);
        assert!(size_of::<Step>() == 4);
    }
    let count = lines.len().min(heights_ulp.len()).min(codes.len());
    // The first turn is entered behind one to eight segments.
    let back = 8 - count % 8;
    let to = codes.as_mut_ptr();
    // SAFETY: the instructions read `count` of `lines` and `heights_ulp` and write as many of `codes`, which are as
    // long at least. They take 24 bits of v, which is below 2^24 within the actuators' limits (see
    // `Response::is_short`), whatever heights and lines there are, read `STEPS` at the upper nine of them and the line
    // of its cell, and write registers that are given here.
    unsafe {
        core::arch::asm!(include_str!("segment_turns_rv32.s"), include_str!("codes_rv32.s"),
            step_bits = const STEP_BITS, spare_bits = const u32::BITS - BITS,
            each = inout(reg) lines.as_ptr().wrapping_sub(back) => _,
            heights = inout(reg) heights_ulp.as_ptr().wrapping_sub(back) => _,
            to = inout(reg) to.wrapping_sub(back) => _,
            end = in(reg) to.wrapping_add(count).wrapping_sub(8),
            steps = in(reg) STEPS.as_ptr(),
            h = inout(reg) count % 8 => _, s = out(reg) _, v = out(reg) _, e = out(reg) _,
            w = out(reg) _, x = out(reg) _, y = out(reg) _, options(nostack));
    }
}
