//! The three calls of a frame, at the capacities of 8 x 8 subapertures with windows of
//! 16 x 16 pixels. Arguments come by reference, so that no entry knows their values.
#![no_std]
#![no_main]

use splash_firmware::config::Config;
use splash_firmware::modal::MAX_MODES;
use splash_firmware::pipeline::{Pipeline, Report};

/// Cells of the grid.
const M: usize = 8 * 8;
/// Pixels of all windows.
const P: usize = M * 16 * 16;
/// Pixels that brightest-n buffers: the eight windows that share a row.
const B: usize = 8 * 16 * 16;

/// The same with two gates and as many modes as there may be: their windows, pixels and modes.
type TwoGateConfig = Config<{ 2 * M }, { 2 * P }, B, MAX_MODES>;
type TwoGatePipeline = Pipeline<{ 2 * M }, B, MAX_MODES>;

/// Bytes on this target of bank and state, without and with the buffer of brightest-n: for
/// 8 x 8 subapertures with windows of 16 x 16 pixels, and for 16 x 16 with 8 x 8.
#[unsafe(no_mangle)]
static PROBE_SIZES: [u32; 8] = [
    size_of::<Config<64, P, 0>>() as u32,
    size_of::<Config<64, P, 2048>>() as u32,
    size_of::<Pipeline<64, 0>>() as u32,
    size_of::<Pipeline<64, 2048>>() as u32,
    size_of::<Config<256, P, 0>>() as u32,
    size_of::<Config<256, P, 1024>>() as u32,
    size_of::<Pipeline<256, 0>>() as u32,
    size_of::<Pipeline<256, 1024>>() as u32,
];

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

#[unsafe(no_mangle)]
fn probe_begin_two_gates(pipeline: &mut TwoGatePipeline, config: &TwoGateConfig, frame: u32) {
    pipeline.begin(config, frame);
}

#[unsafe(no_mangle)]
fn probe_push_row_two_gates(
    pipeline: &mut TwoGatePipeline,
    config: &TwoGateConfig,
    row: &[u16],
) -> bool {
    pipeline.push_row(config, row).is_ok()
}

#[unsafe(no_mangle)]
fn probe_finish_two_gates(pipeline: &mut TwoGatePipeline, config: &TwoGateConfig) -> Report {
    pipeline.finish(config)
}
