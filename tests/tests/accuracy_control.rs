//! The control law in closed loop, against the integrator's equations in f64.

use splash_firmware::config::Config;
use splash_firmware::fixed::TILT_LIMIT;
use splash_firmware::geometry::Mask;
use splash_firmware::pipeline::{Pipeline, Report};
use splash_firmware::slopes::MeanSlope;
use splash_firmware::spec::SorSpec;
use splash_tests::frames::{self, Rng};
use splash_tests::instrument::{Instrument, Values, step};
use splash_tests::twin::control::Integrator;
use splash_tests::twin::pixels::Numbers;
use splash_tests::with_big_stack;

/// Up to 8 x 8 subapertures with windows of 4 x 4 pixels.
type Bank = Config<64, { 64 * 16 }, 0>;
type Path = Pipeline<64, 0>;

/// Light in a window: centroids are within 3 / 60000 px of what is asked for.
const FLUX: u16 = 60_000;
/// Error of a command's step: up to 1 for its two products, and sixteenths of x for the mean over neighbours (up
/// to 1) and over all (1/2), which counts up to 0.9 x 1.13 times.
const ROUNDING_ULP: f64 = 1.0 + 1.5 / 16.0 * 0.9 * 1.13;
/// Error of a slope asked for, ulp: three parts of 60000 of the gain per pixel, and its rounding.
const SLOPE_ULP: f64 = 32.0;

/// Windows of 4 x 4 pixels, half a micrometre per pixel, few sweeps: pistons are not of interest.
fn instrument(mask: Mask) -> Instrument {
    let mut instrument = Instrument::ideal(mask, 4);
    instrument.sor = SorSpec { sweeps: Some(1), cold_sweeps: Some(1), ..SorSpec::default() };
    instrument
}

/// A mirror and the wavefront before it: what the sensor sees is their difference, exposed while
/// the mirror showed the commands of 1 + L frames ago.
struct Loop {
    instrument: Instrument,
    config: Box<Bank>,
    path: Box<Path>,
    frame: u32,
    /// What the mirror showed after each frame.
    shown: Vec<Vec<[f64; 2]>>,
    ulp_per_px: f64,
}

impl Loop {
    fn new(instrument: Instrument) -> Self {
        let config: Box<Bank> = instrument.config();
        let gain = instrument.slope_gain_m_per_px.at(0)[0][0];
        Self {
            ulp_per_px: gain / instrument.ulp_m(),
            shown: vec![vec![[0.0; 2]; instrument.count()]; 1],
            path: Box::new(Path::new()),
            config,
            frame: 0,
            instrument,
        }
    }

    /// What the mirror shows while the next frame is exposed.
    fn exposed(&self) -> &[[f64; 2]] {
        let ago = usize::from(self.instrument.delay_frames) + 1;
        &self.shown[self.shown.len().saturating_sub(ago)]
    }

    /// One frame of a wavefront, ulp; dark where there is `None`.
    fn frame(&mut self, wavefront: &[Option<[f64; 2]>]) -> Report {
        let seen = |(w, m): (&Option<[f64; 2]>, &[f64; 2])| {
            w.map(|w| {
                [0, 1].map(|axis| ((w[axis] - m[axis]) / self.ulp_per_px * 65536.0).round() as i32)
            })
        };
        let centroids: Vec<_> = wavefront.iter().zip(self.exposed()).map(seen).collect();
        let frame = frames::steered(&self.instrument, centroids, FLUX);
        let report = step(&mut self.path, &self.config, self.frame, &frame);
        self.frame += 1;
        let tilts = self.path.positions().iter().map(|p| p.tilt_ulp.map(f64::from));
        self.shown.push(tilts.collect());
        report
    }

    /// The slopes as they were measured.
    fn slopes(&self) -> Vec<Option<[f64; 2]>> {
        let slopes = self.path.slopes().iter();
        slopes.map(|s| s.valid.then(|| s.tilt_ulp.map(f64::from))).collect()
    }

    fn commands(&self) -> Vec<[f64; 2]> {
        self.path.commands().iter().map(|c| c.map(f64::from)).collect()
    }

    /// Largest difference between the commands and others, ulp.
    fn distance(&self, others: &[[f64; 2]]) -> f64 {
        let commands = self.commands();
        let pairs = commands.as_flattened().iter().zip(others.as_flattened());
        splash_tests::largest(pairs.map(|(a, b)| a - b))
    }
}

fn circle(across: usize) -> Mask {
    Mask::circle(across).expect("4 to 8")
}

