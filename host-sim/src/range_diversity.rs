//! Two gates: SPLASH with its spots imaged at two heights, H and about H/2.
//!
//! One beacon height cannot tell a high layer from the ground. The slopes s1 and s2 of two gates see a layer with
//! different lever arms and from different places, and together they separate it, at least where it is smooth. The
//! control law takes its commands from
//!
//! f x1 + q B [q^T x1; q^T x2],
//!
//! with x1 and x2 the slopes of the gates with what the mirror took out added back, q the orthonormalised gradients of
//! low-order polynomials, B a matrix and f a number that leave the least mean square. B and f come from the
//! turbulence's profile, the geometry and the noise.
//!
//! | module | what it is |
//! |---|---|
//! | [`modes`] | q |
//! | [`waves`] | the turbulence as a sum of waves |
//! | [`response`] | what star and gates see of a wave |
//! | [`phase_metric`] | residual phase of tips and tilts |
//! | [`design`] | B and f, and what is expected to be left |
//! | [`law`] | commands from the slopes of both gates |

pub mod design;
pub mod law;
pub mod modes;
pub mod phase_metric;
pub mod response;
pub mod waves;
