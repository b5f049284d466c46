//! Noise-free images of a guide star, one through each subaperture: a Shack-Hartmann sensor.
//!
//! A star or one laser beacon is a point. What a subaperture makes of it is the point spread function
//! of that subaperture alone, |FT of exp(i phi) over subaperture i|^2, with phi the phase along the
//! path less the mirror's: phi_h(x) for a star, phi_h(b x) for a beacon on the axis, b = 1 - h/H.
//! The images are normalised and sampled as those of SPLASH's spots, so that the two differ in their
//! physics only. Against a direct sum over the samples in double precision: 6e-7 of the peak. The light of a
//! deep beacon comes in slices ([`slab`](super::slab)): seen through subaperture i, one out of focus is
//! displaced by e x_i, e = 1/z - 1/H, and blurred by e d.

use super::OpticsError;
use super::block_otf::{BlockOtf, BlockOtfScratch};
use super::focal_plane::{FocalPlane, Image};
use super::lane_fft::LANES;
use super::launch::Launch;
use super::otf::{Lags, PathPhase, in_lanes, to_lanes};
use super::phase::{Path, PhaseSampler, check_geometry};
use super::slab::{Slab, Slice};
use crate::atmosphere::Atmosphere;
use crate::pupil::{Mirror, Pupil};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// The optics of a Shack-Hartmann sensor, from the pupil to the intensity in the pixels.
pub struct SubapertureCamera {
    pupil: Pupil,
    path: Path,
    /// Of a beacon.
    slab: Option<Slab>,
    window: usize,
    block_otf: BlockOtf,
    focal_plane: FocalPlane,
    sampler: PhaseSampler,
    /// Phase along the path less the mirror's: `[row][col]`, and in lanes.
    phase: Vec<f32>,
    mirror: Vec<f32>,
    lanes: Vec<f32>,
    /// Amplitude at the samples, in lanes; empty where nothing stands in the light.
    mask: Vec<f32>,
    /// The images' transfer functions, summed over the slices.
    totals: Vec<Lags>,
}

struct Scratch {
    block: BlockOtfScratch,
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
            slab: beacon_height_m.map(Slab::sheet),
            window,
            block_otf: BlockOtf::new(samples, Launch::Uniform),
            focal_plane,
            sampler: PhaseSampler::default(),
            phase: vec![0.0; side * side],
            mirror: vec![0.0; side * side],
            lanes: vec![0.0; side.div_ceil(LANES) * LANES * side],
            mask: if pupil.is_obstructed() { in_lanes(&pupil.amplitudes(), side) } else { vec![] },
            totals: vec![Lags::new(samples); pupil.subapertures().len()],
        })
    }

    /// The same camera with its beacon's light from this slab; a star has none.
    ///
    /// # Errors
    /// As [`SplashCamera::with_slab`](super::splash_image::SplashCamera::with_slab).
    pub fn with_slab(self, slab: Slab, atmosphere: &Atmosphere) -> Result<Self, OpticsError> {
        if self.path == Path::Star {
            return Ok(self);
        }
        check_geometry(&self.pupil, atmosphere, Some(slab.lowest_m()))?;
        slab.check(self.pupil.diameter_m(), self.pupil.sample_pitch_m())?;
        Ok(Self { slab: Some(slab), ..self })
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
        mirror.phase(&self.pupil, &mut self.mirror);
        let mut totals = std::mem::take(&mut self.totals);
        totals.iter_mut().for_each(Lags::clear);
        match self.slab.clone() {
            None => self.add(Path::Star, 1.0, 0.0, (atmosphere, time_s), &mut totals),
            Some(slab) => {
                for Slice { height_m, weight, curvature_rad_per_m2 } in slab.slices {
                    let path = Path::Beacon { height_m, position_m: [0.0; 2] };
                    let sky = (atmosphere, time_s);
                    self.add(path, weight, curvature_rad_per_m2, sky, &mut totals);
                }
            }
        }
        let (plane, arch) = (&self.focal_plane, Arch::new());
        images.par_chunks_exact_mut(pixels).zip(&totals).for_each_init(
            || plane.scratch(),
            |scratch, (image, otf)| arch.dispatch(Image { plane, otf, scratch, image }),
        );
        self.totals = totals;
    }

    /// Adds the transfer functions of the light of one path, with its weight and the curvature of its defocus.
    fn add(
        &mut self,
        path: Path,
        weight: f32,
        curvature_rad_per_m2: f64,
        (atmosphere, time_s): (&Atmosphere, f64),
        totals: &mut [Lags],
    ) {
        self.sampler.sample(path, &self.pupil, atmosphere, time_s, &mut self.phase);
        for (phase, mirror) in self.phase.iter_mut().zip(&self.mirror) {
            *phase -= mirror;
        }
        let side = self.pupil.side();
        if curvature_rad_per_m2 != 0.0 {
            for (k, phase) in self.phase.iter_mut().enumerate() {
                let square_m2 =
                    self.pupil.sample_m(k / side).powi(2) + self.pupil.sample_m(k % side).powi(2);
                *phase += (curvature_rad_per_m2 * square_m2) as f32;
            }
        }
        to_lanes(&self.phase, side, &mut self.lanes);
        let camera = &*self;
        let path = PathPhase { common: &camera.lanes, mask: &camera.mask, side, high: &[] };
        let arch = Arch::new();
        let scratch = || Scratch {
            block: camera.block_otf.scratch(),
            otf: Lags::new(camera.pupil.samples()),
        };
        totals.par_iter_mut().zip(camera.pupil.subapertures()).for_each_init(
            scratch,
            |scratch, (total, &subaperture)| {
                arch.dispatch(Spot { camera, path: &path, subaperture, scratch, weight, total });
            },
        );
    }
}

/// The transfer function through one subaperture.
struct Spot<'a> {
    camera: &'a SubapertureCamera,
    path: &'a PathPhase<'a>,
    subaperture: [usize; 2],
    scratch: &'a mut Scratch,
    weight: f32,
    /// It is added here, times the weight.
    total: &'a mut Lags,
}

impl WithSimd for Spot<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { camera, path, subaperture, scratch, weight, total } = self;
        let Scratch { block, otf } = scratch;
        camera.block_otf.lags(simd, path, subaperture, block, otf);
        // The transfer function is one at lag zero, if nothing stands in the light.
        let norm = 1.0 / (camera.pupil.samples() * camera.pupil.samples()) as f32;
        for (total, part) in [(&mut total.re, &otf.re), (&mut total.im, &otf.im)] {
            for (total, value) in total.iter_mut().zip(part) {
                *total += weight * (value * norm);
            }
        }
    }
}
