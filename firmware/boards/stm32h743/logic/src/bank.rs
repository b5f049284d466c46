//! A bank that runs: read by the frames' exception and by the main loop, and written by nobody.
//!
//! Each has a half of it. Only both halves together are a bank that can be changed again, so that nothing
//! can change in a frame, and nothing is locked.

use splash_firmware::config::Config;
use static_rc::StaticRcRef;

type Whole<const M: usize, const P: usize, const B: usize> =
    StaticRcRef<'static, Config<M, P, B>, 2, 2>;

/// The right to read a bank.
pub type Half<const M: usize, const P: usize, const B: usize> =
    StaticRcRef<'static, Config<M, P, B>, 1, 2>;

/// Two rights to read a bank, for the one to write it.
pub fn split<const M: usize, const P: usize, const B: usize>(
    bank: &'static mut Config<M, P, B>,
) -> (Half<M, P, B>, Half<M, P, B>) {
    Whole::split(Whole::new(bank))
}

/// The right to write a bank, for both to read it; `None` if they are not those of one bank.
pub fn join<const M: usize, const P: usize, const B: usize>(
    one: Half<M, P, B>,
    other: Half<M, P, B>,
) -> Option<&'static mut Config<M, P, B>> {
    StaticRcRef::ptr_eq(&one, &other).then(|| Whole::into_inner(Whole::join(one, other)))
}
