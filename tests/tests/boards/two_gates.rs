//! Two gates on the emulated boards: the codes of the library in this process.

use super::emulated::or_skip;
use host_sim::board::remote::Remote;
use host_sim::board::{Board, BoardError, Frame, Options, ibex, in_process, qemu};
use splash_firmware::centroid::Measurement;
use splash_firmware::spec::Spec;
use splash_tests::frames::{Rng, steered};
use splash_tests::instrument::Instrument;
use splash_tests::twin::modal::polynomials;

/// Two gates, windows of `window` pixels, modes that take a little of each other.
fn instrument(across: usize, window: u8, modes: usize) -> Instrument {
    let mut rng = Rng::new(150);
    let one = Instrument::circle(across, window);
    let coupling = (0..2 * modes * modes).map(|_| rng.uniform(-0.3, 0.3)).collect();
    let gradients = polynomials(&one.mask, modes);
    one.with_second_gate(gradients, coupling)
}

fn same_codes(open: fn(&Spec<'_>, Options) -> Result<Remote, BoardError>) {
    for (across, window, modes) in [(8, 8, 12), (16, 8, 25)] {
        let instrument = instrument(across, window, modes);
        let spec = instrument.spec();
        let Some(mut there) = or_skip(open(&spec, Options::default())) else { return };
        let mut here = in_process(&spec).expect("configuration");
        let mut both = instrument.clone();
        both.origins.extend(spec.modal.expect("two gates").origins);
        let mut rng = Rng::new(151);
        for number in 0..4 {
            let mut centroids: Vec<_> = both
                .origins
                .iter()
                .map(|_| [0; 2].map(|_: i32| rng.between(-1 << 16, 1 << 16)))
                .map(Some)
                .collect();
            centroids.iter_mut().filter(|_| rng.below(9) == 0).for_each(|c| *c = None);
            let pixels = steered(&both, centroids.iter().copied(), 4000);
            let measured: Vec<_> = centroids
                .iter()
                .map(|c| Measurement {
                    centroid_q16: c.unwrap_or_default(),
                    flux: if c.is_some() { 4000 } else { 0 },
                    ..Measurement::default()
                })
                .collect();
            let frame =
                if number == 3 { Frame::Measurements(&measured) } else { Frame::Pixels(&pixels) };
            let reports = [here.frame(number, frame), there.frame(number, frame)];
            let [here_said, there_said] = reports.map(|report| report.expect("a complete frame"));
            assert_eq!(here_said, there_said);
            assert_eq!(here.codes(), there.codes(), "N = {across}, frame {number}");
            assert_eq!(here.slopes(), there.slopes());
            assert_eq!(here.second_slopes(), there.second_slopes());
            assert_eq!(here.second_measurements(), there.second_measurements());
            assert_eq!(here.second_slopes().len(), here.slopes().len());
        }
    }
}

#[test]
fn qemu_gives_the_codes_of_two_gates() {
    same_codes(qemu::open);
}

#[test]
fn ibex_gives_the_codes_of_two_gates() {
    same_codes(ibex::open);
}
