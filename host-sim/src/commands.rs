//! The commands, one a file.

pub mod closed_loop;
pub mod config;
pub mod frames;
mod output;
mod progress;
pub mod replay;
