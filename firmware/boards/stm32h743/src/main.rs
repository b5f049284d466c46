//! SPLASH on an STM32H743: the flash image.
//!
//! Two interrupts, an exception for the frames' work, and a main loop. [`interrupts`] has their priorities
//! and deadlines; what they decide is in the crate `stm32h743-logic`, which is tested on a PC. Here are the registers, a file for
//! each piece of hardware.

#![no_std]
#![no_main]

mod clocks;
mod counter;
mod critical;
mod dacs;
mod desk;
mod detector;
mod enables;
mod flash;
mod gate;
mod geometry;
mod handed;
mod interrupts;
mod memory;
mod pins;
mod stack;
mod start;
mod stop;
mod uart;

use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_stm32::wdg::IndependentWatchdog;
use geometry::{B, CONTROLLER, M, P, QUEUES, TELEMETRY};
use stm32h743_logic::bank;
use stm32h743_logic::frame_loop::FrameLoop;
use stm32h743_logic::queues::FrameSide;
use stm32h743_logic::restart;
use stm32h743_logic::service::Service;

/// How the board calls itself on the link.
const NAME: &str = "stm32h743";
/// After which time without a whole round the watchdog starts the board anew, us.
const WATCHDOG_US: u32 = 100_000;

#[entry]
fn main() -> ! {
    let peripherals = embassy_stm32::init(clocks::config());
    let Some(mut core) = cortex_m::Peripherals::take() else { stop::halt() };
    start::memories(&mut core);
    let Some(memory) = memory::take() else { stop::halt() };
    counter::start(&mut core);
    enables::down();
    pins::connect();
    gate::start();

    let controller = CONTROLLER.take();
    if let Some(words) = &memory.said {
        defmt::error!("the program before: {}, {}", words.cause, words.text.as_str());
        defmt::error!("in {} at {}, place {:#x}", words.mode, words.at, words.place);
    }
    if let Some(fault) = restart::fault(memory.said.as_ref(), start::by_watchdog()) {
        controller.fault(fault, 0);
    }

    let ends = QUEUES.take().split();
    let [running, other] = memory.banks;
    let (mine, theirs) = bank::split(running);
    let dacs = dacs::DmaDacs::new(memory.words);
    let frames = FrameLoop::new(controller, TELEMETRY.take(), theirs, dacs, counter::Cycles);
    let frames = FrameSide::new(frames, ends.frames);
    let uart = uart::Link::new(peripherals.USART3, peripherals.PD8, peripherals.PD9, memory.link);
    let mut watchdog = IndependentWatchdog::new(peripherals.IWDG1, WATCHDOG_US);
    watchdog.unleash();
    let mut desk = desk::Desk::new(uart, watchdog, ends.news);
    interrupts::start(
        &mut core,
        interrupts::Rows { side: ends.rows, detector: detector::Dma::new(memory.ring.address()) },
        interrupts::Frames { side: frames, ring: memory.ring },
    );
    defmt::info!("room for {} cells, {} window pixels, {} buffered", M, P, B);
    let mut service = Service::new(NAME, ends.asking, ends.telemetry, mine, other);
    match service.restore(&mut desk) {
        Ok(()) => defmt::info!("the stored configuration runs"),
        Err(reason) => defmt::warn!("{}", defmt::Display2Format(&reason)),
    }
    match service.run(&mut desk) {}
}
