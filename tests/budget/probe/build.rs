//! Only what the entries reach stays in the image; relocations stay, because they are its call graph.

fn main() {
    for argument in ["--gc-sections", "--emit-relocs", "--no-relax"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    for entry in ["begin", "push_row", "finish"] {
        println!("cargo:rustc-link-arg-bins=--undefined=probe_{entry}");
    }
    println!("cargo:rustc-link-arg-bin=frame_path=--undefined=PROBE_SIZES");
    for entry in ["begin", "push_row", "finish"] {
        println!("cargo:rustc-link-arg-bin=frame_path=--undefined=probe_{entry}_two_gates");
    }
    for entry in ["large", "recurse"] {
        println!("cargo:rustc-link-arg-bin=guilty=--undefined=probe_{entry}");
    }
    let outside =
        ["decode", "encode", "upload", "adjust", "exchange", "read", "command", "telemetry"];
    for entry in outside {
        println!("cargo:rustc-link-arg-bin=link=--undefined=probe_{entry}");
    }
}
