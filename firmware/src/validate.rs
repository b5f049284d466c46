//! Checks of a specification that need no conversion: sizes, places, ranges of counts.

use crate::centroid::{EstimatorConfig, MAX_WINDOW, MIN_WINDOW};
use crate::control::{ControlConfig, MAX_DELAY};
use crate::error::{ConfigError, Field, Limit};
use crate::schedule;
use crate::spec::{Colouring, ModalSpec, SorSpec, Spec};

/// Capacities, detector and windows' size.
pub(crate) fn geometry<const M: usize, const P: usize>(spec: &Spec<'_>) -> Result<(), ConfigError> {
    let across = spec.mask.across();
    if across * across > M {
        let limit = Limit::Within(4.0, libm::floor(libm::sqrt(M as f64)));
        return Err(ConfigError::new(Field::Across, across as f64, limit));
    }
    let count = spec.mask.count();
    if count == 0 {
        let rule = Limit::Rule("the mask must have at least one subaperture");
        return Err(ConfigError::new(Field::Subapertures, 0.0, rule));
    }
    let check = |field, value: u16, limit| ConfigError::check(field, None, value.into(), limit);
    check(Field::DetectorWidth, spec.detector.width, (1.0, 4096.0))?;
    check(Field::DetectorHeight, spec.detector.height, (1.0, 4096.0))?;
    check(Field::DetectorBits, spec.detector.bits.into(), (8.0, 16.0))?;
    let size = usize::from(spec.windows.size);
    let side = usize::from(spec.detector.width.min(spec.detector.height));
    let largest = MAX_WINDOW.min(side.max(MIN_WINDOW));
    check(Field::WindowSize, size as u16, (MIN_WINDOW as f64, largest as f64))?;
    let windows = count * spec.gates();
    ConfigError::check(Field::Windows, None, windows as f64, (1.0, M as f64))?;
    let pixels = (windows * size * size) as f64;
    ConfigError::check(Field::WindowPixels, None, pixels, (1.0, P as f64))?;
    if let Some(level) = spec.pixels.saturation_adu {
        let top = f64::from((1u32 << spec.detector.bits) - 1);
        check(Field::Saturation, level, (1.0, top))?;
    }
    Ok(())
}

/// Places of windows and bad pixels.
pub(crate) fn windows(spec: &Spec<'_>) -> Result<(), ConfigError> {
    gate(spec, Field::WindowOrigin, spec.windows.origins)?;
    if let Some(modal) = &spec.modal {
        second_windows(spec, modal)?;
    }
    let mut last = None;
    for (i, &[x, y]) in spec.pixels.bad.iter().enumerate() {
        for (value, room) in [(x, spec.detector.width), (y, spec.detector.height)] {
            let limit = (0.0, f64::from(room) - 1.0);
            ConfigError::check(Field::BadPixels, Some(i), f64::from(value), limit)?;
        }
        if last.is_some_and(|last| last >= (y, x)) {
            let rule = Limit::Rule("column: the list must be sorted by row, then column");
            return Err(ConfigError::at(Field::BadPixels, i, f64::from(x), rule));
        }
        last = Some((y, x));
    }
    Ok(())
}

/// Places of the windows of one gate.
fn gate(spec: &Spec<'_>, field: Field, origins: &[[u16; 2]]) -> Result<(), ConfigError> {
    let size = u16::from(spec.windows.size);
    let colour = |(i, cell)| schedule::colour(&spec.schedule.colouring, i, cell);
    let placed = || origins.iter().zip(spec.mask.cells().enumerate().map(colour));
    for (i, (&[x, y], colour)) in placed().enumerate() {
        for (value, room) in [(x, spec.detector.width), (y, spec.detector.height)] {
            let limit = (0.0, f64::from(room) - f64::from(size));
            ConfigError::check(field, Some(i), f64::from(value), limit)?;
        }
        // What is not lit is not measured: it may share pixels with what is, but an image's windows
        // have places of their own.
        let clashes = |(&other, its): (&[u16; 2], u8)| {
            other == [x, y] || (its == colour && overlap(other, [x, y], size))
        };
        if let Some(other) = placed().skip(i + 1).position(clashes) {
            let rule = Limit::Rule(
                "is a window that it overlaps; windows that are lit together must not overlap, \
                 others not coincide",
            );
            return Err(ConfigError::at(field, i, (i + 1 + other) as f64, rule));
        }
    }
    Ok(())
}

