//! Tells the library whether the target has the Armv7E-M instructions on pairs of 16 bits: stable
//! compilers have no `target_feature` for them.

fn main() {
    println!("cargo:rustc-check-cfg=cfg(armv7em)");
    println!("cargo:rerun-if-changed=build.rs");
    let target = std::env::var("TARGET").unwrap_or_default();
    if target.starts_with("thumbv7em") {
        println!("cargo:rustc-cfg=armv7em");
    }
}
