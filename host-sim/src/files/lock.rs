//! One process for one directory.

use crate::error::Error;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::Path;

/// The file in a directory that is locked.
const NAME: &str = ".lock";

/// A directory that no other process writes to while this exists. The system unlocks it when the process
/// ends, however it ends.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

impl Lock {
    /// Locks `directory`, as what `holder` says and with the process's number.
    ///
    /// # Errors
    /// [`Error::Config`] that says who holds it, [`Error::Run`] if it cannot be locked at all.
    pub fn take(directory: &Path, holder: &str) -> Result<Self, Error> {
        let path = directory.join(NAME);
        let failed = |error: std::io::Error| Error::Run(format!("{}: {error}", path.display()));
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let mut file = options.open(&path).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {
                file.set_len(0).map_err(failed)?;
                let words = format!("{holder}, process {}", std::process::id());
                file.write_all(words.as_bytes()).map_err(failed)?;
                Ok(Self { _file: file })
            }
            Err(TryLockError::WouldBlock) => {
                let mut words = String::new();
                // Empty for a moment after it was locked; some systems do not let it be read.
                let known = file.read_to_string(&mut words).is_ok() && !words.is_empty();
                let holder = if known { &words } else { "another process" };
                Err(Error::Config(format!(
                    "--out {}: in use by {holder}: wait for it, or take another directory",
                    directory.display()
                )))
            }
            Err(TryLockError::Error(error)) => Err(failed(error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_at_a_time() {
        let place = tempfile::tempdir().unwrap();
        let first = Lock::take(place.path(), "host-sim first").unwrap();
        let error = Lock::take(place.path(), "host-sim second").unwrap_err();
        let holder = format!("in use by host-sim first, process {}:", std::process::id());
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains(&holder), "{error}");
        drop(first);
        let second = Lock::take(place.path(), "host-sim second").unwrap();
        let error = Lock::take(place.path(), "host-sim third").unwrap_err().to_string();
        assert!(error.contains("host-sim second") && !error.contains("first"), "{error}");
        drop(second);
    }
}
