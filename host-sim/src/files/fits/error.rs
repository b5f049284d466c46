use std::path::PathBuf;

/// Why a FITS file could not be read or written.
///
/// `hdu` is where in the file: "primary array", or "extension 2 (TRUTH)".
#[derive(Debug, thiserror::Error)]
pub enum FitsError {
    /// The operating system refused: no such file, disk full.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file does not begin with `SIMPLE  =`.
    #[error("{}: not a FITS file (it does not begin with SIMPLE =)", file.display())]
    NotFits {
        /// The file.
        file: PathBuf,
    },
    /// The file ends before the data its header announces.
    #[error("{}: {hdu}: truncated, {found} bytes of data, expected {expected}", file.display())]
    Truncated {
        /// The file.
        file: PathBuf,
        /// Where in it.
        hdu: String,
        /// Bytes the header announces.
        expected: u64,
        /// Bytes there are.
        found: u64,
    },
    /// A keyword is missing or has an unexpected value.
    #[error("{}: {hdu}: {keyword} = {found}, expected {expected}", file.display())]
    Keyword {
        /// The file.
        file: PathBuf,
        /// Where in it.
        hdu: String,
        /// The keyword.
        keyword: String,
        /// Its value, or "(absent)".
        found: String,
        /// What it should be.
        expected: String,
    },
    /// A header has no END card.
    #[error("{}: {hdu}: the header has no END card", file.display())]
    NoEnd {
        /// The file.
        file: PathBuf,
        /// Where in it.
        hdu: String,
    },
    /// The file has no such array.
    #[error("{}: no array {array} (there are: {found})", file.display())]
    NoSuchArray {
        /// The file.
        file: PathBuf,
        /// The name or number asked for.
        array: String,
        /// Those there are.
        found: String,
    },
    /// The bytes of a text array are not UTF-8.
    #[error("{}: {hdu}: not UTF-8 text", file.display())]
    NotText {
        /// The file.
        file: PathBuf,
        /// Where in it.
        hdu: String,
    },
    /// The data given do not fill the shape given.
    #[error("{}: {hdu}: {found} values given, expected {expected}", file.display())]
    Size {
        /// The file.
        file: PathBuf,
        /// Where in it.
        hdu: String,
        /// Values the shape asks for.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// A header card cannot be written.
    #[error("{}: {hdu}: keyword {keyword:?} cannot be written: {reason}", file.display())]
    Card {
        /// The file.
        file: PathBuf,
        /// Where in it.
        hdu: String,
        /// The keyword.
        keyword: String,
        /// What is wrong with it.
        reason: &'static str,
    },
}
