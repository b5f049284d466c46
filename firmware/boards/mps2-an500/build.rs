//! Linker scripts: as arguments from here they cannot be lost to a RUSTFLAGS of the caller.

fn main() {
    for script in ["link.x", "defmt.x"] {
        println!("cargo:rustc-link-arg-bins=-T{script}");
    }
    // So that a test can see who calls what.
    println!("cargo:rustc-link-arg-bins=--emit-relocs");
    // The page size of a PC would align sections that have no pages.
    println!("cargo:rustc-link-arg-bins=--nmagic");
    println!("cargo:rerun-if-changed=memory.x");
}
