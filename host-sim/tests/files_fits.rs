//! FITS: what is written is read back, and nothing read makes it panic.

use std::fs;
use std::path::{Path, PathBuf};

use host_sim::files::fits::{FitsError, FitsReader, FitsWriter, Header, Sample, Value};
use proptest::prelude::*;
use tempfile::TempDir;

fn scratch() -> (TempDir, PathBuf) {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("frames.fits");
    (directory, path)
}

/// A cube of three frames of 5 x 4, an f64 extension and a text.
fn sample_file(path: &Path) {
    let header = Header::new().with("BUNIT", "ADU", "").with("GAIN", 4.0, "[e-/ADU] gain");
    let mut cube =
        FitsWriter::create(path).unwrap().cube::<u16>("FRAMES", [5, 4], &header).unwrap();
    for frame in 0..3 {
        cube.push(&[frame * 7 + 65_500; 20]).unwrap();
    }
    let mut file = cube.finish().unwrap();
    file.image("TRUTH", &[2, 2], &Header::new(), &[1.5, f64::MAX, -0.0, 1e-300]).unwrap();
    file.text("CONFIG", "[telescope]\nwavelength = \"0.532 \u{b5}m\"\n").unwrap();
    file.finish().unwrap();
}

fn round_trip<T: Sample + PartialEq + std::fmt::Debug>(data: &[T]) {
    let (_directory, path) = scratch();
    let mut file = FitsWriter::create(&path).unwrap();
    file.image("A", &[data.len()], &Header::new(), data).unwrap();
    file.image("B", &[1, data.len(), 1], &Header::new(), data).unwrap();
    file.finish().unwrap();
    assert_eq!(fs::metadata(&path).unwrap().len() % 2880, 0);
    let mut file = FitsReader::open(&path).unwrap();
    assert_eq!(file.image(0).unwrap(), (vec![data.len()], data.to_vec()));
    assert_eq!(file.image(1).unwrap(), (vec![1, data.len(), 1], data.to_vec()));
}

#[test]
fn numbers_of_every_type_come_back() {
    round_trip(&(0..=255).collect::<Vec<u8>>());
    round_trip(&(0..=65_535).collect::<Vec<u16>>());
    round_trip(&[i32::MIN, -1, 0, 1, i32::MAX]);
    round_trip(&[f32::MIN_POSITIVE, -1.0e-3, 0.0, f32::INFINITY]);
    round_trip(&[f64::MIN_POSITIVE, -1.0e-3, 0.0, f64::INFINITY]);
    round_trip::<f32>(&[]);
    let (_directory, path) = scratch();
    let mut file = FitsWriter::create(&path).unwrap();
    file.image("NAN", &[1], &Header::new(), &[f32::NAN]).unwrap();
    file.finish().unwrap();
    assert!(FitsReader::open(&path).unwrap().image::<f32>(0).unwrap().1[0].is_nan());
}

#[test]
fn header_cards_come_back() {
    let (_directory, path) = scratch();
    let quoted = "it's 68 characters, quotes counted twice, and no more than that ....";
    let header = Header::new()
        .with("BUNIT", "ADU", "")
        .with("ORIGIN", "", "empty text")
        .with("QUOTE", &quoted[..67], "no room for this")
        .with("CLOSED", true, "loop closed")
        .with("OPEN", false, "")
        .with("FRAMES_1", i64::MIN, "")
        .with("WAVELEN", 5.32e-7, "[m] wavelength")
        .with("HUGE", 1e300, "")
        .with("TENTH", 0.1, "")
        .with("WHOLE", 12_000.0, &"long ".repeat(40));
    let mut file = FitsWriter::create(&path).unwrap();
    file.image("X", &[1], &header, &[0_u8]).unwrap();
    file.finish().unwrap();

    let file = FitsReader::open(&path).unwrap();
    let read = &file.hdus()[0].header;
    for (keyword, value, comment) in header.cards() {
        assert_eq!(read.get(keyword), Some(value), "{keyword}");
        let (_, _, found) = read.cards().find(|(found, ..)| *found == keyword).unwrap();
        assert!(comment.starts_with(found), "{keyword}: {found}");
    }
    assert_eq!(read.float("WAVELEN"), Some(5.32e-7));
    assert_eq!(read.float("FRAMES_1"), Some(i64::MIN as f64));
    assert_eq!((read.int("GAIN"), read.text("GAIN"), read.int("WHOLE")), (None, None, None));
}

