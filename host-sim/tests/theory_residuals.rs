//! Residuals by radial order, against an independent integral over spatial frequencies and against
//! what must hold whatever their values.

use host_sim::theory::covariance::matrix;
use host_sim::theory::legendre::GaussLegendre;
use host_sim::theory::mean_gradient::mean_gradients;
use host_sim::theory::noll;
use host_sim::theory::phase_covariance::PhaseCovariance;
use host_sim::theory::reconstructor::{Degenerate, gradients, invert};
use host_sim::theory::residuals::EDGE_POINTS;
use host_sim::theory::squares::Squares;
use host_sim::theory::{Layer, PupilRule, Reconstruction, Residuals, Theory, default_order};
use nalgebra::{Complex, DMatrix, DVector};
use splash_firmware::geometry::Mask;
use std::f64::consts::PI;

fn residuals(mask: &Mask, order: usize, layers: &[(f64, f64)], by: Reconstruction) -> Residuals {
    let layers: Vec<_> = layers.iter().map(|&(weight, beta)| Layer { weight, beta }).collect();
    Theory::new(mask, order, &layers, by).unwrap().residuals(&mut || ())
}

fn circle(across: usize, beta: f64) -> Residuals {
    let mask = Mask::circle(across).unwrap();
    residuals(&mask, default_order(across), &[(1.0, beta)], Reconstruction::Mixed)
}

/// All lists of a result by name.
fn lists(r: &Residuals) -> [(&'static str, &[f64]); 9] {
    [
        ("splash sensed", &r.splash.sensed),
        ("splash total", &r.splash.total),
        ("splash_lever sensed", &r.splash_lever.sensed),
        ("splash_lever total", &r.splash_lever.total),
        ("lgs sensed", &r.lgs.sensed),
        ("lgs total", &r.lgs.total),
        ("lgs_lever sensed", &r.lgs_lever.sensed),
        ("lgs_lever total", &r.lgs_lever.total),
        ("ngs total", &r.ngs.total),
    ]
}

fn assert_close(found: &Residuals, expected: &Residuals, tolerance: f64) {
    assert_eq!(found.orders, expected.orders);
    for ((name, found), (_, expected)) in lists(found).into_iter().zip(lists(expected)) {
        for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
            let error = (found - expected).abs();
            assert!(error < tolerance, "{name}, order {}: {found} {expected}", index + 2);
        }
    }
}

