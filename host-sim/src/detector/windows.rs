//! Spot images onto the detector.

use super::DetectorError;

/// Adds each spot's image into the expectation of the whole detector.
///
/// * `images`: spot-major, then row-major `window` x `window`; the fraction of the spot's light in
///   each pixel.
/// * `flux_e`: photo-electrons per spot and frame.
/// * `origins`: first column and row of each spot's window on the detector, `[x, y]`; windows may
///   overlap.
/// * `width`: columns of the detector, pixels.
/// * `expected_e`: height x width photo-electrons; pixels outside all windows are left alone.
///
/// # Errors
/// If `images` does not hold one window per origin, `expected_e` is not a whole number of rows, or
/// a window leaves the detector; `expected_e` is then unchanged.
pub fn place(
    images: &[f32],
    flux_e: f32,
    origins: &[[usize; 2]],
    window: usize,
    width: usize,
    expected_e: &mut [f32],
) -> Result<(), DetectorError> {
    let size = |what, expected, found| {
        if expected == found { Ok(()) } else { Err(DetectorError::Size { what, expected, found }) }
    };
    size("spot images", origins.len() * window * window, images.len())?;
    let height = expected_e.len().checked_div(width).unwrap_or(0);
    size("expected photo-electrons", width * height, expected_e.len())?;
    for (spot, &[x, y]) in origins.iter().enumerate() {
        if x.saturating_add(window) > width || y.saturating_add(window) > height {
            return Err(DetectorError::Window { spot, x, y, window, width, height });
        }
    }
    if window == 0 {
        return Ok(());
    }
    for (image, &[x, y]) in images.chunks_exact(window * window).zip(origins) {
        for (row, line) in image.chunks_exact(window).enumerate() {
            let start = (y + row) * width + x;
            for (expected, &fraction) in expected_e[start..start + window].iter_mut().zip(line) {
                *expected += flux_e * fraction;
            }
        }
    }
    Ok(())
}
