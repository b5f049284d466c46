use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use super::checksum::{self, Sum};
use super::header::{Value, render_card};
use super::table::{self, Column};
use super::{BLOCK, FitsError, Header, Sample, padding};

/// Writes a FITS file, array after array; the first one becomes the primary array.
///
/// ```
/// # use host_sim::files::fits::{FitsReader, FitsWriter, Header};
/// # let path = std::env::temp_dir().join("splash-doc-write.fits");
/// let header = Header::new().with("BUNIT", "ADU", "").with("GAIN", 4.0, "[e-/ADU] gain");
/// let mut frames = FitsWriter::create(&path)?.cube::<u16>("FRAMES", [3, 2], &header)?;
/// frames.push(&[0, 1, 2, 3, 4, 65535])?;
/// let mut file = frames.finish()?;
/// file.text("CONFIG", "n = 8\n")?;
/// file.finish()?;
///
/// let mut file = FitsReader::open(&path)?;
/// assert_eq!(file.cube::<u16>(0)?.frames(), 1);
/// assert_eq!(file.text(file.find("CONFIG")?)?, "n = 8\n");
/// # std::fs::remove_file(&path).unwrap();
/// # Ok::<(), host_sim::files::fits::FitsError>(())
/// ```
#[derive(Debug)]
pub struct FitsWriter {
    file: BufWriter<File>,
    path: PathBuf,
    /// Arrays written so far.
    arrays: usize,
    /// Stored numbers on their way out; kept to save an allocation per frame.
    bytes: Vec<u8>,
}

/// Appends the frames of a cube; [`CubeWriter::finish`] then enters their number in the header.
///
/// A cube that is never finished (the run failed) keeps NAXIS3 = 0: a valid file without frames.
#[derive(Debug)]
pub struct CubeWriter<T> {
    file: FitsWriter,
    array: OpenArray,
    frames: usize,
    _sample: PhantomData<T>,
}

/// An array whose header is written again when its size and checksum are known.
#[derive(Debug)]
struct OpenArray {
    /// How error messages call it.
    hdu: String,
    /// Where its header starts, bytes.
    start: u64,
    /// BITPIX, BZERO.
    kind: (i64, Option<i64>),
    shape: Vec<usize>,
    /// The cards of a table's columns; `None` for an image.
    columns: Option<Vec<u8>>,
    name: String,
    /// The caller's cards, as they stand in the file.
    cards: Vec<u8>,
    sum: Sum,
    data_bytes: u64,
}

impl FitsWriter {
    /// Creates the file, or empties it.
    ///
    /// # Errors
    /// [`FitsError::Io`].
    pub fn create(path: impl AsRef<Path>) -> Result<Self, FitsError> {
        let path = path.as_ref().to_path_buf();
        match File::create(&path) {
            Ok(file) => Ok(Self { file: BufWriter::new(file), path, arrays: 0, bytes: Vec::new() }),
            Err(source) => Err(FitsError::Io { file: path, source }),
        }
    }

    /// Writes an array of one to three axes, `shape` fastest first, under the name `name`.
    ///
    /// # Errors
    /// [`FitsError::Size`] if `data` does not fill the shape, [`FitsError::Card`] if the name or a
    /// card cannot be written, [`FitsError::Io`].
    pub fn image<T: Sample>(
        &mut self,
        name: &str,
        shape: &[usize],
        header: &Header,
        data: &[T],
    ) -> Result<(), FitsError> {
        let mut array = self.begin::<T>(name, shape, header, None)?;
        self.append(&mut array, shape.iter().product(), data)?;
        self.end(array)
    }