/// A wavefront of tilts within `size` ulp, without a mean.
fn tilts(count: usize, size: f64, rng: &mut Rng) -> Vec<Option<[f64; 2]>> {
    let mut tilts: Vec<_> = (0..count).map(|_| [0; 2].map(|_| rng.uniform(-size, size))).collect();
    for axis in 0..2 {
        let mean = tilts.iter().map(|t| t[axis]).sum::<f64>() / count as f64;
        tilts.iter_mut().for_each(|t| t[axis] -= mean);
    }
    tilts.into_iter().map(Some).collect()
}

/// The integrator of the measured slopes and of what the mirror showed, over 500 frames of a
/// changing wavefront with subapertures that come and go, some of them in groups.
///
/// The model has its own state: what it differs by is rounding, summed over the memory 1/g of the law.
#[test]
fn commands_follow_the_integrator() {
    for (case, mean) in [MeanSlope::Remove, MeanSlope::Keep, MeanSlope::Remove].iter().enumerate() {
        let mut rng = Rng::new(40 + case as u64);
        let mut instrument = instrument(circle(8));
        instrument.mean = *mean;
        instrument.lever_arm = [1.0, 1.0, 1.13][case];
        let count = instrument.count();
        let gains = (0..count).map(|_| rng.uniform(0.3, 0.9)).collect();
        instrument.control_gain = Values::Each(gains);
        let mut model = Integrator::new(&instrument, Numbers::Stored);
        let mut real = Integrator::new(&instrument, Numbers::Physical);
        let mut system = Loop::new(instrument);
        let mut wavefront = tilts(count, 300_000.0, &mut rng);
        let mut worst = [0.0f64; 2];
        for frame in 0..500 {
            let next = tilts(count, 300_000.0, &mut rng);
            for (w, next) in wavefront.iter_mut().flatten().zip(next.iter().flatten()) {
                *w = [0, 1].map(|axis| 0.95 * w[axis] + 0.2 * next[axis]);
            }
            // From frame 100 on one in ten is dark; then for a while a whole half.
            let mut seen = wavefront.clone();
            if frame >= 100 {
                seen.iter_mut().filter(|_| rng.below(10) == 0).for_each(|s| *s = None);
            }
            if (200..260).contains(&frame) {
                seen.iter_mut().take(count / 2).for_each(|s| *s = None);
            }
            let applied = system.exposed().to_vec();
            system.frame(&seen);
            let slopes = system.slopes();
            assert!(slopes.iter().zip(&seen).all(|(a, b)| a.is_some() == b.is_some()));
            model.update(&slopes, &applied);
            real.update(&slopes, &applied);
            worst[0] = worst[0].max(system.distance(&model.command));
            worst[1] = worst[1].max(system.distance(&real.command));
        }
        println!("{mean:?}: {:.1} ulp, from unquantised gains {:.1} ulp", worst[0], worst[1]);
        assert!(worst[0] <= ROUNDING_ULP / 0.3, "{worst:?}");
        // 13-bit gains: half a part in 2^13 of what is up to 2^19, over the same memory.
        assert!(worst[1] <= f64::from(1 << 19) / f64::from(1 << 14) / 0.3, "{worst:?}");
    }
}

/// A whole f64 loop, sensor and mirror included, beside the firmware's: nothing of one enters the
/// other, so the sensor's rounding is part of the difference.
#[test]
fn closed_loop_follows_its_model() {
    let mut rng = Rng::new(43);
    let mut instrument = instrument(circle(8));
    instrument.lever_arm = 1.1;
    let count = instrument.count();
    let mut model = Integrator::new(&instrument, Numbers::Stored);
    let mut system = Loop::new(instrument);
    let mut worst: f64 = 0.0;
    for _ in 0..20 {
        let wavefront = tilts(count, 300_000.0, &mut rng);
        for _ in 0..20 {
            system.frame(&wavefront);
            let applied = model.command.clone();
            let slopes: Vec<_> = wavefront
                .iter()
                .zip(&applied)
                .map(|(w, a)| w.map(|w| [w[0] - a[0], w[1] - a[1]]))
                .collect();
            model.update(&slopes, &applied);
            worst = worst.max(system.distance(&model.command));
        }
    }
    println!("closed loop: {worst:.1} ulp after 400 frames");
    // c' = (1 - g) c + g f x: an error of x counts f times, summed over the memory.
    assert!(worst <= 1.1 * SLOPE_ULP + 4.0, "{worst}");
}

