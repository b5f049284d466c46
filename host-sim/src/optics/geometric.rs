//! Centroids as mean gradients of the wavefront, without diffraction.
//!
//! SPLASH's beams leave the telescope parallel to its axis, each converging to a focus at the beacon's height H:
//! at height h, beam i is a square of side d (1 - h/H) centred on x_i. A second gate images the spots on their
//! way, at a height z < H, where a layer's tilt theta at h has moved the spot by theta (z - h), which the telescope
//! sees as theta (1 - h/z); a layer above z has not moved it yet. The light comes back from (x_i, z) to the whole
//! pupil, so that
//!
//! up: (1 - h/z) mean of grad phi_h over that square,
//! back: mean over the pupil of grad phi_h((1 - h/z) x + (h/z) x_i), the gradient in x.
//!
//! The spot at z is d (1 - z/H) wide; the way back is taken from its centre. The centroid of the light that the
//! beam has left there moves as its mean gradient does, in focus or not.

use super::OpticsError;
use super::launch::Launch;
use super::phase::{Path, check_geometry};
use super::sampling::{Footprint, Stencil};
use crate::atmosphere::{Atmosphere, Flow};
use crate::pupil::{Mirror, Pupil};
use rayon::prelude::*;

/// What the wavefront sensor looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Sensor {
    /// Spots launched through each subaperture and seen by the whole telescope.
    Splash,
    /// One laser beacon above the telescope, seen by each subaperture.
    Lgs,
    /// A star, seen by each subaperture.
    Ngs,
}

/// What a beacon does to gradients beside the cone that its light takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effects {
    /// A gradient at a layer appears times b in the pupil; without, it appears whole.
    pub lever_arm: bool,
    /// The way back from SPLASH's spots takes the mean over the pupil off; without, nothing does.
    pub return_path: bool,
}

impl Effects {
    /// As it is.
    pub const ALL: Self = Self { lever_arm: true, return_path: true };
}

/// The geometric model of a sensor. The gradient is averaged over the continuous wavefront: its
/// mean over a square follows from the phase on the square's edges, its mean over the pupil from
/// the phase on the outline of the pupil.
///
/// SPLASH's beams may be Gaussian: the centre of gravity of a far field is the mean of the gradient
/// weighted by the beam's intensity. The weight is one number for each of the square's cells, as
/// for the images; over a cell the gradient is the difference between its edges.
pub struct GeometricSensor {
    sensor: Sensor,
    effects: Effects,
    launch: Launch,
    pupil: Pupil,
    beacon_height_m: f64,
    /// Where the spots are imaged: at the beacon's height, or by a second gate below.
    gate_height_m: f64,
    /// px per (rad per subaperture): lambda/(2 pi d) in pixels.
    pixels_per_rad: f64,
    /// The pupil's outline across x and across y.
    outline: [Vec<Edge>; 2],
    footprint: Footprint,
}

/// One side of a square that has no neighbour there.
struct Edge {
    /// Grid line, 0 to N, on which it lies.
    line: usize,
    /// Row (column) of subapertures along which it runs.
    block: usize,
    /// 1 where the pupil ends, -1 where it begins.
    sign: f64,
}

/// Functionals of a layer along one axis for one spot position.
struct AxisStencils {
    /// The phase at the grid lines, N + 1.
    lines: Vec<Stencil>,
    /// The mean over the samples of a subaperture, N.
    blocks: Vec<Stencil>,
    /// Of beams that are not uniform, N; `lines` and `blocks` are then for the pupil's mean alone.
    beams: Vec<Beam>,
}

/// A beam's mean over its subaperture, weighted by its intensity.
struct Beam {
    /// Of the phase.
    phase: Stencil,
    /// Of its gradient, per side of the subaperture.
    gradient: Stencil,
}

