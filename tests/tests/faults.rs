//! The fault campaign, a hundredth of it and more: `host-sim faults` runs ten thousand.

use host_sim::fault_campaign::{FaultCampaign, MISHAPS, Memory};
use host_sim::instrument::Instrument;
use host_sim::reconstructor::Reconstructor;

/// The campaign of a seed, which must hold to its end: its digest.
fn campaign(seed: u64, faults: u32) -> String {
    let mut instrument = Instrument::standard().expect("valid");
    instrument.safety.safe_frames = 30;
    let reconstructor = Reconstructor::new(&instrument).expect("valid");
    let mut memory = Memory::default();
    let mut campaign =
        FaultCampaign::new(&mut memory, &instrument, &reconstructor, seed).expect("a board");
    let mut met = vec![];
    for _ in 0..faults {
        met.push(campaign.step().expect("what must hold"));
    }
    campaign.settle().expect("the loop closes again");
    for line in campaign.lines() {
        assert_eq!(line.count, met.iter().filter(|&&m| m == line.mishap).count() as u64);
    }
    if faults >= 200 {
        assert!(MISHAPS.iter().all(|mishap| met.contains(mishap)), "every kind comes");
        let lines = campaign.lines();
        let sum =
            |pick: fn(&host_sim::fault_campaign::Line) -> u64| lines.iter().map(pick).sum::<u64>();
        assert!(sum(|l| l.held) > 0 && sum(|l| l.leaked) > 0 && sum(|l| l.ended) > 0, "{lines:?}");
    }
    campaign.digest()
}

#[test]
fn what_must_hold_holds_through_every_kind_of_fault() {
    campaign(7, 300);
}

#[test]
fn the_same_seed_gives_the_same_codes() {
    let digest = campaign(3, 60);
    assert_eq!(campaign(3, 60), digest);
    assert_ne!(campaign(4, 60), digest);
}
