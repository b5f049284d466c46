//! Linker scripts: as arguments from here they cannot be lost to a RUSTFLAGS of the caller. The memory
//! map is that of the top level: the linker finds its copy, since this folder has none of its own.

use std::path::Path;
use std::{env, fs};

fn main() {
    let map = "../../../memory.x";
    let out = env::var_os("OUT_DIR").expect("cargo says where");
    fs::copy(map, Path::new(&out).join("memory.x")).expect("memory.x at the top level");
    println!("cargo:rerun-if-changed={map}");
    println!("cargo:rustc-link-search={}", Path::new(&out).display());
    for script in ["link.x", "defmt.x"] {
        println!("cargo:rustc-link-arg-bins=-T{script}");
    }
    // So that a test can see who calls what.
    println!("cargo:rustc-link-arg-bins=--emit-relocs");
    // The page size of a PC would align sections that have no pages.
    println!("cargo:rustc-link-arg-bins=--nmagic");
}
