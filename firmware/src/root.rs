//! The root of an actuator's drive: codes that go with the square root of a height.
//!
//! ```text
//! code = 16 sqrt(v)                        v below 2^24
//! code = floor(start + rise v / 2^32)      of the cell that v is in, with 1/2 in it
//! ```
//!
//! A cell's line is parallel to its chord and as far below the curve's highest point over it as it is above its
//! ends: off by at most w^2 / 4 v^(3/2) codes in a cell of width w. A start is a whole number, and the line turns about
//! its cell's middle for that, by up to w / 4 v codes at the ends. Cells are narrower towards 0:
//!
//! | v | codes | width | off by less than |
//! |---|---|---|---|
//! | from 2^20 on | from 16384 on | 2^15 | 1/4 code; 1/100 at the highest |
//! | 2^15 to 2^20 | from 2896 on | 2^11 | 1/5 code |
//! | 2^9 to 2^15 | from 362 on | 2^7 | 1/3 code |
//! | below | | 2^7 | 12 of v: 2^-20 of the highest |
//!
//! and half a code for rounding to nearest. (In the first cell the curve is steeper than a rise can be. Of the lowest
//! codes 12 of v are many, 53 of 0, but the highest code is rounded by 256 of v.) Roots never fall.

/// Bits of v.
pub(crate) const BITS: u32 = 24;
/// Bits of v below the cell of [`STEPS`].
pub(crate) const STEP_BITS: u32 = 15;

/// A range of v whose cells are of one width.
struct Range {
    /// Its first and last step of v, and one more.
    steps: (u32, u32),
    /// Bits of v below a cell.
    width: u32,
    /// Word at which its lines start. `dsp::codes` wants it, times four, to be three less than `width` modulo 32.
    start: u32,
}

const RANGES: [Range; 3] = [
    Range { steps: (0, 1), width: 7, start: 1 },
    Range { steps: (1, 32), width: 11, start: 514 },
    Range { steps: (32, 1 << (BITS - STEP_BITS)), width: STEP_BITS, start: 1507 },
];

const WORDS: usize = 2467;

/// Starts and rises, two words a cell.
#[cfg_attr(target_arch = "riscv32", repr(align(32)))]
pub(crate) struct Lines(pub(crate) [u32; WORDS]);

/// The lines of all cells.
pub(crate) static LINES: Lines = Lines(lines());

/// For the upper bits of v the word that its range's first line would be at if there were lines from v = 0 on, times
/// 16, and its cells' width.
static STEPS: [u16; 1 << (BITS - STEP_BITS)] = {
    let mut steps = [0; 1 << (BITS - STEP_BITS)];
    let mut i = 0;
    while i < steps.len() {
        let (word, width) = place(i as u32);
        steps[i] = (word << 4 | width) as u16;
        i += 1;
    }
    steps
};

/// Of a step, where its line would be if there were lines from v = 0 on, and the bits of v below a cell.
pub(crate) const fn place(step: u32) -> (u32, u32) {
    let [low, middle, high] = &RANGES;
    let range = if step < low.steps.1 {
        low
    } else if step < middle.steps.1 {
        middle
    } else {
        high
    };
    let Range { steps: (first, _), width, start } = *range;
    (start - 2 * (first << STEP_BITS >> width), width)
}

const fn lines() -> [u32; WORDS] {
    let mut lines = [0; WORDS];
    let mut range = 0;
    while range < RANGES.len() {
        let Range { steps: (first, end), width, start } = RANGES[range];
        let mut i = start as usize;
        let mut v = first << STEP_BITS;
        while v < end << STEP_BITS {
            let [from, rise] = line(v as u64, (v + (1 << width)) as u64);
            (lines[i], lines[i + 1]) = (from, rise);
            v += 1 << width;
            i += 2;
        }
        range += 1;
    }
    lines
}

