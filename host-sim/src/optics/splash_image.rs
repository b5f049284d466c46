//! Noise-free images of the SPLASH spots.
//!
//! Spot i is made by the beam launched through subaperture i and seen by the whole telescope
//! (Butterley et al. 2006): its image is the upward point spread function convolved with the
//! reversed downward one, OTF = OTF_up conj(OTF_down). A gradient on the way up moves the spot,
//! the same gradient on the way down moves its image back. The light of a deep beacon comes in slices
//! ([`slab`](super::slab)), whose images add up.

use super::OpticsError;
use super::block_otf::{BlockOtf, BlockOtfScratch};
use super::focal_plane::{FocalPlane, FocalPlaneScratch, Image};
use super::lane_fft::LANES;
use super::launch::Launch;
use super::otf::{HighLayer, Lags, PathPhase, PupilOtf, PupilOtfScratch, in_lanes, to_lanes};
use super::phase::{Path, PhaseSampler, check_geometry};
use super::sampling::{Footprint, Taps};
use super::slab::{Slab, Slice};
use crate::atmosphere::Atmosphere;
use crate::pupil::{Mirror, Pupil};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Detector pixels in lambda/d unless another scale is asked for.
pub const PIXELS_PER_LAMBDA_D: f64 = 2.0;

/// The sensor's optics, from the pupil to the intensity in the pixels.
pub struct SplashCamera {
    pupil: Pupil,
    beacon_height_m: f64,
    slab: Slab,
    window: usize,
    /// Of the pupil.
    power_samples: f64,
    pupil_otf: PupilOtf,
    block_otf: BlockOtf,
    focal_plane: FocalPlane,
    /// Amplitude at the samples, `[group][col][lane]`.
    mask: Vec<f32>,
    sampler: PhaseSampler,
    footprint: Footprint,
    /// Which spots are wanted; those beyond its end are.
    lit: Vec<bool>,
    /// Phase of the layers at the ground less the mirror's: `[row][col]`, and in lanes.
    ground: Vec<f32>,
    mirror: Vec<f32>,
    common: Vec<f32>,
    /// Part of the mirror that is in the return path; where it is not all, `common` of that path.
    returned: f32,
    common_back: Vec<f32>,
    /// Those with a slice's defocus.
    defocused: Vec<f32>,
    defocused_back: Vec<f32>,
    /// Squares of the distances from the axis, m^2, in lanes; empty for a sheet.
    squares_m2: Vec<f32>,
    /// Layers above the ground on the way up, and on the way down from a slice that is not at the focus.
    high: Vec<High>,
    high_down: Vec<High>,
    /// The spots' transfer functions, summed over the slices.
    totals: Vec<Lags>,
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
        let mask = in_lanes(&pupil.amplitudes(), side);
        let lanes = mask.len();
        Ok(Self {
            pupil: pupil.clone(),
            beacon_height_m,
            window,
            power_samples: pupil.power_samples(),
            pupil_otf: PupilOtf::new(pupil),
            block_otf: BlockOtf::new(samples, Launch::Uniform),
            focal_plane,
            mask,
            sampler: PhaseSampler::default(),
            footprint: Footprint::default(),
            lit: vec![],
            ground: vec![0.0; side * side],
            mirror: vec![0.0; side * side],
            common: vec![0.0; lanes],
            returned: 1.0,
            common_back: vec![],
            defocused: vec![],
            defocused_back: vec![],
            squares_m2: vec![],
            high: vec![],
            high_down: vec![],
            totals: vec![Lags::new(samples); pupil.subapertures().len()],
            slab: Slab::sheet(beacon_height_m),
            scratch: vec![],
        })
    }

    /// The same camera with beams of this shape: uniform ones unless this is called.
    #[must_use]
    pub fn with_launch(self, launch: Launch) -> Self {
        Self { block_otf: BlockOtf::new(self.pupil.samples(), launch), ..self }
    }

    /// The same camera with light from this slab, focused at the beacon's height: a sheet there unless this
    /// is called. `atmosphere` is that of [`Self::new`].
    ///
    /// # Errors
    /// [`OpticsError`] if a slice is not above all layers, or so far from the focus that its blur does not
    /// fit into the image's period.
    pub fn with_slab(self, slab: Slab, atmosphere: &Atmosphere) -> Result<Self, OpticsError> {
        let pupil = &self.pupil;
        check_geometry(pupil, atmosphere, Some(slab.lowest_m()))?;
        slab.check(pupil.diameter_m(), pupil.sample_pitch_m())?;
        let squares_m2 = if slab.is_sheet() { vec![] } else { squares_m2(pupil) };
        Ok(Self { slab, squares_m2, ..self })
    }

    /// W, pixels on the side of a window.
    pub fn window(&self) -> usize {
        self.window
    }

    /// Number of spots, one per subaperture in use.
    pub fn spots(&self) -> usize {
        self.pupil.subapertures().len()
    }

    /// Makes the images of these spots only, from now on: `lit` has one entry per spot.
    pub fn light(&mut self, lit: &[bool]) {
        self.lit.clear();
        self.lit.extend_from_slice(lit);
    }

    /// Leaves only this part of the mirror's phase in the return path: 0 for a sensor that looks past the
    /// mirror, 1 unless told otherwise.
    pub fn return_through(&mut self, part: f32) {
        self.returned = part;
    }

    fn is_lit(&self, spot: usize) -> bool {
        self.lit.get(spot) != Some(&false)
    }

    /// The images at `time_s` with `mirror` in the pupil on both paths: `[spot][row][column]`,
    /// the fraction of the light of a spot with nothing in its beam that falls on each pixel; what is not
    /// lit is left alone. The same to the bit for any number of threads.
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
        let (footprint, pupil) = (&mut self.footprint, &self.pupil);
        prepare_high(&mut self.high, footprint, pupil, self.beacon_height_m, atmosphere, time_s);
        while self.scratch.len() < rayon::current_num_threads() {
            self.scratch.push(Mutex::new(Scratch {
                pupil: self.pupil_otf.scratch(),
                block: self.block_otf.scratch(),
                focal_plane: self.focal_plane.scratch(),
                up: Lags::new(self.pupil.samples()),
                down: Lags::new(self.pupil.samples()),
            }));
        }
        let mut totals = std::mem::take(&mut self.totals);
        totals.iter_mut().for_each(Lags::clear);
        for slice in self.slab.slices.clone() {
            self.add_slice(slice, atmosphere, time_s, &mut totals);
        }
        let (arch, camera) = (Arch::new(), &*self);
        let spots = images.par_chunks_exact_mut(pixels).zip(&totals).enumerate();
        spots.filter(|(spot, _)| camera.is_lit(*spot)).for_each(|(_, (image, otf))| {
            let mut scratch = camera.scratch();
            let (plane, scratch) = (&camera.focal_plane, &mut scratch.focal_plane);
            arch.dispatch(Image { plane, otf, scratch, image });
        });
        self.totals = totals;
    }

    /// Adds the transfer functions of the light from one height to those of the spots.
    fn add_slice(
        &mut self,
        slice: Slice,
        atmosphere: &Atmosphere,
        time_s: f64,
        totals: &mut [Lags],
    ) {
        let at_focus = slice.curvature_rad_per_m2 == 0.0;
        if !at_focus {
            let (high, footprint) = (&mut self.high_down, &mut self.footprint);
            prepare_high(high, footprint, &self.pupil, slice.height_m, atmosphere, time_s);
            let curvature = slice.curvature_rad_per_m2 as f32;
            defocus(&mut self.defocused, &self.common, &self.squares_m2, curvature);
            defocus(&mut self.defocused_back, &self.common_back, &self.squares_m2, curvature);
        }
        let camera = &*self;
        let (common, back) = if at_focus {
            (&camera.common, &camera.common_back)
        } else {
            (&camera.defocused, &camera.defocused_back)
        };
        let back = if camera.returned == 1.0 { common } else { back };
        let cone_down = if at_focus { &camera.high } else { &camera.high_down };
        let arch = Arch::new();
        // With all turbulence at the ground every spot is seen through the same wavefront.
        let shared = cone_down.is_empty().then(|| {
            let scratch = &mut *camera.scratch();
            arch.dispatch(Down { camera, path: &camera.path(back, &[]), scratch });
            scratch.down.clone()
        });
        let spots = totals.par_iter_mut().zip(camera.pupil.subapertures()).enumerate();
        spots.filter(|(spot, _)| camera.is_lit(*spot)).for_each(|(_, (total, &subaperture))| {
            let scratch = &mut *camera.scratch();
            let up: Vec<_> = camera.high.iter().map(|high| high.seen(subaperture)).collect();
            let down: Vec<_> = cone_down.iter().map(|high| high.seen(subaperture)).collect();
            match &shared {
                Some(down) => scratch.down.clone_from(down),
                None => arch.dispatch(Down { camera, path: &camera.path(back, &down), scratch }),
            }
            let path = &camera.path(common, &up);
            arch.dispatch(Spot { camera, path, subaperture, scratch, weight: slice.weight, total });
        });
    }

    /// The buffers of this thread.
    fn scratch(&self) -> MutexGuard<'_, Scratch> {
        let thread = rayon::current_thread_index().unwrap_or(0);
        self.scratch[thread].lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn path<'a>(&'a self, common: &'a [f32], high: &'a [HighLayer<'a>]) -> PathPhase<'a> {
        PathPhase { common, mask: &self.mask, side: self.pupil.side(), high }
    }

    /// Phase that all spots share: layers at the ground, less the mirror.
    fn prepare_common(&mut self, atmosphere: &Atmosphere, time_s: f64, mirror: &Mirror) {
        let (pupil, ground) = (&self.pupil, &mut self.ground);
        let at_ground = |height_m| height_m == 0.0;
        self.sampler.sample_layers(Path::Star, pupil, atmosphere, time_s, at_ground, ground);
        mirror.phase(pupil, &mut self.mirror);
        if self.returned != 1.0 {
            let pairs = ground.iter().zip(&self.mirror);
            let back: Vec<f32> = pairs.map(|(g, mirror)| g - self.returned * mirror).collect();
            self.common_back.resize(self.common.len(), 0.0);
            to_lanes(&back, pupil.side(), &mut self.common_back);
        }
        for (phase, mirror) in ground.iter_mut().zip(&self.mirror) {
            *phase -= mirror;
        }
        to_lanes(ground, pupil.side(), &mut self.common);
    }
}

