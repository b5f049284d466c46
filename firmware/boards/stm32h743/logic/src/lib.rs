//! What the STM32H743 board decides, without the registers: what can be wrong in it is tested on a PC.
//!
//! | module | what |
//! |---|---|
//! | [`clocks`] | dividers of the PLLs, and the frequencies that come out |
//! | [`pins`] | what is on which pin |
//! | [`requests`] | which event feeds which DMA stream |
//! | [`mpu`] | the one region without a cache |
//! | [`shape`] | rows a block, blocks a frame, places of the blocks in memory |
//! | [`ring`] | the detector's blocks as the DMA fills them |
//! | [`frame_clock`] | frame numbers, and pulses of a frame, from laser pulses and VSYNC |
//! | [`time`] | time since the start |
//! | [`frame_loop`] | blocks through the controller, codes to the DACs |
//! | [`rounds`] | what is done beside: interlock, missing frames, telemetry |
//! | [`bank`] | the bank that runs, read on both sides |
//! | [`gate`] | the range gate's timer |
//! | [`ad5370`] | words of the DACs |
//! | [`dac_bus`] | which DAC is whose; the words by `embedded-hal` |
//! | [`dac_burst`] | the same words as one DMA transfer a bus, and the timer that steers them |
//! | [`queues`] | what interrupts, frames and main loop pass to one another |
//! | [`asking`], [`answers`] | how the main loop asks, and what is then done |
//! | [`service`] | requests of the link |
//! | [`byte_ring`] | bytes of the link as the DMA writes them |
//! | [`flash`] | the store's flash bank, on the flash controller's registers |
//! | [`restart`] | why the board has started |

#![cfg_attr(not(test), no_std)]

pub mod ad5370;
pub mod answers;
pub mod asking;
pub mod bank;
pub mod byte_ring;
pub mod clocks;
pub mod dac_burst;
pub mod dac_bus;
pub mod flash;
pub mod frame_clock;
pub mod frame_loop;
pub mod gate;
pub mod mpu;
pub mod pins;
pub mod queues;
pub mod requests;
pub mod restart;
pub mod ring;
pub mod rounds;
pub mod service;
pub mod shape;
pub mod time;
