//! Noise-free images of SPLASH's spots on their way: those of a second gate at z, below the beams' focus at H.
//!
//! There a beam is still d (1 - z/H) wide, far beyond diffraction's lambda/d: 39 of them at half of 12 km for
//! d = 0.5 m at 532 nm. The camera of this gate is focused at z.
//!
//! - **Up.** A layer at h is met at b x + (1 - b) x_i, b = 1 - h/H, and turns the light by angles that are seen from
//!   the telescope times b_z = 1 - h/z: in the pupil's coordinates, where a phase's gradient has b in it already,
//!   its phase counts b_z/b. With k = 2 pi / lambda and e = 1/z - 1/H the light at z is, by angle,
//!   |FT of A(x) exp(i k e |x - x_i|^2 / 2 + i sum phi_h b_z/b - i m)|^2 over subaperture i: its shadow, e d wide,
//!   with Fresnel's fringes and what turbulence and mirror do to it.
//! - **Down.** The whole telescope sees that through turbulence whose mean gradient over the pupil moves the
//!   image, as in [`geometric`](super::geometric), and blurs it by lambda/r0 or less: a fortieth of its width,
//!   which is left out.
//! - **Depth.** Light from z' inside the gate is out of the camera's focus by e' = 1/z' - 1/z: blurred by e' D about
//!   e' x_i. Each slice has its share of the light, as in [`slab`](super::slab); the shadow's own width at z' is that
//!   at z to the gate's depth over z, some percent.
//!
//! All of it is taken at lags below d, as the images at H are: OTF_up exp(-i g.l) times the slices' mean of
//! exp(-i k e' (x - x_i).l) over the pupil.

use super::OpticsError;
use super::focal_plane::{FocalPlane, Image, check_window};
use super::geometric::{GeometricSensor, Sensor};
use super::launch::Launch;
use super::otf::Lags;
use super::phase::{Path, check_geometry};
use super::sampling::{Footprint, Taps};
use super::sinc::sinc;
use super::slab::{Slab, Slice};
use crate::atmosphere::Atmosphere;
use crate::pupil::{Mirror, Pupil};
use pulp::Arch;
use rayon::prelude::*;
use splash_fft::{Complex, Planned, Transform};
use std::f64::consts::PI;

/// What an image's period has beside a spot and its blur, lambda/d: room for tilts and fringes.
const MARGIN_LAMBDA_D: f64 = 8.0;
/// Largest number of samples across a subaperture.
const MAX_SAMPLES: usize = 512;

/// The optics of the second gate, from the pupil to the intensity in the pixels.
pub struct GateCamera {
    pupil: Pupil,
    focus_m: f64,
    gate_m: f64,
    window: usize,
    /// Across a subaperture: as many as the image's period has lambda/d.
    samples: usize,
    focal_plane: FocalPlane,
    forward: Transform<f32>,
    inverse: Transform<f32>,
    /// Amplitude of a beam along one axis.
    beam: Vec<f32>,
    /// k e x^2 / 2 along one axis, rad.
    defocus: Vec<f32>,
    way_back: GeometricSensor,
    /// Mean gradients on the way back, rad per subaperture.
    returned: Vec<[f64; 2]>,
    /// The mean over the slices, one a spot; empty for a sheet.
    depth: Vec<Lags>,
    footprint: Footprint,
}

/// A layer, resampled for the frame.
struct Resampled {
    /// b_z/b.
    factor: f32,
    /// For each row of subapertures, `[iy][row][texel]`.
    lines: Vec<f32>,
    texels: usize,
    /// For each column of subapertures.
    taps: Vec<Vec<Taps>>,
}

/// Buffers of one spot.
struct Scratch {
    /// The field, `[row][column]`, then its transform along x.
    rows: Vec<Complex<f32>>,
    /// Transformed along y as well, `[kx][ky]`, then the lags along y.
    columns: Vec<Complex<f32>>,
    fft: Vec<Complex<f32>>,
    lags: Lags,
}

/// Where a gate is.
#[derive(Clone, Debug, PartialEq)]
pub struct Gate {
    /// H, to which the beams converge, m.
    pub focus_m: f64,
    /// z, to which the gate's camera is focused, m: below H.
    pub height_m: f64,
    /// From where the light comes, in the focus of the gate's camera.
    pub slab: Slab,
    /// Of the laser, m.
    pub wavelength_m: f64,
}

