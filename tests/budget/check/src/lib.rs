//! Reads a linked probe: its functions, who calls whom, their stack frames, their instructions.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use object::elf::{EM_ARM, EM_RISCV, R_ARM_THM_PC22, R_RISCV_CALL_PLT};
use object::read::elf::{ElfFile32, FileHeader};
use object::{Object, ObjectSection, ObjectSymbol, RelocationFlags, RelocationTarget, SymbolKind};

/// Bytes of stack taken to be used by a routine that copies or clears memory. These come compiled,
/// without their frame sizes; the largest of them saves nine registers and keeps 48 bytes.
const COPY_FRAME: u64 = 128;
/// Bytes of stack that a kernel's instructions take of their own, at most, of which the compiler knows nothing:
/// those of `firmware/src/dsp/reach_armv7em.s`. A kernel calls nobody.
const KERNEL_FRAME: u64 = 48;

/// One function of the image.
#[derive(Debug, Default)]
pub struct Function {
    /// Symbol, mangled.
    pub name: String,
    /// Start addresses of the functions that it refers to.
    pub callees: BTreeSet<u64>,
    /// Bytes of stack that it takes; `None` where its compiler did not say.
    pub frame: Option<u64>,
    /// Addresses of floating-point instructions.
    pub float: Vec<u64>,
    /// Addresses of calls through a register.
    pub indirect: Vec<u64>,
}

/// All functions of an image, by start address.
#[derive(Debug)]
pub struct Image {
    /// By start address.
    pub functions: BTreeMap<u64, Function>,
}

impl Image {
    /// Reads an ELF file that was linked with `--emit-relocs`.
    #[must_use]
    pub fn read(data: &[u8]) -> Self {
        let elf = ElfFile32::<object::Endianness>::parse(data).expect("a 32-bit ELF file");
        let machine = elf.elf_header().e_machine(elf.endian());
        assert!(machine == EM_ARM || machine == EM_RISCV, "a machine this check knows");
        // Bit 0 of a Thumb function's address says Thumb.
        let start = |address: u64| {
            if machine == EM_ARM { address & !1 } else { address }
        };

        let mut functions = BTreeMap::new();
        let mut spans = BTreeMap::new();
        let mut is_code = BTreeMap::new();
        for symbol in elf.symbols().filter(|symbol| symbol.section_index().is_some()) {
            let name = symbol.name().expect("symbol name");
            match name.get(..2) {
                Some("$t" | "$x") => drop(is_code.insert(symbol.address(), true)),
                Some("$d") => drop(is_code.insert(symbol.address(), false)),
                _ if symbol.kind() == SymbolKind::Text && symbol.size() > 0 => {
                    let address = start(symbol.address());
                    spans.insert(address, address + symbol.size());
                    functions
                        .insert(address, Function { name: name.to_owned(), ..Function::default() });
                }
                _ => {}
            }
        }
        let owner = |address: u64| {
            let (&first, &end) = spans.range(..=address).next_back()?;
            (address < end).then_some(first)
        };

        let mut direct = BTreeSet::new();
        for section in elf.sections().filter(|s| s.name().is_ok_and(|n| n.starts_with(".text"))) {
            for (at, relocation) in section.relocations() {
                let RelocationTarget::Symbol(index) = relocation.target() else {
                    continue;
                };
                let target = start(elf.symbol_by_index(index).expect("symbol").address());
                let is_call = match relocation.flags() {
                    RelocationFlags::Elf { r_type } if machine == EM_ARM => {
                        r_type == R_ARM_THM_PC22
                    }
                    RelocationFlags::Elf { r_type } => r_type == R_RISCV_CALL_PLT,
                    _ => false,
                };
                if is_call {
                    direct.insert(at);
                }
                // A jump to one's own start is a loop; a call to it is recursion.
                if let Some(caller) = owner(at)
                    && functions.contains_key(&target)
                    && (is_call || target != caller)
                {
                    functions.get_mut(&caller).expect("owner").callees.insert(target);
                }
            }
            let data = section.data().expect("section data");
            let mut offset = 0;
            while offset + 2 <= data.len() {
                let at = section.address() + offset as u64;
                let half = |i: usize| {
                    data.get(offset + i..offset + i + 2)
                        .map_or(0, |b| u16::from_le_bytes([b[0], b[1]]))
                };
                if !is_code.range(..=at).next_back().is_none_or(|(_, &code)| code) {
                    offset += 2;
                    continue;
                }
                let (low, high) = (half(0), half(2));
                let (long, float, indirect) = if machine == EM_ARM {
                    thumb(low, high)
                } else {
                    // The call of an auipc/jalr pair is direct.
                    let (long, float, indirect) = riscv(low);
                    (long, float, indirect && !direct.contains(&at.wrapping_sub(4)))
                };
                if let Some(function) = owner(at).and_then(|first| functions.get_mut(&first)) {
                    function.float.extend(float.then_some(at));
                    function.indirect.extend(indirect.then_some(at));
                }
                offset += if long { 4 } else { 2 };
            }
        }

        // Pairs of a 32-bit address and a ULEB128 size.
        for section in elf.sections().filter(|s| s.name() == Ok(".stack_sizes")) {
            let mut data = section.data().expect("section data");
            while let Some((address, rest)) = data.split_first_chunk::<4>() {
                let length = rest.iter().take_while(|byte| **byte & 0x80 != 0).count() + 1;
                let (size, rest) = rest.split_at(length);
                let size = size.iter().rev().fold(0, |sum, byte| sum << 7 | u64::from(byte & 0x7f));
                if let Some(function) =
                    functions.get_mut(&start(u32::from_le_bytes(*address).into()))
                {
                    function.frame = Some(size);
                }
                data = rest;
            }
        }
        Self { functions }
    }