/// Everything once more for N = 4, sharing nothing but the definitions: each estimate is a filter
/// F_j(k) on the spatial frequencies of the phase, and <(p - q)^2> is the integral of
/// |P(k) - Q(k)|^2 over its spectrum. Zernikes are sums of factorials, the inverse is that of the
/// singular values, gradients are differences over edges.
#[test]
fn they_are_integrals_over_spatial_frequencies() {
    const ACROSS: usize = 4;
    const ORDER: usize = 4;
    let beta = 0.75;
    let pitch = 2.0 / ACROSS as f64;
    let places = [-0.75, -0.25, 0.25, 0.75];
    let centres: Vec<[f64; 2]> = places
        .iter()
        .flat_map(|&y| places.map(|x| [x, y]))
        .filter(|[x, y]| x * x + y * y <= 1.0)
        .collect();
    assert_eq!(centres.len(), 12);
    // n, m and the sign of the angular part, 0 for none, 1 for the cosine, -1 for the sine.
    let zernikes: Vec<(usize, usize, i32)> = (1..=ORDER)
        .flat_map(|n| (n % 2..=n).step_by(2).map(move |m| (n, m)))
        .flat_map(|(n, m)| if m == 0 { vec![(n, 0, 0)] } else { vec![(n, m, 1), (n, m, -1)] })
        .collect();
    let angular = |m: usize, part: i32, angle: f64| match part {
        0 => 1.0,
        1 => 2f64.sqrt() * (m as f64 * angle).cos(),
        _ => 2f64.sqrt() * (m as f64 * angle).sin(),
    };
    let factorial = |n: usize| (1..=n).map(|k| k as f64).product::<f64>();
    let zernike = |(n, m, part): (usize, usize, i32), x: f64, y: f64| {
        let r = x.hypot(y);
        let radial: f64 = (0..=(n - m) / 2)
            .map(|s| {
                let below = factorial(s) * factorial((n + m) / 2 - s) * factorial((n - m) / 2 - s);
                (-1f64).powi(s as i32) * factorial(n - s) / below * r.powi((n - 2 * s) as i32)
            })
            .sum();
        (n as f64 + 1.0).sqrt() * radial * angular(m, part, y.atan2(x))
    };
    // Simpson's rule is exact for cubics, two of them for what order 4 has along an edge.
    let simpson = |f: &dyn Fn(f64) -> f64| {
        let weights = [7.0, 32.0, 12.0, 32.0, 7.0].map(|w| w / 90.0);
        (0..5).map(|k| weights[k] * f(k as f64 / 4.0 - 0.5)).sum::<f64>()
    };
    let inverse = |side: f64| {
        let derivatives = DMatrix::from_fn(24, zernikes.len(), |row, j| {
            let ([x, y], h) = (centres[row % 12], side / 2.0);
            let z = |x: f64, y: f64| zernike(zernikes[j], x, y);
            let edge = |sign: f64| {
                if row < 12 {
                    simpson(&|u| z(x + sign * h, y + u * side))
                } else {
                    simpson(&|u| z(x + u * side, y + sign * h))
                }
            };
            (edge(1.0) - edge(-1.0)) / side
        });
        derivatives.pseudo_inverse(1e-10).unwrap().map(|value| Complex::new(value, 0.0))
    };
    let (nominal, matched) = (inverse(pitch), inverse(beta * pitch));
    let sinc = |x: f64| if x == 0.0 { 1.0 } else { x.sin() / x };
    // The transform of the mean gradients over squares of this side, centres drawn in by `shrink`.
    let transform = |k: f64, angle: f64, side: f64, shrink: f64| {
        let [kx, ky] = [k * angle.cos(), k * angle.sin()];
        let filter = sinc(kx * side / 2.0) * sinc(ky * side / 2.0);
        DVector::from_fn(24, |row, _| {
            let [x, y] = centres[row % 12];
            let component = if row < 12 { kx } else { ky };
            Complex::from_polar(component * filter, shrink * (kx * x + ky * y)) * Complex::i()
        })
    };
    let by = |splash: bool, lever: bool, total: bool| -> usize {
        1 + 4 * usize::from(total) + 2 * usize::from(!splash) + usize::from(lever)
    };
    // For each order: <a^2> and <b^2> first, then the residuals.
    let mut sums = [[0.0f64; 11]; ORDER + 1];
    let rule = GaussLegendre::new(8);
    let (end, reach) = (500.0, 2.2);
    let mut from = 0.0f64;
    while from < end {
        let to = if from == 0.0 { 0.3 } else { (from + PI / reach).min(1.6 * from) };
        let (t0, t1) = (from.cbrt(), to.cbrt());
        for &(part, weight) in rule.nodes() {
            let t = t0 + part * (t1 - t0);
            let k = t * t * t;
            // k^(-11/3) k dk = k^(-8/3) 3 t^2 dt
            let radial = weight * (t1 - t0) * 3.0 * t * t * k.powf(-8.0 / 3.0);
            // Half a turn is enough: the integrand at -k is that at k.
            let angles = (0.6 * k * reach) as usize + 30;
            for step in 0..angles {
                let angle = PI * (step as f64 + 0.3) / angles as f64;
                let true_gradients = transform(k, angle, pitch, 1.0);
                let splash = transform(k, angle, beta * pitch, 1.0);
                let lgs = transform(k, angle, beta * pitch, beta);
                let b = &nominal * true_gradients;
                let estimates = [
                    &matched * &splash,
                    (&nominal * &splash) * Complex::new(beta, 0.0),
                    &nominal * &lgs,
                    (&nominal * &lgs) * Complex::new(beta, 0.0),
                ];
                let scale = radial / angles as f64;
                for (j, &(n, m, part)) in zernikes.iter().enumerate() {
                    // The transform of Z_j over the disk's area, to exp(i k x).
                    let size = 2.0 * (n as f64 + 1.0).sqrt() * libm::jn(n as i32 + 1, k) / k
                        * (-1f64).powi(((n - m) / 2) as i32)
                        * angular(m, part, angle);
                    let a = Complex::i().powi(m as i32) * size;
                    let sums = &mut sums[n];
                    sums[0] += scale * a.norm_sqr();
                    sums[9] += scale * b[j].norm_sqr();
                    sums[10] += scale * (a - b[j]).norm_sqr();
                    for (index, estimate) in estimates.iter().enumerate() {
                        sums[1 + index] += scale * (b[j] - estimate[j]).norm_sqr();
                        sums[5 + index] += scale * (a - estimate[j]).norm_sqr();
                    }
                }
            }
        }
        from = to;
    }
    let found = circle(ACROSS, beta);
    assert_eq!(found.orders, [2, 3, 4]);
    for (index, sums) in sums[2..].iter().enumerate() {
        for (name, list, place) in [
            ("splash sensed", &found.splash.sensed, by(true, false, false)),
            ("splash total", &found.splash.total, by(true, false, true)),
            ("splash_lever sensed", &found.splash_lever.sensed, by(true, true, false)),
            ("splash_lever total", &found.splash_lever.total, by(true, true, true)),
            ("lgs sensed", &found.lgs.sensed, by(false, false, false)),
            ("lgs total", &found.lgs.total, by(false, false, true)),
            ("lgs_lever sensed", &found.lgs_lever.sensed, by(false, true, false)),
            ("lgs_lever total", &found.lgs_lever.total, by(false, true, true)),
            ("ngs total", &found.ngs.total, 10),
        ] {
            let unit = if name.ends_with("sensed") { sums[9] } else { sums[0] };
            let expected = sums[place] / unit;
            let error = (list[index] - expected).abs();
            assert!(error < 1e-5, "{name}, order {}: {} {expected}", index + 2, list[index]);
        }
    }
    // What is integrated is the spectrum whose variances Noll has.
    let found = sums[3][0] / sums[2][0];
    assert!((found / (order_variance(3) / order_variance(2)) - 1.0).abs() < 1e-6, "{found}");
}

