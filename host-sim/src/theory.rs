//! How well SPLASH, a laser guide star and a natural guide star can sense Zernike modes: the
//! analysis of section 3 of Butterley et al. (2006), exact but for rounding.
//!
//! | module | equation |
//! |---|---|
//! | [`kolmogorov`] | D(r), and the integral of r^(5/3) along a line |
//! | [`pupil_rule`] | which squares are subapertures |
//! | [`squares`] | where beams cross a layer |
//! | [`covariance`] | <g_i g_l> of gradients averaged over squares |
//! | [`zernike`] | Z_j in Noll's order |
//! | [`noll`] | <a_j a_k> |
//! | [`phase_covariance`] | <a_j phi(x)> |
//! | [`legendre`], [`mean_gradient`] | means over squares |
//! | [`reconstructor`] | D, D' and their inverses |
//! | [`lever_arm`] | how much a beacon's gradients have to be raised |
//! | [`residuals`] | <(b - b')^2> / <b^2> and <(a - b')^2> / <a^2> by radial order |
//!
//! Lengths are in units of the pupil's radius, variances in rad^2 for D / r0 = 1; the results are
//! fractions, the same for any r0 and wavelength. Coefficients are those of the unobstructed circle
//! whatever the pupil's outline. As in the paper, light travels in straight lines, nothing is said
//! of the way down, and there is no noise.
//!
//! ```
//! use host_sim::theory::{Layer, Reconstruction, Theory};
//! use splash_firmware::geometry::Mask;
//!
//! let mask = Mask::circle(8).unwrap();
//! let layers = [Layer { weight: 1.0, beta: 0.75 }];
//! let residuals = Theory::new(&mask, 7, &layers, Reconstruction::Mixed)?.residuals(&mut || ());
//! assert_eq!(residuals.orders, [2, 3, 4, 5, 6, 7]);
//! assert!(residuals.splash.sensed[0] < 0.01 && residuals.lgs.sensed[0] > 0.16);
//! # Ok::<(), host_sim::theory::reconstructor::Degenerate>(())
//! ```

pub mod covariance;
pub mod kolmogorov;
pub mod legendre;
pub mod lever_arm;
pub mod mean_gradient;
pub mod noll;
pub mod phase_covariance;
pub mod pupil_rule;
pub mod reconstructor;
pub mod residuals;
pub mod squares;
pub mod zernike;

pub use pupil_rule::PupilRule;
pub use residuals::{BETAS, Fractions, Layer, Reconstruction, Residuals, Theory, default_order};