impl Gate {
    /// Samples across a subaperture: as many as the image's period has lambda/d, in which a spot and its field of `window`
    /// pixels of lambda/(d `pixels_per_lambda_d`) have room.
    pub(crate) fn samples(&self, pupil: &Pupil, pixels_per_lambda_d: f64, window: usize) -> usize {
        let (pitch_m, wavelength_m) = (pupil.pitch_m(), self.wavelength_m);
        let e_per_m = 1.0 / self.height_m - 1.0 / self.focus_m;
        // In lambda/d.
        let spot = e_per_m * pitch_m * pitch_m / wavelength_m;
        let blur = self.slab.blur_rad(pupil.diameter_m(), wavelength_m) * pitch_m / wavelength_m;
        let period = (spot + blur + MARGIN_LAMBDA_D).max(window as f64 / pixels_per_lambda_d);
        // Multiples of 8 have quick transforms. Far too many are too many as well.
        let least = period.min(2.0 * MAX_SAMPLES as f64).ceil() as usize;
        least.next_multiple_of(8).max(pupil.samples())
    }
}

impl GateCamera {
    /// A camera for `gate` with windows of `window` x `window` pixels (4 to 32) of lambda/(d `pixels_per_lambda_d`), to
    /// look through atmospheres like `atmosphere`.
    ///
    /// # Errors
    /// [`OpticsError`] if the gate is above the focus, or its spots are too wide to be sampled.
    pub fn new(
        pupil: &Pupil,
        atmosphere: &Atmosphere,
        gate: &Gate,
        pixels_per_lambda_d: f64,
        window: usize,
    ) -> Result<Self, OpticsError> {
        let Gate { focus_m, height_m: gate_m, ref slab, wavelength_m } = *gate;
        check_geometry(pupil, atmosphere, Some(focus_m))?;
        super::error::positive("pixels_per_lambda_d", pixels_per_lambda_d)?;
        super::error::positive("wavelength_m", wavelength_m)?;
        check_window(window)?;
        let way_back =
            GeometricSensor::new(Sensor::Splash, pupil, atmosphere, focus_m, pixels_per_lambda_d)?
                .with_gate(gate_m)?;
        let samples = gate.samples(pupil, pixels_per_lambda_d, window);
        if samples > MAX_SAMPLES {
            let limit = format!(
                "one whose spots, their blur and their window are at most {MAX_SAMPLES} lambda/d wide"
            );
            return Err(OpticsError::range("gate_height_m", gate_m, limit));
        }
        let pitch_m = pupil.pitch_m();
        let curvature = PI / wavelength_m * (1.0 / gate_m - 1.0 / focus_m);
        let place_m = |k: usize| from_centre(k, samples) * pitch_m;
        Ok(Self {
            focus_m,
            gate_m,
            window,
            samples,
            focal_plane: FocalPlane::new(samples, window, pixels_per_lambda_d),
            forward: f32::forward(2 * samples),
            inverse: f32::inverse(2 * samples),
            beam: vec![1.0; samples],
            defocus: (0..samples).map(|k| (curvature * place_m(k).powi(2)) as f32).collect(),
            way_back,
            returned: vec![[0.0; 2]; pupil.subapertures().len()],
            depth: if slab.is_sheet() { vec![] } else { depth(pupil, slab, samples) },
            footprint: Footprint::default(),
            pupil: pupil.clone(),
        })
    }

    /// The same camera with beams of this shape: uniform ones unless this is called.
    #[must_use]
    pub fn with_launch(self, launch: Launch) -> Self {
        let amplitudes = launch.amplitudes(self.samples);
        Self { beam: amplitudes.into_iter().map(|a| a as f32).collect(), ..self }
    }

    /// W, pixels on the side of a window.
    pub fn window(&self) -> usize {
        self.window
    }

    /// Number of spots, one per subaperture in use.
    pub fn spots(&self) -> usize {
        self.pupil.subapertures().len()
    }

    /// The images at `time_s` with `mirror` in the pupil on both paths: `[spot][row][column]`, the fraction of the
    /// light of a spot with nothing in its beam that falls on each pixel. The same to the bit for any number of
    /// threads.
    ///
    /// # Panics
    /// If `images` is not spots x W x W, `mirror` does not have one segment per spot, or `time_s` is outside the
    /// atmosphere's duration.
    pub fn expose(
        &mut self,
        atmosphere: &Atmosphere,
        time_s: f64,
        mirror: &Mirror,
        images: &mut [f32],
    ) {
        let pixels = self.window * self.window;
        assert_eq!(images.len(), self.spots() * pixels, "images");
        self.way_back.returned(atmosphere, time_s, mirror, &mut self.returned);
        let layers = self.resample(atmosphere, time_s);
        let (camera, plane, arch) = (&*self, &self.focal_plane, Arch::new());
        images.par_chunks_exact_mut(pixels).enumerate().for_each_init(
            || (camera.scratch(), plane.scratch()),
            |(scratch, plane_scratch), (spot, image)| {
                camera.field(spot, mirror.segments[spot], &layers, &mut scratch.rows);
                camera.correlate(scratch);
                camera.come_back(spot, &mut scratch.lags);
                arch.dispatch(Image { plane, otf: &scratch.lags, scratch: plane_scratch, image });
            },
        );
    }

