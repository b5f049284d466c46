//! A command that says no.

use crate::common;
use std::path::Path;

/// Runs it and expects `code`, nothing on stdout, and one line on stderr in which `words` are found.
pub(crate) fn fails(command: &str, place: &Path, arguments: &[&str], code: i32, words: &[&str]) {
    let output = common::run(command, place, "2", arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    assert!(output.stdout.is_empty() && error.lines().count() == 1, "{arguments:?}: {error}");
    for word in words {
        assert!(error.contains(word), "{arguments:?}: no {word:?} in {error}");
    }
}
