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
//! | [`frame_clock`] | frame numbers from laser pulses and VSYNC |
//! | [`frame_loop`] | blocks through the pipeline, codes to the DACs |
//! | [`gate`] | delay and width of the range gate in ticks |
//! | [`ad5370`] | words of the DACs |
//! | [`dac_bus`] | which DAC is whose; the words by `embedded-hal` |
//! | [`dac_burst`] | the same words as one DMA transfer a bus, and the timer that steers them |
//! | [`queues`] | what interrupts, frames and main loop pass to one another |
//! | [`asking`], [`answers`] | how the main loop asks, and what is then done |
//! | [`service`] | requests of the link |
//! | [`byte_ring`] | bytes of the link as the DMA writes them |

#![cfg_attr(not(test), no_std)]

pub mod ad5370;
pub mod answers;
pub mod asking;
pub mod byte_ring;
pub mod clocks;
pub mod dac_burst;
pub mod dac_bus;
pub mod frame_clock;
pub mod frame_loop;
pub mod gate;
pub mod mpu;
pub mod pins;
pub mod queues;
pub mod requests;
pub mod ring;
pub mod service;
pub mod shape;