    fn scratch(&self) -> Scratch {
        let side = 2 * self.samples;
        let length =
            self.forward.get_inplace_scratch_len().max(self.inverse.get_inplace_scratch_len());
        Scratch {
            rows: vec![Complex::default(); self.samples * side],
            columns: vec![Complex::default(); side * side],
            fft: vec![Complex::default(); length],
            lags: Lags::new(self.samples),
        }
    }

    /// The layers below the gate, resampled along y for each row of subapertures, and the taps along x for each
    /// column.
    fn resample(&mut self, atmosphere: &Atmosphere, time_s: f64) -> Vec<Resampled> {
        let Self { pupil, samples, footprint, .. } = self;
        let (across, samples) = (pupil.across(), *samples);
        let below = atmosphere.flows.iter().filter(|flow| flow.height_m < self.gate_m);
        let resampled = below.map(|flow| {
            footprint.cut(flow, atmosphere, time_s);
            let footprint = &*footprint;
            let taps = |axis: usize, index: usize| {
                let centre_m = pupil.centre_m(index);
                let path = Path::Beacon { height_m: self.focus_m, position_m: [centre_m; 2] };
                let (scale, shift) = path.through(flow.height_m);
                let place_m = |k| centre_m + from_centre(k, samples) * pupil.pitch_m();
                let at_layer = |k| scale * place_m(k) + shift[axis];
                footprint.taps(axis, (0..samples).map(at_layer))
            };
            let texels = footprint.side();
            let mut lines = vec![0.0; across * samples * texels];
            lines.par_chunks_exact_mut(samples * texels).enumerate().for_each(|(iy, lines)| {
                for (taps, line) in taps(1, iy).iter().zip(lines.chunks_exact_mut(texels)) {
                    footprint.between_rows(taps, line);
                }
            });
            let arm = |height_m: f64| 1.0 - flow.height_m / height_m;
            Resampled {
                factor: (arm(self.gate_m) / arm(self.focus_m)) as f32,
                lines,
                texels,
                taps: (0..across).map(|ix| taps(0, ix)).collect(),
            }
        });
        resampled.collect()
    }

    /// The field of one beam, `[row][column]` in rows of twice its length, zero beyond.
    fn field(
        &self,
        spot: usize,
        [_, tip, tilt]: [f64; 3],
        layers: &[Resampled],
        rows: &mut [Complex<f32>],
    ) {
        let (n, coarse) = (self.samples, self.pupil.samples());
        let [ix, iy] = self.pupil.subapertures()[spot];
        // A segment's tip is the phase at its edge.
        let edge = |k: usize| 2.0 * from_centre(k, n);
        let along_x: Vec<f32> = (0..n).map(|k| self.defocus[k] - (tip * edge(k)) as f32).collect();
        // The pupil's sample that covers one of these.
        let of_pupil = |index: usize, k: usize| index * coarse + k * coarse / n;
        rows.fill(Complex::default());
        for (row, field) in rows.chunks_exact_mut(2 * n).enumerate() {
            let along_y = self.defocus[row] - (tilt * edge(row)) as f32;
            for (col, value) in field[..n].iter_mut().enumerate() {
                let layers = layers.iter().map(|layer| {
                    let line = &layer.lines[(iy * n + row) * layer.texels..][..layer.texels];
                    layer.factor * layer.taps[ix][col].on(line)
                });
                let phase = along_x[col] + along_y + layers.sum::<f32>();
                let open = self.pupil.amplitude(of_pupil(iy, row), of_pupil(ix, col));
                *value = Complex::cis(phase) * (open * self.beam[row] * self.beam[col]);
            }
        }
    }

