//! Vector instructions behind safe functions: the one module of the library with `unsafe` in it.
//!
//! A kernel here computes the integers of its portable twin in `pixels` and `centroid`, bit for
//! bit, and is tested against it. A target without one uses the twin.

#[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
pub(crate) mod sse2;
