//! Pressure, temperature and number density of the air: U.S. Standard Atmosphere 1976, 0 to 86 km.

/// Earth's radius of the geopotential, m.
const EARTH_RADIUS_M: f64 = 6_356_766.0;
/// Gravity times molar mass over the gas constant, K/m.
const HYDROSTATIC_K_PER_M: f64 = 9.806_65 * 0.028_964_4 / 8.314_32;
/// Boltzmann's constant, J/K.
const BOLTZMANN_J_PER_K: f64 = 1.380_649e-23;
/// At sea level.
const SEA_LEVEL_K: f64 = 288.15;
const SEA_LEVEL_PA: f64 = 101_325.0;
/// Geopotential height at which a layer begins, m, and its temperature gradient, K/m.
const LAYERS: [(f64, f64); 7] = [
    (0.0, -6.5e-3),
    (11_000.0, 0.0),
    (20_000.0, 1e-3),
    (32_000.0, 2.8e-3),
    (47_000.0, 0.0),
    (51_000.0, -2.8e-3),
    (71_000.0, -2e-3),
];

/// Pressure, Pa, and temperature, K, at an altitude above sea level, m. Above 86 km the last layer goes on
/// up to where it is at 150 K, and is isothermal beyond.
pub fn air(altitude_m: f64) -> (f64, f64) {
    let geopotential_m = EARTH_RADIUS_M * altitude_m / (EARTH_RADIUS_M + altitude_m);
    let (mut pressure, mut temperature) = (SEA_LEVEL_PA, SEA_LEVEL_K);
    for (index, &(base_m, gradient)) in LAYERS.iter().enumerate() {
        let top_m = LAYERS.get(index + 1).map_or(f64::INFINITY, |next| next.0);
        let rise_m = geopotential_m.min(top_m) - base_m;
        let next = (temperature + gradient * rise_m).max(150.0);
        pressure *= if gradient == 0.0 {
            (-HYDROSTATIC_K_PER_M * rise_m / temperature).exp()
        } else {
            (temperature / next).powf(HYDROSTATIC_K_PER_M / gradient)
        };
        temperature = next;
        if geopotential_m <= top_m {
            break;
        }
    }
    (pressure, temperature)
}

/// Molecules per m^3.
pub fn molecules_per_m3(altitude_m: f64) -> f64 {
    let (pressure, temperature) = air(altitude_m);
    pressure / (BOLTZMANN_J_PER_K * temperature)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The printed tables of the standard: geometric altitude, K, Pa.
    #[test]
    fn as_printed() {
        for (altitude_m, kelvin, pascal) in [
            (0.0, 288.15, 101_325.0),
            (5_000.0, 255.676, 54_048.0),
            (12_000.0, 216.65, 19_399.0),
            (20_000.0, 216.65, 5_529.3),
            (30_000.0, 226.509, 1_197.0),
            (50_000.0, 270.65, 79.779),
            (80_000.0, 198.639, 1.0524),
        ] {
            let (pressure, temperature) = air(altitude_m);
            assert!((temperature - kelvin).abs() < 0.01, "{altitude_m} m: {temperature} K");
            assert!((pressure / pascal - 1.0).abs() < 3e-4, "{altitude_m} m: {pressure} Pa");
        }
        assert!((molecules_per_m3(0.0) / 2.547e25 - 1.0).abs() < 1e-3);
    }
}
