//! What a board logs, on standard error.

use defmt_decoder::{DecodeError, Table};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;
use std::sync::Arc;

/// What the bytes of a log are.
#[derive(Clone)]
pub enum Format {
    /// Lines.
    Text,
    /// Frames of defmt, of the program with this table.
    Defmt(Arc<Table>),
}

impl std::fmt::Debug for Format {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Text => "Text",
            Self::Defmt(_) => "Defmt",
        })
    }
}

impl Format {
    /// That of a program which logs by defmt; lines if it has no table.
    pub(super) fn of(elf: &[u8]) -> Self {
        match Table::parse(elf) {
            Ok(Some(table)) => Self::Defmt(Arc::new(table)),
            _ => Self::Text,
        }
    }
}

/// A log that grows.
pub(super) struct Log {
    board: &'static str,
    path: PathBuf,
    format: Format,
    /// Bytes of the file that were read.
    read: u64,
    /// The last line or frame, not yet complete.
    pending: Vec<u8>,
}

impl Log {
    pub(super) fn new(board: &'static str, path: PathBuf, format: Format) -> Self {
        Self { board, path, format, read: 0, pending: Vec::new() }
    }

    /// Shows what is new. A log that cannot be read is no reason to end a run.
    pub(super) fn show(&mut self) {
        let Ok(mut file) = File::open(&self.path) else { return };
        if file.seek(SeekFrom::Start(self.read)).is_err() {
            return;
        }
        self.read += file.read_to_end(&mut self.pending).unwrap_or(0) as u64;
        let end = match self.format {
            Format::Text => b'\n',
            Format::Defmt(_) => 0,
        };
        let Some(last) = self.pending.iter().rposition(|&byte| byte == end) else { return };
        let complete: Vec<u8> = self.pending.drain(..=last).collect();
        match &self.format {
            Format::Text => {
                let text = String::from_utf8_lossy(&complete);
                text.lines().for_each(|line| eprintln!("{}: {line}", self.board));
            }
            Format::Defmt(table) => show_frames(self.board, table, &complete),
        }
    }
}

fn show_frames(board: &str, table: &Table, bytes: &[u8]) {
    let mut decoder = table.new_stream_decoder();
    decoder.received(bytes);
    loop {
        match decoder.decode() {
            Ok(frame) => {
                let level = frame.level().map_or("", |level| level.as_str());
                eprintln!("{board}: {level} {}", frame.display_message());
            }
            Err(DecodeError::Malformed) => eprintln!("{board}: a log message that is no message"),
            Err(DecodeError::UnexpectedEof) => return,
        }
    }
}
