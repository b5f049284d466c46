//! A step of the closed loop with detector images, and its parts alone:
//! `cargo bench -p host-sim --bench step`, with `-- splash/8/` or `-- lgs/` for a part of it, and after
//! `RAYON_NUM_THREADS=1` for the time on one core.
//!
//! `transforms` is the cost of the Fourier transforms alone, done by rustfft: for SPLASH those along x over
//! the pupil seen from each spot, for a guide star those of an image of 2 n x 2 n from each subaperture,
//! which the simulator sums directly.

use criterion::{Criterion, criterion_group, criterion_main};
use host_sim::atmosphere::Atmosphere;
use host_sim::board::{Frame, in_process};
use host_sim::closed_loop::{ClosedLoop, Run, Sensing};
use host_sim::imager::{Imager, Noise};
use host_sim::instrument::Instrument;
use host_sim::optics::camera::Camera;
use host_sim::optics::geometric::Sensor;
use host_sim::optics::phase::{Path, PhaseSampler};
use host_sim::optics::science::Science;
use host_sim::pupil::{Mirror, Pupil};
use host_sim::reconstructor::Reconstructor;
use rayon::prelude::*;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex32;
use std::hint::black_box;
use std::time::Duration;

const SENSORS: [(&str, Sensor); 2] = [("splash", Sensor::Splash), ("lgs", Sensor::Lgs)];
const TIME_S: f64 = 0.0;

fn step(criterion: &mut Criterion) {
    for (name, sensor) in SENSORS {
        for across in [8, 12, 16, 24, 32] {
            size(criterion, &format!("{name}/{across}"), sensor, across);
        }
    }
}

fn size(criterion: &mut Criterion, name: &str, sensor: Sensor, across: usize) {
    let mut group = criterion.benchmark_group(name);
    group.sample_size(10).warm_up_time(Duration::from_millis(300));
    group.measurement_time(Duration::from_secs(1));
    let mut instrument = Instrument::standard().expect("default");
    instrument.telescope.subapertures = across;
    // Still air, so that the turbulence lasts for as many steps as the benchmark wants.
    instrument.atmosphere.layers.iter_mut().for_each(|layer| layer.wind_speed_m_per_s = 0.0);
    let reconstructor = Reconstructor::new(&instrument).expect("instrument");
    let pupil = instrument.pupil().expect("pupil");
    let layers = instrument.layers();
    let (r0_m, diameter_m) = (instrument.atmosphere.r0_m, pupil.diameter_m());
    let sky = Atmosphere::new(r0_m, &layers, diameter_m, pupil.pitch_m(), 1e6, 1).expect("sky");
    let mirror = Mirror::flat(pupil.subapertures().len());
    let (window, scale) = (instrument.windows.size, instrument.windows.pixels_per_lambda_d);
    let beacon_m = instrument.laser.beacon_height_m;

    let mut board = in_process(&reconstructor.spec()).expect("configuration");
    let sensing = Sensing::Images;
    let run = Run { sensor, sensing, frames: u32::MAX, seed: 1, noise_free: false };
    let shared = sky.clone().into();
    let mut closed =
        ClosedLoop::under(&instrument, &reconstructor, board.as_mut(), run, shared).expect("loop");
    let mut camera = Camera::new(sensor, &pupil, &sky, beacon_m, scale, window).expect("camera");
    let mut images = vec![0.0; camera.spots() * window * window];
    let mut imager =
        Imager::new(&instrument, &reconstructor, sensor, &pupil, &sky).expect("imager");
    let (rows, length) = transforms(sensor, &pupil);
    let fft = FftPlanner::new().plan_fft_forward(length);
    let one = Complex32::new(1.0, 0.0);
    group.bench_function("step", |bencher| {
        bencher.iter(|| closed.step().expect("step").observation.strehl);
    });
    group.bench_function("optics", |bencher| {
        bencher.iter(|| camera.expose(&sky, TIME_S, &mirror, black_box(&mut images)));
    });
    group.bench_function("optics and detector", |bencher| {
        let noise = Some(Noise { seed: 1, frame: 1 });
        bencher.iter(|| {
            black_box(imager.expose(&sky, TIME_S, &mirror, noise).expect("windows"));
        });
    });
    group.bench_function("transforms", |bencher| {
        let buffer = || (vec![one; rows * length], vec![one; fft.get_inplace_scratch_len()]);
        bencher.iter(|| {
            (0..pupil.subapertures().len()).into_par_iter().for_each_init(
                buffer,
                |(spectra, scratch), _| {
                    spectra.fill(one);
                    fft.process_with_scratch(black_box(spectra), scratch);
                },
            );
        });
    });
    let mut sampler = PhaseSampler::default();
    let mut phase = vec![0.0; pupil.side() * pupil.side()];
    let path = Path::Beacon { height_m: beacon_m, position_m: [0.0; 2] };
    group.bench_function("atmosphere", |bencher| {
        bencher.iter(|| sampler.sample(path, &pupil, &sky, TIME_S, black_box(&mut phase)));
    });
    let wavelength_m = instrument.science.wavelength_m;
    let mut science = Science::new(&pupil, &sky, wavelength_m, wavelength_m).expect("science");
    group.bench_function("science", |bencher| {
        bencher.iter(|| science.observe(&sky, TIME_S, black_box(&mirror)));
    });
    let pixels = imager.pixels().to_vec();
    let mut board = in_process(&reconstructor.spec()).expect("configuration");
    let mut frame = 0;
    group.bench_function("firmware", |bencher| {
        bencher.iter(|| {
            frame += 1;
            board.frame(frame, Frame::Pixels(black_box(&pixels))).expect("frame")
        });
    });
    group.finish();
}

/// Rows to transform for each spot, and their length.
fn transforms(sensor: Sensor, pupil: &Pupil) -> (usize, usize) {
    let n = pupil.samples();
    match sensor {
        Sensor::Splash => {
            let shortest = pupil.side() + n - 1;
            (pupil.side(), (shortest..).find(|&length| convenient(length)).expect("powers of two"))
        }
        // The rows with light, then all columns.
        Sensor::Lgs | Sensor::Ngs => (3 * n, 2 * n),
    }
}

/// Whether a length has no prime factor above 5.
fn convenient(mut length: usize) -> bool {
    for factor in [2, 3, 5] {
        while length.is_multiple_of(factor) {
            length /= factor;
        }
    }
    length == 1
}

criterion_group!(benches, step);
criterion_main!(benches);
