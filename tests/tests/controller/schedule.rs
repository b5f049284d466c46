//! Interleaved subapertures: sub-cycles against an f64 model of their law.

use super::*;
use splash_firmware::pipeline::Pipeline;
use splash_firmware::spec::Estimator;
use splash_tests::instrument::run_frame;

const LATTICE: [u8; 3] = [2, 0, 2];

fn interleaved() -> Instrument {
    let mut instrument = instrument();
    instrument.limits_m = Values::Uniform([[0.0, instrument.stroke_m]; 3]);
    instrument.slew_m_per_frame = None;
    instrument.lattice = Some(LATTICE);
    instrument.separation = 2.0;
    instrument
}

/// A small tilt of each subaperture's own, Q16 px.
fn atmosphere() -> Vec<[f64; 2]> {
    let tilt = |i: usize| [(i * 37 % 11) as f64 - 5.0, (i * 53 % 13) as f64 - 6.0];
    (0..SUBAPERTURES).map(|i| tilt(i).map(|t| t * 400.0)).collect()
}

/// What the sensor shows of the colour that is lit, with a mirror that shows `commands` in ulp; a Q16
/// pixel is `ulp` of them.
fn seen(commands: &[[i32; 2]], lit: &dyn Fn(usize) -> bool, ulp: f64) -> Vec<Measurement> {
    let tilts = atmosphere();
    let one = |(i, (tilt, command)): (usize, (&[f64; 2], &[i32; 2]))| {
        let axis = |a: usize| (tilt[a] - f64::from(command[a]) / ulp).round() as i32;
        let flux = if lit(i) { FLUX } else { 0 };
        Measurement { centroid_q16: [axis(0), axis(1)], flux, peak: 100, saturated: 0 }
    };
    tilts.iter().zip(commands).enumerate().map(one).collect()
}

fn colour(i: usize) -> usize {
    // (x mod 2) + 2 (y mod 2), by hand.
    (i % 4) % 2 + 2 * ((i / 4) % 2)
}

struct Sub {
    pipeline: Box<Pipeline<CELLS, 0>>,
    config: Box<SmallConfig>,
    ulp: f64,
}

impl Sub {
    fn new(instrument: &Instrument) -> Self {
        let gain_m = instrument.slope_gain_m_per_px.at(0)[0][0];
        let ulp = gain_m / instrument.ulp_m() / 65536.0;
        Self { pipeline: Box::new(Pipeline::new()), config: instrument.config(), ulp }
    }

    /// Sub-cycle `number`.
    fn run(&mut self, number: u32) {
        self.pipeline.begin(&self.config, number);
        let commands = match self.pipeline.commands() {
            [] => vec![[0; 2]; SUBAPERTURES],
            commands => commands.to_vec(),
        };
        let lit = |i: usize| colour(i) == number as usize % 4;
        let all = seen(&commands, &lit, self.ulp);
        self.pipeline.push_measurements(&self.config, &all).expect("all of them");
        let report = self.pipeline.finish(&self.config);
        assert_eq!((report.outcome, report.valid), (Outcome::Updated, 4));
    }
}

#[test]
fn colours_are_those_of_the_lattice() {
    let config: Box<SmallConfig> = interleaved().config();
    assert_eq!(config.colours(), 4);
    let expected: Vec<u8> = (0..SUBAPERTURES).map(|i| colour(i) as u8).collect();
    assert_eq!(config.colouring(), expected);
}

#[test]
fn only_the_colour_that_is_lit_moves_its_tips_and_tilts() {
    let mut sub = Sub::new(&interleaved());
    sub.run(0);
    for number in 1..13 {
        let before = sub.pipeline.commands().to_vec();
        let slopes = sub.pipeline.slopes().to_vec();
        sub.run(number);
        for (i, (now, before)) in sub.pipeline.commands().iter().zip(&before).enumerate() {
            if colour(i) == number as usize % 4 {
                assert!(number > 4 || now != before, "sub-cycle {number}: {i} is lit");
            } else {
                assert_eq!(now, before, "sub-cycle {number}: {i} holds");
                assert_eq!(sub.pipeline.slopes()[i], slopes[i], "and keeps its slope");
            }
        }
    }
}

/// c' = (1 - g) c + g (x - mean x), x of the colour that is lit, the mean over everyone's latest.
#[test]
fn commands_follow_the_law_in_f64() {
    let mut sub = Sub::new(&interleaved());
    let tilts = atmosphere();
    let mut commands = vec![[0.0f64; 2]; SUBAPERTURES];
    let mut latest: Vec<Option<[f64; 2]>> = vec![None; SUBAPERTURES];
    for number in 0..24 {
        sub.run(number);
        for i in (0..SUBAPERTURES).filter(|&i| colour(i) == number as usize % 4) {
            // What the mirror shows and what is left of it add up to the atmosphere.
            latest[i] = Some(tilts[i].map(|t| t * sub.ulp));
        }
        let known: Vec<[f64; 2]> = latest.iter().flatten().copied().collect();
        let mean = [0, 1].map(|a| known.iter().map(|x| x[a]).sum::<f64>() / known.len() as f64);
        for i in (0..SUBAPERTURES).filter(|&i| colour(i) == number as usize % 4) {
            let x = latest[i].expect("lit now");
            for a in 0..2 {
                commands[i][a] = 0.5 * commands[i][a] + 0.5 * (x[a] - mean[a]);
            }
        }
        for (i, (found, expected)) in sub.pipeline.commands().iter().zip(&commands).enumerate() {
            for a in 0..2 {
                let error = f64::from(found[a]) - expected[a];
                // Centroids are rounded to half a Q16 pixel, and so is each step.
                assert!(error.abs() <= 2.0 * sub.ulp + 2.0, "{number}, {i}: {error}");
            }
        }
    }
}