impl GeometricSensor {
    /// A `sensor` with a beacon (if it has one) at `beacon_height_m` and pixels of
    /// lambda/(d `pixels_per_lambda_d`), for atmospheres like `atmosphere`.
    pub fn new(
        sensor: Sensor,
        pupil: &Pupil,
        atmosphere: &Atmosphere,
        beacon_height_m: f64,
        pixels_per_lambda_d: f64,
    ) -> Result<Self, OpticsError> {
        super::error::positive("pixels_per_lambda_d", pixels_per_lambda_d)?;
        let beacon = (sensor != Sensor::Ngs).then_some(beacon_height_m);
        check_geometry(pupil, atmosphere, beacon)?;
        Ok(Self {
            sensor,
            effects: Effects::ALL,
            launch: Launch::Uniform,
            pupil: pupil.clone(),
            beacon_height_m,
            gate_height_m: beacon_height_m,
            pixels_per_rad: pixels_per_lambda_d / std::f64::consts::TAU,
            outline: [0, 1].map(|axis| outline(pupil, axis)),
            footprint: Footprint::default(),
        })
    }

    /// The same sensor with no other effects than these.
    #[must_use]
    pub fn with_effects(self, effects: Effects) -> Self {
        Self { effects, ..self }
    }

    /// The same sensor with its spots imaged at `height_m`, from above 0 to the beacon's height; only SPLASH has
    /// spots to image on their way.
    ///
    /// # Errors
    /// [`OpticsError`] with the limit.
    ///
    /// # Panics
    /// For a guide star.
    pub fn with_gate(self, height_m: f64) -> Result<Self, OpticsError> {
        assert_eq!(self.sensor, Sensor::Splash, "a second gate");
        if super::error::positive("gate_height_m", height_m)? > self.beacon_height_m {
            let limit = format!("<= the beacon's height of {} m", self.beacon_height_m);
            return Err(OpticsError::range("gate_height_m", height_m, limit));
        }
        Ok(Self { gate_height_m: height_m, ..self })
    }

    /// The same sensor with beams of this shape; guide stars have none.
    #[must_use]
    pub fn with_launch(self, launch: Launch) -> Self {
        Self { launch, ..self }
    }

    /// Whether the sensor looks at each spot through the whole pupil.
    fn looks_back(&self) -> bool {
        self.sensor == Sensor::Splash && self.effects.return_path
    }

    /// Centroids [x, y] in pixels at `time_s` with `mirror` in the pupil, in the order of
    /// [`Pupil::subapertures`].
    ///
    /// SPLASH: the mean gradient of phi_i - m over beam i less its mean over the pupil,
    /// phi_i being the phase from spot i. Guide stars: the mean gradient over the subaperture.
    /// The steps between segments carry no light and are not counted: a piston has no effect.
    ///
    /// # Panics
    /// If `centroids` or `mirror` do not have one entry per subaperture, or `time_s` is outside
    /// the atmosphere's duration.
    pub fn centroids(
        &mut self,
        atmosphere: &Atmosphere,
        time_s: f64,
        mirror: &Mirror,
        centroids: &mut [[f64; 2]],
    ) {
        let subapertures = self.pupil.subapertures().len();
        assert_eq!(centroids.len(), subapertures, "centroids");
        assert_eq!(mirror.segments.len(), subapertures, "mirror segments");
        centroids.fill([0.0; 2]);
        for flow in &atmosphere.flows {
            // Light that is imaged below a layer has not met it.
            if self.sensor == Sensor::Ngs || flow.height_m < self.gate_height_m {
                self.footprint.cut(flow, atmosphere, time_s);
                self.add_layer(flow, centroids);
            }
        }
        let mean = self.mean_tilt(mirror);
        for (centroid, segment) in centroids.iter_mut().zip(&mirror.segments) {
            for axis in 0..2 {
                // The edges of a segment differ by twice its centre-to-edge phase.
                centroid[axis] -= 2.0 * (segment[axis + 1] - mean[axis]);
                centroid[axis] *= self.pixels_per_rad;
            }
        }
    }

    /// Mean gradients over the pupil of the light that comes back from each spot, rad per subaperture: what
    /// [`Self::centroids`] takes off.
    ///
    /// # Panics
    /// As there.
    pub(crate) fn returned(
        &mut self,
        atmosphere: &Atmosphere,
        time_s: f64,
        mirror: &Mirror,
        gradients: &mut [[f64; 2]],
    ) {
        let mean = self.mean_tilt(mirror);
        gradients.fill(mean.map(|tilt| -2.0 * tilt));
        for flow in &atmosphere.flows {
            if flow.height_m < self.gate_height_m {
                self.footprint.cut(flow, atmosphere, time_s);
                let [x, y] = self.stencils_from(self.gate_height_m, flow.height_m);
                let [_, back] = self.factors(flow.height_m);
                let spots = gradients.par_iter_mut().zip(self.pupil.subapertures());
                spots.for_each(|(gradient, &[ix, iy])| {
                    for (axis, sum) in gradient.iter_mut().enumerate() {
                        *sum += back * self.pupil_gradient(axis, seen(&x, ix), seen(&y, iy));
                    }
                });
            }
        }
    }

