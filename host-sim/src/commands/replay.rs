//! `host-sim replay`: recorded frames through the firmware library.

use super::frames::{CALIBRATIONS, COUPLING, LEVER_ARM, MODES};
use super::{output, progress};
use crate::board::{Frame, in_process, operate};
use crate::calibration::SlopeCalibration;
use crate::cli::ReplayArgs;
use crate::error::{Error, refuse};
use crate::files::csv::SeriesWriter;
use crate::files::fits::{FitsError, FitsReader, FitsWriter};
use crate::instrument::Instrument;
use crate::range_diversity::law::Law;
use crate::reconstructor::Reconstructor;
use crate::summary::{CodeDigest, faults};
use serde::Serialize;
use splash_firmware::fixed::CENTROID_BITS;
use std::collections::BTreeMap;

/// Columns of a second gate's measurements.
const SECOND_GATE: [&str; 4] =
    ["second_centroid_x_px", "second_centroid_y_px", "second_flux", "second_valid"];

/// The JSON of `host-sim replay`.
#[derive(Debug, Serialize)]
struct ReplayResult {
    frames: u32,
    digest: String,
    faults: BTreeMap<&'static str, u32>,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &ReplayArgs) -> Result<(), Error> {
    let unusable = |error: FitsError| Error::Config(error.to_string());
    let mut file = FitsReader::open(&args.file).map_err(unusable)?;
    file.verify().map_err(unusable)?;
    let name = args.file.display().to_string();
    let instrument = match &args.config {
        Some(config) => Instrument::load(config)?,
        None => {
            let place = file.find("CONFIG").map_err(unusable)?;
            Instrument::parse(&file.text(place).map_err(unusable)?, &format!("{name}[CONFIG]"))?
        }
    };
    instrument.check()?;
    let reconstructor = calibrated(&mut file, &name, Reconstructor::new(&instrument)?)?;
    let mut board = in_process(&reconstructor.spec())?;
    let recorded = file.hdus().first().and_then(|hdu| hdu.header.text("SEED"));
    let seed = recorded.and_then(|seed| seed.parse().ok()).unwrap_or(0);
    let mut cube = file.cube::<u16>(0).map_err(unusable)?;
    let detector = reconstructor.detector().spec();
    let [width, height] = [detector.width, detector.height];
    let [columns, rows] = cube.frame_shape();
    if [columns, rows] != [width, height] {
        let limit = format!("the configuration's {width} x {height} pixels");
        return Err(refuse(
            &format!("{name}: frame"),
            format!("{columns} x {rows} pixels"),
            &limit,
        ));
    }

