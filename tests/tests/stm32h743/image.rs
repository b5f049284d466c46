//! The flash image as it is linked: everything in the memory it belongs to, and nothing that the frame
//! path calls in flash. Without the target's compiler these say that they are skipped; with SPLASH_BOARDS
//! in the environment they fail in place of that.

use host_sim::board::program::cargo_build;
use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ProgramHeader};
use object::{Endianness, Object, ObjectSection, ObjectSymbol, SymbolKind};
use splash_firmware::config::Config;
use splash_firmware::geometry::Mask;
use splash_firmware::last_words::LastWords;
use splash_tests::instrument::Instrument;
use splash_tests::memory_map::{Region, bare, regions};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;
use stm32h743_logic::flash;

const BOARD: &str = "firmware/boards/stm32h743";
/// The top-level map: the only one there is.
const MAP: &str = include_str!("../../../memory.x");
/// Exceptions of the processor before its interrupts.
const EXCEPTIONS: usize = 16;
const DMA1_STREAM0: usize = EXCEPTIONS + 11;
const DCMI: usize = EXCEPTIONS + 78;
const PEND_SV: usize = 14;

/// Modules that a frame passes which a closed loop follows: the library's, and the board's; with a
/// function of those that have others as well.
const FRAME_PATH: [(&str, &str); 19] = [
    ("15splash_firmware8pipeline", "6follow"),
    ("15splash_firmware8pipeline", "6commit"),
    ("15splash_firmware8pipeline", "6retain"),
    ("15splash_firmware8pipeline", "12take_special"),
    ("15splash_firmware7readout", ""),
    ("15splash_firmware8centroid", ""),
    ("15splash_firmware6pixels", ""),
    ("15splash_firmware6slopes", ""),
    ("15splash_firmware7control", ""),
    ("15splash_firmware3sor", ""),
    ("15splash_firmware6mirror", "7advance"),
    ("15splash_firmware6mirror", "5drive"),
    ("15splash_firmware8segments", "10tilt_scale"),
    ("15splash_firmware9actuators", ""),
    ("15splash_firmware3dsp", ""),
    ("15splash_firmware5fixed", ""),
    ("15stm32h743_logic10frame_loop", ""),
    ("15stm32h743_logic6queues", ""),
    ("15stm32h743_logic9dac_burst", ""),
];

/// What the frames' exception calls in flash, and what for.
const IN_FLASH: [(&str, &str); 6] = [
    ("15splash_firmware10controller", "10not_follow"), // a frame that moves the mirror to no command
    ("15splash_firmware4mode", "4fall"),               // a fault leads to safe
    ("15splash_firmware5fault", "10book_times"),       // a fault is booked
    ("15splash_firmware8pipeline", "10scale_flux"),    // a frame that lacks pulses
    ("15stm32h743_logic6rounds", ""),                  // behind the codes
    ("15stm32h743_logic7answers", ""),                 // the main loop asks
];

fn is_among(name: &str, functions: &[(&str, &str)]) -> bool {
    functions.iter().any(|(module, function)| {
        name.split_once(module).is_some_and(|(_, rest)| rest.contains(function))
    })
}

fn top() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the source tree")
}

fn build(arguments: &[&str]) -> Output {
    cargo_build(&top().join(BOARD)).args(arguments).output().expect("cargo")
}

/// The image, built once, or `None` where it cannot be.
fn image() -> Option<&'static [u8]> {
    static IMAGE: OnceLock<Option<Vec<u8>>> = OnceLock::new();
    let built = IMAGE.get_or_init(|| {
        let output = build(&[]);
        if !output.status.success() {
            let why = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(std::env::var_os("SPLASH_BOARDS").is_none(), "{why}");
            println!("skipped: {why}");
            return None;
        }
        let file: PathBuf = "target/boards/thumbv7em-none-eabihf/release/stm32h743".into();
        Some(std::fs::read(top().join(file)).expect("an image"))
    });
    built.as_deref()
}

fn elf(image: &[u8]) -> ElfFile32<'_> {
    ElfFile32::parse(image).expect("an ELF file")
}

fn map() -> BTreeMap<String, Region> {
    regions(&bare(MAP))
}

/// Address and bytes of a section.
fn section(elf: &ElfFile32<'_>, name: &str) -> (u64, u64) {
    let section = elf.section_by_name(name).unwrap_or_else(|| panic!("no {name}"));
    (section.address(), section.size())
}