/// Phases with the curvature of a slice's wavefront.
fn defocus(to: &mut Vec<f32>, phases: &[f32], squares_m2: &[f32], rad_per_m2: f32) {
    to.clear();
    to.extend(phases.iter().zip(squares_m2).map(|(phase, square)| phase + rad_per_m2 * square));
}

/// Resamples every layer above the ground, in the cones that spots at `height_m` have, along y for each row
/// of subapertures, and finds the taps along x for each column: all spots of a row, or of a column, share
/// them.
fn prepare_high(
    high: &mut Vec<High>,
    footprint: &mut Footprint,
    pupil: &Pupil,
    height_m: f64,
    atmosphere: &Atmosphere,
    time_s: f64,
) {
    let (across, side) = (pupil.across(), pupil.side());
    let groups = side.div_ceil(LANES);
    let flows = atmosphere.flows.iter().filter(|flow| flow.height_m != 0.0);
    high.resize_with(flows.clone().count(), High::default);
    for (flow, high) in flows.zip(high) {
        assert!(flow.height_m < height_m, "layer above the beacon");
        footprint.cut(flow, atmosphere, time_s);
        let footprint = &*footprint;
        let taps = |axis: usize, index: usize| {
            let position_m = [pupil.centre_m(index); 2];
            let path = Path::Beacon { height_m, position_m };
            let (scale, shift) = path.through(flow.height_m);
            footprint.taps(axis, (0..side).map(|k| scale * pupil.sample_m(k) + shift[axis]))
        };
        high.texels = footprint.side();
        high.taps = (0..across).map(|ix| taps(0, ix)).collect();
        let row_of_spots = groups * high.texels * LANES;
        high.columns.resize(across * row_of_spots, 0.0);
        high.columns.par_chunks_exact_mut(row_of_spots).enumerate().for_each(|(iy, columns)| {
            let mut line = vec![0.0; high.texels];
            for (row, taps) in taps(1, iy).iter().enumerate() {
                footprint.between_rows(taps, &mut line);
                let group = &mut columns[row / LANES * high.texels * LANES..];
                for (lanes, value) in group.chunks_exact_mut(LANES).zip(&line) {
                    lanes[row % LANES] = *value;
                }
            }
        });
    }
}

