//! What the tests share: instruments, frames made of integers, and models of every stage.
//!
//! Expectations come from [`twin`]: the same stages in f64, written from their equations. Nothing
//! in it calls the firmware.

pub mod frames;
pub mod fuzz;
pub mod golden;
pub mod instrument;
pub mod memory_map;
pub mod twin;

/// Runs `body` on a thread whose stack holds the largest configuration several times over.
///
/// A configuration or a pipeline of 40 x 40 subapertures is moved through the stack on its way
/// into its box. Panics are passed on.
pub fn with_big_stack<T: Send>(body: impl FnOnce() -> T + Send) -> T {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().stack_size(256 << 20).spawn_scoped(scope, body);
        match thread.expect("a thread").join() {
            Ok(value) => value,
            Err(panic) => std::panic::resume_unwind(panic),
        }
    })
}

/// Root mean square of the values; zero of none.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    if count > 0.0 { f64::sqrt(sum / count) } else { 0.0 }
}

/// Largest magnitude of the values; zero of none.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |most, v| f64::max(most, v.abs()))
}
