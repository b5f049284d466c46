//! Linker scripts: as arguments from here they cannot be lost to a RUSTFLAGS of the caller.

fn main() {
    println!("cargo:rustc-link-search={}", env!("CARGO_MANIFEST_DIR"));
    println!("cargo:rustc-link-arg-bin=server=-Tserver.x");
    // More code than a controller has; the simulator has the memory for it.
    println!("cargo:rustc-link-arg-bin=suite=-Tsuite.x");
    // So that a test can see who calls what.
    println!("cargo:rustc-link-arg-bins=--emit-relocs");
    // The page size of a PC would align sections that have no pages.
    println!("cargo:rustc-link-arg-bins=--nmagic");
    for script in ["server.x", "suite.x", "sections.x"] {
        println!("cargo:rerun-if-changed={script}");
    }
}