    /// The part of the mirror's tip and tilt that the sensor cannot see.
    fn mean_tilt(&self, mirror: &Mirror) -> [f64; 2] {
        if !self.looks_back() {
            return [0.0; 2];
        }
        [1, 2].map(|k| {
            let sum: f64 = mirror.segments.iter().map(|segment| segment[k]).sum();
            sum / mirror.segments.len() as f64
        })
    }

    /// Adds one layer's gradients in rad per subaperture.
    fn add_layer(&self, flow: &Flow, centroids: &mut [[f64; 2]]) {
        // Only SPLASH sees a layer above the ground from as many places as it has spots.
        let places = self.has_places(flow.height_m);
        let [along_x, along_y] = self.stencils_from(self.beacon_height_m, flow.height_m);
        let second = (self.gate_height_m != self.beacon_height_m)
            .then(|| self.stencils_from(self.gate_height_m, flow.height_m));
        let [back_x, back_y] = second.as_ref().map_or([&along_x, &along_y], |[x, y]| [x, y]);
        let pupil_mean = |x: &AxisStencils, y: &AxisStencils| match self.looks_back() {
            true => [0, 1].map(|axis| self.pupil_gradient(axis, x, y)),
            false => [0.0; 2],
        };
        let [up, back] = self.factors(flow.height_m);
        let shared = (!places).then(|| pupil_mean(&back_x[0], &back_y[0]));
        centroids.par_iter_mut().zip(self.pupil.subapertures()).for_each(
            |(centroid, &[ix, iy])| {
                let (x, y) = (seen(&along_x, ix), seen(&along_y, iy));
                let mean = shared.unwrap_or_else(|| pupil_mean(&back_x[ix], &back_y[iy]));
                let edges = |axis: usize| {
                    let across_x =
                        |line: usize| self.footprint.integrate(&x.lines[line], &y.blocks[iy]);
                    let across_y =
                        |line: usize| self.footprint.integrate(&x.blocks[ix], &y.lines[line]);
                    match (axis, x.beams.get(ix), y.beams.get(iy)) {
                        (0, Some(x), Some(y)) => self.footprint.integrate(&x.gradient, &y.phase),
                        (_, Some(x), Some(y)) => self.footprint.integrate(&x.phase, &y.gradient),
                        (0, ..) => across_x(ix + 1) - across_x(ix),
                        (..) => across_y(iy + 1) - across_y(iy),
                    }
                };
                for axis in 0..2 {
                    centroid[axis] += match up == back {
                        true => up * (edges(axis) - mean[axis]),
                        false => up * edges(axis) - back * mean[axis],
                    };
                }
            },
        );
    }

    /// Whether a layer is seen from as many places as there are spots.
    fn has_places(&self, height_m: f64) -> bool {
        self.sensor == Sensor::Splash && height_m > 0.0
    }

    /// Functionals of a layer along x and along y, from each column's or row's spot at `from_m`, or from the only
    /// place that there is.
    fn stencils_from(&self, from_m: f64, height_m: f64) -> [Vec<AxisStencils>; 2] {
        let places = self.has_places(height_m);
        let count = if places { self.pupil.across() } else { 1 };
        let position = |index| if places { self.pupil.centre_m(index) } else { 0.0 };
        let path = |index| self.path(from_m, [position(index); 2]);
        let of = |axis| (0..count).map(|k| self.stencils(axis, height_m, path(k))).collect();
        [0, 1].map(of)
    }

    /// What the differences of a layer's phase over a square and over the pupil count for: over what the beam
    /// covers, 1 - h/H of a subaperture, they are 1 - h/H of the gradient that turns it by 1 - h/z.
    fn factors(&self, height_m: f64) -> [f64; 2] {
        let arm = |from_m| self.path(from_m, [0.0; 2]).through(height_m).0;
        let [focus, gate] = [self.beacon_height_m, self.gate_height_m].map(arm);
        match self.effects.lever_arm {
            true => [gate / focus, 1.0],
            false => [1.0 / focus, 1.0 / gate],
        }
    }

