//! Steps of the closed loop per second: optics, detector, firmware and science together.
//! `RAYON_NUM_THREADS=1 cargo bench -p host-sim --bench closed_loop` gives them per core.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use host_sim::board::in_process;
use host_sim::closed_loop::{ClosedLoop, Run, Sensing};
use host_sim::instrument::Instrument;
use host_sim::optics::geometric::Sensor;
use host_sim::reconstructor::Reconstructor;

fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("closed_loop");
    group.throughput(Throughput::Elements(1)).sample_size(20);
    for across in [8, 16, 32] {
        let mut instrument = Instrument::standard().expect("default");
        instrument.telescope.subapertures = across;
        // Still air, so that the turbulence lasts for as many steps as the benchmark wants.
        instrument.atmosphere.layers.iter_mut().for_each(|layer| layer.wind_speed_m_per_s = 0.0);
        let reconstructor = Reconstructor::new(&instrument).expect("instrument");
        let mut board = in_process(&reconstructor.spec()).expect("configuration");
        let (sensor, sensing) = (Sensor::Splash, Sensing::Images);
        let run = Run { sensor, sensing, frames: u32::MAX, seed: 1, noise_free: false };
        let mut closed =
            ClosedLoop::new(&instrument, &reconstructor, board.as_mut(), run, &mut |_| ())
                .expect("closed loop");
        let threads = rayon::current_num_threads();
        group.bench_function(BenchmarkId::new(format!("{threads} threads"), across), |bencher| {
            bencher.iter(|| closed.step().expect("step").observation.strehl);
        });
    }
    group.finish();
}

criterion_group!(benches, step);
criterion_main!(benches);
