//! The stages in f64, written from their equations.