    /// Writes a table of `rows` rows, which may not be the first array of a file.
    ///
    /// # Errors
    /// [`FitsError::Size`] if a column has not as many values for every row, [`FitsError::Card`] if a
    /// name or a card cannot be written or the table is the first array, [`FitsError::Io`].
    pub fn table(
        &mut self,
        name: &str,
        rows: usize,
        columns: &[Column<'_>],
        header: &Header,
    ) -> Result<(), FitsError> {
        let (file, hdu) = (self.path.clone(), format!("table {name:?}"));
        if self.arrays == 0 {
            let (keyword, reason) = ("XTENSION".into(), "a table may not be the first array");
            return Err(FitsError::Card { file, hdu, keyword, reason });
        }
        let table = table::Layout::new(rows, columns)
            .map_err(|(expected, found)| FitsError::Size { file, hdu, expected, found })?;
        let cards = table.cards();
        let mut array = self.begin::<u8>(name, &[table.row_bytes(), rows], header, Some(cards))?;
        let bytes = table.bytes();
        self.append(&mut array, bytes.len(), &bytes)?;
        self.end(array)
    }

    /// Writes text as an array of its UTF-8 bytes.
    ///
    /// # Errors
    /// As [`FitsWriter::image`].
    pub fn text(&mut self, name: &str, text: &str) -> Result<(), FitsError> {
        let header = Header::new().with("CONTENT", "UTF-8", "this array is text");
        self.image(name, &[text.len()], &header, text.as_bytes())
    }

    /// Begins a cube of frames of `[columns, rows]`, to be appended one by one.
    ///
    /// # Errors
    /// As [`FitsWriter::image`].
    pub fn cube<T: Sample>(
        mut self,
        name: &str,
        frame: [usize; 2],
        header: &Header,
    ) -> Result<CubeWriter<T>, FitsError> {
        let array = self.begin::<T>(name, &[frame[0], frame[1], 0], header, None)?;
        Ok(CubeWriter { file: self, array, frames: 0, _sample: PhantomData })
    }

    /// Brings everything to the disk; without it, errors of the last writes are lost.
    ///
    /// # Errors
    /// [`FitsError::Io`].
    pub fn finish(mut self) -> Result<(), FitsError> {
        let result = self.file.flush();
        self.io(result)
    }

    fn begin<T: Sample>(
        &mut self,
        name: &str,
        shape: &[usize],
        header: &Header,
        columns: Option<Vec<u8>>,
    ) -> Result<OpenArray, FitsError> {
        let hdu = format!("array {name:?}");
        let mut cards = Vec::new();
        // The name goes through the same checks as the caller's cards.
        let result = Header::new().with("NAME", name, "").render(&mut cards).and_then(|()| {
            cards.clear();
            header.render(&mut cards)
        });
        if let Err((keyword, reason)) = result {
            return Err(FitsError::Card { file: self.path.clone(), hdu, keyword, reason });
        }
        let start = self.file.stream_position();
        let array = OpenArray {
            hdu,
            start: self.io(start)?,
            kind: (T::BITPIX, T::BZERO),
            shape: shape.to_vec(),
            columns,
            name: name.into(),
            cards,
            sum: Sum::default(),
            data_bytes: 0,
        };
        let result = self.file.write_all(&array.render(self.arrays == 0));
        self.io(result)?;
        Ok(array)
    }

    fn append<T: Sample>(
        &mut self,
        array: &mut OpenArray,
        expected: usize,
        data: &[T],
    ) -> Result<(), FitsError> {
        if data.len() != expected {
            let (file, hdu) = (self.path.clone(), array.hdu.clone());
            return Err(FitsError::Size { file, hdu, expected, found: data.len() });
        }
        self.bytes.clear();
        T::encode(data, &mut self.bytes);
        array.sum.add(&self.bytes);
        array.data_bytes += self.bytes.len() as u64;
        let result = self.file.write_all(&self.bytes);
        self.io(result)
    }

    /// Fills the last block and writes the header again, now with the true size and checksum.
    fn end(&mut self, mut array: OpenArray) -> Result<(), FitsError> {
        let fill = vec![0; padding(array.data_bytes)];
        array.sum.add(&fill);
        let header = array.render(self.arrays == 0);
        let mut write = || {
            self.file.write_all(&fill)?;
            self.file.seek(SeekFrom::Start(array.start))?;
            self.file.write_all(&header)?;
            self.file.seek(SeekFrom::End(0))
        };
        let result = write();
        self.io(result)?;
        self.arrays += 1;
        Ok(())
    }

    fn io<T>(&self, result: std::io::Result<T>) -> Result<T, FitsError> {
        result.map_err(|source| FitsError::Io { file: self.path.clone(), source })
    }
}

impl<T: Sample> CubeWriter<T> {
    /// Appends a frame, row-major.
    ///
    /// # Errors
    /// [`FitsError::Size`] if it does not have columns x rows numbers, [`FitsError::Io`].
    pub fn push(&mut self, frame: &[T]) -> Result<(), FitsError> {
        let pixels = self.array.shape[0] * self.array.shape[1];
        self.file.append(&mut self.array, pixels, frame)?;
        self.frames += 1;
        Ok(())
    }

    /// Frames appended so far.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Completes the cube and gives the file back for further arrays.
    ///
    /// # Errors
    /// [`FitsError::Io`].
    pub fn finish(mut self) -> Result<FitsWriter, FitsError> {
        self.array.shape[2] = self.frames;
        self.file.end(self.array)?;
        Ok(self.file)
    }
}

impl OpenArray {
    /// The whole header, blocks filled; its length does not depend on size or checksum.
    fn render(&self, primary: bool) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(BLOCK);
        let mut card = |keyword: &str, value: Value, comment: &str| {
            render_card(keyword, &value, comment, &mut bytes);
        };
        if primary {
            card("SIMPLE", true.into(), "conforms to the FITS standard");
        } else if self.columns.is_some() {
            card("XTENSION", "BINTABLE".into(), "table");
        } else {
            card("XTENSION", "IMAGE".into(), "image extension");
        }
        let (bitpix, bzero) = self.kind;
        card("BITPIX", bitpix.into(), "bits of a number, negative: floating point");
        card("NAXIS", Value::Int(self.shape.len() as i64), "number of axes");
        for (axis, &length) in self.shape.iter().enumerate() {
            card(&format!("NAXIS{}", axis + 1), Value::Int(length as i64), "");
        }
        if primary {
            card("EXTEND", true.into(), "extensions may follow");
        } else {
            card("PCOUNT", 0.into(), "");
            card("GCOUNT", 1.into(), "");
        }
        if let Some(bzero) = bzero {
            card("BZERO", bzero.into(), "added to the stored numbers: unsigned");
            card("BSCALE", 1.into(), "");
        }
        if let Some(columns) = &self.columns {
            bytes.extend(columns);
        }
        let name = self.name.as_str().into();
        render_card("EXTNAME", &name, "name of this array", &mut bytes);
        bytes.extend(&self.cards);

        let data_sum = self.sum.value();
        let mut card = |keyword: &str, value: String, comment: &str| {
            render_card(keyword, &value.into(), comment, &mut bytes);
            bytes.len()
        };
        card("DATASUM", data_sum.to_string(), "sum of the data");
        let end = card("CHECKSUM", "0".repeat(16), "sum of header and data is -0");
        bytes.extend(format!("{:<80}", "END").bytes());
        bytes.resize(bytes.len() + padding(bytes.len() as u64), b' ');

        let mut sum = self.sum;
        sum.add(&bytes);
        // The value stands between quotes in columns 12 to 27 of its card.
        let value = end - super::CARD + 11;
        bytes[value..value + 16].copy_from_slice(checksum::encode(sum.value()).as_bytes());
        bytes
    }
}
