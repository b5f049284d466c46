//! Zernike polynomials and the covariances of their coefficients, against their definitions and
//! the numbers that Noll (1976) printed.

use host_sim::theory::kolmogorov::{spectrum, structure};
use host_sim::theory::legendre::GaussLegendre;
use host_sim::theory::noll;
use host_sim::theory::phase_covariance::PhaseCovariance;
use host_sim::theory::zernike::{Mode, Part, Zernikes, modes};
use std::f64::consts::{PI, TAU};

fn values(max_order: usize, point: [f64; 2]) -> Vec<f64> {
    let zernikes = Zernikes::new(max_order);
    let mut out = vec![0.0; zernikes.modes().len()];
    zernikes.values(point, &mut out);
    out
}

/// The mean of a function over the unit disk.
fn disk_mean(radii: usize, angles: usize, f: impl Fn([f64; 2]) -> f64) -> f64 {
    let rule = GaussLegendre::new(radii);
    let ring = |r: f64| -> f64 {
        let at = |k: usize| TAU * (k as f64 + 0.5) / angles as f64;
        (0..angles).map(|k| f([r * at(k).cos(), r * at(k).sin()])).sum::<f64>() / angles as f64
    };
    rule.nodes().iter().map(|&(r, weight)| 2.0 * r * weight * ring(r)).sum()
}

#[test]
fn the_first_polynomials_are_those_of_nolls_table() {
    for [x, y] in [[0.3, -0.5], [0.0, 0.7], [-0.9, 0.1], [1.1, 0.4], [0.0, 0.0]] {
        let r2: f64 = x * x + y * y;
        let (r2_cos2, r2_sin2) = (x * x - y * y, 2.0 * x * y);
        let (r3_cos3, r3_sin3) = (x * x * x - 3.0 * x * y * y, 3.0 * x * x * y - y * y * y);
        let expected = [
            2.0 * x,
            2.0 * y,
            3f64.sqrt() * (2.0 * r2 - 1.0),
            6f64.sqrt() * r2_sin2,
            6f64.sqrt() * r2_cos2,
            8f64.sqrt() * (3.0 * r2 - 2.0) * y,
            8f64.sqrt() * (3.0 * r2 - 2.0) * x,
            8f64.sqrt() * r3_sin3,
            8f64.sqrt() * r3_cos3,
            5f64.sqrt() * (6.0 * r2 * r2 - 6.0 * r2 + 1.0),
            10f64.sqrt() * (4.0 * r2 - 3.0) * r2_cos2,
            10f64.sqrt() * (4.0 * r2 - 3.0) * r2_sin2,
        ];
        for (index, (found, expected)) in values(4, [x, y]).iter().zip(expected).enumerate() {
            assert!((found - expected).abs() < 1e-14, "Z{} at {x}, {y}: {found}", index + 2);
        }
    }
}

/// Even j carry the cosine, odd j the sine, and each order has n + 1 polynomials.
#[test]
fn the_order_is_nolls() {
    for (index, mode) in modes(20).iter().enumerate() {
        let j = index + 2;
        // The order that holds j: n (n + 1) / 2 come before it.
        let n = (1..).find(|n| j <= (n + 1) * (n + 2) / 2).unwrap();
        assert_eq!(mode.radial, n, "j = {j}");
        let expected = match (mode.azimuthal, j % 2) {
            (0, _) => Part::Round,
            (_, 0) => Part::Cosine,
            _ => Part::Sine,
        };
        assert_eq!(mode.part, expected, "j = {j}");
    }
    let azimuthal: Vec<_> = modes(4).iter().map(|mode| mode.azimuthal).collect();
    assert_eq!(azimuthal, [1, 1, 0, 2, 2, 1, 1, 3, 3, 0, 2, 2, 4, 4]);
}

