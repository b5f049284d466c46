//! `memory.x` against the reference manual of the STM32H743 (RM0433, chapter 2).

use splash_tests::memory_map::{self, Region, bare, block};
use std::collections::BTreeMap;

const KIB: u64 = 1024;

/// Region, first address, bytes: RM0433, table of the memory map.
const RM0433: [(&str, u64, u64); 8] = [
    ("ITCM", 0x0000_0000, 64 * KIB),
    // Of two banks of 1 MiB the first, and two sectors of 128 KiB of the second.
    ("FLASH", 0x0800_0000, 1024 * KIB),
    ("STORE", 0x0810_0000, 2 * 128 * KIB),
    ("RAM", 0x2000_0000, 128 * KIB),
    ("AXISRAM", 0x2400_0000, 512 * KIB),
    ("SRAM123", 0x3000_0000, (128 + 128 + 32) * KIB),
    ("SRAM4", 0x3800_0000, 64 * KIB),
    ("BKPSRAM", 0x3880_0000, 4 * KIB),
];

fn script() -> String {
    bare(include_str!("../../memory.x"))
}

fn regions() -> BTreeMap<String, Region> {
    memory_map::regions(&script())
}

#[test]
fn regions_are_those_of_the_reference_manual() {
    let expected: BTreeMap<_, _> = RM0433
        .iter()
        .map(|&(name, origin, length)| (name.to_owned(), Region { origin, length }))
        .collect();
    assert_eq!(regions(), expected);
}

fn is_flash(region: &Region) -> bool {
    (0x0800_0000..0x0820_0000).contains(&region.origin)
}

/// The data sheet's own sum: 1 Mbyte of RAM on its first page is 1060 KiB with the TCMs and the
/// backup SRAM.
#[test]
fn ram_adds_up_to_that_of_the_data_sheet() {
    let ram: u64 = regions().iter().filter(|(_, r)| !is_flash(r)).map(|(_, r)| r.length).sum();
    assert_eq!(ram, 1060 * KIB);
}

#[test]
fn regions_do_not_overlap() {
    let mut regions: Vec<_> = regions().into_iter().collect();
    regions.sort_by_key(|(_, region)| region.origin);
    for pair in regions.windows(2) {
        let [(low, a), (high, b)] = pair else { unreachable!() };
        assert!(a.origin + a.length <= b.origin, "{low} runs into {high}");
    }
}

/// A region of the Armv7-M MPU has a power of two as its size and starts at a multiple of it.
#[test]
fn every_region_can_be_covered_by_one_mpu_region() {
    for (name, region) in regions() {
        assert_eq!(region.origin % region.length.next_power_of_two(), 0, "{name}");
    }
}

/// `cortex-m-rt` puts the stack at the end of RAM, and .data and .bss at its start.
#[test]
fn stack_and_hot_state_are_in_dtcm_where_no_dma_buffer_can_be_placed() {
    let dtcm = 0x2000_0000..0x2002_0000;
    let ram = regions()["RAM"];
    assert_eq!(ram.origin..ram.origin + ram.length, dtcm);
    let own = script().matches("> RAM").count();
    assert_eq!(own, 1, "RAM is left to cortex-m-rt but for the tables");
}

#[test]
fn extra_sections_are_uninitialised_and_lie_in_regions_of_their_name() {
    let script = script();
    let regions = regions();
    let (sections, after) = block(&script, "SECTIONS");
    let mut found = Vec::new();
    let mut rest = sections;
    while let Some((head, tail)) = rest.split_once('{') {
        let (_, after) = tail.split_once('}').expect("section is closed");
        let head = head.trim();
        let name = head.strip_prefix('.').and_then(|h| h.split(' ').next()).expect(".name");
        assert!(head.contains("(NOLOAD)"), ".{name} would be loaded from flash");
        let region = after.trim_start().strip_prefix('>').expect("> REGION").trim_start();
        let region = region.split_whitespace().next().expect("REGION");
        assert_eq!(region, name.to_uppercase());
        assert!(regions.contains_key(region), "{region}");
        found.push(name.to_owned());
        rest = after.split_once(region).expect("REGION").1;
    }
    assert_eq!(found, ["axisram", "sram123", "sram4", "bkpsram"]);
    // Without INSERT these would replace the sections of cortex-m-rt.
    assert!(after.trim_start().starts_with("INSERT AFTER .bss;"));
}

/// Linked for one memory, loaded from another: the board's start copies it.
#[test]
fn code_of_itcm_is_loaded_from_flash_and_leaves_the_null_pointer_alone() {
    let script = script();
    let (_, rest) = block(&script, "SECTIONS");
    let (sections, after) = block(rest, "SECTIONS");
    let (itcm, place) = block(sections, ".itcm : ALIGN(32)");
    let first = itcm.lines().map(str::trim).find(|line| !line.is_empty());
    assert_eq!(first, Some(". += 32;"));
    let place: Vec<_> = place.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    assert_eq!(place, ["> ITCM AT > FLASH", "__siitcm = LOADADDR(.itcm) + 32;"]);
    assert!(after.trim_start().starts_with("INSERT AFTER .rodata;"));
}

/// Behind .data and loaded as it is: cortex-m-rt copies both at once.
#[test]
fn tables_are_copied_with_the_data() {
    let script = script();
    let (tables, place) = block(&script, ".tables : ALIGN(4)");
    assert!(tables.trim_end().ends_with(". = ALIGN(4);"), "words are copied");
    let place: Vec<_> = place.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    assert_eq!(place, ["> RAM AT > FLASH", "} INSERT AFTER .data;"]);
}
