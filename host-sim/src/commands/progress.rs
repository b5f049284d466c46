//! Progress bars on stderr; invisible where there is no terminal.

use crate::board::Board;
use crate::calibration::calibrated;
use crate::closed_loop::{ClosedLoop, Run};
use crate::error::Error;
use crate::instrument::Instrument;
use crate::optics::geometric::Sensor;
use crate::reconstructor::Reconstructor;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::Write;

/// A bar over `length` steps of something called `unit`.
pub(super) fn bar(length: u64, what: &'static str, unit: &str) -> ProgressBar {
    let template = format!(
        "{{msg:<12}} {{wide_bar:.cyan/blue}} {{pos}}/{{len}} {unit} {{per_sec}} {{eta}} left"
    );
    // The template is fixed; were it wrong, a plain bar would do.
    let style =
        ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(length).with_style(style).with_message(what)
}

/// A bar over a share of a long run, 0 to 1000 per mille: with the time left.
pub(super) fn share(what: String) -> ProgressBar {
    let bar = bar(1000, "", "per mille");
    bar.set_message(what);
    bar.enable_steady_tick(std::time::Duration::from_secs(1));
    bar
}

/// A bar from 0 to 100 %, and what moves it to a fraction.
pub(super) fn fraction(what: &'static str) -> (ProgressBar, impl FnMut(f64)) {
    let progress = bar(100, what, "%");
    let moved = progress.clone();
    (progress, move |done: f64| moved.set_position((100.0 * done) as u64))
}

/// Measures the slope calibration of a sensor's images, at each gate, behind a bar.
pub(super) fn calibrate(
    sensor: Sensor,
    reconstructor: Reconstructor,
) -> Result<Reconstructor, Error> {
    let (bar, mut progress) = fraction("calibration");
    let reconstructor = calibrated(sensor, reconstructor, &mut progress)?;
    bar.finish_and_clear();
    Ok(reconstructor)
}

/// Designs what is made of a second gate, if there is one, behind a bar.
pub(super) fn combine_gates(reconstructor: Reconstructor) -> Result<Reconstructor, Error> {
    let bar = bar(100, "two gates", "%");
    let reconstructor =
        reconstructor.with_second_gate(&|done| bar.set_position((100.0 * done) as u64))?;
    bar.finish_and_clear();
    Ok(reconstructor)
}

/// Sets a closed loop up behind a bar: drawing the turbulence takes its time.
pub(super) fn close<'a>(
    instrument: &Instrument,
    reconstructor: &Reconstructor,
    board: &'a mut dyn Board,
    run: Run,
) -> Result<ClosedLoop<'a>, Error> {
    let (bar, mut progress) = fraction("turbulence");
    let closed = ClosedLoop::new(instrument, reconstructor, board, run, &mut progress)?;
    bar.finish_and_clear();
    Ok(closed)
}

/// A line on stderr before something long.
pub(super) fn say(line: &str) {
    // Nobody may be listening.
    let _ = writeln!(std::io::stderr(), "{line}");
}
