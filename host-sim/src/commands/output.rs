//! Where results go: the output directory, the table, the JSON line and the headers of FITS files.

use crate::cli::OutputArgs;
use crate::error::Error;
use crate::files::fits::Header;
use crate::instrument::Instrument;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The output directory, made if it is not there.
pub(super) fn directory(out: Option<&Path>, command: &str) -> Result<PathBuf, Error> {
    let path = out.map_or_else(|| Path::new("target/splash").join(command), Path::to_path_buf);
    std::fs::create_dir_all(&path)
        .map_err(|error| Error::Config(format!("--out {}: {error}", path.display())))?;
    Ok(path)
}

/// Writes a CSV file of a line a row, its columns named as their fields.
pub(super) fn records(path: &Path, rows: &[impl Serialize]) -> Result<(), Error> {
    let failed = |error: csv::Error| Error::Run(format!("{}: {error}", path.display()));
    let mut writer = csv::Writer::from_path(path).map_err(failed)?;
    for row in rows {
        writer.serialize(row).map_err(failed)?;
    }
    Ok(writer.flush()?)
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

/// The end of a command: how long it took, where the files are, and the report.
pub(super) fn finish(
    args: &OutputArgs,
    start: Instant,
    directory: &Path,
    result: &impl Serialize,
    mut table: Vec<(&str, String)>,
) -> Result<(), Error> {
    table.push(("time", format!("{:.1} s", start.elapsed().as_secs_f64())));
    table.push(("pictures and files", directory.display().to_string()));
    report(args.json, result, &table)
}

/// The cards of any array; `unit` is that of its values.
pub(super) fn cards(unit: &str) -> Header {
    let header = Header::new().with("BUNIT", unit, "unit of the values");
    header.with("ORIGIN", "host-sim", "SPLASH simulator")
}

/// Adds what stands along an axis: `key` with numbers from 1.
pub(super) fn along<'a>(
    header: Header,
    axis: u32,
    key: &str,
    names: impl IntoIterator<Item = &'a str>,
) -> Header {
    let comment = format!("axis {axis}");
    let card =
        |header: Header, (index, name)| header.with(&format!("{key}{}", index + 1), name, &comment);
    names.into_iter().enumerate().fold(header, card)
}

/// The cards that every array of a run carries; `unit` is that of its values.
pub(super) fn header(instrument: &Instrument, seed: u64, unit: &str) -> Header {
    let telescope = &instrument.telescope;
    cards(unit)
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
