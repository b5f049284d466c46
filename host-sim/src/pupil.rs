//! The segmented telescope pupil and the segmented mirror that lies in it.

use crate::optics::OpticsError;

/// Largest number of subapertures across a pupil.
pub const MAX_ACROSS: usize = 128;
/// Largest number of phase samples across a subaperture.
pub const MAX_SAMPLES: usize = 32;

/// A square grid of square subapertures, of which a mask selects those that carry light.
///
/// Coordinates: x grows with the column, y with the row, the origin is the pupil's centre.
/// Subaperture (ix, iy) is the square of side d centred on ((ix - (N-1)/2) d, (iy - (N-1)/2) d).
/// The pupil function is the union of the selected squares. Phase arrays are `[row][col]`,
/// row-major, N n samples on a side, at the centres of a grid of pitch d/n.
#[derive(Debug, Clone, PartialEq)]
pub struct Pupil {
    across: usize,
    samples: usize,
    pitch_m: f64,
    mask: Vec<bool>,
    subapertures: Vec<[usize; 2]>,
    /// Amplitude of the light at each sample of the grid, `[row][col]`; empty where nothing stands in it.
    amplitude: Vec<f32>,
}

/// What stands in the light inside the subapertures: a disc about the axis, and straight vanes from there outwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstruction {
    /// Diameter of the disc, m.
    pub disc_m: f64,
    /// Width of a vane, m.
    pub vane_width_m: f64,
    /// Number of vanes, at equal angles.
    pub vanes: u32,
    /// Direction of the first, from +x towards +y, rad.
    pub vane_angle_rad: f64,
}

/// Places across a sample at which an obstruction is asked for.
const PLACES: usize = 16;

impl Obstruction {
    /// Directions of the vanes.
    fn directions(&self) -> Vec<[f64; 2]> {
        let turn = |k: u32| f64::from(k) / f64::from(self.vanes) * std::f64::consts::TAU;
        let direction = |k: u32| (self.vane_angle_rad + turn(k)).sin_cos();
        (0..self.vanes).map(direction).map(|(sin, cos)| [cos, sin]).collect()
    }

    /// The part, 0 to 1, that it covers of a cell of side `cell_m` about a place: an edge at a distance s outside
    /// of the centre covers 1/2 - s/cell, exact for edges along x or y.
    fn covers(&self, [x, y]: [f64; 2], cell_m: f64, directions: &[[f64; 2]]) -> f64 {
        let within = |outside_m: f64| (0.5 - outside_m / cell_m).clamp(0.0, 1.0);
        let disc = if self.disc_m > 0.0 { within(x.hypot(y) - self.disc_m / 2.0) } else { 0.0 };
        if self.vane_width_m == 0.0 {
            return disc;
        }
        let vane = |&[cos, sin]: &[f64; 2]| match x * cos + y * sin >= 0.0 {
            true => within((y * cos - x * sin).abs() - self.vane_width_m / 2.0),
            false => 0.0,
        };
        directions.iter().map(vane).fold(disc, f64::max)
    }
}

impl Pupil {
    /// `across` x `across` subapertures of side `pitch_m`, each sampled `samples` x `samples`;
    /// `mask` (row-major, `across`^2 entries) selects those in use.
    pub fn new(
        across: usize,
        samples: usize,
        pitch_m: f64,
        mask: Vec<bool>,
    ) -> Result<Self, OpticsError> {
        if !(1..=MAX_ACROSS).contains(&across) {
            let limit = format!("1 to {MAX_ACROSS} subapertures");
            return Err(OpticsError::range("across", across as f64, limit));
        }
        if !(2..=MAX_SAMPLES).contains(&samples) {
            let limit = format!("2 to {MAX_SAMPLES} samples per subaperture");
            return Err(OpticsError::range("samples", samples as f64, limit));
        }
        crate::optics::error::positive("pitch_m", pitch_m)?;
        if mask.len() != across * across {
            return Err(OpticsError::Length {
                field: "mask".into(),
                value: mask.len(),
                limit: format!("{}", across * across),
            });
        }
        let subapertures: Vec<[usize; 2]> = (0..across * across)
            .filter(|&index| mask[index])
            .map(|index| [index % across, index / across])
            .collect();
        if subapertures.is_empty() {
            let limit = "at least one subaperture in use".into();
            return Err(OpticsError::Length { field: "mask".into(), value: 0, limit });
        }
        Ok(Self { across, samples, pitch_m, mask, subapertures, amplitude: vec![] })
    }