/// Address of a symbol of the linker's.
fn symbol(elf: &ElfFile32<'_>, name: &str) -> u64 {
    elf.symbol_by_name(name).unwrap_or_else(|| panic!("no {name}")).address()
}

/// What is loaded from flash: where it will be, where it is, and its bytes.
fn loaded(elf: &ElfFile32<'_>) -> Vec<[u64; 3]> {
    let endian = Endianness::Little;
    let headers = elf.elf_program_headers().iter();
    let loads = headers.filter(|h| h.p_type(endian) == PT_LOAD && h.p_filesz(endian) > 0);
    loads
        .map(|h| [h.p_vaddr(endian), h.p_paddr(endian), h.p_filesz(endian)].map(u64::from))
        .collect()
}

/// Functions: name, address.
fn functions<'a>(elf: &'a ElfFile32<'_>) -> impl Iterator<Item = (&'a str, u64)> {
    let symbols = elf.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text);
    symbols.filter_map(|symbol| Some((symbol.name().ok()?, symbol.address())))
}

#[test]
fn every_section_lies_in_its_memory_and_fits() {
    let Some(image) = image() else { return };
    let (elf, map) = (elf(image), map());
    let expected = [
        (".vector_table", "FLASH"),
        (".text", "FLASH"),
        (".rodata", "FLASH"),
        (".itcm", "ITCM"),
        (".data", "RAM"),
        (".bss", "RAM"),
        (".uninit", "RAM"),
        (".axisram", "AXISRAM"),
        (".sram123", "SRAM123"),
    ];
    let mut used = BTreeMap::<_, u64>::new();
    for (name, memory) in expected {
        let (address, bytes) = section(&elf, name);
        assert!(bytes > 0, "{name} is empty");
        assert!(map[memory].holds(address, bytes), "{name} at {address:#x}: not in {memory}");
        *used.entry(memory).or_default() += bytes;
    }
    for [_, at, bytes] in loaded(&elf) {
        assert!(map["FLASH"].holds(at, bytes), "{bytes} bytes at {at:#x} are not in flash");
    }
    let flash: u64 = loaded(&elf).iter().map(|[_, _, bytes]| bytes).sum();
    used.insert("FLASH", flash);
    for (memory, bytes) in used {
        println!("{memory}: {bytes} of {} bytes", map[memory].length);
    }
}

#[test]
fn what_is_loaded_from_flash_does_not_overlap() {
    let Some(image) = image() else { return };
    let mut loaded = loaded(&elf(image));
    loaded.sort_unstable_by_key(|&[_, at, _]| at);
    for pair in loaded.windows(2) {
        let [[_, first, bytes], [_, second, _]] = pair else { unreachable!() };
        assert!(first + bytes <= *second, "{first:#x} runs into {second:#x}");
    }
}

/// The store is not the program's, and is where the board looks for it; a slot takes an instrument of 8 x 8
/// subapertures with windows of 16 x 16 pixels.
#[test]
fn the_store_is_left_alone_and_large_enough() {
    let map = map();
    let store = Region { origin: flash::BASE.into(), length: (2 * flash::SECTOR) as u64 };
    assert_eq!(map["STORE"], store);
    // Bank 1, which is read while bank 2 is written.
    assert_eq!((map["FLASH"].origin, map["FLASH"].end()), (0x0800_0000, 0x0810_0000));
    let mut config = Box::new(Config::<64, 16_384, 0>::new());
    config.build(&Instrument::new(Mask::square(8).expect("64 cells"), 16).spec()).expect("valid");
    let mut bytes = 0;
    config.save(&mut |piece| bytes += piece.len());
    println!("image of 64 subapertures: {bytes} bytes of {}", flash::SECTOR);
    assert!(bytes + 64 <= flash::SECTOR);
    let Some(image) = image() else { return };
    for [to, at, bytes] in loaded(&elf(image)) {
        for address in [to, at] {
            assert!(address + bytes <= store.origin || address >= store.end(), "{address:#x}");
        }
    }
}

/// The start neither zeroes nor fills them.
#[test]
fn last_words_outlive_a_reset() {
    let Some(image) = image() else { return };
    let elf = elf(image);
    let (address, bytes) = section(&elf, ".uninit");
    let words = elf.symbols().find(|s| s.name().is_ok_and(|n| n.contains("6memory10LAST_WORDS")));
    let words = words.expect("last words");
    assert!((address..address + bytes).contains(&words.address()));
    assert!(words.size() >= size_of::<LastWords>() as u64);
}

