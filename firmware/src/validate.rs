//! Checks of a specification that need no conversion: sizes, places, ranges of counts.

use crate::centroid::{EstimatorConfig, MAX_WINDOW, MIN_WINDOW};
use crate::control::{ControlConfig, MAX_DELAY};
use crate::error::{ConfigError, Field, Limit};
use crate::schedule;
use crate::spec::{SorSpec, Spec};

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
    ConfigError::check(Field::WindowPixels, None, (count * size * size) as f64, (1.0, P as f64))?;
    if let Some(level) = spec.pixels.saturation_adu {
        let top = f64::from((1u32 << spec.detector.bits) - 1);
        check(Field::Saturation, level, (1.0, top))?;
    }
    Ok(())
}

/// Places of windows and bad pixels.
pub(crate) fn windows(spec: &Spec<'_>) -> Result<(), ConfigError> {
    let (size, origins) = (u16::from(spec.windows.size), spec.windows.origins);
    let colour = |(i, cell)| schedule::colour(&spec.schedule.colouring, i, cell);
    let placed = || origins.iter().zip(spec.mask.cells().enumerate().map(colour));
    for (i, (&[x, y], colour)) in placed().enumerate() {
        for (value, room) in [(x, spec.detector.width), (y, spec.detector.height)] {
            let limit = (0.0, f64::from(room) - f64::from(size));
            ConfigError::check(Field::WindowOrigin, Some(i), f64::from(value), limit)?;
        }
        // What is not lit is not measured: it may share pixels with what is, but an image's windows
        // have places of their own.
        let clashes = |(&[ox, oy], other): (&[u16; 2], u8)| {
            let apart = [x.abs_diff(ox), y.abs_diff(oy)];
            let overlap = apart.iter().all(|&pixels| pixels < size);
            apart == [0, 0] || (overlap && other == colour)
        };
        if let Some(other) = placed().skip(i + 1).position(clashes) {
            let rule = Limit::Rule(
                "is a window that it overlaps; windows that are lit together must not overlap, \
                 others not coincide",
            );
            return Err(ConfigError::at(Field::WindowOrigin, i, (i + 1 + other) as f64, rule));
        }
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
    origins: &[[u16; 2]],
) -> Result<usize, ConfigError> {
    let meets = |row: u16| origins.iter().filter(|[_, y]| *y <= row && row - *y < size).count();
    let concurrent = origins.iter().map(|&[_, y]| meets(y)).max().unwrap_or(0);
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
