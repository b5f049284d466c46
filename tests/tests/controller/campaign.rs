//! Anything in any order, from a seed: what must hold whatever happens.

use super::*;
use sha2::{Digest, Sha256};
use splash_firmware::fault::Fault;
use splash_firmware::gate::Range;
use splash_firmware::ladder::Rung;
use splash_firmware::mode::MODES;
use splash_firmware::segments::Position;
use splash_tests::frames::Rng;

/// 2000 events: frames of all kinds, commands, interlock, faults. Returns the digest of all codes.
fn campaign(seed: u64) -> Vec<u8> {
    let instrument = instrument();
    let mut rng = Rng::new(seed);
    let mut rig = Rig::new(&instrument);
    let mut watch = guard::Watch::new(&instrument, rig.codes());
    let mut digest = Sha256::new();
    let (mut followed, mut booked) = (0, 0);
    for _ in 0..2000 {
        let word = rng.bits() as u32;
        let subaperture = (word % 18) as u16;
        let anything = rng.bits() as i32;
        let before = rig.codes();
        let result = match rng.below(16) {
            0..=4 => Some(rig.frame(&frame(SHIFT))),
            5 => Some(rig.frame(&frame(anything))),
            6 => Some(rig.frame(&dark())),
            7 => Some(rig.frame(&frame(0)[..(word % 16) as usize])),
            8 => Some(rig.missing()),
            9 => Some(rig.numbered(word % 400, word % 12, &lit(SHIFT, word))),
            10 => {
                let inputs =
                    Inputs { laser_permit: word & 15 != 0, high_voltage_ready: word & 240 != 0 };
                rig.look(inputs);
                None
            }
            11 | 12 => {
                let _ = rig.ask(Command::Enter(MODES[word as usize % MODES.len()]));
                None
            }
            13 => {
                let position =
                    Position { piston_ulp: anything, tilt_ulp: [anything >> 6, 1 << 22] };
                let heights_ulp = [anything, 0, -(1 << 20)];
                let _ = match word & 1 {
                    0 => rig.ask(Command::Position { subaperture, position }),
                    _ => rig.ask(Command::Heights { subaperture, heights_ulp }),
                };
                None
            }
            14 => {
                let _ = rig.ask(Command::Arm);
                None
            }
            _ => {
                let range =
                    Range { altitude_mm: word, depth_mm: word / 50, zenith_mdeg: word >> 15 };
                let _ = rig.ask(Command::Gate(range));
                if word.is_multiple_of(16) {
                    rig.controller.fault(Fault::Dacs, rig.ticks);
                }
                None
            }
        };
        match result {
            Some(result) => {
                watch.step(rig.codes());
                followed += u32::from(result.rung == Some(Rung::Follow));
            }
            None => assert_eq!(rig.codes(), before, "nothing but a frame's time moves the mirror"),
        }
        let counts = rig.controller.faults().counts().iter().sum::<u32>();
        assert!(counts >= booked, "counters only grow");
        booked = counts;
        for code in rig.codes().as_flattened() {
            digest.update(code.to_le_bytes());
        }
    }
    assert!(followed > 0 && booked > 0, "{followed} frames followed, {booked} faults");

    // Whatever happened, the operator gets the loop closed again.
    if rig.controller.mode() != Mode::Safe {
        rig.ask(Command::Enter(Mode::Safe)).expect("always a way");
    }
    rig.settle();
    rig.close();
    assert_eq!(rig.frame(&frame(SHIFT)).rung, Some(Rung::Follow));
    digest.finalize().to_vec()
}

#[test]
fn whatever_happens_codes_stay_within_limits_and_the_loop_can_be_closed_again() {
    for seed in 0..20 {
        campaign(seed);
    }
}

#[test]
fn the_same_seed_gives_the_same_codes() {
    assert_eq!(campaign(99), campaign(99));
    assert_ne!(campaign(99), campaign(98));
}
