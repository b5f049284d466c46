//! The three sensors in a closed loop through detector and firmware.

use host_sim::board::in_process;
use host_sim::calibration::SlopeCalibration;
use host_sim::closed_loop::{ClosedLoop, Run, Sensing};
use host_sim::instrument::Instrument;
use host_sim::optics::geometric::Sensor;
use host_sim::reconstructor::Reconstructor;

/// The Strehl ratio that frozen turbulence is corrected to.
fn converged(toml: &str, sensor: Sensor, sensing: Sensing, seed: u64) -> f64 {
    const FRAMES: u32 = 40;
    let mut instrument = Instrument::parse(toml, "test").unwrap().noise_free();
    instrument.atmosphere.layers.iter_mut().for_each(|layer| layer.wind_speed_m_per_s = 0.0);
    let mut reconstructor = Reconstructor::new(&instrument).unwrap();
    if sensing == Sensing::Images {
        let slopes = SlopeCalibration::of(sensor, &instrument, &mut |_| ()).unwrap();
        reconstructor = reconstructor.with_slopes(slopes);
    }
    let mut board = in_process(&reconstructor.spec()).unwrap();
    let run = Run { sensor, sensing, frames: FRAMES, seed, noise_free: true };
    let board = board.as_mut();
    let mut closed = ClosedLoop::new(&instrument, &reconstructor, board, run, &mut |_| ()).unwrap();
    let strehl = (0..FRAMES).map(|_| closed.step().unwrap().observation.strehl);
    strehl.last().unwrap()
}

/// With all turbulence at the ground all sensors see the same wavefront. Laser and star then have the
/// same images. SPLASH's are spread by the return path as well: its thresholded centroids differ by what
/// the speckle does to them.
#[test]
fn all_agree_with_turbulence_at_the_ground() {
    let ground = "[[atmosphere.layers]]\nweight = 1\nheight_m = 0\nwind_speed_m_per_s = 0\n\
                  wind_direction_deg = 0";
    for seed in [1, 2, 3] {
        let images = |sensor| converged(ground, sensor, Sensing::Images, seed);
        let (splash, lgs, ngs) = (images(Sensor::Splash), images(Sensor::Lgs), images(Sensor::Ngs));
        let exact = converged(ground, Sensor::Ngs, Sensing::Geometric, seed);
        println!("seed {seed}: SPLASH {splash:.4}, LGS {lgs:.4}, NGS {ngs:.4}, exact {exact:.4}");
        assert_eq!(lgs, ngs);
        assert!((splash - ngs).abs() < 0.01, "SPLASH {splash}, NGS {ngs}");
        assert!((exact - ngs).abs() < 0.01, "exact {exact}, NGS {ngs}");
    }
}