/// Squares of the samples' distances from the axis, m^2, in lanes.
fn squares_m2(pupil: &Pupil) -> Vec<f32> {
    let side = pupil.side();
    let square = |k: usize| pupil.sample_m(k / side).powi(2) + pupil.sample_m(k % side).powi(2);
    let squares: Vec<f32> = (0..side * side).map(|k| square(k) as f32).collect();
    in_lanes(&squares, side)
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

/// The transfer function of a spot, once its downward one is known.
struct Spot<'a> {
    camera: &'a SplashCamera,
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
        let Scratch { block, up, down, .. } = scratch;
        camera.block_otf.lags(simd, path, subaperture, block, up);
        // Each transfer function is one at lag zero; less on the way up where something stands in the beam.
        let block_samples = camera.pupil.samples() * camera.pupil.samples();
        let norm = 1.0 / (block_samples as f64 * camera.power_samples) as f32;
        let totals = total.re.iter_mut().zip(&mut total.im);
        let ups = up.re.iter().zip(&up.im);
        for (((total_re, total_im), (up_re, up_im)), (re, im)) in
            totals.zip(ups).zip(down.re.iter().zip(&down.im))
        {
            let product = (*up_re * re + *up_im * im, *up_im * re - *up_re * im);
            *total_re += weight * (product.0 * norm);
            *total_im += weight * (product.1 * norm);
        }
    }
}
