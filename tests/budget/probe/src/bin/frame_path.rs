//! The three calls of a frame, at the capacities of 8 x 8 subapertures with windows of
//! 16 x 16 pixels. Arguments come by reference, so that no entry knows their values.
#![no_std]
#![no_main]

use splash_firmware::config::Config;
use splash_firmware::pipeline::{Pipeline, Report};

/// Cells of the grid.
const M: usize = 8 * 8;
/// Pixels of all windows.
const P: usize = M * 16 * 16;
/// Pixels that brightest-n buffers: the eight windows that share a row.
const B: usize = 8 * 16 * 16;

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop {}
}

#[unsafe(no_mangle)]
fn probe_begin(pipeline: &mut Pipeline<M, B>, config: &Config<M, P, B>, frame: u32) {
    pipeline.begin(config, frame);
}

#[unsafe(no_mangle)]
fn probe_push_row(pipeline: &mut Pipeline<M, B>, config: &Config<M, P, B>, row: &[u16]) -> bool {
    pipeline.push_row(config, row).is_ok()
}

#[unsafe(no_mangle)]
fn probe_finish(pipeline: &mut Pipeline<M, B>, config: &Config<M, P, B>) -> Report {
    pipeline.finish(config)
}