    let directory = output::directory(args.output.out.as_deref(), "replay")?;
    let header = output::header(&instrument, seed, "DAC code");
    let segments = reconstructor.mask().count();
    let mut commands = FitsWriter::create(directory.join("commands.fits"))?.cube::<u16>(
        "CODES",
        [3, segments],
        &header,
    )?;
    let mut columns = vec![
        "frame",
        "subaperture",
        "code_0",
        "code_1",
        "code_2",
        "centroid_x_px",
        "centroid_y_px",
        "flux",
        "valid",
        "piston_nm",
        "tip_nm",
        "tilt_nm",
    ];
    if reconstructor.law().is_some() {
        columns.extend(SECOND_GATE);
    }
    let mut series = SeriesWriter::create(directory.join("commands.csv"), &columns)?;
    let mut digest = CodeDigest::default();
    let total = cube.frames();
    let mut pixels = vec![0; width * height];
    let bar = progress::bar(total as u64, "replay", "frames");
    let px = 1.0 / f64::from(1u32 << CENTROID_BITS);
    let nm = 1e9 * board.ulp_m();
    for frame in 0..total as u32 {
        cube.next_frame(&mut pixels).map_err(unusable)?;
        operate(board.as_mut(), frame, reconstructor.lighting().count())?;
        board.frame(frame, Frame::Pixels(&pixels))?;
        digest.add(board.codes());
        commands.push(board.codes().as_flattened())?;
        let seen = board.measurements().iter().zip(board.slopes());
        let moved = board.codes().iter().zip(board.positions());
        for (i, ((measurement, slope), (codes, position))) in seen.zip(moved).enumerate() {
            let [c0, c1, c2] = codes.map(f64::from);
            let [cx, cy] = measurement.centroid_q16.map(|c| f64::from(c) * px);
            let [tip, tilt] = position.tilt_ulp.map(|t| f64::from(t) * nm);
            let piston = f64::from(position.piston_ulp) * nm;
            let (flux, valid) = (f64::from(measurement.flux), f64::from(u8::from(slope.valid)));
            let mut line = vec![f64::from(frame), i as f64, c0, c1, c2, cx, cy, flux, valid];
            line.extend([piston, tip, tilt]);
            let second = (board.second_measurements().get(i), board.second_slopes().get(i));
            if let (Some(measurement), Some(slope)) = second {
                line.extend(measurement.centroid_q16.map(|c| f64::from(c) * px));
                line.extend([f64::from(measurement.flux), f64::from(u8::from(slope.valid))]);
            }
            series.push(&line)?;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    commands.finish()?.finish()?;
    series.finish()?;
    let result = ReplayResult {
        frames: total as u32,
        digest: digest.hex(),
        faults: faults(&board.totals(), &board.standing()?.faults),
    };
    output::report(
        args.output.json,
        &result,
        &[
            ("frames", result.frames.to_string()),
            ("faults", output::faults_in_words(&result.faults)),
            ("digest", result.digest.clone()),
            ("files", directory.display().to_string()),
        ],
    )
}

/// With the calibration recorded in the file, of each gate, and the law of two: found again on another machine, they
/// could differ in their last bits.
fn calibrated(
    file: &mut FitsReader,
    name: &str,
    reconstructor: Reconstructor,
) -> Result<Reconstructor, Error> {
    let subapertures = reconstructor.mask().count();
    let unusable = |error: FitsError| Error::Config(error.to_string());
    let mut read = |array: &str, shape: &[usize]| {
        let place = file.find(array).map_err(unusable)?;
        let (found, values) = file.image::<f64>(place).map_err(unusable)?;
        if found != shape {
            let limit = format!("{shape:?}, as the configuration asks for");
            return Err(refuse(&format!("{name}[{array}]: axes"), format!("{found:?}"), &limit));
        }
        Ok(values)
    };
    let mut slopes = |[reference, gain]: [&str; 2]| {
        let reference = read(reference, &[2, subapertures])?;
        let gain = read(gain, &[2, 2, subapertures])?;
        Ok::<_, Error>(SlopeCalibration {
            reference_px: reference.as_chunks().0.to_vec(),
            gain_m_per_px: gain.as_chunks().0.as_chunks().0.to_vec(),
        })
    };
    let [first, second] = CALIBRATIONS;
    let first = slopes(first)?;
    let instrument = reconstructor.instrument();
    if !instrument.has_second_gate() {
        return Ok(reconstructor.with_slopes(first));
    }
    let (count, second) = (instrument.second_gate.modes, slopes(second)?);
    let modes = read(MODES, &[2, subapertures, count])?;
    let coupling = read(COUPLING, &[2 * count, count])?;
    let place = file.find(MODES).map_err(unusable)?;
    let factor = file.hdus().get(place).and_then(|hdu| hdu.header.float(LEVER_ARM));
    let lever_arm = factor.ok_or_else(|| {
        refuse(&format!("{name}[{MODES}]: {LEVER_ARM}"), "missing", "the law's factor f")
    })?;
    let law = Law { lever_arm, modes: modes.as_chunks().0.to_vec(), coupling };
    Ok(reconstructor.combining_gates(law)?.with_slopes(first).with_second_slopes(second))
}
