//! Profiles by name, and those in CSV files.

use crate::atmosphere::Layer;
use crate::error::Error;
use crate::files::csv::Series;
use std::path::Path;

/// Steps in height of a model, and where it ends: what is above has less than 1e-6 of anything.
const STEP_M: f64 = 5.0;
const TOP_M: f64 = 30e3;

/// A profile that has a name. Sources are in the module's table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the module's table says what they are")]
pub enum Profile {
    Paper,
    HufnagelValley57,
    EsoMedian35,
    MaunaKea7,
}

impl Profile {
    /// All of them.
    pub const ALL: [Self; 4] =
        [Self::Paper, Self::HufnagelValley57, Self::EsoMedian35, Self::MaunaKea7];

    /// The name in a description.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::HufnagelValley57 => "hufnagel-valley-57",
            Self::EsoMedian35 => "eso-median-35",
            Self::MaunaKea7 => "mauna-kea-7",
        }
    }

    /// The one of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|profile| profile.name() == name)
    }

    /// Layers unless told otherwise; 0 for as many as the table has.
    pub fn default_count(self) -> usize {
        match self {
            Self::HufnagelValley57 => 10,
            _ => 0,
        }
    }

    /// Its layers, a model's every 5 m, where the beacon is at `beacon_height_m`.
    pub fn layers(self, beacon_height_m: f64) -> Vec<Layer> {
        let of = |[height_m, weight, wind_speed_m_per_s]: [f64; 3]| Layer {
            weight,
            height_m,
            wind_speed_m_per_s,
            wind_direction_deg: 0.0,
        };
        match self {
            // An eighth of the default subaperture a frame, at right angles, as in the default description.
            Self::Paper => vec![
                of([0.0, 0.6, 62.5]),
                Layer { wind_direction_deg: 90.0, ..of([0.25 * beacon_height_m, 0.4, 62.5]) },
            ],
            Self::HufnagelValley57 => {
                let heights = (0..(TOP_M / STEP_M) as usize).map(|k| (k as f64 + 0.5) * STEP_M);
                let step = |h| of([h, hufnagel_valley_57(h) * STEP_M, bufton_wind_m_per_s(h)]);
                heights.map(step).collect()
            }
            Self::EsoMedian35 => ESO_MEDIAN_35.map(of).to_vec(),
            Self::MaunaKea7 => MAUNA_KEA_7.map(of).to_vec(),
        }
    }
}

/// Layers from a CSV file with the columns `height_m` and `weight`, and perhaps `wind_speed_m_per_s` and
/// `wind_direction_deg`, which are 0 without.
///
/// # Errors
/// [`Error::Config`] if it cannot be read, or a column is missing. Values are checked with the description.
pub fn read(path: &Path) -> Result<Vec<Layer>, Error> {
    let name = path.display();
    let series = Series::read(path).map_err(|error| Error::Config(error.to_string()))?;
    let needed = |column: &str| {
        series.column(column).ok_or_else(|| Error::Config(format!("{name}: no column {column}")))
    };
    let (heights, weights) = (needed("height_m")?, needed("weight")?);
    let known = |column: &str| series.column(column).unwrap_or_else(|| vec![0.0; heights.len()]);
    let (speeds, directions) = (known("wind_speed_m_per_s"), known("wind_direction_deg"));
    let layer = |k: usize| Layer {
        weight: weights[k],
        height_m: heights[k],
        wind_speed_m_per_s: speeds[k],
        wind_direction_deg: directions[k],
    };
    Ok((0..heights.len()).map(layer).collect())
}

/// Cn2 at a height above the ground, m^(-2/3), with a pseudo-wind of 21 m/s and 1.7e-14 at the ground.
pub fn hufnagel_valley_57(height_m: f64) -> f64 {
    const PSEUDO_WIND_M_PER_S: f64 = 21.0;
    const GROUND: f64 = 1.7e-14;
    let h = height_m;
    0.00594 * (PSEUDO_WIND_M_PER_S / 27.0).powi(2) * (1e-5 * h).powi(10) * (-h / 1000.0).exp()
        + 2.7e-16 * (-h / 1500.0).exp()
        + GROUND * (-h / 100.0).exp()
}

