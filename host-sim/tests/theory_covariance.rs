//! Covariances of gradients averaged over squares, against sums over their edges, against the
//! integral over spatial frequencies and against 40-digit arithmetic.

use host_sim::theory::covariance::{Covariance, SquarePair, matrix};
use host_sim::theory::kolmogorov::{LineIntegral, spectrum, structure};
use host_sim::theory::legendre::GaussLegendre;
use host_sim::theory::mean_gradient::mean_gradients;
use host_sim::theory::squares::Squares;
use splash_firmware::geometry::Mask;
use std::f64::consts::PI;

/// Sides and separation of two squares: alike and not, on one another, touching, apart, askew.
const PAIRS: [(f64, f64, [f64; 2]); 8] = [
    (0.25, 0.25, [0.0, 0.0]),
    (0.25, 0.25, [0.25, 0.0]),
    (0.25, 0.25, [0.25, -0.25]),
    (0.25, 0.1875, [0.0, 0.0]),
    (0.25, 0.1875, [0.03125, 0.09375]),
    (0.25, 0.1875, [-0.34375, 0.5]),
    (0.1875, 0.1875, [0.25, 0.25]),
    (0.1875, 0.1875, [1.75, 0.5]),
];

fn parts(covariance: Covariance) -> [f64; 3] {
    [covariance.xx, covariance.xy, covariance.yy]
}

/// The variance of the gradient over the larger square: the unit of errors.
fn variance(a: f64, b: f64) -> f64 {
    SquarePair::new(a.max(b), a.max(b)).covariance([0.0, 0.0]).xx
}

/// A mean gradient is the difference of the phase's means over two opposite edges, so that
/// covariances are sums of means of -D/2 over pairs of edges.
#[test]
fn they_are_sums_over_edges() {
    const STEPS: usize = 1500;
    let phase = |dx: f64, dy: f64| -0.5 * structure() * (dx * dx + dy * dy).powf(5.0 / 6.0);
    // The mean over two edges, by midpoints: D's cusp is weak.
    let mean = |f: &dyn Fn(f64, f64) -> f64| {
        let at = |k: usize| (k as f64 + 0.5) / STEPS as f64 - 0.5;
        let line = |i: usize| (0..STEPS).map(|j| f(at(i), at(j))).sum::<f64>();
        (0..STEPS).map(line).sum::<f64>() / (STEPS * STEPS) as f64
    };
    for (a, b, [sx, sy]) in PAIRS {
        let mut expected = [0.0; 3];
        for i in [-0.5, 0.5] {
            for l in [-0.5, 0.5] {
                let sign = 4.0 * i * l / (a * b);
                let (ei, el) = (i * a, l * b);
                expected[0] += sign * mean(&|u, v| phase(sx + ei - el, sy + u * a - v * b));
                expected[1] += sign * mean(&|u, v| phase(sx + ei - v * b, sy + u * a - el));
                expected[2] += sign * mean(&|u, v| phase(sx + u * a - v * b, sy + ei - el));
            }
        }
        let found = parts(SquarePair::new(a, b).covariance([sx, sy]));
        for (found, expected) in found.iter().zip(expected) {
            let error = (found - expected).abs() / variance(a, b);
            assert!(error < 1e-5, "{a} {b} {sx} {sy}: {found} {expected}");
        }
    }
}

