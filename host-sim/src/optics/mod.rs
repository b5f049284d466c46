//! The optics of SPLASH: from the phase of the layers to what the detector and the science
//! camera receive.
//!
//! | module | gives |
//! |---|---|
//! | [`phase`] | the phase along the paths from a star, a laser guide star or a SPLASH spot |
//! | [`splash_image`] | noise-free images of the spots, by wave optics |
//! | [`gate_image`] | the same of a second gate, where the spots are wide |
//! | [`subaperture_image`] | the same of a guide star, through each subaperture |
//! | [`launch`] | the beam that is launched through a subaperture |
//! | [`slab`] | the depth of the beacon, in slices |
//! | [`camera`] | one of the two, by sensor |
//! | [`geometric`] | centroids as mean gradients, for SPLASH and for guide stars |
//! | [`segment_fit`] | the mirror that leaves the least of the star's phase |
//! | [`science`] | residual phase, variance and Strehl ratio of the corrected star |
//! | [`long_exposure`] | its mean point spread function |

mod block_otf;
pub mod camera;
pub(crate) mod error;
mod focal_plane;
pub mod gate_image;
pub mod geometric;
mod lane_fft;
pub mod launch;
pub mod long_exposure;
mod otf;
pub mod phase;
mod sampling;
pub mod science;
pub mod segment_fit;
pub(crate) mod sinc;
pub(crate) mod sincos;
pub mod slab;
pub mod splash_image;
pub mod subaperture_image;

pub use error::OpticsError;
