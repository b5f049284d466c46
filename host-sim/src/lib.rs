//! The physics of SPLASH around the firmware library, and a closed loop through it.
//!
//! | module | what it is |
//! |---|---|
//! | [`instrument`] | the TOML description of an instrument |
//! | [`pupil`], [`screen`], [`atmosphere`] | subapertures and segments, phase screens, frozen flow |
//! | [`beacon`], [`standard_atmosphere`] | what scatters the laser's light, how much comes back |
//! | [`optics`] | images of the spots, exact gradients, the science star |
//! | [`detector`] | electrons to ADU |
//! | [`lighting`] | which spots are lit in a frame |
//! | [`imager`] | optics and detector of the sensor together |
//! | [`calibration`] | reference slopes and slope gains, from a flat mirror and pokes |
//! | [`reconstructor`] | the firmware's configuration for an instrument |
//! | [`board`] | where the firmware library runs |
//! | [`link`] | what an operator does with a board over its link |
//! | [`mirror`] | DAC codes to the shape of the segments |
//! | [`profile`] | what a frame costs on a board |
//! | [`nor_flash`] | a flash device, and what a power cut does to it |
//! | [`centroid_study`] | what estimators make of images, against exact gradients |
//! | [`quick`] | a sky and a detector for runs of a million frames |
//! | [`closed_loop`] | all of them, frame after frame |
//! | [`endurance`] | a run by the million frames, and what must hold for ever |
//! | [`fault_campaign`] | faults by the thousand in a closed loop, and what must hold |
//! | [`cn2`] | turbulence profiles by name, and fewer layers in their place |
//! | [`summary`] | averages, digest and faults of a run |
//! | [`monte_carlo`] | Strehl ratios over independent screens, for all sensors, and their error budgets |
//! | [`theory`] | what each sensor can sense, by equations |
//! | [`files`], [`figures`] | FITS, CSV and pictures |
//! | [`cli`], [`commands`] | the command line |

pub mod atmosphere;
pub mod beacon;
pub mod board;
pub mod calibration;
pub mod centroid_study;
pub mod cli;
pub mod closed_loop;
pub mod cn2;
pub mod commands;
pub mod detector;
pub mod endurance;
pub mod error;
pub mod fault_campaign;
pub mod figures;
pub mod files;
pub mod imager;
pub mod instrument;
pub mod lighting;
pub mod link;
pub mod mirror;
pub mod monte_carlo;
pub mod nor_flash;
pub mod optics;
pub mod profile;
pub mod pupil;
pub mod quick;
pub mod range_diversity;
pub mod reconstructor;
pub mod screen;
pub mod standard_atmosphere;
pub mod summary;
pub mod theory;
