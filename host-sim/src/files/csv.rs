//! Series of numbers as CSV, with a header line that names each column and its unit:
//! `time_s,strehl,variance_rad2`.

use std::fs::File;
use std::path::{Path, PathBuf};

/// Why a series could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CsvError {
    /// The file cannot be used, or a line has another number of fields than the first.
    #[error("{}: {source}", file.display())]
    Csv {
        /// The file.
        file: PathBuf,
        /// What is wrong, with the line where it applies.
        source: csv::Error,
    },
    /// A row was given with another number of values than there are columns.
    #[error("{}: {found} values given, expected {expected}, one per column", file.display())]
    Row {
        /// The file.
        file: PathBuf,
        /// Columns of the series.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// A field is not a number.
    #[error("{}: line {line}, column {column}: {found:?} is not a number", file.display())]
    NotANumber {
        /// The file.
        file: PathBuf,
        /// Line in the file, from 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// What stands there.
        found: String,
    },
}

/// Writes a series row by row.
#[derive(Debug)]
pub struct SeriesWriter {
    writer: csv::Writer<File>,
    path: PathBuf,
    columns: usize,
}

impl SeriesWriter {
    /// Creates the file and writes the header line.
    ///
    /// # Errors
    /// [`CsvError::Csv`] if the file cannot be written.
    pub fn create<C: AsRef<str>>(path: impl AsRef<Path>, columns: &[C]) -> Result<Self, CsvError> {
        let path = path.as_ref().to_path_buf();
        let create = || {
            let mut writer = csv::Writer::from_path(&path)?;
            writer.write_record(columns.iter().map(AsRef::as_ref))?;
            Ok(writer)
        };
        match create() {
            Ok(writer) => Ok(Self { writer, path, columns: columns.len() }),
            Err(source) => Err(CsvError::Csv { file: path, source }),
        }
    }

    /// Appends a row. Numbers are written with as many digits as it takes to read them back
    /// exactly; whole numbers without a point.
    ///
    /// # Errors
    /// [`CsvError::Row`] if it does not have one value per column, [`CsvError::Csv`].
    pub fn push(&mut self, row: &[f64]) -> Result<(), CsvError> {
        if row.len() != self.columns {
            let file = self.path.clone();
            return Err(CsvError::Row { file, expected: self.columns, found: row.len() });
        }
        let result = self.writer.write_record(row.iter().map(f64::to_string));
        result.map_err(|source| CsvError::Csv { file: self.path.clone(), source })
    }

    /// Brings everything to the disk; without it, errors of the last writes are lost.
    ///
    /// # Errors
    /// [`CsvError::Csv`].
    pub fn finish(mut self) -> Result<(), CsvError> {
        let result = self.writer.flush();
        result.map_err(|error| CsvError::Csv { file: self.path, source: error.into() })
    }
}

/// A series as read.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Names of the columns, units included.
    pub columns: Vec<String>,
    /// One vector per line, one value per column.
    pub rows: Vec<Vec<f64>>,
}

impl Series {
    /// Reads a file written by [`SeriesWriter`], or any CSV of numbers with a header line.
    ///
    /// # Errors
    /// [`CsvError::Csv`] if the file cannot be read or its lines differ in length,
    /// [`CsvError::NotANumber`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self, CsvError> {
        let file = path.as_ref();
        let csv_error = |source| CsvError::Csv { file: file.to_path_buf(), source };
        let mut reader = csv::Reader::from_path(file).map_err(csv_error)?;
        let columns: Vec<String> =
            reader.headers().map_err(csv_error)?.iter().map(String::from).collect();
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(csv_error)?;
            let line = record.position().map_or(0, csv::Position::line);
            let number = |(field, column): (&str, &String)| {
                field.trim().parse().map_err(|_| CsvError::NotANumber {
                    file: file.to_path_buf(),
                    line,
                    column: column.clone(),
                    found: field.into(),
                })
            };
            rows.push(record.iter().zip(&columns).map(number).collect::<Result<_, _>>()?);
        }
        Ok(Self { columns, rows })
    }

    /// The values of the column with this name.
    pub fn column(&self, name: &str) -> Option<Vec<f64>> {
        let index = self.columns.iter().position(|column| column == name)?;
        Some(self.rows.iter().map(|row| row[index]).collect())
    }
}
