//! Serves host-sim: detector rows in, DAC codes and telemetry out.
#![no_std]
#![no_main]

use core::fmt::Write;
use ibex::{Console, DMEM_BYTES, Exit, Once, Ports, STACK_BYTES, exit};
use splash_firmware::banks::Banks;
use splash_firmware::config::Config;
use splash_firmware::controller::Controller;
use splash_firmware::link::LIST;
use splash_firmware::modal::MAX_MODES;
use splash_firmware::telemetry::Ring;
use splash_server::{controller, serve};

/// Windows: two gates of the 208 subapertures of a circle 16 across; and cells of the grid.
const M: usize = 416;
/// Window pixels: 416 windows of 8 x 8, or 104 of 16 x 16.
const P: usize = 26_624;
/// Pixels that brightest-n can buffer: 8 windows of 16 x 16 in a row, or 16 of 8 x 8 in two.
const B: usize = 2_048;
/// Modes of a second gate.
const K: usize = MAX_MODES;
/// Records of telemetry: those of a frame, its summary and what there is of each subaperture, and one more.
const R: usize = 2 + 4 * M.div_ceil(LIST);

static RUNNING: Once<Config<M, P, B, K>> = Once::new(Config::new());
static OTHER: Once<Config<M, P, B, K>> = Once::new(Config::new());
static TELEMETRY: Once<Ring<R>> = Once::new(Ring::new());
static CONTROLLER: Once<Controller<M, B, K>> = Once::new(controller());

const NEEDED: usize = 2 * size_of::<Config<M, P, B, K>>()
    + size_of::<Controller<M, B, K>>()
    + size_of::<Ring<R>>()
    + STACK_BYTES;
const _: () = const_panic::concat_assert!(
    NEEDED <= DMEM_BYTES,
    "M = ",
    M,
    ", P = ",
    P,
    ", B = ",
    B,
    " and the stack need ",
    NEEDED,
    " bytes: ",
    NEEDED.saturating_sub(DMEM_BYTES),
    " more than the board has"
);

/// Where `start` goes.
// SAFETY: the name is that of the call in `start` and of nothing else.
#[allow(unsafe_code, reason = "an entry by its name")]
#[unsafe(no_mangle)]
extern "C" fn main() -> ! {
    if let (Some(running), Some(other), Some(control), Some(telemetry)) =
        (RUNNING.take(), OTHER.take(), CONTROLLER.take(), TELEMETRY.take())
    {
        let _ = writeln!(Console, "room for {M} windows, {P} window pixels, {B} buffered");
        let banks = Banks::new(running, other);
        // The one way in which it ends.
        let ibex::Closed = serve(&mut Ports::new(), "ibex", banks, control, telemetry);
    }
    exit(Exit::Done)
}
