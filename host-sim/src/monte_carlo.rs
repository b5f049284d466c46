//! Strehl ratios over independent phase screens: the paper's figure (Butterley et al. 2006, section
//! 4).
//!
//! Each screen is a sky of its own, and all sensors close their loop under the same ones: a
//! difference between two sensors then has a small error, that of the paired differences.
//!
//! A screen's Strehl ratio is the mean over its frames of |<exp(i phi)>|^2, phi the star's residual
//! phase with its least-squares plane over the pupil removed; the mean over M screens has the error
//! s / sqrt(M).
//!
//! Measured in the paper's setting (d = r0, 40 % of the turbulence at a quarter of the beacon's
//! height, frozen screens, no noise, seed 1), 150 screens, 50 for the images of N = 16:
//!
//! | N = D/r0 | SPLASH images | gradients | LGS images | gradients | NGS images | gradients | fit | SPLASH - LGS |
//! |---|---|---|---|---|---|---|---|---|
//! | 4 | 0.692(6) | 0.696(6) | 0.690(5) | 0.695(5) | 0.752(4) | 0.752(4) | 0.846(2) | +0.002(4) |
//! | 6 | 0.634(6) | 0.640(6) | 0.579(5) | 0.586(5) | 0.742(3) | 0.744(3) | 0.844(1) | +0.055(5) |
//! | 8 | 0.578(7) | 0.581(7) | 0.460(6) | 0.467(6) | 0.726(2) | 0.731(2) | 0.842(1) | +0.118(6) |
//! | 10 | 0.546(8) | 0.553(8) | 0.366(6) | 0.375(6) | 0.733(2) | 0.739(2) | 0.845(1) | +0.180(7) |
//! | 12 | 0.498(9) | 0.506(9) | 0.287(6) | 0.295(6) | 0.730(2) | 0.736(1) | 0.844(1) | +0.211(8) |
//! | 16 | 0.396(16) | 0.394(10) | 0.146(9) | 0.148(5) | 0.723(3) | 0.735(1) | 0.844(1) | +0.250(12) |
//!
//! The digits in brackets are one standard error, the last column's that of the paired differences
//! of images. At N = 8 the screens of seed 1 are two errors below the mean of 800 others: gradients
//! give 0.586(3), 0.475(3) and 0.736(1) there, and the fit 0.844.
//!
//! Under the same screens at N = 8, images less gradients are -0.0035(14) for SPLASH, -0.0074(13)
//! for the laser and -0.0055(8) for the natural star. It is the centroid: the window of 16 pixels
//! cuts the wings, and the threshold at a tenth of the peak what is faint, so that the spot's
//! asymmetry counts for less than its gradient. Either alone does it; with a plain centre of
//! gravity over the image's whole period (16 samples, 32 pixels) the differences are -0.0013(6),
//! -0.0007(5) and +0.0005(3), 40 screens. The speckle of the return path is not the reason.
//!
//! | module | what it is |
//! |---|---|
//! | [`comparator`] | SPLASH, laser guide star, natural guide star, best fit |
//! | [`point`] | one size of pupil: what all its screens have in common, and one screen |
//! | [`budget`] | what is run under a screen: a sensor, or a step of its error budget |
//! | [`gradient_loop`] | a loop of exact gradients in double precision |
//! | [`slope_control`] | its control law |
//! | [`converged`] | what it converges to |
//! | [`pistons`] | its least-squares pistons |
//! | [`gates`] | one gate, two gates and guide stars under the same screens |
//! | [`campaign`] | screens in parallel |
//! | [`checkpoint`] | finished screens on the disk |
//! | [`shard`] | a part of a run, for one of several machines |
//! | [`settings`] | what a run was asked for |
//! | [`cost`] | time and memory before a start |
//! | [`statistics`] | means, errors and paired differences |

pub mod budget;
pub mod campaign;
pub mod checkpoint;
pub mod comparator;
pub mod converged;
pub mod cost;
pub mod gates;
pub mod gradient_loop;
pub mod pistons;
pub mod point;
pub mod settings;
pub mod shard;
pub mod slope_control;
pub mod statistics;
