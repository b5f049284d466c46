//! The regions of a linker script's `MEMORY`.

use std::collections::BTreeMap;

/// A region of memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// First address.
    pub origin: u64,
    /// Bytes.
    pub length: u64,
}

impl Region {
    /// The address behind the last.
    pub fn end(&self) -> u64 {
        self.origin + self.length
    }

    /// Whether these bytes lie in it.
    pub fn holds(&self, address: u64, bytes: u64) -> bool {
        self.origin <= address && address + bytes <= self.end()
    }
}

/// A script without its comments.
///
/// # Panics
/// If one is not closed.
pub fn bare(script: &str) -> String {
    let mut bare = String::new();
    for (i, part) in script.split("/*").enumerate() {
        bare += if i == 0 { part } else { part.split_once("*/").expect("comment is closed").1 };
    }
    bare
}

fn number(text: &str) -> u64 {
    let text = text.trim();
    if let Some(hex) = text.strip_prefix("0x") {
        u64::from_str_radix(hex, 16).expect("hexadecimal")
    } else if let Some(kib) = text.strip_suffix('K') {
        kib.parse::<u64>().expect("KiB") * 1024
    } else {
        text.parse().expect("decimal")
    }
}

/// What is between the braces behind the first `name`, and what follows them.
///
/// # Panics
/// If there is no such block.
pub fn block<'a>(script: &'a str, name: &str) -> (&'a str, &'a str) {
    let (_, rest) = script.split_once(name).expect(name);
    let body = rest.trim_start().strip_prefix('{').expect("opening brace");
    let mut depth = 1;
    for (i, c) in body.char_indices() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if depth == 0 {
            return (&body[..i], &body[i + 1..]);
        }
    }
    panic!("{name} is not closed");
}

/// The regions of a script without comments.
///
/// # Panics
/// If it cannot be read, or a region is named twice.
pub fn regions(script: &str) -> BTreeMap<String, Region> {
    let lines = block(script, "MEMORY").0.lines().filter(|line| !line.trim().is_empty());
    let regions: Vec<_> = lines
        .map(|line| {
            let (name, rest) = line.split_once(':').expect("name : ORIGIN = .., LENGTH = ..");
            let (origin, length) = rest.split_once(',').expect("ORIGIN, LENGTH");
            let value = |text: &str, key| {
                let (found, value) = text.split_once('=').expect("key = value");
                assert_eq!(found.trim(), key);
                number(value)
            };
            let region =
                Region { origin: value(origin, "ORIGIN"), length: value(length, "LENGTH") };
            (name.trim().to_owned(), region)
        })
        .collect();
    let count = regions.len();
    let map: BTreeMap<_, _> = regions.into_iter().collect();
    assert_eq!(map.len(), count, "a region is named twice");
    map
}