    /// The same pupil behind `obstruction`. A sample that is covered in part has the amplitude of the mean over
    /// its area: the part that is open.
    ///
    /// # Errors
    /// [`OpticsError`] if no light is left.
    pub fn with_obstruction(mut self, obstruction: &Obstruction) -> Result<Self, OpticsError> {
        let side = self.side();
        let cell_m = self.sample_pitch_m() / PLACES as f64;
        let offset_m = |k: usize| (k as f64 + 0.5 - PLACES as f64 / 2.0) * cell_m;
        let directions = obstruction.directions();
        let open = |k: usize| {
            let (row, col) = (k / side, k % side);
            if !self.illuminates(row, col) {
                return 0.0;
            }
            let [x, y] = [col, row].map(|index| self.sample_m(index));
            let place = |k: usize| [x + offset_m(k % PLACES), y + offset_m(k / PLACES)];
            let covered = |k: usize| obstruction.covers(place(k), cell_m, &directions);
            let sum: f64 = (0..PLACES * PLACES).map(covered).sum();
            (1.0 - sum / (PLACES * PLACES) as f64) as f32
        };
        let amplitude: Vec<f32> = (0..side * side).map(open).collect();
        if amplitude.iter().all(|&amplitude| amplitude == 0.0) {
            return Err(OpticsError::range("disc_m", obstruction.disc_m, "smaller than the pupil"));
        }
        self.amplitude = amplitude;
        Ok(self)
    }

    /// Whether anything stands in the light.
    pub fn is_obstructed(&self) -> bool {
        !self.amplitude.is_empty()
    }

    /// Amplitude of the light at sample (row, col): 1 in the open, 0 outside the subapertures in use and behind
    /// an obstruction, in between where one covers a part.
    pub fn amplitude(&self, row: usize, col: usize) -> f32 {
        match self.amplitude.get(row * self.side() + col) {
            Some(&amplitude) => amplitude,
            None => f32::from(u8::from(self.illuminates(row, col))),
        }
    }

    /// The amplitudes of all samples, row-major.
    pub(crate) fn amplitudes(&self) -> Vec<f32> {
        let side = self.side();
        (0..side * side).map(|k| self.amplitude(k / side, k % side)).collect()
    }

    /// The amplitudes' sum: the open area in samples.
    pub fn open_samples(&self) -> f64 {
        match self.amplitude.as_slice() {
            [] => self.illuminated_samples() as f64,
            amplitude => amplitude.iter().map(|&a| f64::from(a)).sum(),
        }
    }

    /// The sum of the amplitudes' squares.
    pub(crate) fn power_samples(&self) -> f64 {
        match self.amplitude.as_slice() {
            [] => self.illuminated_samples() as f64,
            amplitude => amplitude.iter().map(|&a| f64::from(a).powi(2)).sum(),
        }
    }

    /// The subapertures whose centre lies inside the circle of diameter N d (52 of 64 for N = 8).
    pub fn circular(across: usize, samples: usize, pitch_m: f64) -> Result<Self, OpticsError> {
        // In units of d/2, where centres are integers: exact at any size.
        let from_centre = |i: usize| (2 * i as i64 + 1 - across as i64).pow(2);
        let mask = (0..across * across)
            .map(|k| from_centre(k % across) + from_centre(k / across) <= (across * across) as i64)
            .collect();
        Self::new(across, samples, pitch_m, mask)
    }

