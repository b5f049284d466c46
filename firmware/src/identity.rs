//! What this library is, told apart from any other build of it.

/// CRC-32 (ISO-HDLC) of the version and of every source file, in the order of their paths.
pub const BUILD: u32 = match u32::from_str_radix(env!("SPLASH_BUILD"), 10) {
    Ok(build) => build,
    Err(_) => 0,
};

/// Version of the library.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
