//! Frozen turbulent layers blown over the telescope.

use crate::optics::OpticsError;
use crate::optics::error::{not_negative, positive};
use crate::screen::{BrownianTorus, MAX_TEXELS, STRUCTURE_CONSTANT, Screen};

/// Texels of a phase screen per subaperture pitch.
pub const TEXELS_PER_PITCH: f64 = 16.0;
/// U over the footprint: the structure function is exact up to U, which therefore exceeds the
/// footprint's diagonal.
const UNIT_PER_FOOTPRINT: f64 = 1.5;

/// A thin layer of turbulence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layer {
    /// Share of the turbulence, in any unit: the weights are normalised to a sum of one.
    pub weight: f64,
    /// Height above the telescope along the line of sight, m.
    pub height_m: f64,
    /// Speed of the frozen flow, m/s.
    pub wind_speed_m_per_s: f64,
    /// Where the layer moves to, in degrees from +x towards +y.
    pub wind_direction_deg: f64,
}

impl Layer {
    fn validate(&self, index: usize) -> Result<(), OpticsError> {
        let name = |field: &str| format!("layers[{index}].{field}");
        not_negative(&name("weight"), self.weight)?;
        not_negative(&name("height_m"), self.height_m)?;
        not_negative(&name("wind_speed_m_per_s"), self.wind_speed_m_per_s)?;
        if !self.wind_direction_deg.is_finite() {
            let value = self.wind_direction_deg;
            return Err(OpticsError::range(name("wind_direction_deg"), value, "finite"));
        }
        Ok(())
    }

    /// Velocity along x and y, m/s.
    pub fn velocity_m_per_s(&self) -> [f64; 2] {
        let (sin, cos) = self.wind_direction_deg.to_radians().sin_cos();
        [self.wind_speed_m_per_s * cos, self.wind_speed_m_per_s * sin]
    }
}

/// A layer with its phase.
#[derive(Debug, Clone)]
pub(crate) struct Flow {
    pub(crate) height_m: f64,
    velocity_m_per_s: [f64; 2],
    pub(crate) screen: Screen,
}

impl Flow {
    /// The place in the screen that is above the pupil's centre at `time_s`, in metres.
    pub(crate) fn centre_m(&self, time_s: f64) -> [f64; 2] {
        self.velocity_m_per_s.map(|velocity| -velocity * time_s)
    }
}

/// One realisation of the turbulence: at time t and position x (m from the optical axis) layer l
/// has the phase screen_l(x - v_l t).
#[derive(Debug, Clone)]
pub struct Atmosphere {
    pub(crate) flows: Vec<Flow>,
    footprint_m: f64,
    duration_s: f64,
}

impl Atmosphere {
    /// Kolmogorov turbulence of Fried parameter `r0_m` (at the sensing wavelength, along the line
    /// of sight) for a telescope of diameter `footprint_m` and subaperture pitch `pitch_m`, blowing
    /// for `duration_s` without any place being seen twice. To draw many, keep a [`Turbulence`].
    pub fn new(
        r0_m: f64,
        layers: &[Layer],
        footprint_m: f64,
        pitch_m: f64,
        duration_s: f64,
        seed: u64,
    ) -> Result<Self, OpticsError> {
        let turbulence = Turbulence::new(r0_m, layers, footprint_m, pitch_m, duration_s)?;
        Ok(turbulence.realise(seed, &mut |_| ()))
    }

    /// Layers with given screens, whose weights are not used; an empty list is a still, empty sky.
    pub fn from_screens(
        layers: Vec<(Layer, Screen)>,
        footprint_m: f64,
        duration_s: f64,
    ) -> Result<Self, OpticsError> {
        positive("footprint_m", footprint_m)?;
        not_negative("duration_s", duration_s)?;
        let mut flows = Vec::with_capacity(layers.len());
        for (index, (layer, screen)) in layers.into_iter().enumerate() {
            layer.validate(index)?;
            let velocity_m_per_s = layer.velocity_m_per_s();
            let flow = Flow { height_m: layer.height_m, velocity_m_per_s, screen };
            for time_s in [0.0, duration_s] {
                if !flow.screen.covers(flow.centre_m(time_s), footprint_m) {
                    let field = format!("layers[{index}]: footprint_m at {time_s} s");
                    return Err(OpticsError::range(field, footprint_m, "inside the screen"));
                }
            }
            flows.push(flow);
        }
        Ok(Self { flows, footprint_m, duration_s })
    }

    /// Heights of the layers, m.
    pub fn heights_m(&self) -> impl Iterator<Item = f64> + '_ {
        self.flows.iter().map(|flow| flow.height_m)
    }

    /// Side of the square that may be sampled at any height, m.
    pub fn footprint_m(&self) -> f64 {
        self.footprint_m
    }

    /// The last time at which the turbulence is defined, s.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// The screens in the order of the layers.
    pub fn screens(&self) -> impl Iterator<Item = &Screen> + '_ {
        self.flows.iter().map(|flow| &flow.screen)
    }
}

