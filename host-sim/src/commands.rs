//! The commands, one a file.

pub mod beam;
mod campaign;
pub mod closed_loop;
pub mod config;
pub mod endure;
pub mod faults;
pub mod frames;
pub mod link;
mod output;
pub mod power;
pub mod profile;
mod progress;
pub mod replay;
pub mod reproduce;
pub mod strehl;
pub mod theory;
