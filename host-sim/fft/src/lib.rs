//! Plans of discrete Fourier transforms.
//!
//! The transforms of `rustfft` are generic over the number: each crate that plans one compiles all of
//! them. They were a fifth of the simulator's code; here they are compiled once.

use rustfft::FftPlanner;
use std::sync::Arc;

pub use rustfft::{Fft, num_complex::Complex};

/// A transform of one length, without normalisation.
pub type Transform<T> = Arc<dyn Fft<T>>;

/// Numbers whose transforms are compiled here.
pub trait Planned: Sized {
    /// X_k = sum_j x_j exp(-2 pi i j k / `len`).
    fn forward(len: usize) -> Transform<Self>;
    /// x_j = sum_k X_k exp(2 pi i j k / `len`).
    fn inverse(len: usize) -> Transform<Self>;
}

macro_rules! planned {
    ($($number:ty),*) => {$(
        impl Planned for $number {
            fn forward(len: usize) -> Transform<Self> {
                FftPlanner::new().plan_fft_forward(len)
            }
            fn inverse(len: usize) -> Transform<Self> {
                FftPlanner::new().plan_fft_inverse(len)
            }
        }
    )*};
}
planned!(f32, f64);
