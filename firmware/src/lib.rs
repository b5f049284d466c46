//! SPLASH reconstructor.
#![no_std]
