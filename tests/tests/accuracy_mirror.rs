//! Segments and actuators against what three actuators with limits can do, in f64.
//!
//! The pupil is a checkerboard: no subaperture has a neighbour, so that the solver's pistons are
//! zero and a segment's target is known: its command, and the plane of the global tilt.

use splash_firmware::actuators::Law;
use splash_firmware::config::Config;
use splash_firmware::fixed::TILT_LIMIT;
use splash_firmware::geometry::Mask;
use splash_firmware::pipeline::{GlobalTilt, Pipeline, Report};
use splash_firmware::segments::Position;
use splash_firmware::slopes::MeanSlope;
use splash_firmware::spec::triangle;
use splash_tests::frames::{self, Rng};
use splash_tests::instrument::{Instrument, STROKE_LSB, ULP_PER_LSB, Values, step};
use splash_tests::largest;
use splash_tests::twin::mirror::{Place, Segment};
use splash_tests::twin::pixels::Numbers;

/// 8 x 8 cells with windows of 4 x 4 pixels.
type Bank = Config<64, { 64 * 16 }, 0>;
type Path = Pipeline<64, 0>;

/// Largest piston of a target, ulp.
const PISTON: f64 = 67_108_864.0;
/// Room below which a tilt counts as out of reach, ulp: tilts are compared in quarters of an LSB,
/// 128 ulp, rounded to the safe side on both ends.
const STEP: f64 = 260.0;

fn checkerboard() -> Mask {
    Mask::from_fn(8, |x, y| (x + y) % 2 == 0).expect("a mask")
}

/// No control law: commands are the slopes of the frame, up to half a stroke over a segment.
fn instrument(rng: &mut Rng) -> Instrument {
    let mut instrument = Instrument::ideal(checkerboard(), 4);
    instrument.mean = MeanSlope::Keep;
    let gain = f64::powi(10.0, rng.between(-8, -6)) * rng.uniform(0.5, 4.0);
    instrument.slope_gain_m_per_px = Values::Uniform([[gain, 0.0], [0.0, gain]]);
    instrument
}

/// Segments that all differ: matrices within their ranges, flats, limits from 5 % of the stroke,
/// responses of either direction.
fn uneven(rng: &mut Rng) -> Instrument {
    let mut instrument = instrument(rng);
    let (count, stroke) = (instrument.count(), instrument.stroke_m);
    instrument.law = if rng.below(2) == 0 { Law::Linear } else { Law::Quadratic };
    instrument.dac_bits = rng.between(8, 16) as u8;
    let plane = |rng: &mut Rng| loop {
        let tilt = |rng: &mut Rng| rng.uniform(-1.5, 1.5);
        let row = |rng: &mut Rng| [rng.uniform(0.5, 2.0), tilt(rng), tilt(rng)];
        let rows = [row(rng), row(rng), row(rng)];
        let [[a, b, c], [d, e, f], [g, h, i]] = rows;
        let determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
        if determinant.abs() > 0.2 {
            break rows;
        }
    };
    let triangle = triangle(0.6);
    let plain = rng.below(3) == 0;
    let matrices = (0..count).map(|_| if plain { triangle } else { plane(rng) }).collect();
    instrument.matrix = Values::Each(matrices);
    let range = |rng: &mut Rng| {
        let low = rng.uniform(0.0, 0.45);
        [low, rng.uniform(low + 0.05, 1.0)].map(|part| part * stroke)
    };
    let limits: Vec<[[f64; 2]; 3]> =
        (0..count).map(|_| [range(rng), range(rng), range(rng)]).collect();
    let mut flat = |[low, high]: [f64; 2]| low + (high - low) * rng.uniform(0.1, 0.9);
    instrument.flat_m = Values::Each(limits.iter().map(|l| l.map(&mut flat)).collect());
    let mut reach = |[low, high]: [f64; 2]| {
        let ends = [low - rng.uniform(0.0, 0.2) * stroke, high + rng.uniform(0.2, 0.4) * stroke];
        if rng.below(2) == 0 { ends } else { [ends[1], ends[0]] }
    };
    instrument.response_m = Values::Each(limits.iter().map(|l| l.map(&mut reach)).collect());
    instrument.limits_m = Values::Each(limits);
    instrument
}

