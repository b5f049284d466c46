//! The fixed-point primitives, over the edges of their ranges and random arguments.

use splash_firmware::fixed;
use splash_firmware::inverse::Inverse;
use splash_firmware::root;

use crate::digest::{Digest, Hasher};
use crate::generator::Generator;

/// Arguments of each primitive.
const ARGUMENTS: u32 = 1000;

/// Each primitive with the digest of its results.
pub(crate) fn digests() -> [(&'static str, Digest); 6] {
    [
        over("quotient", |numbers, hasher| {
            let flux = divisor(numbers);
            // |moment| <= 31 flux < 2^31.
            let moment = (i64::from(numbers.bits() as i32) * 31 * i64::from(flux)) >> 31;
            hasher.i32(Inverse::new(flux).quotient_q15(moment as i32));
        }),
        over("ratio", |numbers, hasher| {
            let mut term = || numbers.edge(&[0, 1, 2, 1 << 22, (1 << 22) - 1]);
            hasher.u32(fixed::ratio_q16(term(), term().min(1 << 22)));
        }),
        over("square-root", |numbers, hasher| {
            let v = numbers.edge(&[0, 1, u32::MAX, u32::MAX >> 4, u32::MAX >> 9]) >> 8;
            hasher.u32(root::root(v));
            hasher.u32(root::coarse_root(v, numbers.below(9)));
        }),
        over("multiply-unsigned", |numbers, hasher| {
            let a = numbers.edge(&[0, 1, u32::MAX, i32::MAX as u32, i32::MIN as u32]) as i32;
            let b = numbers.edge(&[0, 1, 1 << 31, u32::MAX]);
            hasher.i32(fixed::mul_high_unsigned(a, b));
        }),
        over("round-shift", |numbers, hasher| {
            let x = (u64::from(numbers.bits()) << 32 | u64::from(numbers.bits())) as i64 >> 2;
            let n = 1 + numbers.below(62);
            hasher.u64(fixed::round_shift(x >> numbers.below(32), n) as u64);
        }),
        over("saturate", |numbers, hasher| {
            let x = (u64::from(numbers.bits()) << 32 | u64::from(numbers.bits())) as i64;
            let limit = (numbers.bits() >> 1) as i32;
            hasher.i32(fixed::saturate(x >> numbers.below(64), limit));
        }),
    ]
}

/// Below 2^26, of any size.
fn divisor(numbers: &mut Generator) -> u32 {
    let divisor = numbers.edge(&[0, 1, 2, 3, 1 << 25, (1 << 26) - 1]) & ((1 << 26) - 1);
    divisor >> (numbers.below(4) * numbers.below(8))
}

fn over(
    name: &'static str,
    mut one: impl FnMut(&mut Generator, &mut Hasher),
) -> (&'static str, Digest) {
    let (numbers, mut hasher) = (&mut Generator::new(ARGUMENTS), Hasher::default());
    for _ in 0..ARGUMENTS {
        one(numbers, &mut hasher);
    }
    (name, hasher.finish())
}