/// The radial polynomials are sums of (-1)^s (n - s)! / (s! ((n + m)/2 - s)! ((n - m)/2 - s)!)
/// r^(n - 2 s), in and outside the disk.
#[test]
fn the_recurrence_gives_the_sum_of_factorials() {
    let factorial = |n: usize| (1..=n).map(|k| k as f64).product::<f64>();
    for r in [0.2, 0.7, 1.0, 1.15] {
        for (mode, found) in modes(14).iter().zip(values(14, [r, 0.0])) {
            let (n, m) = (mode.radial, mode.azimuthal);
            let term = |s: usize| {
                let sign = if s.is_multiple_of(2) { 1.0 } else { -1.0 };
                let below = factorial(s) * factorial((n + m) / 2 - s) * factorial((n - m) / 2 - s);
                sign * factorial(n - s) / below * f64::powi(r, (n - 2 * s) as i32)
            };
            let radial: f64 = (0..=(n - m) / 2).map(term).sum();
            let angular = match mode.part {
                Part::Round => 1.0,
                Part::Cosine => 2f64.sqrt(),
                Part::Sine => 0.0,
            };
            let expected = (n as f64 + 1.0).sqrt() * radial * angular;
            assert!((found - expected).abs() < 1e-10, "{mode:?} at {r}: {found} {expected}");
        }
    }
}

#[test]
fn the_polynomials_are_orthonormal_up_to_order_40() {
    let order = 40;
    let (rule, angles) = (GaussLegendre::new(42), 96);
    let count = modes(order).len();
    let mut products = nalgebra::DMatrix::<f64>::zeros(count, count);
    let zernikes = Zernikes::new(order);
    let mut row = nalgebra::DVector::zeros(count);
    for &(r, weight) in rule.nodes() {
        for k in 0..angles {
            let (sin, cos) = (TAU * (f64::from(k) + 0.25) / f64::from(angles)).sin_cos();
            zernikes.values([r * cos, r * sin], row.as_mut_slice());
            products.ger(2.0 * r * weight / f64::from(angles), &row, &row, 1.0);
        }
    }
    let error = (products - nalgebra::DMatrix::identity(count, count)).amax();
    assert!(error < 1e-12, "{error}");
}

/// The variance left after the first modes. The piston-free variance is half the mean structure
/// function of two points of the disk, whose distance s has the density
/// (4 s / pi) [acos(s/2) - (s/2) sqrt(1 - s^2/4)].
#[test]
fn residuals_are_nolls() {
    let rule = GaussLegendre::new(100);
    // s = 2 sin(t) takes the square root away.
    let mean: f64 = rule
        .nodes()
        .iter()
        .map(|&(part, weight)| {
            let t = part * PI / 2.0;
            let s = 2.0 * t.sin();
            let density = 4.0 * s / PI * ((PI / 2.0 - t) - t.sin() * t.cos());
            weight * PI / 2.0 * 2.0 * t.cos() * density * s.powf(5.0 / 3.0)
        })
        .sum();
    let piston_free = 0.5 * structure() * mean;
    let variance = |mode: &Mode| noll::covariance(mode.radial, mode.radial, mode.azimuthal);
    let printed = [
        (1, 1.0299, 0.00005),
        (2, 0.582, 0.0005),
        (3, 0.134, 0.0005),
        (4, 0.111, 0.0005),
        (6, 0.0648, 0.00005),
        (10, 0.0401, 0.00005),
    ];
    for (count, residual, rounding) in printed {
        let removed: f64 = modes(3).iter().take(count - 1).map(variance).sum();
        let found = piston_free - removed;
        // He rounded the constant of the spectrum, 0.02290, to 0.023 and that of D to 6.88.
        assert!(found > residual - rounding, "{count} modes: {found}, printed {residual}");
        assert!(found < 1.006 * (residual + rounding), "{count} modes: {found}");
    }
}

