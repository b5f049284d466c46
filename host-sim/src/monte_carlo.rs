//! Strehl ratios over independent phase screens: the paper's figure (Butterley et al. 2006, section 4).
//!
//! Each screen is a sky of its own, and all sensors close their loop under the same ones: a difference
//! between two sensors then has a small error, that of the paired differences.
//!
//! | module | what it is |
//! |---|---|
//! | [`comparator`] | SPLASH, laser guide star, natural guide star, best fit |
//! | [`point`] | one size of pupil: what all its screens have in common, and one screen |
//! | [`gradient_loop`] | a loop of exact gradients in double precision |
//! | [`pistons`] | its least-squares pistons |
//! | [`campaign`] | screens in parallel |
//! | [`checkpoint`] | finished screens on the disk |
//! | [`cost`] | time and memory before a start |
//! | [`statistics`] | means, errors and paired differences |

pub mod campaign;
pub mod checkpoint;
pub mod comparator;
pub mod cost;
pub mod gradient_loop;
pub mod pistons;
pub mod point;
pub mod statistics;
