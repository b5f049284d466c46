//! Two pixels at a time with the Armv7E-M instructions on pairs of 16 bits.
//!
//! | instruction | here |
//! |---|---|
//! | UQSUB16 | saturating difference: pixel less floor less excess |
//! | SMLAD | sum of a pair times a pair of weights, added up |
//! | USUB16, SEL | the larger of two, the saturated ones |
//!
//! SMLAD is signed. Up to 15 bits a signal is what it is; of 16 bits its top bit is flipped, which
//! makes it less by 2^15: the distances of pixels from the window's centre add up to zero over a row,
//! so that this cancels in the moment, and of the sum it is taken back.

use super::{Kernel, Rows, Watched, seen};
use crate::centroid::RowSums;
use crate::pixels::{Cut, Seen};

/// Highest raw value of which the sum of a row's words is a signed number.
const NARROW_TOP: u16 = (1 << 12) - 1;
/// Highest raw value of which no bit needs flipping.
const SIGNED_TOP: u16 = i16::MAX as u16;
/// One in both lanes.
const ONES: u32 = 0x0001_0001;

#[cfg(armv7em)]
mod instructions {
    use core::arch::asm;

    /// Instructions as safe functions.
    macro_rules! instructions {
        ($($(#[$doc:meta])* $name:ident($($x:ident),*) = $($code:literal),* => $out:ident;)*) => {$(
            $(#[$doc])*
            #[inline(always)]
            pub(super) fn $name($($x: u32),*) -> u32 {
                let out: u32;
                // SAFETY: the instructions read registers and write `out` and the status flags,
                // which count as changed; they touch no memory. This module is compiled only where
                // they are part of the target.
                #[allow(unsafe_code)]
                unsafe {
                    asm!($($code),*, $($x = in(reg) $x,)* out = $out(reg) out,
                        options(pure, nomem, nostack));
                }
                out
            }
        )*};
    }

    instructions! {
        /// max(x - y, 0) in each lane, unsigned.
        uqsub16(x, y) = "uqsub16 {out}, {x}, {y}" => lateout;
        /// `sum` plus both products of the lanes, signed.
        smlad(x, y, sum) = "smlad {out}, {x}, {y}, {sum}" => lateout;
    }
}

/// The same instructions in portable arithmetic, so that the kernel can be tested on a PC.
#[cfg(not(armv7em))]
mod instructions {
    fn split(x: u32) -> [u16; 2] {
        [x as u16, (x >> 16) as u16]
    }

    fn lanes(x: u32, y: u32, rule: impl Fn(u16, u16) -> u16) -> u32 {
        let ([a, b], [c, d]) = (split(x), split(y));
        u32::from(rule(a, c)) | u32::from(rule(b, d)) << 16
    }

    pub(super) fn uqsub16(x: u32, y: u32) -> u32 {
        lanes(x, y, u16::saturating_sub)
    }

    pub(super) fn smlad(x: u32, y: u32, sum: u32) -> u32 {
        let signed = |x: u32| split(x).map(|lane| i32::from(lane as i16));
        let ([a, b], [c, d]) = (signed(x), signed(y));
        (sum as i32).wrapping_add(a * c).wrapping_add(b * d) as u32
    }

    pub(super) fn larger(x: u32, y: u32) -> u32 {
        lanes(x, y, u16::max)
    }

    pub(super) fn reached(x: u32, y: u32, one: u32, zero: u32) -> u32 {
        let reached = lanes(x, y, |x, y| if x >= y { u16::MAX } else { 0 });
        (one & reached) | (zero & !reached)
    }
}

use instructions::{smlad, uqsub16};

/// `x` in both lanes.
#[inline(always)]
fn both(x: u16) -> u32 {
    u32::from(x).wrapping_mul(ONES)
}

/// Half pixels from one word to the next, in both lanes.
const WORD: u32 = 4 * ONES;

/// Sums of the signals, of which the top bits are inverted if `FLIP`, as signed numbers.
///
/// Pixel x is weighted with 2x, which no step from word to word carries over between lanes; the window's
/// centre is taken off the sum.
#[inline(always)]
fn signed_sums<const N: usize, const FLIP: bool>(rows: Rows<'_, N>, cut: Cut) -> RowSums {
    let RowSums { sum, x, running } = row::sums::<N, FLIP>(rows, both(cut.excess));
    let centre = (sum as i32).wrapping_mul(2 * N as i32 - 1);
    RowSums { sum, x: x.wrapping_sub(centre), running }
}

/// Weights of the first word.
const FIRST: u32 = 2 << 16;

/// One word after the other.
#[inline(always)]
fn word_sums<const N: usize, const FLIP: bool>(rows: Rows<'_, N>, excess: u32) -> RowSums {
    let flip = if FLIP { both(1 << 15) } else { 0 };
    let (mut sum, mut x, mut running) = (0, 0, 0u32);
    rows.each(|raw, floor| {
        let mut weight = FIRST;
        for (&raw, &floor) in raw.iter().zip(floor) {
            let signal = uqsub16(uqsub16(raw, floor), excess) ^ flip;
            sum = smlad(signal, ONES, sum);
            x = smlad(signal, weight, x);
            weight = weight.wrapping_add(WORD);
        }
        running = running.wrapping_add(sum);
    });
    RowSums { sum, x: x as i32, running }
}

/// The sums of up to 12 bits, whose rows' packed sums are below 8 x 4095 < 2^15, and are signed numbers: a
/// running sum takes the place of weights. Everything is counted twice, but for `places`, of which the
/// second pixels of words are taken off once.
#[inline(always)]
fn from_places<const N: usize>(sum: u32, places: u32, running: u32) -> RowSums {
    // Of the word at place k, N - k times itself is in the running sums: 4 k + 2 lane - (W - 1) is
    // (W + 1) - 2 (2 (N - k) - lane).
    let x = (sum / 2).wrapping_mul(2 * N as u32 + 1).wrapping_sub(places.wrapping_mul(2));
    RowSums { sum: sum / 2, x: x as i32, running: running / 2 }
}

#[cfg(not(armv7em))]
mod row {
    use super::instructions::{larger, reached};
    use super::{ONES, RowSums, Rows, Watched, from_places, smlad, uqsub16};

    pub(super) use super::word_sums as sums;

    pub(super) fn watch(watched: Watched<'_>, [excess, white]: [u32; 2]) -> [u32; 2] {
        let (mut peak, mut saturated) = (0, 0);
        for (&raw, &floor) in watched.raw.iter().zip(watched.floor) {
            let signal = uqsub16(uqsub16(raw, floor), excess);
            peak = larger(signal, peak);
            let lit = reached(signal, ONES, ONES, 0);
            saturated += reached(raw, white, lit, 0);
        }
        [peak, saturated]
    }

    pub(super) fn narrow_sums<const N: usize, const EVEN: bool>(
        rows: Rows<'_, N>,
        excess: u32,
    ) -> RowSums {
        let (mut sum, mut places, mut running) = (0, 0u32, 0u32);
        rows.each(|raw, floor| {
            let mut row = 0;
            for (&raw, &floor) in raw.iter().zip(floor) {
                row += uqsub16(uqsub16(raw, floor), excess);
                places = smlad(row, 2 * ONES, places);
            }
            places -= row >> 16;
            sum = smlad(row, 2 * ONES, sum);
            running += sum;
        });
        from_places::<N>(sum, places, running)
    }
}

/// The rows of the common windows in instructions of their own: words are loaded by two or four, weights
/// are counted up in a register, and thirteen registers are all that there are.
#[cfg(armv7em)]
mod row {
    use super::{FIRST, ONES, RowSums, Rows, Watched, word_sums};
    use core::arch::asm;

    /// Two words.
    macro_rules! words {
        (true) => {
            words!("eor {a}, {a}, #0x80008000\n eor {b}, {b}, #0x80008000\n")
        };
        ($flip:literal) => {
            concat!(
                "ldrd {a}, {b}, [{raw}], #8\n ldrd {c}, {d}, [{floor}], #8\n",
                "uqsub16 {a}, {a}, {c}\n uqsub16 {b}, {b}, {d}\n",
                "uqsub16 {a}, {a}, {excess}\n uqsub16 {b}, {b}, {excess}\n",
                $flip,
                "smlad {sum}, {a}, {ones}, {sum}\n smlad {x}, {a}, {weight}, {x}\n",
                "add {weight}, {weight}, #0x00040004\n",
                "smlad {sum}, {b}, {ones}, {sum}\n smlad {x}, {b}, {weight}, {x}\n",
                "add {weight}, {weight}, #0x00040004\n",
            )
        };
    }

    /// Rows of words; then the weight goes back to the first.
    macro_rules! rows {
        ($weights:literal, $($words:expr),*) => {
            concat!(
                "sub sp, sp, #8\n str {c}, [sp]\n str {d}, [sp, #4]\n",
                "2:\n", $($words,)*
                "sub {weight}, {weight}, #", $weights, "\n add {running}, {running}, {sum}\n",
                "ldr {d}, [sp, #4]\n ldr {c}, [sp]\n add {raw}, {raw}, {d}\n",
                "cmp {floor}, {c}\n bne 2b\n add sp, sp, #8\n",
            )
        };
    }

    /// Four words of up to 12 bits, added to those before them in their row but for the last one's place.
    macro_rules! narrow {
        ($first:literal) => {
            concat!(
                "ldmia {raw}!, {{r0-r3}}\n ldrd {c}, r7, [{floor}], #8\n",
                "uqsub16 r0, r0, {c}\n uqsub16 r1, r1, r7\n ldrd {c}, r7, [{floor}], #8\n",
                "uqsub16 r2, r2, {c}\n uqsub16 r3, r3, r7\n",
                $first,
                "smlad {places}, {row}, {twos}, {places}\n",
                "uqsub16 r1, r1, {excess}\n add {row}, {row}, r1\n",
                "smlad {places}, {row}, {twos}, {places}\n",
                "uqsub16 r2, r2, {excess}\n add {row}, {row}, r2\n",
                "smlad {places}, {row}, {twos}, {places}\n",
                "uqsub16 r3, r3, {excess}\n add {row}, {row}, r3\n",
            )
        };
    }

    /// A row of 4 words, or of as many more. The last word's place, in which all of a row are, is where
    /// second pixels count once only.
    macro_rules! narrow_row {
        (4) => {
            narrow_row!("")
        };
        (8) => {
            narrow_row!(concat!(
                "smlad {places}, {row}, {twos}, {places}\n",
                narrow!("uqsub16 r0, r0, {excess}\n add {row}, {row}, r0\n")
            ))
        };
        ($more:expr) => {
            concat!(
                narrow!("uqsub16 {row}, r0, {excess}\n"),
                $more,
                "ldm sp, {{r0-r2}}\n smlad {places}, {row}, r2, {places}\n",
                "smlad {sum}, {row}, {twos}, {sum}\n add {running}, {running}, {sum}\n",
                "add {raw}, {raw}, r1\n",
            )
        };
    }

    /// Rows, some a turn. What a row's end needs waits on the stack, with the frame pointer, whose register
    /// is one more.
    macro_rules! narrow_rows {
        ($($row:expr),*) => {
            concat!(
                "push {{r0, r1, r2, r7}}\n 2:\n", $($row,)* "cmp {floor}, r0\n bne 2b\n",
                "ldr r7, [sp, #12]\n add sp, sp, #16\n",
            )
        };
    }

    /// Runs instructions on rows, of which there is one at least, with the registers that all of them take. `c`
    /// comes with the end of the floors, `d` with the bytes from the end of a row to the start of the next: both
    /// wait on the stack while there are words in them.
    macro_rules! run {
        ($code:expr, $rows:expr, $excess:expr, $($registers:tt)*) => {{
            let Rows { raw, stride, floor } = $rows;
            let floors = floor.as_flattened().as_ptr_range();
            // SAFETY: the instructions read the rows only, all of which `Block::rows` found in their slices,
            // at their alignment. They write registers that are given here, the status flags, which count as
            // changed, and two words of the stack, which they give back.
            #[allow(unsafe_code)]
            unsafe {
                asm!($code,
                    raw = inout(reg) raw.as_ptr() => _, floor = inout(reg) floors.start => _,
                    excess = in(reg) $excess, $($registers)*,
                    a = out(reg) _, b = out(reg) _, c = inout(reg) floors.end => _,
                    d = inout(reg) stride.wrapping_sub(N).wrapping_mul(4) => _,
                    options(readonly));
            }
        }};
    }

    /// `x`, of which the compiler is to know no more than that, whenever it is asked.
    #[inline(always)]
    pub(super) fn anew(mut x: u16) -> u16 {
        // SAFETY: there is nothing in it.
        #[allow(unsafe_code)]
        unsafe {
            asm!("/* {x} */", x = inout(reg) x, options(nomem, nostack, preserves_flags));
        }
        x
    }

    /// Whether rows are of the kind that has instructions here.
    #[inline(always)]
    fn takes<const N: usize>(rows: &Rows<'_, N>) -> bool {
        (N == 4 || N == 8) && rows.count() > 0
    }

    /// Sums of rows of up to 12 bits, which are an even number if `EVEN`.
    #[inline(always)]
    pub(super) fn narrow_sums<const N: usize, const EVEN: bool>(
        rows: Rows<'_, N>,
        excess: u32,
    ) -> RowSums {
        if !takes(&rows) || EVEN && !rows.count().is_multiple_of(2) {
            return word_sums::<N, false>(rows, excess);
        }
        let Rows { raw, stride, floor } = rows;
        let floors = floor.as_flattened().as_ptr_range();
        let (mut sum, mut places, mut running) = (0u32, 0u32, 0u32);
        macro_rules! add {
            ($code:expr) => {{
                // SAFETY: as of `run`; what is pushed is taken back, r7 with it. Of an even number of rows
                // two at a time end where all do.
                #[allow(unsafe_code)]
                unsafe {
                    asm!($code,
                        raw = inout(reg) raw.as_ptr() => _, floor = inout(reg) floors.start => _,
                        excess = in(reg) excess, twos = in(reg) 2 * ONES, sum = inout(reg) sum,
                        places = inout(reg) places, running = inout(reg) running,
                        row = out(reg) _, c = out(reg) _, inout("r0") floors.end => _,
                        inout("r1") stride.wrapping_sub(N).wrapping_mul(4) => _,
                        inout("r2") ONES + 1 => _, out("r3") _,
                        options(readonly));
                }
            }};
        }
        match (N, EVEN) {
            (4, false) => add!(narrow_rows!(narrow_row!(4))),
            (4, true) => add!(narrow_rows!(narrow_row!(4), narrow_row!(4))),
            (_, false) => add!(narrow_rows!(narrow_row!(8))),
            (_, true) => add!(narrow_rows!(narrow_row!(8), narrow_row!(8))),
        }
        super::from_places::<N>(sum, places, running)
    }

    /// Looks at a word. Of pixels that are saturated the signals are kept, and 2^16 - 2 more, as far as 16 bits
    /// hold it, is -1 where there is one and -2 where there is none.
    macro_rules! look {
        ($raw:literal $signal:literal) => {
            concat!(
                "usub16 ",
                $raw,
                ", ",
                $raw,
                ", {white}\n sel ",
                $raw,
                ", ",
                $signal,
                ", {none}\n",
                "uqadd16 ",
                $raw,
                ", ",
                $raw,
                ", {less}\n smlad {dark}, ",
                $raw,
                ", {less}, {dark}\n",
            )
        };
    }

    /// Peaks and saturated pixels, in their lanes and in a lane.
    #[inline(always)]
    pub(super) fn watch(watched: Watched<'_>, [excess, white]: [u32; 2]) -> [u32; 2] {
        let Watched { raw: [a, b], floor: [c, d] } = watched;
        // -2 in both lanes.
        let less = 0xfffe_fffeu32;
        let mut dark = 0u32;
        let peak: u32;
        // SAFETY: the instructions write registers that are given here, and the status flags, which count as
        // changed; they touch no memory.
        #[allow(unsafe_code)]
        unsafe {
            asm!("uqsub16 {c}, {a}, {c}", "uqsub16 {d}, {b}, {d}",
                "uqsub16 {c}, {c}, {excess}", "uqsub16 {d}, {d}, {excess}",
                look!("{a}" "{c}"), look!("{b}" "{d}"),
                "usub16 {a}, {d}, {c}", "sel {c}, {d}, {c}",
                excess = in(reg) excess, white = in(reg) white, none = in(reg) 0, less = in(reg) less,
                dark = inout(reg) dark, a = inout(reg) *a => _, b = inout(reg) *b => _,
                c = inout(reg) *c => peak, d = inout(reg) *d => _,
                options(pure, nomem, nostack));
        }
        // Of four pixels, each saturated one 2 instead of 4.
        [peak, 8 - dark / 2]
    }

    /// See [`word_sums`].
    #[inline(always)]
    pub(super) fn sums<const N: usize, const FLIP: bool>(
        rows: Rows<'_, N>,
        excess: u32,
    ) -> RowSums {
        if !takes(&rows) {
            return word_sums::<N, FLIP>(rows, excess);
        }
        let (mut sum, mut x, mut running) = (0u32, 0u32, 0u32);
        macro_rules! add {
            ($code:expr) => {
                run!($code, rows, excess, ones = in(reg) ONES, weight = inout(reg) FIRST => _,
                    sum = inout(reg) sum, x = inout(reg) x, running = inout(reg) running)
            };
        }
        match (N, FLIP) {
            (4, false) => add!(rows!("0x00100010", words!(""), words!(""))),
            (4, true) => add!(rows!("0x00100010", words!(true), words!(true))),
            (_, false) => {
                add!(rows!("0x00200020", words!(""), words!(""), words!(""), words!("")));
            }
            (_, true) => {
                add!(rows!("0x00200020", words!(true), words!(true), words!(true), words!(true)));
            }
        }
        RowSums { sum, x: x as i32, running }
    }
}

/// The kernel of this module, for rows of any number of words.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pairs;

/// [`Kernel::sums`], of rows that are an even number if `EVEN`.
#[inline(always)]
fn sums<const N: usize, const EVEN: bool>(rows: Rows<'_, N>, cut: Cut) -> RowSums {
    // Not known from the last window's, or all that surrounds this is there three times.
    #[cfg(armv7em)]
    let top = row::anew(cut.top);
    #[cfg(not(armv7em))]
    let top = cut.top;
    if N <= 8 && top <= NARROW_TOP {
        row::narrow_sums::<N, EVEN>(rows, both(cut.excess))
    } else if top <= SIGNED_TOP {
        signed_sums::<N, false>(rows, cut)
    } else {
        let RowSums { sum, x, running } = signed_sums::<N, true>(rows, cut);
        // What the flipped bits took from each row, and from each row's running sum.
        let (row, count) = ((2 * N as u32) << 15, rows.count() as u32);
        let lost = (row >> 1).wrapping_mul(count.wrapping_mul(count + 1));
        let sum = sum.wrapping_add(row.wrapping_mul(count));
        RowSums { sum, x, running: running.wrapping_add(lost) }
    }
}

impl<const N: usize> Kernel<N> for Pairs {
    #[inline(always)]
    fn sums(self, rows: Rows<'_, N>, cut: Cut) -> RowSums {
        sums::<N, false>(rows, cut)
    }

    #[inline(always)]
    fn window(self, rows: Rows<'_, N>, watched: Watched<'_>, cut: Cut) -> (RowSums, Seen) {
        let seen = Kernel::<N>::watch(self, watched, cut);
        (sums::<N, true>(rows, cut), seen)
    }

    #[inline(always)]
    fn watch(self, watched: Watched<'_>, cut: Cut) -> Seen {
        let [peak, saturated] = row::watch(watched, [both(cut.excess), both(cut.saturation)]);
        seen(peak, saturated)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::tests::agree;

    #[test]
    fn packed_and_portable_agree_to_the_bit() {
        for bits in [12, 15, 16] {
            let top = ((1u32 << bits) - 1) as u16;
            agree::<8, 4>(top, Pairs);
            agree::<16, 8>(top, Pairs);
            agree::<32, 16>(top, Pairs);
        }
    }
}
