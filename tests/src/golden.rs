//! Golden values: what was computed when they were last accepted, one line each, `NAME DIGEST`.
//!
//! They lock the bits; what is right is for the other tests to say.

use std::collections::BTreeMap;
use std::path::PathBuf;

/// Compares lines with `golden/<file>.txt`, or writes them there if `SPLASH_ACCEPT` is 1. `source`
/// says what computed them.
///
/// # Panics
/// With every line that differs, lacks a golden value or is no longer computed, and with the command
/// that accepts them.
pub fn check(file: &str, source: &str, lines: &[String]) {
    let path: PathBuf =
        [env!("CARGO_MANIFEST_DIR"), "golden", &format!("{file}.txt")].iter().collect();
    if std::env::var_os("SPLASH_ACCEPT").is_some_and(|value| value == "1") {
        std::fs::write(&path, lines.join("\n") + "\n").expect("the golden file can be written");
        return;
    }
    let text = std::fs::read_to_string(&path).unwrap_or_default();
    let differences = differences(text.lines(), lines.iter().map(String::as_str));
    assert!(
        differences.is_empty(),
        "\n{}\n{source}: {} of {} differ. If that is meant:\n    \
         SPLASH_ACCEPT=1 cargo test -p splash-tests --test {file}\nand commit {}",
        differences.join("\n"),
        differences.len(),
        lines.len(),
        path.display()
    );
}

/// What is not as it was, in the order of `found`: of the stages of a case, the first is the cause.
fn differences<'a>(
    golden: impl Iterator<Item = &'a str>,
    found: impl Iterator<Item = &'a str>,
) -> Vec<String> {
    let mut golden: BTreeMap<&str, &str> =
        golden.filter_map(|line| line.rsplit_once(' ')).collect();
    let mut different = Vec::new();
    for (name, digest) in found.filter_map(|line| line.rsplit_once(' ')) {
        match golden.remove(name) {
            Some(golden) if golden == digest => (),
            Some(golden) => different.push(format!("{name}: {digest}, golden {golden}")),
            None => different.push(format!("{name}: {digest}, no golden value")),
        }
    }
    let gone = golden.into_keys().map(|name| format!("{name}: golden, but no longer computed"));
    different.extend(gone);
    different
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_difference_is_told() {
        let golden = ["a stage 1", "b stage 2", "c stage 3"];
        let found = ["a stage 1", "b stage 0", "d stage 4"];
        assert_eq!(differences(golden.into_iter(), golden.into_iter()), [""; 0]);
        assert_eq!(
            differences(golden.into_iter(), found.into_iter()),
            [
                "b stage: 0, golden 2",
                "d stage: 4, no golden value",
                "c stage: golden, but no longer computed"
            ]
        );
    }
}
