//! The store: whenever the power is cut, the configuration before or the new one is there, whole.

use host_sim::nor_flash::{Nor, NorError, PAGE};
use splash_firmware::config::Config;
use splash_firmware::image::ImageError;
use splash_firmware::mirror::Serials;
use splash_firmware::store::{Store, StoreError};
use splash_tests::frames::Rng;
use splash_tests::instrument::{Instrument, Values};

const SERIALS: Serials = Serials { mirror: 7, detector: 0xffff_fffe };

type Bank = Config<16, 256, 0>;

fn bank(gain: f64) -> Box<Bank> {
    let mut instrument = Instrument::circle(4, 4);
    instrument.control_gain = Values::Uniform(gain);
    instrument.config()
}

fn image(config: &Bank) -> Vec<u8> {
    let mut bytes = Vec::new();
    config.save(&mut |piece| bytes.extend_from_slice(piece));
    bytes
}

/// What is restored: its hash.
fn restored<const WORD: usize>(flash: Nor<WORD>) -> (Result<u32, StoreError<NorError>>, Nor<WORD>) {
    let (mut store, mut config) = (Store::new(flash), Box::new(Bank::new()));
    let restored = store.restore(&mut config).map(|stored| {
        assert_eq!(stored.hash, config.hash());
        config.hash()
    });
    (restored, store.into_inner())
}

#[test]
fn what_was_stored_last_is_restored() {
    let mut flash = Nor::<32>::new(4, 1, true);
    for i in 0..5 {
        let config = bank(0.1 + 0.1 * f64::from(i));
        let mut store = Store::new(flash);
        let stored = store.store(&config, SERIALS).expect("a good flash");
        assert_eq!((stored.sequence, stored.hash), (i as u32, config.hash()));
        assert_eq!(stored.serials, SERIALS);
        assert_eq!(store.newest_stored(), Ok(Some(stored)));
        let mut loaded = Box::new(Bank::new());
        store.restore(&mut loaded).expect("stored");
        assert!(image(&loaded) == image(&config));
        flash = store.into_inner();
    }
}

/// The power fails in every step of a store in turn, whatever the flash had in it, and again in a step
/// of the next one.
fn every_cut<const WORD: usize>(stride: usize) {
    let configs = [bank(0.2), bank(0.4), bank(0.6), bank(0.8)];
    let hashes = configs.each_ref().map(|config| config.hash());
    let prepared = |seed: u64| {
        // Two stores, so that both slots have been used.
        let mut store = Store::new(Nor::<WORD>::new(4, seed, false));
        store.store(&configs[0], SERIALS).expect("a good flash");
        store.store(&configs[1], SERIALS).expect("a good flash");
        store.into_inner()
    };
    let steps = {
        let mut flash = prepared(1);
        flash.taken = 0;
        let mut store = Store::new(flash);
        store.store(&configs[2], SERIALS).expect("a good flash");
        store.into_inner().taken
    };
    let words = image(&configs[2]).len().next_multiple_of(64) / WORD + 64 / WORD;
    assert_eq!(steps, words + 2, "each word of the image and of the header once, two pages");
    for first in 0..steps {
        let mut flash = prepared(first as u64);
        (flash.steps, flash.taken) = (Some(first), 0);
        let mut store = Store::new(flash);
        assert_eq!(store.store(&configs[2], SERIALS), Err(StoreError::Flash(NorError::PowerCut)));
        let mut flash = store.into_inner();
        assert!(flash.off());
        flash.steps = None;
        let (found, flash) = restored(flash);
        // The last word of a header that has more than one has nothing to program.
        let done = |step| step + 1 == steps && WORD < 64;
        let before = if done(first) { hashes[2] } else { hashes[1] };
        assert_eq!(found, Ok(before), "cut in step {first}");

        for second in (first % stride..steps).step_by(stride) {
            let mut again = flash.clone();
            (again.steps, again.taken) = (Some(second), 0);
            let mut store = Store::new(again);
            assert!(store.store(&configs[3], SERIALS).is_err());
            let mut again = store.into_inner();
            again.steps = None;
            let (found, again) = restored(again);
            let before = if done(second) { hashes[3] } else { before };
            assert_eq!(found, Ok(before), "cut in steps {first} and {second}");
            let mut store = Store::new(again);
            store.store(&configs[3], SERIALS).expect("with power");
            assert_eq!(restored(store.into_inner()).0, Ok(hashes[3]));
        }
    }
    // Behind the last step it is the new one.
    let mut flash = prepared(9);
    flash.steps = Some(steps);
    let mut store = Store::new(flash);
    store.store(&configs[2], SERIALS).expect("power for all of it");
    assert_eq!(restored(store.into_inner()).0, Ok(hashes[2]));
}

#[test]
fn a_power_cut_in_any_step_loses_nothing() {
    every_cut::<32>(11);
    every_cut::<64>(5);
}

/// The first store of all: until it is done there is nothing, and no ghost of what the flash had.
#[test]
fn a_power_cut_in_the_first_store_leaves_nothing() {
    let config = bank(0.5);
    for blank in [true, false] {
        for steps in 0.. {
            let mut flash = Nor::<64>::new(4, steps as u64, blank);
            flash.steps = Some(steps);
            let mut store = Store::new(flash);
            let stored = store.store(&config, SERIALS);
            let mut flash = store.into_inner();
            flash.steps = None;
            let (found, _) = restored(flash);
            if stored.is_ok() {
                assert_eq!(found, Ok(config.hash()));
                break;
            }
            assert_eq!(found, Err(StoreError::Nothing));
        }
    }
}

/// One wrong bit anywhere in the newer slot: the older one is restored.
#[test]
fn a_decayed_slot_is_passed_over() {
    let (older, newer) = (bank(0.3), bank(0.7));
    let mut store = Store::new(Nor::<32>::new(4, 3, true));
    store.store(&older, SERIALS).expect("a good flash");
    let length = store.store(&newer, SERIALS).expect("a good flash").length as usize;
    let mut flash = store.into_inner();
    let mut rng = Rng::new(4);
    for place in 0..64 + length {
        let bit = 1 << rng.below(8);
        flash.bytes[2 * PAGE + place] ^= bit;
        let (found, back) = restored(flash);
        flash = back;
        assert_eq!(found, Ok(older.hash()), "byte {place}");
        flash.bytes[2 * PAGE + place] ^= bit;
    }
    assert_eq!(restored(flash).0, Ok(newer.hash()));
}

#[test]
fn refusals_say_why() {
    let config = bank(0.5);
    let mut store = Store::new(Nor::<32>::new(4, 5, true));
    assert_eq!(store.newest_stored(), Ok(None));
    assert_eq!(store.store(&Bank::new(), SERIALS), Err(StoreError::NotConfigured));
    let large: Box<Config<64, 8192, 0>> = Instrument::circle(8, 8).config();
    let found = large.image_bytes() as u32 + 64;
    let slot = 2 * PAGE as u32;
    assert_eq!(store.store(&large, SERIALS), Err(StoreError::Long { found, slot }));
    store.store(&config, SERIALS).expect("a good flash");
    let mut small = Box::new(Config::<16, 64, 0>::new());
    let unfit = store.restore(&mut small);
    assert!(matches!(unfit, Err(StoreError::Image(ImageError::Refused(_)))), "{unfit:?}");
}