    /// The transfer function of the light of the field in `scratch`: its autocorrelation.
    fn correlate(&self, scratch: &mut Scratch) {
        let (n, side) = (self.samples, 2 * self.samples);
        let Scratch { rows, columns, fft, lags } = scratch;
        self.forward.process_with_scratch(rows, fft);
        columns.fill(Complex::default());
        for (row, field) in rows.chunks_exact(side).enumerate() {
            for (kx, value) in field.iter().enumerate() {
                columns[kx * side + row] = *value;
            }
        }
        self.forward.process_with_scratch(columns, fft);
        columns.iter_mut().for_each(|value| *value = value.norm_sqr().into());
        self.inverse.process_with_scratch(columns, fft);
        for (ly, field) in rows.chunks_exact_mut(side).enumerate() {
            for (kx, value) in field.iter_mut().enumerate() {
                *value = columns[kx * side + ly];
            }
        }
        self.inverse.process_with_scratch(rows, fft);
        // Transforms and the samples of a beam whose light is one.
        let norm = 1.0 / ((side * side) as f32 * (n * n) as f32);
        let lines = lags.re.chunks_exact_mut(side - 1).zip(lags.im.chunks_exact_mut(side - 1));
        for ((re, im), field) in lines.zip(rows.chunks_exact(side)) {
            // Negative lags are at the transform's end.
            let field = field[n + 1..].iter().chain(&field[..n]);
            for ((re, im), value) in re.iter_mut().zip(im).zip(field) {
                (*re, *im) = (norm * value.re, norm * value.im);
            }
        }
    }

    /// What the way back does to it.
    fn come_back(&self, spot: usize, lags: &mut Lags) {
        let [x, y] = self.returned[spot].map(|gradient| turns(self.samples, -gradient));
        by_lags([&x, &y], |at, turn| {
            let (re, im) = (&mut lags.re[at], &mut lags.im[at]);
            let mut value = Complex::new(*re, *im) * turn;
            if let Some(depth) = self.depth.get(spot) {
                value *= Complex::new(depth.re[at], depth.im[at]);
            }
            (*re, *im) = (value.re, value.im);
        });
    }
}

/// Where one of so many samples is, subapertures from the centre of its own.
fn from_centre(k: usize, samples: usize) -> f64 {
    (k as f64 + 0.5) / samples as f64 - 0.5
}

/// exp(i g l) for the lags l = -(n-1) .. n-1 of a gradient g, rad per subaperture.
fn turns(samples: usize, gradient: f64) -> Vec<Complex<f32>> {
    let last = samples as i64 - 1;
    let turn = |l: i64| Complex::cis(gradient * l as f64 / samples as f64);
    (-last..=last).map(turn).map(|turn| Complex::new(turn.re as f32, turn.im as f32)).collect()
}

/// Hands over the place of each lag and the product of what both axes have there.
fn by_lags([x, y]: [&[Complex<f32>]; 2], mut each: impl FnMut(usize, Complex<f32>)) {
    // Those along y are not negative.
    let products = y[y.len() / 2..].iter().flat_map(|y| x.iter().map(move |x| x * y));
    products.enumerate().for_each(|(at, product)| each(at, product));
}

/// The slices' mean of exp(-i k e' (x - x_i).l) over the pupil, for each spot: over a square of side d the mean is a
/// product of two sincs.
fn depth(pupil: &Pupil, slab: &Slab, samples: usize) -> Vec<Lags> {
    let mut all = vec![Lags::new(samples); pupil.subapertures().len()];
    for &Slice { weight, curvature_rad_per_m2, .. } in &slab.slices {
        // rad per subaperture, of a place that is a subaperture from the axis.
        let gradient = 2.0 * curvature_rad_per_m2 * pupil.pitch_m().powi(2);
        let centre = |index: usize| pupil.centre_m(index) / pupil.pitch_m();
        let places: Vec<_> =
            (0..pupil.across()).map(|index| turns(samples, gradient * centre(index))).collect();
        let back: Vec<_> = places
            .iter()
            .map(|turns| turns.iter().map(Complex::conj).collect::<Vec<_>>())
            .collect();
        let square: Vec<Complex<f32>> = (1 - samples as i64..samples as i64)
            .map(|l| sinc(gradient * l as f64 / samples as f64 / 2.0))
            .map(|mean| Complex::new(mean as f32, 0.0))
            .collect();
        let mut mean = vec![Complex::<f32>::default(); samples * (2 * samples - 1)];
        for &[ix, iy] in pupil.subapertures() {
            by_lags([&back[ix], &back[iy]], |at, turn| mean[at] += turn);
        }
        let share = weight / pupil.subapertures().len() as f32;
        by_lags([&square, &square], |at, square| mean[at] *= square * share);
        all.par_iter_mut().zip(pupil.subapertures()).for_each(|(lags, &[ix, iy])| {
            by_lags([&places[ix], &places[iy]], |at, turn| {
                let value = mean[at] * turn;
                lags.re[at] += value.re;
                lags.im[at] += value.im;
            });
        });
    }
    all
}