#[test]
fn the_vector_table_is_where_the_processor_looks_for_it() {
    let Some(image) = image() else { return };
    let (elf, map) = (elf(image), map());
    let table = elf.section_by_name(".vector_table").expect("a table");
    assert_eq!(table.address(), map["FLASH"].origin);
    let words = table.data().expect("its bytes").as_chunks::<4>().0;
    let words: Vec<_> = words.iter().map(|&word| u64::from(u32::from_le_bytes(word))).collect();
    // Stack, exceptions and the 150 interrupts of the part.
    assert_eq!(words.len(), EXCEPTIONS + 150);
    assert_eq!(words[0], map["RAM"].end(), "the stack grows down from the end of DTCM");
    assert_eq!(words[1], elf.entry(), "reset");
    assert!(map["FLASH"].holds(words[1], 1));
    for (number, &word) in words.iter().enumerate().skip(1).filter(|&(_, &word)| word != 0) {
        assert_eq!(word % 2, 1, "vector {number} is no Thumb code");
        let hot = [PEND_SV, DMA1_STREAM0, DCMI].contains(&number);
        let memory = map[if hot { "ITCM" } else { "FLASH" }];
        assert!(memory.holds(word, 1), "vector {number} is {word:#x}");
    }
    assert_ne!(words[DMA1_STREAM0], words[DCMI]);
}

#[test]
fn the_frame_path_lies_in_itcm() {
    let Some(image) = image() else { return };
    let (elf, map) = (elf(image), map());
    let mut seen = 0;
    for (name, address) in functions(&elf) {
        let hot = is_among(name, &FRAME_PATH);
        // A thunk is a jump to another memory, named after its aim.
        if hot && !name.contains("Thunk") {
            assert!(map["ITCM"].holds(address, 1), "{name} at {address:#x}");
            seen += 1;
        }
    }
    assert!(seen > 5, "{seen} functions: have they other names?");
}

/// ITCM is too far from flash for a branch: the linker makes a thunk for each function that is called
/// there, named after it.
#[test]
fn what_a_followed_frame_needs_before_its_codes_is_not_in_flash() {
    let Some(image) = image() else { return };
    let (elf, map) = (elf(image), map());
    let thunks = functions(&elf).filter(|(name, _)| name.contains("Thunk"));
    let (inside, outside): (Vec<_>, Vec<_>) =
        thunks.partition(|&(_, address)| map["ITCM"].holds(address, 1));
    let mut inside = inside.iter().filter(|(name, _)| !is_among(name, &IN_FLASH));
    assert_eq!(inside.next(), None, "calls from ITCM to flash");
    assert!(!outside.is_empty(), "no calls from flash to ITCM: have thunks another name?");
}

#[test]
fn code_of_itcm_is_copied_from_where_it_is_loaded() {
    let Some(image) = image() else { return };
    let elf = elf(image);
    let [start, end, from] = ["__sitcm", "__eitcm", "__siitcm"].map(|name| symbol(&elf, name));
    let (address, bytes) = section(&elf, ".itcm");
    assert_eq!((start, end), (address + 32, address + bytes));
    assert_eq!([start % 4, end % 4, from % 4], [0; 3], "words are copied");
    let segments = loaded(&elf);
    let [_, at, _] = segments.iter().find(|&&[to, ..]| to == address).expect("a segment");
    assert_eq!(from, at + 32);
    // The reset path calls what copies it, and not the empty one that cortex-m-rt provides.
    let copies = elf.symbol_by_name("__pre_init").expect("it is called");
    assert!(copies.size() > 16, "{} bytes", copies.size());
}

/// cortex-m-rt copies from `__sidata` to all between `__sdata` and `__edata`.
#[test]
fn tables_are_copied_with_the_data() {
    let Some(image) = image() else { return };
    let elf = elf(image);
    let [start, end, from] = ["__sdata", "__edata", "__sidata"].map(|name| symbol(&elf, name));
    let (address, bytes) = section(&elf, ".tables");
    assert!(bytes > 0 && start <= address && address + bytes <= end);
    let segments = loaded(&elf);
    let holds = |&&[to, _, length]: &&[u64; 3]| (to..to + length).contains(&address);
    let [to, at, _] = segments.iter().find(holds).expect("a segment");
    assert_eq!(at + (address - to), from + (address - start));
}

