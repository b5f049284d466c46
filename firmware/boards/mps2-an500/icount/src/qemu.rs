//! The part of QEMU's plugin interface (`qemu-plugin.h`, version 1) that is needed, and nothing of it
//! that is unsafe to call.

use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::sync::atomic::AtomicU64;

/// Version of the interface described here: QEMU 4.2 to 8.
pub const VERSION: c_int = 1;

/// Identifies the plugin.
pub type PluginId = u64;

/// A block of translated instructions; only QEMU knows what is in it.
#[repr(C)]
pub struct TranslationBlock(c_void);

/// One of its instructions.
#[repr(C)]
pub struct Instruction(c_void);

/// Versions of the interface that QEMU offers.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Versions {
    pub min: c_int,
    pub cur: c_int,
}

/// The start of `qemu_info_t`.
#[repr(C)]
pub struct Info {
    target_name: *const c_char,
    pub version: Versions,
}

type Translated = extern "C" fn(PluginId, *mut TranslationBlock);
type Executed = extern "C" fn(c_uint, *mut c_void);

/// `QEMU_PLUGIN_INLINE_ADD_U64`.
const INLINE_ADD_U64: c_int = 0;
/// `QEMU_PLUGIN_CB_NO_REGS`.
const NO_REGISTERS: c_int = 0;

unsafe extern "C" {
    fn qemu_plugin_register_vcpu_tb_trans_cb(id: PluginId, callback: Translated);
    fn qemu_plugin_tb_n_insns(block: *const TranslationBlock) -> usize;
    fn qemu_plugin_tb_get_insn(block: *const TranslationBlock, index: usize) -> *mut Instruction;
    fn qemu_plugin_insn_data(instruction: *const Instruction) -> *const c_void;
    fn qemu_plugin_insn_size(instruction: *const Instruction) -> usize;
    fn qemu_plugin_register_vcpu_insn_exec_inline(
        instruction: *mut Instruction,
        operation: c_int,
        target: *mut c_void,
        operand: u64,
    );
    fn qemu_plugin_register_vcpu_insn_exec_cb(
        instruction: *mut Instruction,
        callback: Executed,
        flags: c_int,
        data: *mut c_void,
    );
}

/// The plugin's arguments.
///
/// # Safety
/// `argv` holds `argc` strings that end with a zero.
pub unsafe fn arguments(argc: c_int, argv: *const *const c_char) -> Vec<String> {
    let count = usize::try_from(argc).unwrap_or(0);
    // SAFETY: as promised by the caller.
    let argument = |i| unsafe { CStr::from_ptr(*argv.add(i)) };
    (0..count).map(|i| argument(i).to_string_lossy().into_owned()).collect()
}

/// Has `callback` called whenever a block was translated.
pub fn on_translation(id: PluginId, callback: Translated) {
    // SAFETY: `id` is the one that QEMU gave, and the callback never unloads.
    unsafe { qemu_plugin_register_vcpu_tb_trans_cb(id, callback) }
}

/// The instructions of a block, valid for the time of the translation callback.
pub fn instructions(
    block: *const TranslationBlock,
) -> impl Iterator<Item = *mut Instruction> + use<> {
    // SAFETY: QEMU gave the block to the callback that this is called from.
    let count = unsafe { qemu_plugin_tb_n_insns(block) };
    // SAFETY: as above, and the index is below the count.
    (0..count).map(move |i| unsafe { qemu_plugin_tb_get_insn(block, i) })
}

/// Whether an instruction starts with these bytes, which no longer one does.
///
/// Its size does not tell: at the end of a page QEMU looks at the next instruction before it ends the
/// block, and what it looked at counts with the one before.
pub fn is(instruction: *const Instruction, bytes: [u8; 2]) -> bool {
    // SAFETY: the instruction is of a block in translation; QEMU holds as many bytes as it says.
    unsafe {
        qemu_plugin_insn_size(instruction) >= bytes.len()
            && qemu_plugin_insn_data(instruction).cast::<[u8; 2]>().read() == bytes
    }
}

/// Has the generated code add one to `count` before the instruction.
pub fn count(instruction: *mut Instruction, count: &'static AtomicU64) {
    // SAFETY: the instruction is of a block in translation; the counter lives as long as QEMU.
    unsafe {
        let target = count.as_ptr().cast();
        qemu_plugin_register_vcpu_insn_exec_inline(instruction, INLINE_ADD_U64, target, 1);
    }
}

/// Has `callback` called before the instruction.
pub fn on_execution(instruction: *mut Instruction, callback: Executed) {
    let data = std::ptr::null_mut();
    // SAFETY: the instruction is of a block in translation; the callback takes no data.
    unsafe { qemu_plugin_register_vcpu_insn_exec_cb(instruction, callback, NO_REGISTERS, data) }
}