/// A mirror, its models and where its segments are.
struct Mirror {
    instrument: Instrument,
    config: Box<Bank>,
    path: Box<Path>,
    frame: u32,
    stored: Vec<Segment>,
    exact: Vec<Segment>,
    places: Vec<Place>,
}

/// One segment's step.
struct Move {
    from: Place,
    target: Place,
    to: Place,
    codes: [u16; 3],
}

impl Mirror {
    fn new(instrument: Instrument) -> Self {
        let segments = |numbers| {
            (0..instrument.count()).map(|i| Segment::new(&instrument, i, numbers)).collect()
        };
        let config: Box<Bank> = instrument.config();
        let mut path = Box::new(Path::new());
        path.reset(&config);
        Self {
            stored: segments(Numbers::Stored),
            exact: segments(Numbers::Physical),
            places: vec![[0.0; 3]; instrument.count()],
            frame: 0,
            config,
            path,
            instrument,
        }
    }

    /// One frame: random commands, half of them forgotten, and a global tilt.
    fn step(&mut self, global: [i32; 2], rng: &mut Rng) -> (Report, Vec<Move>) {
        let centroid = |_| Some([0; 2].map(|_: i32| rng.between(-3 << 15, 3 << 15)));
        let centroids: Vec<_> = (0..self.instrument.count()).map(centroid).collect();
        let frame = frames::steered(&self.instrument, centroids, 60_000);
        self.path.set_global_tilt(GlobalTilt { tilt_ulp: global, frame: self.frame });
        let report = step(&mut self.path, &self.config, self.frame, &frame);
        self.frame += 1;
        let limit = f64::from(TILT_LIMIT);
        let state = self.path.commands().iter().zip(self.path.positions()).zip(self.path.codes());
        let cells = self.instrument.mask.cells();
        let mut moves = Vec::new();
        for (((command, position), codes), ((x, y), place)) in
            state.zip(cells.zip(&mut self.places))
        {
            let [tip, tilt] = [0, 1].map(|axis| {
                (f64::from(command[axis]) + f64::from(global[axis])).clamp(-limit, limit)
            });
            // A tilt rises by twice its centre-to-edge path from one segment to the next.
            let [x, y] = [x, y].map(|i| 2.0 * i as f64 - 7.0);
            let plane = f64::from(global[0]) * x + f64::from(global[1]) * y;
            let target = [plane.clamp(-PISTON, PISTON), tip, tilt];
            let to = at(position);
            moves.push(Move { from: *place, target, to, codes: *codes });
            *place = to;
        }
        (report, moves)
    }
}

fn at(position: &Position) -> Place {
    let [tip, tilt] = position.tilt_ulp;
    [position.piston_ulp, tip, tilt].map(f64::from)
}

/// Global tilts of every size, largest included.
fn global(rng: &mut Rng) -> [i32; 2] {
    let size = 1 << rng.between(8, 23);
    match rng.below(4) {
        0 => [0; 2],
        1 => [0; 2].map(|_: i32| size * (2 * rng.between(0, 1) - 1)),
        _ => [0; 2].map(|_: i32| rng.between(-size, size)),
    }
}

/// Heights that a segment's codes give are within its actuators' limits to what codes are rounded by, and codes
/// are within their DAC.
#[test]
fn heights_stay_within_limits() {
    let mut rng = Rng::new(51);
    for _ in 0..60 {
        let mut mirror = Mirror::new(uneven(&mut rng));
        for _ in 0..25 {
            let (_, moves) = mirror.step(global(&mut rng), &mut rng);
            for (m, segment) in moves.iter().zip(&mirror.exact) {
                for (actuator, &code) in m.codes.iter().enumerate() {
                    assert!(f64::from(code) <= segment.top_code());
                    let [low, high] = segment.limits[actuator];
                    // The codes of the limits, in either direction of the response.
                    let ends = [low, high].map(|height| segment.code(actuator, height));
                    let [least, most] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
                    // What codes are rounded by, and the response's own rounding.
                    let [first, last] = segment.exact_codes(code);
                    assert!(last >= least - 0.01 && first <= most + 0.01, "{code} {ends:?}");
                }
            }
        }
    }
}