/// <a^2> of a radial order.
fn order_variance(n: usize) -> f64 {
    (n % 2..=n).step_by(2).map(|m| if m == 0 { 1.0 } else { 2.0 } * noll::covariance(n, n, m)).sum()
}

/// At the ground all sensors see the same.
#[test]
fn at_the_ground_only_aliasing_is_left() {
    for across in [4, 7, 8, 12] {
        let found = circle(across, 1.0);
        for (name, values) in lists(&found) {
            for (value, floor) in values.iter().zip(&found.ngs.total) {
                let expected = if name.ends_with("sensed") { 0.0 } else { *floor };
                assert!((value - expected).abs() < 1e-10, "N = {across}, {name}: {value}");
            }
        }
    }
}

/// Towards the ground what is sensed wrongly vanishes, as (1 - beta) or faster.
#[test]
fn the_ground_is_approached_smoothly() {
    let mut before: Option<Residuals> = None;
    for distance in [1e-2, 1e-3, 1e-4] {
        let found = circle(8, 1.0 - distance);
        for (index, (name, values)) in lists(&found).into_iter().enumerate() {
            if !name.ends_with("sensed") {
                continue;
            }
            for (order, value) in values.iter().enumerate() {
                assert!((0.0..2.0 * distance).contains(value), "{name} at {distance}: {value}");
                if let Some(before) = &before {
                    let before = lists(before)[index].1[order];
                    assert!(*value < before / 8.0, "{name} at {distance}: {value} after {before}");
                }
            }
        }
        before = Some(found);
    }
}

/// Turning the pupil by 90 degrees turns modes into others of the same order.
#[test]
fn a_turned_pupil_has_the_same_residuals() {
    let across = 8;
    let mask = Mask::circle(across).unwrap().without(|x, y| y == 1 || (x == 5 && y < 4));
    let turned = Mask::from_fn(across, |x, y| mask.contains(y, across - 1 - x)).unwrap();
    assert_ne!(mask, turned);
    let of = |mask: &Mask| residuals(mask, 5, &[(1.0, 0.75)], Reconstruction::Mixed);
    assert_close(&of(&turned), &of(&mask), 1e-9);
}