/// int d^2k / (2 pi)^2 A k^(-11/3) k_a k_b sinc sinc sinc sinc cos(k . s), in polar coordinates.
#[test]
fn they_are_integrals_over_spatial_frequencies() {
    let sinc = |x: f64| if x == 0.0 { 1.0 } else { x.sin() / x };
    let rule = GaussLegendre::new(10);
    for (a, b, [sx, sy]) in PAIRS {
        let reach = a + b + f64::hypot(sx, sy);
        // Beyond, less than (k a)^(-8/3) is left.
        let end = 500.0 / b;
        let mut sums = [0.0; 3];
        // k = t^3 removes k^(-2/3) at 0; panels are no longer than half an oscillation.
        let mut from = 0.0f64;
        while from < end {
            let to = if from == 0.0 { 0.5 / reach } else { (from + PI / reach).min(1.5 * from) };
            let (t0, t1) = (from.cbrt(), to.cbrt());
            for &(part, weight) in rule.nodes() {
                let t = t0 + part * (t1 - t0);
                let k = t * t * t;
                let radial = weight * (t1 - t0) * 3.0;
                // The integrand is periodic in the angle: even steps, enough for e^(i k reach).
                let angles = (1.1 * k * reach) as usize + 40;
                for step in 0..angles {
                    let (sin, cos) = (PI * (step as f64 + 0.5) / angles as f64).sin_cos();
                    let (kx, ky) = (k * cos, k * sin);
                    let filter = sinc(kx * a / 2.0)
                        * sinc(ky * a / 2.0)
                        * sinc(kx * b / 2.0)
                        * sinc(ky * b / 2.0)
                        * (kx * sx + ky * sy).cos();
                    let value = radial / angles as f64 * filter;
                    sums[0] += value * cos * cos;
                    sums[1] += value * cos * sin;
                    sums[2] += value * sin * sin;
                }
            }
            from = to;
        }
        // A / (2 pi)^2 times 2 pi radians, A being pi times `spectrum`.
        let expected = sums.map(|sum| 0.5 * spectrum() * sum);
        let found = parts(SquarePair::new(a, b).covariance([sx, sy]));
        for (found, expected) in found.iter().zip(expected) {
            let error = (found - expected).abs() / variance(a, b);
            assert!(error < 1e-5, "{a} {b} {sx} {sy}: {found} {expected}");
        }
    }
}

/// The same equations in 40-digit arithmetic (mpmath), with mpmath's hypergeometric function: what
/// rounding leaves, in units of the covariance of squares on one another.
#[test]
fn rounding_is_as_small_as_documented() {
    let cases = [
        ((0.25, 0.25, [0.0, 0.0]), [3.202544167183123, 0.0, 3.202544167183123], 1e-13),
        (
            (0.25, 0.1875, [0.25, 0.125]),
            [2.098138281693142, -0.2891842471926389, 2.540070290768909],
            1e-12,
        ),
        (
            (0.25, 0.25, [1.75, 1.75]),
            [1.113296626362778, -0.2219025907777832, 1.113296626362778],
            1e-12,
        ),
        (
            (0.125, 0.09375, [0.125, -0.25]),
            [2.569169550577157, 0.3494830260937092, 2.043778031871754],
            2e-11,
        ),
        (
            (0.125, 0.0625, [1.875, 0.375]),
            [0.9894080892749753, -0.0932383749078305, 1.436952694838826],
            2e-10,
        ),
        (
            (0.05, 0.025, [1.95, 0.15]),
            [0.9661184621631026, -0.03682524395566586, 1.442013932622512],
            6e-9,
        ),
        (
            (0.05, 0.005, [1.95, 0.15]),
            [0.9661115384229382, -0.03682618019436242, 1.442019107374492],
            4e-6,
        ),
        (
            (0.005, 0.005, [1.95, 1.95]),
            [1.073752295466085, -0.2147502237760987, 1.073752295466085],
            4e-6,
        ),
    ];
    for ((a, b, separation), expected, limit) in cases {
        let pair = SquarePair::new(a, b);
        let unit = pair.covariance([0.0, 0.0]).xx;
        for (found, expected) in parts(pair.covariance(separation)).iter().zip(expected) {
            let error = (found - expected).abs() / unit;
            assert!(error <= limit, "{a} {b} {separation:?}: {found} {expected}, {error}");
        }
    }
}

/// A quarter turn exchanges the axes and the sign of xy; a reflection changes that sign only.
#[test]
fn they_turn_with_the_squares() {
    for (a, b, [x, y]) in PAIRS {
        let pair = SquarePair::new(a, b);
        let [xx, xy, yy] = parts(pair.covariance([x, y]));
        for (separation, expected) in [
            ([-y, x], [yy, -xy, xx]),
            ([-x, -y], [xx, xy, yy]),
            ([x, -y], [xx, -xy, yy]),
            ([y, x], [yy, xy, xx]),
        ] {
            for (found, expected) in parts(pair.covariance(separation)).iter().zip(expected) {
                assert!((found - expected).abs() < 1e-11 * variance(a, b), "{a} {b} {x} {y}");
            }
        }
    }
}

