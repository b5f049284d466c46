//! Binary tables: columns of numbers and text, one or several in a row.

use super::header::{Value, render_card};

/// A column.
#[derive(Clone, Debug)]
pub struct Column<'a> {
    /// Its name: printable ASCII.
    pub name: &'a str,
    /// The unit of its scaled values, or empty.
    pub unit: &'a str,
    /// Values are the stored numbers times this.
    pub scale: f64,
    /// The stored numbers, row after row.
    pub values: Values,
}

/// The values of a column.
#[derive(Clone, Debug)]
pub enum Values {
    /// T or F.
    Bool(Vec<bool>),
    /// 32-bit numbers.
    I32(Vec<i32>),
    /// 64-bit numbers.
    I64(Vec<i64>),
    /// Double precision.
    F64(Vec<f64>),
    /// Text, one a row; what is not printable ASCII is written as a question mark.
    Text(Vec<String>),
}

impl<'a> Column<'a> {
    /// One with unit and scale.
    pub fn new(name: &'a str, unit: &'a str, scale: f64, values: Values) -> Self {
        Self { name, unit, scale, values }
    }

    /// One of plain numbers or words.
    pub fn plain(name: &'a str, values: Values) -> Self {
        Self::new(name, "", 1.0, values)
    }
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Self::Bool(values) => values.len(),
            Self::I32(values) => values.len(),
            Self::I64(values) => values.len(),
            Self::F64(values) => values.len(),
            Self::Text(values) => values.len(),
        }
    }

    /// TFORM's letter, and bytes of a value.
    fn form(&self) -> (char, usize) {
        match self {
            Self::Bool(_) => ('L', 1),
            Self::I32(_) => ('J', 4),
            Self::I64(_) => ('K', 8),
            Self::F64(_) => ('D', 8),
            Self::Text(texts) => ('A', texts.iter().map(String::len).max().unwrap_or(0).max(1)),
        }
    }

    /// Appends the values of a range as stored.
    fn encode(&self, range: std::ops::Range<usize>, bytes: &mut Vec<u8>) {
        match self {
            Self::Bool(values) => {
                bytes.extend(values[range].iter().map(|&value| if value { b'T' } else { b'F' }));
            }
            Self::I32(values) => {
                values[range].iter().for_each(|value| bytes.extend(value.to_be_bytes()));
            }
            Self::I64(values) => {
                values[range].iter().for_each(|value| bytes.extend(value.to_be_bytes()));
            }
            Self::F64(values) => {
                values[range].iter().for_each(|value| bytes.extend(value.to_be_bytes()));
            }
            Self::Text(values) => {
                let (_, width) = self.form();
                for text in &values[range] {
                    let printable =
                        |byte: u8| if (0x20..=0x7e).contains(&byte) { byte } else { b'?' };
                    let end = bytes.len() + width;
                    bytes.extend(text.bytes().map(printable));
                    bytes.resize(end, b' ');
                }
            }
        }
    }
}

/// Columns that have as many values for every row.
pub(super) struct Layout<'a> {
    rows: usize,
    columns: &'a [Column<'a>],
}

impl<'a> Layout<'a> {
    /// The columns as a table, or how many values one has, expected first.
    pub(super) fn new(rows: usize, columns: &'a [Column<'a>]) -> Result<Self, (usize, usize)> {
        for column in columns {
            let found = column.values.len();
            let text = matches!(column.values, Values::Text(_));
            let expected = if text || rows == 0 { rows } else { found.next_multiple_of(rows) };
            if found != expected {
                return Err((expected, found));
            }
        }
        Ok(Self { rows, columns })
    }

    /// Values of a column in a row.
    fn repeat(&self, column: &Column<'_>) -> usize {
        column.values.len() / self.rows.max(1)
    }

    pub(super) fn row_bytes(&self) -> usize {
        self.columns.iter().map(|column| self.repeat(column) * column.values.form().1).sum()
    }

    /// The cards that describe the columns.
    pub(super) fn cards(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut card = |keyword: String, value: Value| {
            render_card(&keyword, &value, "", &mut bytes);
        };
        card("TFIELDS".into(), Value::Int(self.columns.len() as i64));
        for (i, column) in self.columns.iter().enumerate() {
            let (letter, width) = column.values.form();
            let repeat = if letter == 'A' { width } else { self.repeat(column) };
            let number = i + 1;
            card(format!("TTYPE{number}"), column.name.into());
            card(format!("TFORM{number}"), format!("{repeat}{letter}").into());
            if !column.unit.is_empty() {
                card(format!("TUNIT{number}"), column.unit.into());
            }
            if column.scale != 1.0 {
                card(format!("TSCAL{number}"), column.scale.into());
            }
        }
        bytes
    }

    /// The rows as stored.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.rows * self.row_bytes());
        for row in 0..self.rows {
            for column in self.columns {
                let repeat = self.repeat(column);
                column.values.encode(row * repeat..(row + 1) * repeat, &mut bytes);
            }
        }
        bytes
    }
}