/// Layers are independent, and for a given reconstructor b - b' is a sum over them: fractions are
/// means of those of each layer.
#[test]
fn layers_add_up() {
    let mask = Mask::circle(8).unwrap();
    let of = |layers: &[(f64, f64)]| residuals(&mask, 7, layers, Reconstruction::Nominal);
    let both = of(&[(3.0, 0.9), (1.0, 0.6)]);
    let (low, high) = (of(&[(1.0, 0.9)]), of(&[(1.0, 0.6)]));
    let parts = lists(&low).into_iter().zip(lists(&high));
    for ((name, both), ((_, low), (_, high))) in lists(&both).into_iter().zip(parts) {
        for (index, both) in both.iter().enumerate() {
            let expected = 0.75 * low[index] + 0.25 * high[index];
            assert!((both - expected).abs() < 1e-10, "{name}: {both} {expected}");
        }
    }
    // A layer cut in two is still itself, whatever reconstructor; one of no weight is nothing.
    for by in [Reconstruction::Mixed, Reconstruction::Matched, Reconstruction::Nominal] {
        let cut = residuals(&mask, 7, &[(0.2, 0.7), (0.0, 0.3), (0.3, 0.7)], by);
        assert_close(&cut, &residuals(&mask, 7, &[(1.0, 0.7)], by), 1e-10);
    }
}

/// The names of the reconstructors: mixed is matched without the lever arm and nominal with it;
/// guide stars have the nominal one always.
#[test]
fn reconstructors_are_what_they_are_called() {
    let mask = Mask::circle(8).unwrap();
    let of = |by| residuals(&mask, 7, &[(1.0, 0.75)], by);
    let [mixed, matched, nominal] =
        [Reconstruction::Mixed, Reconstruction::Matched, Reconstruction::Nominal].map(of);
    assert_eq!(mixed.splash, matched.splash);
    assert_eq!(mixed.splash_lever, nominal.splash_lever);
    assert_ne!(mixed.splash, nominal.splash);
    assert_ne!(mixed.splash_lever, matched.splash_lever);
    for other in [&matched, &nominal] {
        assert_eq!((&mixed.lgs, &mixed.lgs_lever), (&other.lgs, &other.lgs_lever));
        assert_eq!(mixed.ngs, other.ngs);
    }
}

/// A laser guide star's coefficients are those of phi(beta x), sensed as well as a natural guide
/// star senses phi: by the triangle inequality the rms of a - b' differs from that of a continuous
/// sensor (see `theory_zernike.rs`) by at most beta^(5/6) times the rms of the floor. And many
/// subapertures approach it.
#[test]
fn a_laser_guide_star_approaches_the_continuous_one() {
    let continuous = [
        0.16589089, 0.29248304, 0.4292114, 0.56769102, 0.70186227, 0.82769144, 0.94277905,
        1.0459697, 1.1370071,
    ];
    let beta = 0.75f64;
    for across in [8, 12, 16, 24] {
        let found = circle(across, beta);
        for (index, (total, floor)) in
            found.lgs_lever.total.iter().zip(&found.ngs.total).enumerate()
        {
            let Some(continuous) = continuous.get(index).copied() else { break };
            let continuous: f64 = continuous;
            let apart = beta.powf(5.0 / 6.0) * floor.sqrt();
            let (least, most) = (continuous.sqrt() - apart, continuous.sqrt() + apart);
            let rms = total.sqrt();
            assert!((least..=most).contains(&rms), "N = {across}, order {}: {total}", index + 2);
        }
    }
    let found = circle(32, beta).lgs_lever.total;
    for (found, continuous) in found.iter().zip(continuous).take(3) {
        assert!((found / continuous - 1.0).abs() < 0.03, "{found} {continuous}");
    }
}