/// <a_j a_k> as the integral over wavenumbers that Noll starts from.
#[test]
fn covariances_are_nolls_integral() {
    let bessel = |n: usize, x: f64| libm::jn(n as i32 + 1, x);
    let rule = GaussLegendre::new(16);
    for (n, other, m) in
        [(1, 1, 1), (1, 3, 1), (2, 2, 0), (2, 4, 2), (4, 8, 0), (7, 7, 3), (13, 13, 1)]
    {
        // k = t^3 takes the cusp of k^(-2/3) at 0 away; beyond k = 400 less than 1e-7 is left.
        let panels = 400;
        let width = 400f64.cbrt() / f64::from(panels);
        let integral: f64 = (0..panels)
            .flat_map(|panel| rule.nodes().iter().map(move |&node| (panel, node)))
            .map(|(panel, (part, weight))| {
                let t = (f64::from(panel) + part) * width;
                let k = t * t * t;
                weight * width * 3.0 * t.powi(-12) * bessel(n, k) * bessel(other, k)
            })
            .sum();
        let sign = if ((n + other) / 2 - m) % 2 == 0 { 1.0 } else { -1.0 };
        let norm = (((n + 1) * (other + 1)) as f64).sqrt();
        let expected = 2.0 * spectrum() * sign * norm * integral;
        let found = noll::covariance(n, other, m);
        assert!((found / expected - 1.0).abs() < 1e-5, "{n} {other} {m}: {found} {expected}");
    }
}

/// <a_j phi(x)> = -(1/2) mean over the disk of Z_j(x') D(x - x').
#[test]
fn covariances_with_the_phase_are_means_over_the_disk() {
    let order = 6;
    let covariance = PhaseCovariance::new(order);
    let mut found = vec![0.0; covariance.modes().len()];
    let largest = noll::covariance(2, 2, 0);
    for point in [[0.1, 0.2], [-0.6, 0.5], [0.8, 0.6], [0.3, -1.0], [0.9, 0.9], [1.3, 0.2]] {
        covariance.values(point, &mut found);
        for index in [0, 1, 2, 3, 7, 9, 14, 20, 26] {
            let expected = disk_mean(300, 600, |[x, y]| {
                let distance = f64::hypot(x - point[0], y - point[1]);
                -0.5 * structure() * distance.powf(5.0 / 3.0) * values(order, [x, y])[index]
            });
            let error = (found[index] - expected).abs();
            assert!(error < 1e-5 * largest, "Z{} at {point:?}: {error}", index + 2);
        }
    }
}

/// A laser guide star that senses every mode measures phi(beta x): the fraction left is
/// 1 + beta^(5/3) - 2 <a a'> / <a^2> with a' = mean of Z(x) phi(beta x), where
/// <a a'> / <a^2> = int k^(-14/3) J(k) J(beta k) dk / (beta int k^(-14/3) J(k)^2 dk), J = J_(n+1).
/// The values are those of Weber's and Schafheitlin's closed form in 30-digit arithmetic (mpmath).
#[test]
fn the_cone_effect_of_a_continuous_sensor() {
    let expected = [
        0.16589089, 0.29248304, 0.4292114, 0.56769102, 0.70186227, 0.82769144, 0.94277905,
        1.0459697, 1.1370071,
    ];
    let (order, beta) = (10, 0.75);
    let (covariance, zernikes) = (PhaseCovariance::new(order), Zernikes::new(order));
    for (n, expected) in (2..=order).zip(expected) {
        let (mut own, mut cross) = (0.0, 0.0);
        for (index, mode) in modes(order).iter().enumerate().filter(|(_, mode)| mode.radial == n) {
            own += noll::covariance(n, n, mode.azimuthal);
            cross += disk_mean(16, 48, |[x, y]| {
                let mut rows = [vec![0.0; modes(order).len()], vec![0.0; modes(order).len()]];
                zernikes.values([x, y], &mut rows[0]);
                covariance.values([beta * x, beta * y], &mut rows[1]);
                rows[0][index] * rows[1][index]
            });
        }
        let left = 1.0 + beta.powf(5.0 / 3.0) - 2.0 * cross / own;
        assert!((left - expected).abs() < 1e-7, "order {n}: {left}, not {expected}");
    }
}
