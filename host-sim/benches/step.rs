//! A step of the closed loop with detector images, and its parts alone: `cargo bench -p host-sim --bench step`.
//! After `--` a part of the names chooses, `step/lgs` or `detector`: only what it needs is set up.
//! `RAYON_NUM_THREADS=1` before it gives the time on one core.
//!
//! | group | what |
//! |---|---|
//! | `step` | `ClosedLoop::step`: star, sensor, detector with noise, firmware, mirror |
//! | `optics` | the noise-free images of all subapertures |
//! | `detector` | photon and read noise of one frame |
//! | `science` | the star's residual phase and Strehl ratio |
//! | `atmosphere` | the turbulent phase along one path |
//! | `firmware` | pixels to DAC codes |
//! | `transforms` | the Fourier transforms alone, done by rustfft |
//!
//! The transforms are, for SPLASH, those along x over the pupil seen from each spot, and for a guide star those
//! of an image of 2 n x 2 n from each subaperture, which the simulator sums directly.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use host_sim::atmosphere::Atmosphere;
use host_sim::board::{Frame, in_process};
use host_sim::closed_loop::{ClosedLoop, Run, Sensing};
use host_sim::detector::place;
use host_sim::imager::Imager;
use host_sim::instrument::Instrument;
use host_sim::optics::camera::Camera;
use host_sim::optics::geometric::Sensor;
use host_sim::optics::phase::{Path, PhaseSampler};
use host_sim::optics::science::Science;
use host_sim::pupil::{Mirror, Pupil};
use host_sim::reconstructor::Reconstructor;
use rayon::prelude::*;
use splash_fft::{Complex, Planned};
use std::cell::OnceCell;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

const SENSORS: [(&str, Sensor); 2] = [("splash", Sensor::Splash), ("lgs", Sensor::Lgs)];
const TIME_S: f64 = 0.0;

/// The default instrument with `across` subapertures, made when it is first looked at.
struct Bench {
    across: usize,
    parts: OnceCell<Parts>,
}

struct Parts {
    instrument: Instrument,
    reconstructor: Reconstructor,
    pupil: Pupil,
    sky: Arc<Atmosphere>,
    mirror: Mirror,
}

impl Bench {
    fn new(across: usize) -> Self {
        Self { across, parts: OnceCell::new() }
    }

    fn parts(&self) -> &Parts {
        self.parts.get_or_init(|| {
            let mut instrument = Instrument::standard().expect("default");
            instrument.telescope.subapertures = self.across;
            // Still air, so that the turbulence lasts for as many steps as the benchmark wants.
            instrument.atmosphere.layers.iter_mut().for_each(|l| l.wind_speed_m_per_s = 0.0);
            let reconstructor = Reconstructor::new(&instrument).expect("instrument");
            let pupil = instrument.pupil().expect("pupil");
            let (r0_m, diameter_m) = (instrument.atmosphere.r0_m, pupil.diameter_m());
            let layers = instrument.layers();
            let sky = Atmosphere::new(r0_m, &layers, diameter_m, pupil.pitch_m(), 1e6, 1);
            let mirror = Mirror::flat(pupil.subapertures().len());
            Parts { instrument, reconstructor, pupil, sky: sky.expect("sky").into(), mirror }
        })
    }
}

impl Parts {
    fn closed_loop<T>(&self, sensor: Sensor, then: impl FnOnce(&mut ClosedLoop) -> T) -> T {
        let mut board = in_process(&self.reconstructor.spec()).expect("configuration");
        let sensing = Sensing::Images;
        let run = Run { sensor, sensing, frames: u32::MAX, seed: 1, noise_free: false };
        let (instrument, sky) = (&self.instrument, self.sky.clone());
        let closed = ClosedLoop::under(instrument, &self.reconstructor, board.as_mut(), run, sky);
        then(&mut closed.expect("loop"))
    }

    /// The camera, and room for its images.
    fn camera(&self, sensor: Sensor) -> (Camera, Vec<f32>) {
        let Instrument { windows, laser, .. } = &self.instrument;
        let (scale, beacon_m) = (windows.pixels_per_lambda_d, laser.beacon_height_m);
        let camera = Camera::new(sensor, &self.pupil, &self.sky, beacon_m, scale, windows.size);
        let camera = camera.expect("camera");
        let images = vec![0.0; camera.spots() * windows.size * windows.size];
        (camera, images)
    }

    /// The light on the detector from a laser guide star, e-.
    fn expected_e(&self) -> Vec<f32> {
        let (mut camera, mut images) = self.camera(Sensor::Lgs);
        camera.expose(&self.sky, TIME_S, &self.mirror, &mut images);
        let detector = self.reconstructor.detector().spec();
        let origins: Vec<_> =
            self.reconstructor.origins().iter().map(|o| o.map(usize::from)).collect();
        let flux_e = self.instrument.laser.electrons_per_spot as f32;
        let mut expected_e = vec![0.0; detector.width * detector.height];
        place(&images, flux_e, &origins, camera.window(), detector.width, &mut expected_e)
            .expect("windows");
        expected_e
    }

