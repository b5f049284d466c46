//! Files: FITS for images, cubes and recorded runs, CSV for series.

pub mod csv;
pub mod fits;
