//! Serves host-sim: detector frames in, DAC codes and telemetry out.
#![no_std]
#![no_main]

use mps2_an500::{Exit, Pipes, RAM_BYTES, STACK_BYTES, exit};
use semihosting::io::ErrorKind;
use splash_firmware::banks::Banks;
use splash_firmware::config::Config;
use splash_firmware::controller::Controller;
use splash_firmware::link::LIST;
use splash_firmware::modal::MAX_MODES;
use splash_firmware::telemetry::Ring;
use splash_server::{controller, serve};
use static_cell::ConstStaticCell;

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

static RUNNING: ConstStaticCell<Config<M, P, B, K>> = ConstStaticCell::new(Config::new());
static OTHER: ConstStaticCell<Config<M, P, B, K>> = ConstStaticCell::new(Config::new());
static TELEMETRY: ConstStaticCell<Ring<R>> = ConstStaticCell::new(Ring::new());
static CONTROLLER: ConstStaticCell<Controller<M, B, K>> = ConstStaticCell::new(controller());

const NEEDED: usize = 2 * size_of::<Config<M, P, B, K>>()
    + size_of::<Controller<M, B, K>>()
    + size_of::<Ring<R>>()
    + size_of::<Pipes>()
    + STACK_BYTES;
const _: () = const_panic::concat_assert!(
    NEEDED <= RAM_BYTES,
    "M = ",
    M,
    ", P = ",
    P,
    ", B = ",
    B,
    " and the stack need ",
    NEEDED,
    " bytes: ",
    NEEDED.saturating_sub(RAM_BYTES),
    " more than the board has"
);

#[cortex_m_rt::entry]
fn main() -> ! {
    let banks = Banks::new(RUNNING.take(), OTHER.take());
    let ended = match Pipes::open() {
        Ok(mut pipes) => {
            defmt::info!("room for {} windows, {} window pixels, {} buffered", M, P, B);
            serve(&mut pipes, "mps2-an500", banks, CONTROLLER.take(), TELEMETRY.take())
        }
        Err(error) => error,
    };
    if ended.kind() == ErrorKind::UnexpectedEof {
        defmt::info!("the link has ended");
        exit(Exit::Done)
    }
    defmt::error!("pipes: {}", defmt::Display2Format(&ended));
    exit(Exit::Link)
}