/// (1 - (1 - g)^k) f x after k frames of a constant x, whatever the delay.
#[test]
fn step_response_is_geometric() {
    for delay_frames in 0..=3 {
        for (g, f) in [(0.5, 1.0), (0.25, 1.0), (1.0, 1.0), (1.5, 1.0), (0.5, 1.13)] {
            let mut rng = Rng::new(44);
            let mut instrument = instrument(circle(6));
            instrument.control_gain = Values::Uniform(g);
            instrument.lever_arm = f;
            instrument.delay_frames = delay_frames;
            let count = instrument.count();
            let mut system = Loop::new(instrument);
            let wavefront = tilts(count, 250_000.0, &mut rng);
            for k in 1..=40 {
                system.frame(&wavefront);
                let part = f * (1.0 - f64::powi(1.0 - g, k));
                let expected: Vec<_> =
                    wavefront.iter().flatten().map(|w| w.map(|w| part * w)).collect();
                // The sensor's rounding, and g f as a 13-bit fraction, over the memory.
                let memory = g / (1.0 - (1.0 - g).abs());
                let allowed =
                    memory * (f * SLOPE_ULP + 2.0 / g + 250_000.0 / f64::from(1 << 14) / g);
                let error = system.distance(&expected);
                assert!(error <= allowed, "L {delay_frames}, g {g}, f {f}, frame {k}: {error}");
            }
        }
    }
}

/// With a wrong delay the sum of slope and command is not the wavefront: the response differs by
/// far more than rounding, so that the test above tells the delays apart.
#[test]
fn a_wrong_delay_shows() {
    for delay_frames in 0..=3u8 {
        let mut rng = Rng::new(45);
        let mut instrument = instrument(circle(6));
        let count = instrument.count();
        instrument.delay_frames = delay_frames;
        let mut system = Loop::new(instrument);
        // The mirror is one frame later, or earlier, than the configuration says.
        system.instrument.delay_frames = if delay_frames == 3 { 2 } else { delay_frames + 1 };
        let wavefront = tilts(count, 100_000.0, &mut rng);
        let mut error = 0.0f64;
        for k in 1..=12 {
            system.frame(&wavefront);
            let part = 1.0 - f64::powi(0.5, k);
            let expected: Vec<_> =
                wavefront.iter().flatten().map(|w| w.map(|w| part * w)).collect();
            error = error.max(system.distance(&expected));
        }
        assert!(error > 10_000.0, "L {delay_frames}: {error}");
    }
}

/// A segment sees a quarter more tip than it reaches, for 300 frames. Its
/// command goes to the wavefront and no further, and once the limits are lifted it is there in
/// the next frame; when the wavefront goes back, so does the command, as if nothing had happened.
#[test]
fn limits_do_not_wind_up() {
    let mut rng = Rng::new(46);
    let wide = instrument(circle(4));
    let count = wide.count();
    let stroke = wide.stroke_m;
    let mut narrow = wide.clone();
    let mut limits = vec![[[0.0, stroke]; 3]; count];
    limits[5] = [[0.495 * stroke, 0.505 * stroke]; 3];
    narrow.limits_m = Values::Each(limits);

    let mut wavefront = tilts(count, 200_000.0, &mut rng);
    // Half a per cent of the stroke is 167,772 ulp of height; this tip takes 207,846.
    let big = 400_000.0;
    for (i, w) in wavefront.iter_mut().flatten().enumerate() {
        *w = [if i == 5 { big } else { w[0] - big / (count - 1) as f64 }, w[1]];
    }
    let mut free = Integrator::new(&wide, Numbers::Stored);
    let mut system = Loop::new(narrow);
    let mut saturated = 0;
    for _ in 0..300 {
        let applied = system.exposed().to_vec();
        saturated += u32::from(system.frame(&wavefront).saturated_actuators);
        free.update(&system.slopes(), &applied);
        assert!(system.distance(&free.command) <= 4.0);
    }
    assert!(saturated > 200, "the segment is limited: {saturated}");
    let limited = system.shown.last().expect("frames")[5][0];
    assert!(limited < 0.9 * system.commands()[5][0], "{limited}");
    let mean = wavefront.iter().flatten().map(|w| w[0]).sum::<f64>() / count as f64;
    let target: Vec<_> = wavefront.iter().flatten().map(|w| [w[0] - mean, w[1]]).collect();
    assert!(system.distance(&target) <= 2.0 * SLOPE_ULP, "the command is the wavefront");

    // Lifted: the very next frame shows the whole command.
    system.config = wide.config();
    let report = system.frame(&wavefront);
    assert_eq!(report.saturated_actuators, 0);
    for (position, command) in system.path.positions().iter().zip(system.path.commands()) {
        assert_eq!(position.tilt_ulp, *command);
    }
    // Limited again, and the wavefront falls to nothing: the command halves in every frame.
    system.config = system.instrument.config();
    let start = system.commands();
    let flat = vec![Some([0.0; 2]); count];
    for k in 1..=10 {
        system.frame(&flat);
        let expected: Vec<_> = start.iter().map(|c| c.map(|c| c * f64::powi(0.5, k))).collect();
        assert!(system.distance(&expected) <= 2.0 * SLOPE_ULP, "frame {k}");
    }
}

