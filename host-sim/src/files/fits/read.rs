use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use super::checksum::Sum;
use super::scan::Hdu;
use super::{FitsError, Sample, Value};

/// Largest frame of a cube.
const MAX_FRAME_PIXELS: usize = 1 << 31;

/// Reads a FITS file: every header is read and checked when it is opened, data when asked for.
///
/// Arrays are counted from 0, the primary array. Extensions that are not images (tables) keep
/// their place in the count but cannot be read.
#[derive(Debug)]
pub struct FitsReader {
    file: BufReader<File>,
    pub(super) path: PathBuf,
    pub(super) hdus: Vec<Hdu>,
}

/// Reads the frames of a cube one by one.
#[derive(Debug)]
pub struct CubeReader<'a, T> {
    file: &'a mut FitsReader,
    /// How error messages call it.
    label: String,
    /// Columns, rows, frames.
    shape: [usize; 3],
    /// Frames read so far.
    read: usize,
    /// Where the next frame starts, bytes.
    next: u64,
    /// A frame as stored.
    bytes: Vec<u8>,
    _sample: PhantomData<T>,
}

impl FitsReader {
    /// Opens a file and reads its headers.
    ///
    /// # Errors
    /// [`FitsError::Io`], [`FitsError::NotFits`], [`FitsError::NoEnd`], [`FitsError::Keyword`] for a
    /// header that contradicts the standard, [`FitsError::Truncated`] if data are missing.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, FitsError> {
        let path = path.as_ref().to_path_buf();
        let open = || {
            let file = File::open(&path)?;
            let length = file.metadata()?.len();
            Ok((BufReader::new(file), length))
        };
        let (file, length) =
            open().map_err(|source| FitsError::Io { file: path.clone(), source })?;
        let mut reader = Self { file, path, hdus: Vec::new() };
        let mut start = 0;
        while let Some(end) = reader.read_header(start, length)? {
            start = end;
        }
        Ok(reader)
    }

    /// Headers and shapes of all arrays.
    pub fn hdus(&self) -> &[Hdu] {
        &self.hdus
    }

    /// The number of the array with this name.
    ///
    /// # Errors
    /// [`FitsError::NoSuchArray`], which lists the names there are.
    pub fn find(&self, name: &str) -> Result<usize, FitsError> {
        self.hdus.iter().position(|hdu| hdu.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.hdus.iter().map(|hdu| hdu.name.as_str()).collect();
            let (file, array) = (self.path.clone(), format!("{name:?}"));
            FitsError::NoSuchArray { file, array, found: names.join(", ") }
        })
    }

    /// Shape and numbers of an array.
    ///
    /// # Errors
    /// [`FitsError::Keyword`] if the array does not exist or is not of this type,
    /// [`FitsError::Io`].
    pub fn image<T: Sample>(&mut self, array: usize) -> Result<(Vec<usize>, Vec<T>), FitsError> {
        let hdu = self.expect::<T>(array)?;
        let (shape, start) = (hdu.shape.clone(), hdu.data_start);
        let count = if shape.is_empty() { 0 } else { shape.iter().product() };
        let mut numbers = vec![T::default(); count];
        let mut bytes = vec![0; count * T::BYTES];
        self.read_at(start, &mut bytes)?;
        T::decode(&bytes, &mut numbers);
        Ok((shape, numbers))
    }

    /// The text of an array written by [`FitsWriter::text`](super::FitsWriter::text).
    ///
    /// # Errors
    /// As [`FitsReader::image`], and [`FitsError::NotText`] if the bytes are not UTF-8.
    pub fn text(&mut self, array: usize) -> Result<String, FitsError> {
        let (_, bytes) = self.image::<u8>(array)?;
        String::from_utf8(bytes).map_err(|_| FitsError::NotText {
            file: self.path.clone(),
            hdu: self.hdus[array].label.clone(),
        })
    }

    /// Compares the data of every array that has a DATASUM with it.
    ///
    /// # Errors
    /// [`FitsError::Keyword`] naming the first array whose data are not those that were written,
    /// [`FitsError::Io`].
    pub fn verify(&mut self) -> Result<(), FitsError> {
        const CHUNK: usize = 1 << 20;
        let mut bytes = vec![0; CHUNK];
        for array in 0..self.hdus.len() {
            let hdu = &self.hdus[array];
            let Some(written) = hdu.header.text("DATASUM").map(str::to_owned) else { continue };
            let samples: usize = if hdu.shape.is_empty() { 0 } else { hdu.shape.iter().product() };
            let length = samples * (hdu.bitpix.unsigned_abs() / 8) as usize;
            let start = hdu.data_start;
            let mut sum = Sum::default();
            for offset in (0..length).step_by(CHUNK) {
                let part = &mut bytes[..CHUNK.min(length - offset)];
                self.read_at(start + offset as u64, part)?;
                sum.add(part);
            }
            // Padding is zeros for numbers, which a sum does not see.
            if written.trim() != sum.value().to_string() {
                let expected = format!("{}, the sum of the data", sum.value());
                return Err(self.keyword(&self.hdus[array], "DATASUM", &expected));
            }
        }
        Ok(())
    }

    /// Begins to read the frames of a cube.
    ///
    /// # Errors
    /// [`FitsError::Keyword`] if the array does not exist, is not of this type or does not have
    /// three axes.
    pub fn cube<T: Sample>(&mut self, array: usize) -> Result<CubeReader<'_, T>, FitsError> {
        let hdu = self.expect::<T>(array)?;
        let Ok(shape) = <[usize; 3]>::try_from(hdu.shape.as_slice()) else {
            return Err(self.keyword(hdu, "NAXIS", "3 (column, row, frame)"));
        };
        // A cube without frames may claim any size of them, and callers make room for one.
        if shape[0].checked_mul(shape[1]).is_none_or(|pixels| pixels > MAX_FRAME_PIXELS) {
            return Err(self.keyword(hdu, "NAXIS1", "a frame of at most 2^31 pixels"));
        }
        let (label, next) = (hdu.label.clone(), hdu.data_start);
        Ok(CubeReader {
            file: self,
            label,
            shape,
            read: 0,
            next,
            bytes: Vec::new(),
            _sample: PhantomData,
        })
    }

    /// The array, if it is there and holds numbers of type `T`.
    fn expect<T: Sample>(&self, array: usize) -> Result<&Hdu, FitsError> {
        let Some(hdu) = self.hdus.get(array) else {
            return Err(FitsError::NoSuchArray {
                file: self.path.clone(),
                array: format!("number {array}"),
                found: format!("0 to {}", self.hdus.len() - 1),
            });
        };
        if hdu.header.text("XTENSION").is_some_and(|kind| kind != "IMAGE") {
            return Err(self.keyword(hdu, "XTENSION", "'IMAGE'"));
        }
        if hdu.bitpix != T::BITPIX {
            return Err(self.keyword(hdu, "BITPIX", T::BITPIX));
        }
        let bzero = T::BZERO.unwrap_or(0);
        // Absent, they are 0, 1, 0 and 1; the last two also make the shape the size of the data.
        let defaults = [("BZERO", bzero, 0), ("BSCALE", 1, 1), ("PCOUNT", 0, 0), ("GCOUNT", 1, 1)];
        for (keyword, expected, absent) in defaults {
            let found = match hdu.header.get(keyword) {
                None => Some(f64::from(absent)),
                Some(_) => hdu.header.float(keyword),
            };
            if found != Some(expected as f64) {
                return Err(self.keyword(hdu, keyword, expected));
            }
        }
        Ok(hdu)
    }

    pub(super) fn keyword(&self, hdu: &Hdu, keyword: &str, expected: impl ToString) -> FitsError {
        FitsError::Keyword {
            file: self.path.clone(),
            hdu: hdu.label.clone(),
            keyword: keyword.into(),
            found: hdu.header.get(keyword).map_or("(absent)".into(), Value::to_string),
            expected: expected.to_string(),
        }
    }

    pub(super) fn read_at(&mut self, start: u64, bytes: &mut [u8]) -> Result<(), FitsError> {
        self.file
            .seek(SeekFrom::Start(start))
            .and_then(|_| self.file.read_exact(bytes))
            .map_err(|source| FitsError::Io { file: self.path.clone(), source })
    }
}

impl<T: Sample> CubeReader<'_, T> {
    /// Columns and rows of a frame.
    pub fn frame_shape(&self) -> [usize; 2] {
        [self.shape[0], self.shape[1]]
    }

    /// Frames of the cube.
    pub fn frames(&self) -> usize {
        self.shape[2]
    }

    /// Reads the next frame, row-major, into `frame`; false if there is none left.
    ///
    /// # Errors
    /// [`FitsError::Size`] if `frame` does not have columns x rows numbers, [`FitsError::Io`].
    pub fn next_frame(&mut self, frame: &mut [T]) -> Result<bool, FitsError> {
        if self.read == self.shape[2] {
            return Ok(false);
        }
        let expected = self.shape[0] * self.shape[1];
        if frame.len() != expected {
            let (file, hdu) = (self.file.path.clone(), self.label.clone());
            return Err(FitsError::Size { file, hdu, expected, found: frame.len() });
        }
        self.bytes.resize(expected * T::BYTES, 0);
        self.file.read_at(self.next, &mut self.bytes)?;
        T::decode(&self.bytes, frame);
        self.read += 1;
        self.next += self.bytes.len() as u64;
        Ok(true)
    }
}
