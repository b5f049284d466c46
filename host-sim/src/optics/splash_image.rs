//! Noise-free images of the SPLASH spots.
//!
//! Spot i is made by the beam launched through subaperture i and seen by the whole telescope
//! (Butterley et al. 2006): its image is the upward point spread function convolved with the
//! reversed downward one, OTF = OTF_up conj(OTF_down). A gradient on the way up moves the spot,
//! the same gradient on the way down moves its image back.

use super::OpticsError;
use super::block_otf::{BlockOtf, BlockOtfScratch};
use super::focal_plane::{FocalPlane, FocalPlaneScratch};
use super::lane_fft::LANES;
use super::launch::Launch;
use super::otf::{HighLayer, Lags, PathPhase, PupilOtf, PupilOtfScratch, to_lanes};
use super::phase::{Path, PhaseSampler, check_geometry};
use super::sampling::{Footprint, Taps};
use crate::atmosphere::Atmosphere;
use crate::pupil::{Mirror, Pupil};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Detector pixels in lambda/d unless another scale is asked for.
pub const PIXELS_PER_LAMBDA_D: f64 = 2.0;

/// The sensor's optics, from the pupil to the intensity in the pixels.
pub struct SplashCamera {
    pupil: Pupil,
    beacon_height_m: f64,
    window: usize,
    pupil_otf: PupilOtf,
    block_otf: BlockOtf,
    focal_plane: FocalPlane,
    /// One at the samples in use, `[group][col][lane]`.
    mask: Vec<f32>,
    sampler: PhaseSampler,
    footprint: Footprint,
    /// Phase of the layers at the ground less the mirror's: `[row][col]`, and in lanes.
    ground: Vec<f32>,
    mirror: Vec<f32>,
    common: Vec<f32>,
    high: Vec<High>,
    scratch: Vec<Mutex<Scratch>>,
}

/// A layer above the ground, resampled for the frame.
#[derive(Default)]
struct High {
    /// Texel columns of the footprint.
    texels: usize,
    /// For each row of subapertures, `[iy][group][texel column][lane]`.
    columns: Vec<f32>,
    /// For each column of subapertures.
    taps: Vec<Vec<Taps>>,
}

struct Scratch {
    pupil: PupilOtfScratch,
    block: BlockOtfScratch,
    focal_plane: FocalPlaneScratch,
    up: Lags,
    down: Lags,
}

impl SplashCamera {
    /// A camera for spots at `beacon_height_m` with windows of `window` x `window` pixels (4 to
    /// 32) of lambda/(d `pixels_per_lambda_d`) (1 to 8; [`PIXELS_PER_LAMBDA_D`] is usual), to look
    /// through atmospheres with the layer heights and the footprint of `atmosphere`. The window
    /// is at most n `pixels_per_lambda_d` pixels wide: 32 pixels take 16 samples per subaperture.
    pub fn new(
        pupil: &Pupil,
        atmosphere: &Atmosphere,
        beacon_height_m: f64,
        pixels_per_lambda_d: f64,
        window: usize,
    ) -> Result<Self, OpticsError> {
        check_geometry(pupil, atmosphere, Some(beacon_height_m))?;
        let (samples, side) = (pupil.samples(), pupil.side());
        let focal_plane = FocalPlane::checked(samples, window, pixels_per_lambda_d)?;
        let mut illuminated = vec![0.0; side * side];
        for (k, value) in illuminated.iter_mut().enumerate() {
            *value = f32::from(u8::from(pupil.illuminates(k / side, k % side)));
        }
        let lanes = side.div_ceil(LANES) * LANES * side;
        let mut mask = vec![0.0; lanes];
        to_lanes(&illuminated, side, &mut mask);
        Ok(Self {
            pupil: pupil.clone(),
            beacon_height_m,
            window,
            pupil_otf: PupilOtf::new(pupil),
            block_otf: BlockOtf::new(samples, Launch::Uniform),
            focal_plane,
            mask,
            sampler: PhaseSampler::default(),
            footprint: Footprint::default(),
            ground: vec![0.0; side * side],
            mirror: vec![0.0; side * side],
            common: vec![0.0; lanes],
            high: vec![],
            scratch: vec![],
        })
    }

    /// The same camera with beams of this shape: uniform ones unless this is called.
    #[must_use]
    pub fn with_launch(self, launch: Launch) -> Self {
        Self { block_otf: BlockOtf::new(self.pupil.samples(), launch), ..self }
    }

    /// W, pixels on the side of a window.
    pub fn window(&self) -> usize {
        self.window
    }

    /// Number of spots, one per subaperture in use.
    pub fn spots(&self) -> usize {
        self.pupil.subapertures().len()
    }