/// Rounding of limits (inwards, by less than one) and of heights (down, by less than two), ulp of
/// piston, as heights of the actuator that moves most.
fn slack(segment: &Segment) -> f64 {
    3.0 * largest(segment.heights([1.0, 0.0, 0.0]))
}

/// How far what a code may stand for is from the law's for a height, which is rounded down by less than
/// two ulp of piston: near code 0 of a quadratic drive half an ulp is several codes.
fn code_error(segment: &Segment, actuator: usize, height: f64, code: u16) -> f64 {
    let [low, high] = segment.limits[actuator];
    let rounding = 2.0 * segment.heights([1.0, 0.0, 0.0])[actuator];
    let ends = [-rounding, 0.0].map(|ulp| segment.code(actuator, (height + ulp).clamp(low, high)));
    let [first, last] = segment.exact_codes(code);
    f64::max(ends[0].min(ends[1]) - last, first - ends[0].max(ends[1]))
}

/// The codes are those of the position that is reported, by the law of the drive.
#[test]
fn codes_follow_the_law() {
    let mut rng = Rng::new(52);
    let (mut worst, mut beyond, mut count) = (0.0f64, 0.0f64, 0);
    for _ in 0..80 {
        let mut mirror = Mirror::new(uneven(&mut rng));
        for _ in 0..20 {
            let (_, moves) = mirror.step(global(&mut rng), &mut rng);
            for (m, segment) in moves.iter().zip(&mirror.stored) {
                let heights = segment.heights(m.to).into_iter().zip(segment.limits);
                for (actuator, (height, [low, high])) in heights.enumerate() {
                    // Rounding may take a position a little past a limit; never a code.
                    let past = f64::max(low - height, height - high);
                    assert!(past <= slack(segment), "{height} {low} {high}");
                    beyond = beyond.max(past);
                    let error = code_error(segment, actuator, height, m.codes[actuator]);
                    worst = worst.max(error);
                    count += 1;
                    assert!(error <= 0.05, "{error}");
                }
            }
        }
    }
    println!("codes: largest error {worst:.3} of {count}; positions {beyond:.0} ulp past a limit");
}

/// Height from zero to full in every eighth of the stroke and of either direction: the line from
/// height to code starts outside the DAC's range for most of them.
#[test]
fn responses_need_not_start_at_zero() {
    let mut rng = Rng::new(57);
    for law in [Law::Linear, Law::Quadratic] {
        for eighths in (0..8).flat_map(|zero| (0..=8).map(move |full| [zero, full])) {
            let mut instrument = instrument(&mut rng);
            let ends = eighths.map(|end| f64::from(end) / 8.0 * instrument.stroke_m);
            let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
            if high - low < instrument.stroke_m / 4.0 {
                continue;
            }
            instrument.law = law;
            instrument.limits_m = Values::Uniform([[low, high]; 3]);
            instrument.flat_m = Values::Uniform([(low + high) / 2.0; 3]);
            instrument.response_m = Values::Uniform([ends; 3]);
            let mut mirror = Mirror::new(instrument);
            for _ in 0..10 {
                let (_, moves) = mirror.step(global(&mut rng), &mut rng);
                for (m, segment) in moves.iter().zip(&mirror.stored) {
                    for (actuator, height) in segment.heights(m.to).into_iter().enumerate() {
                        let error = code_error(segment, actuator, height, m.codes[actuator]);
                        assert!(error <= 0.05, "{law:?} {eighths:?}: {error}");
                    }
                }
            }
        }
    }
}

