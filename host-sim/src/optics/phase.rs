//! The phase that turbulence leaves along each of the paths through it.

use super::OpticsError;
use super::error::positive;
use super::sampling::Footprint;
use crate::atmosphere::Atmosphere;
use crate::pupil::Pupil;

/// A bundle of rays that ends on the pupil. A layer at height h is met by the ray to pupil point
/// x at b x + (1 - b) s: b = 1 - h/H for a beacon at height H and lateral position s, b = 1 for
/// a star.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Path {
    /// A star on the optical axis, at infinity: science and natural guide star.
    Star,
    /// A beacon: the laser guide star for position (0, 0), spot i of SPLASH for x_i.
    Beacon {
        /// H, m above the telescope.
        height_m: f64,
        /// s, m from the optical axis.
        position_m: [f64; 2],
    },
}

impl Path {
    /// b and (1 - b) s for a layer at `height_m`.
    pub(crate) fn through(&self, height_m: f64) -> (f64, [f64; 2]) {
        match *self {
            Path::Star => (1.0, [0.0; 2]),
            Path::Beacon { height_m: beacon_m, position_m } => {
                let away = height_m / beacon_m;
                (1.0 - away, position_m.map(|position| away * position))
            }
        }
    }
}

/// Samples the turbulence at the pupil's samples along any [`Path`]; holds the buffers.
#[derive(Debug, Default)]
pub struct PhaseSampler {
    footprint: Footprint,
    /// Texels of one row of samples, resampled along y.
    line: Vec<f32>,
}

impl PhaseSampler {
    /// Turbulent phase in rad at the sensing wavelength, `[row][col]` at the samples of `pupil`,
    /// at `time_s`, summed over the layers.
    ///
    /// # Panics
    /// If `phase` is not S x S, the pupil is larger than the atmosphere's footprint, a layer is
    /// not below the beacon, or `time_s` is outside the atmosphere's duration.
    pub fn sample(
        &mut self,
        path: Path,
        pupil: &Pupil,
        atmosphere: &Atmosphere,
        time_s: f64,
        phase: &mut [f32],
    ) {
        self.sample_layers(path, pupil, atmosphere, time_s, |_| true, phase);
    }

    /// As [`Self::sample`], over the layers whose height in metres is `selected`.
    pub(crate) fn sample_layers(
        &mut self,
        path: Path,
        pupil: &Pupil,
        atmosphere: &Atmosphere,
        time_s: f64,
        selected: impl Fn(f64) -> bool,
        phase: &mut [f32],
    ) {
        let side = pupil.side();
        assert_eq!(phase.len(), side * side, "phase array");
        phase.fill(0.0);
        for flow in atmosphere.flows.iter().filter(|flow| selected(flow.height_m)) {
            self.footprint.cut(flow, atmosphere, time_s);
            let (scale, shift) = path.through(flow.height_m);
            let [columns, rows] = [0, 1].map(|axis| {
                let offsets = (0..side).map(|k| scale * pupil.sample_m(k) + shift[axis]);
                self.footprint.taps(axis, offsets)
            });
            self.line.resize(self.footprint.side(), 0.0);
            for (taps, out) in rows.iter().zip(phase.chunks_exact_mut(side)) {
                self.footprint.between_rows(taps, &mut self.line);
                for (out, taps) in out.iter_mut().zip(&columns) {
                    *out += taps.on(&self.line);
                }
            }
        }
    }
}

/// Whether `pupil` fits in the atmosphere's footprint, and the layers below the beacon if any.
pub(crate) fn check_geometry(
    pupil: &Pupil,
    atmosphere: &Atmosphere,
    beacon_height_m: Option<f64>,
) -> Result<(), OpticsError> {
    let footprint_m = atmosphere.footprint_m();
    if pupil.diameter_m() > footprint_m * (1.0 + 1e-9) {
        let limit = format!("<= the atmosphere's footprint of {footprint_m} m");
        return Err(OpticsError::range("diameter_m", pupil.diameter_m(), limit));
    }
    if let Some(beacon_m) = beacon_height_m {
        positive("beacon_height_m", beacon_m)?;
        for (index, height_m) in atmosphere.heights_m().enumerate() {
            if height_m >= beacon_m {
                let limit = format!("< the beacon's height of {beacon_m} m");
                return Err(OpticsError::range(
                    format!("layers[{index}].height_m"),
                    height_m,
                    limit,
                ));
            }
        }
    }
    Ok(())
}