/// Colour 2 is skipped, every time: the others end where they end with it.
#[test]
fn a_skipped_sub_cycle_does_not_stop_the_others() {
    let mut sub = Sub::new(&interleaved());
    for number in (0..80).filter(|number| number % 4 != 2) {
        sub.pipeline.begin(&sub.config, number);
        let commands = sub.pipeline.commands().to_vec();
        let lit = |i: usize| colour(i) == number as usize % 4;
        let all = seen(&commands, &lit, sub.ulp);
        sub.pipeline.push_measurements(&sub.config, &all).expect("all of them");
        assert_eq!(sub.pipeline.finish(&sub.config).outcome, Outcome::Updated);
    }
    let tilts = atmosphere();
    let others: Vec<usize> = (0..SUBAPERTURES).filter(|&i| colour(i) != 2).collect();
    let mean =
        [0, 1].map(|a| others.iter().map(|&i| tilts[i][a]).sum::<f64>() / others.len() as f64);
    for (i, command) in sub.pipeline.commands().iter().enumerate() {
        for a in 0..2 {
            let expected = if colour(i) == 2 { 0.0 } else { (tilts[i][a] - mean[a]) * sub.ulp };
            let error = f64::from(command[a]) - expected;
            assert!(error.abs() <= 2.0 * sub.ulp + 2.0, "{i}: {error}");
        }
    }
}

/// A whole frame of a schedule with one colour is a frame without one, rows and all.
#[test]
fn one_colour_is_no_schedule() {
    let mut plain = instrument();
    plain.lattice = None;
    let mut one = plain.clone();
    one.colours = vec![0; SUBAPERTURES];
    let (a, b): (Box<SmallConfig>, Box<SmallConfig>) = (plain.config(), one.config());
    let (mut p, mut q) = (Box::new(Pipeline::<CELLS, 0>::new()), Box::new(Pipeline::new()));
    let mut rng = splash_tests::frames::Rng::new(5);
    for number in 0..5 {
        let pixels: Vec<u16> = (0..256).map(|_| rng.below(4096) as u16).collect();
        let reports =
            (run_frame(&mut p, &a, number, &pixels), run_frame(&mut q, &b, number, &pixels));
        assert_eq!(reports.0, reports.1);
        assert_eq!(p.codes(), q.codes());
    }
}

/// Windows of 4 pixels, 3 apart, share pixels with their neighbours, of other colours: each that is lit has
/// the centre of gravity of its own 4 x 4 pixels.
#[test]
fn windows_of_other_colours_may_overlap() {
    let mut instrument = interleaved();
    instrument.origins =
        instrument.mask.cells().map(|(x, y)| [3 * x as u16, 3 * y as u16]).collect();
    instrument.estimator = Estimator::CentreOfGravity;
    instrument.dark_adu = Values::Uniform(0.0);
    instrument.threshold_sigma = 0.0;
    let config: Box<SmallConfig> = instrument.config();
    let mut pipeline = Box::new(Pipeline::<CELLS, 0>::new());
    let mut rng = splash_tests::frames::Rng::new(7);
    for number in 0..4 {
        let pixels: Vec<u16> = (0..256).map(|_| rng.below(4096) as u16).collect();
        let report = run_frame(&mut pipeline, &config, number, &pixels);
        assert_eq!((report.outcome, report.valid), (Outcome::Updated, 4));
        for i in (0..SUBAPERTURES).filter(|&i| colour(i) == number as usize % 4) {
            let [x0, y0] = instrument.origins[i].map(usize::from);
            let mut sums = [0.0; 3];
            for (x, y) in (0..16).map(|k| (k % 4, k / 4)) {
                let value = f64::from(pixels[(y0 + y) * 16 + x0 + x]);
                let moments = [value, value * (x as f64 - 1.5), value * (y as f64 - 1.5)];
                sums.iter_mut().zip(moments).for_each(|(sum, moment)| *sum += moment);
            }
            let [flux, x, y] = sums;
            let found = pipeline.measurements()[i];
            assert_eq!(f64::from(found.flux), flux);
            for (found, expected) in found.centroid_q16.iter().zip([x / flux, y / flux]) {
                // Rounded once.
                assert!((f64::from(*found) / 65536.0 - expected).abs() < 1.0 / 65536.0, "{i}");
            }
        }
    }
}
