//! How large an instrument this image takes, and that it fits the board.

use splash_firmware::config::Config;
use splash_firmware::controller::Controller;
use splash_firmware::telemetry::Ring;
use static_cell::ConstStaticCell;
use stm32h743_logic::clocks::TIMER_HZ;
use stm32h743_logic::dac_bus::SEGMENTS;
use stm32h743_logic::frame_loop::RECORDS;
use stm32h743_logic::queues::Queues;
use stm32h743_logic::rounds::TIMES;
use stm32h743_logic::service::SERIALS;
use stm32h743_logic::shape::RING_BYTES;

/// Cells of the subaperture grid: 8 x 8.
#[cfg(not(feature = "too-large"))]
pub(crate) const M: usize = 64;
/// Cells of a grid of 40 x 40, for the test that they are refused.
#[cfg(feature = "too-large")]
pub(crate) const M: usize = 1600;
/// Window pixels: 64 windows of 16 x 16.
pub(crate) const P: usize = 256 * M;
/// Pixels that brightest-n can buffer: 8 windows of 16 x 16 in a row.
pub(crate) const B: usize = 2_048;

/// What DTCM keeps for the stack, bytes.
pub(crate) const STACK_BYTES: usize = 32 << 10;
/// DTCM, `RAM` in memory.x, bytes.
const DTCM_BYTES: usize = 128 << 10;
/// What the queues, the interrupts, the logs and the libraries have there beside the controller, bytes.
const OTHERS_BYTES: usize = size_of::<Queues<M, P, B>>() + size_of::<Ring<RECORDS>>() + (8 << 10);
/// AXI SRAM, `AXISRAM` in memory.x, bytes.
const AXI_BYTES: usize = 512 << 10;

/// The hot state, in DTCM.
pub(crate) static CONTROLLER: ConstStaticCell<Controller<M, B>> =
    ConstStaticCell::new(Controller::new(SERIALS, TIMES, TIMER_HZ));
/// Telemetry that waits for the link, in DTCM.
pub(crate) static TELEMETRY: ConstStaticCell<Ring<RECORDS>> = ConstStaticCell::new(Ring::new());
/// The queues, in DTCM.
pub(crate) static QUEUES: ConstStaticCell<Queues<M, P, B>> = ConstStaticCell::new(Queues::new());

const HOT: usize = size_of::<Controller<M, B>>() + OTHERS_BYTES + STACK_BYTES;
const BANKS: usize = 2 * size_of::<Config<M, P, B>>() + RING_BYTES;

const _: () = const_panic::concat_assert!(
    HOT <= DTCM_BYTES,
    "M = ",
    M,
    ", B = ",
    B,
    ": hot state and stack need ",
    HOT,
    " bytes of DTCM: ",
    HOT.saturating_sub(DTCM_BYTES),
    " more than the board has"
);
const _: () = const_panic::concat_assert!(
    BANKS <= AXI_BYTES,
    "M = ",
    M,
    ", P = ",
    P,
    ": two banks and the ring of rows need ",
    BANKS,
    " bytes of AXI SRAM: ",
    BANKS.saturating_sub(AXI_BYTES),
    " more than the board has"
);
const _: () = const_panic::concat_assert!(
    M <= SEGMENTS,
    "M = ",
    M,
    ": there are DACs for ",
    SEGMENTS,
    " segments: ",
    M.saturating_sub(SEGMENTS),
    " fewer than the geometry has"
);
