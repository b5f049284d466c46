//! The STM32H743 board: what it decides, on a model of its hardware; and its flash image, as linked.

mod control;
mod dacs;
mod flash;
mod frames;
mod image;
mod rig;
mod service;
