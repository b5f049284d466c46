//! Finished screens on the disk: an interrupted run takes up where it was.
//!
//! One text file for each set of conditions, named by their digest, so that runs of other conditions never
//! mix: a line `screen,case,strehl,variance_rad2` as soon as a screen is finished. Numbers are written
//! with as many digits as it takes to read them back exactly. A line that was cut short is dropped.

use super::budget::Case;
use super::point::Outcome;
use crate::error::Error;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;

/// What is known of each screen.
pub type Finished = BTreeMap<(u32, Case), Outcome>;

/// A file that grows with the run.
#[derive(Debug)]
pub struct Checkpoint {
    file: File,
    name: String,
    finished: Finished,
}

impl Checkpoint {
    /// Opens the file, or makes it, and reads what is there.
    ///
    /// # Errors
    /// [`Error::Run`] if it cannot be read or written, or holds a line that is none of this program's.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let name = path.display().to_string();
        let failed = |error: std::io::Error| Error::Run(format!("{name}: {error}"));
        let options = OpenOptions::new().read(true).append(true).create(true).clone();
        let file = options.open(path).map_err(failed)?;
        let text = std::fs::read_to_string(path).map_err(failed)?;
        let whole = whole(&text);
        file.set_len(whole.len() as u64).map_err(failed)?;
        let finished = parse_all(whole, &name)?;
        Ok(Self { file, name, finished })
    }

    /// What is in a file that may be growing; nothing if there is none.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn read(path: &Path) -> Result<Finished, Error> {
        let name = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) => parse_all(whole(&text), &name),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Finished::new()),
            Err(error) => Err(Error::Run(format!("{name}: {error}"))),
        }
    }

    /// What is known so far.
    pub fn finished(&self) -> &Finished {
        &self.finished
    }

    /// Adds the outcomes of a screen, in one piece.
    ///
    /// # Errors
    /// [`Error::Run`] if the file cannot be written.
    pub fn add(&mut self, screen: u32, outcomes: &[(Case, Outcome)]) -> Result<(), Error> {
        let line = |(case, outcome): &(Case, Outcome)| {
            let Outcome { strehl, variance_rad2 } = outcome;
            format!("{screen},{},{strehl},{variance_rad2}\n", case.name())
        };
        let lines: String = outcomes.iter().map(line).collect();
        let written = self.file.write_all(lines.as_bytes());
        written.map_err(|error| Error::Run(format!("{}: {error}", self.name)))?;
        let entries = outcomes.iter().map(|&(case, outcome)| ((screen, case), outcome));
        self.finished.extend(entries);
        Ok(())
    }
}

/// Only a line that ends was written as a whole.
fn whole(text: &str) -> &str {
    text.rfind('\n').map_or("", |end| &text[..=end])
}

fn parse_all(text: &str, name: &str) -> Result<Finished, Error> {
    let numbered = text.lines().enumerate().map(|(index, line)| {
        parse(line).ok_or_else(|| {
            Error::Run(format!(
                "{name}: line {}: {line:?} is not screen,case,strehl,variance_rad2; remove \
                 the file to start again",
                index + 1
            ))
        })
    });
    numbered.collect()
}

fn parse(line: &str) -> Option<((u32, Case), Outcome)> {
    let mut fields = line.split(',');
    let screen = fields.next()?.parse().ok()?;
    let case = Case::named(fields.next()?)?;
    let mut number = || fields.next()?.parse().ok();
    let outcome = Outcome { strehl: number()?, variance_rad2: number()? };
    fields.next().is_none().then_some(((screen, case), outcome))
}