/// A turbulence profile, ready to draw realisations of it.
pub struct Turbulence {
    layers: Vec<Layer>,
    /// For each layer: phase in rad per unit of a surface of structure function 2 (r/U)^(5/3).
    scales_rad: Vec<f64>,
    /// Distinct tori, and for each layer the index of its own.
    tori: Vec<BrownianTorus>,
    torus_of: Vec<usize>,
    sizes: Vec<[usize; 2]>,
    texel_m: f64,
    unit_m: f64,
    footprint_m: f64,
    duration_s: f64,
}

impl Turbulence {
    /// See [`Atmosphere::new`]. Layers of weight zero are left out.
    pub fn new(
        r0_m: f64,
        layers: &[Layer],
        footprint_m: f64,
        pitch_m: f64,
        duration_s: f64,
    ) -> Result<Self, OpticsError> {
        positive("r0_m", r0_m)?;
        positive("footprint_m", footprint_m)?;
        positive("pitch_m", pitch_m)?;
        not_negative("duration_s", duration_s)?;
        for (index, layer) in layers.iter().enumerate() {
            layer.validate(index)?;
        }
        let total = positive("sum of the layers' weights", layers.iter().map(|l| l.weight).sum())?;
        let texel_m = pitch_m / TEXELS_PER_PITCH;
        let unit_m = UNIT_PER_FOOTPRINT * footprint_m;
        let (mut kept, mut scales_rad, mut torus_of, mut sizes) = (vec![], vec![], vec![], vec![]);
        for (index, layer) in layers.iter().enumerate().filter(|(_, layer)| layer.weight > 0.0) {
            let size = plan_torus(index, layer, footprint_m, texel_m, duration_s)?;
            let place = sizes.iter().position(|&other| other == size).unwrap_or(sizes.len());
            if place == sizes.len() {
                sizes.push(size);
            }
            torus_of.push(place);
            // D = 6.88 w (r/r0)^(5/3), w being the layer's share.
            let structure = STRUCTURE_CONSTANT * (unit_m / r0_m).powf(5.0 / 3.0);
            scales_rad.push((structure * layer.weight / total / 2.0).sqrt());
            kept.push(*layer);
        }
        let tori = sizes.iter().map(|&size| BrownianTorus::new(size, unit_m / texel_m)).collect();
        let layers = kept;
        Ok(Self {
            layers,
            scales_rad,
            tori,
            torus_of,
            sizes,
            texel_m,
            unit_m,
            footprint_m,
            duration_s,
        })
    }

    /// Texels of the largest screen and of all, without drawing any: drawing takes 24 bytes for each of the
    /// largest, keeping them four bytes for each of all.
    ///
    /// # Errors
    /// [`OpticsError::ScreenTooLarge`].
    pub fn texels(
        layers: &[Layer],
        footprint_m: f64,
        pitch_m: f64,
        duration_s: f64,
    ) -> Result<[u64; 2], OpticsError> {
        let (mut largest, mut all) = (0, 0);
        for (index, layer) in layers.iter().enumerate().filter(|(_, layer)| layer.weight > 0.0) {
            let texel_m = pitch_m / TEXELS_PER_PITCH;
            let [width, height] = plan_torus(index, layer, footprint_m, texel_m, duration_s)?;
            let texels = (width * height) as u64;
            largest = largest.max(texels);
            all += texels;
        }
        Ok([largest, all])
    }

    /// One realisation, a pure function of `seed`; `progress` is told the fraction done.
    pub fn realise(&self, seed: u64, progress: &mut dyn FnMut(f64)) -> Atmosphere {
        // A draw gives two surfaces: the second serves the next layer on a torus of that size.
        let mut spare: Vec<Option<_>> = self.tori.iter().map(|_| None).collect();
        let count = self.layers.len();
        let mut flows = Vec::with_capacity(count);
        for (index, layer) in self.layers.iter().enumerate() {
            progress(index as f64 / count as f64);
            let torus = self.torus_of[index];
            let mut surface = spare[torus].take().unwrap_or_else(|| {
                let [first, second] = self.tori[torus].draw(seed, index as u32);
                spare[torus] = Some(second);
                first
            });
            let scale = self.scales_rad[index];
            for texel in &mut surface.texels {
                *texel *= scale as f32;
            }
            let [width, height] = self.sizes[torus];
            let screen = Screen {
                texels: surface.texels,
                width,
                height,
                texel_m: self.texel_m,
                first_m: [0.0; 2],
                gradient_rad_per_m: surface.gradient.map(|g| g * scale / self.unit_m),
                periodic: true,
            };
            let velocity_m_per_s = layer.velocity_m_per_s();
            flows.push(Flow { height_m: layer.height_m, velocity_m_per_s, screen });
        }
        progress(1.0);
        Atmosphere { flows, footprint_m: self.footprint_m, duration_s: self.duration_s }
    }
}

