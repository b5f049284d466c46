//! The frame path as it is linked for the two bare-metal targets: no panic, no floating point, no
//! division whose time depends on its operands, and a bounded stack. `tests/run` builds the probes.

use check::Image;

const TARGETS: [&str; 2] = ["thumbv7em-none-eabihf", "riscv32imc-unknown-none-elf"];
const ENTRIES: [&str; 6] = [
    "probe_begin",
    "probe_push_row",
    "probe_finish",
    "probe_begin_two_gates",
    "probe_push_row_two_gates",
    "probe_finish_two_gates",
];

/// Bytes of stack below any entry, interrupts apart. The deepest took 1168 when this was set; the
/// rest of the 64 KiB of hot state and stack belongs to the state.
const STACK_LIMIT: u64 = 2048;

const KIB: u64 = 1024;
/// Bytes of a calibration bank, as `TARGETS`: two of them leave 26 KiB of 256 for a ring of rows; on RISC-V, where
/// much is kept as its kernels take it as well, 80 bytes a window, one leaves hot state and 57 KiB of 256 for a ring
/// and the stack.
const BANK_LIMITS: [u64; 2] = [115 * KIB, 135 * KIB];
/// Bytes of hot state.
const STATE_LIMIT: u64 = 64 * KIB - STACK_LIMIT;

fn file(target: &str, probe: &str) -> Vec<u8> {
    let path =
        format!("{}/../../../target/budget/{target}/release/{probe}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read(&path).unwrap_or_else(|error| panic!("{path}: {error}; use tests/run"))
}

fn image(target: &str, probe: &str) -> Image {
    Image::read(&file(target, probe))
}

#[test]
fn banks_and_hot_state_fit() {
    for (target, bank_limit) in TARGETS.into_iter().zip(BANK_LIMITS) {
        let sizes = check::constant(&file(target, "frame_path"), "PROBE_SIZES");
        let limits = [bank_limit, bank_limit, STATE_LIMIT, STATE_LIMIT];
        let names = ["bank", "bank, brightest-n", "state", "state, brightest-n"];
        let (instruments, rest) = sizes.as_chunks::<4>();
        assert!(instruments.len() == 2 && rest.is_empty(), "two instruments of four sizes");
        for (instrument, sizes) in ["N = 8, W = 16", "N = 16, W = 8"].iter().zip(instruments) {
            for ((name, &bytes), limit) in names.iter().zip(sizes).zip(limits) {
                println!("{target}, {instrument}: {name:20} {bytes:7} of {limit} bytes");
                assert!(u64::from(bytes) <= limit, "{target}, {instrument}: {name}: {bytes}");
            }
        }
    }
}

/// What is wrong below one entry, one line each: the rule, and the chain of calls that breaks it.
fn offences(image: &Image, entry: &str) -> Vec<String> {
    let start = image.entry(entry);
    let mut found = Vec::new();
    for (address, chain) in image.reached(start) {
        let function = &image.functions[&address];
        let broken = [
            // Every panic goes through this one.
            ("panic", function.name.contains("9panic_fmt")),
            ("float", !function.float.is_empty() || is_soft_float(&function.name)),
            ("division", is_long_division(&function.name)),
        ];
        let broken = broken.iter().filter(|(_, broken)| *broken);
        found.extend(broken.map(|(rule, _)| format!("{rule}: {}", chain.join(" -> "))));
    }
    match image.stack(start) {
        Ok(bytes) if bytes <= STACK_LIMIT => println!("{entry}: {bytes} bytes of stack"),
        Ok(bytes) => found.push(format!("stack: {bytes} bytes below {entry}")),
        Err(reason) => found.push(format!("stack: no bound below {entry}: {reason}")),
    }
    found
}

/// The compiler's run-time routines for `f32` and `f64`: `__addsf3`, `__fixdfsi`, `__aeabi_fmul`,
/// and what libm adds.
fn is_soft_float(name: &str) -> bool {
    let routine = name.strip_prefix("__").is_some_and(|name| {
        name.starts_with("aeabi_f")
            || name.starts_with("aeabi_d")
            || ["sf", "df"].iter().any(|kind| name.contains(kind))
    });
    routine || name.contains("4libm")
}

/// 64-bit division and remainder, by loops on the bits of their operands.
fn is_long_division(name: &str) -> bool {
    ["divdi3", "moddi3", "divmoddi4", "ldivmod"].iter().any(|routine| name.contains(routine))
}

#[test]
fn the_frame_path_breaks_no_rule() {
    let mut found = Vec::new();
    for target in TARGETS {
        let image = image(target, "frame_path");
        for entry in ENTRIES {
            found.extend(offences(&image, entry).iter().map(|line| format!("{target}: {line}")));
        }
    }
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

/// What bytes from outside reach: the link's decoder and encoder, uploads, adjustments, commands, telemetry.
/// That it links says the same, since its panic handler calls a function that there is not.
#[test]
fn bytes_from_outside_reach_no_panic() {
    for target in TARGETS {
        let image = image(target, "link");
        for entry in
            ["decode", "encode", "upload", "adjust", "exchange", "read", "command", "telemetry"]
        {
            let reached = image.reached(image.entry(&format!("probe_{entry}")));
            let panics = |chain: &&Vec<&str>| chain.iter().any(|name| name.contains("9panicking"));
            let found: Vec<_> = reached.values().filter(panics).collect();
            assert!(found.is_empty(), "{target}, {entry}: {found:?}");
        }
    }
}

/// The check itself: a program that breaks each rule once is caught each time.
#[test]
fn the_check_sees_what_it_looks_for() {
    for target in TARGETS {
        let image = image(target, "guilty");
        let sees = |entry, what: &str| {
            let found = offences(&image, entry);
            assert!(found.iter().any(|line| line.contains(what)), "{target}, {entry}: {found:?}");
        };
        sees("probe_begin", "panic");
        sees("probe_push_row", "float: ");
        sees("probe_push_row", "division: ");
        sees("probe_finish", "through a pointer");
        sees("probe_large", "stack: 4");
        sees("probe_recurse", "recursive");
    }
}