    /// The images at `time_s` with `mirror` in the pupil on both paths: `[spot][row][column]`,
    /// the fraction of that spot's light that falls on each pixel. The same to the bit for any
    /// number of threads.
    ///
    /// # Panics
    /// If `images` is not spots x W x W, `mirror` does not have one segment per spot, `time_s` is
    /// outside the atmosphere's duration, or the atmosphere is not of the geometry given to
    /// [`Self::new`].
    pub fn expose(
        &mut self,
        atmosphere: &Atmosphere,
        time_s: f64,
        mirror: &Mirror,
        images: &mut [f32],
    ) {
        let pixels = self.window * self.window;
        assert_eq!(images.len(), self.spots() * pixels, "images");
        self.prepare_common(atmosphere, time_s, mirror);
        self.prepare_high(atmosphere, time_s);
        while self.scratch.len() < rayon::current_num_threads() {
            self.scratch.push(Mutex::new(Scratch {
                pupil: self.pupil_otf.scratch(),
                block: self.block_otf.scratch(),
                focal_plane: self.focal_plane.scratch(),
                up: Lags::new(self.pupil.samples()),
                down: Lags::new(self.pupil.samples()),
            }));
        }
        let arch = Arch::new();
        // With all turbulence at the ground every spot is seen through the same wavefront.
        let shared = self.high.is_empty().then(|| {
            let mut scratch = self.scratch[0].lock().unwrap_or_else(PoisonError::into_inner);
            arch.dispatch(Down { camera: self, path: &self.path(&[]), scratch: &mut scratch });
            scratch.down.clone()
        });
        let camera = &*self;
        images.par_chunks_exact_mut(pixels).zip(camera.pupil.subapertures()).for_each(
            |(image, &subaperture)| {
                let thread = rayon::current_thread_index().unwrap_or(0);
                let mut scratch =
                    camera.scratch[thread].lock().unwrap_or_else(PoisonError::into_inner);
                let scratch = &mut *scratch;
                let high: Vec<_> = camera.high.iter().map(|high| high.seen(subaperture)).collect();
                let path = camera.path(&high);
                match &shared {
                    Some(down) => scratch.down.clone_from(down),
                    None => arch.dispatch(Down { camera, path: &path, scratch }),
                }
                arch.dispatch(Spot { camera, path: &path, subaperture, scratch, image });
            },
        );
    }

    fn path<'a>(&'a self, high: &'a [HighLayer<'a>]) -> PathPhase<'a> {
        PathPhase { common: &self.common, mask: &self.mask, side: self.pupil.side(), high }
    }

    /// Phase that all spots share: layers at the ground, less the mirror.
    fn prepare_common(&mut self, atmosphere: &Atmosphere, time_s: f64, mirror: &Mirror) {
        let (pupil, ground) = (&self.pupil, &mut self.ground);
        let at_ground = |height_m| height_m == 0.0;
        self.sampler.sample_layers(Path::Star, pupil, atmosphere, time_s, at_ground, ground);
        mirror.phase(pupil, &mut self.mirror);
        for (phase, mirror) in ground.iter_mut().zip(&self.mirror) {
            *phase -= mirror;
        }
        to_lanes(ground, pupil.side(), &mut self.common);
    }

    /// Resamples every layer above the ground along y for each row of subapertures, and finds
    /// the taps along x for each column: all spots of a row, or of a column, share them.
    fn prepare_high(&mut self, atmosphere: &Atmosphere, time_s: f64) {
        let pupil = &self.pupil;
        let (across, side) = (pupil.across(), pupil.side());
        let groups = side.div_ceil(LANES);
        let flows = atmosphere.flows.iter().filter(|flow| flow.height_m != 0.0);
        self.high.resize_with(flows.clone().count(), High::default);
        for (flow, high) in flows.zip(&mut self.high) {
            assert!(flow.height_m < self.beacon_height_m, "layer above the beacon");
            let footprint = &mut self.footprint;
            footprint.cut(flow, atmosphere, time_s);
            let footprint = &*footprint;
            let taps = |axis: usize, index: usize| {
                let position_m = [pupil.centre_m(index); 2];
                let path = Path::Beacon { height_m: self.beacon_height_m, position_m };
                let (scale, shift) = path.through(flow.height_m);
                footprint.taps(axis, (0..side).map(|k| scale * pupil.sample_m(k) + shift[axis]))
            };
            high.texels = footprint.side();
            high.taps = (0..across).map(|ix| taps(0, ix)).collect();
            let row_of_spots = groups * high.texels * LANES;
            high.columns.resize(across * row_of_spots, 0.0);
            high.columns.par_chunks_exact_mut(row_of_spots).enumerate().for_each(
                |(iy, columns)| {
                    let mut line = vec![0.0; high.texels];
                    for (row, taps) in taps(1, iy).iter().enumerate() {
                        footprint.between_rows(taps, &mut line);
                        let group = &mut columns[row / LANES * high.texels * LANES..];
                        for (lanes, value) in group.chunks_exact_mut(LANES).zip(&line) {
                            lanes[row % LANES] = *value;
                        }
                    }
                },
            );
        }
    }
}

impl High {
    fn seen(&self, [ix, iy]: [usize; 2]) -> HighLayer<'_> {
        let row_of_spots = self.columns.len() / self.taps.len();
        let columns = &self.columns[iy * row_of_spots..][..row_of_spots];
        HighLayer { columns, texels: self.texels, taps: &self.taps[ix] }
    }
}

/// Transfer function from a spot to the whole pupil.
struct Down<'a> {
    camera: &'a SplashCamera,
    path: &'a PathPhase<'a>,
    scratch: &'a mut Scratch,
}

impl WithSimd for Down<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Scratch { pupil, down, .. } = self.scratch;
        self.camera.pupil_otf.lags(simd, self.path, pupil, down);
    }
}

/// The image of a spot, once its downward transfer function is known.
struct Spot<'a> {
    camera: &'a SplashCamera,
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
        let Scratch { block, focal_plane, up, down, .. } = scratch;
        camera.block_otf.lags(simd, path, subaperture, block, up);
        // Each transfer function is one at lag zero.
        let block_samples = camera.pupil.samples() * camera.pupil.samples();
        let norm = 1.0 / (block_samples * camera.pupil.illuminated_samples()) as f32;
        let ups = up.re.iter_mut().zip(&mut up.im);
        for ((up_re, up_im), (re, im)) in ups.zip(down.re.iter().zip(&down.im)) {
            let total = (*up_re * re + *up_im * im, *up_im * re - *up_re * im);
            (*up_re, *up_im) = (total.0 * norm, total.1 * norm);
        }
        camera.focal_plane.image(simd, up, focal_plane, image);
    }
}