/// An invalid subaperture takes its valid neighbours' mean; without one it holds; it never
/// integrates on its own.
#[test]
fn gaps_follow_their_neighbours_or_hold() {
    let mut rng = Rng::new(47);
    let instrument = instrument(Mask::square(6).expect("a mask"));
    let count = instrument.count();
    let mut system = Loop::new(instrument);
    let wavefront = tilts(count, 200_000.0, &mut rng);
    for _ in 0..30 {
        system.frame(&wavefront);
    }
    let before = system.commands();
    // (1, 1) alone is dark, and the corner (5, 5) with all around it for two steps.
    let mut seen = wavefront.clone();
    let corner = |i: usize| (5 - i % 6) + (5 - i / 6) <= 2;
    for (i, s) in seen.iter_mut().enumerate() {
        if i == 7 || corner(i) {
            *s = None;
        }
    }
    for _ in 0..60 {
        system.frame(&seen);
    }
    let after = system.commands();
    for axis in 0..2 {
        let mean = [1, 6, 8, 13].iter().map(|&i| after[i][axis]).sum::<f64>() / 4.0;
        assert!((after[7][axis] - mean).abs() <= SLOPE_ULP, "{} {mean}", after[7][axis]);
        // The corner and its two neighbours have no valid neighbour.
        for i in [35, 34, 29] {
            assert_eq!(after[i][axis], before[i][axis], "{i}");
        }
    }
}

/// Noise, dead subapertures and f = 1.1, whose blind modes would grow by 1.05 a frame, for 10^6
/// frames: commands stay those of the law, and bounded.
#[test]
fn a_million_noisy_frames_are_stable() {
    const FRAMES: u32 = 1_000_000;
    let mut rng = Rng::new(48);
    let mut instrument = instrument(circle(4));
    instrument.lever_arm = 1.1;
    let count = instrument.count();
    let mut model = Integrator::new(&instrument, Numbers::Stored);
    let mut system = Loop::new(instrument);
    let mut wavefront = tilts(count, 200_000.0, &mut rng);
    let (mut largest, mut worst) = (0.0f64, 0.0f64);
    for frame in 0..FRAMES {
        if frame % 64 == 0 {
            wavefront = tilts(count, 200_000.0, &mut rng);
        }
        let mut seen = wavefront.clone();
        for (i, s) in seen.iter_mut().enumerate() {
            // 0 is dead, 11 in every other thousand, the others now and then; the rest is noisy.
            let dark = i == 0 || (i == 11 && frame / 1000 % 2 == 0) || rng.below(1000) == 0;
            let noise = [0; 2].map(|_| 30_000.0 * rng.normal());
            *s = s.filter(|_| !dark).map(|w| [w[0] + noise[0], w[1] + noise[1]]);
        }
        let applied = system.exposed().to_vec();
        system.frame(&seen);
        model.update(&system.slopes(), &applied);
        worst = worst.max(system.distance(&model.command));
        let drop = system.shown.len().saturating_sub(4);
        system.shown.drain(..drop);
        let commands = system.path.commands().as_flattened().iter();
        largest = largest.max(splash_tests::largest(commands.map(|&c| f64::from(c))));
    }
    println!("largest command {largest:.0} ulp, from the law {worst:.2} ulp");
    // The wavefront, its noise at six sigma and f; a twelfth of them in the mean.
    assert!(largest <= 1.1 * (1.2 * 200_000.0 + 6.0 * 30_000.0), "{largest}");
    assert!(largest < f64::from(TILT_LIMIT) / 10.0);
    assert!(worst <= ROUNDING_ULP / 0.5, "{worst}");
}

/// The blind mode itself: a tilt common to all in the slopes is not followed, whatever f.
#[test]
fn mean_slope_is_removed() {
    let mut instrument = instrument(circle(6));
    instrument.lever_arm = 1.9;
    let count = instrument.count();
    let mut path = Box::new(Path::new());
    let config: Box<Bank> = with_big_stack(|| instrument.config());
    let frame = frames::steered(&instrument, vec![Some([50_000, -20_000]); count], FLUX);
    for number in 0..1000 {
        step(&mut path, &config, number, &frame);
        let most = path.commands().iter().flatten().map(|c| c.abs()).max();
        assert!(most <= Some(1), "frame {number}: {most:?}");
    }
}
