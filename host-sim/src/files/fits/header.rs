use std::fmt;

use super::CARD;

/// The value of a header card.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// T or F.
    Bool(bool),
    /// A whole number.
    Int(i64),
    /// A finite number.
    Float(f64),
    /// Printable ASCII text of up to 68 characters, a quote counting twice.
    Text(String),
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(true) => f.write_str("T"),
            Self::Bool(false) => f.write_str("F"),
            Self::Int(value) => value.fmt(f),
            Self::Float(value) => f.write_str(&float(*value)),
            Self::Text(value) => write!(f, "'{value}'"),
        }
    }
}

macro_rules! value_from {
    ($($type:ty => $variant:ident),*) => {
        $(impl From<$type> for Value {
            fn from(value: $type) -> Self {
                Self::$variant(value.into())
            }
        })*
    };
}
value_from!(bool => Bool, i32 => Int, u32 => Int, i64 => Int, f64 => Float, &str => Text, String => Text);

/// The cards of a header, in order: keyword, value, comment.
///
/// A header to be written is built with [`Header::with`]; units go in square brackets at the start
/// of the comment (`[m] telescope diameter`), those of the array itself into `BUNIT`. Cards that
/// describe the array (NAXIS, EXTNAME, CHECKSUM ...) are added when it is written.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Header {
    cards: Vec<(String, Value, String)>,
}

/// Keywords that only the writer sets, because they must agree with the data.
const RESERVED: [&str; 14] = [
    "SIMPLE", "XTENSION", "BITPIX", "EXTEND", "PCOUNT", "GCOUNT", "GROUPS", "BZERO", "BSCALE",
    "BLANK", "EXTNAME", "CHECKSUM", "DATASUM", "END",
];

impl Header {
    /// A header without cards.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a card; keyword, value and comment are checked when the header is written.
    ///
    /// A keyword has up to 8 characters out of A-Z, 0-9, - and _. A comment that does not fit
    /// behind the value is cut.
    #[must_use]
    pub fn with(mut self, keyword: &str, value: impl Into<Value>, comment: &str) -> Self {
        self.cards.push((keyword.into(), value.into(), comment.into()));
        self
    }

    /// The value of the first card with this keyword.
    pub fn get(&self, keyword: &str) -> Option<&Value> {
        self.cards.iter().find(|(found, ..)| found == keyword).map(|(_, value, _)| value)
    }

    /// The value as a whole number.
    pub fn int(&self, keyword: &str) -> Option<i64> {
        match self.get(keyword) {
            Some(Value::Int(value)) => Some(*value),
            _ => None,
        }
    }

    /// The value as a number, whole or not.
    pub fn float(&self, keyword: &str) -> Option<f64> {
        match self.get(keyword) {
            Some(Value::Int(value)) => Some(*value as f64),
            Some(Value::Float(value)) => Some(*value),
            _ => None,
        }
    }

    /// The value as text.
    pub fn text(&self, keyword: &str) -> Option<&str> {
        match self.get(keyword) {
            Some(Value::Text(value)) => Some(value),
            _ => None,
        }
    }

    /// Keyword, value and comment of every card, in order.
    pub fn cards(&self) -> impl Iterator<Item = (&str, &Value, &str)> {
        self.cards.iter().map(|(keyword, value, comment)| (&**keyword, value, &**comment))
    }

    /// Appends the cards as they stand in the file, or says which keyword is wrong and why.
    pub(super) fn render(&self, bytes: &mut Vec<u8>) -> Result<(), (String, &'static str)> {
        for (keyword, value, comment) in &self.cards {
            let reason = |reason| (keyword.clone(), reason);
            let of_columns = ["TFIELDS", "TTYPE", "TFORM", "TUNIT", "TSCAL", "TZERO"];
            let reserved = |start: &&str| keyword.starts_with(*start);
            if RESERVED.contains(&keyword.as_str())
                || keyword.starts_with("NAXIS")
                || of_columns.iter().any(reserved)
            {
                return Err(reason("it describes the array and is set by the writer"));
            }
            check(keyword, value, comment).map_err(reason)?;
            render_card(keyword, value, comment, bytes);
        }
        Ok(())
    }

    /// Reads one card; commentary cards and cards without a value are left out.
    ///
    /// A value of no FITS kind is kept as text, so that an error can show it.
    pub(super) fn parse_card(&mut self, card: &[u8; CARD]) {
        let (keyword, rest) = card.split_at(8);
        let Some(field) = rest.strip_prefix(b"= ") else { return };
        let field = String::from_utf8_lossy(field);
        if let Some((value, comment)) = parse_value(field.trim_start()) {
            let keyword = String::from_utf8_lossy(keyword);
            self.cards.push((keyword.trim_end().into(), value, comment.trim().into()));
        }
    }
}

fn check(keyword: &str, value: &Value, comment: &str) -> Result<(), &'static str> {
    let allowed = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || "-_".contains(c);
    if keyword.is_empty() || keyword.len() > 8 || !keyword.chars().all(allowed) {
        return Err("a keyword is 1 to 8 characters of A-Z, 0-9, - and _");
    }
    let printable = |text: &str| text.bytes().all(|byte| (0x20..=0x7e).contains(&byte));
    if !printable(comment) {
        return Err("the comment is not printable ASCII");
    }
    match value {
        Value::Text(text) if !printable(text) => Err("the text is not printable ASCII"),
        Value::Text(text) if text.len() + text.matches('\'').count() > 68 => {
            Err("the text is longer than 68 characters")
        }
        Value::Float(number) if !number.is_finite() => Err("the number is not finite"),
        _ => Ok(()),
    }
}

/// Appends one card in the standard's fixed format, without checks.
pub(super) fn render_card(keyword: &str, value: &Value, comment: &str, bytes: &mut Vec<u8>) {
    let value = match value {
        // Texts start in column 11 and have at least 8 characters between their quotes.
        Value::Text(text) => format!("{:<20}", format!("'{:<8}'", text.replace('\'', "''"))),
        other => format!("{:>20}", other.to_string()),
    };
    let mut card = format!("{keyword:<8}= {value}");
    if !comment.is_empty() {
        card += " / ";
        card += comment;
    }
    card.truncate(CARD);
    bytes.extend(format!("{card:<CARD$}").bytes());
}

/// The shortest decimal that reads back as the same number, with the point FITS readers like.
fn float(value: f64) -> String {
    let text = format!("{value:?}").replace('e', "E");
    match text.split_once('E') {
        Some((digits, exponent)) if !digits.contains('.') => format!("{digits}.0E{exponent}"),
        _ => text,
    }
}

/// Value and comment of what follows `= `; nothing if there is no value.
fn parse_value(field: &str) -> Option<(Value, &str)> {
    if let Some(quoted) = field.strip_prefix('\'') {
        let mut text = String::new();
        let mut rest = quoted;
        while let Some((part, after)) = rest.split_once('\'') {
            text += part;
            rest = after;
            let Some(after_pair) = rest.strip_prefix('\'') else { break };
            text.push('\'');
            rest = after_pair;
        }
        let comment = rest.split_once('/').map_or("", |(_, comment)| comment);
        return Some((Value::Text(text.trim_end().into()), comment));
    }
    let (value, comment) = field.split_once('/').unwrap_or((field, ""));
    let value = match value.trim() {
        "" => return None,
        "T" => Value::Bool(true),
        "F" => Value::Bool(false),
        number => number
            .parse()
            .map(Value::Int)
            .or_else(|_| number.replace(['D', 'd'], "E").parse().map(Value::Float))
            .unwrap_or_else(|_| Value::Text(number.into())),
    };
    Some((value, comment))
}
