//! The reader most astronomers use reads our FITS files, and we read its files.
//!
//! `SPLASH_PYTHON` names a Python interpreter with astropy; without it `python3` is tried, and
//! these tests are skipped if it has no astropy.

use std::path::Path;
use std::process::Command;

use host_sim::files::fits::{FitsReader, FitsWriter, Header};

/// Runs a Python script on a file; false if there is no astropy and none was asked for.
fn python(script: &str, file: &Path) -> bool {
    let named = std::env::var("SPLASH_PYTHON").ok();
    let interpreter = named.as_deref().unwrap_or("python3");
    let astropy = Command::new(interpreter).args(["-c", "import astropy.io.fits"]).output();
    if !astropy.is_ok_and(|output| output.status.success()) {
        assert!(named.is_none(), "SPLASH_PYTHON={interpreter} cannot import astropy");
        println!("skipped: {interpreter} has no astropy (set SPLASH_PYTHON)");
        return false;
    }
    let output = Command::new(interpreter).arg("-c").arg(script).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    true
}

#[test]
fn astropy_reads_what_is_written() {
    let directory = tempfile::TempDir::new().unwrap();
    let path = directory.path().join("run.fits");
    let header = Header::new()
        .with("BUNIT", "ADU", "")
        .with("DIAMETER", 4.0, "[m] telescope diameter")
        .with("WAVELEN", 5.32e-7, "[m] wavelength")
        .with("NSUB", 8, "subapertures across")
        .with("CLOSED", true, "the loop was closed")
        .with("OBSERVER", "Butterley & Love's", "");
    let mut cube =
        FitsWriter::create(&path).unwrap().cube::<u16>("FRAMES", [5, 3], &header).unwrap();
    for frame in 0..4_u16 {
        let pixels: Vec<u16> = (0..15).map(|pixel| frame * 20_000 + pixel).collect();
        cube.push(&pixels).unwrap();
    }
    let mut file = cube.finish().unwrap();
    let metres = Header::new().with("BUNIT", "m", "");
    file.image("HEIGHTS", &[3, 2], &metres, &[0.0, 1e-9, 2e-9, 3e-9, 4e-9, 5e-9_f64]).unwrap();
    file.image("PHASE", &[2, 1], &Header::new(), &[1.5_f32, f32::NAN]).unwrap();
    file.image("COMMANDS", &[2], &Header::new(), &[i32::MIN, i32::MAX]).unwrap();
    file.text("CONFIG", "n = 8\nunit = \"\u{b5}m\"\n").unwrap();
    file.finish().unwrap();

    let script = r#"
import sys, warnings
import numpy as np
from astropy.io import fits
warnings.simplefilter("error")
with fits.open(sys.argv[1], checksum=True) as hdus:
    hdus.verify("exception")
    assert [h.name for h in hdus] == ["FRAMES", "HEIGHTS", "PHASE", "COMMANDS", "CONFIG"]
    frames = hdus[0].data
    assert frames.dtype == np.uint16 and frames.shape == (4, 3, 5), (frames.dtype, frames.shape)
    expected = np.arange(4)[:, None] * 20000 + np.arange(15)
    assert np.array_equal(frames, expected.reshape(4, 3, 5))
    h = hdus[0].header
    assert h["BUNIT"] == "ADU" and h["DIAMETER"] == 4.0 and h["WAVELEN"] == 5.32e-7
    assert h["NSUB"] == 8 and h["CLOSED"] is True and h["OBSERVER"] == "Butterley & Love's"
    assert h.comments["DIAMETER"] == "[m] telescope diameter"
    heights = hdus["HEIGHTS"]
    assert heights.data.dtype.kind == "f" and heights.header["BUNIT"] == "m"
    assert np.array_equal(heights.data, [[0, 1e-9, 2e-9], [3e-9, 4e-9, 5e-9]])
    assert hdus["PHASE"].data[0, 0] == 1.5 and np.isnan(hdus["PHASE"].data[0, 1])
    assert list(hdus["COMMANDS"].data) == [-2**31, 2**31 - 1]
    assert bytes(hdus["CONFIG"].data).decode() == 'n = 8\nunit = "\u00b5m"\n'
"#;
    python(script, &path);
}

#[test]
fn files_of_astropy_are_read() {
    let directory = tempfile::TempDir::new().unwrap();
    let path = directory.path().join("camera.fits");
    let script = r#"
import sys
import numpy as np
from astropy.io import fits
frames = (np.arange(24) * 2800).astype(np.uint16).reshape(2, 3, 4)
primary = fits.PrimaryHDU(frames)
primary.header["EXPTIME"] = (0.001, "[s] exposure")
primary.header["COMMENT"] = "a comment = no value"
primary.header["LONG"] = "x" * 100
table = fits.BinTableHDU.from_columns([fits.Column("T", "D", array=np.arange(3.0))], name="TIME")
image = fits.ImageHDU(np.eye(2), name="EYE")
fits.HDUList([primary, table, image]).writeto(sys.argv[1], checksum=True)
"#;
    if !python(script, &path) {
        return;
    }
    let mut file = FitsReader::open(&path).unwrap();
    assert_eq!(file.hdus()[0].header.float("EXPTIME"), Some(0.001));
    let (shape, frames) = file.image::<u16>(0).unwrap();
    assert_eq!(shape, [4, 3, 2]);
    assert!(frames.iter().enumerate().all(|(index, &pixel)| usize::from(pixel) == index * 2800));
    assert!(file.image::<f64>(1).unwrap_err().to_string().contains("XTENSION = 'BINTABLE'"));
    let eye = file.find("EYE").unwrap();
    assert_eq!(file.image::<f64>(eye).unwrap().1, [1.0, 0.0, 0.0, 1.0]);
}
