use check::Image;
#[test]
fn t() {
    let p = format!("{}/../../../target/budget/thumbv7em-none-eabihf/release/link", env!("CARGO_MANIFEST_DIR"));
    let image = Image::read(&std::fs::read(p).unwrap());
    for e in ["probe_decode","probe_encode","probe_upload","probe_adjust","probe_exchange","probe_read","probe_command","probe_telemetry"] {
        let start = image.entry(e);
        for (a, chain) in image.reached(start) {
            if image.functions[&a].name.contains("panic") { println!("{e}: {}", chain.join(" -> ")); }
        }
        println!("{e} stack {:?}", image.stack(start));
    }
}
