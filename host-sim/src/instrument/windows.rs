//! Where the windows are on the detector.
//!
//! SPLASH's spots are a pitch d apart at the height H, d / H on the sky; a pixel is lambda / (p d). Relayed one
//! by one they get windows at any distance. As they are on the sky they are
//!
//! ```text
//! p d^2 / (lambda H)   pixels
//! ```
//!
//! apart, 78 in the default instrument but 9.4 under a sodium beacon (0.5 m, 589 nm, 90 km, p = 2): a window
//! then has light of its neighbours in it. Spots and windows lie in the nearest whole pixels, so that a
//! distance is up to one pixel off; images are exact within the field that is computed of each
//! ([`Instrument::field_px`]), which repeats itself beyond n p pixels of n samples a subaperture.

use super::Instrument;
use super::limits::MAX_DETECTOR_SIDE;
use crate::error::{Error, refuse};
use serde::{Deserialize, Serialize};
use splash_firmware::centroid::MAX_WINDOW;

/// The windows on the detector.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct Windows {
    pub size: usize,
    pub layout: LayoutName,
    pub spacing_px: usize,
    pub pixels_per_lambda_d: f64,
}

/// What decides on the windows' places.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub enum LayoutName {
    Relayed,
    Sky,
}

impl Windows {
    /// The same windows without light of other spots.
    #[must_use]
    pub fn relayed(self) -> Self {
        match self.layout {
            LayoutName::Relayed => self,
            LayoutName::Sky => Self { layout: LayoutName::Relayed, spacing_px: self.size, ..self },
        }
    }
}

impl Instrument {
    /// From one spot to the next on the sky, pixels.
    pub fn spacing_on_sky_px(&self) -> f64 {
        let pitch_m = self.telescope.pitch_m;
        let lambda_d = pitch_m * pitch_m / (self.laser.wavelength_m * self.laser.beacon_height_m);
        lambda_d * self.windows.pixels_per_lambda_d
    }

    /// Pixels on a side of the image that is computed of each spot, around the middle of its window.
    pub fn field_px(&self) -> usize {
        let size = self.windows.size;
        match self.windows.layout {
            LayoutName::Relayed => size,
            LayoutName::Sky => {
                let period_px = self.telescope.samples as f64 * self.windows.pixels_per_lambda_d;
                let most = (period_px as usize).min(MAX_WINDOW).max(size);
                // As even or odd as the window, so that pixels fall on pixels.
                most - (most - size) % 2
            }
        }
    }

    /// First column and row of each subaperture's window: relayed edge to edge or with empty pixels
    /// all around, or as the spots are on the sky.
    ///
    /// # Errors
    /// [`Error::Config`] if windows of spots that are lit together would overlap, or the detector would be
    /// larger than any.
    pub fn origins(&self) -> Result<Vec<[u16; 2]>, Error> {
        let Windows { size, layout, spacing_px, .. } = self.windows;
        let cells: Vec<_> = self.mask()?.cells().collect();
        if layout == LayoutName::Sky {
            let margin = (self.field_px() - size) / 2;
            let place = |i: usize| (self.place_on_sky_px(i) + margin) as u16;
            self.check_sky(&cells)?;
            return Ok(cells.iter().map(|&(x, y)| [place(x), place(y)]).collect());
        }
        if spacing_px < size || self.detector_side() > MAX_DETECTOR_SIDE {
            let limit = format!(
                "from windows.size = {size} to {MAX_DETECTOR_SIDE} / telescope.subapertures = {}",
                MAX_DETECTOR_SIDE / self.telescope.subapertures.max(1)
            );
            return Err(refuse("windows.spacing_px", spacing_px, &limit));
        }
        let place = |i: usize| (i * spacing_px + (spacing_px - size) / 2) as u16;
        Ok(cells.iter().map(|&(x, y)| [place(x), place(y)]).collect())
    }

    /// Pixels on a side of the detector.
    pub fn detector_side(&self) -> usize {
        let across = self.telescope.subapertures;
        match self.windows.layout {
            LayoutName::Relayed => across.saturating_mul(self.windows.spacing_px),
            LayoutName::Sky => {
                self.place_on_sky_px(across.saturating_sub(1)).saturating_add(self.field_px())
            }
        }
    }

    /// The nearest whole pixel to the i-th spot of a row, from the first.
    fn place_on_sky_px(&self, i: usize) -> usize {
        // A detector too large by far saturates.
        (self.spacing_on_sky_px() * i as f64).round() as usize
    }

    /// The largest windows of spots as they are on the sky: pixels between the nearest two that are lit
    /// together, in columns or rows; `None` if no two are.
    ///
    /// # Errors
    /// [`Error::Config`] for a schedule that cannot be.
    pub fn room_on_sky_px(&self) -> Result<Option<usize>, Error> {
        let cells: Vec<_> = self.mask()?.cells().collect();
        let colours = self.colours()?;
        let place = |i: usize| self.place_on_sky_px(i);
        let spots: Vec<_> = cells.iter().map(|&(x, y)| [place(x), place(y)]).zip(colours).collect();
        let pairs =
            spots.iter().enumerate().flat_map(|(i, a)| spots[..i].iter().map(move |b| (a, b)));
        let together = pairs.filter(|((_, a), (_, b))| a == b);
        Ok(together.map(|(([x, y], _), ([u, v], _))| x.abs_diff(*u).max(y.abs_diff(*v))).min())
    }

    /// Refuses spots as they are on the sky that share a pixel, windows that do not fit and a detector that is
    /// too large.
    fn check_sky(&self, cells: &[(usize, usize)]) -> Result<(), Error> {
        let size = self.windows.size;
        let spacing_px = self.spacing_on_sky_px();
        if spacing_px < 1.0 && cells.len() > 1 {
            let limit = "1 or more: take more windows.pixels_per_lambda_d";
            return Err(refuse("windows.layout: pixels from spot to spot", spacing_px, limit));
        }
        if self.detector_side() > MAX_DETECTOR_SIDE {
            let limit = format!("at most {MAX_DETECTOR_SIDE}, {spacing_px:.1} from spot to spot");
            let field = "windows.layout: pixels on a side of the detector";
            return Err(refuse(field, self.detector_side(), &limit));
        }
        match self.room_on_sky_px()? {
            Some(room) if size > room => {
                let limit = format!(
                    "at most {room}, the pixels between two spots that are lit together; see \
                     schedule.lattice"
                );
                Err(refuse("windows.size", size, &limit))
            }
            _ => Ok(()),
        }
    }
}