#[test]
fn cards_that_fits_cannot_hold_are_refused() {
    let (_directory, path) = scratch();
    let mut file = FitsWriter::create(&path).unwrap();
    let cases: [(&str, Value, &str, &str); 9] = [
        ("TOOLONGKEY", 1.into(), "", "1 to 8 characters"),
        ("lower", 1.into(), "", "1 to 8 characters"),
        ("", 1.into(), "", "1 to 8 characters"),
        ("NAXIS1", 1.into(), "", "set by the writer"),
        ("END", 1.into(), "", "set by the writer"),
        ("NAN", f64::NAN.into(), "", "not finite"),
        ("TEXT", "x".repeat(69).into(), "", "longer than 68"),
        ("TEXT", "\u{b5}m".into(), "", "text is not printable"),
        ("TEXT", 1.into(), "line\nbreak", "comment is not printable"),
    ];
    for (keyword, value, comment, reason) in cases {
        let header = Header::new().with(keyword, value, comment);
        let error = file.image("X", &[1], &header, &[0_u8]).unwrap_err();
        assert!(matches!(error, FitsError::Card { .. }), "{error}");
        assert!(error.to_string().contains(reason), "{error}");
    }
    assert!(file.image("na\nme", &[1], &Header::new(), &[0_u8]).is_err());
}

#[test]
fn cubes_are_written_and_read_frame_by_frame() {
    let (_directory, path) = scratch();
    sample_file(&path);
    let mut file = FitsReader::open(&path).unwrap();
    assert_eq!(file.hdus()[0].shape, [5, 4, 3]);
    let mut cube = file.cube::<u16>(0).unwrap();
    assert_eq!((cube.frame_shape(), cube.frames()), ([5, 4], 3));
    let mut frame = [0; 20];
    for number in 0..3 {
        assert!(cube.next_frame(&mut frame).unwrap());
        assert_eq!(frame, [number * 7 + 65_500; 20]);
    }
    assert!(!cube.next_frame(&mut frame).unwrap());
    let config = file.find("CONFIG").unwrap();
    assert!(file.text(config).unwrap().contains("\u{b5}m"));
}

#[test]
fn an_unfinished_cube_has_no_frames() {
    let (_directory, path) = scratch();
    let file = FitsWriter::create(&path).unwrap();
    let mut cube = file.cube::<u16>("FRAMES", [5, 4], &Header::new()).unwrap();
    cube.push(&[1; 20]).unwrap();
    assert_eq!(cube.frames(), 1);
    let error = cube.push(&[1; 19]).unwrap_err();
    assert!(matches!(error, FitsError::Size { expected: 20, found: 19, .. }), "{error}");
    drop(cube);
    assert_eq!(FitsReader::open(&path).unwrap().cube::<u16>(0).unwrap().frames(), 0);
}

#[test]
fn errors_say_what_is_wrong_where() {
    let (directory, path) = scratch();
    let message = |error: FitsError| {
        error.to_string().replace(&format!("{}/", directory.path().display()), "")
    };
    assert!(message(FitsReader::open(&path).unwrap_err()).starts_with("frames.fits: No such file"));
    fs::write(&path, "not FITS").unwrap();
    let not_fits = "frames.fits: not a FITS file (it does not begin with SIMPLE =)";
    assert_eq!(message(FitsReader::open(&path).unwrap_err()), not_fits);
    fs::write(&path, [b' '; 5760]).unwrap();
    assert_eq!(message(FitsReader::open(&path).unwrap_err()), not_fits);
    fs::write(&path, format!("{:<5760}", "SIMPLE  =                    T")).unwrap();
    assert_eq!(
        message(FitsReader::open(&path).unwrap_err()),
        "frames.fits: primary array: the header has no END card"
    );

    sample_file(&path);
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..2900]).unwrap();
    assert_eq!(
        message(FitsReader::open(&path).unwrap_err()),
        "frames.fits: primary array (FRAMES): truncated, 20 bytes of data, expected 120"
    );

    fs::write(&path, &bytes).unwrap();
    let mut file = FitsReader::open(&path).unwrap();
    assert_eq!(
        message(file.cube::<f64>(1).unwrap_err()),
        "frames.fits: extension 1 (TRUTH): NAXIS = 2, expected 3 (column, row, frame)"
    );
    assert_eq!(
        message(file.image::<f32>(0).unwrap_err()),
        "frames.fits: primary array (FRAMES): BITPIX = 16, expected -32"
    );
    assert_eq!(
        message(file.find("GAIN").unwrap_err()),
        "frames.fits: no array \"GAIN\" (there are: FRAMES, TRUTH, CONFIG)"
    );
    assert_eq!(
        message(file.image::<u8>(3).unwrap_err()),
        "frames.fits: no array number 3 (there are: 0 to 2)"
    );

    // Signed 16-bit numbers: the same BITPIX, another meaning.
    let signed = String::from_utf8_lossy(&bytes[..2880]).replace("32768", "    0");
    fs::write(&path, [signed.as_bytes(), &bytes[2880..]].concat()).unwrap();
    assert_eq!(
        message(FitsReader::open(&path).unwrap().cube::<u16>(0).unwrap_err()),
        "frames.fits: primary array (FRAMES): BZERO = 0, expected 32768"
    );
}

