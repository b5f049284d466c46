//! Floats to integers, a vector at a time: the conversion of the language, which also settles what does not
//! fit, is done one by one.

/// 1.5 * 2^23: adding it rounds to an integer, which is then in the lowest bits.
const ROUND: f32 = 12_582_912.0;

/// The greatest integer up to `x`, from 0 to 2^22.
#[inline(always)]
pub(super) fn floor(x: f32) -> u32 {
    let rounded = x + ROUND;
    let up = u32::from(rounded - ROUND > x);
    rounded.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_sub(up)
}

#[cfg(test)]
mod tests {
    #[test]
    fn floor_at_and_about_every_half() {
        for half in 0..1 << 16 {
            let x = half as f32 / 2.0;
            for x in [x.next_down().max(0.0), x, x.next_up()] {
                assert_eq!(super::floor(x), x.floor() as u32, "{x}");
            }
        }
    }
}
