//! The fuzz targets without a fuzzer: the corpus, then random changes of it for some seconds each.
//!
//! `SPLASH_FUZZ_SECONDS=600 cargo test --release -p splash-tests --test fuzz -- --nocapture` takes ten
//! minutes for each; with a nightly toolchain, `tests/fuzz/run 600` does the same under coverage.

use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{RngSeed, TestError, TestRunner};
use splash_tests::fuzz::{TARGETS, Target, target};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Seconds for each target, if nobody asks for more.
const SECONDS: u64 = 2;
/// Longest input.
const LONGEST: usize = 4096;

/// A change of an input.
#[derive(Clone, Debug)]
enum Change {
    Set(Index, u8),
    Flip(Index, u8),
    Insert(Index, Vec<u8>),
    Remove(Index, Index),
    Repeat(Index, Index),
}

fn change() -> impl Strategy<Value = Change> {
    let byte = prop_oneof![any::<u8>(), Just(0), Just(1), Just(0x7f), Just(0x80), Just(0xff)];
    prop_oneof![
        (any::<Index>(), byte).prop_map(|(at, byte)| Change::Set(at, byte)),
        (any::<Index>(), 0..8u8).prop_map(|(at, bit)| Change::Flip(at, bit)),
        (any::<Index>(), prop::collection::vec(any::<u8>(), 1..16))
            .prop_map(|(at, bytes)| Change::Insert(at, bytes)),
        (any::<Index>(), any::<Index>()).prop_map(|(from, to)| Change::Remove(from, to)),
        (any::<Index>(), any::<Index>()).prop_map(|(from, to)| Change::Repeat(from, to)),
    ]
}

impl Change {
    fn apply(&self, bytes: &mut Vec<u8>) {
        if bytes.is_empty() {
            return bytes.push(0);
        }
        let length = bytes.len();
        let stretch = |from: &Index, to: &Index| {
            let (from, to) = (from.index(length), to.index(length));
            from.min(to)..from.max(to) + 1
        };
        match self {
            Self::Set(at, byte) => bytes[at.index(length)] = *byte,
            Self::Flip(at, bit) => bytes[at.index(length)] ^= 1 << bit,
            Self::Insert(at, new) => {
                let at = at.index(length);
                bytes.splice(at..at, new.iter().copied());
            }
            Self::Remove(from, to) => {
                bytes.drain(stretch(from, to));
            }
            Self::Repeat(from, to) => {
                let copy = bytes[stretch(from, to)].to_vec();
                bytes.extend(copy);
            }
        }
        bytes.truncate(LONGEST);
    }
}

/// The kept inputs of a target.
fn corpus(name: &str) -> Vec<Vec<u8>> {
    let folder: PathBuf = [env!("CARGO_MANIFEST_DIR"), "fuzz", "corpus", name].iter().collect();
    let entries =
        std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    files.sort();
    files.iter().map(|file| std::fs::read(file).expect("a file of the corpus")).collect()
}

fn fuzz(name: &str, target: Target, seconds: u64) {
    let corpus = corpus(name);
    assert!(!corpus.is_empty(), "{name} has no corpus");
    corpus.iter().for_each(|input| target(input));
    let inputs = (0..corpus.len() + 1, prop::collection::vec(change(), 1..24));
    let (start, mut runs) = (Instant::now(), 0u64);
    while start.elapsed() < Duration::from_secs(seconds) {
        let config = ProptestConfig {
            cases: 64,
            rng_seed: RngSeed::Fixed(runs),
            failure_persistence: None,
            ..ProptestConfig::default()
        };
        let outcome = TestRunner::new(config).run(&inputs, |(seed, changes)| {
            // One more than there are: from nothing.
            let mut bytes = corpus.get(seed).cloned().unwrap_or_default();
            changes.iter().for_each(|change| change.apply(&mut bytes));
            target(&bytes);
            Ok(())
        });
        if let Err(TestError::Fail(why, (seed, changes))) = outcome {
            let mut bytes = corpus.get(seed).cloned().unwrap_or_default();
            changes.iter().for_each(|change| change.apply(&mut bytes));
            let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.finding"));
            std::fs::write(&file, &bytes).expect("the finding can be kept");
            panic!("{name}: {why}; the input is in {}", file.display());
        }
        runs += 64;
    }
    println!("{name}: {} of the corpus, {runs} changed inputs in {seconds} s", corpus.len());
}

fn seconds() -> u64 {
    let given = std::env::var("SPLASH_FUZZ_SECONDS");
    given.map_or(SECONDS, |text| text.parse().expect("SPLASH_FUZZ_SECONDS is a number"))
}

#[test]
fn link() {
    fuzz("link", target("link"), seconds());
}

#[test]
fn modes() {
    fuzz("modes", target("modes"), seconds());
}

#[test]
fn rows() {
    fuzz("rows", target("rows"), seconds());
}

#[test]
fn upload() {
    fuzz("upload", target("upload"), seconds());
}

#[test]
fn every_target_is_run() {
    let mut names = TARGETS.map(|(name, _)| name);
    names.sort_unstable();
    assert_eq!(names, ["link", "modes", "rows", "upload"]);
}
