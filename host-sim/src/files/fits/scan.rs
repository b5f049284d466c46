//! Where the headers of a file are, and what they say of the data behind them.

use super::{BLOCK, CARD, FitsError, FitsReader, Header, padding};

/// No header of ours or of an observatory comes near this; it ends the search for END in garbage.
const MAX_HEADER_BLOCKS: usize = 1000;

/// A header and where its data are.
#[derive(Debug, Clone)]
pub struct Hdu {
    /// All cards with a value.
    pub header: Header,
    /// Lengths of the axes, fastest first: columns, rows, frames. Empty if there are no data.
    pub shape: Vec<usize>,
    /// EXTNAME, or empty.
    pub name: String,
    /// How error messages call it.
    pub(super) label: String,
    pub(super) bitpix: i64,
    pub(super) data_start: u64,
}

impl FitsReader {
    /// Reads the header at `start`; returns where the next one may begin, nothing at the end.
    pub(super) fn read_header(
        &mut self,
        start: u64,
        length: u64,
    ) -> Result<Option<u64>, FitsError> {
        let first = self.hdus.is_empty();
        let mut block = [0; BLOCK];
        // Whatever follows the last array and is not a header is allowed, and no concern of ours.
        if start + BLOCK as u64 > length {
            return if first { Err(self.not_fits()) } else { Ok(None) };
        }
        self.read_at(start, &mut block)?;
        match (first, block.starts_with(b"SIMPLE  ="), block.starts_with(b"XTENSION=")) {
            (true, true, _) | (false, _, true) => {}
            (true, ..) => return Err(self.not_fits()),
            (false, ..) => return Ok(None),
        }
        let mut hdu = Hdu {
            header: Header::new(),
            shape: Vec::new(),
            name: String::new(),
            label: match self.hdus.len() {
                0 => "primary array".into(),
                number => format!("extension {number}"),
            },
            bitpix: 0,
            data_start: start,
        };
        for _ in 0..MAX_HEADER_BLOCKS {
            hdu.data_start += BLOCK as u64;
            for card in block.as_chunks::<CARD>().0 {
                if card.trim_ascii_end() == b"END" {
                    return self.end_header(hdu, length).map(Some);
                }
                hdu.header.parse_card(card);
            }
            if hdu.data_start + BLOCK as u64 > length {
                break;
            }
            self.read_at(hdu.data_start, &mut block)?;
        }
        Err(FitsError::NoEnd { file: self.path.clone(), hdu: hdu.label })
    }

    /// Takes shape and type from the cards; returns where the data end, padding included.
    fn end_header(&mut self, mut hdu: Hdu, length: u64) -> Result<u64, FitsError> {
        if let Some(name) = hdu.header.text("EXTNAME") {
            hdu.name = name.into();
            hdu.label += &format!(" ({name})");
        }
        hdu.bitpix = match hdu.header.int("BITPIX") {
            Some(bitpix @ (8 | 16 | 32 | 64 | -32 | -64)) => bitpix,
            _ => return Err(self.keyword(&hdu, "BITPIX", "8, 16, 32, 64, -32 or -64")),
        };
        let Some(axes @ 0..=999) = hdu.header.int("NAXIS") else {
            return Err(self.keyword(&hdu, "NAXIS", "0 to 999"));
        };
        for axis in 1..=axes {
            let keyword = format!("NAXIS{axis}");
            match hdu.header.int(&keyword).map(usize::try_from) {
                Some(Ok(axis_length)) => hdu.shape.push(axis_length),
                _ => return Err(self.keyword(&hdu, &keyword, "a whole number, 0 or more")),
            }
        }
        let expected = self.data_bytes(&hdu)?;
        let found = length - hdu.data_start;
        if found < expected {
            let (file, hdu) = (self.path.clone(), hdu.label);
            return Err(FitsError::Truncated { file, hdu, expected, found });
        }
        let end = hdu.data_start + expected + padding(expected) as u64;
        self.hdus.push(hdu);
        Ok(end)
    }

    /// Bytes of data that the header announces, without padding.
    fn data_bytes(&self, hdu: &Hdu) -> Result<u64, FitsError> {
        if hdu.shape.is_empty() {
            return Ok(0);
        }
        let count = |keyword, absent| match hdu.header.get(keyword) {
            None => Some(absent),
            Some(_) => hdu.header.int(keyword).and_then(|value| u64::try_from(value).ok()),
        };
        let bytes = |groups: u64, heap: u64| {
            let axes = hdu
                .shape
                .iter()
                .try_fold(1_u64, |product, &length| product.checked_mul(length as u64))?;
            axes.checked_add(heap)?
                .checked_mul(groups)?
                .checked_mul(hdu.bitpix.unsigned_abs() / 8)
                // A multiple of the block beyond it must be countable as well.
                .filter(|&bytes| bytes < i64::MAX as u64)
        };
        let groups = count("GCOUNT", 1).ok_or_else(|| self.keyword(hdu, "GCOUNT", "1"))?;
        let heap = count("PCOUNT", 0).ok_or_else(|| self.keyword(hdu, "PCOUNT", "0 or more"))?;
        bytes(groups, heap).ok_or_else(|| self.keyword(hdu, "NAXIS1", "a size below 2^63 bytes"))
    }

    fn not_fits(&self) -> FitsError {
        FitsError::NotFits { file: self.path.clone() }
    }
}
