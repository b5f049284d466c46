//! Noise-free images of a guide star, one through each subaperture: a Shack-Hartmann sensor.
//!
//! A star or one laser beacon is a point. What a subaperture makes of it is the point spread function
//! of that subaperture alone, |FT of exp(i phi) over subaperture i|^2, with phi the phase along the
//! path less the mirror's: phi_h(x) for a star, phi_h(b x) for a beacon on the axis, b = 1 - h/H.
//! The images are normalised and sampled as those of SPLASH's spots, so that the two differ in their
//! physics only. Against a direct sum over the samples in double precision: 6e-7 of the peak.

use super::OpticsError;
use super::block_otf::{BlockOtf, BlockOtfScratch};
use super::focal_plane::{FocalPlane, FocalPlaneScratch};
use super::lane_fft::LANES;
use super::launch::Launch;
use super::otf::{Lags, PathPhase, to_lanes};
use super::phase::{Path, PhaseSampler, check_geometry};
use crate::atmosphere::Atmosphere;
use crate::pupil::{Mirror, Pupil};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// The optics of a Shack-Hartmann sensor, from the pupil to the intensity in the pixels.
pub struct SubapertureCamera {
    pupil: Pupil,
    path: Path,
    window: usize,
    block_otf: BlockOtf,
    focal_plane: FocalPlane,
    sampler: PhaseSampler,
    /// Phase along the path less the mirror's: `[row][col]`, and in lanes.
    phase: Vec<f32>,
    mirror: Vec<f32>,
    lanes: Vec<f32>,
}

struct Scratch {
    block: BlockOtfScratch,
    focal_plane: FocalPlaneScratch,
    otf: Lags,
}

impl SubapertureCamera {
    /// A camera for a guide star on the axis, at `beacon_height_m` or at infinity (`None`), with
    /// windows of `window` x `window` pixels of lambda/(d `pixels_per_lambda_d`): the limits are those
    /// of [`SplashCamera::new`](super::splash_image::SplashCamera::new).
    ///
    /// # Errors
    /// [`OpticsError`] with the value and its limit.
    pub fn new(
        pupil: &Pupil,
        atmosphere: &Atmosphere,
        beacon_height_m: Option<f64>,
        pixels_per_lambda_d: f64,
        window: usize,
    ) -> Result<Self, OpticsError> {
        check_geometry(pupil, atmosphere, beacon_height_m)?;
        let (samples, side) = (pupil.samples(), pupil.side());
        let focal_plane = FocalPlane::checked(samples, window, pixels_per_lambda_d)?;
        Ok(Self {
            pupil: pupil.clone(),
            path: beacon_height_m
                .map_or(Path::Star, |height_m| Path::Beacon { height_m, position_m: [0.0; 2] }),
            window,
            block_otf: BlockOtf::new(samples, Launch::Uniform),
            focal_plane,
            sampler: PhaseSampler::default(),
            phase: vec![0.0; side * side],
            mirror: vec![0.0; side * side],
            lanes: vec![0.0; side.div_ceil(LANES) * LANES * side],
        })
    }

    /// W, pixels on the side of a window.
    pub fn window(&self) -> usize {
        self.window
    }

    /// Number of images, one per subaperture in use.
    pub fn spots(&self) -> usize {
        self.pupil.subapertures().len()
    }

    /// The images at `time_s` with `mirror` in the pupil: `[subaperture][row][column]`, the fraction of
    /// the subaperture's light that falls on each pixel. The same to the bit for any number of
    /// threads.
    ///
    /// # Panics
    /// If `images` is not subapertures x W x W, `mirror` does not have one segment per subaperture, or
    /// `time_s` is outside the atmosphere's duration.
    pub fn expose(
        &mut self,
        atmosphere: &Atmosphere,
        time_s: f64,
        mirror: &Mirror,
        images: &mut [f32],
    ) {
        let pixels = self.window * self.window;
        assert_eq!(images.len(), self.spots() * pixels, "images");
        self.sampler.sample(self.path, &self.pupil, atmosphere, time_s, &mut self.phase);
        mirror.phase(&self.pupil, &mut self.mirror);
        for (phase, mirror) in self.phase.iter_mut().zip(&self.mirror) {
            *phase -= mirror;
        }
        let side = self.pupil.side();
        to_lanes(&self.phase, side, &mut self.lanes);
        let camera = &*self;
        // A subaperture in use is lit all over: nothing is masked.
        let path = PathPhase { common: &camera.lanes, mask: &[], side, high: &[] };
        let arch = Arch::new();
        let scratch = || Scratch {
            block: camera.block_otf.scratch(),
            focal_plane: camera.focal_plane.scratch(),
            otf: Lags::new(camera.pupil.samples()),
        };
        images.par_chunks_exact_mut(pixels).zip(camera.pupil.subapertures()).for_each_init(
            scratch,
            |scratch, (image, &subaperture)| {
                arch.dispatch(Spot { camera, path: &path, subaperture, scratch, image });
            },
        );
    }
}

/// The image through one subaperture.
struct Spot<'a> {
    camera: &'a SubapertureCamera,
    path: &'a PathPhase<'a>,
    subaperture: [usize; 2],
    scratch: &'a mut Scratch,
    image: &'a mut [f32],
}

impl WithSimd for Spot<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { camera, path, subaperture, scratch, image } = self;
        let Scratch { block, focal_plane, otf } = scratch;
        camera.block_otf.lags(simd, path, subaperture, block, otf);
        // The transfer function is one at lag zero.
        let norm = 1.0 / (camera.pupil.samples() * camera.pupil.samples()) as f32;
        for part in [&mut otf.re, &mut otf.im] {
            for value in part {
                *value *= norm;
            }
        }
        camera.focal_plane.image(simd, otf, focal_plane, image);
    }
}
