//! Files: FITS for images, cubes and recorded runs, CSV for series; locks.

pub mod csv;
pub mod fits;
pub mod lock;