/// Quadrature is left only in <a g>, along edges and in the sums over orders: with twice the
/// points and terms, <a b> moves by less than 1e-9 of <a^2>.
#[test]
fn finer_quadrature_changes_nothing() {
    for across in [4, 8, 16] {
        let order = default_order(across);
        let subapertures = Squares::subapertures(&Mask::circle(across).unwrap());
        let inverse =
            |squares: Squares| invert(&gradients(&[(1.0, squares)], order), order).unwrap();
        let nominal = inverse(subapertures.clone());
        for squares in [subapertures.clone(), subapertures.splash(0.75), subapertures.lgs(0.75)] {
            let cross = |points: usize, beyond: usize| {
                let covariance = PhaseCovariance::with_terms(order, beyond);
                let rule = GaussLegendre::new(points);
                let count = covariance.modes().len();
                let with_gradients = mean_gradients(&squares, count, &rule, |point, out| {
                    covariance.values(point, out);
                });
                (&nominal * with_gradients).diagonal()
            };
            let change = cross(EDGE_POINTS, 60) - cross(2 * EDGE_POINTS, 120);
            let covariance = PhaseCovariance::new(order);
            for (mode, change) in covariance.modes().iter().zip(&change) {
                let own = noll::covariance(mode.radial, mode.radial, mode.azimuthal);
                assert!(change.abs() < 1e-9 * own, "N = {across}, {mode:?}: {change} of {own}");
            }
        }
    }
}

/// <b^2> of a natural guide star is that of its gradients: positive, and its matrix symmetric.
#[test]
fn covariance_matrices_are_positive() {
    let squares = Squares::subapertures(&Mask::circle(6).unwrap()).splash(0.75);
    let matrix = matrix(&squares, &squares);
    assert!((&matrix - matrix.transpose()).amax() < 1e-10);
    assert!(matrix.symmetric_eigenvalues().min() > 0.0);
}

/// 7, 10 and 13; less than 3/4 of any order is left to a natural guide star, and two orders more
/// leave more than all of one or cannot be fitted.
#[test]
fn the_default_order_suits_the_subapertures() {
    assert_eq!([8, 12, 16].map(default_order), [7, 10, 13]);
    for across in [4, 5, 7, 8, 9, 11, 12, 13, 16, 20, 21] {
        let mask = Mask::circle(across).unwrap();
        let floor = |order: usize| {
            let layers = [Layer { weight: 1.0, beta: 1.0 }];
            let theory = Theory::new(&mask, order, &layers, Reconstruction::Nominal).ok()?;
            theory.residuals(&mut || ()).ngs.total.into_iter().reduce(f64::max)
        };
        let order = default_order(across);
        assert!(floor(order).unwrap() < 0.75, "N = {across}");
        assert!(floor(order + 2).is_none_or(|floor| floor > 1.0), "N = {across}");
    }
}

/// Subapertures tell N orders apart and no more.
#[test]
fn orders_that_cannot_be_told_apart_are_refused() {
    let layers = [Layer { weight: 1.0, beta: 0.75 }];
    for across in [4, 7, 8, 12] {
        let mask = Mask::circle(across).unwrap();
        let new = |order| Theory::new(&mask, order, &layers, Reconstruction::Mixed);
        assert!(new(across).is_ok(), "N = {across}");
        for order in [across + 1, across + 4, 40] {
            assert_eq!(new(order).unwrap_err(), Degenerate { highest: across }, "N = {across}");
        }
    }
}

#[test]
fn pupil_rules_select_the_subapertures() {
    let count = |rule: PupilRule, across| rule.mask(across, 0.3).unwrap().count();
    for (rule, counts) in [
        (PupilRule::Circle, [52, 112, 208]),
        (PupilRule::Inside, [32, 88, 164]),
        (PupilRule::Touching, [60, 132, 224]),
        (PupilRule::Square, [64, 144, 256]),
    ] {
        assert_eq!([8, 12, 16].map(|across| count(rule, across)), counts, "{rule:?}");
    }
    // Of N = 8 the four in the middle are 0.18 of the radius from the centre, the next 0.4.
    assert_eq!(count(PupilRule::Annulus, 8), 52 - 4);
    assert!(PupilRule::Circle.mask(41, 0.0).is_err());
}
