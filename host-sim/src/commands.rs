//! The commands, one a file.

pub mod beam;
mod campaign;
pub mod centroids;
pub mod closed_loop;
pub mod config;
pub mod crosstalk;
pub mod endure;
pub mod faults;
pub mod frames;
pub mod gates;
pub mod link;
pub mod merge;
mod output;
pub mod power;
pub mod profile;
mod progress;
pub mod replay;
pub mod reproduce;
pub mod scale;
pub mod strehl;
pub mod theory;