    /// From a spot that is at height `from_m`, or from the guide star.
    fn path(&self, from_m: f64, position_m: [f64; 2]) -> Path {
        match self.sensor {
            Sensor::Ngs => Path::Star,
            Sensor::Splash | Sensor::Lgs => Path::Beacon { height_m: from_m, position_m },
        }
    }

    fn stencils(&self, axis: usize, height_m: f64, path: Path) -> AxisStencils {
        let (scale, shift) = path.through(height_m);
        let at_layer = |pupil_m: f64| scale * pupil_m + shift[axis];
        let pupil = &self.pupil;
        let (across, samples) = (pupil.across(), pupil.samples());
        let line_m = |line: usize| (line as f64 - across as f64 / 2.0) * pupil.pitch_m();
        let lines = (0..=across).map(|line| self.footprint.mean(axis, &[at_layer(line_m(line))]));
        let blocks = (0..across).map(|block| {
            let offsets: Vec<f64> = (block * samples..(block + 1) * samples)
                .map(|k| at_layer(pupil.sample_m(k)))
                .collect();
            self.footprint.mean(axis, &offsets)
        });
        let beams = if self.is_shaped() { 0..across } else { 0..0 };
        let beams = beams.map(|block| self.beam(axis, |k| at_layer(line_m(block) + k)));
        AxisStencils { lines: lines.collect(), blocks: blocks.collect(), beams: beams.collect() }
    }

    /// Whether there are beams that weight their subaperture.
    fn is_shaped(&self) -> bool {
        self.sensor == Sensor::Splash && self.launch != Launch::Uniform
    }

    /// A beam along one axis; `place` takes metres from the subaperture's edge to metres at the layer.
    fn beam(&self, axis: usize, place: impl Fn(f64) -> f64) -> Beam {
        let samples = self.pupil.samples();
        let places = |from: f64, count: usize| -> Vec<f64> {
            let pitch_m = self.pupil.sample_pitch_m();
            (0..count).map(|k| place((k as f64 + from) * pitch_m)).collect()
        };
        let slopes = self.launch.intensities(samples);
        let weights: Vec<f64> = slopes.iter().map(|slope| slope / samples as f64).collect();
        // A cell's gradient is the difference between its edges: each edge has a cell on either side.
        let right = slopes.iter().chain([&0.0]);
        let left = [0.0].into_iter().chain(slopes.iter().copied());
        let edges: Vec<f64> = left.zip(right).map(|(left, right)| left - right).collect();
        Beam {
            phase: self.footprint.weighted(axis, &places(0.5, samples), &weights),
            gradient: self.footprint.weighted(axis, &places(0.0, samples + 1), &edges),
        }
    }

    /// Mean gradient over the pupil in rad per subaperture: inside, the edges of neighbouring
    /// squares cancel.
    fn pupil_gradient(&self, axis: usize, x: &AxisStencils, y: &AxisStencils) -> f64 {
        let edges = self.outline[axis].iter().map(|edge| {
            let (x, y) = match axis {
                0 => (&x.lines[edge.line], &y.blocks[edge.block]),
                _ => (&x.blocks[edge.block], &y.lines[edge.line]),
            };
            edge.sign * self.footprint.integrate(x, y)
        });
        edges.sum::<f64>() / self.pupil.subapertures().len() as f64
    }
}

/// Those of a column's or row's spots.
fn seen(stencils: &[AxisStencils], index: usize) -> &AxisStencils {
    stencils.get(index).unwrap_or(&stencils[0])
}

/// The edges across `axis` that bound the pupil.
fn outline(pupil: &Pupil, axis: usize) -> Vec<Edge> {
    let across = pupil.across();
    let inside = |along: usize, block: usize| match axis {
        0 => pupil.contains(along, block),
        _ => pupil.contains(block, along),
    };
    let mut edges = vec![];
    for block in 0..across {
        for line in 0..=across {
            let before = line > 0 && inside(line - 1, block);
            let after = inside(line, block);
            if before != after {
                edges.push(Edge { line, block, sign: if before { 1.0 } else { -1.0 } });
            }
        }
    }
    edges
}
