//! The suite of named cases on the host: its digests are the golden ones, whatever the capacities and
//! whatever ran before. Boards compare theirs with the same file.
//!
//! `SPLASH_ACCEPT=1 cargo test -p splash-tests --test suite` rewrites `golden/suite.txt`.

use splash_firmware::error::Field;
use splash_suite::{BUFFER, MODES, PIXELS, WINDOWS, Workspace};
use splash_tests::{golden, with_big_stack};

fn lines<const M: usize, const P: usize, const B: usize, const K: usize>(
    workspace: &mut Workspace<M, P, B, K>,
) -> Vec<String> {
    let mut lines = Vec::new();
    workspace.run(&mut |line| lines.push(line.to_string())).expect("instruments that fit");
    lines
}

#[test]
fn every_stage_gives_its_golden_bits() {
    with_big_stack(|| {
        let lines = lines(&mut Box::new(Workspace::<WINDOWS, PIXELS, BUFFER, MODES>::new()));
        golden::check("suite", "host", &lines);
    });
}

#[test]
fn neither_capacities_nor_the_past_show() {
    with_big_stack(|| {
        let mut exact = Box::new(Workspace::<WINDOWS, PIXELS, BUFFER, MODES>::new());
        let first = lines(&mut exact);
        let again = lines(&mut exact);
        let large = lines(&mut Box::new(Workspace::<1600, 40_000, 4096, 30>::new()));
        for (what, lines) in [("a second time", again), ("with other capacities", large)] {
            assert_eq!(lines.len(), first.len(), "{what}");
            for (line, first) in lines.iter().zip(&first) {
                assert_eq!(line, first, "{what}");
            }
        }
    });
}

#[test]
fn a_suite_that_does_not_fit_says_so() {
    let mut small = Box::new(Workspace::<64, PIXELS, BUFFER, MODES>::new());
    let error = small.run(&mut |_| ()).expect_err("N = 16");
    assert_eq!((error.field, error.value), (Field::Across, 16.0));
}
