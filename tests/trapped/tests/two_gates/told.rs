//! What telemetry tells of two gates.

use super::{Rig, coupling, instrument, tilts};
use splash_firmware::controller::FrameResult;
use splash_firmware::fault::Moment;
use splash_firmware::gate::GateStamp;
use splash_firmware::link::List;
use splash_firmware::mode::Mode;
use splash_firmware::telemetry::{Decimation, Record, Ring, Stamp};
use splash_tests::frames::Rng;

fn put<T: Copy>(all: &mut Vec<T>, first: u16, items: &List<T>) {
    assert_eq!(usize::from(first), all.len(), "pieces in order");
    all.extend_from_slice(items);
}

/// Slopes and measurements of the second gate's windows come behind the first's; there are no more segments than with
/// one gate.
#[test]
fn windows_of_both_gates_are_told() {
    let mut rng = Rng::new(150);
    let instrument = instrument(8, 12, coupling(12, 0.5, &mut rng));
    let mut rig = Rig::new(&instrument);
    let count = rig.config.subapertures();
    let mut ring = Box::new(Ring::<64>::new());
    ring.subscribe(Decimation { frames: 0, slopes: 1, commands: 1, codes: 1, fluxes: 1 });
    for _ in 0..2 {
        let seen = [(); 2].map(|()| tilts(count, 1e5, &mut rng).into_iter().map(Some).collect());
        let report = rig.frame(&seen);
        let at = Moment { frame: report.frame, ticks: 0 };
        let (mode, gate) = (Mode::ClosedLoop, GateStamp::default());
        let result = FrameResult { report, mode, rung: None, fault: None, gate, at };
        ring.fill(&rig.path, &result, &Stamp::default());
        let (mut slopes, mut fluxes, mut segments) = (Vec::new(), Vec::new(), [0; 2]);
        while let Some(record) = ring.pop() {
            match record {
                Record::Slopes { first, items, .. } => put(&mut slopes, first, &items),
                Record::Fluxes { first, items, .. } => put(&mut fluxes, first, &items),
                Record::Commands { items, .. } => segments[0] += items.len(),
                Record::Codes { items, .. } => segments[1] += items.len(),
                other => panic!("{other:?}"),
            }
        }
        let path = &rig.path;
        assert_eq!(slopes, [path.slopes(), path.second_slopes()].concat());
        assert_eq!(fluxes, [path.measurements(), path.second_measurements()].concat());
        assert_eq!(slopes.len(), 2 * count);
        assert_eq!(segments, [count; 2]);
    }
}