/// The line from `a` to `b`: where it is at 0, in codes, and its rise in 2^-32.
const fn line(a: u64, b: u64) -> [u32; 2] {
    if a == 0 {
        return [53, u32::MAX];
    }
    // Q19, and the rest in Q32.
    let (low, high) = ((a << 38).isqrt() as u128, (b << 38).isqrt() as u128);
    let (sum, difference) = (low + high, high - low);
    let half_above = ((2 * difference * difference) << 13) / sum;
    let middle = ((8 * sum) << 13) + half_above + (1 << 31);
    let rise = (16 << (32 + 19)) / sum;
    let half_way = (a + b) as u128 / 2;
    let start = (middle - rise * half_way + (1 << 31)) >> 32;
    [start as u32, ((middle - (start << 32)) / half_way) as u32]
}

/// Start and rise of the line for `v`.
#[inline(always)]
fn line_of(v: u32) -> [u32; 2] {
    let step = STEPS.get((v >> STEP_BITS) as usize % STEPS.len()).copied().unwrap_or(0);
    let i = u32::from(step >> 4) + 2 * (v >> (step & 15));
    // Always there.
    let line = LINES.0.get(i as usize..).and_then(|lines| lines.first_chunk());
    line.copied().unwrap_or_default()
}

/// 16 sqrt(v), to nearest, for v below 2^24: see the module.
#[inline(always)]
#[must_use]
pub fn root(v: u32) -> u32 {
    let [start, rise] = line_of(v);
    start.wrapping_add(((u64::from(rise) * u64::from(v)) >> 32) as u32)
}

/// The same in units of 2^`bits`.
#[inline(always)]
#[must_use]
pub fn coarse_root(v: u32, bits: u32) -> u32 {
    let [start, rise] = line_of(v);
    let line = (u64::from(start) << 32) + u64::from(rise) * u64::from(v);
    // The half of one is in it, and the half of a unit is wanted.
    ((line + (1 << (31 + bits)) - (1 << 31)) >> (32 + bits)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All arguments, against the root in f64.
    #[test]
    fn roots_are_within_their_bounds() {
        let mut last = 0;
        for v in 0..1 << BITS {
            let (_, width) = place(v >> STEP_BITS);
            let (from, w) = (f64::from(v >> width << width), f64::from(1 << width));
            let [start, rise] = line_of(v);
            let line = f64::from(start) + f64::from(rise) * f64::from(v) / power(32) - 0.5;
            let exact = 16.0 * f64::from(v).sqrt();
            if from == 0.0 {
                assert!((line * line / 256.0 - f64::from(v)).abs() < 12.0, "{v}: {line}");
            } else {
                // The chord, half as far off as it is at most; half a code at a half cell's end; rises that are rounded
                // down, and roots of 19 bits.
                let turned = w / (4.0 * (from + w / 2.0)) + f64::from(v) / power(32) + 1e-4;
                let bound = w * w / (4.0 * from.powf(1.5)) + turned;
                assert!((line - exact).abs() < bound, "{v}: {line}, not {exact}");
                // What the module says of each range.
                let said = match v {
                    0x0010_0000.. => 0.25,
                    0x8000.. => 0.2,
                    0x200.. => 1.0 / 3.0,
                    _ => f64::INFINITY,
                };
                assert!((line - exact).abs() < said, "{v}: {line}, not {exact}");
                assert!(v < (1 << BITS) - (1 << STEP_BITS) || (line - exact).abs() < 0.01, "{v}");
                let drive = line * line / 256.0 - f64::from(v);
                assert!(v >= 1 << STEP_BITS || drive.abs() < 12.0, "{v}: {drive}");
            }
            let code = root(v);
            assert!((f64::from(code) - line).abs() <= 0.5, "{v}: {code}, not {line}");
            assert!(last <= code, "{v}: falls");
            last = code;
            for bits in 0..=8 {
                let coarse = f64::from(coarse_root(v, bits)) - line / power(bits);
                assert!(coarse.abs() <= 0.5, "{v}: {bits} bits");
            }
        }
    }

    fn power(bits: u32) -> f64 {
        f64::powi(2.0, bits as i32)
    }

    #[test]
    fn ranges_are_where_their_lines_are() {
        let mut next = 1;
        let mut step = 0;
        for Range { steps: (first, end), width, start } in RANGES {
            assert_eq!((first, 4 * start % 32, start - next < 8), (step, width - 3, true));
            (next, step) = (start + 2 * ((end - first) << STEP_BITS >> width), end);
        }
        assert_eq!((next as usize, step), (WORDS, 1 << (BITS - STEP_BITS)));
    }
}