    /// Pixels of a laser guide star without noise.
    fn pixels(&self) -> Vec<u16> {
        let Self { reconstructor, pupil, sky, mirror, .. } = self;
        let imager = Imager::new(reconstructor, Sensor::Lgs, pupil, sky);
        let mut imager = imager.expect("imager");
        imager.expose(sky, TIME_S, mirror, None).expect("windows").to_vec()
    }
}

fn benches(criterion: &mut Criterion) {
    let benches = [8, 12, 16, 24, 32].map(Bench::new);
    steps(criterion, &benches);
    optics(criterion, &benches);
    transforms(criterion, &benches);
    parts(criterion, &benches);
}

fn steps(criterion: &mut Criterion, benches: &[Bench]) {
    let mut group = criterion.benchmark_group("step");
    for (name, sensor) in SENSORS {
        for bench in benches {
            group.bench_function(BenchmarkId::new(name, bench.across), |bencher| {
                bench.parts().closed_loop(sensor, |closed| {
                    let mut step = || closed.step().expect("step").observation.strehl;
                    // The first one meets cold caches.
                    step();
                    bencher.iter(step);
                });
            });
        }
    }
    group.finish();
}

fn optics(criterion: &mut Criterion, benches: &[Bench]) {
    let mut group = criterion.benchmark_group("optics");
    for (name, sensor) in SENSORS {
        for bench in benches {
            let mut camera = None;
            group.bench_function(BenchmarkId::new(name, bench.across), |bencher| {
                let Parts { sky, mirror, .. } = bench.parts();
                let (camera, images) = camera.get_or_insert_with(|| bench.parts().camera(sensor));
                bencher.iter(|| camera.expose(sky, TIME_S, mirror, black_box(images)));
            });
        }
    }
    group.finish();
}

fn transforms(criterion: &mut Criterion, benches: &[Bench]) {
    let mut group = criterion.benchmark_group("transforms");
    for (name, sensor) in SENSORS {
        for bench in benches {
            group.bench_function(BenchmarkId::new(name, bench.across), |bencher| {
                let pupil = &bench.parts().pupil;
                let (rows, length) = rows(sensor, pupil);
                let fft = f32::forward(length);
                let one = Complex::new(1.0f32, 0.0);
                let buffers =
                    || (vec![one; rows * length], vec![one; fft.get_inplace_scratch_len()]);
                bencher.iter(|| {
                    (0..pupil.subapertures().len()).into_par_iter().for_each_init(
                        buffers,
                        |(spectra, scratch), _| {
                            spectra.fill(one);
                            fft.process_with_scratch(black_box(spectra), scratch);
                        },
                    );
                });
            });
        }
    }
    group.finish();
}

/// Those that do not depend on the sensor.
fn parts(criterion: &mut Criterion, benches: &[Bench]) {
    for bench in benches {
        let across = bench.across;
        let mut expected_e = None;
        criterion.bench_function(&format!("detector/{across}"), |bencher| {
            let detector = bench.parts().reconstructor.detector();
            let expected_e = expected_e.get_or_insert_with(|| bench.parts().expected_e());
            let (mut frame, mut pixels) = (0, vec![0; expected_e.len()]);
            bencher.iter(|| {
                frame += 1;
                detector.read(expected_e, frame, 1, black_box(&mut pixels)).expect("sizes");
            });
        });
        criterion.bench_function(&format!("science/{across}"), |bencher| {
            let Parts { instrument, pupil, sky, mirror, .. } = bench.parts();
            let wavelength_m = instrument.science.wavelength_m;
            let mut science =
                Science::new(pupil, sky, wavelength_m, wavelength_m).expect("science");
            bencher.iter(|| science.observe(sky, TIME_S, black_box(mirror)));
        });
        criterion.bench_function(&format!("atmosphere/{across}"), |bencher| {
            let Parts { instrument, pupil, sky, .. } = bench.parts();
            let height_m = instrument.laser.beacon_height_m;
            let path = Path::Beacon { height_m, position_m: [0.0; 2] };
            let mut sampler = PhaseSampler::default();
            let mut phase = vec![0.0; pupil.side() * pupil.side()];
            bencher.iter(|| sampler.sample(path, pupil, sky, TIME_S, black_box(&mut phase)));
        });
        let mut pixels = None;
        criterion.bench_function(&format!("firmware/{across}"), |bencher| {
            let pixels = pixels.get_or_insert_with(|| bench.parts().pixels());
            let spec = bench.parts().reconstructor.spec();
            let (mut board, mut frame) = (in_process(&spec).expect("configuration"), 0);
            bencher.iter(|| {
                frame += 1;
                board.frame(frame, Frame::Pixels(black_box(pixels))).expect("frame")
            });
        });
    }
}

/// Rows to transform for each spot, and their length.
fn rows(sensor: Sensor, pupil: &Pupil) -> (usize, usize) {
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

criterion_group! {
    name = step;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = benches
}
criterion_main!(step);
