//! Who may still panic on a board: the callers of the panic machinery in each image as it is linked,
//! against `golden/panics.txt`, and each in start-up, logging or an emulator's own way in and out.
//!
//! `SPLASH_ACCEPT=1 cargo test -p splash-tests --test panics` accepts another list, not another place. A
//! board whose compiler is missing is skipped, or fails where SPLASH_BOARDS is set.

use host_sim::board::program::{BuildError, cargo_build};
use host_sim::board::{BoardError, ibex, qemu};
use object::{Object, ObjectSection, ObjectSymbol, RelocationTarget, SymbolKind};
use splash_tests::golden;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Functions of the machinery, by what their names have in them.
const MACHINERY: [&str; 7] = [
    "core::panicking::",
    "unwrap_failed",
    "expect_failed",
    "core::slice::index::slice_",
    "core::slice::copy_from_slice_impl::len_mismatch_fail",
    "core::str::slice_error_fail",
    "core::cell::panic_",
];

/// Where a caller may be, and what that is.
const PLACES: [(&str, &str); 8] = [
    ("defmt_semihosting::", "logging"),
    ("defmt_rtt::", "logging"),
    ("_defmt_acquire", "logging"),
    // Values of refused fields, in words.
    ("core::num::", "logging"),
    ("core::fmt::float::", "logging"),
    ("__cortex_m_rt_main", "start-up"),
    // Clocks and the link's UART.
    ("embassy_stm32::", "start-up"),
    ("mps2_an500::pipes::", "the emulator's pipes"),
];

/// A name without its hash.
fn demangled(name: &str) -> String {
    format!("{:#}", rustc_demangle::demangle(name))
}

/// Functions outside the machinery that call into it, in an image linked with its relocations.
fn callers(image: &[u8]) -> BTreeSet<String> {
    let file = object::File::parse(image).expect("an image");
    // The last bit of an address says Thumb.
    let functions: BTreeMap<u64, (u64, String)> = file
        .symbols()
        .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0)
        .map(|symbol| (symbol.address() & !1, (symbol.size(), symbol.name().unwrap_or_default())))
        .map(|(start, (size, name))| (start, (size, demangled(name))))
        .collect();
    let containing = |address: u64| {
        let (start, (size, name)) = functions.range(..=address).next_back()?;
        (address < start + size).then_some(name)
    };
    let is_machinery = |name: &str| MACHINERY.iter().any(|part| name.contains(part));
    let (mut found, mut relocations) = (BTreeSet::new(), 0);
    for section in file.sections().filter(|section| section.kind() == object::SectionKind::Text) {
        for (offset, relocation) in section.relocations() {
            relocations += 1;
            let RelocationTarget::Symbol(target) = relocation.target() else { continue };
            let target = file.symbol_by_index(target).expect("a symbol");
            if !is_machinery(&demangled(target.name().unwrap_or_default())) {
                continue;
            }
            // Offsets of a linked image are addresses.
            let caller = containing(offset).cloned().unwrap_or_else(|| format!("{offset:#x}"));
            if !is_machinery(&caller) {
                found.insert(caller);
            }
        }
    }
    assert!(relocations > 100, "the image has its relocations");
    found
}

/// The STM32H743's image.
fn flash_image() -> Result<PathBuf, BoardError> {
    let board = "stm32h743";
    let top = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..");
    let folder = top.join("firmware/boards").join(board);
    let failed = |source| BoardError::Build { board, source };
    let status = cargo_build(&folder).status().map_err(|e| failed(BuildError::Cargo(e)))?;
    if !status.success() {
        return Err(failed(BuildError::Failed { folder, target: "thumbv7em-none-eabihf" }));
    }
    Ok(top.join("target/boards/thumbv7em-none-eabihf/release").join(board))
}

fn program(built: Result<PathBuf, BoardError>) -> Option<Vec<u8>> {
    match built {
        Ok(path) => Some(std::fs::read(path).expect("the program")),
        Err(error) => {
            assert!(std::env::var_os("SPLASH_BOARDS").is_none(), "{error}");
            println!("skipped: {error}");
            None
        }
    }
}

#[test]
fn only_start_up_and_logging_may_panic() {
    let images = [
        ("mps2-an500", qemu::program("server")),
        ("ibex", ibex::program("server")),
        ("stm32h743", flash_image()),
    ];
    let mut lines = Vec::new();
    for (board, built) in images {
        let Some(image) = program(built) else { return };
        for caller in callers(&image) {
            let place = PLACES.iter().find(|(part, _)| caller.contains(part));
            let (_, place) = place.unwrap_or_else(|| panic!("{board}: {caller} may panic"));
            lines.push(format!("{board} {} {}", caller.replace(' ', "_"), place.replace(' ', "-")));
        }
    }
    golden::check("panics", "the linker", &lines);
}
