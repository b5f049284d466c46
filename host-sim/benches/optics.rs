//! Time of one frame of SPLASH images, all spots: `RAYON_NUM_THREADS=1 cargo bench --bench optics`
//! gives it per core.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use host_sim::atmosphere::{Atmosphere, Layer};
use host_sim::optics::splash_image::{PIXELS_PER_LAMBDA_D, SplashCamera};
use host_sim::pupil::{Mirror, Pupil};
use std::hint::black_box;

fn expose(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("expose");
    let layer = |weight, height_m, wind_direction_deg| Layer {
        weight,
        height_m,
        wind_speed_m_per_s: 10.0,
        wind_direction_deg,
    };
    let layers = [layer(0.6, 0.0, 0.0), layer(0.4, 3000.0, 90.0)];
    for across in [8, 16, 32] {
        let pitch_m = 0.5;
        let pupil = Pupil::circular(across, 8, pitch_m).expect("pupil");
        let duration_s = 0.1;
        let diameter_m = pupil.diameter_m();
        let atmosphere =
            Atmosphere::new(0.5, &layers, diameter_m, pitch_m, duration_s, 1).expect("atmosphere");
        let mut camera = SplashCamera::new(&pupil, &atmosphere, 12_000.0, PIXELS_PER_LAMBDA_D, 16)
            .expect("camera");
        let mirror = Mirror::flat(camera.spots());
        let mut images = vec![0.0; camera.spots() * 16 * 16];
        let threads = rayon::current_num_threads();
        let id = BenchmarkId::new(format!("{threads} threads"), across);
        group.bench_function(id, |bencher| {
            bencher.iter(|| camera.expose(&atmosphere, 0.05, &mirror, black_box(&mut images)));
        });
    }
    group.finish();
}

criterion_group!(benches, expose);
criterion_main!(benches);
