//! Tells the library whether the target has the Armv7E-M instructions on pairs of 16 bits, since stable
//! compilers have no `target_feature` for them, and what its own source is.

use std::fs;
use std::path::{Path, PathBuf};

fn main() {
    println!("cargo:rustc-check-cfg=cfg(armv7em)");
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=src");
    let target = std::env::var("TARGET").unwrap_or_default();
    if target.starts_with("thumbv7em") {
        println!("cargo:rustc-cfg=armv7em");
    }
    println!("cargo:rustc-env=SPLASH_BUILD={}", source_hash());
}

/// CRC-32 (ISO-HDLC) over version and source files, by path.
fn source_hash() -> u32 {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let mut digest = crc.digest();
    digest.update(env!("CARGO_PKG_VERSION").as_bytes());
    let mut files = Vec::new();
    find(Path::new("src"), &mut files);
    files.sort();
    for file in files {
        let source = fs::read(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        digest.update(&source);
    }
    digest.finalize()
}

fn find(folder: &Path, files: &mut Vec<PathBuf>) {
    let entries =
        fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() { find(&path, files) } else { files.push(path) }
    }
}
