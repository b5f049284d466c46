//! The physics of SPLASH around the firmware library, and a closed loop through it.
//!
//! | module | what it is |
//! |---|---|
//! | [`instrument`] | the TOML description of an instrument |
//! | [`pupil`], [`screen`], [`atmosphere`] | subapertures and segments, phase screens, frozen flow |
//! | [`optics`] | images of the spots, exact gradients, the science star |
//! | [`detector`] | electrons to ADU |
//! | [`imager`] | optics and detector of the sensor together |
//! | [`calibration`] | reference slopes and slope gains, from a flat mirror and pokes |
//! | [`reconstructor`] | the firmware's configuration for an instrument |
//! | [`board`] | where the firmware library runs |
//! | [`mirror`] | DAC codes to the shape of the segments |
//! | [`profile`] | what a frame costs on a board |
//! | [`closed_loop`] | all of them, frame after frame |
//! | [`summary`] | averages, digest and faults of a run |
//! | [`monte_carlo`] | Strehl ratios over independent screens, for all sensors, and their error budgets |
//! | [`theory`] | what each sensor can sense, by equations |
//! | [`files`], [`figures`] | FITS, CSV and pictures |
//! | [`cli`], [`commands`] | the command line |

pub mod atmosphere;
pub mod board;
pub mod calibration;
pub mod cli;
pub mod closed_loop;
pub mod commands;
pub mod detector;
pub mod error;
pub mod figures;
pub mod files;
pub mod imager;
pub mod instrument;
pub mod mirror;
pub mod monte_carlo;
pub mod optics;
pub mod profile;
pub mod pupil;
pub mod reconstructor;
pub mod screen;
pub mod summary;
pub mod theory;
