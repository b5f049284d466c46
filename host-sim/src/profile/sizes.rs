//! What a program takes of a board's memories, from its ELF file.

use object::elf::{SHF_ALLOC, SHF_WRITE};
use object::{File, Object, ObjectSection, SectionFlags, SectionKind};
use std::path::Path;

/// Bytes of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Code, constants and the initial values of data: what is programmed.
    pub flash: u64,
    /// Data, without the stack.
    pub ram: u64,
}

impl Sizes {
    /// Of the program in `file`.
    ///
    /// # Errors
    /// If it cannot be read, or is no ELF file; names the file.
    pub fn of(file: &Path) -> Result<Self, std::io::Error> {
        let named = |error: String| std::io::Error::other(format!("{}: {error}", file.display()));
        let bytes = std::fs::read(file).map_err(|error| named(error.to_string()))?;
        let elf = File::parse(bytes.as_slice()).map_err(|error| named(error.to_string()))?;
        let mut sizes = Self { flash: 0, ram: 0 };
        for section in elf.sections() {
            let SectionFlags::Elf { sh_flags } = section.flags() else { continue };
            if sh_flags & u64::from(SHF_ALLOC) == 0 {
                continue;
            }
            if section.kind() != SectionKind::UninitializedData {
                sizes.flash += section.size();
            }
            if sh_flags & u64::from(SHF_WRITE) != 0 {
                sizes.ram += section.size();
            }
        }
        Ok(sizes)
    }
}