/// Tip and tilt are kept exactly when some piston makes them reachable, and the piston is then
/// the nearest to what was asked for; otherwise both shrink by the largest factor that is
/// feasible.
#[test]
fn tip_and_tilt_have_priority() {
    let mut rng = Rng::new(53);
    let (mut kept, mut moved, mut shrunk, mut worst) = (0, 0, 0, 0.0f64);
    for _ in 0..100 {
        let mut mirror = Mirror::new(uneven(&mut rng));
        for _ in 0..25 {
            let (_, moves) = mirror.step(global(&mut rng), &mut rng);
            for (m, segment) in moves.iter().zip(&mirror.stored) {
                let (target, to) = ([m.target[1], m.target[2]], [m.to[1], m.to[2]]);
                let scale = segment.scale(target);
                if to == target {
                    // Less what rounding takes.
                    assert!(segment.room(target) >= -2.0 * slack(segment));
                    kept += 1;
                } else {
                    assert!(
                        segment.room(target) < STEP + slack(segment),
                        "out of reach: {}",
                        segment.room(target)
                    );
                    let longer = usize::from(target[0].abs() < target[1].abs());
                    let found = to[longer] / target[longer];
                    let error = (found - scale).abs();
                    worst = worst.max(error);
                    assert!(error <= 1e-3, "{found} of {scale}");
                    // One factor for both, rounded towards zero.
                    let other = target[1 - longer] * found;
                    assert!((to[1 - longer] - other).abs() <= 2.0);
                    shrunk += 1;
                }
                let [low, high] = segment.pistons(to);
                let nearest = m.target[0].min(high).max(low.min(high));
                moved += u32::from(nearest != m.target[0]);
                let error = (m.to[0] - nearest).abs();
                assert!(error <= 2.0 * slack(segment), "{} {nearest} in {low} {high}", m.to[0]);
            }
        }
    }
    println!("kept {kept}, piston moved {moved}, shrunk {shrunk}; scale within {worst:.1e}");
    assert!(kept > 5000 && moved > 5000 && shrunk > 5000);
}

/// Actuators beyond their limits are counted as the command asks for them.
#[test]
fn saturated_actuators_are_counted() {
    let mut rng = Rng::new(54);
    let mut total = 0;
    for _ in 0..60 {
        let mut mirror = Mirror::new(uneven(&mut rng));
        for _ in 0..25 {
            let (report, moves) = mirror.step(global(&mut rng), &mut rng);
            let [mut least, mut most] = [0, 0];
            for (m, segment) in moves.iter().zip(&mirror.stored) {
                for (height, [low, high]) in
                    segment.heights(m.target).into_iter().zip(segment.limits)
                {
                    let past = f64::max(low - height, height - high);
                    // Height and limit are rounded before they are compared.
                    least += u16::from(past > slack(segment));
                    most += u16::from(past > -slack(segment));
                }
            }
            let counted = report.saturated_actuators;
            assert!((least..=most).contains(&counted), "{counted} not in {least}..={most}");
            assert_eq!(report.slewed_actuators, 0);
            total += u32::from(counted);
        }
        assert_eq!(mirror.path.totals().saturated_actuators, total);
        total = 0;
    }
}

/// With a slew limit, segments go straight towards what they reach, as fast as it allows.
#[test]
fn slew_limit_bounds_every_actuator() {
    let mut rng = Rng::new(55);
    let (mut limited, mut free, mut slowest) = (0, 0, 1.0f64);
    for _ in 0..60 {
        // Targets that are within reach, so that only the slew limit acts.
        let mut instrument = instrument(&mut rng);
        instrument.slope_gain_m_per_px = Values::Uniform([[2e-7, 0.0], [0.0, 2e-7]]);
        instrument.control_gain = Values::Uniform(1.0);
        let lsb_m = instrument.stroke_m / STROKE_LSB;
        let slew_lsb = rng.uniform(0.0, 12.0).exp2();
        instrument.slew_m_per_frame = Some(slew_lsb * lsb_m);
        let slew = slew_lsb * ULP_PER_LSB;
        let mut mirror = Mirror::new(instrument);
        for _ in 0..40 {
            let size = 1 << rng.between(8, 19);
            let global = [0; 2].map(|_: i32| rng.between(-size, size));
            let (report, moves) = mirror.step(global, &mut rng);
            let [mut least, mut most] = [0, 0];
            for (m, segment) in moves.iter().zip(&mirror.stored) {
                let way = [0, 1, 2].map(|k| m.target[k] - m.from[k]);
                let gone = [0, 1, 2].map(|k| m.to[k] - m.from[k]);
                let heights = segment.heights(m.target).into_iter().zip(segment.limits);
                if heights.clone().any(|(h, [low, high])| h < low + STEP || h > high - STEP) {
                    // Out of reach after all: where the segment goes is another test's business.
                    least = 0;
                    most = u16::MAX;
                    assert!(largest(segment.heights(gone)) <= slew + 2.0);
                    continue;
                }
                let asked = segment.heights(way);
                least += asked.iter().filter(|s| s.abs() > slew + 2.0).count() as u16;
                most = most
                    .saturating_add(asked.iter().filter(|s| s.abs() > slew - 2.0).count() as u16);
                let (longest, moved) = (largest(asked), largest(segment.heights(gone)));
                assert!(moved <= slew + 1.0, "{moved} of {slew}");
                if longest <= slew - 2.0 {
                    assert_eq!(m.to, m.target);
                    free += 1;
                    continue;
                }
                limited += 1;
                // Fractions of the way count in 2^-16, from quarters of an LSB: what that costs.
                let least_move = slew - 256.0 - longest / 65536.0 - 2.0;
                assert!(moved >= least_move, "{moved} of {slew}, way {longest}");
                slowest = slowest.min(moved / slew.min(longest));
                let part = gone.iter().zip(way).map(|(g, w)| g * w).sum::<f64>()
                    / way.iter().map(|w| w * w).sum::<f64>();
                let aside = largest(gone.iter().zip(way).map(|(g, w)| g - part * w));
                assert!(aside <= 2.0, "{aside} ulp off the straight line");
            }
            assert!((least..=most).contains(&report.slewed_actuators));
        }
    }
    println!("slew: {limited} limited, {free} free; slowest {slowest:.3} of what is allowed");
    assert!(limited > 5000 && free > 5000);
}

