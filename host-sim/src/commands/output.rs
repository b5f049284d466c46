//! Where results go: the output directory, the table, the JSON line and the headers of FITS files.

use crate::error::Error;
use crate::files::fits::Header;
use crate::instrument::Instrument;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The output directory, made if it is not there.
pub(super) fn directory(out: Option<&Path>, command: &str) -> Result<PathBuf, Error> {
    let path = out.map_or_else(|| Path::new("target/splash").join(command), Path::to_path_buf);
    std::fs::create_dir_all(&path)
        .map_err(|error| Error::Config(format!("--out {}: {error}", path.display())))?;
    Ok(path)
}

/// Prints `result` as one JSON line on stdout, or the table; the table goes to stderr beside JSON.
pub(super) fn report(
    json: bool,
    result: &impl Serialize,
    table: &[(&str, String)],
) -> Result<(), Error> {
    let width = table.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let lines: String =
        table.iter().map(|(name, value)| format!("{name:<width$}  {value}\n")).collect();
    let (mut stdout, mut stderr) = (std::io::stdout().lock(), std::io::stderr().lock());
    if json {
        stderr.write_all(lines.as_bytes())?;
        let line = serde_json::to_string(result).map_err(|error| Error::Run(error.to_string()))?;
        writeln!(stdout, "{line}")?;
    } else {
        stdout.write_all(lines.as_bytes())?;
    }
    Ok(())
}

/// The cards that every array of a run carries; `unit` is that of its values.
pub(super) fn header(instrument: &Instrument, seed: u64, unit: &str) -> Header {
    let telescope = &instrument.telescope;
    Header::new()
        .with("BUNIT", unit, "unit of the values")
        .with("ORIGIN", "host-sim", "SPLASH simulator")
        .with("NSUB", telescope.subapertures as i64, "subapertures across the pupil")
        .with("PITCH", telescope.pitch_m, "[m] subaperture pitch")
        .with("R0", instrument.r0_m(), "[m] Fried parameter at WAVELEN")
        .with("WAVELEN", instrument.laser.wavelength_m, "[m] laser wavelength")
        .with("BEACON", instrument.laser.beacon_height_m, "[m] beacon height")
        .with("WINDOW", instrument.windows.size as i64, "[px] side of a window")
        .with("FRAMETIM", instrument.frame_s(), "[s] from one frame to the next")
        .with("SEED", seed.to_string(), "seed of turbulence and noise")
}

/// The faults of a run in words.
pub(super) fn faults_in_words(faults: &std::collections::BTreeMap<&str, u32>) -> String {
    if faults.is_empty() {
        return "none".to_string();
    }
    faults.iter().map(|(name, count)| format!("{name} {count}")).collect::<Vec<_>>().join(", ")
}