    /// All N x N subapertures.
    pub fn square(across: usize, samples: usize, pitch_m: f64) -> Result<Self, OpticsError> {
        Self::new(across, samples, pitch_m, vec![true; across * across])
    }

    /// N, subapertures across the grid.
    pub fn across(&self) -> usize {
        self.across
    }

    /// n, phase samples across a subaperture.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// S = N n, phase samples across the grid.
    pub fn side(&self) -> usize {
        self.across * self.samples
    }

    /// d, the side of a subaperture in metres.
    pub fn pitch_m(&self) -> f64 {
        self.pitch_m
    }

    /// D = N d in metres.
    pub fn diameter_m(&self) -> f64 {
        self.across as f64 * self.pitch_m
    }

    /// d/n, the spacing of phase samples in metres.
    pub fn sample_pitch_m(&self) -> f64 {
        self.pitch_m / self.samples as f64
    }

    /// The subapertures in use as (ix, iy), in row-major order of the mask.
    pub fn subapertures(&self) -> &[[usize; 2]] {
        &self.subapertures
    }

    /// Row-major, N^2 entries.
    pub fn mask(&self) -> &[bool] {
        &self.mask
    }

    /// Whether subaperture (ix, iy) is in use; false outside the grid.
    pub fn contains(&self, ix: usize, iy: usize) -> bool {
        ix < self.across && iy < self.across && self.mask[iy * self.across + ix]
    }

    /// Coordinate of the centre of subaperture column or row `index`, in metres.
    pub fn centre_m(&self, index: usize) -> f64 {
        (index as f64 - (self.across as f64 - 1.0) / 2.0) * self.pitch_m
    }

    /// Coordinate of sample column or row `index`, in metres.
    pub fn sample_m(&self, index: usize) -> f64 {
        (index as f64 - (self.side() as f64 - 1.0) / 2.0) * self.sample_pitch_m()
    }

    /// Whether sample (row, col) lies in a subaperture in use.
    pub fn illuminates(&self, row: usize, col: usize) -> bool {
        self.contains(col / self.samples, row / self.samples)
    }

    /// Number of samples in the subapertures in use, M n^2.
    pub fn illuminated_samples(&self) -> usize {
        self.subapertures.len() * self.samples * self.samples
    }
}

/// The shape of the segmented mirror, one segment per subaperture in use, lying in the pupil.
///
/// Over segment i the phase that the mirror takes out is
/// m(x) = piston + tip 2 (x - x_i)/d + tilt 2 (y - y_i)/d:
/// tip and tilt are the phase from the segment's centre to its edge.
#[derive(Debug, Clone, PartialEq)]
pub struct Mirror {
    /// [piston, tip, tilt] in rad at the sensing wavelength, in the order of
    /// [`Pupil::subapertures`].
    pub segments: Vec<[f64; 3]>,
}

impl Mirror {
    /// A flat mirror of `segments` segments.
    pub fn flat(segments: usize) -> Self {
        Self { segments: vec![[0.0; 3]; segments] }
    }

    /// The mirror's phase in rad at the pupil's samples, `[row][col]`, zero where there is no
    /// segment.
    ///
    /// # Panics
    /// If `phase` is not S x S or the number of segments is not that of the pupil.
    pub fn phase(&self, pupil: &Pupil, phase: &mut [f32]) {
        let (n, side) = (pupil.samples(), pupil.side());
        assert_eq!(phase.len(), side * side, "phase array");
        assert_eq!(self.segments.len(), pupil.subapertures().len(), "mirror segments");
        phase.fill(0.0);
        let edges: Vec<f64> = (0..n).map(|k| (2.0 * k as f64 + 1.0) / n as f64 - 1.0).collect();
        for (&[ix, iy], &[piston, tip, tilt]) in pupil.subapertures().iter().zip(&self.segments) {
            for (j, y) in edges.iter().enumerate() {
                let start = (iy * n + j) * side + ix * n;
                for (value, x) in phase[start..start + n].iter_mut().zip(&edges) {
                    *value = (piston + tip * x + tilt * y) as f32;
                }
            }
        }
    }
}
