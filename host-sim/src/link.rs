//! The PC's end of the link to a board: what an operator does with one.
//!
//! | file | has |
//! |---|---|
//! | [`transport`] | what bytes go over, and how it fails |
//! | [`serial`], [`thread`], [`crate::board::process`] | a serial line, a server in this process, an emulator |
//! | [`client`] | requests out, answers in, telemetry aside |
//! | [`frames`] | the requests of a board whose frames come from here |
//! | [`light`] | what such a board's detector sees |
//! | [`operator`] | what an operator does: modes, parameters, images, flash, records |
//! | [`parameters`] | parameters by name, in physical units |
//! | [`recording`] | telemetry as FITS tables |
//! | [`calibrate`] | darks, flats, reference slopes, pokes |

pub mod calibrate;
pub mod client;
pub mod frames;
pub mod light;
pub mod operator;
pub mod parameters;
pub mod recording;
pub mod serial;
pub mod thread;
pub mod transport;

pub use client::Client;
pub use transport::{Failure, Transport};
