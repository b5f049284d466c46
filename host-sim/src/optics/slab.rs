//! The depth of the beacon: what the range gate lets in comes from a slab, not from a sheet.
//!
//! The beams are focused at H and so is the telescope. Light scattered at another height z is out of focus
//! twice. With e = 1/z - 1/H and k = 2 pi / lambda, and x_i the place above which beam i is focused:
//!
//! - **up**: the beam that converges to H has, at z, the angular intensity of the amplitude
//!   A(x) exp(i (phi + k e |x - x_i|^2 / 2)) over its subaperture: a blur e d wide;
//! - **down**: from (x_i, z) the telescope that is focused at H receives exp(i (phi_z + k e |x - x_i|^2 / 2)) over
//!   the whole pupil: a blur e D wide about -e x_i (perspective: the point is seen at another angle), which is
//!   the larger by D/d. It is the telescope's depth of focus, about lambda H^2 / (d D) for spots of lambda/d,
//!   that limits the gate's depth: 38 m for d = 0.5 m, D = 4 m, H = 12 km at 532 nm.
//!
//! Only the product OTF_up conj(OTF_down) counts, and a gradient common to both leaves it as it is: the terms
//! linear in x_i cancel, and the phase k e |x|^2 / 2 about the telescope's axis on both paths is the whole
//! effect, elongation included: over spot i its gradient is e x_i, over the pupil zero.
//!
//! A layer at h is met on the way up in the cone of the focus, at x (1 - h/H) + x_i h/H, whatever z; on the way
//! down in the cone of the slice, at x (1 - h/z) + x_i h/z. The intensities of slices add up. Each slice has its
//! share of the light: density of scatterers times 1/z^2, at the points of a Gauss-Legendre rule.

use super::OpticsError;
use super::error::positive;
use crate::theory::legendre::GaussLegendre;
use std::f64::consts::{PI, TAU};

/// Largest number of slices.
pub const MAX_SLICES: usize = 64;

/// The gate's slab as slices.
#[derive(Clone, Debug, PartialEq)]
pub struct Slab {
    pub(crate) slices: Vec<Slice>,
}

/// Light from one height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Slice {
    pub(crate) height_m: f64,
    /// Share of the light; they sum up to one.
    pub(crate) weight: f32,
    /// k e / 2, rad/m^2.
    pub(crate) curvature_rad_per_m2: f64,
}

impl Slab {
    /// A sheet at the focus: no depth.
    pub fn sheet(focus_m: f64) -> Self {
        Self { slices: vec![Slice { height_m: focus_m, weight: 1.0, curvature_rad_per_m2: 0.0 }] }
    }

    /// Heights, m, with shares of the light, of beams of `wavelength_m` focused at `focus_m`; shares are
    /// normalised.
    ///
    /// # Errors
    /// [`OpticsError`] if there is none, or one is not above 0.
    pub fn new(
        focus_m: f64,
        wavelength_m: f64,
        heights_and_shares: &[(f64, f64)],
    ) -> Result<Self, OpticsError> {
        positive("beacon_height_m", focus_m)?;
        positive("wavelength_m", wavelength_m)?;
        if !(1..=MAX_SLICES).contains(&heights_and_shares.len()) {
            let limit = format!("1 to {MAX_SLICES}");
            return Err(OpticsError::range("slices", heights_and_shares.len() as f64, limit));
        }
        let sum: f64 = heights_and_shares.iter().map(|(_, share)| share).sum();
        let slice = |&(height_m, share): &(f64, f64)| {
            positive("slice height_m", height_m)?;
            positive("slice share", share)?;
            Ok(Slice {
                height_m,
                weight: (share / sum) as f32,
                curvature_rad_per_m2: PI / wavelength_m * (1.0 / height_m - 1.0 / focus_m),
            })
        };
        Ok(Self { slices: heights_and_shares.iter().map(slice).collect::<Result<_, _>>()? })
    }

    /// A slab of `depth_m` about the focus in `count` slices, with scatterers of `density` at a height, m.
    ///
    /// # Errors
    /// As [`Self::new`]; a slab that reaches the ground has a slice there.
    pub fn gated(
        focus_m: f64,
        depth_m: f64,
        wavelength_m: f64,
        count: usize,
        density: impl Fn(f64) -> f64,
    ) -> Result<Self, OpticsError> {
        let rule = GaussLegendre::new(count.min(MAX_SLICES + 1));
        let slices = rule.nodes().iter().map(|&(place, weight)| {
            let height_m = focus_m + depth_m * (place - 0.5);
            (height_m, weight * density(height_m) / (height_m * height_m))
        });
        Self::new(focus_m, wavelength_m, &slices.collect::<Vec<_>>())
    }

    /// The slices that a slab of `depth_m` needs: a lag of d turns by 2 pi times the blur in lambda/d from the
    /// lowest slice to the highest, and a Gauss-Legendre rule of n points follows 8 (n - 2) rad to 1 % of the
    /// peak.
    pub fn slices_needed(
        focus_m: f64,
        depth_m: f64,
        wavelength_m: f64,
        pitch_m: f64,
        diameter_m: f64,
    ) -> usize {
        let blur_rad = depth_m * diameter_m / (focus_m * focus_m);
        let turn_rad = TAU * blur_rad * pitch_m / wavelength_m;
        ((turn_rad / 8.0).ceil() as usize + 2).min(MAX_SLICES)
    }

    /// Width, rad on the sky, of what the whole pupil makes of the slices out of its focus.
    pub(crate) fn blur_rad(&self, diameter_m: f64, wavelength_m: f64) -> f64 {
        let e_per_m = |slice: &Slice| slice.curvature_rad_per_m2.abs() * wavelength_m / PI;
        2.0 * diameter_m * self.slices.iter().map(e_per_m).fold(0.0, f64::max)
    }

    /// Number of slices.
    pub fn count(&self) -> usize {
        self.slices.len()
    }

    /// Whether all light comes from the focus.
    pub(crate) fn is_sheet(&self) -> bool {
        self.slices.iter().all(|slice| slice.curvature_rad_per_m2 == 0.0)
    }

    /// The lowest slice, m.
    pub(crate) fn lowest_m(&self) -> f64 {
        self.slices.iter().map(|slice| slice.height_m).fold(f64::INFINITY, f64::min)
    }

    /// Whether the samples of a pupil follow the defocus: a spot at one edge is blurred by e D to one side,
    /// which must be less than half of the image's period.
    pub(crate) fn check(&self, diameter_m: f64, sample_m: f64) -> Result<(), OpticsError> {
        let steepest =
            |slice: &Slice| 2.0 * slice.curvature_rad_per_m2.abs() * diameter_m * sample_m;
        match self.slices.iter().max_by(|a, b| steepest(a).total_cmp(&steepest(b))) {
            Some(slice) if steepest(slice) > PI => {
                let limit = format!(
                    "nearer to the focus: its blur is {:.2} times half of the image's period",
                    steepest(slice) / PI
                );
                Err(OpticsError::range("slice height_m", slice.height_m, limit))
            }
            _ => Ok(()),
        }
    }
}