/// Whether two windows share pixels.
fn overlap([ax, ay]: [u16; 2], [bx, by]: [u16; 2], size: u16) -> bool {
    ax.abs_diff(bx) < size && ay.abs_diff(by) < size
}

/// Places of the second gate's windows among the first's; and there is no schedule.
fn second_windows(spec: &Spec<'_>, modal: &ModalSpec<'_>) -> Result<(), ConfigError> {
    gate(spec, Field::SecondOrigin, modal.origins)?;
    let (size, first) = (u16::from(spec.windows.size), spec.windows.origins);
    for (i, (&[x, y], &[x0, y0])) in modal.origins.iter().zip(first).enumerate() {
        if let Some(other) = first.iter().position(|&other| overlap(other, [x, y], size)) {
            let rule = "is a window of the first gate that it overlaps; windows must not overlap";
            let rule = Limit::Rule(rule);
            return Err(ConfigError::at(Field::SecondOrigin, i, other as f64, rule));
        }
        if (y, x) < (y0, x0) {
            return Err(ConfigError::at(Field::SecondOrigin, i, y.into(), SECOND_COMES_LATER));
        }
    }
    match spec.schedule.colouring {
        Colouring::None => Ok(()),
        _ => Err(ConfigError::new(Field::Modes, modes(spec) as f64, NO_SCHEDULE)),
    }
}

/// Modes of the second gate; 0 without one.
pub(crate) fn modes(spec: &Spec<'_>) -> usize {
    spec.modal.map_or(0, |modal| modal.modes.len() / spec.mask.count().max(1))
}

/// Of a second gate's window in a wrong place.
pub(crate) const SECOND_COMES_LATER: Limit = Limit::Rule(
    "row: must come after its subaperture's window of the first gate, by row, then column",
);
/// Of modes together with a schedule: a mode is over the whole pupil, at one time.
pub(crate) const NO_SCHEDULE: Limit =
    Limit::Rule("modes: a second gate needs all subapertures lit together, without a schedule");

/// The control law beside its gains.
pub(crate) fn control(spec: &Spec<'_>) -> Result<ControlConfig, ConfigError> {
    let delay = spec.control.delay_frames;
    let limit = (0.0, MAX_DELAY as f64);
    ConfigError::check(Field::DelayFrames, None, f64::from(delay), limit)?;
    Ok(ControlConfig { mean: spec.slopes.mean, delay })
}

/// The number of windows that one row can meet, if their pixels fit the buffer where they need to.
pub(crate) fn buffer<const B: usize>(
    estimator: &EstimatorConfig,
    size: u16,
    origins: impl Iterator<Item = [u16; 2]> + Clone,
) -> Result<usize, ConfigError> {
    let meets = |row: u16| origins.clone().filter(|[_, y]| *y <= row && row - *y < size).count();
    let concurrent = origins.clone().map(|[_, y]| meets(y)).max().unwrap_or(0);
    if let EstimatorConfig::Brightest { .. } = estimator {
        let pixels = concurrent * usize::from(size) * usize::from(size);
        ConfigError::check(Field::BrightestBuffer, None, pixels as f64, (0.0, B as f64))?;
    }
    Ok(concurrent)
}

/// The solver.
pub(crate) fn sor(spec: &Spec<'_>) -> Result<(), ConfigError> {
    let SorSpec { omega, sweeps, cold_sweeps } = spec.sor;
    ConfigError::check(Field::Omega, None, omega.unwrap_or(1.0), (1.0, 1.99))?;
    let sweeps = f64::from(sweeps.unwrap_or(1));
    ConfigError::check(Field::Sweeps, None, sweeps, (1.0, 1000.0))?;
    let cold = f64::from(cold_sweeps.unwrap_or(1));
    ConfigError::check(Field::ColdSweeps, None, cold, (1.0, 10_000.0))?;
    Ok(())
}