/// They have no image: were they not all zeros, the compiler would not have put them where the linker
/// script finds them.
#[test]
fn banks_are_what_the_start_zeroes() {
    let Some(image) = image() else { return };
    let elf = elf(image);
    let [start, end] = ["__sbanks", "__ebanks"].map(|name| symbol(&elf, name));
    let banks = elf.symbols().find(|s| s.name().is_ok_and(|name| name.contains("6memory5BANKS")));
    let banks = banks.expect("banks");
    assert_eq!(start, banks.address());
    assert!((end - 32..=end).contains(&(start + banks.size())));
    assert_eq!([start % 4, end % 4], [0; 2], "words are zeroed");
}

#[test]
fn statics_lie_where_their_users_can_reach_them() {
    let Some(image) = image() else { return };
    let (elf, map) = (elf(image), map());
    // Name, memory, whether a DMA writes or reads it.
    let statics = [
        ("6memory5BANKS", "AXISRAM", false),
        ("6memory4RING", "AXISRAM", true),
        ("6memory9DAC_WORDS", "SRAM123", true),
        ("6memory9LINK_RING", "SRAM123", true),
        ("8geometry10CONTROLLER", "RAM", false),
        ("8geometry9TELEMETRY", "RAM", false),
        ("6memory10LAST_WORDS", "RAM", false),
        ("8geometry6QUEUES", "RAM", false),
        ("10interrupts4ROWS", "RAM", false),
        ("10interrupts6FRAMES", "RAM", false),
        ("15splash_firmware4root5LINES", "RAM", false),
        ("15splash_firmware4root5STEPS", "RAM", false),
        ("15splash_firmware7inverse8INVERSES", "RAM", false),
        ("15splash_firmware7control8INVERSES", "RAM", false),
    ];
    for (name, memory, dma) in statics {
        let found = elf.symbols().find(|symbol| symbol.name().is_ok_and(|n| n.contains(name)));
        let found = found.unwrap_or_else(|| panic!("no {name}"));
        let (address, bytes) = (found.address(), found.size());
        assert!(map[memory].holds(address, bytes), "{name} at {address:#x}: not in {memory}");
        println!("{name}: {bytes} bytes at {address:#x}");
        if dma {
            assert_eq!((address % 32, bytes % 32), (0, 0), "{name} shares a cache line");
        }
    }
}

/// What src/geometry.rs keeps for it.
#[test]
fn the_stack_has_its_32_kib() {
    let Some(image) = image() else { return };
    let (elf, map) = (elf(image), map());
    let (address, bytes) = section(&elf, ".uninit");
    let free = map["RAM"].end() - (address + bytes);
    println!("stack: {free} bytes");
    assert!(free >= 32 * 1024, "{free} bytes");
}

#[test]
fn the_map_is_that_of_the_top_level() {
    assert!(!top().join(BOARD).join("memory.x").exists(), "it would be taken in its place");
    let Some(image) = image() else { return };
    let (elf, ram) = (elf(image), map()["RAM"]);
    assert_eq!(symbol(&elf, "__sdata"), ram.origin);
    assert_eq!(symbol(&elf, "_stack_start"), ram.end());
}

#[test]
fn cargo_run_flashes_this_part() {
    let config = std::fs::read_to_string(top().join(BOARD).join(".cargo/config.toml"));
    let config = config.expect("a configuration");
    assert!(config.contains("target = \"thumbv7em-none-eabihf\""));
    assert!(config.contains("runner = \"probe-rs run --chip STM32H743ZITx\""));
}

#[test]
fn a_geometry_that_does_not_fit_is_refused_by_the_compiler_which_says_by_how_much() {
    // Without the target there is nothing to refuse it.
    if image().is_none() {
        return;
    }
    let output = build(&["--features", "too-large"]);
    assert!(!output.status.success());
    let text = String::from_utf8_lossy(&output.stderr);
    let (needs, more) = text.split_once("bytes of AXI SRAM: ").expect("AXI SRAM");
    let last_number = |text: &str| {
        let word = text.split_whitespace().next_back().map(str::to_owned);
        word.and_then(|word| word.parse::<u64>().ok())
    };
    let needed = last_number(needs).expect("what it needs");
    let more = more.split_once(" more than the board has").expect("by how much").0;
    assert_eq!(last_number(more), Some(needed - map()["AXISRAM"].length));
    assert!(text.contains("M = 1600: there are DACs for 78 segments: 1522 fewer"), "{text}");
}
