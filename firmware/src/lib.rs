//! SPLASH wavefront reconstructor: detector rows in, DAC codes of a segmented mirror out.
//!
//! SPLASH (Butterley, Love, Wilson, Myers & Morris 2006) launches an array of converging laser
//! beams from a telescope's pupil. Each makes a spot on the sky; the centroid of a spot's image is
//! its subaperture's wavefront tilt minus the global tilt. A segmented mirror takes tip and tilt
//! from the centroids and its pistons from a successive over-relaxation solve.
//!
//! The library is `no_std`, integer-only in the frame path, without panics or allocation there,
//! and gives the same bits on a PC, a Cortex-M7 and a RISC-V soft core.
//!
//! One stage a file, in the order in which a frame meets them:
//!
//! | module | in | out |
//! |---|---|---|
//! | [`pixels`] | raw rows, u16 ADU | calibrated, thresholded signal, u16 |
//! | [`centroid`] | signal | centroid (Q16 px), flux, peak |
//! | [`slopes`] | centroid | tip, tilt (centre-to-edge path, ulp), validity |
//! | [`modal`] | slopes of two gates | a correction by modes |
//! | [`control`] | slopes, what the mirror showed | tip/tilt commands |
//! | [`sor`] | tip/tilt commands | pistons |
//! | [`segments`] | piston, tip, tilt | heights of three actuators, inside what they reach |
//! | [`actuators`] | heights | DAC codes, u16 |
//!
//! and what decides about frames and mirror:
//!
//! | module | what |
//! |---|---|
//! | [`quality`] | which frames may be reconstructed |
//! | [`schedule`] | which subapertures a frame lights |
//! | [`gate`] | the range gate, tick by tick |
//! | [`mode`], [`ladder`] | what the mirror is for; what bad frames do to a closed loop |
//! | [`fault`], [`last_words`] | what went wrong, counted and kept |
//! | [`mirror`] | the guard that every code passes |
//! | [`interlock`], [`watchdog`] | when laser and high voltage may be on, when a cycle went well |
//! | [`controller`] | all of them, as a board drives it |
//!
//! and what a PC has to do with it:
//!
//! | module | what |
//! |---|---|
//! | [`link`] | messages, and how they come over a stream of bytes |
//! | [`image`], [`adjust`] | a configuration as bytes; one change of it |
//! | [`banks`] | the configuration that runs, and the one that is being made |
//! | [`store`] | the running configuration in flash |
//! | [`calibration`] | what a configuration was calibrated on, and what is missing |
//! | [`telemetry`], [`strehl`] | what frames leave; what it says of the wavefront |
//! | [`identity`] | which build this is |
//!
//! [`pipeline::Pipeline`] composes the stages; [`spec::Spec`] describes an instrument in physical units
//! and [`config::Config::build`] turns it, once, into integers that cannot be wrong.

#![cfg_attr(not(test), no_std)]

pub mod actuators;
pub mod adjust;
pub mod banks;
pub mod calibration;
pub mod centroid;
pub mod config;
pub mod control;
pub mod controller;
mod dsp;
pub mod error;
mod excerpt;
pub mod fault;
pub mod fixed;
pub mod frame_counter;
pub mod gate;
pub mod geometry;
pub mod identity;
pub mod image;
pub mod interlock;
pub mod inverse;
pub mod ladder;
pub mod last_words;
pub mod link;
mod loader;
pub mod mirror;
pub mod modal;
pub mod mode;
mod omega;
pub mod pipeline;
pub mod pixels;
mod probe;
pub mod quality;
mod quantise;
mod readout;
pub mod redblack;
mod report;
pub mod root;
pub mod schedule;
pub mod segments;
pub mod slopes;
pub mod sor;
pub mod spec;
pub mod store;
pub mod strehl;
pub mod telemetry;
mod validate;
pub mod watchdog;