/// Every element is that of its two squares, whether separations are whole pitches or not.
#[test]
fn matrices_hold_the_pairs() {
    let subapertures = Squares::subapertures(&Mask::circle(6).unwrap());
    for other in [subapertures.splash(0.6), subapertures.lgs(0.6)] {
        let matrix = matrix(&subapertures, &other);
        let pair = SquarePair::new(subapertures.side(), other.side());
        let unit = variance(subapertures.side(), other.side());
        for i in 0..subapertures.count() {
            for l in 0..other.count() {
                let (from, to) = (subapertures.centre(i), other.centre(l));
                let Covariance { xx, xy, yy } = pair.covariance([from[0] - to[0], from[1] - to[1]]);
                for (row, column, expected) in [(0, 0, xx), (0, 1, xy), (1, 0, xy), (1, 1, yy)] {
                    let found = matrix[(2 * i + row, 2 * l + column)];
                    assert!((found - expected).abs() < 1e-11 * unit, "{i} {l}: {found} {expected}");
                }
            }
        }
    }
}

/// Everything smaller by beta is Kolmogorov turbulence of beta^(5/3) the variance: gradients, per
/// unit of the smaller length, have beta^(5/3 - 2).
#[test]
fn a_laser_guide_star_sees_the_same_turbulence_scaled() {
    let beta = 0.75f64;
    let subapertures = Squares::subapertures(&Mask::circle(8).unwrap());
    let lgs = subapertures.lgs(beta);
    let difference =
        matrix(&lgs, &lgs) * beta.powf(1.0 / 3.0) - matrix(&subapertures, &subapertures);
    assert!(difference.amax() < 1e-10, "{}", difference.amax());
}

/// K(x, y) against quadrature, on both sides of |x| = |y|.
#[test]
fn the_line_integral_is_one() {
    let (integral, rule) = (LineIntegral::new(), GaussLegendre::new(60));
    for (x, y) in [(1.0f64, 0.5f64), (0.5, 1.0), (1.0, 1.0), (-0.3, -0.9), (0.8, -0.1), (2.0, 1e-3)]
    {
        let expected: f64 = rule
            .nodes()
            .iter()
            .map(|(t, w)| w * y * (x * x + (t * y).powi(2)).powf(5.0 / 6.0))
            .sum();
        let (found, r53) = integral.at(x, y);
        assert!((found / expected - 1.0).abs() < 1e-13, "{x} {y}: {found} {expected}");
        assert!((r53 / f64::hypot(x, y).powf(5.0 / 3.0) - 1.0).abs() < 1e-14, "{x} {y}");
    }
    // On the axes it is elementary.
    assert_eq!(integral.at(0.7, 0.0).0, 0.0);
    assert!((integral.at(0.0, -0.7).0 + 0.375 * 0.7f64.powf(8.0 / 3.0)).abs() < 1e-15);
    assert_eq!(integral.at(0.0, 0.0), (0.0, 0.0));
}

/// The gradient of x^3 y averaged over a square about (p, q) is (3 p^2 q + s^2 q / 4, p^3 + s^2 p / 4).
#[test]
fn mean_gradients_of_polynomials_are_exact() {
    let squares = Squares::subapertures(&Mask::circle(5).unwrap()).splash(0.8);
    let rule = GaussLegendre::new(3);
    let means = mean_gradients(&squares, 1, &rule, |[x, y], out| out[0] = x * x * x * y);
    let s2 = squares.side().powi(2);
    for index in 0..squares.count() {
        let [p, q] = squares.centre(index);
        let expected = [3.0 * p * p * q + s2 * q / 4.0, p * p * p + s2 * p / 4.0];
        for (axis, expected) in expected.into_iter().enumerate() {
            assert!((means[(2 * index + axis, 0)] - expected).abs() < 1e-14, "{index} {axis}");
        }
    }
}
