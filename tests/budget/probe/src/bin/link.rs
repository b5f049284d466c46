//! Everything that bytes from outside reach: the link's decoder and encoder, uploads, adjustments, the
//! operator's commands. A panic that could be reached calls a function that there is not: then this
//! does not link.
#![no_std]
#![no_main]

use splash_firmware::adjust::{Adjustment, Parameter};
use splash_firmware::banks::Draft;
use splash_firmware::config::Config;
use splash_firmware::controller::{Command, Controller, FrameResult};
use splash_firmware::link::{self, Message, Receiver, Request, Response, WIRE};
use splash_firmware::telemetry::{Ring, Stamp};

/// Cells of the grid.
const M: usize = 8 * 8;
/// Pixels of all windows.
const P: usize = M * 16 * 16;
/// Pixels that brightest-n buffers.
const B: usize = 8 * 16 * 16;
/// Modes of a second gate.
const K: usize = 25;
/// Records of telemetry.
const R: usize = 40;

unsafe extern "C" {
    fn a_panic_can_be_reached() -> !;
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    unsafe { a_panic_can_be_reached() }
}

#[unsafe(no_mangle)]
fn probe_decode(receiver: &mut Receiver, byte: u8) -> Option<Message<Request>> {
    receiver.push(byte).and_then(Result::ok)
}

#[unsafe(no_mangle)]
fn probe_encode(response: &Message<Response>, wire: &mut [u8; WIRE]) -> usize {
    link::encode(response, wire).map_or(0, |bytes| bytes.len())
}

#[unsafe(no_mangle)]
fn probe_upload(draft: &mut Draft<'_, M, P, B, K>, offset: u32, bytes: &[u8]) -> bool {
    let begun = if offset == 0 { draft.begin(bytes.len() as u32) } else { Ok(()) };
    begun.and_then(|()| draft.chunk(offset, bytes)).is_ok()
}

#[unsafe(no_mangle)]
fn probe_adjust(
    draft: &mut Draft<'_, M, P, B, K>,
    change: &Adjustment,
    other: &Config<M, P, B, K>,
) -> bool {
    draft.copy(other).is_ok() && draft.adjust(change).is_ok() && draft.check().is_ok()
}

#[unsafe(no_mangle)]
fn probe_exchange<'a>(
    draft: &mut Draft<'a, M, P, B, K>,
    running: &mut &'a mut Config<M, P, B, K>,
    controller: &mut Controller<M, B, K>,
) -> bool {
    let admit = |before: &Config<M, P, B, K>, next: &Config<M, P, B, K>| {
        controller.exchange(before, next, next.calibration().is_ok())
    };
    draft.switch().is_ok() && draft.exchange(running, admit).is_some()
}

#[unsafe(no_mangle)]
fn probe_read(config: &Config<M, P, B, K>, parameter: Parameter, buffer: &mut [u8]) -> bool {
    config.excerpt(7, buffer).is_empty() || config.value(parameter).is_ok()
}

#[unsafe(no_mangle)]
fn probe_command(
    controller: &mut Controller<M, B, K>,
    config: &Config<M, P, B, K>,
    command: Command,
) -> bool {
    controller.request(config, command, config.calibration().is_ok(), 0).is_ok()
}

#[unsafe(no_mangle)]
fn probe_telemetry(
    ring: &mut Ring<R>,
    controller: &Controller<M, B, K>,
    result: &FrameResult,
    stamp: &Stamp,
) -> bool {
    ring.fill(controller.pipeline(), result, stamp);
    ring.pop().is_some()
}