    /// Start address of the function called `name`.
    #[must_use]
    pub fn entry(&self, name: &str) -> u64 {
        let mut found = self.functions.iter().filter(|(_, function)| function.name == name);
        *found.next().unwrap_or_else(|| panic!("no {name}")).0
    }

    /// The functions reached from `entry`, itself included, each with a chain of names that leads
    /// to it.
    #[must_use]
    pub fn reached(&self, entry: u64) -> BTreeMap<u64, Vec<&str>> {
        let mut seen = BTreeMap::new();
        let mut open = vec![(entry, Vec::new())];
        while let Some((address, mut chain)) = open.pop() {
            let function = &self.functions[&address];
            chain.push(function.name.as_str());
            if let Entry::Vacant(vacant) = seen.entry(address) {
                vacant.insert(chain.clone());
                open.extend(function.callees.iter().map(|&callee| (callee, chain.clone())));
            }
        }
        seen
    }

    /// The largest sum of frames along any chain of calls from `entry`, with a kernel at its end.
    ///
    /// # Errors
    /// Names the function where there is no bound: it is recursive, calls through a pointer, or
    /// its frame is not known.
    pub fn stack(&self, entry: u64) -> Result<u64, String> {
        Ok(self.deepest(entry, &mut Vec::new())? + KERNEL_FRAME)
    }

    fn deepest(&self, address: u64, chain: &mut Vec<u64>) -> Result<u64, String> {
        let function = &self.functions[&address];
        if chain.contains(&address) {
            return Err(format!("{} is recursive", function.name));
        }
        if !function.indirect.is_empty() {
            return Err(format!("{} calls through a pointer", function.name));
        }
        let copies = ["memcpy", "memmove", "memset", "memclr"];
        let allowed = copies.iter().any(|name| function.name.contains(name)).then_some(COPY_FRAME);
        let frame = function.frame.or(allowed);
        let frame = frame.ok_or_else(|| format!("{}: frame not known", function.name))?;
        chain.push(address);
        let mut below = 0;
        for &callee in &function.callees {
            below = below.max(self.deepest(callee, chain)?);
        }
        chain.pop();
        Ok(frame + below)
    }
}

/// The 32-bit words of the constant called `name`.
#[must_use]
pub fn constant(data: &[u8], name: &str) -> Vec<u32> {
    let elf = ElfFile32::<object::Endianness>::parse(data).expect("a 32-bit ELF file");
    let symbol = elf.symbols().find(|symbol| symbol.name() == Ok(name));
    let symbol = symbol.unwrap_or_else(|| panic!("no {name}"));
    let section = symbol.section_index().and_then(|index| elf.section_by_index(index).ok());
    let bytes = section.and_then(|section| {
        section.data_range(symbol.address(), symbol.size()).expect("section data")
    });
    let (words, _) = bytes.expect("a constant in a section").as_chunks();
    words.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

/// Whether an instruction is 32 bits long, is floating point, and is a branch to a register.
///
/// Floating point on Armv7E-M: coprocessors 10 and 11, in the coprocessor space of the encoding.
fn thumb(low: u16, high: u16) -> (bool, bool, bool) {
    let long = low >> 11 >= 0b11101;
    let float = long && low & 0xec00 == 0xec00 && high >> 9 & 7 == 0b101;
    // BLX Rm, and BX Rm other than the return, BX LR.
    let indirect = low & 0xff87 == 0x4780 || (low & 0xff87 == 0x4700 && low != 0x4770);
    (long, float, indirect && !long)
}

/// As [`thumb`], for RV32IMC: there are no floating-point instructions, so any is a mistake.
fn riscv(low: u16) -> (bool, bool, bool) {
    let long = low & 3 == 3;
    let opcode = low & 0x7f;
    let float = long && matches!(opcode, 0x07 | 0x27 | 0x43 | 0x47 | 0x4b | 0x4f | 0x53);
    let link = low >> 7 & 31;
    let jalr = long && opcode == 0x67 && link == 1;
    let c_jalr = low & 0xf07f == 0x9002 && link != 0;
    (long, float, jalr || c_jalr)
}