#[test]
fn sizes_beyond_memory_are_refused() {
    let (_directory, path) = scratch();
    let header = |axes: [u64; 3]| {
        let cards = [
            format!("SIMPLE  = {:>20}", "T"),
            format!("BITPIX  = {:>20}", 8),
            format!("NAXIS   = {:>20}", 3),
            format!("NAXIS1  = {:>20}", axes[0]),
            format!("NAXIS2  = {:>20}", axes[1]),
            format!("NAXIS3  = {:>20}", axes[2]),
            "END".into(),
        ];
        let text: String = cards.iter().map(|card| format!("{card:<80}")).collect();
        format!("{text:<2880}")
    };
    fs::write(&path, header([1 << 40, 1 << 40, 1])).unwrap();
    let error = FitsReader::open(&path).unwrap_err();
    assert!(matches!(error, FitsError::Keyword { .. }), "{error}");
    fs::write(&path, header([1 << 30, 1 << 30, 0])).unwrap();
    let error = FitsReader::open(&path).unwrap().cube::<u8>(0).unwrap_err();
    assert!(matches!(error, FitsError::Keyword { .. }), "{error}");
    fs::write(&path, header([1 << 30, 1, 1])).unwrap();
    let error = FitsReader::open(&path).unwrap_err();
    assert!(matches!(error, FitsError::Truncated { .. }), "{error}");
}

/// Opens bytes as a file and reads all there is, in every way.
fn read_everything(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).unwrap();
    let Ok(mut file) = FitsReader::open(path) else { return };
    for array in 0..=file.hdus().len() {
        let _ = (file.image::<u8>(array), file.image::<u16>(array), file.image::<i32>(array));
        let _ = (file.image::<f32>(array), file.image::<f64>(array), file.text(array));
        if let Ok(mut cube) = file.cube::<u16>(array) {
            // Small files only: whatever is announced and accepted is there.
            let mut frame = vec![0; cube.frame_shape().iter().product::<usize>().min(1 << 20)];
            while cube.frames() < 1 << 20 && cube.next_frame(&mut frame).unwrap_or(false) {}
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn random_bytes_do_not_panic(
        mut bytes in prop::collection::vec(any::<u8>(), 0..9000),
        fits in any::<bool>(),
    ) {
        let start = b"SIMPLE  =                    T";
        if fits && bytes.len() > start.len() {
            bytes[..start.len()].copy_from_slice(start);
        }
        let (_directory, path) = scratch();
        read_everything(&path, &bytes);
    }

    #[test]
    fn mutated_files_do_not_panic(
        edits in prop::collection::vec((0..9usize, 0..80usize, prop::sample::select(b"0123456789-.'/=TFEN \xff\x00".to_vec())), 1..6),
        extension in 0..3usize,
        cut in prop::option::of(0..20_000usize),
    ) {
        let (_directory, path) = scratch();
        sample_file(&path);
        let mut bytes = fs::read(&path).unwrap();
        for (card, column, byte) in edits {
            // The first cards of a header matter most.
            bytes[extension * 5760 + card * 80 + column] = byte;
        }
        bytes.truncate(cut.unwrap_or(usize::MAX));
        read_everything(&path, &bytes);
    }

    #[test]
    fn any_cube_comes_back(
        columns in 1..7usize,
        rows in 1..7usize,
        frames in prop::collection::vec(any::<u16>(), 0..20),
    ) {
        let (_directory, path) = scratch();
        let file = FitsWriter::create(&path).unwrap();
        let mut cube = file.cube::<u16>("FRAMES", [columns, rows], &Header::new()).unwrap();
        for &level in &frames {
            cube.push(&vec![level; columns * rows]).unwrap();
        }
        cube.finish().unwrap().finish().unwrap();
        let mut file = FitsReader::open(&path).unwrap();
        let (shape, data) = file.image::<u16>(0).unwrap();
        prop_assert_eq!(shape, vec![columns, rows, frames.len()]);
        prop_assert!(data.chunks(columns * rows).zip(frames).all(|(f, l)| f.iter().all(|&p| p == l)));
    }
}

#[test]
fn data_that_changed_since_they_were_written_are_told() {
    let directory = tempfile::tempdir().expect("directory");
    let path = directory.path().join("frames.fits");
    let header = Header::new();
    let mut frames = FitsWriter::create(&path)
        .expect("create")
        .cube::<u16>("FRAMES", [3, 2], &header)
        .expect("cube");
    frames.push(&[1, 2, 3, 4, 5, 6]).expect("push");
    frames.finish().expect("cube").finish().expect("file");
    FitsReader::open(&path).expect("open").verify().expect("as written");

    let mut bytes = fs::read(&path).expect("read");
    // The data are the last block: six numbers, then padding.
    let data = bytes.len() - 2880;
    bytes[data + 3] ^= 1;
    fs::write(&path, &bytes).expect("write");
    let error = FitsReader::open(&path).expect("open").verify().expect_err("changed").to_string();
    assert!(error.contains("primary array (FRAMES): DATASUM = "), "{error}");
}