/// Bufton's wind with 2.8 m/s at the ground, whose rms from 5 to 20 km is the model's 21 m/s.
pub fn bufton_wind_m_per_s(height_m: f64) -> f64 {
    2.8 + 30.0 * (-((height_m - 9400.0) / 4800.0).powi(2)).exp()
}

/// Height, m; share; wind, m/s.
const ESO_MEDIAN_35: [[f64; 3]; 35] = [
    [30.0, 0.241954, 5.5],
    [90.0, 0.119977, 5.5],
    [150.0, 0.0968817, 5.1],
    [200.0, 0.0589889, 5.5],
    [245.0, 0.0472911, 5.6],
    [300.0, 0.0472911, 5.7],
    [390.0, 0.0472911, 5.8],
    [600.0, 0.0472911, 6.0],
    [1130.0, 0.0398925, 6.5],
    [1880.0, 0.0323939, 7.0],
    [2630.0, 0.0161969, 7.5],
    [3500.0, 0.0260951, 8.5],
    [4500.0, 0.0155971, 9.5],
    [5500.0, 0.0103980, 11.5],
    [6500.0, 0.00999811, 17.5],
    [7500.0, 0.0119977, 23.0],
    [8500.0, 0.00400924, 26.0],
    [9500.0, 0.0139974, 29.0],
    [10500.0, 0.0129975, 32.0],
    [11500.0, 0.00700868, 27.0],
    [12500.0, 0.0159970, 22.0],
    [13500.0, 0.0258951, 14.5],
    [14500.0, 0.0190964, 9.5],
    [15500.0, 0.00986813, 6.3],
    [16500.0, 0.00616883, 5.5],
    [17500.0, 0.00400924, 6.0],
    [18500.0, 0.00246953, 6.5],
    [19500.0, 0.00215959, 7.0],
    [20500.0, 0.00184965, 7.5],
    [21500.0, 0.00135974, 8.0],
    [22500.0, 0.00110979, 8.5],
    [23500.0, 0.000616883, 9.0],
    [24500.0, 0.000925825, 9.5],
    [25500.0, 0.000493907, 10.0],
    [26500.0, 0.000431918, 10.0],
];

/// The same.
const MAUNA_KEA_7: [[f64; 3]; 7] = [
    [0.0, 0.4557, 5.6],
    [500.0, 0.1295, 5.77],
    [1000.0, 0.0442, 6.25],
    [2000.0, 0.0506, 7.57],
    [4000.0, 0.1167, 13.31],
    [8000.0, 0.0926, 19.06],
    [16000.0, 0.1107, 12.14],
];

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// What gives the model its name, at 500 nm: r0 = 5 cm and an isoplanatic angle of 7 urad.
    #[test]
    fn hufnagel_valley_is_5_7() {
        let layers = Profile::HufnagelValley57.layers(12e3);
        let k2 = (TAU / 500e-9_f64).powi(2);
        let sum = |power: f64| -> f64 {
            layers.iter().map(|layer| layer.weight * layer.height_m.powf(power)).sum()
        };
        let r0_m = (0.423 * k2 * sum(0.0)).powf(-0.6);
        let angle = (2.914 * k2 * sum(5.0 / 3.0)).powf(-0.6);
        assert!((r0_m / 0.05 - 1.0).abs() < 0.01, "{r0_m}");
        assert!((angle / 7e-6 - 1.0).abs() < 0.02, "{angle}");
    }

    #[test]
    fn the_wind_is_that_of_the_model() {
        let speeds = (0..15_000).map(|k| bufton_wind_m_per_s(5000.5 + f64::from(k)));
        let rms = (speeds.map(|speed| speed * speed).sum::<f64>() / 15e3).sqrt();
        assert!((rms - 21.0).abs() < 0.1, "{rms}");
    }

    #[test]
    fn shares_of_the_tables_add_up() {
        for profile in [Profile::Paper, Profile::EsoMedian35, Profile::MaunaKea7] {
            let layers = profile.layers(12e3);
            let sum: f64 = layers.iter().map(|layer| layer.weight).sum();
            assert!((sum - 1.0).abs() < 2e-4, "{profile:?}: {sum}");
            assert!(layers.windows(2).all(|pair| pair[0].height_m < pair[1].height_m));
        }
    }
}