/// Width and height in texels of the torus over which a layer's footprint travels without ever
/// lying on a place it has left.
///
/// Let the wind's larger component be along a. A torus at least as long along a as the path plus
/// the footprint is never wrapped along a. Across, the path may wrap: the footprint then lands
/// beside its own past only if it has moved, across, by at least the other side less the
/// footprint; it has moved at least as much along a, and since the sides are at least
/// 4 U = 6 footprints, that is far beyond the footprint.
fn plan_torus(
    index: usize,
    layer: &Layer,
    footprint_m: f64,
    texel_m: f64,
    duration_s: f64,
) -> Result<[usize; 2], OpticsError> {
    // Interpolation reaches two texels beyond the footprint on each side.
    let footprint = footprint_m / texel_m + 6.0;
    let shortest = (4.0 * UNIT_PER_FOOTPRINT * footprint_m / texel_m).max(2.0 * footprint);
    let [vx, vy] = layer.velocity_m_per_s().map(f64::abs);
    let speed = vx.max(vy);
    let longest = shortest.max(speed * duration_s / texel_m + footprint);
    if longest * shortest > MAX_TEXELS as f64 {
        let longest_s = (MAX_TEXELS as f64 / shortest - footprint).max(0.0) * texel_m / speed;
        return Err(OpticsError::ScreenTooLarge {
            layer: index,
            duration_s,
            texels: (longest * shortest) as u64,
            limit: MAX_TEXELS,
            // A still layer that does not fit fits no run at all.
            longest_s: if longest_s.is_finite() { longest_s } else { 0.0 },
        });
    }
    let (long, short) =
        (fast_length(longest.ceil() as usize), fast_length(shortest.ceil() as usize));
    Ok(if vx >= vy { [long, short] } else { [short, long] })
}

/// The smallest even number >= `length` without a prime factor above 5: transforms are fast there.
fn fast_length(length: usize) -> usize {
    (length.next_multiple_of(2)..)
        .step_by(2)
        .find(|&candidate| {
            let mut rest = candidate;
            for prime in [2, 3, 5] {
                while rest.is_multiple_of(prime) {
                    rest /= prime;
                }
            }
            rest == 1
        })
        .expect("powers of two are unbounded")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(speed: f64, direction: f64) -> Layer {
        Layer {
            weight: 1.0,
            height_m: 0.0,
            wind_speed_m_per_s: speed,
            wind_direction_deg: direction,
        }
    }

    /// Wherever the footprint goes on the torus, it overlaps an earlier position only where the
    /// layer itself still does.
    #[test]
    fn no_place_is_visited_twice() {
        let (footprint_m, texel_m, duration_s) = (4.0, 0.03125, 60.0);
        for direction in (0..24).map(|k| 15.0 * f64::from(k) + 0.7) {
            let layer = layer(10.0, direction);
            let [w, h] = plan_torus(0, &layer, footprint_m, texel_m, duration_s).unwrap();
            let sides = [w as f64 * texel_m, h as f64 * texel_m];
            let velocity = layer.velocity_m_per_s();
            for step in 0..=6000 {
                let time = duration_s * f64::from(step) / 6000.0;
                let moved = velocity.map(|v| v * time);
                let overlap =
                    |gap: [f64; 2]| gap.iter().all(|g| g.abs() < footprint_m + 4.0 * texel_m);
                let wrapped = [0, 1].map(|k| moved[k] - sides[k] * (moved[k] / sides[k]).round());
                if overlap(wrapped) {
                    assert!(overlap(moved), "direction {direction}, after {time} s");
                    assert_eq!(wrapped, moved);
                }
            }
        }
    }

    #[test]
    fn a_run_too_long_names_the_longest() {
        let error = plan_torus(3, &layer(20.0, 90.0), 4.0, 0.03125, 1e5).unwrap_err();
        let OpticsError::ScreenTooLarge { layer: 3, longest_s, .. } = error else {
            panic!("{error}")
        };
        assert!(plan_torus(3, &layer(20.0, 90.0), 4.0, 0.03125, 0.999 * longest_s).is_ok());
        assert!(plan_torus(3, &layer(20.0, 90.0), 4.0, 0.03125, 1.001 * longest_s).is_err());
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        let new = |r0, weight| {
            let layer = Layer { weight, ..layer(10.0, 0.0) };
            Turbulence::new(r0, &[layer], 1.0, 0.5, 0.0).map(|_| ()).unwrap_err().to_string()
        };
        assert_eq!(new(f64::NAN, 1.0), "r0_m = NaN: must be finite and > 0");
        assert_eq!(new(0.5, -1.0), "layers[0].weight = -1: must be finite and >= 0");
        assert_eq!(new(0.5, 0.0), "sum of the layers' weights = 0: must be finite and > 0");
    }
}