/// The slowest mirror that can be configured, one LSB a frame, arrives: from the far end of its
/// stroke it never stands still, and over 200 LSB it takes at most 400 frames.
#[test]
fn the_slowest_slew_arrives() {
    let mut rng = Rng::new(56);
    let mut instrument = instrument(&mut rng);
    instrument.slope_gain_m_per_px = Values::Uniform([[1e-12, 0.0], [0.0, 1e-12]]);
    instrument.slew_m_per_frame = Some(1.0001 * instrument.stroke_m / STROKE_LSB);
    let mut mirror = Mirror::new(instrument);
    let asked = [13_000, 1_000];
    for _ in 0..400 {
        mirror.step(asked, &mut rng);
    }
    for (m, segment) in mirror.step(asked, &mut rng).1.iter().zip(&mirror.stored) {
        let way = [0, 1, 2].map(|k| m.target[k] - m.from[k]);
        assert!(largest(segment.heights(way)) <= ULP_PER_LSB, "{way:?}");
        assert_eq!(m.to, m.target);
    }
    // Two opposite corners of the mirror, most of a stroke apart.
    for sign in [1, -1] {
        let far = [sign * 1_100_000, sign * 1_100_000];
        for _ in 0..20 {
            let (_, moves) = mirror.step(far, &mut rng);
            for (m, segment) in moves.iter().zip(&mirror.stored) {
                let gone = [0, 1, 2].map(|k| m.to[k] - m.from[k]);
                let way = [0, 1, 2].map(|k| m.target[k] - m.from[k]);
                if largest(way) > 2.0 * ULP_PER_LSB {
                    let moved = largest(segment.heights(gone));
                    assert!(moved >= 0.4 * ULP_PER_LSB, "{moved} ulp of {way:?}");
                }
            }
        }
    }
}

/// Limits and slew together, with segments of every kind: no actuator moves faster, and none
/// leaves its range.
#[test]
fn limits_hold_on_the_way() {
    let mut rng = Rng::new(58);
    for _ in 0..60 {
        let mut instrument = uneven(&mut rng);
        let slew = rng.uniform(0.0, 14.0).exp2();
        instrument.slew_m_per_frame = Some(slew * instrument.stroke_m / STROKE_LSB);
        let mut mirror = Mirror::new(instrument);
        for _ in 0..40 {
            let (_, moves) = mirror.step(global(&mut rng), &mut rng);
            for (m, segment) in moves.iter().zip(&mirror.stored) {
                let gone = segment.heights([0, 1, 2].map(|k| m.to[k] - m.from[k]));
                // Three components rounded towards zero, each times up to two.
                assert!(largest(gone) <= slew * ULP_PER_LSB + 1.0, "{gone:?}");
                for (height, [low, high]) in segment.heights(m.to).into_iter().zip(segment.limits) {
                    let past = f64::max(low - height, height - high);
                    assert!(past <= 4.0 + slack(segment), "{height} {low} {high}");
                }
            }
        }
    }
}
